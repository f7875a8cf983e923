//! An incremental encoder as it is made: its edges are not where they should be.
//!
//! A *line* of the disc is four *counts*, one for each edge of the two tracks. In counts:
//! - the four edges of a line are off by their [`phase`](Parameters::phase), the same in every line;
//! - each line is off by up to [`pitch`](Parameters::pitch), each its own;
//! - the disc is not centred: once a turn it leads and lags by [`eccentricity`](Parameters::eccentricity);
//! - each reading sees the shaft up to [`jitter`](Parameters::jitter) off, so that a shaft which stands on an
//!   edge may flicker by one count.
//!
//! No edge ever overtakes its neighbour, and no count is ever lost.

use std::f64::consts::TAU;

use super::random::{Random, hashed};

/// What it is like, in counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameters {
    /// Counts a turn of its own shaft: a multiple of 4.
    pub counts_per_turn: u32,
    /// By how much each of a line's four edges is late. Less than 0.25.
    pub phase: [f64; 4],
    /// The most by which a line is late or early. Less than 0.2.
    pub pitch: f64,
    /// Amplitude.
    pub eccentricity: f64,
    /// The most by which a reading is off. Less than 0.1.
    pub jitter: f64,
    /// Where on the disc counting begins, and which disc it is.
    pub seed: u64,
}

/// One that counts since it was switched on.
#[derive(Clone, Debug, PartialEq)]
pub struct Encoder {
    parameters: Parameters,
    /// Where the shaft was then, in counts of the disc, and what the disc showed there.
    start: f64,
    zero: i64,
    random: Random,
}

impl Encoder {
    /// At count 0.
    pub fn new(parameters: Parameters) -> Self {
        let mut random = Random::new(parameters.seed);
        let start = random.even(0.0, parameters.counts_per_turn.into());
        let mut new = Self { parameters, start, zero: 0, random };
        new.zero = new.edges_below(start);
        new
    }

    /// What it counts where the shaft has turned by so many counts.
    pub fn read(&mut self, turned: f64) -> i64 {
        let jitter = self.random.even(-1.0, 1.0) * self.parameters.jitter;
        self.edges_below(self.start + turned + jitter) - self.zero
    }

    fn edges_below(&self, at: f64) -> i64 {
        let p = &self.parameters;
        let turn = at / f64::from(p.counts_per_turn);
        let seen = at + p.eccentricity * (TAU * turn).sin();
        let nearest = seen.floor() as i64;
        match nearest {
            n if seen < self.edge(n) => n - 1,
            n if seen >= self.edge(n + 1) => n + 1,
            n => n,
        }
    }

    fn edge(&self, number: i64) -> f64 {
        let p = &self.parameters;
        let on_disc = number.rem_euclid(p.counts_per_turn.into()) as u64;
        let line = hashed(p.seed, on_disc / 4) * p.pitch;
        number as f64 + p.phase[(on_disc % 4) as usize] + line
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROUGH: Parameters = Parameters {
        counts_per_turn: 12,
        phase: [0.15, -0.1, 0.05, -0.15],
        pitch: 0.08,
        eccentricity: 0.01,
        jitter: 0.0,
        seed: 5,
    };

    #[test]
    fn it_counts_every_edge_once_either_way_and_returns_to_where_it_was() {
        let mut encoder = Encoder::new(ROUGH);
        let mut widths = Vec::new();
        let (mut last, mut last_edge) = (0, 0.0);
        for k in 0..120_000 {
            let at = f64::from(k) / 1000.0;
            let count = encoder.read(at);
            assert!(count == last || count == last + 1, "{last} and then {count}");
            if count > last {
                widths.push(at - last_edge);
                (last, last_edge) = (count, at);
            }
        }
        assert!((119..=121).contains(&last), "{last}");
        let uneven =
            widths[4..].iter().fold((9.0_f64, 0.0_f64), |(a, b), w| (a.min(*w), b.max(*w)));
        assert!((0.5..0.85).contains(&uneven.0) && (1.15..1.5).contains(&uneven.1), "{uneven:?}");
        assert_eq!(encoder.read(0.0), 0);
        assert!((-121..=-119).contains(&encoder.read(-120.0)));
        // A disc is round: a turn further on its edges lie alike.
        let turn: Vec<_> = (0..1000).map(|k| encoder.read(f64::from(k) / 100.0)).collect();
        let next: Vec<_> =
            (0..1000).map(|k| encoder.read(f64::from(k) / 100.0 + 12.0) - 12).collect();
        assert_eq!(turn, next);
    }

    #[test]
    fn a_shaft_that_stands_flickers_by_one_count_on_an_edge_and_by_none_elsewhere() {
        let mut encoder = Encoder::new(Parameters { jitter: 0.04, ..ROUGH });
        let (mut flickering, mut places) = (0, 0);
        for k in 0..2000 {
            let at = f64::from(k) / 100.0;
            let read: Vec<_> = (0..50).map(|_| encoder.read(at)).collect();
            let (low, high) = (read.iter().min().unwrap(), read.iter().max().unwrap());
            assert!(high - low <= 1);
            (flickering, places) = (flickering + (high - low), places + 1);
        }
        let share = flickering as f64 / f64::from(places);
        assert!((0.05..0.09).contains(&share), "{share}: twice the jitter of every count");
    }
}
