//! Boards as a program serves them and JSON shows and sets them, whatever their personality: [`Machine`], one
//! file each beside this one. Links, pages and inspectors know nothing else.

mod ax12_bus;
mod cm5;
mod pass_through;
mod pioneer_arm;
mod pms5005;
mod servos;
pub mod values;
pub mod world;

use embassy_time::Instant;
use serde_json::{Map, Value, json};

use crate::wire::Line;

pub use ax12_bus::Ax12Bus;
pub use cm5::Cm5;
pub use pass_through::PassThrough;

/// The key for the host's link, which every board has.
const LINK: &str = "link";

/// A simulated board on virtual time, with a line to its host.
pub trait Machine {
    /// What it is, for the user.
    fn name(&self) -> &'static str;

    /// The line to its host.
    fn line(&self) -> &Line;

    /// Runs until `time`.
    fn run_until(&mut self, time: Instant);

    /// How it is, in a line that stays the same for as long as nothing happens.
    fn status(&self) -> String;

    /// What is wrong with it, by name.
    fn faults(&self) -> Vec<String>;

    /// The simulated truth.
    fn state(&self) -> Value;

    /// What can be [`set`](Self::set).
    fn settable(&self) -> &'static [&'static str];

    /// What of it is not as the simulation would have it, as it would be set.
    fn overridden(&self) -> Map<String, Value>;

    /// Changes the simulated world.
    ///
    /// # Errors
    /// One line that names the key; nothing is changed then.
    fn set(&mut self, changes: &Map<String, Value>) -> Result<(), String>;
}

/// Answers a question of an inspector: `{"get":"state"}` or `{"set":{...}}`. Of the host's side of its line it
/// tells `host`.
///
/// # Errors
/// In one line what is wrong with the question; nothing is changed then.
pub fn ask(
    question: &Value,
    machine: &mut dyn Machine,
    host: impl FnOnce() -> Value,
) -> Result<Value, String> {
    let wanted = "expected {\"get\":\"state\"} or {\"set\":{...}}";
    let object = question.as_object().filter(|object| object.len() == 1).ok_or(wanted)?;
    match object.iter().next() {
        Some((key, Value::String(what))) if key == "get" && what == "state" => {
            let mut state = machine.state();
            let mut overridden = machine.overridden();
            if machine.line().is_cut() {
                overridden.insert(LINK.into(), false.into());
            }
            state["overridden"] = overridden.into();
            state["settable"] = machine.settable().iter().copied().chain([LINK]).collect();
            state["host"] = host();
            Ok(state)
        }
        Some((key, Value::Object(changes))) if key == "set" => {
            set(changes.clone(), machine)?;
            Ok(json!({ "ok": true }))
        }
        _ => Err(wanted.into()),
    }
}

/// Sets what every board has, and leaves the rest to this one.
fn set(mut changes: Map<String, Value>, machine: &mut dyn Machine) -> Result<(), String> {
    let names = machine.settable();
    if let Some(key) = changes.keys().find(|key| *key != LINK && !names.contains(&key.as_str())) {
        let names = names.join(", ");
        return Err(format!("{key}: nothing of this name can be set; there are {names}, {LINK}"));
    }
    let is_whole = match changes.remove(LINK) {
        None => None,
        Some(Value::Null) => Some(true),
        Some(Value::Bool(is_whole)) => Some(is_whole),
        Some(_) => return Err(format!("{LINK}: expected true, false, or null")),
    };
    machine.set(&changes)?;
    if let Some(is_whole) = is_whole {
        machine.line().cut(!is_whole);
    }
    Ok(())
}
