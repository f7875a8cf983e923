//! Set-points that move linearly over a number of control periods and arrive exactly.
//!
//! A [`Ramp`] is the way from one value to another, cut into one increment a period; the
//! increments add up to the whole way, with no division and no rounding left over at the end.
//! After period k of n the way covered is `floor(way * k / n)`.

use crate::units::PERIODS_PER_SECOND;

/// The rest of a way. Units are its owner's: bits of counts, of counts per second, of duty.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Ramp {
    /// Periods still to go.
    left: u16,
    /// All periods of the way.
    periods: u16,
    /// What every period covers.
    step: i32,
    /// What every period would cover besides, in `1/periods`.
    remainder: u16,
    /// The remainders that have not yet made a whole.
    owed: u16,
    /// The slope.
    per_second: i32,
}

impl Ramp {
    /// No way to go.
    pub const NONE: Self =
        Self { left: 0, periods: 0, step: 0, remainder: 0, owed: 0, per_second: 0 };

    /// A way of `way` in `periods` control periods; in 0 or 1 it is gone at once.
    pub fn new(way: i32, periods: u16) -> Self {
        let periods = periods.max(1);
        let n = i32::from(periods);
        // way * 1000 / n, in two parts because the product may need more than 32 bits.
        let slope = |whole: i32, rest: i32| {
            whole
                .checked_mul(PERIODS_PER_SECOND)?
                .checked_add(rest.checked_mul(PERIODS_PER_SECOND)?.checked_div(n)?)
        };
        let per_second = slope(way.checked_div(n).unwrap_or(0), way.checked_rem(n).unwrap_or(0));
        Self {
            left: periods,
            periods,
            step: way.checked_div_euclid(n).unwrap_or(0),
            remainder: way
                .checked_rem_euclid(n)
                .and_then(|rest| u16::try_from(rest).ok())
                .unwrap_or(0),
            owed: 0,
            // A jump has no slope to speak of: whoever follows it is not to be fed forward.
            per_second: if periods == 1 { 0 } else { per_second.unwrap_or(0) },
        }
    }

    /// The increment of the next period; 0 once the way is gone.
    pub fn advance(&mut self) -> i32 {
        if self.left == 0 {
            return 0;
        }
        self.left = self.left.saturating_sub(1);
        match self.owed.checked_add(self.remainder) {
            Some(owed) if owed < self.periods => {
                self.owed = owed;
                self.step
            }
            // A whole has come together (with 16 bits it may even have overflowed on the way).
            _ => {
                self.owed = self.remainder.wrapping_sub(self.periods.wrapping_sub(self.owed));
                self.step.saturating_add(1)
            }
        }
    }

    /// Periods still to go.
    pub fn left(&self) -> u16 {
        self.left
    }

    /// The slope in units per second while there is way to go; 0 for a jump, and at the end.
    pub fn slope(&self) -> i32 {
        if self.left == 0 { 0 } else { self.per_second }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_period_is_on_the_line_and_the_last_one_arrives() {
        for way in [-100_000, -6000, -7, -1, 0, 1, 3, 500, 6001, 8_388_608] {
            for periods in [1, 2, 3, 7, 500, 501, 40_000, u16::MAX] {
                let mut ramp = Ramp::new(way, periods);
                let mut covered = 0;
                for k in 1..=i64::from(periods) {
                    covered += i64::from(ramp.advance());
                    let line = (i64::from(way) * k).div_euclid(i64::from(periods));
                    assert_eq!(covered, line, "{way} in {periods}, period {k}");
                }
                assert_eq!((ramp.left(), ramp.advance()), (0, 0));
            }
        }
    }

    #[test]
    fn no_time_is_at_once_and_has_no_slope() {
        let mut ramp = Ramp::new(6000, 0);
        assert_eq!((ramp.slope(), ramp.advance(), ramp.advance()), (0, 6000, 0));
        assert_eq!(Ramp::new(6000, 500).slope(), 12_000);
    }
}
