//! The settings by number: one table of what each is called, counts and may be, and where the code
//! has it. The structs that the code uses are made of it, with their defaults.
//!
//! Numbers never change their meaning and are never given again: they are on the wire (DIDs 7 and
//! 96, and what carries the same to an arm) and in the flash. 56, 57 and 63 (the tracking errors of
//! fault 3 before it knew which way a shaft goes) have had theirs. A value is a whole number; 0 and 1
//! stand for no and yes. A row may hold a *bank*: the same setting of several channels or joints.

use crate::channel::{CHANNELS, Method, Polarity, Sensor};

use super::{ChannelSettings, JointSettings, Settings, SoftLimits};

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
    /// Where the nth is; `None` beyond the end of a bank.
    field: fn(&mut Settings, usize) -> Option<&mut dyn Value>,
}

/// What a setting's value counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Unit {
    /// A choice among numbered things.
    Choice,
    /// 0 is no, 1 is yes.
    Flag,
    /// Bit 0 is the first of several.
    Bits,
    /// Milliseconds.
    Milliseconds,
    /// Centimetres.
    Centimetres,
    /// A/D counts, as in the telemetry.
    AdCounts,
    /// Counts of a position sensor.
    Counts,
    /// Counts of a position sensor per second.
    CountsPerSecond,
    /// Drive in 1/16384 of full drive.
    Duty,
    /// Seconds.
    Seconds,
    /// Ticks of an arm's joint.
    Ticks,
}

/// A setting as the code uses it.
trait Value {
    fn get(&self) -> i32;

    /// Values are in the setting's range, and so fit.
    fn set(&mut self, value: i32);
}

macro_rules! whole_numbers {
    ($($number:ty),+) => {
        $(impl Value for $number {
            fn get(&self) -> i32 {
                *self as i32 // the highest is 8,000,000
            }

            fn set(&mut self, value: i32) {
                *self = value as $number;
            }
        })+
    };
}
whole_numbers!(u8, u16, i16, u32);

impl Value for bool {
    fn get(&self) -> i32 {
        (*self).into()
    }

    fn set(&mut self, value: i32) {
        *self = value != 0;
    }
}

impl Value for Option<Sensor> {
    fn get(&self) -> i32 {
        self.map_or(0, |sensor| sensor as i32 + 1)
    }

    fn set(&mut self, value: i32) {
        *self = Sensor::ALL.into_iter().find(|&sensor| Some(sensor).get() == value);
    }
}

impl Value for Option<Method> {
    fn get(&self) -> i32 {
        self.map_or(0, |method| method as i32 + 1)
    }

    fn set(&mut self, value: i32) {
        *self = Method::ALL.into_iter().find(|&method| Some(method).get() == value);
    }
}

impl Value for Polarity {
    fn get(&self) -> i32 {
        (*self == Self::Negative).into()
    }

    fn set(&mut self, value: i32) {
        *self = if value == 0 { Self::Positive } else { Self::Negative };
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
        (self.field)(&mut copy, n).map_or(0, |field| field.get())
    }

    /// Sets the nth to a value in its range.
    pub fn set(&self, settings: &mut Settings, n: usize, value: i32) {
        if let Some(field) = (self.field)(settings, n) {
            field.set(value);
        }
    }

    /// The number of the nth.
    pub fn number(&self, n: usize) -> u16 {
        self.number + u16::from(self.step) * u16::from(self.member(n).unwrap_or(0)) // 279 at the most
    }
}

/// A default that is no number stands in brackets behind its number.
macro_rules! default {
    ($number:literal) => {
        $number
    };
    ($number:literal $value:expr) => {
        $value
    };
}

// A group of settings is a struct: its fields with a row of the table each, then its other fields
// (`with`) and the rows that are not simply a field of it (`and`).
macro_rules! settings {
    ($($(#[doc = $doc:literal])+ $group:ident at $($at:ident).+ {
        $($(#[doc = $why:literal])* $field:ident: $type:ty = $default:literal $(($value:expr))?,
            $number:literal, $name:literal, $unit:ident, $low:literal..=$high:literal,
            $what:literal;)*
    }
    $(with {
        $($(#[doc = $other_doc:literal])+ $other:ident: $other_type:ty = $other_default:expr;)*
    })?
    $(and {
        $($first_number:literal $(+ $step:literal * [$first:literal..=$last:literal])?,
            $row_name:literal, $row_unit:ident, $row_low:literal..=$row_high:literal,
            $row_default:literal, $row_what:literal, $place:expr;)*
    })?)+) => {
        $(
            $(#[doc = $doc])+
            #[derive(Clone, Copy, Debug, PartialEq, Eq)]
            #[cfg_attr(feature = "defmt", derive(defmt::Format))]
            pub struct $group {
                $(
                    #[doc = concat!("Setting ", $number, ", ", $name, ": ", $what, ".")]
                    ///
                    $(#[doc = $why])*
                    pub $field: $type,
                )*
                $($($(#[doc = $other_doc])+ pub $other: $other_type,)*)?
            }

            impl $group {
                /// The defaults of the table.
                pub const DEFAULT: Self = Self {
                    $($field: default!($default $($value)?),)*
                    $($($other: $other_default,)*)?
                };

                fn of(settings: &mut Settings) -> &mut Self {
                    &mut settings.$($at).+
                }
            }
        )+

        /// How many settings there are.
        ///
        /// An n is a channel or a joint, 1 to 6 as people count, and stands behind the name (the wire's channel is
        /// one less). All but an
        /// arm's (112 to 173) take effect in the control period after they were set; what a host
        /// has sent before (gains, say) stays as it was read then. An arm's take effect with the
        /// next start, so that no joint jumps: save them, and reboot.
        ///
        /// | number | name | unit | range | default | what it is |
        /// |---|---|---|---|---|---|
        $(
            $(#[doc = concat!("| ", $number, " | ", $name, " | ", stringify!($unit), " | ", $low,
                " to ", $high, " | ", $default, " | ", $what, " |")])*
            $($(#[doc = concat!("| ", $first_number $(, " + ", $step, " n")?, " | ", $row_name,
                " | ", stringify!($row_unit), " | ", $row_low, " to ", $row_high, " | ",
                $row_default, " | ", $row_what, " |")])*)?
        )+
        pub const COUNT: usize = count(TABLE);

        pub(super) const TABLE: &[Row] = &[$(
            $(Row {
                number: $number,
                step: 0,
                members: (0, 0),
                name: $name,
                unit: Unit::$unit,
                range: ($low, $high),
                field: |s, _| Some(&mut $group::of(s).$field),
            },)*
            $($(Row {
                number: $first_number,
                step: 0 $(+ $step)?,
                members: (0 $(+ $first)?, 0 $(+ $last)?),
                name: $row_name,
                unit: Unit::$row_unit,
                range: ($row_low, $row_high),
                field: $place,
            },)*)?
        )+];

        /// The defaults as the documentation has them.
        #[cfg(test)]
        pub(super) const DOCUMENTED: &[i32] = &[$($($default,)* $($($row_default,)*)?)+];

        /// The rows of the documentation's table.
        #[cfg(test)]
        pub(super) const ROWS: &[&str] = &[$(
            $(concat!("| ", $number, " | ", $name, " | ", stringify!($unit), " | ", $low,
                " to ", $high, " | ", $default, " | ", $what, " |"),)*
            $($(concat!("| ", $first_number $(, " + ", $step, " n")?, " | ", $row_name,
                " | ", stringify!($row_unit), " | ", $row_low, " to ", $row_high, " | ",
                $row_default, " | ", $row_what, " |"),)*)?
        )+];
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
    /// The controller's settings.
    ControlSettings at control {
        link_timeout: u16 = 2000, 1, "link timeout", Milliseconds, 0..=60000,
            "silence of the host after which moving channels are stopped; 0 never stops them";
        full_speed_encoder: u32 = 16384, 3, "full speed encoder", CountsPerSecond, 0..=8000000,
            "an encoder's speed at full drive, for feed-forward, unless its channel has its own; 0 is none";
        full_speed_potentiometer: u32 = 4096, 4,
            "full speed potentiometer", CountsPerSecond, 0..=8000000,
            "a potentiometer's, in the same way; 0 is none";
        longest_move: u16 = 10000, 5, "longest move", Milliseconds, 0..=60000,
            "silence of the host in which a timed position move goes on to its end; 0 stops it with 1";
        oldest_command: u16 = 0, 6, "oldest command", Milliseconds, 0..=60000,
            "age of a channel's last motion command after which it stops as by silence; 0 is never";
    }
    with {
        /// Each DC channel.
        channels: [ChannelSettings; CHANNELS] = [ChannelSettings::DEFAULT; CHANNELS];
        /// Collision protection.
        collision: CollisionSettings = CollisionSettings::DEFAULT;
        /// Limits of the DC channels' positions.
        soft_limits: [SoftLimits; CHANNELS] = [SoftLimits::NONE; CHANNELS];
        /// Whether a DC channel's current can be measured.
        current_sensors: [bool; CHANNELS] = [true; CHANNELS];
        /// Faults of every DC channel.
        channel_faults: ChannelFaultSettings = ChannelFaultSettings::DEFAULT;
        /// Faults of the board.
        board_faults: BoardFaultSettings = BoardFaultSettings::DEFAULT;
    }
    and {
        99 + 1 * [1..=6], "current sensor", Flag, 0..=1, 1,
            "whether channel n has one; without, faults 2 and 5 are off and 4 is slower to tell",
            |s, n| Some(s.control.current_sensors.get_mut(n)?);
        176 + 4 * [1..=6], "slew time", Milliseconds, 0..=60000, 0,
            "from no drive to full drive, at least; what stops is not slewed; 0 is at once",
            |s, n| Some(&mut s.control.channels.get_mut(n)?.slew_ms);
        177 + 4 * [1..=6], "acceleration", CountsPerSecond, 0..=8000000, 0,
            "of a closed loop's set-point, a second; velocity 0 brakes by it; 0 is any",
            |s, n| Some(&mut s.control.channels.get_mut(n)?.acceleration);
        178 + 4 * [1..=6], "highest duty", Duty, 1..=16384, 16384,
            "either way, whatever drives",
            |s, n| Some(&mut s.control.channels.get_mut(n)?.highest_duty);
        179 + 4 * [1..=6], "integral share", Duty, 0..=16384, 16384,
            "the most that the integral of a closed loop adds to its drive",
            |s, n| Some(&mut s.control.channels.get_mut(n)?.integral_share);
        198 + 10 * [1..=6], "position Kp", Choice, 0..=65535, 50,
            "as in DID 7, sub-command 07",
            |s, n| Some(&mut s.control.channels.get_mut(n)?.position.kp);
        199 + 10 * [1..=6], "position Kd", Choice, 0..=65535, 5,
            "as in DID 7, sub-command 07",
            |s, n| Some(&mut s.control.channels.get_mut(n)?.position.kd);
        200 + 10 * [1..=6], "position Ki", Choice, 0..=65535, 0,
            "in hundredths, however DID 7 reads it",
            |s, n| Some(&mut s.control.channels.get_mut(n)?.position.ki_hundredths);
        201 + 10 * [1..=6], "velocity Kp", Choice, 0..=65535, 50,
            "as in DID 7, sub-command 08",
            |s, n| Some(&mut s.control.channels.get_mut(n)?.velocity.kp);
        202 + 10 * [1..=6], "velocity Kd", Choice, 0..=65535, 5,
            "as in DID 7, sub-command 08",
            |s, n| Some(&mut s.control.channels.get_mut(n)?.velocity.kd);
        203 + 10 * [1..=6], "velocity Ki", Choice, 0..=65535, 0,
            "in hundredths, however DID 7 reads it",
            |s, n| Some(&mut s.control.channels.get_mut(n)?.velocity.ki_hundredths);
        204 + 10 * [1..=6], "sensor", Choice, 0..=3, 0,
            "0 as commands imply, 1 one potentiometer, 2 two, 3 the encoder; as sub-command 0D",
            |s, n| Some(&mut s.control.channels.get_mut(n)?.sensor);
        205 + 10 * [1..=6], "method", Choice, 0..=3, 0,
            "0 as commands imply, 1 PWM, 2 position, 3 velocity; as sub-command 0E",
            |s, n| Some(&mut s.control.channels.get_mut(n)?.method);
        206 + 10 * [1..=6], "polarity", Choice, 0..=1, 0,
            "0 positive PWM makes the sensor's counts rise, 1 fall; as sub-command 06",
            |s, n| Some(&mut s.control.channels.get_mut(n)?.polarity);
        207 + 10 * [1..=6], "full speed", CountsPerSecond, 0..=8000000, 0,
            "channel n's speed at full drive, for feed-forward; 0 is setting 3 or 4",
            |s, n| Some(&mut s.control.channels.get_mut(n)?.full_speed);
        267 + 1 * [1..=6], "velocity reset", Milliseconds, 1..=60000, 128,
            "how long an error lasts until the velocity loop's integral has added as much as Kp",
            |s, n| Some(&mut s.control.channels.get_mut(n)?.velocity_reset.time_ms);
        273 + 1 * [1..=6], "velocity look-ahead", Milliseconds, 0..=16, 16,
            "how far the velocity loop looks ahead along the acceleration; less is quieter on a coarse encoder",
            |s, n| Some(&mut s.control.channels.get_mut(n)?.velocity_reset.look_ahead_ms);
    }

    /// When the collision protection (sub-command 13) holds the wheels back.
    CollisionSettings at control.collision {
        sonar_stop_cm: u8 = 30, 16, "sonar stop", Centimetres, 0..=254,
            "collision protection: an ultrasonic range that stops forward drive";
        sonar_clear_cm: u8 = 35, 17, "sonar clear", Centimetres, 0..=254,
            "above this range it lets go; not below 16";
        ir_stop: u16 = 1678, 18, "infrared stop", AdCounts, 0..=4095,
            "collision protection: an infrared reading that stops forward drive (1678 is 20 cm)";
        ir_clear: u16 = 1388, 19, "infrared clear", AdCounts, 0..=4095,
            "below this reading it lets go (1388 is 25 cm); not above 18";
        /// All by default, since the manual does not say where they are mounted and backing off
        /// must always be possible.
        sonar_forward: u8 = 63, 20, "sonars forward", Bits, 0..=63,
            "which ultrasonic sensors look forward: bit 0 is sensor 1";
        enabled: bool = 0 (false), 23, "collision protection", Flag, 0..=1,
            "whether it holds the wheels back; as sub-command 13";
    }
    with {
        /// For wheels 0 and 1: whether rising counts drive the robot forward.
        forward_is_positive: [bool; 2] = [true; 2];
    }
    and {
        21, "wheel 1 forward rises", Flag, 0..=1, 1,
            "whether rising counts of channel 0 drive the robot forward",
            |s, _| Some(&mut s.control.collision.forward_is_positive[0]);
        22, "wheel 2 forward rises", Flag, 0..=1, 1,
            "whether rising counts of channel 1 drive the robot forward",
            |s, _| Some(&mut s.control.collision.forward_is_positive[1]);
    }

    /// The PMS5005 session's settings.
    LinkSettings at link {
        ki_reading: u8 = 2, 2, "Ki reading", Choice, 0..=2,
            "how the two bytes of Ki are read: 0 M + N/100, 1 M + N/256, 2 a word of hundredths";
        telemetry_period_ms: u16 = 50, 32, "telemetry period", Milliseconds, 1..=60000,
            "period of every telemetry stream";
        state_period_ms: u16 = 20, 33, "machine state period", Milliseconds, 1..=60000,
            "period of the machine state (DID 102); a line of 115200 baud carries 69 a second beside telemetry";
    }

    /// When a DC channel's faults trip: [`safety::faults`](crate::safety::faults). Times are
    /// control periods (ms).
    ChannelFaultSettings at control.channel_faults {
        /// 5.6 A can be measured.
        over_current: u16 = 3640, 48, "over-current", AdCounts, 0..=4095,
            "fault 1: a motor current that is limited (3640 is 5 A); 0 never is";
        over_current_ms: u16 = 2000, 49, "over-current time", Milliseconds, 0..=60000,
            "fault 1: how long it may be limited; 0 for ever";
        driven: u16 = 8192, 50, "driven", Duty, 1..=16384,
            "faults 3, 4: a channel is driven from this duty on; 3 takes half of it";
        stall_current: u16 = 728, 51, "stall current", AdCounts, 0..=4095,
            "faults 2, 4: a held shaft's current at full drive, at least; less in proportion (728 is 1 A)";
        /// Wheels push against a wall for a while, and nothing runs away.
        stall_ms: u16 = 6000, 52, "stall time", Milliseconds, 0..=60000,
            "fault 2: how long a shaft may be held fast; 0 for ever";
        sensor_ms: u16 = 500, 53, "sensor time", Milliseconds, 0..=60000,
            "fault 4: how long a driven loop may see no motion; 0 for ever";
        rail_ms: u16 = 250, 54, "rail time", Milliseconds, 0..=60000,
            "fault 4: the same at an end of a potentiometer; 0 for ever";
        /// By default a turn takes 35 ms.
        jump: u16 = 128, 55, "sensor jump", Counts, 0..=4095,
            "fault 4: what no potentiometer moves in a control period; 0 is anything";
        tracking_ms: u16 = 1500, 58, "tracking time", Milliseconds, 0..=30000,
            "fault 3: how long a loop may hunt; 0 for ever";
        jump_ms: u8 = 20, 59, "jump time", Milliseconds, 1..=200,
            "fault 4: how long a jump must last; one bad reading is no lost sensor";
        /// A loop that goes on a move reverses once or twice; more than seven times a second
        /// add up.
        hunt_ms: u8 = 100, 60, "hunt time", Milliseconds, 0..=250,
            "fault 3: a loop hunts for so long after it has reversed its drive; 0 never does";
        /// Less than the default is noise of a converter, or of an encoder that stands on an edge.
        still: u16 = 8, 61, "still", Counts, 0..=4095,
            "faults 2, 4: a shaft that stays so near stands still; a velocity so far off is an error";
        rail: u16 = 8, 62, "rail", Counts, 0..=2047,
            "fault 4: a potentiometer so near to an end of its track is at the rail";
        /// Off before it has gone as far as in 200 ms.
        wrong_way_ms: u16 = 150, 76, "wrong way", Milliseconds, 0..=60000,
            "fault 3: a shaft may go so far against its drive as at full speed in this time; 0 is off";
        dead_band: u16 = 655, 77, "dead band", Duty, 0..=16384,
            "faults 2 to 4: a duty below this need not move a shaft";
        /// More than a loaded joint sags.
        stall_error: u16 = 128, 78, "stall error", Counts, 0..=32767,
            "faults 2, 4: a position loop that is less far off only holds a load";
        lost_ms: u16 = 2000, 79, "sensor lost time", Milliseconds, 0..=60000,
            "fault 4: how long a loop above the dead band may see no motion; 0 for ever";
        /// Above what the default motors draw when they work, below what a held one draws.
        continuous_current: u16 = 1820, 92, "continuous current", AdCounts, 0..=4095,
            "fault 5: what a motor bears for ever (1820 is 2.5 A); 0 is off";
        thermal_s: u16 = 10, 93, "thermal time", Seconds, 1..=600,
            "fault 5: time constant of a motor's heat";
    }

    /// When the board's faults trip, in A/D counts; a threshold of 0 never does.
    BoardFaultSettings at control.board_faults {
        motor_battery_low: u16 = 853, 64, "motor battery low", AdCounts, 0..=4095,
            "fault 16: below this (853 is 5 V); 0 is off";
        /// Off by default: what can be measured is allowed.
        motor_battery_high: u16 = 0, 65, "motor battery high", AdCounts, 0..=4095,
            "fault 17: from this on (171 is 1 V); 0 is off";
        servo_battery_low: u16 = 1820, 66, "servo battery low", AdCounts, 0..=4095,
            "fault 18: below this (1820 is 4 V); 0 is off";
        main_battery_low: u16 = 2002, 67, "main battery low", AdCounts, 0..=4095,
            "fault 19: below this (2002 is 4.4 V); 0 is off";
        driver_hot: u16 = 1096, 68, "driver hot", AdCounts, 0..=4095,
            "fault 20: below this (1096 is 90 degrees, less is hotter); 0 is off";
        ambient_hot: u16 = 3692, 69, "ambient hot", AdCounts, 0..=4095,
            "fault 21: from this on (3692 is 70 degrees); 0 is off";
        lasts_ms: u16 = 1000, 70, "battery and heat time", Milliseconds, 0..=60000,
            "faults 16 to 21: how long it must last";
        missed_periods: u16 = 100, 71, "missed periods", Milliseconds, 0..=9000,
            "fault 23: so many missed in a row; 0 is off";
        no_motor_battery: u16 = 171, 72, "no motor battery", AdCounts, 0..=4095,
            "fault 16: below this there is none (171 is 1 V)";
        no_battery: u16 = 455, 73, "no battery", AdCounts, 0..=4095,
            "faults 18, 19: below this there is none (455 is 1 V)";
        /// By default hotter than any driver that still drives.
        no_driver: u16 = 400, 74, "no driver", AdCounts, 0..=4095,
            "fault 20: below this there is none (400 is 150 degrees)";
        no_thermometer: u16 = 4040, 75, "no thermometer", AdCounts, 0..=4095,
            "fault 21: from this on there is none (4040 is 80 degrees)";
    }
    and {
        78 + 2 * [1..=6], "soft limit low", Counts, 0..=32767, 0,
            "channel n is driven no lower; off if equal to the next one, or if that is beyond the sensor",
            |s, n| Some(&mut s.control.soft_limits.get_mut(n)?.low);
        79 + 2 * [1..=6], "soft limit high", Counts, 0..=32767, 0,
            "channel n is driven no higher; not below the one before",
            |s, n| Some(&mut s.control.soft_limits.get_mut(n)?.high);
    }

    /// The Pioneer Arm's settings.
    ///
    /// The original's joint values are in no document that is left. The defaults are ours: every
    /// joint has its home and its centre at 127, and with 140 ticks to 90 degrees the whole byte is
    /// 0.59 to 2.41 ms of pulse (82 degrees either way), within the 0.5 to 2.5 ms that hobby servos
    /// bear. A tick is 7 us. Another calibration is held only to what the board gives, 0.22 to
    /// 3.11 ms.
    ///
    /// All of them are in force from the start on; what a host sets waits for the next.
    ArmSettings at arm {
        dialect: u8 = 0, 112, "arm dialect", Choice, 0..=2,
            "ARMpac's status bytes: 0 manual, 1 manual with joint 1 in bit 0, 2 ARIA's";
        /// Nothing tells where a servo is, so this is what the arm waits by before it takes power
        /// away, should its joints have been faster (at the lowest SPEEDs). By default twice the
        /// 150 ms of an ordinary hobby servo without load. Our assumption; a slower servo may be short of
        /// home when power goes off.
        servo_ms_per_60_deg: u16 = 300, 113, "arm servo time", Milliseconds, 50..=2000,
            "what the slowest of the arm's servos takes for 60 degrees";
        autopark_s: u16 = 600, 114, "arm autopark", Seconds, 0..=65535,
            "idle time until the arm parks itself; 0 is never";
        grippark_s: u16 = 300, 115, "arm grippark", Seconds, 0..=65535,
            "time until a closed gripper goes home; 0 is never";
    }
    with {
        /// The joints: ranges in ticks, the speed at boot in ms a tick. A pulse is
        /// 1.5 ms + (ticks - centre) / ticks_per_90 ms.
        joints: [JointSettings; CHANNELS] = [JointSettings::DEFAULT; CHANNELS];
    }
    and {
        120 + 8 * [1..=6], "joint speed", Milliseconds, 1..=127, 20,
            "of a step of one tick, at boot; an arm that nobody watches goes home no faster",
            |s, n| Some(&mut s.arm.joints.get_mut(n)?.ms_per_tick);
        121 + 8 * [1..=6], "joint home", Ticks, 0..=255, 127,
            "home position, from lowest to highest",
            |s, n| Some(&mut s.arm.joints.get_mut(n)?.home);
        122 + 8 * [1..=6], "joint min", Ticks, 0..=255, 0,
            "lowest position",
            |s, n| Some(&mut s.arm.joints.get_mut(n)?.min);
        123 + 8 * [1..=6], "joint centre", Ticks, 0..=255, 127,
            "position of 0 degrees and of a pulse of 1.5 ms",
            |s, n| Some(&mut s.arm.joints.get_mut(n)?.centre);
        124 + 8 * [1..=6], "joint max", Ticks, 0..=255, 255,
            "highest position, not below the lowest",
            |s, n| Some(&mut s.arm.joints.get_mut(n)?.max);
        125 + 8 * [1..=6], "joint ticks per 90", Ticks, 1..=255, 140,
            "of 90 degrees and 1 ms of pulse; lowest and highest position must be 0.22 to 3.11 ms",
            |s, n| Some(&mut s.arm.joints.get_mut(n)?.ticks_per_90);
    }
}
