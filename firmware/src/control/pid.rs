//! The controller kernel in fixed point, and what the gains of the wire mean.
//!
//! Both loops compute, once a period of 1 ms,
//!
//! ```text
//!   duty = kp * error + integral(ki * error) - kd * rate + feed_forward
//! ```
//!
//! limited to the allowed drive (full drive is 1). `rate` is how fast the measurement itself
//! changes, so a jump of the set-point gives no derivative kick. While the limit holds the drive
//! back, the integral takes no part that would drive deeper into the limit (conditional
//! integration), and it never exceeds the limits itself.
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
//!
//! The velocity loop's Kp has the reset time of 128 ms built in because hosts leave Ki at 0 and
//! expect the speed to be held: a proportional term alone would settle well below the set-point.

use fixed::{
    FixedI32, FixedI64,
    types::{
        I24F8, I32F32,
        extra::{U24, U32, U40},
    },
};
use protocol::pms5005::Loop;

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
    /// A unit of error.
    kp: FixedI32<U24>,
    /// A unit of error and period.
    ki: FixedI32<U32>,
    /// A unit of rate.
    kd: FixedI32<U24>,
}

impl Gains {
    /// The formula of the [module](self).
    pub fn new(control_loop: Loop, gains: HostGains) -> Self {
        let (kp, kd) = (i32::from(gains.kp), i32::from(gains.kd));
        // Ki a second is Ki / 1000 a period, and it counts hundredths; 2^32 is the unit of `ki`.
        // 2^32 / 100_000 = 2^27 / 3125; the division, rounded, is in two parts to fit 32 bits.
        let hundredths = i32::from(gains.ki_hundredths);
        let (whole, rest) = (hundredths / 3125, hundredths % 3125);
        let ki = |log2: u32| {
            let shift = 27_u32.saturating_sub(log2);
            (whole << shift).saturating_add((rest << shift).saturating_add(3125 / 2) / 3125)
        };
        match control_loop {
            Loop::Position => Self {
                kp: FixedI32::from_bits(kp << 9),
                ki: FixedI32::from_bits(ki(10)),
                kd: FixedI32::from_bits(kd << 8),
            },
            Loop::Velocity => Self {
                kp: FixedI32::from_bits(kp << 5),
                ki: FixedI32::from_bits(
                    ki(12).saturating_add(kp << (13_u32.saturating_sub(RESET_TIME_SHIFT))),
                ),
                kd: FixedI32::from_bits(kd << 6),
            },
        }
    }
}

/// The drive that is allowed: parts of full drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// The lowest, -1 or more.
    pub low: I32F32,
    /// The highest, 1 or less.
    pub high: I32F32,
}

impl Limits {
    /// Full drive both ways.
    pub const FULL: Self = Self { low: I32F32::NEG_ONE, high: I32F32::ONE };

    /// The drive, or the limit that it is beyond.
    pub fn apply(&self, drive: I32F32) -> I32F32 {
        drive.min(self.high).max(self.low)
    }

    /// Whether both are beyond this drive.
    fn are_beyond(&self, drive: I32F32) -> bool {
        self.low < drive && drive < self.high
    }
}

/// Drive with 8 more bits below the point, so that no part of an error is too small to add up.
type Integral = FixedI64<U40>;

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

    /// One period. See the [module](self) for the formula. `feed_forward` is less than 2^24 times
    /// full drive.
    #[inline]
    pub fn step(
        &mut self,
        gains: &Gains,
        error: I24F8,
        rate: I24F8,
        feed_forward: I32F32,
        limits: &Limits,
    ) -> I32F32 {
        // Nothing can wrap: at the extremes of gains and errors a product with `kp` or `kd` is
        // 2^24 times full drive, one with `ki` 2^22 times, and 64 bits hold 2^31 and 2^23 times.
        let proportional = gains.kp.wide_mul(error);
        let derivative = gains.kd.wide_mul(rate);
        let others = proportional.wrapping_sub(derivative).wrapping_add(feed_forward);

        let integral = self.integral.wrapping_add(gains.ki.wide_mul(error));
        let drive = others.wrapping_add(to_drive(integral));
        // Most periods are far from any limit, and cheaper for being told apart.
        if limits.are_beyond(drive) && limits.are_beyond(to_drive(integral)) {
            self.integral = integral;
            return drive;
        }
        // Gains are never negative: the integral moves with the sign of the error.
        let deeper = if error < 0 { drive < limits.low } else { drive > limits.high };
        self.limited(others, if deeper { self.integral } else { integral }, limits)
    }

    /// The end of a period in which a limit has its say.
    #[cold]
    fn limited(&mut self, others: I32F32, integral: Integral, limits: &Limits) -> I32F32 {
        // The limits may have tightened since: what is kept has to fit them too.
        self.integral = integral.min(from_drive(limits.high)).max(from_drive(limits.low));
        limits.apply(others.wrapping_add(to_drive(self.integral)))
    }
}

fn to_drive(integral: Integral) -> I32F32 {
    I32F32::from_bits(integral.to_bits() >> 8)
}

/// For limits: they are within -1 and 1, far from the type's.
fn from_drive(limit: I32F32) -> Integral {
    Integral::from_bits(limit.to_bits() << 8)
}
