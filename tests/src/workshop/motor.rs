//! A brushed DC motor on its bridge, from first principles, all of it referred to the motor's shaft.
//!
//! ```text
//!   J dw/dt = k i (1 + ripple) - b w - cogging - friction        L di/dt = u - R i - k w
//!   u = supply * (duty less what the driver loses)
//! ```
//!
//! - Between two looks (50 us) the linear part is solved exactly, by its matrix exponential; what depends on
//!   the angle or the speed (ripple, cogging, friction) is what it is at the look.
//! - Friction is Coulomb's, and Stribeck's curve leads to it from the breakaway torque. A shaft at rest stays
//!   *exactly* there until more than that pulls; one that comes to rest does so at a look.
//! - Friction wanders: it is never twice the same, and so never turns a shaft.
//! - A driver loses the beginning of every pulse, and takes up a new duty late. Disabled, it lets the shaft
//!   coast and the current dies out; enabled with duty 0 it shorts the motor.
//! - Left out: ripple of the PWM, the diodes' voltages, heat, a supply that sags, backlash, elasticity.
//!
//! [`Parameters`] tells the truth about itself: gain, dead band, time constants.

use std::f64::consts::TAU;

use super::random::Random;

/// Looks in a control period of 1 ms.
pub const LOOKS: usize = 20;
/// Seconds between two looks.
pub const LOOK_S: f64 = 1e-3 / LOOKS as f64;

/// What the motor and its driver are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameters {
    /// V.
    pub supply: f64,
    /// Ohm, the bridge's included.
    pub resistance: f64,
    /// H, above 0.
    pub inductance: f64,
    /// N·m/A, which is also V·s/rad.
    pub torque_constant: f64,
    /// kg·m² of rotor and load.
    pub inertia: f64,
    /// N·m of dry friction while it turns.
    pub coulomb: f64,
    /// N·m that hold it at rest.
    pub breakaway: f64,
    /// rad/s at which 1/e is left of what breakaway is above Coulomb's friction. Above 0.
    pub stribeck: f64,
    /// N·m·s/rad.
    pub viscous: f64,
    /// By which part of itself friction wanders, root mean square.
    pub wander: f64,
    /// The part of the torque by which it ripples, and how often a turn.
    pub ripple: (f64, f64),
    /// N·m by which it cogs, and how often a turn. Less than Coulomb's friction.
    pub cogging: (f64, f64),
    /// The part of full duty that the driver loses.
    pub lost_duty: f64,
    /// How late the driver takes up a new duty, in looks: up to 40, which is 2 ms.
    pub delay_looks: usize,
}

impl Parameters {
    /// N·m of full drive at rest.
    pub fn stall_torque(&self) -> f64 {
        self.torque_constant * self.supply / self.resistance
    }

    /// N·m·s/rad: by how much a faster shaft has less torque.
    fn slope(&self) -> f64 {
        self.torque_constant.powi(2) / self.resistance + self.viscous
    }

    /// rad/s of steady speed for each part of full duty beyond the dead band, times full duty.
    pub fn gain(&self) -> f64 {
        self.stall_torque() / self.slope()
    }

    /// The part of full duty from which steady speeds count: what Coulomb's friction and the driver take.
    pub fn dead_band(&self) -> f64 {
        self.coulomb / self.stall_torque() + self.lost_duty
    }

    /// The part of full duty that moves a shaft at rest, if friction and cogging are at their mean.
    pub fn breakaway_duty(&self) -> f64 {
        self.breakaway / self.stall_torque() + self.lost_duty
    }

    /// The two time constants in seconds of the driven motor, longer first: the mechanical one, and that
    /// of the current. `NaN` if it swings, as no motor here does.
    pub fn time_constants(&self) -> (f64, f64) {
        // (J s + b)(L s + R) + k² = 0
        let square = self.inertia * self.inductance;
        let linear = self.inertia * self.resistance + self.viscous * self.inductance;
        let constant = self.viscous * self.resistance + self.torque_constant.powi(2);
        let root = (linear * linear - 4.0 * square * constant).sqrt();
        // Both from the sum of two positive numbers: no digits are lost.
        let fast = (linear + root) / (2.0 * square);
        let slow = constant / (square * fast);
        (1.0 / slow, 1.0 / fast)
    }

    /// Friction in N·m that opposes this velocity, without its wander and without the viscous part.
    fn dry(&self, velocity: f64) -> f64 {
        let far = velocity / self.stribeck;
        if far.abs() > 6.0 {
            return self.coulomb;
        }
        self.coulomb + (self.breakaway - self.coulomb) * (-far * far).exp()
    }
}

/// What a bridge is told.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Drive {
    /// -1 to 1.
    pub duty: f64,
    /// Whether it drives at all.
    pub enabled: bool,
}

/// How a state goes on until the next look: rows are angle, velocity, current; columns these and the two
/// inputs, voltage and torque.
type Ahead = [[f64; 5]; 3];

/// A motor that turns.
#[derive(Clone, Debug, PartialEq)]
pub struct Motor {
    parameters: Parameters,
    driven: Ahead,
    coasting: Ahead,
    /// What is left of a current until the next look in a shaft at rest.
    decay: f64,
    angle: f64,
    velocity: f64,
    current: f64,
    /// The newest first.
    told: [Drive; 3],
    /// By which part friction is off at this moment.
    wandered: f64,
    /// How far it can turn, if it is blocked.
    stops: Option<(f64, f64)>,
    phase: f64,
    random: Random,
}

/// Friction wanders with this time constant, in control periods.
const WANDER_PERIODS: f64 = 10.0;

impl Motor {
    /// At rest at angle 0.
    pub fn new(parameters: Parameters, seed: u64) -> Self {
        let p = &parameters;
        let still = (-LOOK_S * p.resistance / p.inductance).exp();
        let mut random = Random::new(seed);
        Self {
            driven: ahead(p, p.torque_constant),
            coasting: ahead(p, 0.0),
            decay: still,
            angle: 0.0,
            velocity: 0.0,
            current: 0.0,
            told: [Drive::default(); 3],
            wandered: 0.0,
            stops: None,
            phase: random.even(0.0, TAU),
            random,
            parameters,
        }
    }

    /// rad since the beginning.
    pub fn angle(&self) -> f64 {
        self.angle
    }

    /// rad/s.
    pub fn velocity(&self) -> f64 {
        self.velocity
    }

    /// A.
    pub fn current(&self) -> f64 {
        self.current
    }

    /// Lets it turn no further than so many rad either way from here.
    pub fn block(&mut self, play: f64) {
        self.stops = Some((self.angle - play, self.angle + play));
    }

    /// Somebody takes hold of the shaft: it stands.
    pub fn stop_by_hand(&mut self) {
        self.velocity = 0.0;
    }

    /// A control period.
    pub fn step(&mut self, drive: Drive) {
        self.told = [drive, self.told[0], self.told[1]];
        let kept = (-1.0 / WANDER_PERIODS).exp();
        let fresh = (1.0 - kept * kept).sqrt() * self.parameters.wander;
        self.wandered = kept * self.wandered + fresh * self.random.normal();
        for look in 0..LOOKS {
            let late = self.parameters.delay_looks.saturating_sub(look).div_ceil(LOOKS);
            self.look(self.told[late.min(self.told.len() - 1)]);
        }
    }

    fn look(&mut self, drive: Drive) {
        let p = self.parameters;
        let voltage = if drive.enabled {
            let got = (drive.duty.abs().min(1.0) - p.lost_duty).max(0.0);
            p.supply * got.copysign(drive.duty)
        } else {
            0.0
        };
        let of_angle = |(size, often): (f64, f64)| match size {
            0.0 => 0.0,
            _ => size * (often * self.angle + self.phase).sin(),
        };
        let current = if drive.enabled { self.current } else { 0.0 };
        let uneven = p.torque_constant * current * of_angle(p.ripple) - of_angle(p.cogging);
        let dry = p.dry(self.velocity) * (1.0 + self.wandered).max(0.0);
        let way = if self.velocity == 0.0 {
            let pull = p.torque_constant * current + uneven;
            let is_at_stop = self.stops.is_some_and(|(low, high)| {
                if pull > 0.0 { self.angle >= high } else { self.angle <= low }
            });
            if pull.abs() <= dry || is_at_stop {
                return self.rest(voltage);
            }
            pull.signum()
        } else {
            self.velocity.signum()
        };
        let state = [self.angle, self.velocity, self.current, voltage, uneven - dry * way];
        let ahead = if drive.enabled { &self.driven } else { &self.coasting };
        let [angle, velocity, current] = ahead.map(|row| (0..5).map(|k| row[k] * state[k]).sum());
        self.current = current;
        if velocity * way > 0.0 {
            (self.angle, self.velocity) = (angle, velocity);
        } else {
            // It came to rest in between, on a straight line.
            let part = self.velocity / (self.velocity - velocity);
            if self.velocity != 0.0 {
                self.angle += self.velocity * part * LOOK_S / 2.0;
            }
            self.velocity = 0.0;
        }
        if let Some((low, high)) = self.stops
            && !(low..=high).contains(&self.angle)
        {
            (self.angle, self.velocity) = (self.angle.clamp(low, high), 0.0);
        }
    }

    /// Only the current goes on.
    fn rest(&mut self, voltage: f64) {
        let settled = voltage / self.parameters.resistance;
        self.current = settled + (self.current - settled) * self.decay;
    }
}

/// Of a motor whose current makes so much torque, and whose velocity so much voltage.
fn ahead(p: &Parameters, constant: f64) -> Ahead {
    let (j, l) = (p.inertia, p.inductance);
    let rates = [
        [0.0, 1.0, 0.0, 0.0, 0.0],
        [0.0, -p.viscous / j, constant / j, 0.0, 1.0 / j],
        [0.0, -constant / l, -p.resistance / l, 1.0 / l, 0.0],
        [0.0; 5],
        [0.0; 5],
    ];
    let [angle, velocity, current, ..] = exponential(rates, LOOK_S);
    [angle, velocity, current]
}

/// exp(a t): Taylor's series of a 1024th of it, squared ten times.
fn exponential(a: [[f64; 5]; 5], t: f64) -> [[f64; 5]; 5] {
    let unit: [[f64; 5]; 5] =
        std::array::from_fn(|i| std::array::from_fn(|j| if i == j { 1.0 } else { 0.0 }));
    let small = a.map(|row| row.map(|x| x * t / 1024.0));
    let (mut sum, mut term) = (unit, unit);
    for n in 1..=12 {
        term = product(&term, &small).map(|row| row.map(|x| x / f64::from(n)));
        sum = std::array::from_fn(|i| std::array::from_fn(|j| sum[i][j] + term[i][j]));
    }
    (0..10).fold(sum, |power, _| product(&power, &power))
}

fn product(a: &[[f64; 5]; 5], b: &[[f64; 5]; 5]) -> [[f64; 5]; 5] {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..5).map(|k| a[i][k] * b[k][j]).sum()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every number is easy: stall torque 60 mN·m, slope 1.25e-4 N·m·s/rad, gain 480 rad/s, dead band 12 %.
    const PLAIN: Parameters = Parameters {
        supply: 12.0,
        resistance: 4.0,
        inductance: 1.6e-3,
        torque_constant: 0.02,
        inertia: 1e-5,
        coulomb: 6e-3,
        breakaway: 9e-3,
        stribeck: 4.0,
        viscous: 25e-6,
        wander: 0.0,
        ripple: (0.0, 6.0),
        cogging: (0.0, 12.0),
        lost_duty: 0.02,
        delay_looks: 0,
    };
    const ROUGH: Parameters = Parameters {
        wander: 0.08,
        ripple: (0.03, 6.0),
        cogging: (1e-3, 12.0),
        delay_looks: 13,
        ..PLAIN
    };

    fn within(what: &str, value: f64, low: f64, high: f64) {
        assert!((low..=high).contains(&value), "{what}: {value}, not {low} to {high}");
    }

    fn run(motor: &mut Motor, duty: f64, periods: u32) {
        (0..periods).for_each(|_| motor.step(Drive { duty, enabled: true }));
    }

    fn running(parameters: Parameters, duty: f64) -> Motor {
        let mut motor = Motor::new(parameters, 1);
        run(&mut motor, duty, 2000);
        motor
    }

    #[test]
    fn what_it_tells_of_itself_is_what_the_numbers_make() {
        within("gain", PLAIN.gain(), 479.9, 480.1);
        within("dead band", PLAIN.dead_band(), 0.1199, 0.1201);
        within("breakaway", PLAIN.breakaway_duty(), 0.1699, 0.1701);
        let (slow, fast) = PLAIN.time_constants();
        // J/slope = 80 ms, L/R = 0.4 ms.
        within("slow", slow, 0.0796, 0.0798);
        within("fast", fast, 0.000400, 0.000402);
    }

    #[test]
    fn its_steady_speed_is_its_gain_times_the_duty_beyond_the_dead_band() {
        for duty in [0.2, 0.5, 1.0] {
            for sign in [1.0, -1.0] {
                let speed = running(PLAIN, sign * duty).velocity() * sign;
                let should = 480.0 * (duty - 0.12);
                within("speed", speed / should, 0.9999, 1.0001);
            }
        }
        // Everything that is uneven turns about the mean.
        let mut motor = running(ROUGH, 0.5);
        let from = motor.angle();
        run(&mut motor, 0.5, 4000);
        within("mean", (motor.angle() - from) / 4.0 / (480.0 * 0.38), 0.99, 1.01);
    }

    #[test]
    fn it_approaches_a_new_speed_with_its_time_constant_behind_its_dead_time() {
        for (parameters, dead) in
            [(PLAIN, 0.4e-3), (Parameters { delay_looks: 30, ..PLAIN }, 1.9e-3)]
        {
            let mut motor = running(parameters, 0.3);
            let (from, to) = (motor.velocity(), 480.0 * 0.68);
            let angle = motor.angle();
            let mut speeds = vec![];
            for _ in 0..1000 {
                run(&mut motor, 0.8, 1);
                speeds.push((to - motor.velocity()) / (to - from));
            }
            // ln of what is left falls by dt/T: taken between 20 and 200 ms.
            let slope = (speeds[19] / speeds[199]).ln() / 0.18;
            within("time constant", 1.0 / slope, 0.0795, 0.0799);
            // The way that it lags behind: dead time and time constant, 1 s long.
            let lag = (to * 1.0 - (motor.angle() - angle)) / (to - from);
            within("lag", lag - 0.0797, dead - 1e-4, dead + 1e-4);
        }
    }

    #[test]
    fn it_takes_more_to_break_away_than_to_go_on_and_less_moves_nothing() {
        let mut motor = Motor::new(PLAIN, 1);
        let mut moves = |k: i32| {
            run(&mut motor, f64::from(k) / 1e4, 2000);
            motor.velocity() > 5.0
        };
        let breakaway = (1000..2500).find(|k| moves(*k)).unwrap();
        assert!((1700..1710).contains(&breakaway), "{breakaway}");
        // Moving, the least that it takes is 7.1 mN·m, at 8 rad/s.
        let stalls = (0..breakaway).rev().find(|k| !moves(*k)).unwrap();
        assert!((1350..1400).contains(&stalls), "{stalls}");
    }

    #[test]
    fn a_shaft_at_rest_stays_exactly_there() {
        let mut motor = running(ROUGH, 0.3);
        run(&mut motor, 0.0, 2000);
        let at = motor.angle();
        for duty in [0.0, 0.1, -0.1] {
            run(&mut motor, duty, 50_000);
            assert_eq!((motor.angle(), motor.velocity()), (at, 0.0));
        }
        run(&mut motor, 0.22, 100);
        assert!(motor.angle() > at + 1.0);
    }

    #[test]
    fn a_shorted_motor_brakes_and_a_disabled_one_coasts() {
        let stop = |enabled| {
            let mut motor = running(PLAIN, 1.0);
            let periods = (1..5000).find(|_| {
                motor.step(Drive { duty: 0.0, enabled });
                motor.velocity() == 0.0
            });
            periods.unwrap()
        };
        // J/s ln(1 + s w / Tc), with the slope s or with the viscous part of it, at 422 rad/s.
        let (brakes, coasts) = (stop(true), stop(false));
        assert!((178..186).contains(&brakes), "{brakes}");
        assert!((400..408).contains(&coasts), "{coasts}: J/b ln(1 + 25e-6 * 422 / 6e-3)");
    }

    #[test]
    fn a_blocked_shaft_draws_its_stall_current_and_moves_within_its_play() {
        for play in [0.0, 0.3] {
            let mut motor = Motor::new(PLAIN, 1);
            motor.block(play);
            run(&mut motor, 1.0, 100);
            within("current", motor.current(), 2.939, 2.941); // 98 % of 12 V over 4 ohm
            assert_eq!((motor.angle(), motor.velocity()), (play, 0.0));
            run(&mut motor, -1.0, 100);
            assert_eq!((motor.angle(), motor.velocity()), (-play, 0.0));
        }
    }

    #[test]
    fn energy_is_all_accounted_for() {
        let mut motor = Motor::new(PLAIN, 1);
        let (mut supplied, mut lost) = (0.0, 0.0);
        let p = PLAIN;
        for k in 0..40_000 {
            let duty: f64 = if k < 25_000 { 0.8 } else { -0.5 };
            let (i, w) = (motor.current, motor.velocity);
            motor.look(Drive { duty, enabled: true });
            let (i, w) = ((i + motor.current) / 2.0, (w + motor.velocity) / 2.0);
            supplied += p.supply * (duty - p.lost_duty.copysign(duty)) * i * LOOK_S;
            let friction = p.dry(w) * w.abs() + p.viscous * w * w;
            lost += (p.resistance * i * i + friction) * LOOK_S;
        }
        let kept =
            (p.inertia * motor.velocity.powi(2) + p.inductance * motor.current.powi(2)) / 2.0;
        within("accounted for", (lost + kept) / supplied, 0.999, 1.001);
        assert!(kept > 0.01 * supplied);
    }

    #[test]
    fn the_same_seed_makes_the_same_bits_and_another_does_not() {
        let [a, b, c] = [7, 7, 8].map(|seed| {
            let mut motor = Motor::new(ROUGH, seed);
            run(&mut motor, 0.4, 3000);
            [motor.angle(), motor.velocity(), motor.current()].map(f64::to_bits)
        });
        assert_eq!(a, b);
        assert_ne!(a, c);
    }
}
