//! What the world is made of. The default scene: wheels with encoders on channels 0 and 1, joints
//! with potentiometers on 2 to 5, six servos, nothing in the way.

use core::array;

/// The sensor on a motor's shaft.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "json", derive(serde::Deserialize))]
#[cfg_attr(feature = "json", serde(rename_all = "kebab-case"))]
pub enum ShaftSensor {
    /// A quadrature encoder (channels 0 and 1).
    Encoder,
    /// One potentiometer; the shaft ends with its track.
    Potentiometer,
    /// Two potentiometers half a turn apart (channels 0 to 2); the shaft turns freely.
    DualPotentiometer,
    /// None.
    None,
}

/// A motor. Speeds are in counts of its sensor per second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotorScene {
    /// What is on its shaft.
    pub sensor: ShaftSensor,
    /// Wired the other way round: forward drive lowers the counts.
    pub reversed: bool,
    /// Speed at full drive and nominal supply, without friction; above 0.
    pub full_speed: f32,
    /// Mechanical time constant in seconds; above 0.
    pub time_constant_s: f32,
    /// Dry friction in parts of the stall torque, 0 to 1.
    pub friction: f32,
    /// A load that pulls the counts down for ever, such as gravity, in parts of the stall torque, -1 to
    /// 1.
    pub load: f32,
    /// Current at full drive with the shaft held, in amperes.
    pub stall_current_a: f32,
    /// Position at boot in counts.
    pub start: i64,
}

impl MotorScene {
    /// What a motor with this sensor is like unless the scene says otherwise.
    pub fn with(sensor: ShaftSensor) -> Self {
        let wheel = Self {
            sensor,
            reversed: false,
            full_speed: 16_384.0,
            time_constant_s: 0.06,
            friction: 0.02,
            load: 0.0,
            stall_current_a: 3.0,
            start: 0,
        };
        match sensor {
            ShaftSensor::Encoder | ShaftSensor::None => wheel,
            ShaftSensor::Potentiometer | ShaftSensor::DualPotentiometer => Self {
                full_speed: 4096.0,
                time_constant_s: 0.05,
                friction: 0.03,
                stall_current_a: 1.5,
                start: 2048,
                ..wheel
            },
        }
    }
}

/// The batteries, in volts.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "json", derive(serde::Deserialize))]
#[cfg_attr(feature = "json", serde(default, deny_unknown_fields))]
pub struct BatteryScene {
    /// Main board.
    pub main_v: f32,
    /// DC motors, without load.
    pub motor_v: f32,
    /// Servos.
    pub servo_v: f32,
    /// What the motors' full speed is given for; above 0.
    pub motor_nominal_v: f32,
    /// Internal resistance of the motor battery.
    pub motor_resistance_ohm: f32,
}

impl Default for BatteryScene {
    fn default() -> Self {
        Self {
            main_v: 7.4,
            motor_v: 12.0,
            servo_v: 6.0,
            motor_nominal_v: 12.0,
            motor_resistance_ohm: 0.15,
        }
    }
}

/// What the sensors see.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "json", derive(serde::Deserialize))]
#[cfg_attr(feature = "json", serde(default, deny_unknown_fields))]
pub struct Environment {
    /// Ultrasonic ranges in cm, 255 for nothing in range.
    pub sonar_cm: [u8; 6],
    /// Infrared range, 10 to 80 cm.
    pub ir_range_cm: f32,
    /// Ambient temperature.
    pub ambient_c: f32,
    /// Temperatures of the motor drivers.
    pub driver_c: [f32; 2],
    /// Accelerations along the axes of the tilt sensor.
    pub tilt_g: [f32; 2],
    /// Voltages on the custom A/D inputs, 0 to 3.
    pub custom_v: [f32; 8],
    /// Input port.
    pub gpio_in: u8,
    /// A wall in front of the vehicle: how far it is at the start, 0 to 10,000 cm. None by default.
    pub wall_cm: Option<f32>,
    /// How far a count of wheels 0 and 1 carries the vehicle forward, -1 to 1 cm; negative where it
    /// goes forward with falling counts. By default 0.004: 65 cm/s at full speed.
    pub cm_per_count: [f32; 2],
}

impl Default for Environment {
    fn default() -> Self {
        Self {
            sonar_cm: [255; 6],
            ir_range_cm: 80.0,
            ambient_c: 22.0,
            driver_c: [25.0; 2],
            tilt_g: [0.0; 2],
            custom_v: [0.0; 8],
            gpio_in: 0,
            wall_cm: None,
            cm_per_count: [0.004; 2],
        }
    }
}

/// What is broken from the start.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "json", derive(serde::Deserialize))]
#[cfg_attr(feature = "json", serde(default, deny_unknown_fields))]
pub struct FaultScene {
    /// Blocked shafts.
    pub jam: [bool; 6],
    /// Motors whose position sensor is pulled.
    pub unplugged: [bool; 6],
    /// Whether the host's link is whole; for whoever has the line, the plant has none.
    pub link: bool,
}

impl Default for FaultScene {
    fn default() -> Self {
        Self { jam: [false; 6], unplugged: [false; 6], link: true }
    }
}

/// A world to simulate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scene {
    /// Motors of channels 0 to 5.
    pub motors: [MotorScene; 6],
    /// Batteries.
    pub battery: BatteryScene,
    /// Surroundings.
    pub environment: Environment,
    /// What is broken.
    pub faults: FaultScene,
    /// Peak noise of the A/D converters in counts.
    pub noise_lsb: f32,
    /// The seed of that noise, for whoever makes the plant and has no other.
    pub seed: Option<u64>,
}

impl Default for Scene {
    fn default() -> Self {
        Self {
            motors: array::from_fn(|i| {
                MotorScene::with(match i {
                    0 | 1 => ShaftSensor::Encoder,
                    _ => ShaftSensor::Potentiometer,
                })
            }),
            battery: BatteryScene::default(),
            environment: Environment::default(),
            faults: FaultScene::default(),
            noise_lsb: 1.5,
            seed: None,
        }
    }
}
