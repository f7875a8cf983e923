//! The page: a board seen, driven and tuned in a browser, and the JSON interface between them.
//!
//! ```text
//!  browser ──JSON──> server ──> Panel ──> Session ──> board     (a panel is pure: it runs on virtual time)
//!          <──JSON── (sockets)   │
//!                                └──> world, if the board is a virtual one
//! ```
//!
//! - [`Panel`]: what pages may do and are told, without I/O; `serve`: HTTP, sockets and a line around it;
//! - `page/`: what the browser gets: one HTML file, its style and its scripts. Nothing else is fetched. Only
//!   `socket.js` knows that there is a server: with another in its place, page and panel are one program.
//!
//! # The interface
//! The same for every transport. `GET /` and what it names are the page; `GET /socket` is a WebSocket whose text
//! messages are one JSON object each. Motors and servos are 1 to 6, counts those of a motor's sensor.
//!
//! ## What a page says
//! `{"do": NAME, "id": N, ...}`. With an `id`, any whole number of the page's, it gets one answer: `{"id": N, "ok": VALUE}`
//! or `{"id": N, "error": TEXT}`, one line that names what is wrong and what to do.
//!
//! | do | with | armed | |
//! |---|---|---|---|
//! | `stop` | | no | everything off, at once, and another page that is armed is disarmed; ok `{"confirmed", "stands", "opposed"}` when that is known |
//! | `arm`, `disarm` | | no | takes the right to write, if no other page has it; gives it back, and what it drives is stopped |
//! | `alive` | | | due every 50 ms from the page that is armed: after 250 ms without (3 s while it drives nothing) what it drives is stopped, and it is disarmed. Servos stay where they are |
//! | `drive` | `motor`, one of `velocity` (counts/s), `position` (counts), `duty` (percent); `ms` of ramp, 0 | yes | motor runs until it is told otherwise; ok null when acknowledged |
//! | `off` | `motor` | yes | stops this one |
//! | `step` | `motor`, `velocity` or `position`, `ms`: how long, 2000 | yes | ok as [below](#a-step) when it is over; the motor is stopped then |
//! | `plan` | `motor` | no | what tuning it will do at the most: ok `{"moves": "turns", "seconds"}`, it turns freely, for so long in all; or `{"moves": "stays", "counts"}`, it stays within so many counts of where it stands |
//! | `check` | `motor`, `duty`: percent at the most, 50; `set_polarity`, false: whether it may be turned round | yes | a moment of duty each way; ok as [below](#a-check) at its end |
//! | `tune` | `motor`, `duty`: percent at the most, 50; `loop`: `"velocity"` or `"position"`, by its sensor | yes | finds the motor, gains for it, and confirms them by a step; ok as [below](#a-tuning) at its end. All settings are then as before: `set` puts what was found in force |
//! | `servo` | `servo`, `us`, `ms` | yes | a pulse in microseconds, which holds; null is no pulse |
//! | `gpio` | `outputs`: 0 to 255 | yes | bit 0 is GPIO0 |
//! | `lcd` | `image`: 2048 hex digits | yes | sixteen parts of 64 columns as DID 23 has them |
//! | `zero` | `motor` | yes | its encoder's count becomes 0; the motor must be off |
//! | `clear` | `motor`, or nothing: all | yes | clears what is latched of a motor; of the board only together with all |
//! | `set` | `values`: `{NAME: NUMBER, ...}` | yes | settings in force, all or none (unless a stop interrupts it), not saved |
//! | `save`, `reset` | | yes | saves what is in force; the defaults, saved. Only with all off |
//! | `settings` | | no | reads all settings anew |
//! | `backup` | | no | ok is the text of a file |
//! | `diff` | `text` | no | ok `{"differ": [{"name", "board", "file"}], "missing": [NAME]}` |
//! | `restore` | `text` | yes | puts a backup in force and saves it, all or none; ok as `diff`'s |
//! | `world` | `set`: `{KEY: VALUE, ...}` | no | changes a virtual board's world |
//!
//! ## What it is told
//! `{"tell": NAME, ...}`, when it opens and whenever it changes:
//!
//! | tell | with |
//! |---|---|
//! | `page` | `name` of this page (`"page 2"`) |
//! | `board` | `link`, `connected`, `why` if not; `kind` (`"pms5005"`, `"pioneer-arm"`, `"cm5"`), `title`, `firmware` (`"0.1.0"` or null), `extension`, `start` and `origin` (why it started, where its settings are from; words), `has_state`, `is_virtual` |
//! | `armed` | `by`: the name of the page that is armed, or null; `you` |
//! | `state` | up to 50 a second: `ms` (of the board's uptime, never back), `silent`, `obstacle`, `fault`, `refused`, `battery_v` (board, motors, servos), `servos_us` (null is no pulse), `motors`: six of `mode` (`"off"`, `"PWM"`, `"position"`, `"velocity"`), `set_point` (counts/s, counts turn by turn, or percent in PWM), `position`, `velocity`, `duty` (percent), `current` (A), `reason` (words or null), `ours` (driven from a page here) |
//! | `sensors` | up to 10 a second: `sonar_cm` (255 nothing), `ir_cm` (10 to 80), `human`, `tilt`, `overheat`, `temperature`, `custom`, `reference` (A/D), `potentiometers` (A/D), `inputs` (bits), `remote` |
//! | `health` | once a second: `uptime_ms`, `latency_us` (worst), `stack`, `missed` (periods), `faults` (how many), `counters` and `refusals` (names and numbers), `frames` and `bytes` a second on this link |
//! | `faults` | `faults`: a list of `number`, `name`, `whose`, `motor` (or null), `ms`, `remedy`, `values`: `[NAME, NUMBER]` pairs |
//! | `settings` | `settings`: a list of `name`, `group`, `value`, `default`, `low`, `high`, `unit` (words); `unsaved`: whether something was set since the last save |
//! | `outputs` | what pages here have set, as the wire does not tell it: `gpio` (or null), `lcd` (or null) |
//! | `job` | what is being checked or tuned: `motor` (null: nothing is), `what` (`"check"`, `"tune"`), `doing` (words), `has_state`: whether `state` comes meanwhile |
//! | `note` | `text`: what happened by itself, as a stop and why |
//! | `joints` | of an arm: `powered`, `connected`, `joints`: six of `position` (ticks), `moving` |
//! | `servos` | of a CM-5: a list of `id` and, if it reports, `position`, `speed`, `load`, `voltage_v`, `temperature_c` |
//! | `world` | of a virtual board, 5 a second: `state`, the simulated truth as the inspector tells it |
//!
//! ## A step
//! `{"motor", "unit", "target", "samples": [[MS, VALUE, PERCENT OF DUTY]], "rise_ms", "overshoot_percent", "settling_ms",
//! "steady_error", "why"}`; rise and settling are null if they never came, `why` is what limited it at the end, or null. A board
//! that records has been asked for every few ms, another for a machine state every 20 ms.
//!
//! ## A check
//! `{"motor", "ways": [{"moved", "current", "duty"}, ...], "has_current", "turned_round"}`: with rising counts and with
//! falling ones, how many counts it moved as it should, the current (A/D) above that at rest and the highest duty in percent;
//! whether a current was seen; whether setting "polarity" was turned round. What is wrong with the wiring is an error.
//!
//! A check or a tuning wants its motor off, nothing else driven from a page, a board that tells its machine state and has a recorder
//! (extension 3). While it runs nothing is driven or set from a page. It ends as any drive from a page does; the answer is
//! an error then, and the settings are set back, unless the board is gone.
//!
//! ## A tuning
//! - `motor`, `loop`, `unit` and `target` of the step that confirmed it, `checked`: as above without `motor`;
//! - `fit`: `gain` (counts/s at full drive), `time_constant_ms`, `dead_time_ms`, `dead_band` (percent of duty, with rising and
//!   with falling counts), `percent` of the motion that this explains;
//! - `gains`: `kp`, `kd`, `reset_ms` (null of a position loop); `settings`: a list of `number`, `name`, `before`, `value`, all
//!   that makes it so;
//! - `predicted`, `measured`: `rise_ms`, `overshoot_percent`, `settling_ms`, `steady_error` of the step;
//! - `curves`: `measured` and `predicted`, a value every `interval_ms`.

#[cfg(feature = "io")]
mod host;
#[cfg(feature = "io")]
mod http;
mod panel;
#[cfg(feature = "io")]
mod server;

pub use panel::{ALIVE, Asker, PageId, Panel};
#[cfg(feature = "io")]
pub use server::{Page, Serve, World, serve};
