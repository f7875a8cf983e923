//! What an owner may choose, with the defaults that suit a correctly wired original.
//!
//! - [`Settings`]: the choices, as the code uses them;
//! - [`table`]: the same by number, as hosts and the flash know them, and `numbered`: what is done
//!   with the numbers;
//! - [`store`]: where they survive.

mod numbered;
pub mod store;
pub mod table;

use protocol::pms5005::Sensor;

use protocol::arcos::{Dialect, JOINTS, JointInfo, MotionBits};
use protocol::pms5005::CHANNELS;

use crate::units::{Duty, ServoPulse};

pub use numbered::SettingRefused;

/// How the two bytes of Ki are read; hosts disagree.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum KiReading {
    /// M + N/100: the manual's "integer part, fraction part" in decimal.
    Hundredths,
    /// M + N/256: the manual's table taken as fixed point.
    Fraction256,
    /// A 16-bit number, low byte first, divided by 100: what public hosts send.
    #[default]
    WordHundredths,
}

impl KiReading {
    /// Ki in hundredths from its two bytes.
    pub(crate) fn hundredths(self, [integer, fraction]: [u8; 2]) -> u16 {
        let whole = u16::from(integer) * 100;
        match self {
            Self::Hundredths => whole + u16::from(fraction),
            Self::Fraction256 => whole + ((u16::from(fraction) * 100) >> 8),
            Self::WordHundredths => u16::from_le_bytes([integer, fraction]),
        }
    }
}

/// When the collision protection (sub-command 13) holds the wheels back.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct CollisionSettings {
    /// An ultrasonic range of this many cm or less stops forward drive; default 30.
    pub sonar_stop_cm: u8,
    /// Above this many cm it lets go again; default 35.
    pub sonar_clear_cm: u8,
    /// An infrared range reading of this many A/D counts or more stops forward drive; default
    /// 1678, which is 20 cm.
    pub ir_stop: u16,
    /// Below this many A/D counts it lets go again; default 1388, which is 25 cm.
    pub ir_clear: u16,
    /// Which ultrasonic sensors look forward: bit 0 is sensor 1. Default: all, since the manual
    /// does not say where they are mounted and backing off must always be possible.
    pub sonar_forward: u8,
    /// For wheels 0 and 1: whether rising counts drive the robot forward; default both.
    pub forward_is_positive: [bool; 2],
}

/// The least and the greatest position that a channel may be driven to, in counts of its sensor.
/// Two equal ones set none, the default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SoftLimits {
    /// 0 or more.
    pub low: i16,
    /// Up to the sensor's last count.
    pub high: i16,
}

impl SoftLimits {
    /// No limits.
    pub const NONE: Self = Self { low: 0, high: 0 };

    /// Whether there are any.
    pub fn are_set(&self) -> bool {
        self.low < self.high
    }
}

/// When a DC channel's faults trip: [`safety::faults`](crate::safety::faults). Times are control
/// periods (ms).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ChannelFaultSettings {
    /// A motor current of this many A/D counts or more is limited; 0 never is. Default 3640, which
    /// is 5 A of the 5.6 A that can be measured.
    pub over_current: u16,
    /// How long it may be limited without a pause; 0 for ever. Default 2000.
    pub over_current_ms: u16,
    /// A channel is driven at this duty or more, in 1/16384; default 8192.
    pub driven: u16,
    /// At full drive a shaft that is held fast draws this many A/D counts or more, and in
    /// proportion at less; default 728, which is 1 A.
    pub stall_current: u16,
    /// How long a shaft may be held fast while it is driven; 0 for ever. Default 6000: wheels push
    /// against a wall for a while, and nothing runs away.
    pub stall_ms: u16,
    /// How long a driven loop may see no motion without the current of a shaft that is held fast;
    /// 0 for ever. Default 500.
    pub sensor_ms: u16,
    /// The same at an end of a potentiometer's track; default 250.
    pub rail_ms: u16,
    /// A potentiometer that moves so many counts in a control period has jumped; 0 never does.
    /// Default 128: a turn takes 35 ms then.
    pub jump: u16,
    /// A position loop that is off by more than this many counts may be astray; default 512.
    pub tracking_position: u16,
    /// A velocity loop that is off by more than this many counts/s may be astray; default 2048.
    pub tracking_velocity: u16,
    /// How long a driven shaft may move away from where it is to be; 0 for ever. Default 1500.
    pub tracking_ms: u16,
    /// How long a jump must last: one bad reading is no lost sensor. Default 20.
    pub jump_ms: u8,
    /// A loop hunts for so long after it has reversed its drive. Default 100: one that goes on a
    /// move does so once or twice; more than seven times a second add up.
    pub hunt_ms: u8,
    /// A shaft that stays within so many counts stands still. Default 8: less is noise of a
    /// converter, or of an encoder that stands on an edge.
    pub still: u16,
    /// A potentiometer so many counts from an end of its track is at the rail; default 8.
    pub rail: u16,
    /// A shaft that moves away from its set-point does so faster than this many counts/s; default
    /// 64.
    pub away: u16,
}

/// When the board's faults trip, in A/D counts; a threshold of 0 never does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct BoardFaultSettings {
    /// The motors' battery is low below this; default 853, which is 5 V.
    pub motor_battery_low: u16,
    /// The motors' battery is too high from this on; default 0: what can be measured is allowed.
    pub motor_battery_high: u16,
    /// The servos' battery is low below this; default 1820, which is 4 V.
    pub servo_battery_low: u16,
    /// The main board's battery is low below this; default 2002, which is 4.4 V.
    pub main_battery_low: u16,
    /// A driver is too hot below this; default 1096, which is 90 degrees.
    pub driver_hot: u16,
    /// The surroundings are too hot from this on; default 3692, which is 70 degrees.
    pub ambient_hot: u16,
    /// How long each of these must last, in ms; default 1000.
    pub lasts_ms: u16,
    /// Missed control periods in a row that are too many; default 100.
    pub missed_periods: u16,
    /// Below this the motors' battery is not there; default 171, which is 1 V.
    pub no_motor_battery: u16,
    /// Below this another battery is not there; default 455, which is 1 V.
    pub no_battery: u16,
    /// Below this a driver's sensor is not there; default 400, which is 150 degrees: hotter than
    /// any driver that still drives.
    pub no_driver: u16,
    /// From this on the thermometer is not there; default 4040, which is 80 degrees.
    pub no_thermometer: u16,
}

/// The controller's settings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ControlSettings {
    /// Silence of the host, in control periods (ms), after which moving channels are stopped;
    /// 0 never stops them. Default 2000.
    pub link_timeout: u16,
    /// Silence of the host, in control periods (ms), in which a timed position move may go on to the
    /// end of its time; not above `link_timeout` silence stops it as it stops an untimed one. Default
    /// 10,000.
    pub longest_move: u16,
    /// How Ki is read.
    pub ki_reading: KiReading,
    /// Encoder counts per second at full drive, for feed-forward; default 16384.
    pub full_speed_encoder: u32,
    /// Potentiometer counts per second at full drive, for feed-forward; default 4096.
    pub full_speed_potentiometer: u32,
    /// Collision protection.
    pub collision: CollisionSettings,
    /// Limits of the DC channels' positions.
    pub soft_limits: [SoftLimits; CHANNELS],
    /// Faults of every DC channel.
    pub channel_faults: ChannelFaultSettings,
    /// Faults of the board.
    pub board_faults: BoardFaultSettings,
}

impl ControlSettings {
    /// Counts per second at full drive, by the sensor that counts.
    pub fn full_speed(&self, sensor: Sensor) -> u32 {
        match sensor {
            Sensor::Encoder => self.full_speed_encoder,
            Sensor::SinglePotentiometer | Sensor::DualPotentiometer => {
                self.full_speed_potentiometer
            }
        }
    }
}

/// The PMS5005 session's settings, times in ms.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LinkSettings {
    /// Period of telemetry; default 50.
    pub telemetry_period_ms: u16,
}

/// The Pioneer Arm's settings.
///
/// The original's joint values are in no document that is left. The defaults are ours: every joint
/// has its home and its centre at 127, and with 140 ticks to 90 degrees the whole byte is 0.59 to
/// 2.41 ms of pulse (82 degrees either way), within the 0.5 to 2.5 ms that hobby servos bear. A
/// tick is 7 us. Another calibration is held only to what the board gives, 0.22 to 3.11 ms.
///
/// All of them are in force from the start on; what a host sets waits for the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ArmSettings {
    /// What ARMpac's status bytes mean; default the manual's, motion in bits 1 to 6.
    pub dialect: Dialect,
    /// The joints: ranges in ticks, the speed at boot in ms a tick. A pulse is
    /// 1.5 ms + (ticks - centre) / ticks_per_90 ms.
    pub joints: [JointInfo; JOINTS],
    /// How long the slowest of the servos takes for 60 degrees, in ms. Nothing tells where a servo
    /// is, so this is what the arm waits by before it takes power away, should its joints have been
    /// faster (at the lowest SPEEDs). Default 300: twice the 150 of an ordinary hobby servo without
    /// load. Our assumption; a slower servo may be short of home when power goes off.
    pub servo_ms_per_60_deg: u16,
    /// Idle seconds until the arm parks itself, 0 is never; default 600.
    pub autopark_s: u16,
    /// Seconds until a closed gripper goes home, 0 is never; default 300.
    pub grippark_s: u16,
}

impl ArmSettings {
    /// The defaults named at each field.
    pub const DEFAULT: Self = Self {
        dialect: Dialect::Manual(MotionBits::OneToSix),
        joints: [JointInfo {
            ms_per_tick: 20,
            home: 127,
            min: 0,
            centre: 127,
            max: 255,
            ticks_per_90: 140,
        }; JOINTS],
        servo_ms_per_60_deg: 300,
        autopark_s: 600,
        grippark_s: 300,
    };
}

/// The pulse of a joint at a position, in 1/2250 ms: 1.5 ms at its centre, and 1 ms more or less 90
/// degrees from there.
pub(crate) fn joint_pulse(joint: &JointInfo, ticks: u8) -> i32 {
    const MS: i32 = ServoPulse::PER_MS as i32;
    let way = i32::from(ticks) - i32::from(joint.centre);
    MS * 3 / 2 + way * MS / i32::from(joint.ticks_per_90.max(1))
}

/// What happens when the PC of a CM-5 falls silent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum OnSilence {
    /// Goals and torque stay as they are; what turns endlessly is stopped. A robot that goes limp
    /// falls.
    #[default]
    Freeze,
    /// All torque goes: for what must not hold against a hand.
    TorqueOff,
}

/// The CM-5 bridge's settings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BridgeSettings {
    /// Baud of the board's line to the PC; default 1,000,000. A stock CM-5's port has 57,600. The
    /// virtual board has an option instead.
    pub pc_baud: u32,
    /// Silence of the PC, in ms, after which `on_silence` is done and hellos are said again; 0
    /// never. Default 1000.
    pub pc_timeout_ms: u16,
    /// What the servos do then; default [`OnSilence::Freeze`].
    pub on_silence: OnSilence,
    /// How often an ID that did not answer is asked again before there is no servo; default 2. With
    /// one byte of a hundred damaged, a PING of twice 6 bytes fails once in nine times.
    pub search_retries: u8,
    /// Whether the PC may set a servo's lock, which leaves only registers 24 to 35 writable until
    /// power-off; default no.
    pub pass_lock: bool,
}

impl BridgeSettings {
    /// The defaults named at each field.
    pub const DEFAULT: Self = Self {
        pc_baud: 1_000_000,
        pc_timeout_ms: 1000,
        on_silence: OnSilence::Freeze,
        search_retries: 2,
        pass_lock: false,
    };
}

impl Default for BridgeSettings {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// All settings of a board with motors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    /// The controller's.
    pub control: ControlSettings,
    /// The PMS5005's link's.
    pub link: LinkSettings,
    /// The Pioneer Arm's.
    pub arm: ArmSettings,
}

impl Settings {
    /// The defaults named at each field.
    pub const DEFAULT: Self = Self {
        control: ControlSettings {
            link_timeout: 2000,
            longest_move: 10_000,
            ki_reading: KiReading::WordHundredths,
            full_speed_encoder: Duty::FULL as u32,
            full_speed_potentiometer: 4096,
            collision: CollisionSettings {
                sonar_stop_cm: 30,
                sonar_clear_cm: 35,
                ir_stop: 1678,
                ir_clear: 1388,
                sonar_forward: 0b11_1111,
                forward_is_positive: [true; 2],
            },
            soft_limits: [SoftLimits::NONE; CHANNELS],
            channel_faults: ChannelFaultSettings {
                over_current: 3640,
                over_current_ms: 2000,
                driven: Duty::FULL as u16 / 2,
                stall_current: 728,
                stall_ms: 6000,
                sensor_ms: 500,
                rail_ms: 250,
                jump: 128,
                tracking_position: 512,
                tracking_velocity: 2048,
                tracking_ms: 1500,
                jump_ms: 20,
                hunt_ms: 100,
                still: 8,
                rail: 8,
                away: 64,
            },
            board_faults: BoardFaultSettings {
                motor_battery_low: 853,
                motor_battery_high: 0,
                servo_battery_low: 1820,
                main_battery_low: 2002,
                driver_hot: 1096,
                ambient_hot: 3692,
                lasts_ms: 1000,
                missed_periods: 100,
                no_motor_battery: 171,
                no_battery: 455,
                no_driver: 400,
                no_thermometer: 4040,
            },
        },
        link: LinkSettings { telemetry_period_ms: 50 },
        arm: ArmSettings::DEFAULT,
    };
}

impl Default for Settings {
    fn default() -> Self {
        Self::DEFAULT
    }
}
