//! Where a shaft may be: the scale of its sensor, less what its soft limits forbid.
//!
//! A move goes the shorter way; within limits the way that stays inside, however long; from a place
//! outside, the way in that does not pass the place opposite. A shaft that comes near a limit is
//! braked, whatever drives it, and one that is pushed against it is held there. What is outside and
//! still stays where it is: nobody has asked it to come back. Limits beyond the sensor's scale are none.

use crate::channel::Sensor;

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
        let fit = soft.are_set() && soft.high <= last_count(sensor);
        Self { scale: scale(sensor), limits: fit.then_some((low.saturating_add(half), half)) }
    }

    /// What a move may be ahead of its shaft at once: with more than half a turn nobody knew which way.
    pub fn farthest_ahead(&self) -> Counts {
        match self.scale {
            Scale::Line => Counts::MAX,
            Scale::Circle(turn) => Counts::from(turn).wrapping_shr(2),
        }
    }

    /// The target, or the limit that it is beyond.
    pub fn clamp(&self, target: Counts) -> Counts {
        match self.limits {
            Some((middle, half)) => {
                target.max(middle.saturating_sub(half)).min(middle.saturating_add(half))
            }
            None => target,
        }
    }

    /// The way that a move goes from one position to another.
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

    /// How far one position is from another, by the shorter way: what a shaft has moved, or a loop is
    /// off.
    pub fn difference(&self, to: Counts, from: Counts) -> Counts {
        self.scale.difference(to, from)
    }

    /// A target as a position on the track: a full turn is the same place as 0.
    pub fn target(&self, target: i16) -> Counts {
        match self.scale {
            Scale::Circle(turn) if i32::from(target) == i32::from(turn) => Counts::ZERO,
            _ => Counts::from(target),
        }
    }

    /// Narrows the drive that is allowed so that the shaft comes to rest within the soft limits; one that
    /// is outside may come back. `full_speed` is in counts per second, 1 or more.
    pub fn hold_within(&self, now: Reading, full_speed: i32, limits: &mut Limits) {
        if let Some((above, below)) = self.room(now.position) {
            limits.high = limits.high.min(braked(above, now.velocity, full_speed));
            let low = braked(below, now.velocity.saturating_neg(), full_speed);
            limits.low = limits.low.max(low.saturating_neg());
        }
    }

    /// The drive that holds a shaft at the limit that it is pushed against, or a little beyond, as a load
    /// beside the drive may do; `None` elsewhere.
    pub fn pushed_back(&self, now: Reading, upwards: bool, full_speed: i32) -> Option<Drive> {
        const LITTLE: Counts = Counts::const_from_int(-64);
        let (above, below) = self.room(now.position)?;
        let (room, speed) = match upwards {
            true => (above, now.velocity),
            false => (below, now.velocity.saturating_neg()),
        };
        let drive = spared(room, speed, full_speed);
        let drive = if upwards { drive } else { drive.saturating_neg() };
        (LITTLE..Counts::ZERO).contains(&room).then_some(drive)
    }

    /// How far the limits are above and below.
    fn room(&self, position: Counts) -> Option<(Counts, Counts)> {
        let (middle, half) = self.limits?;
        let off = self.scale.difference(position, middle);
        Some((half.saturating_sub(off), half.saturating_add(off)))
    }
}

/// How much drive a shaft may have towards a limit, -1 to 1, with so much room left, at this speed
/// towards it. One that is outside is braked, unless it creeps: that may be noise, and in neutral it
/// would be noise that drives.
fn braked(room: Counts, speed: CountsPerSecond, full_speed: i32) -> Drive {
    let most = spared(room.max(Counts::ZERO), speed, full_speed);
    if speed > creep(full_speed) { most } else { most.max(Drive::ZERO) }
}

/// A shaft that seems to move no faster may stand: a 16th of full speed, and 100 counts/s at the least.
pub fn creep(full_speed: i32) -> CountsPerSecond {
    CountsPerSecond::from_bits(full_speed.saturating_mul(16)).max(CountsPerSecond::from_num(100))
}

/// The drive for what room a shaft does not need to come to rest, 10 ms of full speed being full drive.
///
/// It needs 40 ms until it is braked (the estimate of its velocity lags by 16), and then comes to rest
/// evenly, from full speed within 250 ms: four times the inertia of an ordinary wheel can.
fn spared(room: Counts, speed: CountsPerSecond, full_speed: i32) -> Drive {
    const FULL: i64 = Duty::FULL as i64;
    let full_speed = i64::from(full_speed);
    let speed = i64::from(speed.max(CountsPerSecond::ZERO).to_bits());
    // In bits of counts: speed^2 * 0.25 s / (2 * full speed).
    let evenly = (speed.saturating_mul(speed) >> 11).checked_div(full_speed).unwrap_or(0);
    let needed = (speed / 25).saturating_add(evenly);
    let spare = i64::from(room.to_bits()).saturating_sub(needed);
    // Bits of counts to bits of drive: 2^14 / 2^8, over 0.01 s.
    let drive = spare.saturating_mul(6400).checked_div(full_speed).unwrap_or(0);
    Drive::from_bits(saturate(drive.clamp(-FULL, FULL)))
}

/// The last count of a sensor's scale.
pub fn last_count(sensor: Sensor) -> i16 {
    match sensor {
        Sensor::SinglePotentiometer => 4095,
        Sensor::DualPotentiometer => 4428,
        Sensor::Encoder => i16::MAX,
    }
}

/// The scale of a sensor.
pub fn scale(sensor: Sensor) -> Scale {
    match sensor {
        Sensor::SinglePotentiometer => Scale::Line,
        Sensor::DualPotentiometer => Scale::DUAL_POTENTIOMETER,
        Sensor::Encoder => Scale::ENCODER,
    }
}
