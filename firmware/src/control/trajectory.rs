//! How a set-point gets from one value to another: one increment a period, and exact at the end.
//!
//! - A [`Ramp`] is linear over a number of control periods. After period k of n the way covered is
//!   `floor(way * k / n)`.
//! - A [`Profile`] keeps to an acceleration besides: it speeds up to what the ramp would do, and slows
//!   down in time. It takes as much longer as it needs for that.
//!
//! Units are their owner's: bits of counts, of counts per second, of duty.

use super::saturate;
use crate::units::PERIODS_PER_SECOND;

/// One of the two.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Course {
    /// Linear.
    Ramp(Ramp),
    /// At a limited acceleration.
    Profile(Profile),
}

impl Course {
    /// No way to go.
    pub const NONE: Self = Self::Ramp(Ramp::NONE);

    /// The increment of the next period; 0 once the way is gone.
    pub fn advance(&mut self) -> i32 {
        match self {
            Self::Ramp(ramp) => ramp.advance(),
            Self::Profile(profile) => profile.advance(),
        }
    }

    /// Periods still to go, without those that speeding up and slowing down take.
    pub fn left(&self) -> u16 {
        match self {
            Self::Ramp(ramp) => ramp.left(),
            Self::Profile(profile) => profile.left(),
        }
    }

    /// The slope in units per second while there is way to go; 0 for a jump, and at the end.
    pub fn slope(&self) -> i32 {
        match self {
            Self::Ramp(ramp) => ramp.slope(),
            Self::Profile(profile) => profile.slope(),
        }
    }

    /// The set-point stands: a profile sets out anew.
    pub fn stand(&mut self) {
        if let Self::Profile(profile) = self {
            profile.pace = 0;
        }
    }

    /// The set-point has been put back by so much: the way is longer, the slope the same.
    pub fn lengthen(&mut self, by: i32) {
        match self {
            Self::Ramp(ramp) => *ramp = ramp.longer(by),
            Self::Profile(profile) => profile.way = profile.way.saturating_add(by),
        }
    }
}

/// The rest of a linear way.
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

    /// The same slope over a way that is longer by so much.
    fn longer(&self, by: i32) -> Self {
        let left = i64::from(self.left);
        let remainders = i64::from(self.remainder).saturating_mul(left);
        let wholes = remainders.saturating_add(self.owed.into());
        let wholes = wholes.checked_div(self.periods.into()).unwrap_or(0);
        let rest = i64::from(self.step).saturating_mul(left).saturating_add(wholes);
        let way = saturate(rest.saturating_add(by.into()));
        Self { per_second: self.per_second, ..Self::new(way, periods_for(way, self.per_second)) }
    }
}

/// How many periods a way takes at this slope, at most 65,535; 1 if there is none.
fn periods_for(way: i32, per_second: i32) -> u16 {
    let a_second = i64::from(way).saturating_abs().saturating_mul(PERIODS_PER_SECOND.into());
    let periods = a_second.checked_div(i64::from(per_second).saturating_abs()).unwrap_or(1);
    u16::try_from(periods).unwrap_or(u16::MAX)
}

/// The rest of a way at a limited acceleration. Its numbers have 8 bits more than their owner's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Profile {
    /// What is left of the way, in the owner's bits, and what was gone of the first of them.
    way: i32,
    gone: i32,
    /// What this period covers, either way; at most `cruise`, and from one period to the next no more
    /// than `acceleration` apart.
    pace: i32,
    cruise: i32,
    acceleration: i32,
}

impl Profile {
    /// A way at this slope (units per second) and acceleration (units per second and second), from one
    /// that is under way.
    pub fn new(way: i32, slope: i32, acceleration: i64, before: &Course) -> Self {
        let a_period = |per_second: i64| per_second.saturating_mul(256).wrapping_div(1000);
        let acceleration = acceleration.saturating_mul(256).wrapping_div(1_000_000);
        let pace = match before {
            Course::Ramp(ramp) => saturate(a_period(ramp.slope().into())),
            Course::Profile(profile) => profile.pace,
        };
        Self {
            way,
            gone: 0,
            pace,
            cruise: saturate(a_period(i64::from(slope).saturating_abs())).max(1),
            acceleration: saturate(acceleration).max(1),
        }
    }

    fn advance(&mut self) -> i32 {
        let way = (i64::from(self.way) << 8).saturating_sub(self.gone.into());
        let (pace, most) = (i64::from(self.pace), i64::from(self.acceleration));
        let last = most.min(self.cruise.into());
        if way.saturating_abs() <= last && pace.saturating_abs() <= most {
            let rest = self.way;
            (self.way, self.gone, self.pace) = (0, 0, 0);
            return rest;
        }
        // The pace p from which it comes to rest after this way: p^2 + a p = 2 a way.
        let (way_left, a) = (way.unsigned_abs(), most.unsigned_abs());
        let square = a.saturating_mul(a >> 2).saturating_add(a.saturating_mul(way_left << 1));
        let stops = i64::try_from(square.isqrt().saturating_sub(a >> 1)).unwrap_or(i64::MAX);
        let wanted = stops.min(self.cruise.into()).max(1).saturating_mul(way.signum());
        let change = wanted.saturating_sub(pace).min(most).max(most.saturating_neg());
        let pace = pace.saturating_add(change);
        self.pace = saturate(pace);
        let gone = self.gone.saturating_add(self.pace);
        let whole = gone >> 8;
        self.gone = gone & 0xFF;
        self.way = self.way.saturating_sub(whole);
        whole
    }

    fn left(&self) -> u16 {
        periods_for(self.way, self.cruise_per_second())
    }

    fn cruise_per_second(&self) -> i32 {
        saturate(i64::from(self.cruise).saturating_mul(PERIODS_PER_SECOND.into()) >> 8)
    }

    fn slope(&self) -> i32 {
        saturate(i64::from(self.pace).saturating_mul(PERIODS_PER_SECOND.into()) >> 8)
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

    #[test]
    fn a_way_that_gets_longer_keeps_its_slope_and_arrives() {
        for (way, periods, gone, by) in
            [(6000, 500, 200, 100), (-70_001, 40_000, 1, -7), (7, 3, 2, 0)]
        {
            let mut course = Course::Ramp(Ramp::new(way, periods));
            let covered: i32 = (0..gone).map(|_| course.advance()).sum();
            let slope = course.slope();
            course.lengthen(by);
            assert_eq!(course.slope(), slope);
            let mut rest = Vec::new();
            while course.left() > 0 {
                rest.push(course.advance());
            }
            assert_eq!(covered + rest.iter().sum::<i32>(), way + by);
            let line = f64::from(way) / f64::from(periods);
            let off = rest.len() as f64 * line - f64::from(way + by - covered);
            assert!(off.abs() <= 1.5 * line.abs() + 1.0, "{way}: {} periods", rest.len());
        }
    }

    #[test]
    fn a_profile_speeds_up_and_slows_down_within_its_acceleration_and_arrives() {
        // Bits of counts: 256 a count. 1000, 100,000 counts/s^2; rates of 50, 4000, 60,000 counts/s.
        for acceleration in [1000 << 8, 100_000 << 8] {
            for slope in [50 << 8, 4000 << 8, 60_000 << 8] {
                for way in [-12_000 << 8, -300, 1, 256, 3 << 8, 700 << 8, 30_000 << 8] {
                    let mut course =
                        Course::Profile(Profile::new(way, slope, acceleration, &Course::NONE));
                    let (mut covered, mut last) = (0i64, 0i64);
                    let most = acceleration / 1_000_000 + 2; // a bit of a count for each rounding
                    let mut periods = 0;
                    while covered != i64::from(way) || last != 0 {
                        let pace = i64::from(course.advance());
                        covered += pace;
                        assert!((pace - last).abs() <= most, "{way}: from {last} to {pace}");
                        assert!(pace.abs() <= i64::from(slope) / 1000 + 1, "{way}: {pace}");
                        // A few bits for rounding.
                        assert!(covered.abs() <= i64::from(way).abs() + 4, "{way}: {covered}");
                        last = pace;
                        periods += 1;
                        assert!(periods < 700_000, "{way}: still on its way");
                    }
                    // Not needlessly slow: the way at its rate, and twice the time to get up to it.
                    let (way, slope) = (f64::from(way).abs(), f64::from(slope));
                    let a = acceleration as f64;
                    let seconds = if way < slope * slope / a {
                        2.0 * (way / a).sqrt()
                    } else {
                        way / slope + slope / a
                    };
                    let least = seconds * 1000.0;
                    let most = least * 1.1 + 20.0;
                    assert!(
                        (least * 0.95 - 2.0..=most).contains(&f64::from(periods)),
                        "{way} {slope} {a}: {periods} not {least}"
                    );
                }
            }
        }
    }

    #[test]
    fn a_profile_that_is_turned_round_brakes_first() {
        let acceleration = 10_000 << 8;
        let mut course =
            Course::Profile(Profile::new(9000 << 8, 8000 << 8, acceleration, &Course::NONE));
        let gone: i32 = (0..500).map(|_| course.advance()).sum();
        let mut back = Course::Profile(Profile::new(-gone, 8000 << 8, acceleration, &course));
        let (mut at, mut farthest) = (gone, gone);
        for _ in 0..5000 {
            at += back.advance();
            farthest = farthest.max(at);
        }
        // From 5000 counts/s it takes 1250 counts to stand.
        assert_eq!(at, 0);
        assert!((1240..=1280).contains(&((farthest - gone) >> 8)), "{}", (farthest - gone) >> 8);
    }
}
