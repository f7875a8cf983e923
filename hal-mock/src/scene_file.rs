//! Scenes from a TOML file. Whatever the file leaves out is as in the default scene.
//!
//! ```toml
//! noise_lsb = 1.5                 # A/D noise, peak
//! seed = 7                        # of that noise; the command line's comes first
//!
//! [motor.0]                       # motor.0 to motor.5
//! sensor = "dual-potentiometer"   # encoder, potentiometer, dual-potentiometer, none
//! reversed = true                 # wired the other way round
//! full_speed = 4096.0             # counts/s at full drive
//! time_constant_s = 0.05
//! friction = 0.03                 # of stall torque
//! load = 0.15                     # of stall torque, pulls the counts down
//! stall_current_a = 1.5
//! start = 2048                    # counts
//!
//! [battery]
//! motor_v = 11.1                  # main_v, servo_v, motor_nominal_v, motor_resistance_ohm
//!
//! [environment]
//! sonar_cm = [40, 255, 255, 255, 255, 255]
//! ir_range_cm = 80.0              # ambient_c, driver_c, tilt_g, custom_v, gpio_in
//! wall_cm = 120.0                 # a wall ahead, at the start; sonars 1 to 3 and infrared see it
//! cm_per_count = [0.004, 0.004]   # wheels 0 and 1; negative: falling counts go forward
//!
//! [faults]                        # from the start; the inspector's words
//! jam = [false, false, true, false, false, false]
//! unplugged = [true, false, false, false, false, false]
//! link = false
//! ```

use serde::Deserialize;

use crate::plant::{
    BatteryScene, Environment, FARTHEST_CM, FaultScene, MotorScene, Scene, ShaftSensor,
};

#[derive(Deserialize)]
#[serde(default, deny_unknown_fields)]
struct SceneFile {
    noise_lsb: f32,
    seed: Option<u64>,
    motor: Motors,
    battery: BatteryScene,
    environment: Environment,
    faults: FaultScene,
}

impl Default for SceneFile {
    fn default() -> Self {
        let Scene { noise_lsb, seed, battery, environment, faults, .. } = Scene::default();
        Self { noise_lsb, seed, battery, environment, faults, motor: Motors::default() }
    }
}

#[derive(Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Motors {
    #[serde(rename = "0")]
    m0: MotorChanges,
    #[serde(rename = "1")]
    m1: MotorChanges,
    #[serde(rename = "2")]
    m2: MotorChanges,
    #[serde(rename = "3")]
    m3: MotorChanges,
    #[serde(rename = "4")]
    m4: MotorChanges,
    #[serde(rename = "5")]
    m5: MotorChanges,
}

#[derive(Clone, Copy, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct MotorChanges {
    sensor: Option<ShaftSensor>,
    reversed: Option<bool>,
    full_speed: Option<f32>,
    time_constant_s: Option<f32>,
    friction: Option<f32>,
    load: Option<f32>,
    stall_current_a: Option<f32>,
    start: Option<i64>,
}

impl MotorChanges {
    fn apply(self, to: MotorScene) -> MotorScene {
        // Another sensor comes with a motor that suits it.
        let base = self.sensor.filter(|s| *s != to.sensor).map_or(to, MotorScene::with);
        MotorScene {
            sensor: base.sensor,
            reversed: self.reversed.unwrap_or(base.reversed),
            full_speed: self.full_speed.unwrap_or(base.full_speed),
            time_constant_s: self.time_constant_s.unwrap_or(base.time_constant_s),
            friction: self.friction.unwrap_or(base.friction),
            load: self.load.unwrap_or(base.load),
            stall_current_a: self.stall_current_a.unwrap_or(base.stall_current_a),
            start: self.start.unwrap_or(base.start),
        }
    }
}

/// Reads a scene.
///
/// # Errors
/// One line that names the key and what is wrong with it.
pub fn parse(text: &str) -> Result<Scene, String> {
    let file: SceneFile = toml::from_str(text).map_err(|error| {
        let place = error.span().and_then(|span| text.get(..span.start)).map(|before| {
            let number = before.matches('\n').count();
            let line = text.lines().nth(number).unwrap_or_default().trim();
            format!("line {}, `{line}`: ", number + 1)
        });
        place.unwrap_or_default() + &error.message().replace('\n', " ")
    })?;
    let Motors { m0, m1, m2, m3, m4, m5 } = file.motor;
    let mut scene = Scene {
        noise_lsb: file.noise_lsb,
        seed: file.seed,
        battery: file.battery,
        environment: file.environment,
        faults: file.faults,
        ..Scene::default()
    };
    for (motor, changes) in scene.motors.iter_mut().zip([m0, m1, m2, m3, m4, m5]) {
        *motor = changes.apply(*motor);
    }
    check(&scene)?;
    Ok(scene)
}

fn check(scene: &Scene) -> Result<(), String> {
    for (i, motor) in scene.motors.iter().enumerate() {
        let name = |key| format!("motor.{i}.{key}");
        in_range(name("full_speed"), motor.full_speed, 1.0, 1e6)?;
        in_range(name("time_constant_s"), motor.time_constant_s, 1e-4, 1e3)?;
        in_range(name("friction"), motor.friction, 0.0, 1.0)?;
        in_range(name("load"), motor.load, -1.0, 1.0)?;
        in_range(name("stall_current_a"), motor.stall_current_a, 0.0, 1e3)?;
        let start = match motor.sensor {
            ShaftSensor::Potentiometer => 0..=4095,
            _ => -1_000_000_000..=1_000_000_000,
        };
        if !start.contains(&motor.start) {
            let (start, (low, high)) = (motor.start, start.into_inner());
            return Err(format!("motor.{i}.start = {start}: must be {low} to {high}"));
        }
        match motor.sensor {
            ShaftSensor::Encoder if i > 1 => {
                return Err(format!("motor.{i}.sensor: only motors 0 and 1 have encoders"));
            }
            ShaftSensor::DualPotentiometer if i > 2 => {
                return Err(format!(
                    "motor.{i}.sensor: only motors 0 to 2 have two potentiometers"
                ));
            }
            _ => {}
        }
    }
    let battery = &scene.battery;
    in_range("battery.motor_nominal_v".into(), battery.motor_nominal_v, 0.1, 1e3)?;
    in_range("battery.motor_v".into(), battery.motor_v, 0.0, 1e3)?;
    in_range("battery.main_v".into(), battery.main_v, 0.0, 1e3)?;
    in_range("battery.servo_v".into(), battery.servo_v, 0.0, 1e3)?;
    in_range("battery.motor_resistance_ohm".into(), battery.motor_resistance_ohm, 0.0, 1e3)?;
    let world = &scene.environment;
    in_range("environment.ir_range_cm".into(), world.ir_range_cm, 10.0, 80.0)?;
    in_range("environment.ambient_c".into(), world.ambient_c, -50.0, 150.0)?;
    if let Some(wall_cm) = world.wall_cm {
        in_range("environment.wall_cm".into(), wall_cm, 0.0, FARTHEST_CM)?;
    }
    for (key, values, low, high) in [
        ("driver_c", &world.driver_c[..], -50.0, 200.0),
        ("tilt_g", &world.tilt_g[..], -2.0, 2.0),
        ("custom_v", &world.custom_v[..], 0.0, 3.0),
        ("cm_per_count", &world.cm_per_count[..], -1.0, 1.0),
    ] {
        for (i, value) in values.iter().enumerate() {
            in_range(format!("environment.{key}[{i}]"), *value, low, high)?;
        }
    }
    in_range("noise_lsb".into(), scene.noise_lsb, 0.0, 4095.0)
}

/// Not a number is in no range.
fn in_range(name: String, value: f32, low: f32, high: f32) -> Result<(), String> {
    if (low..=high).contains(&value) {
        Ok(())
    } else {
        Err(format!("{name} = {value}: must be {low} to {high}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_empty_file_is_the_default_scene() {
        assert_eq!(parse(""), Ok(Scene::default()));
    }

    #[test]
    fn a_motor_with_another_sensor_comes_with_numbers_that_suit_it() {
        let scene = parse("[motor.0]\nsensor = \"dual-potentiometer\"\nreversed = true").unwrap();
        let expected = MotorScene::with(ShaftSensor::DualPotentiometer);
        assert_eq!(scene.motors[0], MotorScene { reversed: true, ..expected });
        assert_eq!(scene.motors[1], Scene::default().motors[1]);
    }

    #[test]
    fn a_wall_a_seed_and_what_is_broken_are_read() {
        let text = "seed = 7
            [environment]
            wall_cm = 120.5
            cm_per_count = [0.01, -0.01]
            [faults]
            unplugged = [false, true, false, false, false, false]
            link = false";
        let mut expected = Scene { seed: Some(7), ..Scene::default() };
        expected.environment.wall_cm = Some(120.5);
        expected.environment.cm_per_count = [0.01, -0.01];
        expected.faults.unplugged[1] = true;
        expected.faults.link = false;
        assert_eq!(parse(text), Ok(expected));
    }

    #[test]
    fn what_is_wrong_is_named_in_one_line() {
        for (text, names) in [
            ("nois = 1", "nois"),
            ("[motor.6]\nreversed = true", "6"),
            ("[motor.0]\nspeed = 3", "speed"),
            ("[motor.3]\nsensor = \"encoder\"", "motor.3.sensor"),
            ("[motor.0]\nfull_speed = 0.0", "motor.0.full_speed"),
            ("[motor.2]\nload = -1.5", "motor.2.load"),
            ("[environment]\nsonar_cm = [1, 2]", "line 2"),
            ("[environment]\nsonar_cm = [300, 1, 1, 1, 1, 1]", "300"),
            ("noise_lsb = nan", "noise_lsb"),
            ("= 3", "line 1"),
            ("noise_lsb = 1\n\nnoise_lsb = 2", "line 3, `noise_lsb = 2`"),
            ("[motor.0]\nreversed = true\nfoo = 1", "line 3, `foo = 1`"),
            ("[motor.2]\nstart = -5", "motor.2.start"),
            ("[environment]\ntilt_g = [0.0, nan]", "environment.tilt_g[1]"),
            ("[environment]\nir_range_cm = 0.0", "environment.ir_range_cm"),
            ("[environment]\nwall_cm = -1.0", "environment.wall_cm"),
            ("[environment]\nwall_cm = \"far\"", "line 2"),
            ("[environment]\ncm_per_count = [0.0, 2.0]", "environment.cm_per_count[1]"),
            ("[faults]\njam = [true]", "line 2"),
            ("[faults]\nlinks = false", "links"),
            ("seed = -1", "seed"),
        ] {
            let error = parse(text).unwrap_err();
            assert!(error.contains(names) && error.lines().count() == 1, "{text}: {error}");
        }
    }
}
