//! Settings by name: read, set all or none, saved.

use protocol::extension::{Action, Assignments, Request};

use super::Client;
use crate::error::Error;
use crate::session::{Personality, Reply, Setting};
use crate::settings::{Settings, assignments, check, find, most, parts, with_name};

impl Client {
    /// All settings, as they are in force.
    ///
    /// # Errors
    /// As all requests; [`Error::NotCarried`] by a board without the extension.
    pub fn settings(&mut self) -> Result<Settings, Error> {
        self.settings_until(|_| false)
    }

    /// Settings up to the first that is `wanted`, or all.
    ///
    /// # Errors
    /// As [`settings`](Self::settings).
    pub fn settings_until(&mut self, wanted: impl Fn(&Setting) -> bool) -> Result<Settings, Error> {
        let mut settings = Settings::new();
        let mut next = Some(0);
        while let Some(number) = next {
            let setting = self.numbered(number)?;
            // A list that does not rise would have no end.
            next = setting.next.filter(|&next| next > setting.number && !wanted(&setting));
            settings.push(setting);
        }
        Ok(settings)
    }

    /// The setting of this name.
    ///
    /// # Errors
    /// [`Error::UnknownName`]; as all requests.
    pub fn setting(&mut self, name: &str) -> Result<Setting, Error> {
        let is_it = |setting: &Setting| setting.name.eq_ignore_ascii_case(name);
        find(&self.settings_until(is_it)?, name).cloned()
    }

    /// The setting of this number.
    pub(crate) fn numbered(&mut self, number: u16) -> Result<Setting, Error> {
        const WHAT: &str = "settings";
        self.needs_settings()?;
        match self.ask(&Request::Setting(number), WHAT)? {
            Reply::Setting(setting) => Ok(setting),
            _ => Err(Error::NoAnswer(WHAT)),
        }
    }

    fn needs_settings(&self) -> Result<(), Error> {
        if self.identity.is_some() {
            return Ok(());
        }
        let why = match self.personality() {
            Personality::Cm5 => "; they are constants of its firmware",
            _ => ": its firmware knows no extension; only ours has them",
        };
        Err(Error::NotCarried(self.personality(), "settings to be read or set", why))
    }

    /// Sets a setting. It is in force, and forgotten at the next start unless it is [saved](Self::save).
    ///
    /// # Errors
    /// [`Error::UnknownName`], [`Error::OutOfRange`], before anything is sent; as all requests.
    pub fn set(&mut self, name: &str, value: i32) -> Result<Setting, Error> {
        let setting = self.setting(name)?;
        self.set_known(&setting, value)
    }

    /// The same for one that was read before.
    ///
    /// # Errors
    /// As [`set`](Self::set).
    pub fn set_known(&mut self, setting: &Setting, value: i32) -> Result<Setting, Error> {
        check(setting, value.into())?;
        let assigned = self.assign(&[(setting.number, value)]);
        assigned.map_err(|error| with_name(error, std::slice::from_ref(setting)))?;
        self.numbered(setting.number)
    }

    /// Sets settings by number, all of them or, as far as that can be, none: so many as fit are taken in
    /// one control period. If a later request is refused, those before it are undone.
    ///
    /// # Errors
    /// As all requests.
    pub fn assign_all(&mut self, now: &[Setting], values: &[(u16, i32)]) -> Result<(), Error> {
        let parts = parts(values, most(self.personality()));
        for (k, part) in parts.iter().enumerate() {
            let Err(error) = self.assign(part) else { continue };
            // What has no answer may be in force.
            let refused = matches!(error, Error::Refused { .. });
            let error = with_name(error, now);
            for done in parts.iter().take(if refused { k } else { k + 1 }).rev() {
                let before: Vec<_> = done
                    .iter()
                    .filter_map(|&(number, _)| {
                        let setting = now.iter().find(|setting| setting.number == number)?;
                        Some((number, setting.value))
                    })
                    .collect();
                self.assign(&before).map_err(|second| Error::NotSet(format!(
                    "{error}; and the first settings could not be undone ({second}): they are in force, and not saved; restart the board to have those that were saved"
                )))?;
            }
            return Err(error);
        }
        Ok(())
    }

    fn assign(&mut self, values: &[(u16, i32)]) -> Result<(), Error> {
        let data = assignments(values)?;
        let assignments = Assignments::parse(&data)
            .map_err(|verdict| Error::Refused { verdict, setting: None })?;
        self.ask(&Request::Set(assignments), "setting settings").map(drop)
    }

    /// Saves the settings that are in force; only with all motors and servos off.
    ///
    /// # Errors
    /// As all requests.
    pub fn save(&mut self) -> Result<(), Error> {
        self.needs_settings()?;
        self.act(Action::Save, "a save of its settings")
    }

    /// The defaults, in force and saved; only with all motors and servos off.
    ///
    /// # Errors
    /// As all requests.
    pub fn factory_reset(&mut self) -> Result<(), Error> {
        self.needs_settings()?;
        self.act(Action::FactoryReset, "a factory reset")
    }
}
