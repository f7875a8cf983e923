//! The simulated world of a PMS5005 as the inspector's questions change it: JSON in, [`Overrides`], walls
//! and seeds out. Bad values are refused whole, in one line that names the key.

use serde_json::{Map, Value, json};

use super::values::{decimal, decimals, flags, number, numbers, shown, that_are_set};
use crate::plant::{FARTHEST_CM, Overrides, Plant};

/// What can be [`set`].
pub const SETTABLE: &[&str] = &[
    "pot",
    "encoder",
    "motor_current",
    "custom_ad",
    "human",
    "tilt",
    "overheat",
    "temperature",
    "ir_range",
    "battery",
    "reference",
    "sonar_cm",
    "ir_command",
    "gpio_in",
    "jam",
    "unplugged",
    "battery_v",
    "wall_cm",
    "seed",
];

/// What of a world is not as the simulation would have it, as it would be set.
pub fn overridden(plant: &Plant) -> Map<String, Value> {
    let mut all = that_are_set(json!(plant.overrides));
    all.extend(that_are_set(json!({
        "battery_v": plant.overrides.battery_v.map(|volts| volts.map(shown)),
        "wall_cm": plant.placed_wall_cm().map(shown),
        "seed": plant.reseeded(),
    })));
    all
}

/// Changes a world.
///
/// # Errors
/// One line that names the key and what is wanted; nothing is changed then.
pub fn set(plant: &mut Plant, changes: &Map<String, Value>) -> Result<(), String> {
    let mut changes = changes.clone();
    let wall = changes.remove("wall_cm");
    let wall = wall.map(|value| decimal("wall_cm", &value, FARTHEST_CM)).transpose()?;
    let seed = changes.remove("seed");
    let seed = seed.map(|value| number("seed", &value, u64::MAX)).transpose()?;
    plant.overrides = changed(&plant.overrides, &changes)?;
    if let Some(cm) = wall {
        plant.place_wall(cm);
    }
    if let Some(seed) = seed {
        plant.reseed(seed);
    }
    Ok(())
}

/// The overrides with some of them changed; an error names the key, and nothing is changed.
fn changed(old: &Overrides, changes: &Map<String, Value>) -> Result<Overrides, String> {
    const AD: u64 = 4095;
    const MOST_VOLTS: f32 = 1000.0;
    let mut new = old.clone();
    for (key, value) in changes {
        match key.as_str() {
            "pot" => new.potentiometers = numbers(key, value, AD)?,
            "encoder" => new.encoders = numbers(key, value, u16::MAX.into())?,
            "motor_current" => new.currents = numbers(key, value, AD)?,
            "custom_ad" => new.custom_ad = numbers(key, value, AD)?,
            "human" => new.human = numbers(key, value, AD)?,
            "tilt" => new.tilt = numbers(key, value, AD)?,
            "overheat" => new.overheat = numbers(key, value, AD)?,
            "temperature" => new.temperature = number(key, value, AD)?,
            "ir_range" => new.ir_range = number(key, value, AD)?,
            "battery" => new.battery = numbers(key, value, AD)?,
            "reference" => new.reference = numbers(key, value, AD)?,
            "sonar_cm" => new.sonar_cm = numbers(key, value, 255)?,
            "ir_command" => new.ir_command = numbers(key, value, 255)?,
            "gpio_in" => new.gpio_in = number(key, value, 255)?,
            "jam" => new.jam = flags(key, value)?,
            "unplugged" => new.unplugged = flags(key, value)?,
            "battery_v" => new.battery_v = decimals(key, value, MOST_VOLTS)?,
            _ => return Err(format!("{key}: cannot be set")),
        }
    }
    Ok(new)
}
