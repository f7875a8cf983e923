//! What a closed loop, or a soft limit, makes of its shaft: it drives it the wrong way, or it hunts.

use super::{Observed, reached};
use crate::control::axis::{Deviation, SetPoint};
use crate::settings::ChannelFaultSettings;
use crate::units::{Counts, CountsPerSecond, Drive, PERIODS_PER_SECOND};

/// For so long the estimate of the velocity may rise after the drive has turned round, or after a
/// loose plug has made it jump, before it falls.
const SETTLES: u8 = 32;
/// What is no more than noise: so many counts/s, and so much (2^-7) of a velocity.
const NOISE_SHIFT: u32 = 7;
const NOISE: CountsPerSecond = CountsPerSecond::const_from_int(4);

/// A shaft that moves against the drive, and away from what it is asked for, without slowing down:
/// its sensor is swapped, or its motor.
///
/// A healthy shaft that was turned round slows down all the time; one that a load moves stays near
/// its set-point.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct WrongWay {
    /// Periods since it began to move against the drive, up to [`SETTLES`].
    begun: u8,
    /// Since it was last slower than ever since then: the speed at that time, how far off a position loop
    /// was, and the way, in thousandths of a count.
    slowest: CountsPerSecond,
    off: Counts,
    way: u64,
}

impl WrongWay {
    /// Whether it has gone too far.
    pub(super) fn step(&mut self, now: &Observed, settings: &ChannelFaultSettings) -> bool {
        let velocity = now.reading.velocity;
        let speed = velocity.saturating_abs();
        let is_driven = now.duty.raw().unsigned_abs() >= settings.dead_band;
        // A PWM asks for nothing; it is a soft limit that brakes there.
        let (is_away, off) = match now.deviation {
            None => (true, Counts::ZERO),
            Some(Deviation::Position(way)) => {
                (is_opposite(velocity.to_bits(), way.to_bits()), way.saturating_abs())
            }
            Some(Deviation::Velocity(difference)) => {
                (is_opposite(velocity.to_bits(), difference.to_bits()), Counts::ZERO)
            }
        };
        // The estimate at rest is seldom 0 to the bit.
        let is_against =
            speed > NOISE && is_opposite(velocity.to_bits(), now.drive.to_bits()) && is_away;
        if !(is_driven && is_against) {
            *self = Self::default();
            return false;
        }
        let noise = NOISE.saturating_add(self.slowest.wrapping_shr(NOISE_SHIFT));
        let is_slower = speed < self.slowest.saturating_sub(noise);
        if self.begun == 0 || is_slower {
            (self.slowest, self.off, self.way) = (speed, off, 0);
        }
        if self.begun < SETTLES {
            self.begun = self.begun.saturating_add(1);
            self.slowest = self.slowest.max(speed);
        }
        self.way = self.way.saturating_add(speed.to_num::<i32>().unsigned_abs().into());
        let bearable = u64::from(now.full_speed).saturating_mul(settings.wrong_way_ms.into());
        if settings.wrong_way_ms == 0 || self.begun < SETTLES || self.way < bearable {
            return false;
        }
        match now.deviation {
            // One that runs down a slope is as fast as it is asked to be.
            Some(Deviation::Velocity(difference)) => {
                difference.saturating_abs() >= speed.wrapping_shr(1)
            }
            // One that is let down stays as near to its set-point as it was.
            None => true,
            Some(Deviation::Position(_)) => {
                let farther = i64::from(off.saturating_sub(self.off).to_bits());
                let twice = farther.saturating_mul((2 * PERIODS_PER_SECOND).into()) >> 8;
                u64::try_from(twice).unwrap_or(0) >= bearable
            }
        }
    }
}

/// Whether neither is 0 and their signs differ.
fn is_opposite(one: i32, other: i32) -> bool {
    one != 0 && other != 0 && (one < 0) != (other < 0)
}

/// For so long the set-point must have stood before a drive that turns round is the loop's own doing.
const STEADY: u16 = 500;

/// A loop that turns its drive round again and again although nobody asks it to.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Hunting {
    /// What was asked for last, and for how long already.
    asked: Option<SetPoint>,
    steady: u16,
    /// Which way the loop last pushed, and for how long it still hunts.
    pushed_forward: Option<bool>,
    hunts: u8,
    /// Up by two for a period in which it hunts, down by one for any other.
    astray: u16,
}

impl Hunting {
    /// Whether it has hunted for too long.
    pub(super) fn step(&mut self, now: &Observed, settings: &ChannelFaultSettings) -> bool {
        let asked = Some(now.set_point);
        self.steady = if asked == self.asked { self.steady.saturating_add(1) } else { 0 };
        self.asked = asked;
        self.hunts = self.hunts.saturating_sub(1);
        if now.duty.raw().unsigned_abs() >= settings.driven >> 1 {
            let is_forward = now.drive > Drive::ZERO;
            if self.pushed_forward == Some(!is_forward) && self.steady >= STEADY {
                self.hunts = settings.hunt_ms;
            }
            self.pushed_forward = Some(is_forward);
        }
        self.astray = if self.hunts > 0 {
            self.astray.saturating_add(2)
        } else {
            self.astray.saturating_sub(1)
        };
        reached(self.astray, settings.tracking_ms.saturating_mul(2))
    }
}
