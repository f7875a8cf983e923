//! Settings in a file: TOML, by name, each with its unit, range and default beside it.
//!
//! A file is checked whole against the board before anything is sent. What a file does not hold is named,
//! and stays as it is; nothing is left out of one. What is no setting is in no backup: encoder counts,
//! the LCD's picture, faults on record.

use std::fmt::Write;

use protocol::extension::Identity;

use crate::error::Error;
use crate::session::{Personality, Setting};
use crate::settings::{self, Settings};
use crate::words;

/// The form of the file. It rises when an older handwheel would misread it.
const FORMAT: i64 = 1;

/// How a kind of board is called in a file.
fn kind(personality: Personality) -> &'static str {
    match personality {
        Personality::Pms5005 => "pms5005",
        Personality::Arcos => "pioneer-arm",
        Personality::Cm5 => "cm5",
    }
}

/// The text of a backup.
pub fn write(personality: Personality, identity: Identity, settings: &[Setting]) -> String {
    let [major, minor, patch] = identity.version;
    let mut text = format!(
        "# Settings of {personality}, as `handwheel backup` found them in force. `handwheel restore` puts them\n\
         # back, `handwheel diff` compares. A channel's number, 1 to 6, stands behind a name.\n\
         \n[handwheel]\nformat = {FORMAT}\nboard = \"{}\"\nfirmware = \"{major}.{minor}.{patch}\"\nextension = {}\ncount = {}\n\n[settings]\n",
        kind(personality),
        identity.extension,
        settings.len(),
    );
    for setting in settings {
        let (low, high) = setting.range;
        let unit = match words::unit(setting.unit) {
            "" => String::new(),
            unit => format!("{unit}; "),
        };
        let name = toml_string(&setting.name);
        // A String takes everything.
        let _ = writeln!(text, "# {unit}{low} to {high}, default {}", setting.default);
        let _ = writeln!(text, "{name} = {}", setting.value);
    }
    text
}

/// A name of ASCII, between quotes.
fn toml_string(name: &str) -> String {
    format!("\"{}\"", name.replace('\\', "\\\\").replace('"', "\\\""))
}

/// What is in a file: names and values, all known to the board and in range.
#[derive(Debug, PartialEq, Eq)]
pub struct Plan {
    /// Those that differ: the setting as it is on the board, and the file's value.
    pub changes: Vec<(Setting, i32)>,
    /// The board's settings that the file does not hold.
    pub missing: Vec<String>,
}

/// Reads a file, and checks all of it against the board's settings.
///
/// # Errors
/// [`Error::File`]: no TOML, not a backup, another kind of board, a newer form or firmware, an end that is
/// missing, a name that is not known; [`Error::OutOfRange`]. One line each, about the first thing
/// that is wrong.
pub fn check(
    text: &str,
    personality: Personality,
    identity: Identity,
    board: &Settings,
) -> Result<Plan, Error> {
    let wrong = |what: String| Error::File(what);
    let table: toml::Table = text.parse().map_err(|error: toml::de::Error| {
        let line = error
            .span()
            .map_or(0, |span| text.get(..span.start).unwrap_or_default().matches('\n').count() + 1);
        wrong(format!("line {line}: no TOML: {}", error.message().replace('\n', " ")))
    })?;
    let no_backup = || {
        wrong("not a backup of handwheel: it has no [handwheel] with format and board, or no [settings]".into())
    };
    let head = table.get("handwheel").and_then(toml::Value::as_table).ok_or_else(no_backup)?;
    let format = head.get("format").and_then(toml::Value::as_integer).ok_or_else(no_backup)?;
    if format != FORMAT {
        return Err(wrong(format!(
            "written by another handwheel (format {format}, this one reads {FORMAT}): use that one"
        )));
    }
    let of = head.get("board").and_then(toml::Value::as_str).ok_or_else(no_backup)?;
    if of != kind(personality) {
        return Err(wrong(format!("a backup of a {of}, and this is {personality}: take its own")));
    }
    let settings = table.get("settings").and_then(toml::Value::as_table).ok_or_else(no_backup)?;
    if let Some(stranger) =
        table.keys().find(|key| !matches!(key.as_str(), "handwheel" | "settings"))
    {
        return Err(wrong(format!("[{stranger}] is not known; it may be a newer version's")));
    }
    let extension = head.get("extension").and_then(toml::Value::as_integer).unwrap_or(0);
    if extension > identity.extension.into() {
        let firmware = head.get("firmware").and_then(toml::Value::as_str).unwrap_or("a newer one");
        return Err(wrong(format!(
            "a backup of firmware {firmware} (extension {extension}), which is newer than the board's \
             (extension {}): bring the board up to date first",
            identity.extension
        )));
    }
    let count = head.get("count").and_then(toml::Value::as_integer);
    if let Some(count) = count.filter(|&count| count > settings.len() as i64) {
        return Err(wrong(format!(
            "it has {} settings, and says that it has {count}: a part is missing; if you have cut it \
             yourself, set `count` in [handwheel] to {}",
            settings.len(),
            settings.len()
        )));
    }
    let mut changes: Vec<(Setting, i32)> = Vec::new();
    let mut seen: Vec<u16> = Vec::new();
    for (name, value) in settings {
        let setting = settings::find(board, name).map_err(|error| wrong(error.to_string()))?;
        if seen.contains(&setting.number) {
            return Err(wrong(format!("{name}: it is there twice")));
        }
        seen.push(setting.number);
        let value =
            value.as_integer().ok_or_else(|| wrong(format!("{name}: a whole number is wanted")))?;
        let value = settings::check(setting, value)?;
        if value != setting.value {
            changes.push((setting.clone(), value));
        }
    }
    let is_missing =
        |setting: &&Setting| !settings.keys().any(|name| name.eq_ignore_ascii_case(&setting.name));
    let missing = board.iter().filter(is_missing).map(|setting| setting.name.clone()).collect();
    Ok(Plan { changes, missing })
}

#[cfg(test)]
mod tests {
    use protocol::extension::{Origin, ResetCause, Unit};

    use super::*;

    const IDENTITY: Identity = Identity {
        version: [0, 1, 0],
        extension: 2,
        reset: ResetCause::Power,
        settings: Origin::Stored,
    };

    fn board() -> Settings {
        let setting = |number, name: &str, value, range, unit| Setting {
            number,
            next: None,
            name: name.into(),
            value,
            range,
            default: 0,
            unit,
        };
        vec![
            setting(32, "telemetry period", 50, (1, 60_000), Unit::Milliseconds),
            setting(80, "soft limit low 1", -3, (-10, 32_767), Unit::Counts),
        ]
    }

    fn text() -> String {
        write(Personality::Pms5005, IDENTITY, &board())
    }

    #[test]
    fn what_is_written_is_read_back_and_tells_unit_range_and_default() {
        let plan = check(&text(), Personality::Pms5005, IDENTITY, &board()).unwrap();
        assert_eq!(plan, Plan { changes: vec![], missing: vec![] });
        assert!(text().contains("# ms; 1 to 60000, default 0\n\"telemetry period\" = 50\n"));
    }

    #[test]
    fn what_differs_and_what_is_missing_is_told() {
        let changed = text()
            .replace("= 50", "= 20")
            .replace("\"soft limit low 1\" = -3\n", "")
            .replace("count = 2", "count = 1");
        let plan = check(&changed, Personality::Pms5005, IDENTITY, &board()).unwrap();
        assert_eq!(plan.changes, [(board()[0].clone(), 20)]);
        assert_eq!(plan.missing, ["soft limit low 1"]);
    }

    #[test]
    fn a_wrong_file_is_one_line_that_names_what_is_wrong() {
        let cases = [
            (
                text().replace("telemetry period\"", "telemetri period\""),
                "did you mean \"telemetry period\"",
            ),
            (
                text().replace("= 50", "= 60001"),
                "telemetry period: 60001 is out of range, 1 to 60000",
            ),
            (text().replace("= 50", "= 99999999999"), "out of range"),
            (text().replace("= 50", "= \"fast\""), "whole number"),
            (text().replace("format = 1", "format = 2"), "another handwheel"),
            (text().replace("format = 1", "format = -1"), "another handwheel"),
            (text().replace("extension = 2", "extension = 3"), "newer than the board's"),
            (text().replace("\"soft limit low 1\" = -3\n", ""), "a part is missing"),
            (
                text().replace("soft limit low 1\" = -3", "Telemetry Period\" = 7"),
                "it is there twice",
            ),
            (text().replace("\"pms5005\"", "\"pioneer-arm\""), "a backup of a pioneer-arm"),
            (text().replace("[settings]", "[setings]"), "not a backup"),
            (text().replace("= 50", "="), "line 13: no TOML"),
            (text() + "\"telemetry period\" = 1\n", "no TOML"),
            (text() + "[extra]\n", "[extra]"),
            (String::new(), "not a backup"),
        ];
        for (text, says) in cases {
            let error =
                check(&text, Personality::Pms5005, IDENTITY, &board()).unwrap_err().to_string();
            assert!(error.contains(says) && !error.contains('\n'), "{says}: {error}");
        }
    }
}
