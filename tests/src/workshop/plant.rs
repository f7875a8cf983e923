//! The plants: 200 drives that never change, and what is wrong with some.
//!
//! [`Plant::number`] draws one, log-even unless it says otherwise:
//!
//! | what | from | to |
//! |---|---|---|
//! | speed at full duty | 480 counts/s | 60,000 counts/s |
//! | counts a turn of the encoder | 12 | 4096, and so that its shaft makes 0.5 to 200 turns a second |
//! | the motor's speed behind its gear | 40 turns/s | 200 turns/s, and not below the encoder's |
//! | current of the held shaft at 12 V | 1.2 A | 4 A |
//! | time constant of the bare rotor | 15 ms | 50 ms |
//! | inertia, in parts of the rotor's | 1 | 30 |
//! | dry friction, in parts of the stall torque | 0.5 % | 15 % |
//! | viscous friction, in parts of what the back-EMF makes | 1 % | 30 % |
//! | breakaway, in parts of dry friction (evenly) | 1 | 1.5 |
//! | duty that the driver loses (evenly) | 0 | 2 % |
//! | how late the driver is (evenly) | 0 | 2 ms |
//! | time constant of the current | 0.1 ms | 0.8 ms |
//!
//! So the mechanical time constant is 11 ms to 1.5 s, the dead band up to 17 %, breakaway up to 24.5 %.
//! Inertia is drawn as a multiple of the rotor's: drawn apart, a small strong motor with a large rotor would
//! have a time constant that no maker sells. None of what is drawn is thrown away or drawn again.
//!
//! **What is defined.** K is, for every plant: above Stribeck's speeds (up to 2 % of full speed) steady speed
//! is a straight line of the duty. Tau is, unless it cannot be known to 5 % by anybody who sees whole counts
//! at 1 kHz: where it is less than 10 control periods, or where the way by which the shaft lags behind a jump
//! to full duty, K tau, is less than 10 counts (5 % of it is then less than half a count). That excepts few.

use std::f64::consts::TAU;

use super::encoder::{self, Encoder};
use super::motor::{Drive, LOOK_S, Motor, Parameters};
use super::random::Random;

/// How many there are.
pub const PLANTS: u64 = 200;

/// A drive as it was drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plant {
    /// 0 to 199, or more.
    pub number: u64,
    /// The motor, with gear and load.
    pub motor: Parameters,
    /// The encoder.
    pub encoder: encoder::Parameters,
    /// Counts of the encoder for each rad of the motor.
    pub counts_per_rad: f64,
    /// A/D counts that the current reads too much, and their noise, root mean square.
    pub current_sensor: (f64, f64),
}

/// What is true of a plant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Truth {
    /// K in counts/s: steady speed over duty beyond the dead band, per full duty.
    pub gain: f64,
    /// Parts of full duty.
    pub dead_band: f64,
    /// Parts of full duty.
    pub breakaway: f64,
    /// counts/s at full duty.
    pub full_speed: f64,
    /// The mechanical time constant while driven, in seconds.
    pub tau: f64,
    /// In seconds: how late the driver is, and the time constant of the current.
    pub dead_time: f64,
}

impl Truth {
    /// Whether tau can be known to 5 %: see the [module](self).
    pub fn is_tau_defined(&self) -> bool {
        self.tau >= 0.010 && self.gain * self.tau >= 10.0
    }
}

impl Plant {
    /// The plant of this number: always the same.
    pub fn number(number: u64) -> Self {
        let mut random = Random::new(number);
        let full_speed = random.log_even(480.0, 60_000.0);
        let fewest = (full_speed / 200.0).max(12.0);
        let most = (full_speed / 0.5).min(4096.0);
        let lines = (random.log_even(fewest, most) / 4.0).round().max((fewest / 4.0).ceil());
        let counts_per_turn = 4.0 * lines;
        let motor_turns = random.log_even((full_speed / counts_per_turn).max(40.0), 200.0);

        let supply = 12.0;
        let resistance = supply / random.log_even(1.2, 4.0);
        let dry = random.log_even(0.005, 0.15);
        let viscous = random.log_even(0.01, 0.3);
        let lost_duty = random.even(0.0, 0.02);
        let full = TAU * motor_turns;
        // So that full duty, less what is lost, makes full speed.
        let torque_constant = supply * (1.0 - lost_duty - dry) / (full * (1.0 + viscous));
        let back_emf = torque_constant.powi(2) / resistance;
        let stall_torque = torque_constant * supply / resistance;
        let rotor = random.log_even(0.015, 0.050) * back_emf;
        let coulomb = dry * stall_torque;
        let cogging = random.even(0.0, 0.5) * coulomb;
        let motor = Parameters {
            supply,
            resistance,
            inductance: resistance * random.log_even(1e-4, 8e-4),
            torque_constant,
            inertia: rotor * random.log_even(1.0, 30.0),
            coulomb,
            breakaway: coulomb * random.even(1.0, 1.5),
            stribeck: full * random.log_even(0.002, 0.007),
            viscous: viscous * back_emf,
            wander: random.log_even(0.02, 0.1),
            ripple: (random.even(0.005, 0.03), random.one_of(&[6.0, 10.0, 14.0, 18.0])),
            cogging: (
                cogging.min(random.even(0.0, 0.02) * stall_torque),
                random.one_of(&[6.0, 10.0, 14.0]),
            ),
            lost_duty,
            delay_looks: random.even(0.0, 2e-3 / LOOK_S) as usize,
        };
        let encoder = encoder::Parameters {
            counts_per_turn: counts_per_turn as u32,
            phase: std::array::from_fn(|_| random.even(-0.15, 0.15)),
            pitch: random.even(0.0, 0.08),
            eccentricity: counts_per_turn * random.even(0.02, 0.15) / 360.0,
            jitter: random.even(0.0, 0.04),
            seed: number,
        };
        Self {
            number,
            motor,
            encoder,
            counts_per_rad: full_speed / full,
            current_sensor: (random.even(-6.0, 6.0), random.even(1.0, 6.0)),
        }
    }

    /// What is true of it.
    pub fn truth(&self) -> Truth {
        let (tau, of_current) = self.motor.time_constants();
        let gain = self.motor.gain() * self.counts_per_rad;
        Truth {
            gain,
            dead_band: self.motor.dead_band(),
            breakaway: self.motor.breakaway_duty(),
            full_speed: gain * (1.0 - self.motor.dead_band()),
            tau,
            dead_time: of_current + self.motor.delay_looks as f64 * LOOK_S,
        }
    }

    /// It, on the workbench.
    pub fn build(&self, wrong: Option<Wrong>) -> Machine {
        let mut motor = Motor::new(self.motor, self.number);
        if let Some(Wrong::BlockedShaft { play_degrees }) = wrong {
            let counts = play_degrees / 360.0 * f64::from(self.encoder.counts_per_turn);
            motor.block(counts / self.counts_per_rad / 2.0);
        }
        Machine {
            motor,
            encoder: Encoder::new(self.encoder),
            plant: *self,
            wrong,
            random: Random::new(self.number ^ 0xAD),
        }
    }
}

/// What may be wrong with a machine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Wrong {
    /// Positive duty lowers the counts.
    SwappedWires,
    /// The encoder tells nothing.
    DeadSensor,
    /// The shaft turns no further than the play of what blocks it, in degrees of the encoder.
    BlockedShaft {
        /// From stop to stop.
        play_degrees: f64,
    },
}

/// A plant that is built.
#[derive(Clone, Debug)]
pub struct Machine {
    plant: Plant,
    motor: Motor,
    encoder: Encoder,
    wrong: Option<Wrong>,
    random: Random,
}

impl Machine {
    /// A control period.
    pub fn step(&mut self, drive: Drive) {
        let duty = match self.wrong {
            Some(Wrong::SwappedWires) => -drive.duty,
            _ => drive.duty,
        };
        self.motor.step(Drive { duty, ..drive });
    }

    /// The true position, in counts since the beginning, with their parts.
    pub fn position(&self) -> f64 {
        self.motor.angle() * self.plant.counts_per_rad
    }

    /// The true speed in counts/s.
    pub fn speed(&self) -> f64 {
        self.motor.velocity() * self.plant.counts_per_rad
    }

    /// The true current in A.
    pub fn current(&self) -> f64 {
        self.motor.current()
    }

    /// What the board's counter reads.
    pub fn counter(&mut self) -> u16 {
        match self.wrong {
            Some(Wrong::DeadSensor) => 0,
            _ => self.encoder.read(self.position()) as u16,
        }
    }

    /// What the board's converter reads: 728 counts an ampere either way, 12 bits.
    pub fn current_adc(&mut self) -> u16 {
        let (offset, noise) = self.plant.current_sensor;
        let read = 728.0 * self.motor.current().abs() + offset + noise * self.random.normal();
        read.round().clamp(0.0, 4095.0) as u16
    }

    /// Somebody takes hold of the shaft: it stands.
    pub fn stop_by_hand(&mut self) {
        self.motor.stop_by_hand();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all() -> impl Iterator<Item = Plant> {
        (0..PLANTS).map(Plant::number)
    }

    fn spread(of: impl Fn(&Plant) -> f64) -> (f64, f64) {
        all().fold((f64::MAX, f64::MIN), |(low, high), plant| {
            (low.min(of(&plant)), high.max(of(&plant)))
        })
    }

    #[test]
    fn they_are_as_far_apart_as_was_asked() {
        let (slowest, fastest) = spread(|p| p.truth().full_speed);
        assert!((480.0..520.0).contains(&slowest) && (55_000.0..60_001.0).contains(&fastest));
        let (coarsest, finest) = spread(|p| p.encoder.counts_per_turn.into());
        assert!((12.0..16.0).contains(&coarsest) && (3700.0..=4096.0).contains(&finest));
        let stall = |p: &Plant| p.motor.stall_torque();
        let (least, most) = spread(|p| p.motor.coulomb / stall(p));
        assert!((25.0..30.0).contains(&(most / least)), "dry friction");
        let (short, long) = spread(|p| p.truth().tau);
        assert!((0.0115..0.02).contains(&short) && (0.9..1.5).contains(&long), "{short} {long}");
        let (_, hardest) = spread(|p| p.truth().breakaway);
        assert!((0.18..0.25).contains(&hardest), "{hardest}");
        let (_, turns) = spread(|p| p.truth().full_speed / f64::from(p.encoder.counts_per_turn));
        assert!((150.0..200.1).contains(&turns), "{turns} turns a second");
        let undefined = all().filter(|p| !p.truth().is_tau_defined()).count();
        assert!(undefined <= 6, "{undefined} have no tau");
    }

    #[test]
    fn a_number_is_always_the_same_plant_and_no_other() {
        assert_eq!(Plant::number(17), Plant::number(17));
        assert_ne!(Plant::number(17), Plant { number: 17, ..Plant::number(18) });
        // These may not change without the change being meant: results are told by number.
        let told = Plant::number(0).truth();
        assert_eq!((told.gain.round(), (told.tau * 1e5).round()), (9164.0, 34_729.0));
    }

    /// Without noise it would be exact; this is what noise and ripple leave of it.
    #[test]
    fn a_plant_has_the_gain_and_the_time_constant_that_it_tells() {
        for plant in all().step_by(8) {
            let truth = plant.truth();
            let mut machine = plant.build(None);
            let settle = (truth.tau * 8000.0) as u32 + 200;
            // Mean speed at a steady duty, and by how far it lagged behind until then.
            let mut jump_to = |duty: f64| {
                let drive = Drive { duty, enabled: true };
                let before = machine.position();
                (0..settle).for_each(|_| machine.step(drive));
                let from = machine.position();
                (0..2000).for_each(|_| machine.step(drive));
                let speed = (machine.position() - from) / 2.0;
                (speed, speed * f64::from(settle) / 1000.0 - (from - before))
            };
            jump_to(0.9);
            let jumps = 16.0;
            let (mut gain, mut lag) = (0.0, 0.0);
            for _ in 0..16 {
                let ((slow, down), (fast, up)) = (jump_to(0.5), jump_to(0.9));
                gain += (fast - slow) / 0.4 / truth.gain / jumps;
                lag += (up - down) / 2.0 / (fast - slow) / jumps;
            }
            assert!((0.99..1.01).contains(&gain), "plant {}: {gain} of its K", plant.number);
            let off = (lag - truth.dead_time - truth.tau) / truth.tau;
            assert!(off.abs() < 0.03, "plant {}: tau is off by {off}", plant.number);
        }
    }

    #[test]
    fn what_is_wrong_is_wrong() {
        let plant = Plant::number(1);
        let forward = Drive { duty: 0.6, enabled: true };
        let run = |wrong| {
            let mut machine = plant.build(wrong);
            (0..500).for_each(|_| machine.step(forward));
            (machine.position(), f64::from(machine.counter() as i16), machine.current_adc())
        };
        let (right, told, _) = run(None);
        assert!(right > 20.0 && (told - right).abs() < 4.0, "{told}, not {right}");
        let (swapped, told, _) = run(Some(Wrong::SwappedWires));
        assert!(swapped < -0.9 * right && (told - swapped).abs() < 4.0);
        assert!(matches!(run(Some(Wrong::DeadSensor)), (at, 0.0, _) if at > 20.0));
        let (blocked, _, current) = run(Some(Wrong::BlockedShaft { play_degrees: 1.0 }));
        let play = f64::from(plant.encoder.counts_per_turn) / 360.0;
        assert!((blocked - play / 2.0).abs() < 1e-6, "{blocked}");
        let stall = 728.0 * 12.0 / plant.motor.resistance * (0.6 - plant.motor.lost_duty);
        assert!((f64::from(current) - stall).abs() < 30.0, "{current}, not {stall}");
    }
}
