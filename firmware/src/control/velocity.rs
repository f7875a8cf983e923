//! A velocity estimate that is quiet at low speed.
//!
//! The plain difference of counts over one period of 1 ms knows only multiples of 1000 counts/s:
//! at 400 counts/s it reads 0, 0, 1000, 0, 1000. This is a tracking observer (an alpha-beta
//! filter) instead: it runs a model shaft at its own estimate of the velocity, compares the
//! shaft's counts with the model's, and corrects both. Critically damped,
//!
//! ```text
//!   alpha = 1/4, beta = alpha^2 / 4 = 1/64:   natural frequency alpha / (2 T) = 125 rad/s
//! ```
//!
//! so it settles in about 40 ms, has no lag at constant velocity (it lags 2/125 s behind a
//! ramp), and both corrections are shifts. Ripple from the quantisation, as measured by the test
//! below: less than 1/15 of the plain difference's at 40 and at 400 counts/s.

use fixed::types::I16F16;

use super::saturate;
use crate::units::{Counts, CountsPerSecond, PERIODS_PER_SECOND};

/// alpha = 2^-2.
const ALPHA_SHIFT: u32 = 2;
/// beta = 2^-6.
const BETA_SHIFT: u32 = 6;

/// The observer of one shaft.
#[derive(Clone, Copy, Debug, Default)]
pub struct VelocityEstimator {
    /// The shaft's counts minus the model's.
    lead: I16F16,
    /// The model's velocity in counts per period.
    rate: I16F16,
}

impl VelocityEstimator {
    /// An observer of a shaft at rest.
    pub const fn new() -> Self {
        Self { lead: I16F16::ZERO, rate: I16F16::ZERO }
    }

    /// One period: the shaft has moved by `moved` counts. Answers its velocity.
    pub fn update(&mut self, moved: Counts) -> CountsPerSecond {
        // The model has 8 more bits below the point than counts have.
        let moved = I16F16::from_bits(moved.to_bits().saturating_mul(1 << 8));
        let lead = self.lead.saturating_add(moved).saturating_sub(self.rate);
        self.rate = self.rate.saturating_add(lead.wrapping_shr(BETA_SHIFT));
        self.lead = lead.saturating_sub(lead.wrapping_shr(ALPHA_SHIFT));
        self.velocity()
    }

    /// The velocity last estimated.
    pub fn velocity(&self) -> CountsPerSecond {
        let per_second = i64::from(self.rate.to_bits()).saturating_mul(PERIODS_PER_SECOND.into());
        CountsPerSecond::from_bits(saturate(per_second >> 8))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Runs a shaft at `speed` counts/s for 4 s and answers the root mean square error of the
    /// estimate and of the plain difference over the last 2 s, and the estimate's mean.
    fn ripple(speed: i32) -> (f64, f64, f64) {
        let mut estimator = VelocityEstimator::new();
        let (mut ours, mut plain, mut sum) = (0.0, 0.0, 0.0);
        let at = |ms: i32| (speed * ms).div_euclid(1000);
        for ms in 1..=4000 {
            let moved = at(ms) - at(ms - 1);
            let estimate: f64 = estimator.update(Counts::from_num(moved)).to_num();
            if ms > 2000 {
                ours += (estimate - f64::from(speed)).powi(2);
                plain += (f64::from(moved * 1000) - f64::from(speed)).powi(2);
                sum += estimate;
            }
        }
        ((ours / 2000.0).sqrt(), (plain / 2000.0).sqrt(), sum / 2000.0)
    }

    #[test]
    fn it_is_quieter_than_plain_differences_and_unbiased() {
        for speed in [-1234, -400, -40, 40, 400, 1234] {
            let (ours, plain, mean) = ripple(speed);
            println!("{speed} counts/s: rms error {ours:.1}, plain differences {plain:.1}");
            assert!(ours <= plain / 15.0, "{speed}: {ours} against {plain}");
            assert!((mean - f64::from(speed)).abs() < 1.0, "{speed}: mean {mean}");
        }
    }

    #[test]
    fn it_follows_a_step_within_40_ms_and_is_no_faster_than_it_can_be_quiet() {
        let mut estimator = VelocityEstimator::new();
        let rise = (1..).find(|_| estimator.update(Counts::from_num(8)) > 7600).unwrap();
        assert!((15..=40).contains(&rise), "{rise} ms to 95 %");
    }

    #[test]
    fn a_shaft_at_rest_has_velocity_zero() {
        let mut estimator = VelocityEstimator::new();
        estimator.update(Counts::from_num(300));
        let last = (0..500).map(|_| estimator.update(Counts::ZERO)).last().unwrap();
        assert!(last.abs() < 1, "{last}");
    }

    #[test]
    fn impossible_jumps_saturate_and_are_forgotten() {
        let mut estimator = VelocityEstimator::new();
        for moved in [Counts::MAX, Counts::MIN, Counts::MAX, Counts::MAX, Counts::MIN] {
            let last = (0..500).map(|_| estimator.update(moved)).last().unwrap();
            let end = if moved > 0 { CountsPerSecond::MAX } else { CountsPerSecond::MIN };
            assert_eq!(last, end);
        }
        let last = (0..500).map(|_| estimator.update(Counts::ZERO)).last().unwrap();
        assert!(last.abs() < 1, "{last}");
    }
}
