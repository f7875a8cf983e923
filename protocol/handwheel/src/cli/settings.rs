//! `get`, `set`, `save`, `reset`.

use serde_json::{Value, json};

use super::{Context, DONE, Outcome};
use crate::error::Error;
use crate::session::Setting;
use crate::settings::{check, find};
use crate::words;

impl Context<'_, '_> {
    /// All settings, the one of this name, or those of it with any number.
    pub fn get(&mut self, name: &str) -> Outcome {
        let mut client = self.connect()?;
        let all = client.settings_until(|setting| setting.name.eq_ignore_ascii_case(name))?;
        let of_name = |setting: &&Setting| {
            let stem = setting.name.rsplit_once(' ').filter(|(_, digit)| digit.len() == 1);
            setting.name.eq_ignore_ascii_case(name)
                || stem.is_some_and(|(stem, digit)| {
                    stem.eq_ignore_ascii_case(name) && digit.parse::<u8>().is_ok()
                })
        };
        let mut shown: Vec<_> = all.iter().filter(of_name).collect();
        if name.is_empty() {
            shown = all.iter().collect();
        }
        if shown.is_empty() {
            find(&all, name)?;
        }
        for setting in &shown {
            self.say(&line(setting));
        }
        let driven = self.others(&mut client)?;
        let settings: Vec<_> = shown.into_iter().map(object).collect();
        self.tell(&json!({ "settings": settings, "driven_by_another_host": driven }));
        Ok(DONE)
    }

    /// The last word is the value, those before it the name.
    pub fn set(&mut self, words: &[String]) -> Outcome {
        let (value, name) = words.split_last().map_or(("", &[][..]), |(v, n)| (v.as_str(), n));
        let name = name.join(" ");
        let value: i64 = value.parse().map_err(|_| {
            let all = words.join(" ");
            Error::NoValue(format!(
                "{all}: a name and a whole number are wanted, as `set telemetry period 20`"
            ))
        })?;
        let mut client = self.connect()?;
        let before = client.setting(&name)?;
        let value = check(&before, value)?;
        let set = client.set_known(&before, value)?;
        let when = match set.name.starts_with("arm ") || set.name.starts_with("joint ") {
            true => "in force from the next start on, if saved (`handwheel save`)",
            false => "in force, and not saved (`handwheel save`)",
        };
        self.say(&format!(
            "{}: {} -> {} {}; {when}",
            set.name,
            before.value,
            set.value,
            words::unit(set.unit)
        ));
        if set.name == "link timeout" && set.value == 0 {
            self.remark("nothing stops a motor any more whose host has died");
        }
        let driven = self.others(&mut client)?;
        self.tell(&json!({
            "name": set.name, "before": before.value, "value": set.value,
            "driven_by_another_host": driven,
        }));
        Ok(DONE)
    }

    pub fn save(&mut self) -> Outcome {
        self.connect()?.save()?;
        self.say("saved");
        self.tell(&json!({ "saved": true }));
        Ok(DONE)
    }

    pub fn reset(&mut self) -> Outcome {
        self.connect()?.factory_reset()?;
        self.say("the defaults are in force, and saved");
        self.tell(&json!({ "reset": true }));
        Ok(DONE)
    }
}

fn line(setting: &Setting) -> String {
    let (low, high) = setting.range;
    let changed = if setting.value == setting.default { ' ' } else { '*' };
    let unit = words::unit(setting.unit);
    let unit = if unit.is_empty() { String::new() } else { format!("{unit}, ") };
    format!(
        "{:26}{changed}{:8}   {unit}{low} to {high}, default {}",
        setting.name, setting.value, setting.default
    )
}

fn object(setting: &Setting) -> Value {
    json!({
        "name": setting.name,
        "value": setting.value,
        "unit": words::unit(setting.unit),
        "range": [setting.range.0, setting.range.1],
        "default": setting.default,
    })
}
