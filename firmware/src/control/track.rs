//! Where a shaft may be: the scale of its sensor, less what its soft limits forbid.
//!
//! Without limits the way from one position to another is the shorter one. With them it is the one
//! that stays inside, however long; from a place outside, the shorter way in. And a shaft that comes
//! near a limit is braked, whatever drives it, so that it comes to rest there.

use protocol::pms5005::Sensor;

use super::axis::Reading;
use super::pid::Limits;
use super::ring::Scale;
use super::saturate;
use crate::settings::SoftLimits;
use crate::units::{Counts, CountsPerSecond, Drive, Duty};

/// The track of one channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Track {
    scale: Scale,
    /// The middle between the limits, and how far they are from it.
    limits: Option<(Counts, Counts)>,
}

impl Track {
    /// The track by this sensor, within these limits.
    pub fn new(sensor: Sensor, soft: &SoftLimits) -> Self {
        let (low, high) = (Counts::from(soft.low), Counts::from(soft.high));
        let half: Counts = high.saturating_sub(low).wrapping_shr(1);
        Self {
            scale: scale(sensor),
            limits: soft.are_set().then_some((low.saturating_add(half), half)),
        }
    }

    /// The way from one position to another.
    pub fn way(&self, to: Counts, from: Counts) -> Counts {
        match self.limits {
            None => self.scale.difference(to, from),
            Some((middle, _)) => {
                let off = |position| self.scale.difference(position, middle);
                off(to).saturating_sub(off(from))
            }
        }
    }

    /// `position + way`, for ways of less than a turn.
    pub fn advance(&self, position: Counts, way: Counts) -> Counts {
        self.scale.advance(position, way)
    }

    /// What the shaft has moved from one period to the next.
    pub fn moved(&self, to: Counts, from: Counts) -> Counts {
        self.scale.difference(to, from)
    }

    /// A target as a position on the track: a full turn is the same place as 0.
    pub fn target(&self, target: i16) -> Counts {
        match self.scale {
            Scale::Circle(turn) if i32::from(target) == i32::from(turn) => Counts::ZERO,
            _ => Counts::from(target),
        }
    }

    /// Narrows the drive that is allowed so that the shaft comes to rest within the soft limits; one
    /// that is outside may come back. `full_speed` is in counts per second, 1 or more.
    pub fn hold_within(&self, now: Reading, full_speed: i32, limits: &mut Limits) {
        if let Some((middle, half)) = self.limits {
            let off = self.scale.difference(now.position, middle);
            let most = |room, speed| braked(room, speed, full_speed);
            limits.high = limits.high.min(most(half.saturating_sub(off), now.velocity));
            let low = most(half.saturating_add(off), now.velocity.saturating_neg());
            limits.low = limits.low.max(low.saturating_neg());
        }
    }
}

/// How much drive a shaft may have towards a limit, -1 to 1, with so much room left, at this speed
/// towards it.
///
/// It needs 40 ms until it is braked (the estimate of its velocity lags by 16), and then comes to rest
/// evenly, from full speed within 250 ms: four times the inertia of an ordinary wheel can. What room is
/// left over allows full drive if it is 10 ms of full speed.
fn braked(room: Counts, speed: CountsPerSecond, full_speed: i32) -> Drive {
    let full_speed = i64::from(full_speed);
    let speed = i64::from(speed.max(CountsPerSecond::ZERO).to_bits());
    // In bits of counts: speed^2 * 0.25 s / (2 * full speed).
    let evenly = (speed.saturating_mul(speed) >> 11).checked_div(full_speed).unwrap_or(0);
    let needed = (speed / 25).saturating_add(evenly);
    // One that is outside already is braked, and no more: nobody has asked it to come back.
    let spare = i64::from(room.max(Counts::ZERO).to_bits()).saturating_sub(needed);
    // Bits of counts to bits of drive: 2^14 / 2^8, over 0.01 s.
    let drive = spare.saturating_mul(6400).checked_div(full_speed).unwrap_or(0);
    const FULL: i64 = Duty::FULL as i64;
    Drive::from_bits(saturate(drive.clamp(-FULL, FULL)))
}

/// The scale of a sensor.
pub fn scale(sensor: Sensor) -> Scale {
    match sensor {
        Sensor::SinglePotentiometer => Scale::Line,
        Sensor::DualPotentiometer => Scale::DUAL_POTENTIOMETER,
        Sensor::Encoder => Scale::ENCODER,
    }
}
