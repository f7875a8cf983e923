//! Random numbers from a seed: the same on every machine, for ever (splitmix64).

/// A stream of them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Random(u64);

impl Random {
    /// The stream of this seed. Neighbouring seeds have nothing in common.
    pub fn new(seed: u64) -> Self {
        Self(mix(seed.wrapping_add(0x5851_F42D_4C95_7F2D)))
    }

    /// Evenly spread from `low` to `high`.
    pub fn even(&mut self, low: f64, high: f64) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        low + (high - low) * unit(mix(self.0))
    }

    /// From `low` to `high`, every factor as likely as any other of the same size.
    pub fn log_even(&mut self, low: f64, high: f64) -> f64 {
        self.even(low.ln(), high.ln()).exp()
    }

    /// One of these.
    pub fn one_of<T: Copy>(&mut self, all: &[T]) -> T {
        all[(self.even(0.0, all.len() as f64) as usize).min(all.len() - 1)]
    }

    /// Of mean 0 and mean square 1, nearly normal, never beyond 3.47 (four even ones added).
    pub fn normal(&mut self) -> f64 {
        let sum: f64 = (0..4).map(|_| self.even(-1.0, 1.0)).sum();
        sum * 0.75_f64.sqrt()
    }
}

/// -1 to 1, always the same for the same two numbers.
pub fn hashed(seed: u64, number: u64) -> f64 {
    2.0 * unit(mix(mix(seed).wrapping_add(number))) - 1.0
}

fn mix(z: u64) -> u64 {
    let z = z.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// 0 to 1.
fn unit(bits: u64) -> f64 {
    (bits >> 11) as f64 / (1_u64 << 53) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn they_have_the_mean_and_the_spread_that_they_promise() {
        let mut random = Random::new(3);
        let normal: Vec<f64> = (0..100_000).map(|_| random.normal()).collect();
        let mean = |of: &dyn Fn(f64) -> f64| normal.iter().map(|x| of(*x)).sum::<f64>() / 1e5;
        assert!(mean(&|x| x).abs() < 0.015 && (mean(&|x| x * x) - 1.0).abs() < 0.02);
        let drawn: Vec<f64> = (0..100_000).map(|_| random.log_even(1.0, 100.0)).collect();
        let below = drawn.iter().filter(|x| **x < 10.0).count();
        assert!((49_000..51_000).contains(&below), "{below}");
        assert!(drawn.iter().all(|x| (1.0..100.0).contains(x)));
        assert_ne!(Random::new(1).even(0.0, 1.0), Random::new(2).even(0.0, 1.0));
    }
}
