//! What machines with AX-12 servos have in common: which servos, where they are, what goes wrong on
//! their bus.

use protocol::dynamixel::{Errors, Register};
use serde_json::{Map, Value, json};

use super::values;
use crate::plant::{Ax12, Surroundings};
use crate::servo_bus::{Faults, ServoBus};

/// A fault rate of one.
const CERTAIN_PPM: u64 = 1_000_000;

/// What [`Kept::set`] knows.
pub const SETTABLE: [&str; 9] = [
    "unplug",
    "replug",
    "jammed",
    "temperature_c",
    "voltage_dv",
    "load",
    "dropped_ppm",
    "flipped_ppm",
    "stalled_ppm",
];

/// What a machine keeps of its servos beside their bus.
pub struct Kept {
    /// The IDs in the beginning.
    ids: Vec<u8>,
    faults: Faults,
}

impl Kept {
    /// Of these servos, on a bus with these faults.
    pub fn new(servos: &[Ax12], faults: Faults) -> Self {
        Self { ids: servos.iter().map(Ax12::id).collect(), faults }
    }

    /// What of it is not as it was in the beginning.
    pub fn overridden(&self, bus: &ServoBus) -> Map<String, Value> {
        overridden(bus, &self.ids, &self.faults)
    }

    /// Changes the bus and its servos as the inspector asks. An error names the key, and nothing is changed.
    pub fn set(&mut self, bus: &mut ServoBus, changes: &Map<String, Value>) -> Result<(), String> {
        set(bus, &self.ids, &mut self.faults, changes)
    }
}

fn overridden(bus: &ServoBus, ids: &[u8], faults: &Faults) -> Map<String, Value> {
    let of = |what: &dyn Fn(&Ax12, bool) -> bool| {
        let such =
            ids.iter().zip(bus.servos()).filter(|(_, (servo, plugged))| what(servo, *plugged));
        let ids: Vec<u8> = such.map(|(id, _)| *id).collect();
        (!ids.is_empty()).then_some(ids)
    };
    let usual = Surroundings::default();
    let unusual = |what: &dyn Fn(&Surroundings) -> i64| {
        let servos = ids.iter().zip(bus.servos());
        let values = servos.map(|(id, (servo, _))| (id.to_string(), what(&servo.surroundings)));
        let values: Map<_, _> = values
            .filter(|(_, value)| *value != what(&usual))
            .map(|(id, value)| (id, value.into()))
            .collect();
        (!values.is_empty()).then_some(values)
    };
    let rate = |ppm: u32| (ppm > 0).then_some(ppm);
    values::that_are_set(json!({
        "unplug": of(&|_, plugged| !plugged),
        "jammed": of(&|servo, _| servo.surroundings.jammed),
        "temperature_c": unusual(&|world| world.temperature_c.into()),
        "voltage_dv": unusual(&|world| world.supply_dv.into()),
        "load": unusual(&|world| world.load.into()),
        "dropped_ppm": rate(faults.dropped_ppm),
        "flipped_ppm": rate(faults.flipped_ppm),
        "stalled_ppm": rate(faults.stalled_ppm),
    }))
}

fn set(
    bus: &mut ServoBus,
    ids: &[u8],
    faults: &mut Faults,
    changes: &Map<String, Value>,
) -> Result<(), String> {
    let mut rates = *faults;
    let (mut unplug, mut replug, mut jammed) = (vec![], vec![], None);
    // What is to become of each servo's world.
    let mut worlds: Vec<_> = (0..ids.len()).map(|index| bus.servo(index).surroundings).collect();
    let usual = Surroundings::default();
    for (key, value) in changes {
        let rate = match key.as_str() {
            "unplug" => {
                unplug = named(ids, key, value)?;
                continue;
            }
            "replug" => {
                replug = named(ids, key, value)?;
                continue;
            }
            "jammed" => {
                jammed = Some(named(ids, key, value)?);
                continue;
            }
            "temperature_c" => {
                for (index, value) in by_id(ids, key, value, 0, 255)? {
                    worlds[index].temperature_c = value.unwrap_or(usual.temperature_c);
                }
                continue;
            }
            "voltage_dv" => {
                for (index, value) in by_id(ids, key, value, 0, 255)? {
                    worlds[index].supply_dv = value.unwrap_or(usual.supply_dv);
                }
                continue;
            }
            "load" => {
                for (index, value) in by_id(ids, key, value, -2000, 2000)? {
                    worlds[index].load = value.unwrap_or(usual.load);
                }
                continue;
            }
            "dropped_ppm" => &mut rates.dropped_ppm,
            "flipped_ppm" => &mut rates.flipped_ppm,
            "stalled_ppm" => &mut rates.stalled_ppm,
            _ => return Err(format!("{key}: cannot be set")),
        };
        *rate = values::number(key, value, CERTAIN_PPM)?.unwrap_or(0);
    }
    *faults = rates;
    bus.set_faults(rates);
    unplug.into_iter().for_each(|index| bus.unplug(index));
    replug.into_iter().for_each(|index| bus.plug(index));
    for (index, mut world) in worlds.into_iter().enumerate() {
        if let Some(jammed) = &jammed {
            world.jammed = jammed.contains(&index);
        }
        bus.servo(index).surroundings = world;
    }
    Ok(())
}

/// Numbers, or nulls, for the servos that an object names by their IDs, by their places.
fn by_id<T: TryFrom<i64>>(
    ids: &[u8],
    key: &str,
    value: &Value,
    least: i64,
    most: i64,
) -> Result<Vec<(usize, Option<T>)>, String> {
    let entry = |(id, value): (&String, &Value)| {
        let place = ids.iter().position(|known| id.parse() == Ok(*known))?;
        let number = match value {
            Value::Null => None,
            value => {
                let number = value.as_i64().filter(|number| (least..=most).contains(number))?;
                Some(T::try_from(number).ok()?)
            }
        };
        Some((place, number))
    };
    let entries = value.as_object().and_then(|object| object.iter().map(entry).collect());
    entries.ok_or(format!(
        "{key}: expected whole numbers from {least} to {most}, or null, by IDs out of {ids:?}, as \
         {{\"{}\":{}}}",
        ids.first().copied().unwrap_or(1),
        most / 3,
    ))
}

/// Which of these servos a list of IDs names, by their places.
fn named(ids: &[u8], key: &str, value: &Value) -> Result<Vec<usize>, String> {
    let place = |value: &Value| ids.iter().position(|&id| value.as_u64() == Some(id.into()));
    let named = value.as_array().and_then(|named| named.iter().map(place).collect());
    named.ok_or(format!("{key}: expected a list of IDs out of {ids:?}"))
}

/// Where the servos are, for a status line.
pub fn positions<'a>(servos: impl Iterator<Item = (&'a Ax12, bool)>) -> String {
    let positions = servos.map(|(servo, plugged)| match plugged {
        true => servo.get(Register::PRESENT_POSITION).to_string(),
        false => "-".into(),
    });
    positions.collect::<Vec<_>>().join(",")
}

/// What is wrong with servos, by their own account.
pub fn errors<'a>(servos: impl Iterator<Item = (&'a Ax12, bool)>) -> Vec<String> {
    let wrong = servos.filter(|(servo, plugged)| *plugged && servo.errors() != Errors::NONE);
    wrong.map(|(servo, _)| format!("servo {}: {}", servo.id(), servo.errors())).collect()
}

/// A servo for the inspector. Temperature, voltage, load and `jammed` are its world, as they can be
/// set; `speed` (0.111 rpm, clockwise negative) and position are its shaft's.
pub fn state(servo: &Ax12, plugged: bool) -> Value {
    json!({
        "id": servo.id(),
        "plugged": plugged,
        "position": servo.position(),
        "speed": servo.speed(),
        "goal": servo.get(Register::GOAL_POSITION),
        "moving_speed": servo.get(Register::MOVING_SPEED),
        "torque": servo.is_driven(),
        "present_load": servo.get(Register::PRESENT_LOAD),
        "temperature_c": servo.surroundings.temperature_c,
        "voltage_dv": servo.surroundings.supply_dv,
        "load": servo.surroundings.load,
        "jammed": servo.surroundings.jammed,
        "errors": servo.errors().to_string(),
    })
}
