//! The simulated world on the other side of the ports.
//!
//! A [`Plant`] is built from a [`Scene`], moves in steps of 1 ms, and reads like the board's
//! converters and counters. [`Overrides`] replace what sensors read, and break or change what is
//! around the board, without touching what is simulated behind them.
//!
//! Arithmetic is `f32` with nothing but the four operations, so that a computer and a Cortex-M4
//! agree to the bit. Noise comes from one seeded generator.

mod ax12;
mod convert;
mod motor;
mod scene;
mod servo;
mod wall;

use core::array;

use firmware::control::potentiometer;
use firmware::ports::{MotionInputs, Outputs, Sensors};

pub use ax12::{Ax12, Surroundings};
pub use motor::{Hold, Motor};
pub use scene::{BatteryScene, Environment, FaultScene, MotorScene, Scene, ShaftSensor};
pub use servo::Servo;
pub use wall::FARTHEST_CM;
use wall::{BUMPER_CM, Wall};

/// Length of a step in seconds.
pub const STEP_S: f32 = 0.001;

/// What a user has put in place of the simulation. `None` is the simulation's own.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "json", derive(serde::Serialize))]
pub struct Overrides {
    /// Potentiometers, A/D counts.
    #[cfg_attr(feature = "json", serde(rename = "pot"))]
    pub potentiometers: [Option<u16>; 6],
    /// Encoders' counters.
    #[cfg_attr(feature = "json", serde(rename = "encoder"))]
    pub encoders: [Option<u16>; 2],
    /// Motor currents, A/D counts.
    #[cfg_attr(feature = "json", serde(rename = "motor_current"))]
    pub currents: [Option<u16>; 6],
    /// Custom A/D channels, A/D counts.
    pub custom_ad: [Option<u16>; 8],
    /// Human sensors, A/D counts.
    pub human: [Option<u16>; 4],
    /// Tilt sensors, A/D counts.
    pub tilt: [Option<u16>; 2],
    /// Driver temperatures, A/D counts.
    pub overheat: [Option<u16>; 2],
    /// Ambient temperature, A/D counts.
    pub temperature: Option<u16>,
    /// Infrared range, A/D counts.
    pub ir_range: Option<u16>,
    /// Batteries: board, motors, servos; A/D counts.
    pub battery: [Option<u16>; 3],
    /// Vcc and Vref, A/D counts.
    pub reference: [Option<u16>; 2],
    /// Ultrasonic ranges, cm.
    pub sonar_cm: [Option<u8>; 6],
    /// Infrared remote control.
    pub ir_command: [Option<u8>; 4],
    /// Input port.
    pub gpio_in: Option<u8>,
    /// Blocked shafts.
    pub jam: [Option<bool>; 6],
    /// Motors whose position sensor is pulled. An encoder's counter stands still, and goes on from
    /// there when it is plugged in again; a potentiometer's input is open, which reads as
    /// that of a motor without one: the middle of the range.
    pub unplugged: [Option<bool>; 6],
    /// The batteries themselves: board, motors without load, servos; volts, 0 or more.
    #[cfg_attr(feature = "json", serde(skip))]
    pub battery_v: [Option<f32>; 3],
    /// The display's bus hangs: nothing is shown any more.
    #[cfg_attr(feature = "json", serde(skip))]
    pub lcd_hangs: bool,
}

/// The world. See the [module](self).
pub struct Plant {
    scene: Scene,
    /// DC motors with their shafts.
    pub motors: [Motor; 6],
    /// Servos.
    pub servos: [Servo; 6],
    /// What the board drives.
    pub outputs: Outputs,
    /// What a user has put in place of the simulation.
    pub overrides: Overrides,
    /// The LCD's sixteen frames of 64 columns, as the protocol numbers them.
    pub lcd: [[u8; 64]; 16],
    /// Motor supply in volts, sagging under load.
    supply_v: f32,
    /// A wall that a user has placed.
    wall: Option<Wall>,
    noise: fastrand::Rng,
    /// The noise's first seed, and one that a user has put in its place.
    seed: u64,
    reseeded: Option<u64>,
    /// Milliseconds simulated.
    now_ms: u64,
}

impl Plant {
    /// A world at rest, whose noise has this seed.
    pub fn new(scene: Scene, seed: u64) -> Self {
        Self {
            motors: array::from_fn(|i| Motor::new(scene.motors[i])),
            servos: [Servo::default(); 6],
            outputs: Outputs::default(),
            overrides: Overrides::default(),
            lcd: [[0; 64]; 16],
            supply_v: scene.battery.motor_v,
            wall: None,
            noise: fastrand::Rng::with_seed(seed),
            seed,
            reseeded: None,
            now_ms: 0,
            scene,
        }
    }

    /// Puts a wall so far ahead of where the vehicle is now, 0 to [`FARTHEST_CM`]; `None` takes it
    /// away, and the scene's is there again, where it was.
    pub fn place_wall(&mut self, cm: Option<f32>) {
        self.wall = cm.map(|cm| Wall { cm, wheels: self.wheels() });
    }

    /// How far ahead a wall was last placed.
    pub fn placed_wall_cm(&self) -> Option<f32> {
        self.wall.map(|wall| wall.cm)
    }

    /// How far the wall is now, in cm, if there is one.
    pub fn wall_cm(&self) -> Option<f32> {
        let Environment { wall_cm, cm_per_count, .. } = self.scene.environment;
        let [first, second, ..] = &self.scene.motors;
        let scenes = || wall_cm.map(|cm| Wall { cm, wheels: [first.start, second.start] });
        let wall = self.wall.or_else(scenes)?;
        Some(wall.distance_cm(self.wheels(), cm_per_count))
    }

    /// Has the noise go on from another seed, or with `None` begin anew from its first.
    pub fn reseed(&mut self, seed: Option<u64>) {
        self.reseeded = seed;
        self.noise.seed(seed.unwrap_or(self.seed));
    }

    /// The seed that was last put in place of the first.
    pub fn reseeded(&self) -> Option<u64> {
        self.reseeded
    }

    fn wheels(&self) -> [i64; 2] {
        array::from_fn(|i| self.motors[i].position())
    }

    fn battery(&self) -> BatteryScene {
        let own = self.scene.battery;
        let [main, motor, servo] = self.overrides.battery_v;
        BatteryScene {
            main_v: main.unwrap_or(own.main_v),
            motor_v: motor.unwrap_or(own.motor_v),
            servo_v: servo.unwrap_or(own.servo_v),
            ..own
        }
    }

    fn is_unplugged(&self, motor: usize) -> bool {
        self.overrides.unplugged[motor].unwrap_or(self.scene.faults.unplugged[motor])
    }

    /// What holds a motor's shaft.
    fn hold(&self, motor: usize, is_at_wall: bool) -> Hold {
        if self.overrides.jam[motor].unwrap_or(self.scene.faults.jam[motor]) {
            return Hold::BothWays;
        }
        match self.scene.environment.cm_per_count.get(motor) {
            Some(&cm) if is_at_wall && cm > 0.0 => Hold::Rising,
            Some(&cm) if is_at_wall && cm < 0.0 => Hold::Falling,
            _ => Hold::Nothing,
        }
    }

    /// Lets time pass until `ms` milliseconds after the beginning, under the outputs as they are.
    pub fn advance_to(&mut self, ms: u64) {
        while self.now_ms < ms {
            self.now_ms += 1;
            self.step();
        }
    }

    fn step(&mut self) {
        let battery = self.battery();
        let supply = self.supply_v / battery.motor_nominal_v;
        let is_at_wall = self.wall_cm().is_some_and(|cm| cm <= BUMPER_CM);
        let mut load_a = 0.0;
        for i in 0..self.motors.len() {
            let (hold, is_unplugged) = (self.hold(i, is_at_wall), self.is_unplugged(i));
            let motor = &mut self.motors[i];
            let from = motor.position();
            motor.step(self.outputs.motors[i], supply, hold);
            if is_unplugged {
                motor.miss(motor.position() - from);
            }
            load_a += motor.current_a();
        }
        // A battery charges no motor here: a braking motor's current stays in its bridge.
        self.supply_v = (battery.motor_v - load_a * battery.motor_resistance_ohm).max(0.0);
        for (servo, pulse) in self.servos.iter_mut().zip(self.outputs.servos) {
            servo.step(pulse);
        }
    }

    /// What the converters and counters of the motion hardware read.
    pub fn motion_inputs(&mut self) -> MotionInputs {
        let mut potentiometers = [convert::MID_SCALE; 6];
        let plant = &*self;
        let with = |sensor| {
            let motors = plant.motors.iter().enumerate();
            motors.filter(move |&(i, m)| m.scene().sensor == sensor && !plant.is_unplugged(i))
        };
        for (i, motor) in with(ShaftSensor::Potentiometer) {
            potentiometers[i] = motor.potentiometer(0.0);
        }
        // A pair takes the input of another motor's potentiometer.
        for (i, motor) in with(ShaftSensor::DualPotentiometer) {
            if let Some(&(first, second)) = potentiometer::PAIRS.get(i) {
                potentiometers[first] = motor.potentiometer(0.0);
                potentiometers[second] = motor.potentiometer(motor::HALF_TURN);
            }
        }
        MotionInputs {
            potentiometers: array::from_fn(|i| {
                let read = self.converter(potentiometers[i]);
                self.overrides.potentiometers[i].unwrap_or(read)
            }),
            currents: array::from_fn(|i| {
                let read = self.converter(convert::current(self.motors[i].current_a()));
                self.overrides.currents[i].unwrap_or(read)
            }),
            encoders: array::from_fn(|i| {
                self.overrides.encoders[i].unwrap_or(self.motors[i].encoder())
            }),
        }
    }

    /// What the other sensors read.
    pub fn sensors(&mut self) -> Sensors {
        let world = self.scene.environment;
        let wall_cm = self.wall_cm().unwrap_or(f32::INFINITY);
        let battery = self.battery();
        let set = self.overrides.clone();
        let battery_ad = [
            convert::volts(battery.main_v, 9.0),
            convert::volts(self.supply_v, 24.0),
            convert::volts(battery.servo_v, 9.0),
        ];
        let reference_ad = [convert::volts(5.0, 6.0), convert::volts(3.0, 6.0)];
        Sensors {
            custom_ad: array::from_fn(|i| {
                let read = self.converter(convert::volts(world.custom_v[i], 3.0));
                set.custom_ad[i].unwrap_or(read)
            }),
            gpio_in: set.gpio_in.unwrap_or(world.gpio_in),
            sonar_cm: array::from_fn(|i| {
                let ahead = if i < wall::SONARS_AHEAD { wall::sonar_cm(wall_cm) } else { u8::MAX };
                set.sonar_cm[i].unwrap_or(world.sonar_cm[i].min(ahead))
            }),
            human: array::from_fn(|i| {
                let read = self.converter(convert::MID_SCALE);
                set.human[i].unwrap_or(read)
            }),
            tilt: array::from_fn(|i| {
                let read = self.converter(convert::tilt(world.tilt_g[i]));
                set.tilt[i].unwrap_or(read)
            }),
            overheat: array::from_fn(|i| {
                let read = self.converter(convert::driver_temperature(world.driver_c[i]));
                set.overheat[i].unwrap_or(read)
            }),
            temperature: {
                let read = self.converter(convert::temperature(world.ambient_c));
                set.temperature.unwrap_or(read)
            },
            ir_range: {
                let read = self.converter(convert::ir_range(world.ir_range_cm.min(wall_cm)));
                set.ir_range.unwrap_or(read)
            },
            ir_command: array::from_fn(|i| set.ir_command[i].unwrap_or(0)),
            battery: array::from_fn(|i| {
                let read = self.converter(battery_ad[i]);
                set.battery[i].unwrap_or(read)
            }),
            reference: array::from_fn(|i| {
                let read = self.converter(reference_ad[i]);
                set.reference[i].unwrap_or(read)
            }),
        }
    }

    /// An A/D conversion: noise, rounding, the converter's range.
    fn converter(&mut self, ideal: f32) -> u16 {
        let noise = (self.noise.f32() + self.noise.f32() - 1.0) * self.scene.noise_lsb;
        convert::quantise(ideal + noise)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use firmware::ports::MotorOutput;
    use firmware::units::Duty;

    fn driven(raw: i32) -> Outputs {
        let mut outputs = Outputs::default();
        outputs.motors[0] = MotorOutput { duty: Duty::from_raw(raw), enabled: true };
        outputs
    }

    #[test]
    fn a_wheel_runs_up_with_its_time_constant_and_coasts_longer_than_it_brakes() {
        let mut plant = Plant::new(Scene::default(), 1);
        plant.outputs = driven(16384);
        plant.advance_to(60);
        let speed = plant.motors[0].velocity();
        // One time constant: 63 % of the speed, less friction and sag.
        assert!((9000.0..10_500.0).contains(&speed), "{speed}");
        plant.advance_to(1000);
        let top = plant.motors[0].velocity();
        assert!((15_000.0..16_384.0).contains(&top), "{top}");

        let slowed = |outputs| {
            let mut plant = Plant::new(Scene::default(), 1);
            plant.outputs = driven(16384);
            plant.advance_to(1000);
            plant.outputs = outputs;
            plant.advance_to(1100);
            plant.motors[0].velocity()
        };
        let (braked, coasted) = (slowed(driven(0)) / top, slowed(Outputs::default()) / top);
        assert!((0.05..0.25).contains(&braked), "{braked}");
        assert!((0.5..0.95).contains(&coasted), "{coasted}");
    }

    #[test]
    fn a_jammed_shaft_draws_stall_current_and_the_supply_sags() {
        let mut plant = Plant::new(Scene::default(), 1);
        plant.outputs = driven(16384);
        plant.overrides.jam[0] = Some(true);
        plant.advance_to(100);
        assert_eq!(plant.motors[0].position(), 0);
        let current = plant.motion_inputs().currents[0];
        assert!((2000..2200).contains(&current), "{current}: about 3 A of 728 a volt");
        let battery = plant.sensors().battery[1];
        assert!((1900..2040).contains(&battery), "{battery}: below 12 V");
    }

    #[test]
    fn the_same_seed_gives_the_same_noise_and_another_does_not() {
        let read = |seed| Plant::new(Scene::default(), seed).motion_inputs().potentiometers;
        assert_eq!(read(7), read(7));
        assert_ne!(read(7), read(8));
        // Also when it is put in later, and when it is taken away again.
        let mut plant = Plant::new(Scene::default(), 8);
        plant.reseed(Some(7));
        assert_eq!((plant.motion_inputs().potentiometers, plant.reseeded()), (read(7), Some(7)));
        plant.reseed(None);
        assert_eq!((plant.motion_inputs().potentiometers, plant.reseeded()), (read(8), None));
    }

    #[test]
    fn an_unplugged_encoder_stands_still_and_goes_on_from_there() {
        let mut plant = Plant::new(Scene::default(), 1);
        plant.outputs = driven(16384);
        plant.advance_to(100);
        let stood = plant.motion_inputs().encoders[0];
        plant.overrides.unplugged[0] = Some(true);
        plant.advance_to(300);
        assert_eq!(plant.motion_inputs().encoders[0], stood);
        let missed = plant.motors[0].position() - i64::from(stood);
        assert!(missed > 2000, "{missed}");
        plant.overrides.unplugged[0] = None;
        plant.advance_to(400);
        let counted = i64::from(plant.motion_inputs().encoders[0]);
        assert!(counted > i64::from(stood) + 1000);
        assert_eq!(counted, plant.motors[0].position() - missed);
    }

    #[test]
    fn the_inputs_of_unplugged_potentiometers_are_open() {
        let mut scene = Scene { noise_lsb: 0.0, ..Scene::default() };
        scene.motors[0] = MotorScene::with(ShaftSensor::DualPotentiometer);
        (scene.motors[0].start, scene.motors[3].start) = (500, 500);
        scene.faults.unplugged = [true, false, false, true, false, false];
        let mut plant = Plant::new(scene, 1);
        assert_eq!(plant.motion_inputs().potentiometers, [2048; 6]);
        plant.overrides.unplugged[3] = Some(false);
        assert_eq!(plant.motion_inputs().potentiometers[3], 500);
    }

    #[test]
    fn another_battery_is_measured_and_felt() {
        let mut plant = Plant::new(Scene { noise_lsb: 0.0, ..Scene::default() }, 1);
        plant.outputs = driven(16384);
        plant.advance_to(1000);
        let full = plant.motors[0].velocity();
        plant.overrides.battery_v = [Some(4.5), Some(6.0), Some(4.5)];
        plant.advance_to(2000);
        let half = plant.motors[0].velocity() / full;
        assert!((0.47..0.5).contains(&half), "{half}");
        let [main, motor, servo] = plant.sensors().battery;
        assert!((main, servo) == (2048, 2048) && (1000..1024).contains(&motor), "{motor}");
        plant.overrides.battery_v = [None; 3];
        plant.advance_to(3000);
        assert!((plant.motors[0].velocity() / full - 1.0).abs() < 0.01);
    }

    #[test]
    fn the_encoder_counter_wraps_at_16_bits_both_ways() {
        let mut plant = Plant::new(Scene::default(), 1);
        plant.outputs = driven(-16384);
        plant.advance_to(300);
        let position = plant.motors[0].position();
        assert!((-4500..-1000).contains(&position), "{position}");
        assert_eq!(plant.motion_inputs().encoders[0], position as u16);
    }
}
