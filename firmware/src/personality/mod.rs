//! Personalities: how a controller of old presents itself to its host.
//!
//! A [`Session`] is one without I/O: bytes and the time go in, [`Effect`]s and bytes come out. It
//! knows the wire and the controller's vocabulary, never a port. `app::link` runs any of them.
//!
//! The CM-5 is none: it has no controller, but a second line to servos of its own. It is the
//! [`bridge`](crate::bridge).

mod extension;
pub mod pioneer_arm;
pub mod pms5005;

use core::ops::Range;

use embassy_time::Instant;
use protocol::deframe::{Framing, Reception};
use protocol::extension::Counters;

use crate::command::Command;
use crate::controller::Snapshot;
use crate::ports::Program;
use crate::reception::{TimedReceiver, count};
use crate::recorder::{self, Recording, Row};
use crate::settings::Settings;

pub use extension::Boot;

/// Room for the longest frame that any session sends: the PMS5005's machine state. A task that is silent
/// for more than 90 ms counts as hung (`app`): at 115200 baud these take 12 ms; an arm's 84 at its 9600
/// take 87.5.
pub const MAX_FRAME: usize = 133;

/// What a host asks of the board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effect {
    /// Something of the controller. What a [`Command::Adopt`] puts into force,
    /// [`settings`](Session::settings) tells.
    Control(Command),
    /// To show a sixteenth of an image.
    Show(Picture),
    /// To begin a recording.
    Record(recorder::Setup),
    /// Something that only a board at rest can do. The next one is asked for when the session has
    /// been told what came of this one.
    Upkeep(Upkeep),
}

/// What is done while control is held back and nothing is driven.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Upkeep {
    /// To save [these settings](Session::to_save).
    Save,
    /// To start a program.
    Start(Program),
}

/// Why upkeep was not done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UpkeepRefused {
    /// A motor or a servo is on.
    OutputsOn,
    /// This board cannot start such a program.
    NotAvailable,
    /// The flash does not take the settings.
    FlashFailed,
}

/// A sixteenth of an image for the LCD.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Picture {
    /// 0 to 15: even left, odd right, from the top.
    pub number: u8,
    /// 64 columns, least significant bit on top.
    pub columns: [u8; 64],
}

/// Rows that are looked at together: as many as a block of the extension has.
pub type BlockRows = heapless::Vec<Row, { protocol::extension::BLOCK }>;

/// What a session can look at when it has something to tell. Each look is dear.
pub trait View {
    /// The state of things after the newest control period.
    fn snapshot(&self) -> Snapshot;

    /// How the recorder is.
    fn recording(&self) -> Recording;

    /// This recording's number, and its rows with these numbers, as far as there are any.
    fn rows(&self, numbers: Range<usize>) -> (u8, BlockRows);
}

/// A board's conversation with its host. The time that it is told never runs backwards.
pub trait Session {
    /// What it counts.
    type Counters: Copy + Default;

    /// Takes bytes from the front of `bytes` until they ask something of the board, or are all
    /// taken (`None`). Call it until it answers `None`; with no bytes it looks only whether a frame
    /// has been waiting for its rest too long.
    fn receive(&mut self, bytes: &mut &[u8], now: Instant) -> Option<Effect>;

    /// The settings in force.
    fn settings(&self) -> &Settings;

    /// The settings that the [`Upkeep::Save`] that it has just asked for saves.
    fn to_save(&self) -> &Settings;

    /// What time alone asks of the board. Call it until it answers `None`. The snapshot is dear, and taken
    /// only if it is time.
    fn advance(&mut self, _now: Instant, _snapshot: impl FnOnce() -> Snapshot) -> Option<Effect> {
        None
    }

    /// When [`receive`](Self::receive) or [`advance`](Self::advance) will have something to do
    /// although no byte comes.
    fn wakes_at(&self) -> Option<Instant>;

    /// The next frame to send, written into `out`; `None` if there is nothing to say now. Call it
    /// whenever the line is free.
    fn transmit<'b>(
        &mut self,
        now: Instant,
        board: &impl View,
        out: &'b mut [u8; MAX_FRAME],
    ) -> Option<&'b [u8]>;

    /// When there will be something to send; it may be now or past.
    fn sends_at(&self) -> Instant;

    /// Counts an error that the line reported.
    fn line_failed(&mut self);

    /// What came of the [`Upkeep`] that it has asked for, and what that asks of the board. A program
    /// that can be started will be, a moment later.
    fn upkeep_done(&mut self, _result: Result<(), UpkeepRefused>) -> Option<Effect> {
        None
    }

    /// Counts a picture that found no room to wait.
    fn picture_dropped(&mut self) {}

    /// Everything counted so far.
    fn counters(&self) -> Self::Counters;

    /// A number that changes with every frame of our host: its signs of life. It wraps.
    fn signs_of_life(&self) -> u32;
}

impl<F: Framing, const N: usize> TimedReceiver<F, N> {
    /// A session's counters, with what the receiver has counted.
    fn counted(&self, counters: Counters) -> Counters {
        let Reception { frames_ok, bad_frames, bytes_skipped, .. } = self.reception();
        Counters { frames_ok, bad_frames, bytes_skipped, ..counters }
    }
}
