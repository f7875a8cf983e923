//! Why a channel does not do what was asked of it: one reason, the most pressing.

use crate::channel::Channel;
use crate::control::axis::{Axis, AxisRefusal, Halt, HeldBack};
use crate::safety::channel::Limiting;
use crate::safety::faults::Fault;
use crate::safety::latch::Latched;

/// Why a channel does not do what was asked of it, the most pressing first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Reason {
    /// A fault that stops it is latched. Gone when it is cleared.
    Fault(Fault),
    /// The host fell silent: the channel was stopped, or its move broken off. Gone with its next
    /// motion command.
    Silence,
    /// Its last motion command grew too old (setting 6). Gone with the next one.
    OldCommand,
    /// It is suspended. Gone with a resume, or with its next motion command.
    Suspended,
    /// Its last motion command was refused, for its own part or for another channel's, as commands are
    /// taken whole. Gone with the next one that is taken.
    Refused {
        /// Why.
        why: AxisRefusal,
        /// The command's [origin](crate::command::Command::MoveMotors::origin).
        origin: u8,
    },
    /// The collision protection forbids the way that it is driven.
    Obstacle,
    /// Its current is too high: the drive is limited.
    OverCurrent,
    /// Its current was too high for too long: the drive is limited.
    Overload,
    /// It is held at a soft limit, or its target lies beyond one.
    SoftLimit,
    /// Its highest duty limits the drive.
    HighestDuty,
    /// Its slew time limits the drive.
    Slew,
    /// It has all the drive that there is, and that is not enough.
    FullDrive,
}

impl core::fmt::Display for Reason {
    /// In words, for a person.
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Fault(fault) => write!(f, "fault {}: {fault}", fault.number()),
            Self::Silence => f.write_str("stopped: the host fell silent"),
            Self::OldCommand => f.write_str("stopped: its last command grew too old"),
            Self::Suspended => f.write_str("suspended"),
            Self::Refused { why, origin } => write!(f, "DID {origin} was refused: {why}"),
            Self::SoftLimit => f.write_str("held at a soft limit"),
            Self::Obstacle => f.write_str("held back by an obstacle"),
            Self::OverCurrent => f.write_str("limited: too much current"),
            Self::Overload => f.write_str("limited: too much current for too long"),
            Self::HighestDuty => f.write_str("limited to its highest duty"),
            Self::Slew => f.write_str("limited by its slew time"),
            Self::FullDrive => f.write_str("at full drive, which is not enough"),
        }
    }
}

/// A motion command that was refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct RefusedCommand {
    pub why: AxisRefusal,
    pub origin: u8,
}

/// The reason of a channel after a period, if it has one. `obstacle` tells in which drive, that of rising
/// counts or the other, an obstacle holds it back.
#[inline]
pub(super) fn reason(
    channel: Channel,
    axis: &Axis,
    latched: &Latched,
    refused: Option<RefusedCommand>,
    obstacle: Option<bool>,
    limiting: impl FnOnce() -> Option<Limiting>,
) -> Option<Reason> {
    if let Some(fault) = latched.stopping(channel) {
        return Some(Reason::Fault(fault));
    }
    match axis.halt() {
        Some(Halt::Silence) => return Some(Reason::Silence),
        Some(Halt::Age) => return Some(Reason::OldCommand),
        Some(Halt::Suspension) => return Some(Reason::Suspended),
        None => {}
    }
    if let Some(RefusedCommand { why, origin }) = refused {
        return Some(Reason::Refused { why, origin });
    }
    Some(match axis.held_back()? {
        HeldBack::Outside { rising } if obstacle == Some(rising) => Reason::Obstacle,
        HeldBack::Outside { .. } => match limiting() {
            Some(Limiting::OverCurrent) => Reason::OverCurrent,
            Some(Limiting::Overload) | None => Reason::Overload,
        },
        HeldBack::SoftLimit => Reason::SoftLimit,
        HeldBack::HighestDuty => Reason::HighestDuty,
        HeldBack::Slew => Reason::Slew,
        HeldBack::FullDrive => Reason::FullDrive,
    })
}
