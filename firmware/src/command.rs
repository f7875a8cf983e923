//! The controller's vocabulary: what a personality may ask of it, and why it may refuse.

use crate::channel::{CHANNELS, Channel, Method, Scope};
use crate::control::axis::AxisRefusal;
use crate::control::servo::Slew;
use crate::safety::faults::Fault;

/// What a personality asks of the controller. A command takes effect whole, in one control period.
/// Aligned, and so copied word by word: interrupts are off meanwhile, and control waits.
#[repr(align(4))]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// Drive DC channels. Targets are in the method's unit: sensor counts, counts per second, or
    /// raw [`Duty`](crate::units::Duty).
    MoveMotors {
        /// What the targets are.
        method: Method,
        /// `None` leaves a channel alone.
        targets: [Option<i16>; CHANNELS],
        /// Control periods until the set-point is there; 0 is at once.
        periods: u16,
        /// A number by which the personality knows what asked for it, should it be refused.
        origin: u8,
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
    /// Let a channel's encoder stand at this count from now on. The channel must be off; a move by it that
    /// is paused is forgotten.
    SetCount {
        /// Whose.
        channel: Channel,
        /// What it stands at.
        count: i32,
        /// By which the snapshot tells what came of it.
        serial: u8,
    },
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
        write!(f, "channel {}: {}", self.channel.index(), self.reason)
    }
}
