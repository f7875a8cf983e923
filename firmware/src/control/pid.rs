//! The controller kernel in fixed point, and what the gains of the wire mean.
//!
//! Both loops compute, once a period of 1 ms,
//!
//! ```text
//!   drive = kp * error + integral(ki * error) - kd * rate + feed_forward
//! ```
//!
//! limited to the allowed drive (full drive is 1). `rate` is how fast the measurement itself
//! changes, so a jump of the set-point gives no derivative kick. While a limit holds the drive
//! back, the integral takes no part that would drive deeper into the limit (conditional
//! integration) and does not exceed that limit itself; full drive it never exceeds.
//!
//! The gains that hosts send are the original's numbers: Kp 50, Kd 5, Ki 0 by default, and Kp 15
//! to 25 usable for the wheels of the time. This is what one unit of each is worth, in parts of
//! full drive:
//!
//! | gain | position loop | velocity loop |
//! |---|---|---|
//! | Kp = 1 | 2^-15 a count: Kp 50 drives fully at 655 counts | 2^-19 a count/s, and as much again for every 128 ms that the error lasts |
//! | Kd = 1 | 2^-16 a count/s | 2^-18 a (count/s) per ms |
//! | Ki = 1.00 | 2^-10 a count and second | 2^-12 a (count/s) and second |
//! | the most that counts | Kp 32767: full drive at one count; Kd 511: at 128 counts/s | Kp 32767: full drive at 16 counts/s; with it Ki adds nothing |
//!
//! The velocity loop's Kp has the reset time of 128 ms built in because hosts leave Ki at 0 and
//! expect the speed to be held: a proportional term alone would settle well below the set-point.
//!
//! # The numbers
//! What a Cortex-M4 does in one instruction decides the formats: it multiplies 32 by 32 bits and
//! adds the upper half of the product (SMMLA), or the whole of it (SMLAL). With gains of 30 and 38
//! bits behind the point the upper halves are drives of 14 bits, which is what a [`Duty`] has, and
//! no product at the largest gains and errors comes near the 32 bits of their sum: so nothing has
//! to be checked but the limits, and nothing is rounded but each term once, down, to 1/16384 of
//! full drive.
//!
//! [`Duty`]: crate::units::Duty

use fixed::{
    FixedI32, FixedI64,
    types::{
        I16F16, I24F8,
        extra::{U30, U38, U54},
    },
};
use protocol::pms5005::Loop;

use super::{saturate, upper_half};
use crate::units::{Counts, CountsPerSecond, Drive};

/// log2 of the velocity loop's reset time in periods: 128 ms.
const RESET_TIME_SHIFT: u32 = 7;

/// Gains as the original numbers them, for one loop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct HostGains {
    /// Kp, 0 to 65535.
    pub kp: u16,
    /// Kd, 0 to 65535.
    pub kd: u16,
    /// Ki in hundredths, 0 to 65535.
    pub ki_hundredths: u16,
}

impl HostGains {
    /// The original's defaults.
    pub const DEFAULT: Self = Self { kp: 50, kd: 5, ki_hundredths: 0 };
}

/// Gains in parts of full drive, ready to multiply.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Gains {
    /// A unit of error. At most 2^30 bits: see [`Pid::step`].
    kp: FixedI32<U30>,
    /// A unit of error and period.
    ki: FixedI32<U38>,
    /// A unit of rate. Negative, so that every term is added: one instruction less.
    minus_kd: FixedI32<U38>,
}

/// The highest Kp that makes a difference.
const MAX_KP: u16 = 32767;

impl Gains {
    /// The formula of the [module](self).
    pub fn new(control_loop: Loop, gains: HostGains) -> Self {
        let kp = i32::from(gains.kp.min(MAX_KP));
        let (ki_shift, kp_per_period, kd_shift) = match control_loop {
            Loop::Position => (16, 0, 22),
            // An error of 1 is 16 counts/s, so that Kp is worth the same; a rate of 1 is 1/32.
            Loop::Velocity => (14, kp << (23_u32.saturating_sub(RESET_TIME_SHIFT)), 15),
        };
        // Ki a second is Ki / 1000 a period, and it counts hundredths. A product of 16 and 28 bits.
        const PERIOD_HUNDREDTH: i64 = (1 << 44) / 100_000;
        let ki = i64::from(gains.ki_hundredths).wrapping_mul(PERIOD_HUNDREDTH) >> ki_shift;
        let kd = i32::from(gains.kd).min(i32::MAX >> kd_shift);
        Self {
            kp: FixedI32::from_bits(kp << 15),
            ki: FixedI32::from_bits(saturate(ki.saturating_add(kp_per_period.into()))),
            minus_kd: FixedI32::from_bits((kd << kd_shift).saturating_neg()),
        }
    }
}

/// How far a measurement is from its set-point: in a position loop counts, up to 32768 of them, in
/// a velocity loop 16 counts/s.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Error(I16F16);

impl Error {
    /// Of a position loop.
    pub fn of_position(error: Counts) -> Self {
        Self(I16F16::from_bits(shift::<8>(error.to_bits())))
    }

    /// Of a velocity loop.
    pub fn of_velocity(error: CountsPerSecond) -> Self {
        Self(I16F16::from_bits(shift::<4>(error.to_bits())))
    }
}

/// How fast a measurement changes: in a position loop counts/s, in a velocity loop 1/32 of a
/// (count/s) per period, up to 2^23 of these.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rate(I24F8);

impl Rate {
    /// Of a position loop.
    pub fn of_position(velocity: CountsPerSecond) -> Self {
        Self(velocity)
    }

    /// Of a velocity loop: what a period has changed.
    pub fn of_velocity(change: CountsPerSecond) -> Self {
        Self(I24F8::from_bits(shift::<5>(change.to_bits())))
    }
}

/// To the left, limited to what 32 bits hold.
fn shift<const BY: u32>(bits: i32) -> i32 {
    bits.clamp(i32::MIN >> BY, i32::MAX >> BY) << BY
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
    /// Full drive both ways.
    pub const FULL: Self = Self { low: Drive::NEG_ONE, high: Drive::ONE };

    /// The drive, or the limit that it is beyond.
    pub fn apply(&self, drive: Drive) -> Drive {
        drive.min(self.high).max(self.low)
    }
}

/// Drive with so many more bits below the point that no part of an error is too small to add up.
type Integral = FixedI64<U54>;
/// What its upper half has more than a drive.
const INTEGRAL_SHIFT: u32 = 8;

/// One loop's memory: the integral, in parts of full drive.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Pid {
    integral: Integral,
}

impl Pid {
    /// An empty memory.
    pub fn new() -> Self {
        Self::default()
    }

    /// One period. See the [module](self) for the formula. `feed_forward` is less than 2^14 times
    /// full drive.
    #[inline]
    pub fn step(
        &mut self,
        gains: &Gains,
        error: Error,
        rate: Rate,
        feed_forward: Drive,
        limits: &Limits,
    ) -> Drive {
        // Nothing can wrap: in bits of a drive the proportional term is less than 2^29, the
        // damping at most 2^30, the feed-forward less than 2^28. A period adds at most 2^8 to
        // the integral's full drive, and 64 bits hold 2^9 times full drive.
        let proportional = upper_half(gains.kp.wide_mul(error.0).to_bits());
        let damping = upper_half(gains.minus_kd.wide_mul(rate.0).to_bits());
        let integral = self.with(gains, error);
        let others = Drive::from_bits(proportional)
            .wrapping_add(feed_forward)
            .wrapping_add(Drive::from_bits(damping));
        let drive = others.wrapping_add(to_drive(integral));
        if limits.low <= drive && drive <= limits.high {
            self.integral = integral;
            return drive;
        }
        self.limited(gains, error, others, limits)
    }

    /// The integral with a period's error.
    #[inline]
    fn with(&self, gains: &Gains, error: Error) -> Integral {
        within_full_drive(self.integral.wrapping_add(gains.ki.wide_mul(error.0)))
    }

    /// A period in which a limit holds the drive back. It begins again, so that all others do not
    /// keep what only it needs.
    #[cold]
    #[inline(never)]
    fn limited(&mut self, gains: &Gains, error: Error, others: Drive, limits: &Limits) -> Drive {
        let integral = self.with(gains, error);
        let drive = others.wrapping_add(to_drive(integral));
        // Gains are never negative: the integral moves with the sign of the error.
        let deeper = if error.0 < 0 { drive < limits.low } else { drive > limits.high };
        let integral = if deeper { self.integral } else { integral };
        self.integral = integral.min(from_drive(limits.high)).max(from_drive(limits.low));
        limits.apply(others.wrapping_add(to_drive(self.integral)))
    }
}

fn to_drive(integral: Integral) -> Drive {
    Drive::from_bits(upper_half(integral.to_bits()) >> INTEGRAL_SHIFT)
}

/// For limits: they are within -1 and 1, far from the type's.
fn from_drive(limit: Drive) -> Integral {
    Integral::from_bits(i64::from(limit.to_bits()) << (32 + INTEGRAL_SHIFT))
}

/// Limited to full drive. The upper half is enough to do so: one instruction.
fn within_full_drive(integral: Integral) -> Integral {
    const FULL: i32 = Drive::ONE.to_bits() << INTEGRAL_SHIFT;
    let bits = integral.to_bits();
    let upper = upper_half(bits).clamp(-FULL, FULL - 1);
    Integral::from_bits(i64::from(upper) << 32 | bits & i64::from(u32::MAX))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The formula in floating point, on the numbers of the wire: what a term is worth.
    fn terms(control_loop: Loop, host: HostGains, error: f64, rate: f64) -> (f64, f64, f64) {
        let log2 = |shift: i32| 2.0_f64.powi(-shift);
        let (kp, kd, ki) = match control_loop {
            Loop::Position => (log2(15), log2(16), log2(10)),
            Loop::Velocity => (log2(19), log2(18), log2(12)),
        };
        let proportional = f64::from(host.kp) * kp * error;
        let reset = if control_loop == Loop::Velocity { proportional / 128.0 } else { 0.0 };
        let integral = f64::from(host.ki_hundredths) / 100.0 * ki / 1000.0 * error + reset;
        (proportional, integral, f64::from(host.kd) * kd * rate)
    }

    fn of(control_loop: Loop, error: I24F8, rate: I24F8) -> (Error, Rate) {
        match control_loop {
            Loop::Position => (Error::of_position(error), Rate::of_position(rate)),
            Loop::Velocity => (Error::of_velocity(error), Rate::of_velocity(rate)),
        }
    }

    #[test]
    fn a_unit_of_each_gain_is_worth_what_the_table_says() {
        for control_loop in [Loop::Position, Loop::Velocity] {
            for (kp, kd, ki_hundredths) in [(50, 5, 0), (1, 0, 0), (0, 511, 0), (900, 33, 40_000)] {
                let host = HostGains { kp, kd, ki_hundredths };
                let gains = Gains::new(control_loop, host);
                for (error, rate) in [(0, 0), (1, 1), (-1, 3), (9, -40), (-40, 9)] {
                    let (p, i, d) = terms(control_loop, host, error.into(), rate.into());
                    let (error, rate) =
                        of(control_loop, I24F8::from_num(error), I24F8::from_num(rate));
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
    fn an_integral_adds_up_what_is_far_below_a_bit_of_the_drive() {
        let gains = HostGains { kp: 0, kd: 0, ki_hundredths: 1 };
        let gains = Gains::new(Loop::Position, gains);
        let mut pid = Pid::new();
        let error = Error::of_position(Counts::ONE);
        let mut step = || pid.step(&gains, error, Rate::default(), Drive::ZERO, &Limits::FULL);
        // A count for 1000 s at Ki = 0.01: 2^-10 / 100 * 1000 of full drive, which is 160 bits.
        let drive = (0..1_000_000).map(|_| step()).last().unwrap();
        assert!((158..=161).contains(&drive.to_bits()), "{drive}");
    }

    #[test]
    fn the_largest_gains_and_errors_drive_fully_in_the_right_direction_and_never_wrap() {
        let most = HostGains { kp: u16::MAX, kd: u16::MAX, ki_hundredths: u16::MAX };
        let extremes = [i32::MIN, -1 << 23, -256, 0, 256, 1 << 23, i32::MAX];
        for control_loop in [Loop::Position, Loop::Velocity] {
            let gains = Gains::new(control_loop, most);
            for error in extremes {
                for rate in extremes {
                    for forward in [-(1 << 28) + 1, 0, (1 << 28) - 1] {
                        let mut pid = Pid::new();
                        let (error, rate) = (I24F8::from_bits(error), I24F8::from_bits(rate));
                        let (error, rate) = of(control_loop, error, rate);
                        let forward = Drive::from_bits(forward);
                        let exact = i128::from(gains.kp.to_bits()) * i128::from(error.0.to_bits())
                            + i128::from(gains.minus_kd.to_bits()) * i128::from(rate.0.to_bits())
                            + (i128::from(forward.to_bits()) << 32);
                        for _ in 0..3 {
                            let drive = pid.step(&gains, error, rate, forward, &Limits::FULL);
                            // Beyond what the integral can turn round the sign is certain.
                            if exact > 1 << 48 {
                                assert_eq!(drive, Drive::ONE);
                            } else if exact < -(1 << 48) {
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
        let gains = Gains::new(Loop::Position, host);
        let limits = Limits { high: Drive::ONE / 4, ..Limits::FULL };
        let mut pid = Pid::new();
        let mut step = |error: i32, limits: &Limits| {
            let error = Error::of_position(Counts::from_num(error));
            pid.step(&gains, error, Rate::default(), Drive::ZERO, limits)
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
