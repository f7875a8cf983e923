//! A motor's numbers from recordings, by least squares: those with which a simulated motor, driven as the real
//! one was, turns as that one did.
//!
//! What is compared is how far the shaft turned in windows of some length, not where it is: a push that was
//! not recorded is forgotten after a time constant, and whole counts blur little. The search is Levenberg and
//! Marquardt's, from several time constants, as one that is far off may lead astray.

use super::model::{Motor, PERIOD, Running};

/// What was recorded, evenly spaced in time, from a shaft at rest on.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Record {
    /// Control periods from one sample to the next.
    pub(super) every: usize,
    /// Duty, -1 to 1, positive where counts rise.
    pub(super) duty: Vec<f64>,
    /// Counts.
    pub(super) position: Vec<f64>,
}

/// A motor, and how well it explains what was recorded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fit {
    /// The motor.
    pub motor: Motor,
    /// How much of the motion it explains, in percent; 100 is all.
    pub percent: f64,
}

/// What is searched for: the logarithms of gain and time constant, dead time, both dead bands.
const UNKNOWNS: usize = 5;
type Unknowns = [f64; UNKNOWNS];

/// Windows in seconds; rounds of a search; how far each unknown is moved to see what that changes.
const WINDOW: f64 = 0.04;
const ROUNDS: usize = 30;
const NUDGES: Unknowns = [1e-3, 1e-3, 2e-4, 1e-3, 1e-3];
/// Time constants to begin with, in seconds.
const STARTS: [f64; 4] = [0.03, 0.1, 0.3, 1.0];
/// The longest dead time and time constant that are believed, in seconds.
pub(super) const LONGEST_DEAD_TIME: f64 = 0.04;
const LONGEST_TIME_CONSTANT: f64 = 10.0;

fn unknowns(motor: &Motor) -> Unknowns {
    let [rising, falling] = motor.dead_band;
    [motor.gain.ln(), motor.time_constant.ln(), motor.dead_time, rising, falling]
}

/// The nearest motor that there may be.
fn motor([gain, time_constant, dead_time, rising, falling]: Unknowns) -> Motor {
    Motor {
        gain: gain.exp(),
        time_constant: time_constant.exp().clamp(PERIOD, LONGEST_TIME_CONSTANT),
        dead_time: dead_time.clamp(0.0, LONGEST_DEAD_TIME),
        dead_band: [rising.clamp(0.0, 1.0), falling.clamp(0.0, 1.0)],
    }
}

/// Finds the motor; `None` if nothing turned, or too little was recorded.
pub(super) fn fit(records: &[Record]) -> Option<Fit> {
    let search = Search { records };
    let fastest = records.iter().flat_map(|record| search.turns(record, &record.position));
    let fastest = fastest.fold(0.0_f64, |most, turn| most.max(turn.abs())) / WINDOW;
    let most = records.iter().flat_map(|record| &record.duty);
    let most = most.fold(0.0_f64, |most, duty| most.max(duty.abs()));
    if fastest == 0.0 || most == 0.0 {
        return None;
    }
    let start = |time_constant| Motor {
        gain: fastest / most,
        time_constant,
        dead_time: 2.0 * PERIOD,
        dead_band: [most / 8.0; 2],
    };
    let found = STARTS.iter().map(|&time_constant| search.from(&start(time_constant)));
    found.max_by(|a, b| a.percent.total_cmp(&b.percent))
}

struct Search<'a> {
    records: &'a [Record],
}

impl Search<'_> {
    /// How far a shaft turned in each window.
    fn turns(&self, record: &Record, positions: &[f64]) -> Vec<f64> {
        let window = ((WINDOW / PERIOD) as usize / record.every).max(1);
        let pairs = positions.iter().zip(positions.iter().skip(window));
        pairs.step_by((window / 16).max(1)).map(|(from, to)| to - from).collect()
    }

    /// What was recorded less what this motor would have done, window by window.
    fn rest(&self, motor: &Motor) -> Vec<f64> {
        let of = |record: &Record| {
            let mut running = Running::at_rest(*motor);
            let positions: Vec<_> = record
                .duty
                .iter()
                .map(|&duty| {
                    let position = running.position;
                    (0..record.every).for_each(|_| running.step(duty));
                    position
                })
                .collect();
            let was = self.turns(record, &record.position).into_iter();
            was.zip(self.turns(record, &positions)).map(|(was, is)| was - is).collect::<Vec<_>>()
        };
        self.records.iter().flat_map(of).collect()
    }

    fn from(&self, start: &Motor) -> Fit {
        let mut at = unknowns(start);
        let mut rest = self.rest(&motor(at));
        let mut damping = 1e-3;
        for _ in 0..ROUNDS {
            let before = dot(&rest, &rest);
            let slopes: [Vec<f64>; UNKNOWNS] = std::array::from_fn(|n| {
                let mut moved = at;
                moved[n] += NUDGES[n];
                let moved = self.rest(&motor(moved)).into_iter();
                moved.zip(&rest).map(|(moved, rest)| (moved - rest) / NUDGES[n]).collect()
            });
            let products: [Unknowns; UNKNOWNS] =
                std::array::from_fn(|n| std::array::from_fn(|k| dot(&slopes[n], &slopes[k])));
            let results = std::array::from_fn(|n| -dot(&slopes[n], &rest));
            // A step that makes it worse was too far: less of it.
            let is_better = (0..8).any(|_| {
                let mut damped = products;
                (0..UNKNOWNS).for_each(|n| damped[n][n] += damping * damped[n][n] + 1e-12);
                damping *= 10.0;
                let Some(step) = solve(damped, results) else { return false };
                let next = unknowns(&motor(std::array::from_fn(|n| at[n] + step[n])));
                let left = self.rest(&motor(next));
                let is_better = dot(&left, &left) < before;
                if is_better {
                    (at, rest, damping) = (next, left, (damping * 0.02).max(1e-9));
                }
                is_better
            });
            if !is_better || dot(&rest, &rest) > before * (1.0 - 1e-7) {
                break;
            }
        }
        let turns = self.records.iter().flat_map(|record| self.turns(record, &record.position));
        let turns: Vec<_> = turns.collect();
        let spread = dot(&turns, &turns).max(f64::MIN_POSITIVE);
        Fit { motor: motor(at), percent: 100.0 * (1.0 - (dot(&rest, &rest) / spread).sqrt()) }
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Solves linear equations by Gauss and Jordan's elimination; `None` if they have no one solution.
fn solve(mut rows: [Unknowns; UNKNOWNS], mut results: Unknowns) -> Option<Unknowns> {
    for n in 0..UNKNOWNS {
        let size = |row: usize| rows[row][n].abs();
        let best = (n..UNKNOWNS).max_by(|&a, &b| size(a).total_cmp(&size(b)))?;
        rows.swap(n, best);
        results.swap(n, best);
        if rows[n][n].abs() < f64::MIN_POSITIVE {
            return None;
        }
        for other in (0..UNKNOWNS).filter(|&other| other != n) {
            let factor = rows[other][n] / rows[n][n];
            let pivot = rows[n];
            rows[other].iter_mut().zip(pivot).for_each(|(value, above)| *value -= factor * above);
            results[other] -= factor * results[n];
        }
    }
    Some(std::array::from_fn(|n| results[n] / rows[n][n]))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Runs a motor by a duty of the time, and records its whole counts every so many periods.
    fn record(motor: Motor, seconds: f64, every: usize, duty: impl Fn(f64) -> f64) -> Record {
        let mut running = Running::at_rest(motor);
        let mut record = Record { every, ..Record::default() };
        for n in 0..(seconds / PERIOD) as usize {
            let duty = duty(n as f64 * PERIOD);
            if n.is_multiple_of(every) {
                record.duty.push(duty);
                record.position.push(running.position.floor());
            }
            running.step(duty);
        }
        record
    }

    /// Two levels each way.
    fn steps(low: f64, high: f64, long: f64) -> impl Fn(f64) -> f64 {
        move |time| match (time / long) as u32 % 6 {
            0 | 2 => low,
            1 => high,
            3 | 5 => -low,
            _ => -high,
        }
    }

    #[test]
    fn the_numbers_of_a_motor_are_found_in_whole_counts() {
        for (gain, coarse) in [(480.0, 0.04), (2000.0, 0.02), (60_000.0, 0.01)] {
            for time_constant in [0.02, 0.1, 0.5, 1.5] {
                for band in [0.02, 0.2] {
                    let dead_band = [band, band + 0.03];
                    let was = Motor { gain, time_constant, dead_time: 0.004, dead_band };
                    let long = (3.0 * time_constant).clamp(0.12, 1.5);
                    let taken =
                        record(was, (6.0 * long).max(4.0), 1, steps(band + 0.15, 0.5, long));
                    let found = fit(&[taken]).unwrap();
                    let off = |is: f64, was: f64| (is / was - 1.0).abs();
                    let is = found.motor;
                    let case = format!("{was:?} {found:?}");
                    assert!(off(is.gain, gain) < coarse, "{case}");
                    assert!(off(is.time_constant, time_constant) < 0.05, "{case}");
                    assert!(
                        (is.dead_band[0] - band).abs() < 0.02 && found.percent > 80.0,
                        "{case}"
                    );
                }
            }
        }
    }

    #[test]
    fn of_a_shaft_that_stands_nothing_is_found() {
        let stands = Record { every: 1, duty: vec![0.5; 1000], position: vec![7.0; 1000] };
        assert_eq!(fit(&[stands]), None);
        assert_eq!(fit(&[]), None);
    }
}
