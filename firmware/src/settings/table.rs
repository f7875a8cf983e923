//! The settings by number: one table of what each is called, counts and may be.
//!
//! Numbers never change their meaning and are never given again: they are on the wire (DIDs 7 and
//! 96, and what carries the same to an arm) and in the flash. A value is a whole number; 0 and 1
//! stand for no and yes. A row may hold a *bank*: the same setting of several channels or joints.

use protocol::arcos::{Dialect, MotionBits};
use protocol::pms5005::extension::Unit;

use super::{KiReading, Settings};

/// One setting, or a bank of them.
pub(super) struct Row {
    /// Its number; the members of a bank have this and so many steps more as they are numbered.
    number: u16,
    /// 0 if it is no bank.
    step: u8,
    /// What the first and the last of a bank are called behind its name.
    members: (u8, u8),
    pub unit: Unit,
    pub name: &'static str,
    /// Lowest and highest value.
    pub range: (i32, i32),
    pub get: fn(&Settings, usize) -> i32,
    /// Only called with values in range, so that they fit their fields.
    pub set: fn(&mut Settings, usize, i32),
}

impl Row {
    /// How many settings it holds.
    pub const fn count(&self) -> usize {
        let (first, last) = self.members;
        (last - first) as usize + 1
    }

    /// What the nth of a bank is called behind its name.
    pub fn member(&self, n: usize) -> Option<u8> {
        (self.step > 0).then_some(self.members.0 + n as u8) // 6 at the most
    }

    /// The number of the nth.
    pub fn number(&self, n: usize) -> u16 {
        self.number + u16::from(self.step) * u16::from(self.member(n).unwrap_or(0)) // 173 at the most
    }
}

macro_rules! settings {
    ($($number:literal $(+ $step:literal * [$first:literal..=$last:literal])?, $name:literal,
        $unit:ident, $low:literal, $high:literal, $default:literal, $what:literal,
        $get:expr, $set:expr;)+) => {
        /// How many settings there are.
        ///
        /// An n is a channel, 0 to 5, or a joint, 1 to 6, and stands behind the name. All but an arm's
        /// (from 112 on) take effect in the control period after they were set; what a host has sent
        /// before (gains, say) stays as it was read then. An arm's take effect with the next start, so
        /// that no joint jumps: save them, and reboot.
        ///
        /// | number | name | unit | range | default | what it is |
        /// |---|---|---|---|---|---|
        $(#[doc = concat!("| ", $number $(, " + ", $step, " n")?, " | ", $name,
            " | ", stringify!($unit), " | ", $low, " to ", $high, " | ", $default, " | ", $what,
            " |")])+
        pub const COUNT: usize = count(TABLE);

        pub(super) const TABLE: &[Row] = &[$(Row {
            number: $number,
            step: 0 $(+ $step)?,
            members: (0 $(+ $first)?, 0 $(+ $last)?),
            name: $name,
            unit: Unit::$unit,
            range: ($low, $high),
            get: $get,
            set: $set,
        }),+];

        /// The defaults as the documentation has them.
        #[cfg(test)]
        pub(super) const DOCUMENTED: &[i32] = &[$($default),+];
    };
}

const fn count(mut rows: &[Row]) -> usize {
    let mut count = 0;
    while let [row, rest @ ..] = rows {
        count += row.count();
        rows = rest;
    }
    count
}

settings! {
    1, "link timeout", Milliseconds, 0, 60000, 2000,
        "silence of the host after which moving channels are stopped; 0 never stops them",
        |s, _| s.control.link_timeout.into(), |s, _, v| s.control.link_timeout = v as u16;
    2, "Ki reading", Choice, 0, 2, 0,
        "how the two bytes of Ki are read: 0 M + N/100, 1 M + N/256, 2 a word of hundredths",
        |s, _| s.control.ki_reading as i32, |s, _, v| s.control.ki_reading = ki_reading(v);
    3, "full speed encoder", CountsPerSecond, 0, 8000000, 16384,
        "an encoder's speed at full drive, for feed-forward; 0 is none",
        |s, _| s.control.full_speed_encoder as i32, |s, _, v| s.control.full_speed_encoder = v as u32;
    4, "full speed potentiometer", CountsPerSecond, 0, 8000000, 4096,
        "a potentiometer's speed at full drive, for feed-forward; 0 is none",
        |s, _| s.control.full_speed_potentiometer as i32,
        |s, _, v| s.control.full_speed_potentiometer = v as u32;
    16, "sonar stop", Centimetres, 0, 254, 30,
        "collision protection: an ultrasonic range that stops forward drive",
        |s, _| s.control.collision.sonar_stop_cm.into(),
        |s, _, v| s.control.collision.sonar_stop_cm = v as u8;
    17, "sonar clear", Centimetres, 0, 254, 35,
        "above this range it lets go; not below 16",
        |s, _| s.control.collision.sonar_clear_cm.into(),
        |s, _, v| s.control.collision.sonar_clear_cm = v as u8;
    18, "infrared stop", AdCounts, 0, 4095, 1678,
        "collision protection: an infrared reading that stops forward drive (1678 is 20 cm)",
        |s, _| s.control.collision.ir_stop.into(), |s, _, v| s.control.collision.ir_stop = v as u16;
    19, "infrared clear", AdCounts, 0, 4095, 1388,
        "below this reading it lets go (1388 is 25 cm); not above 18",
        |s, _| s.control.collision.ir_clear.into(), |s, _, v| s.control.collision.ir_clear = v as u16;
    20, "sonars forward", Bits, 0, 63, 63,
        "which ultrasonic sensors look forward: bit 0 is sensor 1",
        |s, _| s.control.collision.sonar_forward.into(),
        |s, _, v| s.control.collision.sonar_forward = v as u8;
    21, "wheel 1 forward rises", Flag, 0, 1, 1,
        "whether rising counts of channel 0 drive the robot forward",
        |s, _| s.control.collision.forward_is_positive[0].into(),
        |s, _, v| s.control.collision.forward_is_positive[0] = v != 0;
    22, "wheel 2 forward rises", Flag, 0, 1, 1,
        "whether rising counts of channel 1 drive the robot forward",
        |s, _| s.control.collision.forward_is_positive[1].into(),
        |s, _, v| s.control.collision.forward_is_positive[1] = v != 0;
    32, "telemetry period", Milliseconds, 1, 60000, 50,
        "period of every telemetry stream",
        |s, _| s.link.telemetry_period_ms.into(), |s, _, v| s.link.telemetry_period_ms = v as u16;
    48, "over-current", AdCounts, 0, 4095, 3640,
        "fault 1: a motor current that is limited (3640 is 5 A); 0 never is",
        |s, _| s.control.channel_faults.over_current.into(), |s, _, v| s.control.channel_faults.over_current = v as u16;
    49, "over-current time", Milliseconds, 0, 60000, 2000,
        "fault 1: how long it may be limited; 0 for ever",
        |s, _| s.control.channel_faults.over_current_ms.into(), |s, _, v| s.control.channel_faults.over_current_ms = v as u16;
    50, "driven", Duty, 1, 16384, 8192,
        "faults 2 to 4: a channel is driven from this duty on",
        |s, _| s.control.channel_faults.driven.into(), |s, _, v| s.control.channel_faults.driven = v as u16;
    51, "stall current", AdCounts, 0, 4095, 728,
        "faults 2, 4: what a shaft that is held fast draws at full drive, at least (728 is 1 A)",
        |s, _| s.control.channel_faults.stall_current.into(), |s, _, v| s.control.channel_faults.stall_current = v as u16;
    52, "stall time", Milliseconds, 0, 60000, 6000,
        "fault 2: how long a driven shaft may be held fast; 0 for ever",
        |s, _| s.control.channel_faults.stall_ms.into(), |s, _, v| s.control.channel_faults.stall_ms = v as u16;
    53, "sensor time", Milliseconds, 0, 60000, 500,
        "fault 4: how long a driven loop may see no motion; 0 for ever",
        |s, _| s.control.channel_faults.sensor_ms.into(), |s, _, v| s.control.channel_faults.sensor_ms = v as u16;
    54, "rail time", Milliseconds, 0, 60000, 250,
        "fault 4: the same at an end of a potentiometer; 0 for ever",
        |s, _| s.control.channel_faults.rail_ms.into(), |s, _, v| s.control.channel_faults.rail_ms = v as u16;
    55, "sensor jump", Counts, 0, 4095, 128,
        "fault 4: what no potentiometer moves in a control period; 0 is anything",
        |s, _| s.control.channel_faults.jump.into(), |s, _, v| s.control.channel_faults.jump = v as u16;
    56, "tracking position", Counts, 0, 32767, 512,
        "fault 3: how far a position loop may be off",
        |s, _| s.control.channel_faults.tracking_position.into(), |s, _, v| s.control.channel_faults.tracking_position = v as u16;
    57, "tracking velocity", CountsPerSecond, 0, 65535, 2048,
        "fault 3: how far a velocity loop may be off",
        |s, _| s.control.channel_faults.tracking_velocity.into(), |s, _, v| s.control.channel_faults.tracking_velocity = v as u16;
    58, "tracking time", Milliseconds, 0, 30000, 1500,
        "fault 3: how long a loop may be astray or hunt; 0 for ever",
        |s, _| s.control.channel_faults.tracking_ms.into(), |s, _, v| s.control.channel_faults.tracking_ms = v as u16;
    59, "jump time", Milliseconds, 1, 200, 20,
        "fault 4: how long a jump must last; one bad reading is no lost sensor",
        |s, _| s.control.channel_faults.jump_ms.into(), |s, _, v| s.control.channel_faults.jump_ms = v as u16;
    60, "hunt time", Milliseconds, 0, 1000, 100,
        "fault 3: a loop hunts for so long after it has reversed its drive; 0 never does",
        |s, _| s.control.channel_faults.hunt_ms.into(), |s, _, v| s.control.channel_faults.hunt_ms = v as u16;
    61, "still", Counts, 0, 4095, 8,
        "faults 2, 4: a shaft that stays so near stands still",
        |s, _| s.control.channel_faults.still.into(), |s, _, v| s.control.channel_faults.still = v as u16;
    62, "rail", Counts, 0, 2047, 8,
        "fault 4: a potentiometer so near to an end of its track is at the rail",
        |s, _| s.control.channel_faults.rail.into(), |s, _, v| s.control.channel_faults.rail = v as u16;
    63, "tracking away", CountsPerSecond, 0, 65535, 64,
        "fault 3: a shaft that moves away from its set-point does so faster",
        |s, _| s.control.channel_faults.away.into(), |s, _, v| s.control.channel_faults.away = v as u16;
    64, "motor battery low", AdCounts, 0, 4095, 853,
        "fault 16: below this (853 is 5 V); 0 is off",
        |s, _| s.control.board_faults.motor_battery_low.into(), |s, _, v| s.control.board_faults.motor_battery_low = v as u16;
    65, "motor battery high", AdCounts, 0, 4095, 0,
        "fault 17: from this on (171 is 1 V); 0 is off",
        |s, _| s.control.board_faults.motor_battery_high.into(), |s, _, v| s.control.board_faults.motor_battery_high = v as u16;
    66, "servo battery low", AdCounts, 0, 4095, 1820,
        "fault 18: below this (1820 is 4 V); 0 is off",
        |s, _| s.control.board_faults.servo_battery_low.into(), |s, _, v| s.control.board_faults.servo_battery_low = v as u16;
    67, "main battery low", AdCounts, 0, 4095, 2002,
        "fault 19: below this (2002 is 4.4 V); 0 is off",
        |s, _| s.control.board_faults.main_battery_low.into(), |s, _, v| s.control.board_faults.main_battery_low = v as u16;
    68, "driver hot", AdCounts, 0, 4095, 1096,
        "fault 20: below this (1096 is 90 degrees, less is hotter); 0 is off",
        |s, _| s.control.board_faults.driver_hot.into(), |s, _, v| s.control.board_faults.driver_hot = v as u16;
    69, "ambient hot", AdCounts, 0, 4095, 3692,
        "fault 21: from this on (3692 is 70 degrees); 0 is off",
        |s, _| s.control.board_faults.ambient_hot.into(), |s, _, v| s.control.board_faults.ambient_hot = v as u16;
    70, "battery and heat time", Milliseconds, 0, 60000, 1000,
        "faults 16 to 21: how long it must last",
        |s, _| s.control.board_faults.lasts_ms.into(), |s, _, v| s.control.board_faults.lasts_ms = v as u16;
    71, "missed periods", Milliseconds, 0, 9000, 100,
        "fault 23: so many missed in a row; 0 is off",
        |s, _| s.control.board_faults.missed_periods.into(), |s, _, v| s.control.board_faults.missed_periods = v as u16;
    72, "no motor battery", AdCounts, 0, 4095, 171,
        "fault 16: below this there is none (171 is 1 V)",
        |s, _| s.control.board_faults.no_motor_battery.into(), |s, _, v| s.control.board_faults.no_motor_battery = v as u16;
    73, "no battery", AdCounts, 0, 4095, 455,
        "faults 18, 19: below this there is none (455 is 1 V)",
        |s, _| s.control.board_faults.no_battery.into(), |s, _, v| s.control.board_faults.no_battery = v as u16;
    74, "no driver", AdCounts, 0, 4095, 400,
        "fault 20: below this there is none (400 is 150 degrees)",
        |s, _| s.control.board_faults.no_driver.into(), |s, _, v| s.control.board_faults.no_driver = v as u16;
    75, "no thermometer", AdCounts, 0, 4095, 4040,
        "fault 21: from this on there is none (4040 is 80 degrees)",
        |s, _| s.control.board_faults.no_thermometer.into(), |s, _, v| s.control.board_faults.no_thermometer = v as u16;
    80 + 2 * [0..=5], "soft limit low", Counts, 0, 32767, 0,
        "channel n is driven no lower; equal to the next one it is off",
        |s, n| of(&s.control.soft_limits, n).low.into(),
        |s, n, v| change(&mut s.control.soft_limits, n, |soft| soft.low = v as i16);
    81 + 2 * [0..=5], "soft limit high", Counts, 0, 32767, 0,
        "channel n is driven no higher; not below the one before",
        |s, n| of(&s.control.soft_limits, n).high.into(),
        |s, n, v| change(&mut s.control.soft_limits, n, |soft| soft.high = v as i16);
    112, "arm dialect", Choice, 0, 2, 0,
        "ARMpac's status bytes: 0 manual, 1 manual with joint 1 in bit 0, 2 ARIA's",
        |s, _| dialect_number(s.arm.dialect), |s, _, v| s.arm.dialect = dialect(v);
    113, "arm servo time", Milliseconds, 50, 2000, 300,
        "what the slowest of the arm's servos takes for 60 degrees",
        |s, _| s.arm.servo_ms_per_60_deg.into(), |s, _, v| s.arm.servo_ms_per_60_deg = v as u16;
    114, "arm autopark", Seconds, 0, 65535, 600,
        "idle time until the arm parks itself; 0 is never",
        |s, _| s.arm.autopark_s.into(), |s, _, v| s.arm.autopark_s = v as u16;
    115, "arm grippark", Seconds, 0, 65535, 300,
        "time until a closed gripper goes home; 0 is never",
        |s, _| s.arm.grippark_s.into(), |s, _, v| s.arm.grippark_s = v as u16;
    120 + 8 * [1..=6], "joint speed", Milliseconds, 1, 127, 20,
        "of a step of one tick, at boot; an arm that nobody watches goes home no faster",
        |s, n| of(&s.arm.joints, n).ms_per_tick.into(),
        |s, n, v| change(&mut s.arm.joints, n, |joint| joint.ms_per_tick = v as u8);
    121 + 8 * [1..=6], "joint home", Ticks, 0, 255, 127,
        "home position, from lowest to highest",
        |s, n| of(&s.arm.joints, n).home.into(),
        |s, n, v| change(&mut s.arm.joints, n, |joint| joint.home = v as u8);
    122 + 8 * [1..=6], "joint min", Ticks, 0, 255, 0,
        "lowest position",
        |s, n| of(&s.arm.joints, n).min.into(),
        |s, n, v| change(&mut s.arm.joints, n, |joint| joint.min = v as u8);
    123 + 8 * [1..=6], "joint centre", Ticks, 0, 255, 127,
        "position of 0 degrees and of a pulse of 1.5 ms",
        |s, n| of(&s.arm.joints, n).centre.into(),
        |s, n, v| change(&mut s.arm.joints, n, |joint| joint.centre = v as u8);
    124 + 8 * [1..=6], "joint max", Ticks, 0, 255, 255,
        "highest position, not below the lowest",
        |s, n| of(&s.arm.joints, n).max.into(),
        |s, n, v| change(&mut s.arm.joints, n, |joint| joint.max = v as u8);
    125 + 8 * [1..=6], "joint ticks per 90", Ticks, 1, 255, 140,
        "of 90 degrees and 1 ms of pulse; lowest and highest position must be 0.22 to 3.11 ms",
        |s, n| of(&s.arm.joints, n).ticks_per_90.into(),
        |s, n, v| change(&mut s.arm.joints, n, |joint| joint.ticks_per_90 = v as u8);
}

/// The nth of a bank.
fn of<T: Copy + Default>(bank: &[T], n: usize) -> T {
    bank.get(n).copied().unwrap_or_default()
}

fn change<T>(bank: &mut [T], n: usize, change: impl FnOnce(&mut T)) {
    if let Some(it) = bank.get_mut(n) {
        change(it);
    }
}

fn ki_reading(value: i32) -> KiReading {
    match value {
        1 => KiReading::Fraction256,
        2 => KiReading::WordHundredths,
        _ => KiReading::Hundredths,
    }
}

fn dialect(value: i32) -> Dialect {
    match value {
        1 => Dialect::Manual(MotionBits::ZeroToFive),
        2 => Dialect::Aria,
        _ => Dialect::Manual(MotionBits::OneToSix),
    }
}

fn dialect_number(dialect: Dialect) -> i32 {
    match dialect {
        Dialect::Manual(MotionBits::OneToSix) => 0,
        Dialect::Manual(MotionBits::ZeroToFive) => 1,
        Dialect::Aria => 2,
    }
}
