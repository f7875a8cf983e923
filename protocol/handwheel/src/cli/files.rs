//! `backup`, `restore`, `diff`.

use std::fs::File;
use std::io::Write;
use std::path::Path;

use serde_json::{Value, json};

use super::{ANSWER_IS_NO, Context, DONE, Outcome};
use crate::backup::{self, Plan};
use crate::client::Client;
use crate::error::Error;
use crate::session::Setting;
use crate::settings::Settings;

impl Context<'_, '_> {
    /// Writes all settings into a new file.
    pub fn backup(&mut self, file: &Path) -> Outcome {
        let mut client = self.connect()?;
        let settings = client.settings()?;
        // A board without the extension has no settings, and has said so.
        let identity = client.identity().ok_or(Error::NoAnswer("who it is"))?;
        let text = backup::write(client.personality(), identity, &settings);
        let written = File::create_new(file).and_then(|mut file| {
            file.write_all(text.as_bytes())?;
            file.sync_all()
        });
        written.map_err(|error| {
            named(
                file,
                match error.kind() {
                    std::io::ErrorKind::AlreadyExists => {
                        "exists; choose another name, nothing is overwritten".into()
                    }
                    _ => error.to_string(),
                },
            )
        })?;
        self.say(&format!("{} settings are in {}", settings.len(), file.display()));
        self.tell(&json!({ "file": file.display().to_string(), "settings": settings.len() }));
        Ok(DONE)
    }

    /// Checks a file whole, then puts it in force, reads it back, and saves it.
    pub fn restore(&mut self, file: &Path) -> Outcome {
        let text = read(file)?;
        let mut client = self.connect()?;
        let before = client.settings()?;
        let plan = plan(file, &text, &client, &before)
            .map_err(|error| Error::File(format!("{error}; nothing was changed")))?;
        all_off(&mut client)?;
        // Ctrl-C does not leave half of it.
        self.holds();
        if let Err(error) = put(&mut client, &before, &plan) {
            return Err(named(file, error.to_string()));
        }
        self.tell_missing(&plan);
        self.say(&format!("{} settings were changed, and all are saved", plan.changes.len()));
        self.tell(&json!({
            "changed": plan.changes.iter().map(change).collect::<Vec<_>>(),
            "not_in_the_file": plan.missing,
            "saved": true,
        }));
        Ok(DONE)
    }

    /// Shows where a file and the board differ.
    pub fn diff(&mut self, file: &Path) -> Outcome {
        let text = read(file)?;
        let mut client = self.connect()?;
        let board = client.settings()?;
        let plan = plan(file, &text, &client, &board)?;
        for (setting, value) in &plan.changes {
            self.say(&format!(
                "{}: {} on the board, {value} in the file",
                setting.name, setting.value
            ));
        }
        self.tell_missing(&plan);
        self.tell(&json!({
            "differ": plan.changes.iter().map(change).collect::<Vec<_>>(),
            "not_in_the_file": plan.missing,
        }));
        if plan.changes.is_empty() && plan.missing.is_empty() {
            self.say("no difference");
            return Ok(DONE);
        }
        Ok(ANSWER_IS_NO)
    }

    fn tell_missing(&mut self, plan: &Plan) {
        if !plan.missing.is_empty() {
            self.say(&format!(
                "{} settings are not in the file, and left as they are: {}",
                plan.missing.len(),
                plan.missing.join(", ")
            ));
        }
    }
}

/// Puts all of it in force and saves it, or undoes what was done.
fn put(client: &mut Client, before: &Settings, plan: &Plan) -> Result<(), Error> {
    let values: Vec<_> = plan.changes.iter().map(|(s, value)| (s.number, *value)).collect();
    client.assign_all(before, &values).map_err(|error| match error {
        Error::NotSet(_) => error, // it says what is in force now
        other => Error::NotSet(format!("{other}; nothing was changed")),
    })?;
    let done = client.settings().and_then(|now| {
        let wrong = plan.changes.iter().find(|(setting, value)| {
            !now.iter().any(|found| found.number == setting.number && found.value == *value)
        });
        match wrong {
            Some((setting, _)) => Err(Error::NotSet(format!(
                "{}: the board has another value than it was given; another host may set settings",
                setting.name
            ))),
            None => client.save(),
        }
    });
    done.map_err(|error| {
        let old: Vec<_> = plan.changes.iter().map(|(s, _)| (s.number, s.value)).collect();
        match client.assign_all(before, &old) {
            Ok(()) => Error::NotSet(format!("{error}; the settings are as before")),
            Err(second) => Error::NotSet(format!("{error}; and they could not be undone ({second}): they are in force, and not saved; restart the board to have those that were saved")),
        }
    })
}

/// A board saves only with all motors and servos off: that is looked at before anything is sent.
fn all_off(client: &mut Client) -> Result<(), Error> {
    let is_on = match client.state_at_rest()? {
        Some(state) => !crate::state::is_off(&state),
        None if client.personality() == crate::session::Personality::Arcos => {
            client.arm_status()?.powered
        }
        None => false,
    };
    if is_on {
        return Err(Error::Stopped("something is driven, and a board saves only with all off: `handwheel stop` first; nothing was changed".into()));
    }
    Ok(())
}

fn read(file: &Path) -> Result<String, Error> {
    std::fs::read_to_string(file).map_err(|error| {
        let why = match error.kind() {
            std::io::ErrorKind::NotFound => {
                "there is no such file; `handwheel backup` makes one".into()
            }
            std::io::ErrorKind::InvalidData => "not a backup of handwheel: it is no text".into(),
            std::io::ErrorKind::IsADirectory => "a folder; name a file".into(),
            _ => error.to_string(),
        };
        named(file, why)
    })
}

fn plan(file: &Path, text: &str, client: &Client, board: &Settings) -> Result<Plan, Error> {
    // A board without the extension has no settings, and has said so.
    let identity = client.identity().ok_or(Error::NoAnswer("who it is"))?;
    let plan = backup::check(text, client.personality(), identity, board);
    plan.map_err(|error| named(file, error.to_string()))
}

fn named(file: &Path, what: String) -> Error {
    Error::File(format!("{}: {what}", file.display()))
}

fn change((setting, value): &(Setting, i32)) -> Value {
    json!({ "name": setting.name, "board": setting.value, "file": value })
}
