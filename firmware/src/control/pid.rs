//! The PID controller of the DC channels in fixed point, and what the gains that hosts send mean.
//!
//! Both loops compute, once a period of 1 ms,
//!
//! ```text
//!   drive = kp * error + integral(ki * error) - kd * rate + feed_forward
//! ```
//!
//! limited to the allowed drive (full drive is 1). It promises:
//! - No derivative kick: `rate` is how fast the measurement changes, less the slope of a position
//!   ramp, so a jump of the set-point does not appear in it.
//! - Anti-windup: while a limit holds the drive back, the integral does not grow deeper into the
//!   limit (conditional integration), and does not exceed that limit itself. It never exceeds full
//!   drive.
//! - No overflow, whatever the gains, the error and the rate are.
//! - Each term is rounded once, down, to 1/16384 of full drive, the last bit of a
//!   [`Duty`](crate::units::Duty).
//!
//! The gains that hosts send are the original's numbers: Kp 50, Kd 5, Ki 0 by default, and Kp 15
//! to 25 usable for the wheels of the time. This is what one unit of each is worth, in parts of
//! full drive:
//!
//! | gain | position loop | velocity loop |
//! |---|---|---|
//! | Kp = 1 | 2^-15 a count: Kp 50 drives fully at 655 counts | 2^-19 a count/s of the error expected in 16 ms (see below), and as much again for every reset time (128 ms) that the error lasts |
//! | Kd = 1 | 2^-16 a count/s | 2^-18 a (count/s) per ms |
//! | Ki = 1.00 | 2^-10 a count and second | 2^-12 a (count/s) and second |
//! | the most that counts | Kp 32767: full drive at one count; Kd 511: at 128 counts/s | Kp 32767: full drive at 16 counts/s; with it Ki adds nothing. Kd 2047: at 128 (counts/s) per ms |
//!
//! The velocity loop's Kp has a reset time built in, 128 ms unless its setting says otherwise, because hosts leave Ki at 0 and
//! expect the speed to be held: a proportional term alone would settle well below the set-point. And it
//! looks 16 ms ahead along the acceleration, again unless its setting says otherwise, because the estimate of the velocity is that late
//! ([`velocity`](super::velocity)): without that a motor four times as fast as its setting runs at twice
//! the speed asked for a moment. The look-ahead takes its part of the largest Kd, 8 for each Kp; a slow motor with a coarse encoder
//! needs none, and its drive is quieter for it.

use crate::settings::{HostGains, Reset};
use fixed::FixedI32;
use fixed::traits::LossyFrom;
use fixed::types::{I2F30, I10F54, I16F16, I24F8, extra::U38};

use super::saturate;
use crate::units::{Counts, CountsPerSecond, Drive};

/// Gains in parts of full drive, ready to multiply: the table of the [module](self).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Gains {
    /// A unit of error.
    kp: I2F30,
    /// A unit of error and period.
    ki: FixedI32<U38>,
    /// A unit of rate, the look-ahead of a velocity loop included. Negative, so that all terms are
    /// added, and rounded down alike.
    minus_kd: FixedI32<U38>,
}

impl Gains {
    /// The gains of a position loop.
    pub fn position(gains: HostGains) -> Self {
        let (ki, kd) = (i64::from(gains.ki_hundredths), i64::from(gains.kd));
        Self::of(gains.kp, (ki << (38 - 10)) / 100_000, kd.min(511) << (38 - 16))
    }

    /// The gains of a velocity loop.
    pub fn velocity(gains: HostGains, reset: Reset) -> Self {
        let kp = i64::from(gains.kp.min(32767));
        let (ki, kd) = (i64::from(gains.ki_hundredths), i64::from(gains.kd));
        // + 4: the unit of this loop's error is 2^4 counts/s.
        let ki = (ki << (38 - 12 + 4)) / 100_000;
        let kp_per_period = (kp << (38 - 15)).checked_div(reset.time_ms.into()).unwrap_or(0);
        let kp_ahead = (kp << (38 - 19)).saturating_mul(reset.look_ahead_ms.min(16).into());
        let kd = (kd.min(2047) << (38 - 18)).saturating_add(kp_ahead);
        Self::of(gains.kp, ki.saturating_add(kp_per_period), kd)
    }

    /// What is worth 2^-n is bit 30 - n of kp, and bit 38 - n of ki and kd. Ki counts hundredths, and is for
    /// a second of 1000 periods.
    fn of(kp: u16, ki: i64, kd: i64) -> Self {
        Self {
            kp: I2F30::from_bits(i32::from(kp.min(32767)) << (30 - 15)),
            ki: FixedI32::from_bits(saturate(ki)),
            minus_kd: FixedI32::from_bits(saturate(kd).saturating_neg()),
        }
    }

    /// Whether the error is integrated.
    pub fn has_integral(&self) -> bool {
        self.ki != 0
    }
}

/// The set-point less the measurement, in the unit of which Kp = 1 is worth 2^-15 of full
/// drive: counts in the position loop, 16 counts/s in the velocity loop. At most 32768 of these.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Error(I16F16);

impl Error {
    /// Of a position loop.
    pub fn of_position(error: Counts) -> Self {
        Self(I16F16::from_bits(shift::<8>(error.to_bits())))
    }

    /// Of a velocity loop: 8 more bits behind the point, less 4 for the unit.
    pub fn of_velocity(error: CountsPerSecond) -> Self {
        Self(I16F16::from_bits(shift::<4>(error.to_bits())))
    }
}

/// Shifts to the left, and saturates instead of losing bits. Not by `clamp`: of its two comparisons
/// and the shift the compiler makes other things than one saturating instruction.
fn shift<const BY: u32>(bits: i32) -> i32 {
    bits.min(i32::MAX >> BY).max(i32::MIN >> BY) << BY
}

/// An integral's part of the drive, rounded down: as `Drive::lossy_from`, which asks first whether
/// it is 0, and the compiler then writes what follows twice.
fn part_of(integral: I10F54) -> Drive {
    let bits = integral.to_bits() >> (I10F54::FRAC_NBITS - Drive::FRAC_NBITS);
    Drive::from_bits(bits as i32) // 24 bits are left
}

/// The drive that is allowed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// The lowest, -1 to 0.
    pub low: Drive,
    /// The highest, 0 to 1.
    pub high: Drive,
}

impl Limits {
    /// None that any loop's drive could reach.
    pub const NONE: Self = Self { low: Drive::MIN, high: Drive::MAX };

    /// Full drive both ways.
    pub const FULL: Self = Self { low: Drive::NEG_ONE, high: Drive::ONE };

    /// Whether the drive is allowed.
    fn allow(&self, drive: Drive) -> bool {
        self.low <= drive && drive <= self.high
    }

    /// The drive, or the limit that it is beyond.
    pub fn apply(&self, drive: Drive) -> Drive {
        drive.min(self.high).max(self.low)
    }

    /// As [`apply`](Self::apply), whichever of the limits is the lower.
    pub fn nearest(&self, drive: Drive) -> Drive {
        drive.max(self.low.min(self.high)).min(self.high.max(self.low))
    }
}

/// One loop's memory.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Pid {
    /// In parts of full drive, with so many bits that no error is too small to add up.
    integral: I10F54,
}

impl Pid {
    /// An empty memory.
    pub fn new() -> Self {
        Self::default()
    }

    /// One period: the drive, within `limits`. See the [module](self) for the formula.
    ///
    /// `rate` is how fast the measurement changes: in counts/s in the position loop, in (counts/s)
    /// per ms in the velocity loop. `feed_forward` is at most 2^14 times full drive.
    #[inline]
    pub fn step(
        &mut self,
        gains: &Gains,
        error: Error,
        rate: I24F8,
        feed_forward: Drive,
        limits: &Limits,
    ) -> Drive {
        // Nothing can wrap, so the additions need no check: a drive holds 2^17 times full drive. With
        // the largest gains and inputs feed-forward is 2^14 times, the proportional term 2^15, the
        // derivative 2^16, the growth of the integral 2^8: less than 2^17 together.
        let proportional = Drive::lossy_from(gains.kp.wide_mul(error.0));
        let derivative = Drive::lossy_from(gains.minus_kd.wide_mul(rate));
        let others = feed_forward.wrapping_add(proportional).wrapping_add(derivative);
        let integral = self.integral.wrapping_add(gains.ki.wide_mul(error.0));
        let drive = others.wrapping_add(part_of(integral));

        if limits.allow(drive) && Limits::FULL.allow(part_of(integral)) {
            self.integral = integral;
            return drive;
        }
        self.step_at_a_limit(integral, error, others, limits)
    }

    /// Cuts the integral back to a share of full drive either way, in the unit of a
    /// [`Duty`](crate::units::Duty).
    pub fn cut_integral(&mut self, share: u16) {
        let most = I10F54::wrapping_from_num(Drive::from_bits(share.into()));
        self.integral = self.integral.min(most).max(most.wrapping_neg());
    }

    /// Anti-windup: a period in which `integral` or the drive would go beyond a limit.
    #[cold]
    fn step_at_a_limit(
        &mut self,
        integral: I10F54,
        error: Error,
        others: Drive,
        limits: &Limits,
    ) -> Drive {
        let mut integral = integral.min(I10F54::ONE).max(I10F54::NEG_ONE);
        let drive = others.wrapping_add(part_of(integral));
        if !limits.allow(drive) {
            // The integral moves with the sign of the error: gains are never negative.
            let deeper =
                if drive > limits.high { error.0.is_positive() } else { error.0.is_negative() };
            if deeper {
                integral = self.integral;
            }
            let bound = |limit: Drive| I10F54::wrapping_from_num(limit); // at most full drive
            // A limit that brakes is none of the integral's.
            let (high, low) = (limits.high.max(Drive::ZERO), limits.low.min(Drive::ZERO));
            integral = integral.min(bound(high)).max(bound(low));
        }
        self.integral = integral;
        limits.apply(others.wrapping_add(part_of(integral)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::channel::Loop;

    /// The formula in floating point, on the numbers of the wire: what a term is worth.
    fn terms(control_loop: Loop, host: HostGains, error: f64, rate: f64) -> (f64, f64, f64) {
        let half_to_the = |power: i32| 0.5_f64.powi(power);
        let (kp, kd, ki) = match control_loop {
            Loop::Position => (half_to_the(15), half_to_the(16), half_to_the(10)),
            Loop::Velocity => (half_to_the(19), half_to_the(18), half_to_the(12)),
        };
        let proportional = f64::from(host.kp) * kp * error;
        let (reset, ahead) = match control_loop {
            Loop::Position => (0.0, 0.0),
            Loop::Velocity => (proportional / 128.0, f64::from(host.kp) * kp * 16.0),
        };
        let integral = f64::from(host.ki_hundredths) / 100.0 * ki / 1000.0 * error + reset;
        (proportional, integral, (f64::from(host.kd) * kd + ahead).min(half_to_the(7)) * rate)
    }

    fn gains_of(control_loop: Loop, host: HostGains) -> Gains {
        match control_loop {
            Loop::Position => Gains::position(host),
            Loop::Velocity => Gains::velocity(host, Reset::DEFAULT),
        }
    }

    fn of(control_loop: Loop, error: I24F8) -> Error {
        match control_loop {
            Loop::Position => Error::of_position(error),
            Loop::Velocity => Error::of_velocity(error),
        }
    }

    #[test]
    fn a_unit_of_each_gain_is_worth_what_the_table_says() {
        for control_loop in [Loop::Position, Loop::Velocity] {
            for (kp, kd, ki_hundredths) in [(50, 5, 0), (1, 0, 0), (0, 511, 0), (900, 33, 40_000)] {
                let host = HostGains { kp, kd, ki_hundredths };
                let gains = gains_of(control_loop, host);
                for (error, rate) in [(0, 0), (1, 1), (-1, 3), (9, -40), (-40, 9)] {
                    let (p, i, d) = terms(control_loop, host, error.into(), rate.into());
                    let (error, rate) =
                        (of(control_loop, I24F8::from_num(error)), I24F8::from_num(rate));
                    let mut pid = Pid::new();
                    for period in 1..=3 {
                        let drive = pid.step(&gains, error, rate, Drive::ZERO, &Limits::FULL);
                        let exact = (p + i * f64::from(period) - d).clamp(-1.0, 1.0);
                        // Three terms, each rounded down; and a Ki that is rounded.
                        let off = (drive.to_num::<f64>() - exact) * 16384.0;
                        let right = (-3.0..=0.1).contains(&off);
                        assert!(right, "{host:?} {control_loop:?}: {off} bits off");
                    }
                }
            }
        }
    }

    #[test]
    fn a_reset_time_and_a_look_ahead_are_what_their_settings_say() {
        let host = HostGains { kp: 200, kd: 0, ki_hundredths: 0 };
        let drive_after = |reset, periods: usize, rate: i32| {
            let (gains, mut pid) = (Gains::velocity(host, reset), Pid::new());
            let error = Error::of_velocity(CountsPerSecond::from_num(64));
            let mut step =
                || pid.step(&gains, error, I24F8::from_num(rate), Drive::ZERO, &Limits::FULL);
            (0..periods).map(|_| step()).last().unwrap().to_num::<f64>()
        };
        let proportional = 200.0 * 64.0 / 524_288.0;
        for time_ms in [50, 128, 1000] {
            let reset = Reset { time_ms, look_ahead_ms: 0 };
            let twice = drive_after(reset, time_ms.into(), 0);
            assert!((twice / proportional - 2.0).abs() < 0.02, "{time_ms}: {twice}");
        }
        for look_ahead_ms in [0, 5, 16] {
            let reset = Reset { time_ms: 1000, look_ahead_ms };
            let ahead = drive_after(reset, 1, 0) - drive_after(reset, 1, 3);
            let expected = 200.0 * 3.0 * f64::from(look_ahead_ms) / 524_288.0;
            assert!((ahead - expected).abs() < 2e-4, "{look_ahead_ms}: {ahead}");
        }
        let none = drive_after(Reset { time_ms: 0, ..Reset::DEFAULT }, 500, 0);
        assert!((none - proportional).abs() < 1e-3, "no reset at all: {none}");
    }

    #[test]
    fn an_integral_adds_up_what_is_far_below_a_bit_of_the_drive() {
        let gains = HostGains { kp: 0, kd: 0, ki_hundredths: 1 };
        let gains = Gains::position(gains);
        let mut pid = Pid::new();
        let error = Error::of_position(Counts::ONE);
        let mut step = || pid.step(&gains, error, I24F8::ZERO, Drive::ZERO, &Limits::FULL);
        // A count for 1000 s at Ki = 0.01: 2^-10 / 100 * 1000 of full drive, which is 160 bits.
        let drive = (0..1_000_000).map(|_| step()).last().unwrap();
        assert!((158..=161).contains(&drive.to_bits()), "{drive}");
    }

    #[test]
    fn the_largest_gains_and_errors_drive_fully_in_the_right_direction_and_never_wrap() {
        let most = HostGains { kp: u16::MAX, kd: u16::MAX, ki_hundredths: u16::MAX };
        let extremes = [i32::MIN, -1 << 23, -256, 0, 256, 1 << 23, i32::MAX];
        for control_loop in [Loop::Position, Loop::Velocity] {
            let gains = gains_of(control_loop, most);
            for error in extremes {
                for rate in extremes {
                    for forward in [-(1 << 28) + 1, 0, (1 << 28) - 1].map(Drive::from_bits) {
                        let mut pid = Pid::new();
                        let error = of(control_loop, I24F8::from_bits(error));
                        let rate = I24F8::from_bits(rate);
                        let exact = gains.kp.wide_mul(error.0).to_num::<f64>()
                            + gains.minus_kd.wide_mul(rate).to_num::<f64>()
                            + forward.to_num::<f64>();
                        for _ in 0..3 {
                            let drive = pid.step(&gains, error, rate, forward, &Limits::FULL);
                            // Beyond twice full drive the integral cannot turn it round.
                            if exact > 2.0 {
                                assert_eq!(drive, Drive::ONE);
                            } else if exact < -2.0 {
                                assert_eq!(drive, Drive::NEG_ONE);
                            }
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn what_a_limit_holds_back_does_not_add_up() {
        let host = HostGains { kp: 0, kd: 0, ki_hundredths: 5000 };
        let gains = Gains::position(host);
        let limits = Limits { high: Drive::ONE / 4, ..Limits::FULL };
        let mut pid = Pid::new();
        let mut step = |error: i32, limits: &Limits| {
            let error = Error::of_position(Counts::from_num(error));
            pid.step(&gains, error, I24F8::ZERO, Drive::ZERO, limits)
        };
        let risen = (0..1000).map(|_| step(500, &limits)).last().unwrap();
        let a_step = 0.025; // of full drive a period
        assert!(
            limits.high >= risen && limits.high.to_num::<f64>() - risen.to_num::<f64>() < a_step
        );
        // Reached and held for long: one step the other way tells at once.
        assert!(step(-500, &limits) < limits.high);
        (0..1000).for_each(|_| _ = step(500, &Limits::FULL));
        assert!(step(-500, &Limits::FULL) < Drive::ONE);
        // A limit that tightens takes what is beyond it.
        assert_eq!(step(0, &limits), limits.high);
        assert_eq!(step(0, &Limits::FULL), limits.high);
    }
}
