//! What no controller of old has: settings, health, faults, upkeep. A format of its own, which two
//! protocols carry: a number (DID) and DATA. [`Request`] is what a host asks, [`Answer`] what the
//! board tells; [`Fault`] numbers what can go wrong.
//!
//! | carried by | as | written by |
//! |---|---|---|
//! | the [PMS5005](crate::pms5005) | DIDs 96 to 111, and DID 7's sub-commands from 0x80; answers with RID 0, RES 255 | [`Command::Extension`](crate::pms5005::Command::Extension), [`encode_answer`](crate::pms5005::encode_answer) |
//! | [ARCOS](crate::arcos::extension) | commands and packets 96 to 101 and 103 | [`encode_request`](crate::arcos::extension::encode_request), [`encode_answer`](crate::arcos::extension::encode_answer) |
//!
//! All of it lies off the manuals' maps: a host that never sends one of them sees an original.
//! Frames, checksums and acknowledgements are the carrier's. Beyond an acknowledgement a request gets
//! one answer, which is an [`Outcome`] where there is nothing to read; a refused one changes nothing, is
//! counted as any refused frame is, and its outcome names the error. Words and numbers are sent low byte
//! first; ranges are inclusive.
//!
//! [`VERSION`] rises when bytes change. They change at the end only: an answer grows behind the bytes
//! that it has, and codes and DIDs are added. So a reader passes over bytes behind those it knows, and
//! takes counters that an older board does not send as 0.
//!
//! Exceptions: health (DID 98) is a stream, so N of it are N answers, and to stop it (0) has none.
//! Eight other answers may wait for the line; one that finds no room is dropped and counted
//! ([`Counters::answers_dropped`]), though its request was carried out. A host that waits for each
//! answer before it asks again loses none.
//!
//! Busy ([`Verdict::Busy`]) is the outcome of a save, a reset or a reboot while another of them is
//! pending, of setting settings while a factory reset is, which would undo them, and of asking for
//! a fault (DID 100), or setting an encoder's count, while the answer about another is pending: ask again when that has come.
//!
//! # Table E.1: from host to board
//! | DID | definition | DATA | answer |
//! |---|---|---|---|
//! | 7 | Set settings, all of them or none, in one control period | `[0x80 + number (2 bytes) + value (4 bytes)]+`, 36 of them at most | 101 |
//! | 7 | Clear the latched faults, but for those of the board whose cause is still there | `0x81` | 101 |
//! | 7 | Save the settings; only with all motors and servos off | `0x82` | 101, when it is done |
//! | 7 | Factory reset: the defaults, in force and saved; only with all off | `0x83` | 101, when it is done |
//! | 7 | Reboot; only with all off | `0x84` | 101, then the board restarts |
//! | 7 | Reboot into the ROM's DFU loader; only with all off | `0x85` | 101, then the board restarts |
//! | 7 | Set the count of an encoder; only with its channel off (a move that is paused is forgotten) | `0x86` + channel (1 byte, from 0) + count (4 bytes, signed) | 101 |
//! | 96 | Read a setting | number (2 bytes) | 96, or 101 |
//! | 97 | Who are you? | none | 97 |
//! | 98 | Health | as DID 123: none is continuously, N is N times, 0 is stop | 98: the first at once, but never less than the period of telemetry (setting 32) behind the one before or the start |
//! | 99 | Counters | none | 99 |
//! | 100 | The record of a latched fault; one at a time | its place in the list (1 byte), from 0 | 100, or 101 |
//! | 102 | The machine state; PMS5005 only | as DID 123 | 102: the first at once, then every period of setting 33 |
//! | 103 | What was refused, by reason | none | 103 |
//! | 104 | How is the recorder? PMS5005 only | none | 104 |
//! | 104 | Begin a recording, and forget the one before | channels (1 byte), trigger (1), decimation (2), samples (2), before (2) ([`Setup`]) | 104 |
//! | 105 | Read blocks of the recording | number of the first (2 bytes), how many (2); 0 ends what was asked before | as many 105, one behind the other |
//!
//! DID 7 is an extension's when DATA begins with 0x80 or above. Such a frame holds settings, or one
//! of the other sub-commands alone; the manual's do not mix with them.
//!
//! # Table E.2: from board to host
//! | DID | bytes | DATA |
//! |---|---|---|
//! | 96 | 1 to 2 | Number of the setting |
//! | | 3 to 4 | Number of the next setting, 0 behind the last; asking for 0 yields the first |
//! | | 5 to 8 | Value (signed) |
//! | | 9 to 12, 13 to 16 | Lowest and highest value |
//! | | 17 to 20 | Default |
//! | | 21 | Unit ([`Unit`]) |
//! | | 22 to the end | Name, ASCII, 24 bytes at most; of several of one name (channels, joints) a space and a digit behind it tell which |
//! | 97 | 1, 2, 3 | Version of the firmware: major, minor, patch |
//! | | 4 | Version of this extension ([`VERSION`]) |
//! | | 5 | Why the board has started ([`ResetCause`]) |
//! | | 6 | Where its settings come from ([`Origin`]) |
//! | 98 | 1 to 4 | Uptime in ms; wraps after 49 days |
//! | | 5 to 6 | Worst control latency since boot in microseconds: from the tick that begins a control period until its outputs stand |
//! | | 7 to 8 | Stack high-water mark: the most that was ever used, in bytes; 0 is unknown |
//! | | 9 | Latched faults, 47 at the most |
//! | | 10 to 13 | Control periods missed: those that have begun a period late or more; wraps |
//! | 99 | 1 to 72 | 18 counters of 4 bytes, in the order of [`Counters`]; they wrap |
//! | 100 | 1 | Place in the list, as asked |
//! | | 2 | Fault records, 16 at the most: of faults beyond them only the number is known (DID 98); when the place is not below it, nothing follows |
//! | | 3 | Number of the fault ([`Fault`]) |
//! | | 4 | Channel 0 to 5; 255 is the board |
//! | | 5 to 8 | Uptime in ms when it tripped |
//! | | 9 to 14 | Three values of 2 bytes (signed) from then, by the fault ([`Fault::values`]) |
//! | 101 | 1 | DID of the request |
//! | | 2 | First byte of its DATA, 0 if it had none |
//! | | 3 | What came of it ([`Verdict`]) |
//! | | 4 to 5 | Number of the setting that it is about, or 0 |
//! | 102 | 1 to 2 | The low 16 bits of the uptime in ms |
//! | | 3 | Bits: 0 the host is silent, 1 an obstacle, 2 a fault is latched ([`flag`]) |
//! | | 4 | Commands refused; wraps |
//! | | 5 to 10 | Main board, motor and servo batteries (A/D) |
//! | | 11 to 112 | Channels 1 to 6, 17 bytes each: |
//! | | +0 to 3 | position (signed), counts of its sensor since boot, turn by turn |
//! | | +4 to 7 | velocity (signed), counts per second |
//! | | +8 to 9 | set-point (signed), by the mode |
//! | | +10 to 11 | duty (signed), 1/16384 |
//! | | +12 to 13 | motor current (A/D) |
//! | | +14 | [`Mode`] |
//! | | +15 | [`Reason`] |
//! | | +16 | more of the reason: the number of the fault, or the DID of the command; 0 |
//! | | 113 to 124 | Servos 1 to 6: pulse width in 1/2250 ms, 0 is no pulse |
//! | 103 | 1 to 36 | 9 counters of 4 bytes, in the order of [`Refusals`]; they wrap |
//! | 104 | 1 | Number of the recording, 1 to 255 and round again; 0 is none since the start |
//! | | 2 | [`Phase`] |
//! | | 3 | Channels: bit 0 is channel 1 |
//! | | 4 | [`Trigger`] |
//! | | 5 to 6 | Decimation: control periods from one sample to the next |
//! | | 7 to 8 | Samples in all: as asked, or what fits |
//! | | 9 to 10 | Samples taken so far |
//! | | 11 to 12 | How many of them before the trigger: fewer than asked, if it came early |
//! | | 13 to 16 | Uptime in ms at the trigger, 0 before it |
//! | | 17 to 18 | Rows that the memory holds; a row is a sample of one channel |
//! | 105 | 1 | Number of the recording |
//! | | 2 to 3 | Number of the block, from 0 |
//! | | 4 to the end | 8 rows of 15 bytes, fewer in the last block, none if there is no such block or the recording is not done: |
//! | | +0 to 14 | as in a channel of DID 102: position, velocity, set-point, duty, current, mode |
//!
//! Rows go sample by sample, and within a sample channel by channel. A sample at the trigger is always
//! taken, so the gap before it may be shorter than the others. Blocks (DID 105) wait for the line behind
//! everything else that is due; 32 KiB of rows take some 3 s at 115,200 baud. What a host misses it asks for again.
//!
//! A frame of DID 102 takes 133 bytes. Beside the default telemetry (3 frames every 50 ms, 2,340 bytes
//! a second) and without it a line has room for so many a second; asked for more, streams take turns and
//! telemetry is skipped:
//!
//! | baud | beside telemetry | alone |
//! |---|---|---|
//! | 19,200 | none | 14 |
//! | 38,400 | 11 | 28 |
//! | 57,600 | 25 | 43 |
//! | 115,200 | 69 | 86 |
//!
//! On a line slower than 16,000 baud a frame takes longer than the firmware's tasks may be silent: there a
//! board must not be asked for it.
//!
//! Who only reads or records keeps nothing running: DIDs 96 to 111 are no signs of life ([`is_read`]).
//!
//! Nothing here is a measured value that could give way: unlike telemetry, DATA may hold `5E 0D`.

mod answer;
mod fault;
mod recorder;
mod request;
mod state;

pub use answer::{
    Answer, Counters, Description, Health, Identity, Latched, Origin, Outcome, Refusals,
    ResetCause, Unit, Verdict,
};
pub use fault::{Fault, FaultRecord};
pub use recorder::{BLOCK, Block, Phase, Recording, Row, Setup, Trigger};
pub use request::{Action, Assignments, Request};
pub use state::{ChannelState, MachineState, Mode, Reason, flag};

/// The version of this extension that [`Identity`] tells.
pub const VERSION: u8 = 3;

/// Data IDs (Tables E.1 and E.2); the extension owns 96 to 111.
pub mod did {
    /// The PMS5005's system parameters, of which sub-commands from 0x80 on are the extension's.
    pub const PARAMETERS: u8 = crate::pms5005::did::PARAMETERS;
    /// A setting.
    pub const SETTING: u8 = 96;
    /// Version and how the board has started.
    pub const IDENTITY: u8 = 97;
    /// Health.
    pub const HEALTH: u8 = 98;
    /// Counters.
    pub const COUNTERS: u8 = 99;
    /// A latched fault.
    pub const FAULT: u8 = 100;
    /// What came of a request.
    pub const OUTCOME: u8 = 101;
    /// The machine state.
    pub const STATE: u8 = 102;
    /// What was refused, by reason.
    pub const REFUSALS: u8 = 103;
    /// The recorder.
    pub const RECORDING: u8 = 104;
    /// A block of the recording.
    pub const BLOCK: u8 = 105;
    /// The last DID of the extension.
    pub const LAST: u8 = 111;
}

/// Whether a frame with this DID drives nothing: it asks to be told something, or to record.
pub fn is_read(did: u8) -> bool {
    (did::SETTING..=did::LAST).contains(&did)
}

/// Whether a frame with this DID and DATA is the extension's, well formed or not.
pub fn owns(did: u8, data: &[u8]) -> bool {
    let is_sub_command =
        did == did::PARAMETERS && data.first().is_some_and(|&sub| sub >= request::SET);
    is_sub_command || is_read(did)
}
