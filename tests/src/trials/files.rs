//! What people write: scenes, backups of settings, the inspector's questions. Any text is read, or is
//! refused in one line; what is read makes a world in which every number is one.

use std::fmt::Write;
use std::sync::OnceLock;

use firmware::ports::MotorOutput;
use firmware::settings::Settings;
use firmware::units::{Duty, ServoPulse};
use hal_mock::machine::world;
use hal_mock::plant::{Plant, Scene};
use hal_mock::scene_file;
use handwheel::backup;
use handwheel::session::{Personality, Setting};
use protocol::extension::{Identity, Origin, ResetCause, Unit, VERSION};
use serde_json::{Map, Value, json};

use super::Choices;

/// What people write for numbers.
const NUMBERS: [&str; 16] = [
    "0",
    "1",
    "-1",
    "0.0",
    "1.0",
    "0.5",
    "nan",
    "inf",
    "-inf",
    "1e30",
    "255",
    "4095",
    "65536",
    "18446744073709551615",
    "true",
    "\"encoder\"",
];

/// One line that a person can read.
fn refused(error: &str) {
    assert!(!error.trim().is_empty() && error.lines().count() == 1, "{error:?}");
}

/// A world moves for a while, driven, and no number of it is none.
fn moves(mut plant: Plant) {
    let driven = MotorOutput { duty: Duty::from_raw(12_000), enabled: true };
    plant.outputs.motors = [driven; 6];
    plant.outputs.servos = [Some(ServoPulse::from_raw(5000)); 6];
    plant.advance_to(30);
    for motor in &plant.motors {
        assert!(motor.velocity().is_finite() && motor.current_a().is_finite(), "{motor:?}");
    }
    plant.motion_inputs().currents.iter().for_each(|current| assert!(*current <= 4095));
    let sensors = plant.sensors();
    sensors.battery.iter().for_each(|battery| assert!(*battery <= 4095));
}

/// A line of a scene: a key that there is, and a value that somebody could write.
fn scene_line(choices: &mut Choices, text: &mut String) {
    let value = choices.among(&NUMBERS);
    let keys =
        ["noise_lsb", "seed", "[motor.0]", "[motor.5]", "[battery]", "[environment]", "[faults]"];
    let more = [
        "sensor",
        "reversed",
        "full_speed",
        "time_constant_s",
        "friction",
        "load",
        "stall_current_a",
        "start",
        "motor_v",
        "main_v",
        "servo_v",
        "motor_nominal_v",
        "motor_resistance_ohm",
        "ir_range_cm",
        "ambient_c",
        "wall_cm",
        "link",
    ];
    let lists = ["sonar_cm", "cm_per_count", "driver_c", "tilt_g", "custom_v", "jam", "unplugged"];
    let _ = match choices.below(4) {
        0 => {
            let key = choices.among(&keys);
            let is_table = key.starts_with('[');
            if is_table { writeln!(text, "{key}") } else { writeln!(text, "{key} = {value}") }
        }
        1 | 2 => writeln!(text, "{} = {value}", choices.among(&more)),
        _ => {
            let values = vec![value; choices.among(&[0, 2, 4, 6, 8])].join(", ");
            writeln!(text, "{} = [{values}]", choices.among(&lists))
        }
    };
}

fn scene(text: &str) {
    match scene_file::parse(text) {
        Ok(scene) => moves(Plant::new(scene, 1)),
        Err(error) => refused(&error),
    }
}

const IDENTITY: Identity = Identity {
    version: [0, 1, 0],
    extension: VERSION,
    reset: ResetCause::Power,
    settings: Origin::Stored,
};

/// All settings, as a board tells them.
fn board() -> &'static [Setting] {
    static BOARD: OnceLock<Vec<Setting>> = OnceLock::new();
    BOARD.get_or_init(|| {
        Settings::DEFAULT
            .iter()
            .map(|(number, value)| {
                let told = Settings::DEFAULT.describe(number).expect("it is one");
                let member = told.member.map(|member| format!(" {member}")).unwrap_or_default();
                let (name, range) = (format!("{}{member}", told.name), told.range);
                let (next, default) = (told.next, told.default);
                Setting { number, next, name, value, range, default, unit: Unit::Choice }
            })
            .collect()
    })
}

fn settings(text: &str) {
    let board = board().to_vec();
    match backup::check(text, Personality::Pms5005, IDENTITY, &board) {
        Ok(plan) => {
            for (setting, value) in plan.changes {
                assert!((setting.range.0..=setting.range.1).contains(&value), "{setting:?}");
            }
        }
        Err(error) => refused(&error.to_string()),
    }
}

/// A backup that somebody has changed.
fn changed_backup(choices: &mut Choices) -> String {
    static WHOLE: OnceLock<String> = OnceLock::new();
    let whole = WHOLE.get_or_init(|| backup::write(Personality::Pms5005, IDENTITY, board()));
    let mut lines: Vec<&str> = whole.lines().filter(|line| !line.starts_with('#')).collect();
    for _ in 0..choices.below(6) {
        let at = choices.below(lines.len() as u32) as usize;
        match choices.below(4) {
            0 => drop(lines.remove(at)),
            1 => lines.insert(at, lines[choices.below(lines.len() as u32) as usize]),
            2 => lines.insert(at, "\"telemetry period\" = 20"),
            _ => lines.insert(at, choices.among(&NUMBERS)),
        }
    }
    lines.join("\n")
}

fn question(choices: &mut Choices) -> Map<String, Value> {
    let mut changes = Map::new();
    for _ in 0..1 + choices.below(4) {
        let key = choices.among(world::SETTABLE);
        let values = [
            json!(null),
            json!(0),
            json!(-1),
            json!(4095),
            json!(255),
            json!(65_536),
            json!(0.5),
            json!(1e300),
            json!(u64::MAX),
            json!(true),
            json!("x"),
            json!({}),
        ];
        let value = values[choices.below(values.len() as u32) as usize].clone();
        let count = choices.among(&[0, 2, 3, 4, 6, 8]);
        let is_list = choices.one_in(2);
        changes.insert(key.into(), if is_list { json!(vec![value; count]) } else { value });
    }
    changes
}

/// Sets what is asked, or nothing; what is set can be set again, and is the same then.
fn inspect(changes: &Map<String, Value>) {
    let mut plant = Plant::new(Scene::default(), 1);
    let before = world::overridden(&plant);
    if let Err(error) = world::set(&mut plant, changes) {
        refused(&error);
        assert_eq!(world::overridden(&plant), before, "it was refused, and changed: {error}");
        return;
    }
    let now = world::overridden(&plant);
    let mut again = Plant::new(Scene::default(), 1);
    world::set(&mut again, &now).expect("what is told can be set");
    assert_eq!(world::overridden(&again), now);
    moves(plant);
}

pub(super) fn trial(choices: &mut Choices) {
    match choices.below(6) {
        0 => scene(&String::from_utf8_lossy(&choices.rest(600))),
        1 => {
            let mut text = String::new();
            (0..1 + choices.below(12)).for_each(|_| scene_line(choices, &mut text));
            scene(&text);
        }
        2 => settings(&String::from_utf8_lossy(&choices.rest(600))),
        3 => settings(&changed_backup(choices)),
        4 => {
            let bytes = choices.rest(600);
            if let Ok(Value::Object(changes)) = serde_json::from_slice(&bytes) {
                inspect(&changes);
            }
        }
        _ => inspect(&question(choices)),
    }
}
