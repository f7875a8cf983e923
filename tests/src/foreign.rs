//! A plant and a PID from the textbook, in floating point, by somebody who has read neither the
//! simulated motors nor their numbers: what the controller is measured against.
//!
//! [`Motor`] is a brushed DC gear motor and the wheel behind it. Every angle, torque and inertia
//! is referred to the motor's shaft, as if the gear were 1:1.
//!
//! ```text
//!   duty * supply = R i + L di/dt + k w       motor: Jm w' = k i - cogging - mesh - friction
//!   mesh: a dead zone, spring and damper      wheel: Jw w' = mesh - load - friction
//! ```
//!
//! - Friction is Stribeck's curve on both bodies. A body at rest stays *exactly* at rest until more
//!   than the breakaway torque pulls: in each substep friction takes away as much momentum as it
//!   can, but never turns a velocity round. So nothing creeps or chatters.
//! - Positive duty counts up. The encoder is on the motor's shaft unless
//!   [`encoder_on_wheel`](Parameters::encoder_on_wheel) says otherwise.
//! - An enabled bridge with duty 0 shorts the motor, which brakes it; a disabled one lets it coast.
//! - Left out: ripple of the PWM and of the brushes, diodes, heat, a supply that sags.
//!
//! The same seed makes the same bits on the same machine (`sin` and `exp` are the machine's).
//! [`TextbookPid`] is that of Åström and Murray, *Feedback Systems*, "PID Control".

use std::f64::consts::TAU;

/// The longest substep in seconds: a fortieth of the shortest periods, which are that of cogging at
/// full speed and that of the lightest wheel against the motor.
const SUBSTEP: f64 = 50e-6;

/// What the motor and the wheel are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameters {
    /// V.
    pub supply: f64,
    /// Ohm, the bridge's included.
    pub resistance: f64,
    /// H; 0 for a current without delay.
    pub inductance: f64,
    /// N·m/A, which is also V·s/rad.
    pub torque_constant: f64,
    /// kg·m², of the rotor.
    pub motor_inertia: f64,
    /// The wheel's inertia in parts of the rotor's: 0.05 to 50.
    pub inertia_ratio: f64,
    /// N·m of friction while moving, motor and wheel together.
    pub coulomb: f64,
    /// N·m of friction at rest, motor and wheel together.
    pub breakaway: f64,
    /// rad/s at which 1/e is left of what breakaway is above Coulomb's friction. Not 0.
    pub stribeck_velocity: f64,
    /// N·m·s/rad, motor and wheel together.
    pub viscous: f64,
    /// How much of all friction is the wheel's, 0 to 1.
    pub wheel_friction: f64,
    /// rad, from flank to flank.
    pub backlash: f64,
    /// N·m/rad of a tooth against its flank.
    pub stiffness: f64,
    /// N·m·s/rad of a tooth against its flank.
    pub damping: f64,
    /// N·m, amplitude.
    pub cogging: f64,
    /// Detents a turn.
    pub cogs: f64,
    /// N·m on the wheel, such as gravity; positive turns it back.
    pub load_torque: f64,
    /// N·m on the wheel, root mean square, drawn anew with every step.
    pub torque_noise: f64,
    /// A/D counts on the current, root mean square, drawn anew with every step.
    pub adc_noise: f64,
    /// The encoder's counts a turn; need not be whole.
    pub counts_per_turn: f64,
    /// Whether the encoder is behind the backlash instead of before it.
    pub encoder_on_wheel: bool,
}

impl Parameters {
    /// A wheel that makes this many counts a second at full duty, unloaded. The motor is always the
    /// same (12 V, 3 A held, 0.3 A running, 500 rad/s, 90 ms); the encoder is made to fit.
    pub fn wheel(full_speed_counts_per_second: f64) -> Self {
        let wheel = Self {
            supply: 12.0,
            resistance: 4.0,
            inductance: 2e-3,
            torque_constant: 0.0216,
            motor_inertia: 5.5e-6,
            inertia_ratio: 1.0,
            coulomb: 4e-3,
            breakaway: 6e-3,
            stribeck_velocity: 5.0,
            viscous: 5e-6,
            wheel_friction: 0.4,
            backlash: 1.0,
            stiffness: 2.4,
            damping: 1.5e-3,
            cogging: 0.5e-3,
            cogs: 6.0,
            load_torque: 0.0,
            torque_noise: 0.0,
            adc_noise: 0.0,
            counts_per_turn: 1.0,
            encoder_on_wheel: false,
        };
        Self { counts_per_turn: full_speed_counts_per_second / (wheel.full_speed() / TAU), ..wheel }
    }

    /// The torque in N·m of full duty at rest.
    pub fn stall_torque(&self) -> f64 {
        self.torque_constant * self.supply / self.resistance
    }

    /// rad/s at full duty, where the load is friction alone.
    pub fn full_speed(&self) -> f64 {
        (self.stall_torque() - self.coulomb) / self.slope()
    }

    /// The time constant in seconds of the velocity while the motor is driven or shorted.
    pub fn time_constant(&self) -> f64 {
        self.motor_inertia * (1.0 + self.inertia_ratio) / self.slope()
    }

    /// N·m·s/rad: by how much a faster shaft has less torque.
    fn slope(&self) -> f64 {
        self.torque_constant.powi(2) / self.resistance + self.viscous
    }

    /// Stribeck's curve: friction in N·m, motor and wheel together.
    fn friction(&self, velocity: f64) -> f64 {
        let stribeck = (-(velocity / self.stribeck_velocity).powi(2)).exp();
        self.coulomb + (self.breakaway - self.coulomb) * stribeck + self.viscous * velocity.abs()
    }
}

/// The rotor, or the wheel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Body {
    angle: f64,
    velocity: f64,
}

impl Body {
    /// Moves for `seconds`; both torques over the same inertia, in rad/s².
    fn turn(&mut self, pull: f64, friction: f64, seconds: f64) {
        let free = self.velocity + pull * seconds;
        self.velocity = (free.abs() - friction * seconds).max(0.0).copysign(free);
        self.angle += self.velocity * seconds;
    }
}

/// The motor and its wheel.
#[derive(Clone, Debug, PartialEq)]
pub struct Motor {
    parameters: Parameters,
    motor: Body,
    wheel: Body,
    held: bool,
    current: f64,
    adc_noise: f64,
    /// Where the detents are, in radians of cogging.
    phase: f64,
    random: u64,
}

impl Motor {
    /// At rest, at 0 counts, in the middle of its backlash, anywhere between two detents.
    pub fn new(parameters: Parameters, seed: u64) -> Self {
        let rest = Body::default();
        let mut new = Self {
            parameters,
            motor: rest,
            wheel: rest,
            held: false,
            current: 0.0,
            adc_noise: 0.0,
            phase: 0.0,
            random: seed,
        };
        new.phase = new.noise(TAU);
        new
    }

    /// Lets `seconds` pass. `duty` is -1 to 1; a bridge that is not `enabled` does nothing.
    pub fn step(&mut self, duty: f64, enabled: bool, seconds: f64) {
        let load = self.parameters.load_torque + self.noise(self.parameters.torque_noise);
        self.adc_noise = self.noise(self.parameters.adc_noise);
        let substeps = (seconds / SUBSTEP).ceil().max(1.0);
        for _ in 0..substeps as usize {
            self.substep(duty.clamp(-1.0, 1.0), enabled, load, seconds / substeps);
        }
    }

    fn substep(&mut self, duty: f64, enabled: bool, load: f64, dt: f64) {
        let p = self.parameters;
        self.current = if enabled {
            let emf = p.torque_constant * self.motor.velocity;
            let settled = (duty * p.supply - emf) / p.resistance;
            settled + (self.current - settled) * (-dt * p.resistance / p.inductance).exp()
        } else {
            0.0
        };
        let mesh = self.mesh();
        let cogging = p.cogging * (p.cogs * self.motor.angle + self.phase).sin();
        let torque = p.torque_constant * self.current - cogging - mesh;
        let friction = p.friction(self.motor.velocity) * (1.0 - p.wheel_friction);
        self.motor.turn(torque / p.motor_inertia, friction / p.motor_inertia, dt);

        if self.held {
            self.wheel.velocity = 0.0;
        } else {
            let inertia = p.motor_inertia * p.inertia_ratio;
            let friction = p.friction(self.wheel.velocity) * p.wheel_friction;
            self.wheel.turn((mesh - load) / inertia, friction / inertia, dt);
        }
    }

    /// The torque from motor to wheel. A flank pushes and never pulls.
    fn mesh(&self) -> f64 {
        let p = &self.parameters;
        let lead = self.motor.angle - self.wheel.angle;
        let deep = lead - lead.clamp(-p.backlash / 2.0, p.backlash / 2.0);
        if deep == 0.0 {
            return 0.0;
        }
        let damped = p.damping * (self.motor.velocity - self.wheel.velocity);
        let push = deep.signum() * (p.stiffness * deep + damped);
        push.max(0.0) * deep.signum()
    }

    /// A number of this root mean square, evenly spread about 0 (splitmix64).
    fn noise(&mut self, rms: f64) -> f64 {
        self.random = self.random.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = self.random;
        let z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        let even = ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 52) as f64 - 1.0; // -1 to 1
        rms * 3.0_f64.sqrt() * even
    }

    /// Holds the wheel fast, or lets it go.
    pub fn hold(&mut self, held: bool) {
        self.held = held;
    }

    /// What the motor and the wheel are; may change while they run.
    pub fn parameters(&mut self) -> &mut Parameters {
        &mut self.parameters
    }

    /// The encoder's counter.
    pub fn encoder(&self) -> u16 {
        self.counts().floor() as i64 as u16
    }

    /// What the encoder would count without wrapping and with parts of a count.
    pub fn counts(&self) -> f64 {
        self.encoder_side().angle * self.parameters.counts_per_turn / TAU
    }

    /// Counts a second, of the encoder's side.
    pub fn velocity(&self) -> f64 {
        self.encoder_side().velocity * self.parameters.counts_per_turn / TAU
    }

    fn encoder_side(&self) -> &Body {
        if self.parameters.encoder_on_wheel { &self.wheel } else { &self.motor }
    }

    /// A, positive with positive duty.
    pub fn current(&self) -> f64 {
        self.current
    }

    /// What the board's A/D converter reads: 728 counts an ampere, either direction, 12 bits.
    pub fn current_adc(&self) -> u16 {
        (728.0 * self.current.abs() + self.adc_noise).round().clamp(0.0, 4095.0) as u16
    }
}

/// A PID in parallel form with a period of 1 ms. The derivative is of the measurement, filtered.
/// The integral stands still while it would go deeper into a limit (conditional integration: with
/// back-calculation it would unwind by what is fed forward beyond the limit).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TextbookPid {
    /// Parts of full drive a unit of error.
    pub kp: f64,
    /// Parts of full drive a unit of error and second.
    pub ki: f64,
    /// Parts of full drive a unit per second.
    pub kd: f64,
    /// Parts of full drive a unit of what is fed forward.
    pub kff: f64,
    /// The time constant of the derivative's filter in seconds. 8 ms as it is made.
    pub derivative_filter: f64,
    /// The lowest and the highest drive. -1 and 1 as it is made.
    pub limits: (f64, f64),
    integral: f64,
    derivative: f64,
    last: Option<f64>,
}

impl TextbookPid {
    /// Seconds.
    pub const PERIOD: f64 = 1e-3;

    /// From physical gains, in parts of full drive; see the fields.
    pub fn new(kp: f64, ki: f64, kd: f64, kff: f64) -> Self {
        let (derivative_filter, limits) = (8e-3, (-1.0, 1.0));
        Self {
            kp,
            ki,
            kd,
            kff,
            derivative_filter,
            limits,
            integral: 0.0,
            derivative: 0.0,
            last: None,
        }
    }

    /// A velocity loop, in counts/s, with the gains of the wire: what each is worth is the table in
    /// `firmware::control::pid`, with the reset time of 128 ms and the 16 ms ahead. Fed forward is half of
    /// the set-point.
    pub fn velocity(kp: u16, kd: u16, ki_hundredths: u16, full_speed: f64) -> Self {
        let [kp, kd, ki] = [kp, kd, ki_hundredths].map(f64::from);
        let kp = kp / 2_f64.powi(19);
        let ki = ki / 100.0 / 2_f64.powi(12) + kp / 0.128;
        Self::new(kp, ki, kd / 2_f64.powi(18) / 1000.0 + kp * 16e-3, 0.5 / full_speed)
    }

    /// A position loop, in counts, with the gains of the wire, as [`velocity`](Self::velocity). Fed
    /// forward is the velocity of the set-point, to the drive and to the derivative.
    pub fn position(kp: u16, kd: u16, ki_hundredths: u16, full_speed: f64) -> Self {
        let [kp, kd, ki] = [kp, kd, ki_hundredths].map(f64::from);
        let ki = ki / 100.0 / 2_f64.powi(10);
        let kd = kd / 2_f64.powi(16);
        Self::new(kp / 2_f64.powi(15), ki, kd, 1.0 / full_speed + kd)
    }

    /// One period: the drive.
    pub fn step(&mut self, set_point: f64, measured: f64, fed_forward: f64) -> f64 {
        let error = set_point - measured;
        let moved = measured - self.last.replace(measured).unwrap_or(measured);
        self.derivative = (self.derivative_filter * self.derivative + moved)
            / (self.derivative_filter + Self::PERIOD);
        let wanted =
            self.kp * error + self.integral - self.kd * self.derivative + self.kff * fed_forward;
        let drive = wanted.clamp(self.limits.0, self.limits.1);
        if (wanted - drive) * error <= 0.0 {
            self.integral += Self::PERIOD * self.ki * error;
        }
        drive
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;

    const FULL: f64 = 16384.0;
    const MS: f64 = 1e-3;

    /// What is true of every angle alike: a motor without detents.
    fn smooth() -> Parameters {
        Parameters { cogging: 0.0, ..Parameters::wheel(FULL) }
    }

    fn within(what: &str, value: f64, low: f64, high: f64) {
        assert!((low..=high).contains(&value), "{what}: {value}, not {low} to {high}");
    }

    /// Runs for so many ms, or for less until `done`; returns the ms it took.
    fn run(m: &mut Motor, duty: f64, on: bool, ms: u32, done: impl Fn(&Motor) -> bool) -> u32 {
        (1..=ms)
            .find(|_| {
                m.step(duty, on, MS);
                done(m)
            })
            .unwrap_or(ms)
    }

    /// A motor that has run with this duty for 2 s.
    fn running(parameters: Parameters, duty: f64) -> Motor {
        let mut m = Motor::new(parameters, 1);
        run(&mut m, duty, true, 2000, |_| false);
        m
    }

    fn energy(m: &Motor) -> f64 {
        let p = &m.parameters;
        let lead = m.motor.angle - m.wheel.angle;
        let deep = lead - lead.clamp(-p.backlash / 2.0, p.backlash / 2.0);
        (p.motor_inertia * m.motor.velocity.powi(2)
            + p.motor_inertia * p.inertia_ratio * m.wheel.velocity.powi(2)
            + p.inductance * m.current.powi(2)
            + p.stiffness * deep.powi(2))
            / 2.0
    }

    #[test]
    fn full_duty_makes_full_speed_either_way_and_draws_what_a_free_wheel_draws() {
        for full in [500.0, FULL, 1e6] {
            for sign in [1.0, -1.0] {
                let m = running(Parameters::wheel(full), sign);
                within("full speed", m.velocity() * sign / full, 0.99, 1.01);
                within("free current", m.current() * sign, 0.28, 0.32);
                assert_eq!(m.encoder(), m.counts().floor().rem_euclid(65536.0) as u16);
            }
        }
    }

    #[test]
    fn it_is_at_63_percent_of_full_speed_after_its_time_constant() {
        for (ratio, low, high) in [(1.0, 85, 97), (4.0, 216, 238)] {
            let mut m = Motor::new(Parameters { inertia_ratio: ratio, ..smooth() }, 1);
            let rise = run(&mut m, 1.0, true, 2000, |m| m.velocity() > 0.632 * FULL);
            assert!((low..=high).contains(&rise), "inertia ratio {ratio}: {rise} ms");
        }
    }

    #[test]
    fn a_held_wheel_draws_3_amperes_at_full_duty_and_in_proportion() {
        let mut m = Motor::new(Parameters { adc_noise: 4.0, ..Parameters::wheel(FULL) }, 1);
        m.hold(true);
        for (duty, amperes) in [(1.0, 3.0), (0.5, 1.5), (-1.0, -3.0)] {
            run(&mut m, duty, true, 500, |_| false);
            within("held current", m.current(), amperes - 0.03, amperes + 0.03);
            within(
                "A/D counts",
                m.current_adc().into(),
                728.0 * amperes.abs() - 30.0,
                728.0 * amperes.abs() + 30.0,
            );
            assert_eq!(m.velocity(), 0.0);
        }
        let read = |m: &mut Motor| {
            m.step(-1.0, true, MS);
            m.current_adc()
        };
        let different: HashSet<u16> = (0..100).map(|_| read(&mut m)).collect();
        assert!((10..=15).contains(&different.len()), "{different:?}"); // 4 * sqrt(3) = 7 either way
        run(&mut m, 1.0, false, 1, |_| false);
        assert_eq!(m.current(), 0.0);
        m.parameters().supply = 24.0;
        run(&mut m, 1.0, true, 100, |_| false);
        assert_eq!(m.current_adc(), 4095);
        let slow = |inductance| {
            let mut m = Motor::new(Parameters { inductance, ..smooth() }, 1);
            m.hold(true);
            run(&mut m, 1.0, true, 100, |m| m.current() > 1.9)
        };
        assert_eq!((slow(0.0), slow(8e-3)), (1, 3)); // one period, or L/R = 2 ms and some back-EMF
    }

    #[test]
    fn it_takes_more_to_break_away_than_to_keep_moving_and_less_does_nothing() {
        // Over the stall torque: 6 / 64.8 mN·m at rest; moving, the least that friction and the
        // back-EMF take together, at 7.5 rad/s: 5.1 / 64.8.
        let mut m = Motor::new(smooth(), 1);
        let duty = |k: i32| f64::from(k) / 1e4;
        let mut moves_at = |k: i32| {
            run(&mut m, duty(k), true, 300, |_| false);
            m.wheel.velocity > 1.0
        };
        let breakaway = (300..2000).find(|k| moves_at(*k)).unwrap();
        let stalls = (0..breakaway).rev().find(|k| !moves_at(*k)).unwrap();
        within("breakaway", duty(breakaway), 0.087, 0.0945);
        within("stalls", duty(stalls), 0.075, 0.081);
        // From the middle of the gap the motor alone sets off: 0.6 * 6 / 64.8 = 0.0556.
        assert_eq!(running(smooth(), 0.055).counts(), 0.0);
        within("the motor alone", running(smooth(), 0.0565).motor.angle, 0.5, 0.6);
        within("above", running(smooth(), 0.097).velocity() / FULL, 0.03, 0.04);
    }

    #[test]
    fn a_reversed_motor_crosses_its_backlash_before_the_wheel_starts() {
        for backlash in [0.3, 1.0] {
            let parameters = Parameters { backlash, encoder_on_wheel: true, ..smooth() };
            let mut m = Motor::new(parameters, 1);
            m.hold(true); // pressed on one flank
            run(&mut m, 0.3, true, 300, |_| false);
            run(&mut m, 0.0, true, 300, |_| false);
            m.hold(false);
            let (motor, from) = (m.motor.angle, m.encoder());
            let motor_starts = run(&mut m, -0.3, true, 300, |m| m.motor.velocity < 0.0);
            let wheel_starts = run(&mut m, -0.3, true, 300, |m| m.velocity() < 0.0);
            assert!(motor_starts <= 2 && (5..60).contains(&wheel_starts), "{wheel_starts} ms");
            within("travel", (motor - m.motor.angle) / backlash, 1.0, 1.15);
            run(&mut m, -0.3, true, 300, |_| false);
            assert!(from.wrapping_sub(m.encoder()) > 100); // the encoder is the wheel's
        }
    }

    #[test]
    fn a_disabled_bridge_coasts_and_a_duty_of_0_brakes() {
        // J/b ln(1 + b w / Tc), and with the shorted motor's slope for b.
        for (on, low, high) in [(false, 980, 1080), (true, 225, 265)] {
            let mut m = running(smooth(), 1.0);
            let stop = run(&mut m, 0.0, on, 3000, |m| m.wheel.velocity == 0.0);
            assert!((low..=high).contains(&stop), "enabled {on}: {stop} ms");
        }
    }

    #[test]
    fn nothing_moves_by_a_bit_in_100_s_of_noise_below_breakaway() {
        for (duty, on, load) in [(0.0, false, 1.5e-3), (0.04, true, 0.0), (-0.04, true, 1.5e-3)] {
            let noisy =
                Parameters { load_torque: load, torque_noise: 3e-4, ..Parameters::wheel(FULL) };
            let mut m = running(noisy, duty);
            let at = (m.motor, m.wheel);
            run(&mut m, duty, on, 100_000, |_| false);
            assert_eq!((m.motor, m.wheel), at, "duty {duty}, load {load}");
        }
        // A weight that is heavier than all friction turns it backwards.
        let mut heavy = running(smooth(), 0.0);
        heavy.parameters().load_torque = 8e-3;
        run(&mut heavy, 0.0, true, 1000, |_| false);
        within("sinks", heavy.velocity() / FULL, -0.1, -0.01);
    }

    #[test]
    fn without_friction_it_settles_in_a_detent() {
        for seed in 0..10 {
            let parameters = Parameters {
                coulomb: 0.0,
                breakaway: 0.0,
                viscous: 1e-4,
                wheel_friction: 0.0,
                ..Parameters::wheel(FULL)
            };
            let mut m = Motor::new(parameters, seed);
            run(&mut m, 0.0, false, 3000, |_| false);
            let detents = (6.0 * m.motor.angle + m.phase) / TAU;
            within("from a detent", detents - detents.round(), -1e-3, 1e-3);
        }
    }

    #[test]
    fn energy_goes_where_it_should_and_comes_from_nowhere() {
        let mut m = Motor::new(Parameters::wheel(FULL), 1);
        let (mut supplied, mut lost) = (0.0, 0.0);
        for k in 0..20_000 {
            let duty = if k < 12_000 { 0.8 } else { -0.5 };
            m.step(duty, true, SUBSTEP);
            let p = m.parameters;
            let friction =
                (1.0 - p.wheel_friction) * p.friction(m.motor.velocity) * m.motor.velocity.abs()
                    + p.wheel_friction * p.friction(m.wheel.velocity) * m.wheel.velocity.abs();
            supplied += duty * p.supply * m.current * SUBSTEP;
            lost += (p.resistance * m.current.powi(2) + friction) * SUBSTEP;
        }
        within("accounted for", (lost + energy(&m)) / supplied, 0.98, 1.0);
        let mut m = running(smooth(), 1.0);
        let mut before = energy(&m);
        for _ in 0..2000 {
            m.step(1.0, false, MS);
            let now = energy(&m);
            assert!(now <= before * 1.0001, "{before} J and then {now} J");
            before = now;
        }
        assert_eq!(m.wheel.velocity, 0.0);
    }

    #[test]
    fn the_same_seed_makes_the_same_bits_and_another_does_not() {
        let noisy = Parameters { torque_noise: 1e-3, adc_noise: 5.0, ..Parameters::wheel(FULL) };
        let [a, b, c] = [7, 7, 8].map(|seed| {
            let mut m = Motor::new(noisy, seed);
            run(&mut m, 0.4, true, 5000, |_| false);
            [m.counts(), m.velocity(), m.current(), f64::from(m.current_adc())].map(f64::to_bits)
        });
        assert_eq!(a, b);
        assert_ne!(a, c);
        let mut m = Motor::new(noisy, 9);
        let drawn: Vec<f64> = (0..10_000).map(|_| m.noise(2.0)).collect();
        within("mean", drawn.iter().sum::<f64>() / 1e4, -0.1, 0.1);
        within("mean square", drawn.iter().map(|x| x * x).sum::<f64>() / 1e4, 3.9, 4.1);
    }

    #[test]
    fn the_textbook_pid_has_the_gains_of_the_wire() {
        // Kp 50 at 655.36 counts; Kp 1 doubles in 128 ms; Kd against a ramp; Ki in a second.
        let close = |value: f64, to: f64| within("drive", value / to, 0.999, 1.001);
        let after = |mut pid: TextbookPid, ms: u32, set: f64, slope: f64, fed: f64| {
            (0..=ms).map(|k| pid.step(set, slope * f64::from(k), fed)).last().unwrap()
        };
        close(after(TextbookPid::position(50, 0, 0, FULL), 0, 327.68, 0.0, 0.0), 0.5);
        close(
            after(TextbookPid::position(0, 5, 0, FULL), 500, 0.0, 2.0, 0.0),
            -2000.0 * 5.0 / 65536.0,
        );
        close(after(TextbookPid::position(0, 0, 100, FULL), 1000, 100.0, 0.0, 0.0), 100.0 / 1024.0);
        close(after(TextbookPid::position(0, 0, 0, FULL), 0, 0.0, 0.0, FULL / 4.0), 0.25);
        let filtered = after(TextbookPid::position(0, 5, 0, FULL), 8, 0.0, 2.0, 0.0);
        within("after 8 ms of 8", filtered / (-2000.0 * 5.0 / 65536.0), 0.58, 0.66);
        let velocity = |kp, kd, ki| TextbookPid::velocity(kp, kd, ki, FULL);
        close(after(velocity(50, 0, 0), 0, 1000.0, 0.0, 0.0), 50_000.0 / 524_288.0);
        close(after(velocity(50, 0, 0), 128, 1000.0, 0.0, 0.0), 100_000.0 / 524_288.0);
        close(after(velocity(0, 5, 0), 500, 0.0, 100.0, 0.0), -500.0 / 262_144.0);
        close(after(velocity(0, 0, 100), 1000, 100.0, 0.0, 0.0), 100.0 / 4096.0);
    }

    #[test]
    fn the_textbook_pid_holds_a_speed_and_leaves_a_limit_at_once() {
        let mut m = Motor::new(Parameters::wheel(FULL), 1);
        let mut pid = TextbookPid::velocity(50, 0, 0, FULL);
        pid.limits = (-1.0, 0.3);
        let mut loop_for = |ms: u32, set: f64| {
            (0..ms).map(|_| m.step(pid.step(set, m.velocity(), set), true, MS)).last();
            m.velocity() / FULL
        };
        within("limited", loop_for(5000, 0.9 * FULL), 0.2, 0.27);
        // Wound up, it would go on at the limit for long.
        within("after the limit", loop_for(400, 0.1 * FULL), 0.08, 0.12);
        within("settled", loop_for(2000, 0.1 * FULL), 0.097, 0.103);
    }
}
