//! The controller's vocabulary: what a personality may ask of it, and why it may refuse.

use protocol::pms5005::extension::Fault;
use protocol::pms5005::{CHANNELS, Channel, Method, Scope};

use crate::control::axis::AxisRefusal;
use crate::control::servo::Slew;

/// Channels 0 and 1 have encoders.
pub const ENCODERS: usize = 2;

/// What a personality asks of the controller. A command takes effect whole, in one control period.
/// Aligned, and so copied word by word: interrupts are off meanwhile, and control waits.
#[repr(align(4))]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// Drive DC channels. Targets are in the method's unit: sensor counts, counts per second, or
    /// raw [`Duty`](crate::units::Duty).
    Drive {
        /// What the targets are.
        method: Method,
        /// `None` leaves a channel alone.
        targets: [Option<i16>; CHANNELS],
        /// Control periods until the set-point is there; 0 is at once.
        periods: u16,
    },
    /// Move servos; targets in 1/2250 ms.
    MoveServos {
        /// `None` leaves a servo alone.
        targets: [Option<i16>; CHANNELS],
        /// Control periods until the pulse width is there; 0 is at once.
        periods: u16,
    },
    /// Slew servos, each at its own pace, whether the host speaks or not. `None` leaves a servo alone.
    SlewServos([Option<Slew>; CHANNELS]),
    /// Go by the settings that wait beside the commands from now on: they are too large to be queued with
    /// them.
    Adopt,
    /// Suspend (`run` false) or resume.
    Run {
        /// Whom.
        scope: Scope,
        /// Which.
        run: bool,
    },
    /// Set the output port.
    Gpio(u8),
    /// Clear latched faults: all of them, or one DC channel's own.
    ClearFaults(Scope),
    /// Show the record of the latched fault at this place in the
    /// [`Snapshot`](crate::controller::Snapshot), from now on.
    ShowFault(u8),
    /// Keep on record what only somebody else can see.
    Record(Fault),
}

const _: () = assert!(size_of::<Command>() <= 36);

/// Why a command was not carried out: a channel does not take its target.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Refused {
    /// Which.
    pub channel: Channel,
    /// Why not.
    pub reason: AxisRefusal,
}

impl core::fmt::Display for Refused {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let why = match self.reason {
            AxisRefusal::BeyondScale => "the target lies beyond the sensor's scale",
            AxisRefusal::OtherMethod => "it was set to another method (sub-command 0E)",
        };
        write!(f, "channel {}: {why}", self.channel.number())
    }
}
