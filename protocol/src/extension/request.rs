//! What a host asks of the extension ([Requests](crate#requests)), both directions.

use super::answer::Verdict;
use super::did;
use super::recorder::Setup;
use crate::data::{Data, EncodeError, Field, append, codes};
use crate::repeat::Repeat;

/// The sub-command of DID 7 that sets a setting; all from here on are the extension's.
pub(super) const SET: u8 = 0x80;
/// The sub-command that sets the count of an encoder.
pub(super) const SET_COUNT: u8 = 0x86;

/// A host's [request](crate#requests).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Request<'a> {
    /// Set settings (DID 7, sub-command 80).
    Set(Assignments<'a>),
    /// Do something (DID 7, sub-commands 81 to 85).
    Do(Action),
    /// Read the setting of this number (DID 96).
    Setting(u16),
    /// Who are you? (DID 97)
    Identity,
    /// Tell the health, so often (DID 98).
    Health(Repeat),
    /// Read the counters (DID 99).
    Counters,
    /// Read the latched fault at this place (DID 100).
    Fault(u8),
    /// Read what was refused, by reason (DID 103).
    Refusals,
    /// Tell the machine state, so often (DID 102).
    State(Repeat),
    /// How is the recorder? (DID 104)
    Recording,
    /// Begin a recording (DID 104).
    Record(Setup),
    /// Read blocks of the recording (DID 105).
    Blocks {
        /// The number of the first.
        first: u16,
        /// How many; 0 ends what was asked before.
        count: u16,
    },
    /// Set the count of an encoder (DID 7, sub-command 86).
    SetCount {
        /// Whose, from 0.
        channel: u8,
        /// What it stands at from now on.
        count: i32,
    },
}

codes! {
    /// What a host can have done: a sub-command of DID 7 that stands alone.
    Action {
        /// Clear the latched faults.
        ClearFaults = 0x81,
        /// Save the settings.
        Save = 0x82,
        /// Back to the defaults, in force and saved.
        FactoryReset = 0x83,
        /// Restart the firmware.
        Reboot = 0x84,
        /// Start the ROM's DFU loader.
        RebootIntoDfu = 0x85,
    }
}

impl<'a> Request<'a> {
    /// Reads DID and DATA of a frame that is the extension's; `None` if it is not.
    pub(crate) fn parse(did: u8, data: &'a [u8]) -> Option<Result<Self, Verdict>> {
        if !super::owns(did, data) {
            return None;
        }
        let nothing = data.is_empty();
        let repeat = || matches!(data, [] | [_]).then(|| Repeat::parse(data.first()));
        let request = match did {
            did::PARAMETERS => return Some(Self::parse_sub_command(data)),
            did::SETTING => {
                data.try_into().ok().map(|word| Self::Setting(u16::from_le_bytes(word)))
            }
            did::IDENTITY => nothing.then_some(Self::Identity),
            did::HEALTH => repeat().map(Self::Health),
            did::COUNTERS => nothing.then_some(Self::Counters),
            did::FAULT => data.try_into().ok().map(|[place]: [u8; 1]| Self::Fault(place)),
            did::STATE => repeat().map(Self::State),
            did::REFUSALS => nothing.then_some(Self::Refusals),
            did::RECORDING if nothing => Some(Self::Recording),
            did::RECORDING => return Some(Setup::parse(data).map(Self::Record)),
            did::BLOCK => data.try_into().ok().map(|[f0, f1, c0, c1]: [u8; 4]| Self::Blocks {
                first: u16::from_le_bytes([f0, f1]),
                count: u16::from_le_bytes([c0, c1]),
            }),
            _ => return Some(Err(Verdict::Unknown)),
        };
        Some(request.ok_or(Verdict::BadLength))
    }

    /// Reads DATA of a DID 7 that is the extension's.
    fn parse_sub_command(data: &'a [u8]) -> Result<Self, Verdict> {
        match data {
            [SET, ..] => Assignments::parse(data).map(Self::Set),
            &[SET_COUNT, channel, c0, c1, c2, c3] => {
                Ok(Self::SetCount { channel, count: i32::from_le_bytes([c0, c1, c2, c3]) })
            }
            [SET_COUNT, ..] => Err(Verdict::BadLength),
            [number, rest @ ..] => match Action::from_number(*number) {
                Some(action) if rest.is_empty() => Ok(Self::Do(action)),
                Some(_) => Err(Verdict::BadLength),
                None => Err(Verdict::Unknown),
            },
            [] => Err(Verdict::Unknown),
        }
    }

    /// The DID that it has on the wire.
    pub(crate) fn did(&self) -> u8 {
        match self {
            Self::Set(_) | Self::Do(_) | Self::SetCount { .. } => did::PARAMETERS,
            Self::Setting(_) => did::SETTING,
            Self::Identity => did::IDENTITY,
            Self::Health(_) => did::HEALTH,
            Self::Counters => did::COUNTERS,
            Self::Fault(_) => did::FAULT,
            Self::State(_) => did::STATE,
            Self::Refusals => did::REFUSALS,
            Self::Recording | Self::Record(_) => did::RECORDING,
            Self::Blocks { .. } => did::BLOCK,
        }
    }

    /// Appends DATA.
    pub(crate) fn emit(&self, data: &mut Data) -> Result<(), EncodeError> {
        match self {
            Self::Set(assignments) => append(data, assignments.as_bytes()),
            Self::Do(action) => append(data, &[action.number()]),
            Self::Setting(number) => append(data, &number.to_le_bytes()),
            Self::Identity | Self::Counters | Self::Refusals | Self::Recording => Ok(()),
            Self::Record(setup) => setup.put(data),
            Self::Blocks { first, count } => [*first, *count].put(data),
            Self::Health(repeat) | Self::State(repeat) => repeat.emit(data),
            Self::Fault(place) => append(data, &[*place]),
            Self::SetCount { channel, count } => {
                let [c0, c1, c2, c3] = count.to_le_bytes();
                append(data, &[SET_COUNT, *channel, c0, c1, c2, c3])
            }
        }
    }
}

/// Bytes of one assignment: sub-command, number, value.
const ASSIGNMENT: usize = 7;

/// DATA of a well-formed list of assignments.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Assignments<'a> {
    bytes: &'a [u8],
}

impl<'a> Assignments<'a> {
    /// Appends an assignment of a value to a setting; [`parse`](Self::parse) makes a request of
    /// what was appended.
    ///
    /// # Errors
    /// [`EncodeError::TooLong`] when DATA is full.
    pub fn emit(number: u16, value: i32, data: &mut Data) -> Result<(), EncodeError> {
        let ([n0, n1], [v0, v1, v2, v3]) = (number.to_le_bytes(), value.to_le_bytes());
        append(data, &[SET, n0, n1, v0, v1, v2, v3])
    }

    /// Reads DATA through.
    ///
    /// # Errors
    /// [`Verdict::BadLength`] when it ends within an assignment, [`Verdict::Unknown`] when something else
    /// stands between them.
    pub fn parse(bytes: &'a [u8]) -> Result<Self, Verdict> {
        let (assignments, rest) = bytes.as_chunks::<ASSIGNMENT>();
        let stranger = assignments.iter().map(|a| a[0]).find(|&sub| sub != SET);
        match stranger {
            Some(_) => Err(Verdict::Unknown),
            None if assignments.is_empty() || !rest.is_empty() => Err(Verdict::BadLength),
            None => Ok(Self { bytes }),
        }
    }

    /// The DATA they stand in.
    pub fn as_bytes(&self) -> &'a [u8] {
        self.bytes
    }

    /// Numbers and values, in the order of the wire.
    pub fn iter(&self) -> impl Iterator<Item = (u16, i32)> + 'a {
        let (assignments, _) = self.bytes.as_chunks::<ASSIGNMENT>();
        assignments.iter().map(|&[_, n0, n1, v0, v1, v2, v3]| {
            (u16::from_le_bytes([n0, n1]), i32::from_le_bytes([v0, v1, v2, v3]))
        })
    }
}
