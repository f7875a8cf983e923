//! Settings: found by name, checked, cut into requests; and what one of them means to a host.

use protocol::arcos::{Dialect, MotionBits};
use protocol::extension::Assignments;
use protocol::pms5005::Data;

use crate::error::Error;
use crate::session::{Personality, Setting};
use crate::words;

/// Number of the setting "link timeout".
pub(crate) const LINK_TIMEOUT: u16 = 1;

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

/// How an arm's state is read, by its setting "arm dialect".
pub(crate) fn dialect(setting: Option<i32>) -> Dialect {
    match setting {
        Some(1) => Dialect::Manual(MotionBits::ZeroToFive),
        Some(2) => Dialect::Aria,
        _ => Dialect::Manual(MotionBits::OneToSix),
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
            let is_it = |setting: &&Setting| words::setting(setting.number) == number;
            let name = settings.iter().find(is_it).map(|setting| setting.name.clone());
            Error::Refused { verdict, setting: name.or(Some(number)) }
        }
        other => other,
    }
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
