//! Setting, checking and telling settings by their numbers.

use super::table::{Row, TABLE, row};
use super::{Settings, Unit, has_sensor};
use crate::units::ServoPulse;

/// Why a setting does not take a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SettingRefused {
    /// No setting has this number.
    NoSuchSetting(u16),
    /// The value is out of this setting's range.
    OutOfRange(u16),
    /// This setting contradicts another.
    Contradiction(u16),
}

/// A setting, with all that is known of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Setting {
    /// Its number.
    pub number: u16,
    /// The next setting's, `None` behind the last.
    pub next: Option<u16>,
    /// Its value.
    pub value: i32,
    /// Its lowest and its highest value.
    pub range: (i32, i32),
    /// Its value until somebody says otherwise.
    pub default: i32,
    /// What the values count.
    pub unit: Unit,
    /// Its name, ASCII.
    pub name: &'static str,
    /// Of several of this name (channels, joints), which: 1 to 6.
    pub member: Option<u8>,
}

impl core::fmt::Display for Setting {
    /// Its name, and which it is.
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self.member {
            Some(member) => write!(f, "{} {member}", self.name),
            None => f.write_str(self.name),
        }
    }
}

// The rows that may contradict others.
const SONAR_CLEAR: &Row = row("sonar clear");
const INFRARED_CLEAR: &Row = row("infrared clear");
const SOFT_LIMIT_HIGH: &Row = row("soft limit high");
const SENSOR: &Row = row("sensor");
const JOINT_HOME: &Row = row("joint home");
const JOINT_MAX: &Row = row("joint max");
const JOINT_TICKS_PER_90: &Row = row("joint ticks per 90");

/// The row of a setting, and its place there.
fn find(number: u16) -> Option<(&'static Row, usize)> {
    let place =
        |row: &'static Row| Some((row, (0..row.count()).find(|&n| row.number(n) == number)?));
    TABLE.iter().find_map(place)
}

/// The lowest number above this one.
fn next(number: u16) -> Option<u16> {
    let of_row = |row: &Row| (0..row.count()).map(|n| row.number(n)).find(|&next| next > number);
    TABLE.iter().filter_map(of_row).min()
}

impl Settings {
    /// Sets one of them. Set all that belong together, then [`check`](Self::check) them.
    ///
    /// # Errors
    /// Says what is wrong; nothing is changed then.
    pub fn set(&mut self, number: u16, value: i32) -> Result<(), SettingRefused> {
        let (row, n) = find(number).ok_or(SettingRefused::NoSuchSetting(number))?;
        let (low, high) = row.range;
        if !(low..=high).contains(&value) {
            return Err(SettingRefused::OutOfRange(number));
        }
        row.set(self, n, value);
        Ok(())
    }

    /// Whether they agree with each other.
    ///
    /// # Errors
    /// [`SettingRefused::Contradiction`] names the first that does not.
    pub fn check(&self) -> Result<(), SettingRefused> {
        let contradiction = |row: &Row, n| Err(SettingRefused::Contradiction(row.number(n)));
        let collision = &self.control.collision;
        if collision.sonar_clear_cm < collision.sonar_stop_cm {
            return contradiction(SONAR_CLEAR, 0);
        }
        if collision.ir_clear > collision.ir_stop {
            return contradiction(INFRARED_CLEAR, 0);
        }
        for (n, soft) in self.control.soft_limits.iter().enumerate() {
            if soft.high < soft.low {
                return contradiction(SOFT_LIMIT_HIGH, n);
            }
        }
        for (n, channel) in self.control.channels.iter().enumerate() {
            if channel.sensor.is_some_and(|sensor| !has_sensor(n, sensor)) {
                return contradiction(SENSOR, n);
            }
        }
        for (n, joint) in self.arm.joints.iter().enumerate() {
            let is_given = |ticks| {
                let pulse = joint.pulse(ticks);
                i32::from(ServoPulse::from_raw(pulse).raw()) == pulse
            };
            if joint.max < joint.min {
                return contradiction(JOINT_MAX, n);
            }
            if !(joint.min..=joint.max).contains(&joint.home) {
                return contradiction(JOINT_HOME, n);
            }
            if !is_given(joint.min) || !is_given(joint.max) {
                return contradiction(JOINT_TICKS_PER_90, n);
            }
        }
        Ok(())
    }

    /// All of them, with their numbers, in the order of the rows.
    pub fn iter(&self) -> impl Iterator<Item = (u16, i32)> {
        let of_row =
            |row: &'static Row| (0..row.count()).map(|n| (row.number(n), row.get(self, n)));
        TABLE.iter().flat_map(of_row)
    }

    /// Everything about the setting of this number, about the first for number 0; `None` if there
    /// is none.
    pub fn describe(&self, number: u16) -> Option<Setting> {
        let number = if number == 0 { next(0)? } else { number };
        let (row, n) = find(number)?;
        Some(Setting {
            number,
            next: next(number),
            value: row.get(self, n),
            range: row.range,
            default: row.get(&Self::DEFAULT, n),
            unit: row.unit,
            name: row.name,
            member: row.member(n),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::table::{COUNT, DOCUMENTED, ROWS};
    use super::*;

    /// For people who read no Rust.
    const PAGE: &str = include_str!("../../../protocol/README.md");

    #[test]
    fn the_page_of_the_wire_has_the_settings_row_by_row() {
        // "208" of "| 198 + 10 n | ...": a bank stands where its first member does.
        let number = |row: &&str| -> u16 {
            let first = row.trim_start_matches("| ").split(" | ").next().unwrap();
            let terms = first.trim_end_matches(" n").split(" + ");
            terms.map(|term| term.parse::<u16>().unwrap()).sum()
        };
        let mut expected = ROWS.to_vec();
        expected.sort_by_key(number);
        let (_, section) = PAGE.split_once("\n## Settings by number\n").expect("the heading");
        let section = section.split("\n## ").next().unwrap();
        let is_row = |line: &&str| line.starts_with("| ") && !line.starts_with("| number");
        let told: Vec<_> = section.lines().filter(is_row).collect();
        assert_eq!(told, expected, "the table should be\n{}\n", expected.join("\n"));
    }

    /// What one unit of a gain is worth stands beside the code that multiplies it, too.
    #[test]
    fn the_page_of_the_wire_tells_what_gains_are_worth() {
        let rows = include_str!("../control/pid.rs").lines();
        let rows: Vec<_> = rows.filter_map(|line| line.strip_prefix("//! |")).collect();
        assert_eq!(rows.len(), 6, "heading, rule, Kp, Kd, Ki, the most that counts");
        for row in rows {
            assert!(PAGE.contains(&format!("\n|{row}\n")), "|{row}");
        }
    }

    #[test]
    fn every_default_is_the_documented_one_and_in_range() {
        Settings::DEFAULT.check().unwrap();
        let mut checked = 0;
        assert_eq!(TABLE.len(), DOCUMENTED.len());
        for (row, documented) in TABLE.iter().zip(DOCUMENTED) {
            for n in 0..row.count() {
                let default = row.get(&Settings::DEFAULT, n);
                assert_eq!(default, *documented, "{}", row.name);
                assert!((row.range.0..=row.range.1).contains(&default), "{}", row.name);
                checked += 1;
            }
        }
        assert_eq!(checked, COUNT);
    }

    #[test]
    fn every_setting_takes_its_whole_range_and_nothing_beyond_and_no_other_with_it() {
        for (set, _) in Settings::DEFAULT.iter() {
            let Setting { range: (low, high), name, .. } = Settings::DEFAULT.describe(set).unwrap();
            for value in [low, low + 1, high / 2, high - 1, high] {
                let mut settings = Settings::DEFAULT;
                settings.set(set, value.max(low)).unwrap();
                for (number, now) in settings.iter() {
                    let default = settings.describe(number).unwrap().default;
                    let expected = if number == set { value.max(low) } else { default };
                    assert_eq!(now, expected, "{number} after {name} = {value}");
                }
            }
            for value in [i32::MIN, low - 1, high + 1, i32::MAX] {
                let mut settings = Settings::DEFAULT;
                let refused = settings.set(set, value);
                assert_eq!(refused, Err(SettingRefused::OutOfRange(set)));
                assert_eq!(settings, Settings::DEFAULT);
            }
        }
        assert_eq!(Settings::DEFAULT.iter().count(), COUNT);
        let mut settings = Settings::DEFAULT;
        assert_eq!(settings.set(999, 0), Err(SettingRefused::NoSuchSetting(999)));
    }

    #[test]
    fn a_host_walks_through_all_settings_from_number_0_in_their_order() {
        let mut walked = Vec::new();
        let mut next = Some(0);
        while let Some(number) = next {
            let description = Settings::DEFAULT.describe(number).unwrap();
            walked.push((description.number, description.to_string()));
            next = description.next;
        }
        assert!(walked.is_sorted_by(|a, b| a.0 < b.0), "no number twice");
        assert_eq!(walked.len(), COUNT);
        let named = |number| &*walked.iter().find(|setting| setting.0 == number).unwrap().1;
        assert_eq!((named(80), named(91)), ("soft limit low 1", "soft limit high 6"));
        assert_eq!((named(128), named(173)), ("joint speed 1", "joint ticks per 90 6"));
        assert_eq!(Settings::DEFAULT.describe(15), None);
    }

    #[test]
    fn settings_that_cross_contradict_each_other() {
        let contradiction = |assignments: &[(u16, i32)]| {
            let mut settings = Settings::DEFAULT;
            assignments.iter().for_each(|&(number, value)| settings.set(number, value).unwrap());
            settings.check().err()
        };
        let refused = |number| Some(SettingRefused::Contradiction(number));
        assert_eq!(contradiction(&[(16, 36)]), refused(17));
        assert_eq!(contradiction(&[(16, 36), (17, 36)]), None);
        assert_eq!(contradiction(&[(19, 1679)]), refused(19));
        assert_eq!(contradiction(&[(19, 1679), (18, 1679)]), None);
        assert_eq!(contradiction(&[(84, 1000)]), refused(85));
        assert_eq!(contradiction(&[(84, 1000), (85, 1000)]), None);
        // Joint 2: home beyond its ends, ends the wrong way round, pulses that the board cannot
        // give.
        assert_eq!(contradiction(&[(138, 128)]), refused(137));
        assert_eq!(contradiction(&[(138, 127)]), None);
        assert_eq!(contradiction(&[(140, 126)]), refused(137));
        assert_eq!(contradiction(&[(140, 100), (138, 101)]), refused(140));
        // 127 ticks down from 1.5 ms: 0.22 ms at 99.4 ticks a millisecond.
        assert_eq!(contradiction(&[(141, 99)]), refused(141));
        assert_eq!(contradiction(&[(141, 100)]), None);
        // 226 ticks up: 3.114 ms.
        assert_eq!(contradiction(&[(139, 29)]), refused(141));
        assert_eq!(contradiction(&[(139, 30)]), None);
    }
}
