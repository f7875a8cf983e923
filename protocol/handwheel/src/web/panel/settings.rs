//! Settings: read, changed all or none, saved, and put in and out of files.

use std::collections::VecDeque;

use protocol::extension::{Action, Assignments, Request};
use serde_json::{Map, Value, json};

use super::exchanges::Purpose;
use super::message::text;
use super::{Asker, Panel};
use crate::backup::{self, Plan};
use crate::error::Error;
use crate::session::{Failure, Reply, Setting};
use crate::settings::{Settings, assignments, check, find, most, parts, with_name};
use crate::state::is_off;

/// What is known of the settings.
#[derive(Default)]
pub(super) struct Tuning {
    /// All of them, once they were read.
    list: Settings,
    /// While they are read.
    reading: Option<Reading>,
    readings: u64,
    /// Something was set since the last save.
    pub(super) unsaved: bool,
    change: Option<Change>,
}

/// A reading of all of them, numbered: those so far, and whether a question is under way.
struct Reading {
    number: u64,
    list: Settings,
    is_asked: bool,
}

/// A change that is under way, all or none.
struct Change {
    asker: Asker,
    ok: Value,
    steps: VecDeque<Step>,
    /// The step whose answer is waited for.
    current: Option<Step>,
    /// What puts back what is done so far.
    undo: Vec<Vec<(u16, i32)>>,
    /// What the settings are to be, and what they were.
    wanted: Vec<(u16, i32)>,
    before: Vec<(u16, i32)>,
    was_unsaved: bool,
    /// Why it is being undone.
    failed: Option<String>,
}

#[derive(Clone)]
enum Step {
    /// One request, which the board takes all or none.
    Assign(Vec<(u16, i32)>),
    Read(u16),
    Save,
}

impl Tuning {
    pub(super) fn list(&self) -> &[Setting] {
        &self.list
    }

    pub(super) fn value_of(&self, name: &str) -> Option<i32> {
        find(&self.list, name).ok().map(|setting| setting.value)
    }

    /// Whether some are being set.
    pub(super) fn is_changing(&self) -> bool {
        self.change.is_some()
    }

    /// Values that are known to be in force; whether any is another one than before.
    pub(super) fn put_values(&mut self, values: &[(u16, i32)]) -> bool {
        let mut differs = false;
        for known in &mut self.list {
            let value = values.iter().rfind(|(number, _)| *number == known.number);
            if let Some((_, value)) = value.filter(|(_, value)| *value != known.value) {
                (known.value, differs) = (*value, true);
            }
        }
        differs
    }

    /// Whether all of them are being read.
    pub(super) fn is_reading(&self) -> bool {
        self.reading.is_some()
    }

    fn put(&mut self, setting: Setting) {
        if let Some(known) = self.list.iter_mut().find(|known| known.number == setting.number) {
            *known = setting;
        }
    }
}

impl Panel {
    /// Begins to read all of them.
    pub(super) fn read_settings(&mut self) {
        self.settings.readings += 1;
        let number = self.settings.readings;
        self.settings.reading = Some(Reading { number, list: Settings::new(), is_asked: false });
    }

    pub(super) fn read_of_settings(
        &mut self,
        what: &str,
        asker: Asker,
        object: &Map<String, Value>,
    ) -> Result<(), String> {
        if what == "settings" {
            self.needs_extension()?;
            self.read_settings();
            self.answer(asker, Ok(Value::Null));
            return Ok(());
        }
        self.needs_list()?;
        let identity = self.board.identity.ok_or("this board has no settings")?;
        let value = match what {
            "backup" => backup::write(self.personality(), identity, &self.settings.list).into(),
            _ => told(&self.plan(object)?),
        };
        self.answer(asker, Ok(value));
        Ok(())
    }

    pub(super) fn change_settings(
        &mut self,
        what: &str,
        asker: Asker,
        object: &Map<String, Value>,
    ) -> Result<(), String> {
        self.needs_list()?;
        // What a job has set for itself is not to be saved, nor what it sets back to be lost.
        self.needs_no_job()?;
        match what {
            "save" => {
                let save = Request::Do(Action::Save);
                self.ask(&save, Purpose::Keep(asker, Action::Save));
            }
            "reset" => {
                let reset = Request::Do(Action::FactoryReset);
                self.ask(&reset, Purpose::Keep(asker, Action::FactoryReset));
            }
            "restore" => {
                let plan = self.plan(object)?;
                if self.tells.state.is_some_and(|state| !is_off(&state)) {
                    return Err("something is driven, and a board saves only with all off: Stop first; nothing was changed".into());
                }
                let wanted = plan.changes.iter().map(|(s, value)| (s.number, *value)).collect();
                self.change(asker, told(&plan), wanted, true);
            }
            _ => {
                let values = object.get("values").and_then(Value::as_object);
                let values = values.filter(|values| !values.is_empty());
                let values = values.ok_or("values: {NAME: NUMBER, ...} is wanted")?;
                let mut wanted = Vec::new();
                for (name, value) in values {
                    let setting = find(&self.settings.list, name).map_err(|e| e.to_string())?;
                    let value = value
                        .as_i64()
                        .ok_or_else(|| format!("{name}: a whole number is wanted"))?;
                    let value = check(setting, value).map_err(|e| e.to_string())?;
                    wanted.push((setting.number, value));
                }
                self.change(asker, Value::Null, wanted, false);
            }
        }
        Ok(())
    }

    fn needs_extension(&self) -> Result<(), String> {
        match self.board.has_extension() {
            true => Ok(()),
            false => Err(format!("{} has no settings to be read or set", self.title())),
        }
    }

    pub(super) fn needs_list(&self) -> Result<(), String> {
        self.needs_extension()?;
        if self.settings.change.is_some() {
            return Err("settings are being changed: wait for that to end".into());
        }
        match self.settings.list.is_empty() {
            true => Err("the settings are still being read: wait a moment".into()),
            false => Ok(()),
        }
    }

    fn plan(&self, object: &Map<String, Value>) -> Result<Plan, String> {
        let identity = self.board.identity.ok_or("this board has no settings")?;
        let text = text(object, "text")?;
        let plan = backup::check(text, self.personality(), identity, &self.settings.list);
        plan.map_err(|error| format!("{error}; nothing was changed"))
    }

    fn change(&mut self, asker: Asker, ok: Value, wanted: Vec<(u16, i32)>, is_saved: bool) {
        let value = |(number, _): &(u16, i32)| {
            let known = self.settings.list.iter().find(|setting| setting.number == *number)?;
            Some((*number, known.value))
        };
        let before = wanted.iter().filter_map(value).collect();
        let was_unsaved = self.settings.unsaved;
        let assigned = parts(&wanted, most(self.personality())).into_iter().map(Step::Assign);
        let read = wanted.iter().map(|(number, _)| Step::Read(*number));
        let save = is_saved.then_some(Step::Save);
        self.settings.change = Some(Change {
            asker,
            ok,
            steps: assigned.chain(read).chain(save).collect(),
            current: None,
            undo: Vec::new(),
            wanted,
            before,
            was_unsaved,
            failed: None,
        });
        self.next_of_change();
    }

    fn next_of_change(&mut self) {
        let Some(change) = &mut self.settings.change else { return };
        change.current = change.steps.pop_front();
        match change.current.clone() {
            None => self.end_change(None),
            Some(Step::Read(number)) => self.ask(&Request::Setting(number), Purpose::Change),
            Some(Step::Save) => self.ask(&Request::Do(Action::Save), Purpose::Change),
            Some(Step::Assign(values)) => {
                // Without an answer it may be in force all the same.
                let is_of = |(number, _): &&(u16, i32)| values.iter().any(|(of, _)| of == number);
                change.undo.push(change.before.iter().filter(is_of).copied().collect());
                self.settings.unsaved = true;
                match assignments(&values) {
                    Ok(data) => match Assignments::parse(&data) {
                        Ok(parsed) => self.ask(&Request::Set(parsed), Purpose::Change),
                        Err(verdict) => self.undo_change(verdict.to_string()),
                    },
                    Err(error) => self.undo_change(error.to_string()),
                }
            }
        }
    }

    pub(super) fn change_goes_on(&mut self, result: Result<Reply, Failure>) {
        let personality = self.personality();
        let Some(change) = &mut self.settings.change else { return };
        match (change.current.take(), result) {
            (step, Err(failure)) => {
                if matches!((&step, failure), (Some(Step::Assign(_)), Failure::Refused(..))) {
                    change.undo.pop();
                }
                let error = Error::of(failure, personality, "settings");
                let error = with_name(error, &self.settings.list).to_string();
                return self.undo_change(error);
            }
            (Some(Step::Read(number)), Ok(Reply::Setting(setting))) => {
                let is_undone = change.failed.is_some();
                let list = if is_undone { &change.before } else { &change.wanted };
                let wanted = list.iter().find(|(wanted, _)| *wanted == number);
                let differs = wanted.is_some_and(|(_, value)| *value != setting.value);
                let name = setting.name.clone();
                self.learn(&setting);
                self.settings.put(setting);
                if differs {
                    return self.undo_change(format!(
                        "{name}: the board has another value than it was given; another host may set settings"
                    ));
                }
            }
            (Some(Step::Save), Ok(_)) => self.settings.unsaved = false,
            _ => {}
        }
        self.next_of_change();
    }

    /// Something went wrong: back to what was.
    fn undo_change(&mut self, why: String) {
        let Some(change) = &mut self.settings.change else { return };
        if let Some(first) = &change.failed {
            let error = format!(
                "{first}; and it could not be undone ({why}): what was set is in force, and not saved; \
                 restart the board to have what was saved"
            );
            return self.end_change(Some(error));
        }
        change.failed = Some(why);
        let undo = std::mem::take(&mut change.undo);
        let numbers: Vec<_> = undo.iter().flatten().map(|(number, _)| *number).collect();
        change.steps = undo.into_iter().rev().map(Step::Assign).collect();
        change.steps.extend(numbers.into_iter().map(Step::Read));
        self.next_of_change();
    }

    fn end_change(&mut self, error: Option<String>) {
        let Some(change) = self.settings.change.take() else { return };
        if error.is_none() && change.failed.is_some() {
            self.settings.unsaved = change.was_unsaved;
        }
        let undone = change.failed.map(|why| format!("{why}; the settings are as before"));
        let result = error.or(undone).map_or(Ok(change.ok), Err);
        self.answer(change.asker, result);
        self.tell_settings();
    }

    /// A stop came first, or the board is gone.
    pub(super) fn settings_were_interrupted(&mut self, why: &str) {
        if let Some(reading) = &mut self.settings.reading {
            reading.is_asked = false;
        }
        if let Some(change) = self.settings.change.take() {
            let error =
                format!("interrupted, as {why}: some may be set or saved, see what is in force");
            self.answer(change.asker, Err(error));
            self.read_settings();
        }
    }

    /// A save or a reset is done.
    pub(super) fn was_kept(&mut self, action: Action) {
        self.settings.unsaved = false;
        if action == Action::FactoryReset {
            self.read_settings();
        } else {
            self.tell_settings();
        }
    }

    /// Reads on.
    pub(super) fn advance_settings(&mut self) {
        let Some(reading) = &mut self.settings.reading else { return };
        // What a job has set is soon set back.
        if reading.is_asked || self.settings.change.is_some() || self.motion.job.is_some() {
            return;
        }
        let next = match reading.list.last() {
            None => Some(0),
            // A list that does not rise would have no end.
            Some(last) => last.next.filter(|&next| next > last.number),
        };
        match next {
            Some(number) => {
                reading.is_asked = true;
                let purpose = Purpose::ReadSetting(reading.number);
                self.ask(&Request::Setting(number), purpose);
            }
            None => {
                if let Some(reading) = self.settings.reading.take() {
                    self.settings.list = reading.list;
                    self.tell_settings();
                }
            }
        }
    }

    pub(super) fn setting_is_read(&mut self, of: u64, result: Result<Reply, Failure>) {
        let reading = self.settings.reading.as_mut().filter(|reading| reading.number == of);
        let Some(reading) = reading else { return };
        match result {
            Ok(Reply::Setting(setting)) => {
                reading.is_asked = false;
                reading.list.push(setting.clone());
                self.learn(&setting);
            }
            _ => {
                self.settings.reading = None;
                self.note("the settings could not be read: Read again");
            }
        }
    }
}

/// What a file would change.
fn told(plan: &Plan) -> Value {
    let differ = |(setting, value): &(Setting, i32)| json!({ "name": setting.name, "board": setting.value, "file": value });
    json!({
        "differ": plan.changes.iter().map(differ).collect::<Vec<_>>(),
        "missing": plan.missing,
    })
}
