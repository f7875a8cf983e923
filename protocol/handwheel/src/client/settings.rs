//! Settings by name.

use protocol::extension::{Action, Assignments, Request};
use protocol::pms5005::Data;

use super::Client;
use crate::error::Error;
use crate::session::{Personality, Reply, Setting};
use crate::words;

/// Settings, as a board tells them, in the order of their numbers.
pub type Settings = Vec<Setting>;

/// Settings in one request, which the board takes in one control period, all or none: as many as a
/// PMS5005's frame and an ARCOS packet hold.
pub(crate) fn most(personality: Personality) -> usize {
    if personality == Personality::Arcos { 27 } else { 36 }
}

/// The setting of this name.
///
/// # Errors
/// [`Error::UnknownName`], with the nearest.
pub fn find<'a>(settings: &'a [Setting], name: &str) -> Result<&'a Setting, Error> {
    let found = settings.iter().find(|setting| setting.name.eq_ignore_ascii_case(name));
    found.ok_or_else(|| {
        let names = settings.iter().map(|setting| setting.name.as_str());
        Error::UnknownName { name: name.into(), nearest: words::nearest(name, names) }
    })
}

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

/// The DATA of a request that sets these.
pub(crate) fn assignments(values: &[(u16, i32)]) -> Result<Data, Error> {
    let mut data = Data::new();
    for (number, value) in values {
        Assignments::emit(*number, *value, &mut data)
            .map_err(|_| Error::NoAnswer("setting settings"))?;
    }
    Ok(data)
}

/// A refusal with the name of the setting that it is about.
pub(crate) fn with_name(error: Error, settings: &[Setting]) -> Error {
    match error {
        Error::Refused { verdict, setting: Some(number) } => {
            let is_it = |setting: &&Setting| number_of(setting.number) == number;
            let name = settings.iter().find(is_it).map(|setting| setting.name.clone());
            Error::Refused { verdict, setting: name.or(Some(number)) }
        }
        other => other,
    }
}

/// How a setting is called whose name is not known.
pub(crate) fn number_of(number: u16) -> String {
    format!("setting {number}")
}

/// Whether a value is in its setting's range.
///
/// # Errors
/// [`Error::OutOfRange`].
pub(crate) fn check(setting: &Setting, value: i64) -> Result<i32, Error> {
    let (low, high) = setting.range;
    let wrong = || Error::OutOfRange { name: setting.name.clone(), value, low, high };
    let value = i32::try_from(value).map_err(|_| wrong())?;
    if (low..=high).contains(&value) { Ok(value) } else { Err(wrong()) }
}

/// Requests' worth of assignments. Settings whose numbers follow each other may depend on each other (a low
/// limit and its high one), and the board looks at each request by itself: they stay together, where
/// that many fit.
pub(crate) fn parts(values: &[(u16, i32)], most: usize) -> Vec<Vec<(u16, i32)>> {
    let mut values = values.to_vec();
    values.sort_unstable();
    let mut parts: Vec<Vec<(u16, i32)>> = Vec::new();
    for run in values.chunk_by(|(a, _), (b, _)| b - a <= 1) {
        // Cut evenly, and between pairs: banks of pairs begin with an even number.
        let pieces = run.len().div_ceil(most);
        let size = run.len().div_ceil(pieces).next_multiple_of(2).min(most);
        for piece in run.chunks(size) {
            match parts.last_mut() {
                Some(part) if part.len() + piece.len() <= most => part.extend(piece),
                _ => parts.push(piece.to_vec()),
            }
        }
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbours_stay_in_one_request() {
        let values: Vec<_> = (1..=6).chain(16..=23).chain(48..=79).map(|n| (n, 0)).collect();
        let parts = parts(&values, 36);
        assert_eq!(parts.concat(), values);
        assert_eq!(parts.iter().map(Vec::len).collect::<Vec<_>>(), [14, 32]);
    }

    #[test]
    fn what_is_longer_than_a_request_is_cut_between_pairs() {
        let values: Vec<_> = (64..=93).map(|n| (n, 0)).collect();
        let parts = parts(&values, 27);
        assert_eq!(parts.concat(), values);
        assert!(parts.iter().all(|part| part.len() <= 27 && part[0].0 % 2 == 0));
    }
}
