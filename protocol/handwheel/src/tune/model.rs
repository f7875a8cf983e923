//! What a motor with its load does, in the few numbers that a loop is tuned by, and what a loop of the board
//! would make of it.
//!
//! Vocabulary: *gain* is the slope of the steady speed over the duty, in counts per second at full drive;
//! the *dead band* the duty that moves nothing; the *time constant* how fast a speed follows a duty, and the
//! *dead time* how long nothing is seen of a new one.
//!
//! ```text
//!   time constant * dv/dt = gain * (duty a dead time ago - dead band) - v
//! ```
//!
//! The loops are the firmware's (`firmware/src/control`: `pid`, `velocity`), in floating point, and so is the
//! shaft's sensor: whole counts, once a control period.

use std::collections::VecDeque;

use super::gains::{Gains, Loop, Step};

/// A control period in seconds.
pub(super) const PERIOD: f64 = 1e-3;

/// A motor with its load, as its sensor sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motor {
    /// Counts per second at full drive, beyond the dead band.
    pub gain: f64,
    /// In seconds.
    pub time_constant: f64,
    /// In seconds.
    pub dead_time: f64,
    /// The duty that moves nothing, 0 to 1: with rising and with falling counts.
    pub dead_band: [f64; 2],
}

impl Motor {
    /// Steady counts per second at this duty, -1 to 1.
    pub fn steady(&self, duty: f64) -> f64 {
        let [rising, falling] = self.dead_band;
        self.gain * if duty > 0.0 { (duty - rising).max(0.0) } else { (duty + falling).min(0.0) }
    }
}

/// A motor that runs, period by period.
pub(super) struct Running {
    motor: Motor,
    /// What is left of a speed after a period without drive.
    left: f64,
    /// Duties that are still to be felt, the oldest first.
    coming: VecDeque<f64>,
    /// How much of the oldest is still felt in the next period.
    share: f64,
    pub(super) speed: f64,
    pub(super) position: f64,
}

impl Running {
    /// At rest, in the middle of a count.
    pub(super) fn at_rest(motor: Motor) -> Self {
        let periods = motor.dead_time / PERIOD;
        Self {
            motor,
            left: (-PERIOD / motor.time_constant).exp(),
            coming: VecDeque::from(vec![0.0; periods as usize + 1]),
            share: periods.fract(),
            speed: 0.0,
            position: 0.5,
        }
    }

    /// One period with this duty.
    pub(super) fn step(&mut self, duty: f64) {
        self.coming.push_back(duty);
        let oldest = self.coming.pop_front().unwrap_or(duty);
        let next = self.coming.front().copied().unwrap_or(duty);
        let before = self.speed;
        self.speed = self.after(oldest * self.share + next * (1.0 - self.share));
        self.position += (before + self.speed) / 2.0 * PERIOD;
    }

    /// The speed after a period with this duty.
    fn after(&self, duty: f64) -> f64 {
        let ([rising, falling], speed) = (self.motor.dead_band, self.speed);
        let is_rising = speed > 0.0 || speed == 0.0 && duty > 0.0;
        let pull = if is_rising { duty - rising } else { duty + falling };
        if speed == 0.0 && (is_rising && pull <= 0.0 || !is_rising && pull >= 0.0) {
            return 0.0;
        }
        let goal = self.motor.gain * pull;
        let next = goal + (speed - goal) * self.left;
        // Friction stops a shaft, and does not turn it back.
        if next * speed < 0.0 { 0.0 } else { next }
    }
}

/// The board's loop over one channel.
struct Control {
    control_loop: Loop,
    /// In parts of full drive: a unit of error, of error and period, of rate.
    kp: f64,
    ki: f64,
    kd: f64,
    /// Drive for a count per second of the set-point.
    forward: f64,
    most: f64,
    integral: f64,
    /// The velocity observer: how far the shaft is ahead of its model, and the model's counts a period.
    lead: f64,
    rate: f64,
    count: f64,
    velocity: f64,
}

impl Control {
    /// A loop with these gains, of a motor that makes `full_speed`, with no more duty than `most`.
    fn new(control_loop: Loop, gains: Gains, full_speed: f64, most: f64) -> Self {
        let Gains { kp, kd, reset_ms } = gains;
        let (kp, kd) = (f64::from(kp), f64::from(kd));
        let half_to_the = |power: i32| 0.5_f64.powi(power);
        let (kp, ki, kd, forward) = match control_loop {
            Loop::Velocity => {
                let kp = kp * half_to_the(19);
                let ki = (kp / f64::from(reset_ms)).min(half_to_the(11));
                (kp, ki, kd * half_to_the(18), 0.5 / full_speed)
            }
            Loop::Position => (kp * half_to_the(15), 0.0, kd * half_to_the(16), 0.0),
        };
        let (integral, lead, rate, count, velocity) = (0.0, 0.0, 0.0, 0.0, 0.0);
        Self { control_loop, kp, ki, kd, forward, most, integral, lead, rate, count, velocity }
    }

    /// The duty of a period, for a shaft that is there.
    fn step(&mut self, set_point: f64, position: f64) -> f64 {
        let count = position.floor();
        let lead = self.lead + (count - self.count) - self.rate;
        self.count = count;
        self.rate += lead / 64.0;
        self.lead = lead - lead / 4.0;
        let before = self.velocity;
        self.velocity = self.rate / PERIOD;
        let (error, rate) = match self.control_loop {
            Loop::Velocity => (set_point - self.velocity, self.velocity - before),
            Loop::Position => (set_point - count, self.velocity),
        };
        let others = self.kp * error - self.kd * rate + self.forward * set_point;
        let integral = (self.integral + self.ki * error).clamp(-1.0, 1.0);
        let duty = others + integral;
        let is_deeper = duty > self.most && error > 0.0 || duty < -self.most && error < 0.0;
        if !is_deeper {
            self.integral = integral;
        }
        if duty.abs() > self.most {
            self.integral = self.integral.clamp(-self.most, self.most);
        }
        (others + self.integral).clamp(-self.most, self.most)
    }
}

/// One period of a step's response as it is expected.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Expected {
    /// The shaft's own: counts per second, or counts.
    pub(super) value: f64,
    /// What the board sees of it.
    pub(super) seen: f64,
    pub(super) duty: f64,
}

/// What the loop with these gains makes of a step from rest to this target, period by period.
pub(super) fn step_of(
    motor: &Motor,
    control_loop: Loop,
    gains: Gains,
    Step { target, most }: Step,
    periods: usize,
) -> Vec<Expected> {
    let mut control = Control::new(control_loop, gains, motor.gain, most);
    let mut running = Running::at_rest(*motor);
    let period = |_| {
        let duty = control.step(target, running.position);
        running.step(duty);
        let (value, seen) = match control_loop {
            Loop::Velocity => (running.speed, control.velocity),
            Loop::Position => (running.position - 0.5, control.count),
        };
        Expected { value, seen, duty }
    };
    (0..periods).map(period).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const MOTOR: Motor =
        Motor { gain: 8000.0, time_constant: 0.1, dead_time: 0.003, dead_band: [0.1, 0.2] };

    #[test]
    fn a_motor_runs_up_in_its_time_constant_after_its_dead_time() {
        let mut running = Running::at_rest(MOTOR);
        let speeds: Vec<_> = (0..2000)
            .map(|_| {
                running.step(0.5);
                running.speed
            })
            .collect();
        assert_eq!(speeds[2], 0.0);
        let at = |ms: usize| speeds[ms + 2] / 3200.0;
        assert!((at(100) - 0.632).abs() < 0.002 && (at(1000) - 1.0).abs() < 1e-4, "{}", at(100));
    }

    #[test]
    fn a_dead_band_holds_a_shaft_and_stops_it() {
        let mut running = Running::at_rest(MOTOR);
        (0..1000).for_each(|_| running.step(-0.19));
        assert_eq!(running.speed, 0.0);
        (0..1000).for_each(|_| running.step(-0.3));
        assert!((running.speed + 800.0).abs() < 1.0, "{}", running.speed);
        (0..1000).for_each(|_| running.step(0.0));
        assert_eq!(running.speed, 0.0);
    }

    #[test]
    fn a_velocity_step_settles_at_its_target() {
        let gains = Gains { kp: 250, kd: 0, reset_ms: 100 };
        let response =
            step_of(&MOTOR, Loop::Velocity, gains, Step { target: 2000.0, most: 0.6 }, 2000);
        let end = response[1999];
        assert!((end.value - 2000.0).abs() < 20.0, "{end:?}");
        assert!((end.duty - 0.35).abs() < 0.05 && response.iter().all(|at| at.duty <= 0.6));
    }
}
