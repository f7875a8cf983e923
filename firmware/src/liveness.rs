//! One rule of liveness: one loop feeds the watchdog, and only as long as all tasks answer.
//!
//! A task *answers* at the top of its loop; one that waits does so every [`CHECK_IN_PERIOD`]. The
//! *feeder* is the loop that checks, drives and feeds. A task that is silent for too long has *hung*:
//! from then on the feeder keeps the outputs off and feeds no more, whatever comes.
//!
//! | | controller | CM-5 |
//! |---|---|---|
//! | feeder, and how often it feeds | `control`, 1 ms | `bridge::tasks::bus`, 50 ms at the most |
//! | a task hangs after a silence of | [`LONGEST_SILENCE`] | [`BRIDGE_SILENCE`] |
//! | the watchdog bites after | [`WATCHDOG_PERIOD`], 35 to 96.5 ms | [`BRIDGE_WATCHDOG_PERIOD`], 170 to 471 ms |
//!
//! The spread is that of the STM32F4's LSI, 17 to 47 kHz (data sheet). So a controller's outputs are
//! off within 91 ms of a hung task's last answer, and within 100 ms if control hangs, wherever it does:
//! in a critical section, an interrupt handler, a log. Control that is late by 33 ms is safe from a bite
//! on any chip. A CM-5 drives nothing itself: its watchdog restarts it.
//!
//! As long as a task has yet to answer for the first time, the feeder feeds but drives nothing. While
//! commands are held back for upkeep it feeds and drives as before, and no silence is counted. Neither
//! may last longer than a second.

use core::cell::Cell;

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::RawMutex;
use embassy_time::Duration;

/// A task that waits for something answers at least this often. One that works answers when the work
/// is done: a picture 2 ms, a telemetry frame 4.3 ms, a ranger's turn 40 ms.
pub const CHECK_IN_PERIOD: Duration = Duration::from_millis(50);
/// The longest work between two answers is an arm's longest frame at 9600 baud, 87.5 ms; a PMS5005's takes
/// 12 ms at 115200 baud, and 69 ms at 19200.
pub const LONGEST_SILENCE: Duration = Duration::from_millis(90);
/// The longest report, of 100 servos at 57,600 baud, takes 140 ms; a check adds the
/// feeder's whole interval, 50 ms, even to a task that has just answered.
pub const BRIDGE_SILENCE: Duration = Duration::from_millis(200);
/// How long a start or an upkeep may take, in passes of control, of which none happens while a sector
/// is erased. Setting the display up takes 30 ms, a save of settings 40 ms (twice that in damaged flash),
/// the wait for the last answer to leave before a restart 100 ms.
const LONGEST_EXCUSE_MS: u16 = 1000;

/// After so long without food the controller's watchdog resets the chip, which turns the outputs off, by the nominal LSI of 32 kHz: 205 counts of 8
/// cycles.
pub const WATCHDOG_PERIOD: Duration = Duration::from_micros(51_250);
/// The CM-5's: 1000 counts.
pub const BRIDGE_WATCHDOG_PERIOD: Duration = Duration::from_millis(250);
/// Both, between their start and the first food, and after
/// [`before_erase`](crate::ports::SystemPort::before_erase), with nothing driven: 4096 counts, the
/// most there are, 697 ms at 47 kHz. Erasing a sector of 16 KiB stalls the core of an STM32F4 for 500
/// ms at the most.
pub const ERASE_PERIOD: Duration = Duration::from_millis(1024);

/// What the feeder may do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Liveness {
    /// Feed, but drive nothing: a task has still to begin.
    Starting,
    /// Drive and feed.
    Alive,
    /// Drive nothing and feed no more.
    Hung,
}

/// How long each of `TASKS` tasks has been silent, in the time that the feeder reports. Control reports
/// 1 ms a pass, however late it is, and so nobody's silence grows while it is held up; the CM-5's reports
/// the time that has passed.
pub(crate) struct RollCall<M: RawMutex, const TASKS: usize> {
    longest_silence_ms: u16,
    state: Mutex<M, Cell<State<TASKS>>>,
}

#[derive(Clone, Copy)]
struct State<const TASKS: usize> {
    /// In ms; `None` before a task has answered for the first time.
    silence: [Option<u16>; TASKS],
    /// For how many ms in a row no silence has been counted.
    excused: u16,
    has_hung: bool,
}

impl<M: RawMutex, const TASKS: usize> RollCall<M, TASKS> {
    /// Nobody has answered yet.
    pub(crate) const fn new(longest_silence: Duration) -> Self {
        let state = State { silence: [None; TASKS], excused: 0, has_hung: false };
        Self {
            longest_silence_ms: longest_silence.as_millis() as u16, // 200 at the most
            state: Mutex::new(Cell::new(state)),
        }
    }

    /// The task of this number, 0 to `TASKS` - 1, answers.
    pub(crate) fn answer(&self, task: usize) {
        self.change(|state| {
            if let Some(silence) = state.silence.get_mut(task) {
                *silence = Some(0);
            }
        });
    }

    /// The feeder checks, and reports the time since its last check. If commands are `held` back, a task
    /// that waits for one to be carried out has not hung: no silence is counted.
    pub(crate) fn check(&self, passed_ms: u16, held: bool) -> Liveness {
        self.change(|state| {
            let has_begun = !state.silence.contains(&None);
            if has_begun && !held {
                state.excused = 0;
                for silence in state.silence.iter_mut().flatten() {
                    *silence = silence.saturating_add(passed_ms);
                    state.has_hung |= *silence > self.longest_silence_ms;
                }
            } else {
                state.excused = state.excused.saturating_add(passed_ms);
                state.has_hung |= state.excused > LONGEST_EXCUSE_MS;
            }
            match (state.has_hung, has_begun) {
                (true, _) => Liveness::Hung,
                (false, true) => Liveness::Alive,
                (false, false) => Liveness::Starting,
            }
        })
    }

    fn change<T>(&self, change: impl FnOnce(&mut State<TASKS>) -> T) -> T {
        self.state.lock(|cell| {
            let mut state = cell.get();
            let result = change(&mut state);
            cell.set(state);
            result
        })
    }
}
