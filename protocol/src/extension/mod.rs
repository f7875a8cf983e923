//! What no controller of old has: settings, health, faults, upkeep. A format of its own, which two
//! protocols carry: a number (DID) and DATA. [`Request`] is what a host asks, [`Answer`] what the
//! board tells; [`Fault`] numbers what can go wrong.
//!
//! | carried by | as | written by |
//! |---|---|---|
//! | the [PMS5005](crate::pms5005) | DIDs 96 to 111, and DID 7's sub-commands from 0x80; answers with RID 0, RES 255 | [`Command::Extension`](crate::pms5005::Command::Extension), [`encode_answer`](crate::pms5005::encode_answer) |
//! | [ARCOS](crate::arcos::extension) | commands and packets 96 to 101 and 103 | [`encode_request`](crate::arcos::extension::encode_request), [`encode_answer`](crate::arcos::extension::encode_answer) |
//!
//! Its rules and bytes stand on the [page of the wire](crate#the-extension): what a host asks under
//! [Requests](crate#requests), what the board tells DID by DID behind it. Words and numbers are sent low
//! byte first; ranges are inclusive.
//!
//! [`VERSION`] rises when bytes change. They change at the end only: an answer grows behind the bytes
//! that it has, and codes and DIDs are added.
//!
//! Who only reads keeps nothing running: DIDs 96 to 111 are no signs of life ([`is_read`]). Nothing here
//! is a measured value that could give way: unlike telemetry, DATA may hold `5E 0D`.

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

/// Data IDs (page of the wire, [Requests](crate#requests)); the extension owns 96 to 111.
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
