//! The settings by number: one table of what each is called, counts and may be.
//!
//! Numbers never change their meaning and are never given again: they are on the wire (DIDs 7 and
//! 96) and in the flash. A value is a whole number; 0 and 1 stand for no and yes.
//!
//! It holds what the controller and the PMS5005's session have. The Pioneer Arm's settings are not
//! in it: they are chosen when its board is made, and are not stored.

use protocol::pms5005::extension::{Description, Unit};

use super::{KiReading, Settings};

/// One setting.
struct Row {
    number: u16,
    name: &'static str,
    unit: Unit,
    /// Lowest and highest value.
    range: (i32, i32),
    get: fn(&Settings) -> i32,
    /// Only called with values in range, so that they fit their fields.
    set: fn(&mut Settings, i32),
}

/// Why a setting does not take a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum SettingRefused {
    /// No setting has this number.
    NoSuchSetting(u16),
    /// The value is out of this setting's range.
    OutOfRange(u16),
    /// This setting contradicts another.
    Contradiction(u16),
}

macro_rules! settings {
    ($($number:literal, $name:literal, $unit:ident, $low:literal, $high:literal, $default:literal,
        $what:literal, $get:expr, $set:expr;)+) => {
        /// Every setting, in the order of the numbers. All take effect in the control period after
        /// they were set; what a host has sent before (gains, say) stays as it was read then.
        ///
        /// | number | name | unit | range | default | what it is |
        /// |---|---|---|---|---|---|
        $(#[doc = concat!("| ", $number, " | ", $name, " | ", stringify!($unit), " | ", $low,
            " to ", $high, " | ", $default, " | ", $what, " |")])+
        pub const NUMBERS: &[u16] = &[$($number),+];

        const TABLE: &[Row] = &[$(Row {
            number: $number,
            name: $name,
            unit: Unit::$unit,
            range: ($low, $high),
            get: $get,
            set: $set,
        }),+];

        /// The defaults as the documentation has them.
        #[cfg(test)]
        const DOCUMENTED: &[i32] = &[$($default),+];
    };
}

settings! {
    1, "link timeout", Milliseconds, 0, 60000, 2000,
        "silence of the host after which moving channels are stopped; 0 never stops them",
        |s| s.control.link_timeout.into(), |s, v| s.control.link_timeout = v as u16;
    2, "Ki reading", Choice, 0, 2, 0,
        "how the two bytes of Ki are read: 0 M + N/100, 1 M + N/256, 2 a word of hundredths",
        |s| s.control.ki_reading as i32, |s, v| s.control.ki_reading = ki_reading(v);
    3, "full speed encoder", CountsPerSecond, 0, 8000000, 16384,
        "an encoder's speed at full drive, for feed-forward; 0 is none",
        |s| s.control.full_speed_encoder as i32, |s, v| s.control.full_speed_encoder = v as u32;
    4, "full speed potentiometer", CountsPerSecond, 0, 8000000, 4096,
        "a potentiometer's speed at full drive, for feed-forward; 0 is none",
        |s| s.control.full_speed_potentiometer as i32,
        |s, v| s.control.full_speed_potentiometer = v as u32;
    16, "sonar stop", Centimetres, 0, 254, 30,
        "collision protection: an ultrasonic range that stops forward drive",
        |s| s.control.collision.sonar_stop_cm.into(),
        |s, v| s.control.collision.sonar_stop_cm = v as u8;
    17, "sonar clear", Centimetres, 0, 254, 35,
        "above this range it lets go; not below 16",
        |s| s.control.collision.sonar_clear_cm.into(),
        |s, v| s.control.collision.sonar_clear_cm = v as u8;
    18, "infrared stop", AdCounts, 0, 4095, 1678,
        "collision protection: an infrared reading that stops forward drive (1678 is 20 cm)",
        |s| s.control.collision.ir_stop.into(), |s, v| s.control.collision.ir_stop = v as u16;
    19, "infrared clear", AdCounts, 0, 4095, 1388,
        "below this reading it lets go (1388 is 25 cm); not above 18",
        |s| s.control.collision.ir_clear.into(), |s, v| s.control.collision.ir_clear = v as u16;
    20, "sonars forward", Bits, 0, 63, 63,
        "which ultrasonic sensors look forward: bit 0 is sensor 1",
        |s| s.control.collision.sonar_forward.into(),
        |s, v| s.control.collision.sonar_forward = v as u8;
    21, "wheel 1 forward rises", Flag, 0, 1, 1,
        "whether rising counts of channel 0 drive the robot forward",
        |s| s.control.collision.forward_is_positive[0].into(),
        |s, v| s.control.collision.forward_is_positive[0] = v != 0;
    22, "wheel 2 forward rises", Flag, 0, 1, 1,
        "whether rising counts of channel 1 drive the robot forward",
        |s| s.control.collision.forward_is_positive[1].into(),
        |s, v| s.control.collision.forward_is_positive[1] = v != 0;
    32, "telemetry period", Milliseconds, 1, 60000, 50,
        "period of every telemetry stream",
        |s| s.link.telemetry_period_ms.into(), |s, v| s.link.telemetry_period_ms = v as u16;
    48, "over-current", AdCounts, 0, 4095, 3640,
        "fault 1: a motor current that is limited (3640 is 5 A); 0 never is",
        |s| s.control.channel_faults.over_current.into(), |s, v| s.control.channel_faults.over_current = v as u16;
    49, "over-current time", Milliseconds, 0, 60000, 2000,
        "fault 1: how long it may be limited; 0 for ever",
        |s| s.control.channel_faults.over_current_ms.into(), |s, v| s.control.channel_faults.over_current_ms = v as u16;
    50, "driven", Duty, 1, 16384, 8192,
        "faults 2 to 4: a channel is driven from this duty on",
        |s| s.control.channel_faults.driven.into(), |s, v| s.control.channel_faults.driven = v as u16;
    51, "stall current", AdCounts, 0, 4095, 728,
        "faults 2, 4: what a shaft that is held fast draws at full drive, at least (728 is 1 A)",
        |s| s.control.channel_faults.stall_current.into(), |s, v| s.control.channel_faults.stall_current = v as u16;
    52, "stall time", Milliseconds, 0, 60000, 6000,
        "fault 2: how long a driven shaft may be held fast; 0 for ever",
        |s| s.control.channel_faults.stall_ms.into(), |s, v| s.control.channel_faults.stall_ms = v as u16;
    53, "sensor time", Milliseconds, 0, 60000, 500,
        "fault 4: how long a driven loop may see no motion; 0 for ever",
        |s| s.control.channel_faults.sensor_ms.into(), |s, v| s.control.channel_faults.sensor_ms = v as u16;
    54, "rail time", Milliseconds, 0, 60000, 250,
        "fault 4: the same at an end of a potentiometer; 0 for ever",
        |s| s.control.channel_faults.rail_ms.into(), |s, v| s.control.channel_faults.rail_ms = v as u16;
    55, "sensor jump", Counts, 0, 4095, 128,
        "fault 4: what no potentiometer moves in a control period; 0 is anything",
        |s| s.control.channel_faults.jump.into(), |s, v| s.control.channel_faults.jump = v as u16;
    56, "tracking position", Counts, 0, 32767, 512,
        "fault 3: how far a position loop may be off",
        |s| s.control.channel_faults.tracking_position.into(), |s, v| s.control.channel_faults.tracking_position = v as u16;
    57, "tracking velocity", CountsPerSecond, 0, 65535, 2048,
        "fault 3: how far a velocity loop may be off",
        |s| s.control.channel_faults.tracking_velocity.into(), |s, v| s.control.channel_faults.tracking_velocity = v as u16;
    58, "tracking time", Milliseconds, 0, 30000, 1500,
        "fault 3: how long a loop may be astray or hunt; 0 for ever",
        |s| s.control.channel_faults.tracking_ms.into(), |s, v| s.control.channel_faults.tracking_ms = v as u16;
    64, "motor battery low", AdCounts, 0, 4095, 853,
        "fault 16: below this (853 is 5 V); 0 is off",
        |s| s.control.board_faults.motor_battery_low.into(), |s, v| s.control.board_faults.motor_battery_low = v as u16;
    65, "motor battery high", AdCounts, 0, 4095, 0,
        "fault 17: from this on (171 is 1 V); 0 is off",
        |s| s.control.board_faults.motor_battery_high.into(), |s, v| s.control.board_faults.motor_battery_high = v as u16;
    66, "servo battery low", AdCounts, 0, 4095, 1820,
        "fault 18: below this (1820 is 4 V); 0 is off",
        |s| s.control.board_faults.servo_battery_low.into(), |s, v| s.control.board_faults.servo_battery_low = v as u16;
    67, "main battery low", AdCounts, 0, 4095, 2002,
        "fault 19: below this (2002 is 4.4 V); 0 is off",
        |s| s.control.board_faults.main_battery_low.into(), |s, v| s.control.board_faults.main_battery_low = v as u16;
    68, "driver hot", AdCounts, 0, 4095, 1096,
        "fault 20: below this (1096 is 90 degrees, less is hotter); 0 is off",
        |s| s.control.board_faults.driver_hot.into(), |s, v| s.control.board_faults.driver_hot = v as u16;
    69, "ambient hot", AdCounts, 0, 4095, 3692,
        "fault 21: from this on (3692 is 70 degrees); 0 is off",
        |s| s.control.board_faults.ambient_hot.into(), |s, v| s.control.board_faults.ambient_hot = v as u16;
    70, "battery and heat time", Milliseconds, 0, 60000, 1000,
        "faults 16 to 21: how long it must last",
        |s| s.control.board_faults.lasts_ms.into(), |s, v| s.control.board_faults.lasts_ms = v as u16;
    71, "missed periods", Milliseconds, 0, 9000, 100,
        "fault 23: so many missed in a row; 0 is off",
        |s| s.control.board_faults.missed_periods.into(), |s, v| s.control.board_faults.missed_periods = v as u16;
    80, "soft limit 0 low", Counts, 0, 32767, 0,
        "channel 0 is driven no lower; equal to the next one it is off",
        |s| s.control.soft_limits[0].low.into(), |s, v| s.control.soft_limits[0].low = v as i16;
    81, "soft limit 0 high", Counts, 0, 32767, 0,
        "channel 0 is driven no higher; not below the one before",
        |s| s.control.soft_limits[0].high.into(), |s, v| s.control.soft_limits[0].high = v as i16;
    82, "soft limit 1 low", Counts, 0, 32767, 0,
        "channel 1 is driven no lower; equal to the next one it is off",
        |s| s.control.soft_limits[1].low.into(), |s, v| s.control.soft_limits[1].low = v as i16;
    83, "soft limit 1 high", Counts, 0, 32767, 0,
        "channel 1 is driven no higher; not below the one before",
        |s| s.control.soft_limits[1].high.into(), |s, v| s.control.soft_limits[1].high = v as i16;
    84, "soft limit 2 low", Counts, 0, 32767, 0,
        "channel 2 is driven no lower; equal to the next one it is off",
        |s| s.control.soft_limits[2].low.into(), |s, v| s.control.soft_limits[2].low = v as i16;
    85, "soft limit 2 high", Counts, 0, 32767, 0,
        "channel 2 is driven no higher; not below the one before",
        |s| s.control.soft_limits[2].high.into(), |s, v| s.control.soft_limits[2].high = v as i16;
    86, "soft limit 3 low", Counts, 0, 32767, 0,
        "channel 3 is driven no lower; equal to the next one it is off",
        |s| s.control.soft_limits[3].low.into(), |s, v| s.control.soft_limits[3].low = v as i16;
    87, "soft limit 3 high", Counts, 0, 32767, 0,
        "channel 3 is driven no higher; not below the one before",
        |s| s.control.soft_limits[3].high.into(), |s, v| s.control.soft_limits[3].high = v as i16;
    88, "soft limit 4 low", Counts, 0, 32767, 0,
        "channel 4 is driven no lower; equal to the next one it is off",
        |s| s.control.soft_limits[4].low.into(), |s, v| s.control.soft_limits[4].low = v as i16;
    89, "soft limit 4 high", Counts, 0, 32767, 0,
        "channel 4 is driven no higher; not below the one before",
        |s| s.control.soft_limits[4].high.into(), |s, v| s.control.soft_limits[4].high = v as i16;
    90, "soft limit 5 low", Counts, 0, 32767, 0,
        "channel 5 is driven no lower; equal to the next one it is off",
        |s| s.control.soft_limits[5].low.into(), |s, v| s.control.soft_limits[5].low = v as i16;
    91, "soft limit 5 high", Counts, 0, 32767, 0,
        "channel 5 is driven no higher; not below the one before",
        |s| s.control.soft_limits[5].high.into(), |s, v| s.control.soft_limits[5].high = v as i16;
}

fn ki_reading(value: i32) -> KiReading {
    match value {
        1 => KiReading::Fraction256,
        2 => KiReading::WordHundredths,
        _ => KiReading::Hundredths,
    }
}

fn row(number: u16) -> Option<&'static Row> {
    TABLE.iter().find(|row| row.number == number)
}

impl Settings {
    /// Sets one of them. Set all that belong together, then [`check`](Self::check) them.
    ///
    /// # Errors
    /// Says what is wrong; nothing is changed then.
    pub fn set(&mut self, number: u16, value: i32) -> Result<(), SettingRefused> {
        let row = row(number).ok_or(SettingRefused::NoSuchSetting(number))?;
        let (low, high) = row.range;
        if !(low..=high).contains(&value) {
            return Err(SettingRefused::OutOfRange(number));
        }
        (row.set)(self, value);
        Ok(())
    }

    /// Whether they agree with each other.
    ///
    /// # Errors
    /// [`SettingRefused::Contradiction`] names the first that does not.
    pub fn check(&self) -> Result<(), SettingRefused> {
        let collision = &self.control.collision;
        if collision.sonar_clear_cm < collision.sonar_stop_cm {
            return Err(SettingRefused::Contradiction(17));
        }
        if collision.ir_clear > collision.ir_stop {
            return Err(SettingRefused::Contradiction(19));
        }
        for (number, soft) in (81..).step_by(2).zip(&self.control.soft_limits) {
            if soft.high < soft.low {
                return Err(SettingRefused::Contradiction(number));
            }
        }
        Ok(())
    }

    /// All of them, by number.
    pub fn iter(&self) -> impl Iterator<Item = (u16, i32)> {
        TABLE.iter().map(|row| (row.number, (row.get)(self)))
    }

    /// Everything about the setting of this number, about the first for number 0; `None` if there
    /// is none.
    pub fn describe(&self, number: u16) -> Option<Description<'static>> {
        let number = if number == 0 { *NUMBERS.first()? } else { number };
        let row = row(number)?;
        Some(Description {
            number,
            next: NUMBERS.iter().copied().find(|&next| next > number),
            value: (row.get)(self),
            range: row.range,
            default: (row.get)(&Self::DEFAULT),
            unit: row.unit,
            name: row.name,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_in_order_and_every_default_is_the_documented_one_and_in_range() {
        assert!(NUMBERS.is_sorted_by(|a, b| a < b) && NUMBERS[0] > 0);
        Settings::DEFAULT.check().unwrap();
        for (row, documented) in TABLE.iter().zip(DOCUMENTED) {
            let default = (row.get)(&Settings::DEFAULT);
            assert_eq!(default, *documented, "{}", row.name);
            assert!((row.range.0..=row.range.1).contains(&default), "{}", row.name);
            assert!(row.name.is_ascii() && row.name.len() <= Description::LONGEST_NAME);
        }
    }

    #[test]
    fn every_setting_takes_its_whole_range_and_nothing_beyond_and_no_other_with_it() {
        for row in TABLE {
            let (low, high) = row.range;
            for value in [low, low + 1, high / 2, high - 1, high] {
                let mut settings = Settings::DEFAULT;
                settings.set(row.number, value).unwrap();
                for (number, now) in settings.iter() {
                    let default = settings.describe(number).unwrap().default;
                    let expected = if number == row.number { value } else { default };
                    assert_eq!(now, expected, "{number} after {} = {value}", row.name);
                }
            }
            for value in [i32::MIN, low - 1, high + 1, i32::MAX] {
                let mut settings = Settings::DEFAULT;
                let refused = settings.set(row.number, value);
                assert_eq!(refused, Err(SettingRefused::OutOfRange(row.number)));
                assert_eq!(settings, Settings::DEFAULT);
            }
        }
        let mut settings = Settings::DEFAULT;
        assert_eq!(settings.set(999, 0), Err(SettingRefused::NoSuchSetting(999)));
    }

    #[test]
    fn a_host_walks_through_all_settings_from_number_0() {
        let mut walked = Vec::new();
        let mut next = Some(0);
        while let Some(number) = next {
            let description = Settings::DEFAULT.describe(number).unwrap();
            walked.push(description.number);
            next = description.next;
        }
        assert_eq!(walked, NUMBERS);
        assert_eq!(Settings::DEFAULT.describe(5), None);
    }

    #[test]
    fn thresholds_that_cross_contradict_each_other() {
        let contradiction = |assignments: &[(u16, i32)]| {
            let mut settings = Settings::DEFAULT;
            assignments.iter().for_each(|&(number, value)| settings.set(number, value).unwrap());
            settings.check().err()
        };
        assert_eq!(contradiction(&[(16, 36)]), Some(SettingRefused::Contradiction(17)));
        assert_eq!(contradiction(&[(16, 36), (17, 36)]), None);
        assert_eq!(contradiction(&[(19, 1679)]), Some(SettingRefused::Contradiction(19)));
        assert_eq!(contradiction(&[(19, 1679), (18, 1679)]), None);
        assert_eq!(contradiction(&[(84, 1000)]), Some(SettingRefused::Contradiction(85)));
        assert_eq!(contradiction(&[(84, 1000), (85, 1000)]), None);
    }
}
