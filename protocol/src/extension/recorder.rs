//! The recorder (DIDs 104 and 105): what channels did, period by period, in the board's memory.
//!
//! A *row* is one sample of one channel. A recording is read in *blocks* of [`BLOCK`] rows, which are
//! numbered from 0 and asked for again if one is lost.

use super::state::Mode;
use super::{Answer, Verdict};
use crate::data::{Data, EncodeError, Field, codes, record};

/// Rows in a block.
pub const BLOCK: usize = 8;

codes! {
    /// What begins a recording (byte 2 of a request 104).
    Trigger {
        /// The request itself.
        Now = 0,
        /// A motion command that one of its channels carries out.
        Motion = 1,
        /// A fault of one of its channels, or of the board.
        Fault = 2,
    }
}

codes! {
    /// How far a recording is (byte 2 of an answer 104).
    Phase {
        /// There was none since the start.
        None = 0,
        /// It waits for its trigger, and keeps what comes before.
        Waiting = 1,
        /// It has begun.
        Recording = 2,
        /// It is all there, to be read.
        Done = 3,
    }
}

record! {
    /// What is to be recorded (DID 104 to the board), 8 bytes.
    pub struct Setup {
        /// Whose: bit 0 is channel 0; 1 to 63.
        pub channels: u8,
        /// What begins it.
        pub trigger: Trigger,
        /// Control periods from one sample to the next, from 1.
        pub decimation: u16,
        /// Samples in all, from 1; more than fit are cut to what fits.
        pub samples: u16,
        /// How many of them are from before the trigger: less than all, and none for [`Trigger::Now`].
        pub before: u16,
    }
}

impl Setup {
    /// Reads DATA of a request.
    ///
    /// # Errors
    /// [`Verdict::BadLength`], [`Verdict::OutOfRange`].
    pub(super) fn parse(mut data: &[u8]) -> Result<Self, Verdict> {
        let (is_whole, fields) = (data.len() == 8, &mut data);
        let setup = Self::take(fields).filter(|_| is_whole);
        // All that a whole one can fail by is a trigger that nobody knows.
        let setup = setup.ok_or(if is_whole { Verdict::OutOfRange } else { Verdict::BadLength })?;
        let in_range = (1..64).contains(&setup.channels)
            && setup.decimation > 0
            && setup.before < setup.samples
            && (setup.before == 0 || setup.trigger != Trigger::Now);
        if in_range { Ok(setup) } else { Err(Verdict::OutOfRange) }
    }
}

record! {
    /// How the recorder is (DID 104 from the board), 18 bytes.
    pub struct Recording {
        /// The recording's number, 1 to 255 and round again; 0 before the first.
        pub serial: u8,
        /// How far it is.
        pub phase: Phase,
        /// Whose: bit 0 is channel 0.
        pub channels: u8,
        /// What begins it.
        pub trigger: Trigger,
        /// Control periods from one sample to the next.
        pub decimation: u16,
        /// Samples in all: as asked, or what fits.
        pub samples: u16,
        /// Samples taken so far.
        pub taken: u16,
        /// How many of them are from before the trigger.
        pub before: u16,
        /// Uptime in ms at the trigger; 0 before it.
        pub triggered_ms: u32,
        /// Rows that the memory holds.
        pub capacity: u16,
    }
}

record! {
    /// A sample of one channel, 15 bytes: the first ones of a channel in the machine state.
    pub struct Row {
        /// Counts of its sensor since boot, turn by turn; wraps.
        pub position: i32,
        /// Counts of its sensor per second.
        pub velocity: i32,
        /// What it is asked for at this moment of its move, by the mode.
        pub set_point: i16,
        /// What its bridge does, in 1/16384 of full drive.
        pub duty: i16,
        /// Motor current, A/D counts 0 to 4095.
        pub current: u16,
        /// What it is doing.
        pub mode: Mode,
    }
}

impl Default for Row {
    fn default() -> Self {
        Self { position: 0, velocity: 0, set_point: 0, duty: 0, current: 0, mode: Mode::Off }
    }
}

/// A block of a recording (DID 105 from the board): rows sample by sample, and within a sample channel by
/// channel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Block {
    /// The recording's number.
    pub serial: u8,
    /// The block's, from 0.
    pub number: u16,
    count: u8,
    rows: [Row; BLOCK],
}

impl Block {
    /// A block of these rows, [`BLOCK`] at the most. Without any it says that there is no block of this
    /// number, or that the recording is not done.
    pub fn new(serial: u8, number: u16, rows: impl IntoIterator<Item = Row>) -> Self {
        let mut block = Self { serial, number, ..Self::default() };
        for (place, row) in block.rows.iter_mut().zip(rows) {
            *place = row;
            block.count = block.count.saturating_add(1); // 8 at the most
        }
        block
    }

    /// Its rows: row [`BLOCK`] * number of the recording, and those behind it.
    pub fn rows(&self) -> &[Row] {
        self.rows.get(..usize::from(self.count)).unwrap_or_default()
    }

    pub(super) fn put(&self, data: &mut Data) -> Result<(), EncodeError> {
        self.serial.put(data)?;
        self.number.put(data)?;
        self.rows().iter().try_for_each(|row| row.put(data))
    }

    pub(super) fn take(data: &mut &[u8]) -> Option<Answer<'static>> {
        let (serial, number) = (Field::take(data)?, Field::take(data)?);
        let rows = core::iter::from_fn(|| Row::take(data));
        Some(Answer::Block(Self::new(serial, number, rows.take(BLOCK))))
    }
}
