//! A DC motor with gear, shaft and sensor.
//!
//! Per unit of full drive, with the motor's own numbers (`full_speed`, `time_constant_s`, ...):
//!
//! ```text
//!   dv/dt   = (drive * full_speed - v) / time_constant - load - friction   (bridge enabled)
//!   current = stall_current * (drive - v / full_speed)                     (back-EMF included)
//! ```
//!
//! which is a brushed motor with inertia, back-EMF, a constant load and dry friction, its inductance
//! neglected (it is over in a fraction of a millisecond). A disabled bridge carries no current: the
//! shaft coasts against friction. An enabled one with no drive shorts the motor, which brakes it.

use firmware::ports::MotorOutput;
use firmware::units::Duty;

use super::STEP_S;
use super::scene::{MotorScene, ShaftSensor};

/// One turn of a shaft with potentiometers, and half of it, in A/D counts.
const TURN: i64 = 4428;
pub const HALF_TURN: f32 = 2214.0;
/// The end of a potentiometer's track.
const TRACK: f32 = 4095.0;
/// How much longer a coasting shaft takes to slow down than a shorted one, without friction.
const COASTING: f32 = 8.0;

/// What holds a shaft fast.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hold {
    /// It is free.
    Nothing,
    /// Its counts may neither rise nor fall.
    BothWays,
    /// Its counts may not rise.
    Rising,
    /// Its counts may not fall.
    Falling,
}

/// A motor. Positions and velocities are in counts of its sensor.
#[derive(Clone, Copy, Debug)]
pub struct Motor {
    scene: MotorScene,
    /// Whole counts, unwrapped, and the fraction above them (0 to 1).
    whole: i64,
    fraction: f32,
    /// Counts that its encoder has not seen.
    missed: i64,
    velocity: f32,
    current_a: f32,
}

impl Motor {
    /// At rest where the scene has it.
    pub fn new(scene: MotorScene) -> Self {
        Self { scene, whole: scene.start, fraction: 0.0, missed: 0, velocity: 0.0, current_a: 0.0 }
    }

    /// What it was made from.
    pub fn scene(&self) -> &MotorScene {
        &self.scene
    }

    /// Unwrapped position in counts.
    pub fn position(&self) -> i64 {
        self.whole
    }

    /// Velocity in counts per second.
    pub fn velocity(&self) -> f32 {
        self.velocity
    }

    /// Magnitude of the current in amperes.
    pub fn current_a(&self) -> f32 {
        self.current_a.abs()
    }

    /// One step under `output`; `supply` is the supply voltage in parts of the nominal one, `hold`
    /// what holds the shaft.
    pub fn step(&mut self, output: MotorOutput, supply: f32, hold: Hold) {
        let scene = &self.scene;
        let wiring = if scene.reversed { -1.0 } else { 1.0 };
        let drive = f32::from(output.duty.raw()) / f32::from(Duty::FULL) * supply * wiring;
        let (drag, push) = if output.enabled {
            (STEP_S / scene.time_constant_s, drive)
        } else {
            (STEP_S / (scene.time_constant_s * COASTING), 0.0)
        };
        // Implicit in the drag, so that no time constant is too short.
        let of_stall_torque = scene.full_speed * STEP_S / scene.time_constant_s;
        let (load, friction) = (scene.load * of_stall_torque, scene.friction * of_stall_torque);
        let free = (self.velocity + push * scene.full_speed * drag - load) / (1.0 + drag);
        let is_held = match hold {
            Hold::Nothing => false,
            Hold::BothWays => true,
            Hold::Rising => free > 0.0,
            Hold::Falling => free < 0.0,
        };
        self.velocity =
            if is_held || free.abs() <= friction { 0.0 } else { free - friction * free.signum() };
        self.current_a = if output.enabled {
            scene.stall_current_a * (drive - self.velocity / scene.full_speed)
        } else {
            0.0
        };
        self.travel(self.velocity * STEP_S);
    }

    fn travel(&mut self, way: f32) {
        self.fraction += way;
        let whole = self.fraction as i64 - i64::from(self.fraction < 0.0);
        self.whole += whole;
        self.fraction -= whole as f32;
        // A joint on one potentiometer ends where its track does.
        if self.scene.sensor == ShaftSensor::Potentiometer
            && !(0..=TRACK as i64).contains(&self.whole)
        {
            self.whole = self.whole.clamp(0, TRACK as i64);
            self.fraction = 0.0;
            self.velocity = 0.0;
        }
    }

    /// Has the encoder not see the last `counts`: it was unplugged. Its counter goes on from where it
    /// stood.
    pub fn miss(&mut self, counts: i64) {
        self.missed += counts;
    }

    /// The quadrature counter: 16 bits, wrapping. 0 without an encoder.
    pub fn encoder(&self) -> u16 {
        match self.scene.sensor {
            ShaftSensor::Encoder => (self.whole - self.missed) as u16,
            _ => 0,
        }
    }

    /// What a potentiometer reads that is mounted `offset` counts behind; in its dead zone it is
    /// pulled to the nearer end of its track.
    pub fn potentiometer(&self, offset: f32) -> f32 {
        let turned = self.whole - offset as i64;
        let angle = turned.rem_euclid(TURN) as f32 + self.fraction;
        let middle_of_dead_zone = (TRACK + TURN as f32) / 2.0;
        if angle <= TRACK {
            angle
        } else if angle < middle_of_dead_zone {
            TRACK
        } else {
            0.0
        }
    }
}
