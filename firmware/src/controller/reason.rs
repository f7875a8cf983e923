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
    /// It is suspended. Gone with a resume, or with its next motion command.
    Suspended,
    /// Its last motion command was refused; its origin is as the command had it. Gone with the next
    /// one that is taken.
    Refused {
        /// Why.
        why: AxisRefusal,
        /// The command's [origin](crate::command::Command::MoveMotors::origin).
        origin: u8,
    },
    /// It is held at a soft limit.
    SoftLimit,
    /// The collision protection forbids the way that it is driven.
    Obstacle,
    /// Its current is too high: the drive is limited.
    OverCurrent,
    /// Its current was too high for too long: the drive is limited.
    Overload,
    /// Its slew time or its highest duty holds the drive down.
    Slew,
}

impl core::fmt::Display for Reason {
    /// In words, for a person.
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Fault(fault) => write!(f, "fault {}: {fault}", fault.number()),
            Self::Silence => f.write_str("stopped: the host fell silent"),
            Self::Suspended => f.write_str("suspended"),
            Self::Refused { why, origin } => write!(f, "DID {origin} was refused: {why}"),
            Self::SoftLimit => f.write_str("held at a soft limit"),
            Self::Obstacle => f.write_str("held back by an obstacle"),
            Self::OverCurrent => f.write_str("limited: too much current"),
            Self::Overload => f.write_str("limited: too much current for too long"),
            Self::Slew => f.write_str("held down by its slew time or highest duty"),
        }
    }
}

/// A motion command that was refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct RefusedCommand {
    pub why: AxisRefusal,
    pub origin: u8,
}

/// The reason of a channel after a period, if it has one.
pub(super) fn reason(
    channel: Channel,
    axis: &Axis,
    latched: &Latched,
    refused: Option<RefusedCommand>,
    limiting: Option<Limiting>,
) -> Option<Reason> {
    let halt = axis.halt().map(|halt| match halt {
        Halt::Silence => Reason::Silence,
        Halt::Suspension => Reason::Suspended,
    });
    let refused = refused.map(|RefusedCommand { why, origin }| Reason::Refused { why, origin });
    let held_back = || {
        axis.held_back().map(|held_back| match (held_back, limiting) {
            (HeldBack::SoftLimit, _) => Reason::SoftLimit,
            (HeldBack::Outside, Some(Limiting::OverCurrent)) => Reason::OverCurrent,
            (HeldBack::Outside, Some(Limiting::Overload)) => Reason::Overload,
            (HeldBack::Outside, None) => Reason::Obstacle,
            (HeldBack::OwnSettings, _) => Reason::Slew,
        })
    };
    let fault = latched.stopping(channel).map(Reason::Fault);
    fault.or(halt).or(refused).or_else(held_back)
}
