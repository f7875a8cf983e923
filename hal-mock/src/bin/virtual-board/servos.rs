//! What machines with AX-12 servos have in common: which servos, where they are, what goes wrong on
//! their bus.

use hal_mock::plant::Ax12;
use hal_mock::servo_bus::Faults;
use protocol::dynamixel::Register;
use serde_json::{Value, json};

use crate::values;

/// The highest ID of a servo.
const HIGHEST_ID: u8 = 253;
/// A fault rate of one.
const CERTAIN_PPM: u64 = 1_000_000;

/// The IDs in a list of numbers and ranges, as from the option `--servos`.
pub fn ids(list: &str) -> Result<Vec<u8>, String> {
    let part = |part: &str| {
        let (first, last) = part.split_once('-').unwrap_or((part, part));
        let (first, last): (u8, u8) = (first.trim().parse().ok()?, last.trim().parse().ok()?);
        (first <= last && last <= HIGHEST_ID).then_some(first..=last)
    };
    let ranges: Option<Vec<_>> = list.split(',').map(part).collect();
    let ids = ranges.map(|ranges| ranges.into_iter().flatten().collect());
    ids.ok_or(format!("--servos {list}: expected IDs from 0 to 253, as 1-6 or 1,2,5-7"))
}

/// The rates in a list like `dropped=100,stalled=2000`, as from the option `--bus-faults`.
pub fn faults(list: &str) -> Result<Faults, String> {
    let mut faults = Faults::default();
    for part in list.split(',').filter(|part| !part.is_empty()) {
        let rate = |value: &str| value.parse().ok().filter(|ppm| u64::from(*ppm) <= CERTAIN_PPM);
        let named = part.split_once('=').and_then(|(name, value)| {
            let place = match name.trim() {
                "dropped" => &mut faults.dropped_ppm,
                "flipped" => &mut faults.flipped_ppm,
                "stalled" => &mut faults.stalled_ppm,
                _ => return None,
            };
            *place = rate(value.trim())?;
            Some(())
        });
        named.ok_or(format!(
            "--bus-faults {list}: expected dropped=, flipped= or stalled= and parts of a million, \
             as flipped=100,stalled=2000"
        ))?;
    }
    Ok(faults)
}

/// Changes a fault rate, if `key` is one.
pub fn set_fault(faults: &mut Faults, key: &str, value: &Value) -> Result<bool, String> {
    let place = match key {
        "dropped_ppm" => &mut faults.dropped_ppm,
        "flipped_ppm" => &mut faults.flipped_ppm,
        "stalled_ppm" => &mut faults.stalled_ppm,
        _ => return Ok(false),
    };
    *place = values::number(key, value, CERTAIN_PPM)?.unwrap_or(0);
    Ok(true)
}

/// Which of these servos a list of IDs names.
pub fn named(ids: &[u8], key: &str, value: &Value) -> Result<Vec<bool>, String> {
    let known = |value: &Value| {
        let id = u8::try_from(value.as_u64()?).ok()?;
        ids.contains(&id).then_some(id)
    };
    let named: Option<Vec<_>> = value.as_array().and_then(|ids| ids.iter().map(known).collect());
    let named = named.ok_or(format!("{key}: expected a list of IDs out of {ids:?}"))?;
    Ok(ids.iter().map(|id| named.contains(id)).collect())
}

/// Where the servos are, for a status line.
pub fn positions<'a>(servos: impl Iterator<Item = (&'a Ax12, bool)>) -> String {
    let positions = servos.map(|(servo, plugged)| match plugged {
        true => servo.get(Register::PRESENT_POSITION).to_string(),
        false => "-".into(),
    });
    positions.collect::<Vec<_>>().join(",")
}

/// A servo in a line.
pub fn line(servo: &Ax12, plugged: bool) -> String {
    format!(
        "servo {:3} {:4} goal {:4} torque {} {}",
        servo.id(),
        servo.get(Register::PRESENT_POSITION),
        servo.get(Register::GOAL_POSITION),
        if servo.get(Register::TORQUE_ENABLE) == 1 { " on" } else { "off" },
        if plugged { servo.errors().to_string() } else { "unplugged".into() },
    )
}

/// A servo for the inspector.
pub fn state(servo: &Ax12, plugged: bool) -> Value {
    json!({
        "id": servo.id(),
        "plugged": plugged,
        "position": servo.position(),
        "goal": servo.get(Register::GOAL_POSITION),
        "speed": servo.get(Register::MOVING_SPEED),
        "torque": servo.get(Register::TORQUE_ENABLE) == 1,
        "load": servo.get(Register::PRESENT_LOAD),
        "errors": servo.errors().to_string(),
    })
}
