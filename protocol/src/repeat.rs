//! How often something is asked for: the last byte of a request for telemetry, health or the machine state.

use core::num::NonZeroU8;

use crate::data::{Data, EncodeError, append};

/// How often it is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Repeat {
    /// No more.
    Stop,
    /// So many times, 1 to 255.
    Times(NonZeroU8),
    /// Until further notice.
    Continuous,
}

impl Repeat {
    /// DATA of the request: nothing, or how often.
    pub(crate) fn parse(count: Option<&u8>) -> Self {
        match count {
            None => Self::Continuous,
            Some(&count) => NonZeroU8::new(count).map_or(Self::Stop, Self::Times),
        }
    }

    pub(crate) fn emit(self, data: &mut Data) -> Result<(), EncodeError> {
        match self {
            Self::Stop => append(data, &[0]),
            Self::Times(count) => append(data, &[count.get()]),
            Self::Continuous => Ok(()),
        }
    }
}
