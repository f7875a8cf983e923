//! The settings by number: one table of what each is called, counts and may be.
//!
//! Numbers never change their meaning and are never given again: they are on the wire (DIDs 7 and
//! 96, and what carries the same to an arm) and in the flash. A value is a whole number; 0 and 1
//! stand for no and yes. A row may hold a *bank*: the same setting of several channels or joints.

use protocol::arcos::{Dialect, MotionBits};
use protocol::pms5005::extension::Unit;

use self::Field::{Flag, I16, Ki, Status, U8, U16, U32};
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
    /// Where the nth is.
    field: fn(&mut Settings, usize) -> Field<'_>,
}

/// A setting as the code uses it.
enum Field<'a> {
    U8(&'a mut u8),
    U16(&'a mut u16),
    I16(&'a mut i16),
    U32(&'a mut u32),
    Flag(&'a mut bool),
    Ki(&'a mut KiReading),
    Status(&'a mut Dialect),
    /// Beyond the end of a bank.
    Nowhere,
}

impl Field<'_> {
    fn get(self) -> i32 {
        match self {
            U8(field) => (*field).into(),
            U16(field) => (*field).into(),
            I16(field) => (*field).into(),
            U32(field) => *field as i32, // the highest is 8,000,000
            Flag(field) => (*field).into(),
            Ki(field) => *field as i32,
            Status(field) => dialect_number(*field),
            Self::Nowhere => 0,
        }
    }

    /// Values are in the setting's range, and so fit.
    fn set(self, value: i32) {
        match self {
            U8(field) => *field = value as u8,
            U16(field) => *field = value as u16,
            I16(field) => *field = value as i16,
            U32(field) => *field = value as u32,
            Flag(field) => *field = value != 0,
            Ki(field) => *field = ki_reading(value),
            Status(field) => *field = dialect(value),
            Self::Nowhere => {}
        }
    }
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

    /// The nth's value.
    pub fn get(&self, settings: &Settings, n: usize) -> i32 {
        let mut copy = *settings;
        (self.field)(&mut copy, n).get()
    }

    /// Sets the nth to a value in its range.
    pub fn set(&self, settings: &mut Settings, n: usize, value: i32) {
        (self.field)(settings, n).set(value);
    }

    /// The number of the nth.
    pub fn number(&self, n: usize) -> u16 {
        self.number + u16::from(self.step) * u16::from(self.member(n).unwrap_or(0)) // 173 at the most
    }
}

macro_rules! settings {
    ($($number:literal $(+ $step:literal * [$first:literal..=$last:literal])?, $name:literal,
        $unit:ident, $low:literal, $high:literal, $default:literal, $what:literal,
        $field:expr;)+) => {
        /// How many settings there are.
        ///
        /// An n is a channel, 0 to 5, or a joint, 1 to 6, and stands behind the name. All but an
        /// arm's (from 112 on) take effect in the control period after they were set; what a host
        /// has sent before (gains, say) stays as it was read then. An arm's take effect with the
        /// next start, so that no joint jumps: save them, and reboot.
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
            field: $field,
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

/// The row of this name, which must be there when it is compiled.
pub(super) const fn row(name: &str) -> &'static Row {
    let mut rows = TABLE;
    while let [row, rest @ ..] = rows {
        if is_same(row.name.as_bytes(), name.as_bytes()) {
            return row;
        }
        rows = rest;
    }
    panic!("no setting has this name")
}

const fn is_same(mut one: &[u8], mut other: &[u8]) -> bool {
    while let ([a, one_rest @ ..], [b, other_rest @ ..]) = (one, other)
        && *a == *b
    {
        (one, other) = (one_rest, other_rest);
    }
    one.is_empty() && other.is_empty()
}

settings! {
    1, "link timeout", Milliseconds, 0, 60000, 2000,
        "silence of the host after which moving channels are stopped; 0 never stops them",
        |s, _| U16(&mut s.control.link_timeout);
    2, "Ki reading", Choice, 0, 2, 2,
        "how the two bytes of Ki are read: 0 M + N/100, 1 M + N/256, 2 a word of hundredths",
        |s, _| Ki(&mut s.control.ki_reading);
    3, "full speed encoder", CountsPerSecond, 0, 8000000, 16384,
        "an encoder's speed at full drive, for feed-forward; 0 is none",
        |s, _| U32(&mut s.control.full_speed_encoder);
    4, "full speed potentiometer", CountsPerSecond, 0, 8000000, 4096,
        "a potentiometer's speed at full drive, for feed-forward; 0 is none",
        |s, _| U32(&mut s.control.full_speed_potentiometer);
    5, "longest move", Milliseconds, 0, 60000, 10000,
        "silence of the host in which a timed position move goes on to its end; 0 stops it with 1",
        |s, _| U16(&mut s.control.longest_move);
    16, "sonar stop", Centimetres, 0, 254, 30,
        "collision protection: an ultrasonic range that stops forward drive",
        |s, _| U8(&mut s.control.collision.sonar_stop_cm);
    17, "sonar clear", Centimetres, 0, 254, 35,
        "above this range it lets go; not below 16",
        |s, _| U8(&mut s.control.collision.sonar_clear_cm);
    18, "infrared stop", AdCounts, 0, 4095, 1678,
        "collision protection: an infrared reading that stops forward drive (1678 is 20 cm)",
        |s, _| U16(&mut s.control.collision.ir_stop);
    19, "infrared clear", AdCounts, 0, 4095, 1388,
        "below this reading it lets go (1388 is 25 cm); not above 18",
        |s, _| U16(&mut s.control.collision.ir_clear);
    20, "sonars forward", Bits, 0, 63, 63,
        "which ultrasonic sensors look forward: bit 0 is sensor 1",
        |s, _| U8(&mut s.control.collision.sonar_forward);
    21, "wheel 1 forward rises", Flag, 0, 1, 1,
        "whether rising counts of channel 0 drive the robot forward",
        |s, _| Flag(&mut s.control.collision.forward_is_positive[0]);
    22, "wheel 2 forward rises", Flag, 0, 1, 1,
        "whether rising counts of channel 1 drive the robot forward",
        |s, _| Flag(&mut s.control.collision.forward_is_positive[1]);
    32, "telemetry period", Milliseconds, 1, 60000, 50,
        "period of every telemetry stream",
        |s, _| U16(&mut s.link.telemetry_period_ms);
    48, "over-current", AdCounts, 0, 4095, 3640,
        "fault 1: a motor current that is limited (3640 is 5 A); 0 never is",
        |s, _| U16(&mut s.control.channel_faults.over_current);
    49, "over-current time", Milliseconds, 0, 60000, 2000,
        "fault 1: how long it may be limited; 0 for ever",
        |s, _| U16(&mut s.control.channel_faults.over_current_ms);
    50, "driven", Duty, 1, 16384, 8192,
        "faults 2 to 4: a channel is driven from this duty on",
        |s, _| U16(&mut s.control.channel_faults.driven);
    51, "stall current", AdCounts, 0, 4095, 728,
        "faults 2, 4: what a shaft that is held fast draws at full drive, at least (728 is 1 A)",
        |s, _| U16(&mut s.control.channel_faults.stall_current);
    52, "stall time", Milliseconds, 0, 60000, 6000,
        "fault 2: how long a driven shaft may be held fast; 0 for ever",
        |s, _| U16(&mut s.control.channel_faults.stall_ms);
    53, "sensor time", Milliseconds, 0, 60000, 500,
        "fault 4: how long a driven loop may see no motion; 0 for ever",
        |s, _| U16(&mut s.control.channel_faults.sensor_ms);
    54, "rail time", Milliseconds, 0, 60000, 250,
        "fault 4: the same at an end of a potentiometer; 0 for ever",
        |s, _| U16(&mut s.control.channel_faults.rail_ms);
    55, "sensor jump", Counts, 0, 4095, 128,
        "fault 4: what no potentiometer moves in a control period; 0 is anything",
        |s, _| U16(&mut s.control.channel_faults.jump);
    56, "tracking position", Counts, 0, 32767, 512,
        "fault 3: how far a position loop may be off",
        |s, _| U16(&mut s.control.channel_faults.tracking_position);
    57, "tracking velocity", CountsPerSecond, 0, 65535, 2048,
        "fault 3: how far a velocity loop may be off",
        |s, _| U16(&mut s.control.channel_faults.tracking_velocity);
    58, "tracking time", Milliseconds, 0, 30000, 1500,
        "fault 3: how long a loop may be astray or hunt; 0 for ever",
        |s, _| U16(&mut s.control.channel_faults.tracking_ms);
    59, "jump time", Milliseconds, 1, 200, 20,
        "fault 4: how long a jump must last; one bad reading is no lost sensor",
        |s, _| U8(&mut s.control.channel_faults.jump_ms);
    60, "hunt time", Milliseconds, 0, 250, 100,
        "fault 3: a loop hunts for so long after it has reversed its drive; 0 never does",
        |s, _| U8(&mut s.control.channel_faults.hunt_ms);
    61, "still", Counts, 0, 4095, 8,
        "faults 2, 4: a shaft that stays so near stands still",
        |s, _| U16(&mut s.control.channel_faults.still);
    62, "rail", Counts, 0, 2047, 8,
        "fault 4: a potentiometer so near to an end of its track is at the rail",
        |s, _| U16(&mut s.control.channel_faults.rail);
    63, "tracking away", CountsPerSecond, 0, 65535, 64,
        "fault 3: a shaft that moves away from its set-point does so faster",
        |s, _| U16(&mut s.control.channel_faults.away);
    64, "motor battery low", AdCounts, 0, 4095, 853,
        "fault 16: below this (853 is 5 V); 0 is off",
        |s, _| U16(&mut s.control.board_faults.motor_battery_low);
    65, "motor battery high", AdCounts, 0, 4095, 0,
        "fault 17: from this on (171 is 1 V); 0 is off",
        |s, _| U16(&mut s.control.board_faults.motor_battery_high);
    66, "servo battery low", AdCounts, 0, 4095, 1820,
        "fault 18: below this (1820 is 4 V); 0 is off",
        |s, _| U16(&mut s.control.board_faults.servo_battery_low);
    67, "main battery low", AdCounts, 0, 4095, 2002,
        "fault 19: below this (2002 is 4.4 V); 0 is off",
        |s, _| U16(&mut s.control.board_faults.main_battery_low);
    68, "driver hot", AdCounts, 0, 4095, 1096,
        "fault 20: below this (1096 is 90 degrees, less is hotter); 0 is off",
        |s, _| U16(&mut s.control.board_faults.driver_hot);
    69, "ambient hot", AdCounts, 0, 4095, 3692,
        "fault 21: from this on (3692 is 70 degrees); 0 is off",
        |s, _| U16(&mut s.control.board_faults.ambient_hot);
    70, "battery and heat time", Milliseconds, 0, 60000, 1000,
        "faults 16 to 21: how long it must last",
        |s, _| U16(&mut s.control.board_faults.lasts_ms);
    71, "missed periods", Milliseconds, 0, 9000, 100,
        "fault 23: so many missed in a row; 0 is off",
        |s, _| U16(&mut s.control.board_faults.missed_periods);
    72, "no motor battery", AdCounts, 0, 4095, 171,
        "fault 16: below this there is none (171 is 1 V)",
        |s, _| U16(&mut s.control.board_faults.no_motor_battery);
    73, "no battery", AdCounts, 0, 4095, 455,
        "faults 18, 19: below this there is none (455 is 1 V)",
        |s, _| U16(&mut s.control.board_faults.no_battery);
    74, "no driver", AdCounts, 0, 4095, 400,
        "fault 20: below this there is none (400 is 150 degrees)",
        |s, _| U16(&mut s.control.board_faults.no_driver);
    75, "no thermometer", AdCounts, 0, 4095, 4040,
        "fault 21: from this on there is none (4040 is 80 degrees)",
        |s, _| U16(&mut s.control.board_faults.no_thermometer);
    80 + 2 * [0..=5], "soft limit low", Counts, 0, 32767, 0,
        "channel n is driven no lower; equal to the next one it is off",
        |s, n| of(&mut s.control.soft_limits, n, |soft| I16(&mut soft.low));
    81 + 2 * [0..=5], "soft limit high", Counts, 0, 32767, 0,
        "channel n is driven no higher; not below the one before",
        |s, n| of(&mut s.control.soft_limits, n, |soft| I16(&mut soft.high));
    112, "arm dialect", Choice, 0, 2, 0,
        "ARMpac's status bytes: 0 manual, 1 manual with joint 1 in bit 0, 2 ARIA's",
        |s, _| Status(&mut s.arm.dialect);
    113, "arm servo time", Milliseconds, 50, 2000, 300,
        "what the slowest of the arm's servos takes for 60 degrees",
        |s, _| U16(&mut s.arm.servo_ms_per_60_deg);
    114, "arm autopark", Seconds, 0, 65535, 600,
        "idle time until the arm parks itself; 0 is never",
        |s, _| U16(&mut s.arm.autopark_s);
    115, "arm grippark", Seconds, 0, 65535, 300,
        "time until a closed gripper goes home; 0 is never",
        |s, _| U16(&mut s.arm.grippark_s);
    120 + 8 * [1..=6], "joint speed", Milliseconds, 1, 127, 20,
        "of a step of one tick, at boot; an arm that nobody watches goes home no faster",
        |s, n| of(&mut s.arm.joints, n, |joint| U8(&mut joint.ms_per_tick));
    121 + 8 * [1..=6], "joint home", Ticks, 0, 255, 127,
        "home position, from lowest to highest",
        |s, n| of(&mut s.arm.joints, n, |joint| U8(&mut joint.home));
    122 + 8 * [1..=6], "joint min", Ticks, 0, 255, 0,
        "lowest position",
        |s, n| of(&mut s.arm.joints, n, |joint| U8(&mut joint.min));
    123 + 8 * [1..=6], "joint centre", Ticks, 0, 255, 127,
        "position of 0 degrees and of a pulse of 1.5 ms",
        |s, n| of(&mut s.arm.joints, n, |joint| U8(&mut joint.centre));
    124 + 8 * [1..=6], "joint max", Ticks, 0, 255, 255,
        "highest position, not below the lowest",
        |s, n| of(&mut s.arm.joints, n, |joint| U8(&mut joint.max));
    125 + 8 * [1..=6], "joint ticks per 90", Ticks, 1, 255, 140,
        "of 90 degrees and 1 ms of pulse; lowest and highest position must be 0.22 to 3.11 ms",
        |s, n| of(&mut s.arm.joints, n, |joint| U8(&mut joint.ticks_per_90));
}

/// A field of the nth of a bank.
fn of<'a, T>(bank: &'a mut [T], n: usize, field: fn(&'a mut T) -> Field<'a>) -> Field<'a> {
    bank.get_mut(n).map_or(Field::Nowhere, field)
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
