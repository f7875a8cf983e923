//! The faults: when each trips, and what it stops. What becomes of a fault that has tripped is
//! [`latch`](super::latch)'s.
//!
//! | fault | trips when (defaults; every number is a setting) | stops |
//! |---|---|---|
//! | 1 over-current | 5 A or more have held the drive down for 2 s, the second in which it is given back included; until then it is only limited | its channel |
//! | 2 stall | the shaft draws the current of one that is held at this duty (1 A of full drive's, and 0.25 A at least) and has not moved 8 counts for 6 s, 128 counts off in a position loop, 8 counts/s in a velocity loop; the time begins anew with every reversal of the drive. PWM of which nobody has said that a sensor measures it: the current alone. Not while a soft limit holds the shaft | its channel |
//! | 3 tracking error | in a closed loop, or where a soft limit brakes a PWM: above the dead band (4 % of full drive) the shaft moves against the drive and away from the set-point without slowing down, as far as it comes in 150 ms at full speed (settings 3, 4); or the loop hunts: it turns its drive round, at a quarter of full drive or more, within 100 ms though its set-point has stood for 500 ms: 1.5 s of it, and as much again for every 3 s in between without | its channel |
//! | 4 sensor lost | in a closed loop: above the dead band, without the current of a shaft that is held at this duty, no motion of 8 counts for 2 s; at half of full drive or more for 500 ms (250 ms at an end of a potentiometer); or a potentiometer has jumped 128 counts in a period and has stayed there for 20 ms | its channel |
//! | 5 overload | 2.5 A for ever are borne, more for a while (time constant 10 s); then the drive is limited to what brings the current back, and that is no fault; it is one if for 2 s of that the current is 5 % above | its channel |
//! | 6 current sensor | a current input reads 0.25 A or more for 500 ms while the channel is off, or neutral with its shaft at rest; until it reads less there it counts as none | nothing |
//! | 16 motor battery low | 1 V to 5 V for 1 s | all DC channels |
//! | 17 motor battery high | off by default: the board measures to 24 V, and so much is allowed | all DC channels |
//! | 18 servo battery low | 1 V to 4 V for 1 s | all DC channels and servos |
//! | 19 main battery low | 1 V to 4.4 V for 1 s | all DC channels |
//! | 20 driver too hot | 90 to 150 degrees for 1 s | all DC channels |
//! | 21 ambient too hot | 70 to 80 degrees for 1 s | all DC channels |
//! | 22 link loss | a host that was heard is silent for 2 s | nothing more: the ramp of [`link`](super::link) has stopped it, and the next motion command goes |
//! | 23 control period missed | 100 periods in a row have begun a period late or more; with others in between, more of them; one in eight, never | all DC channels |
//! | 24 receive overrun | the line says so | nothing |
//! | 25 settings corrupt | at boot | nothing |
//! | 26 watchdog reset | at boot | nothing |
//!
//! Whether a channel has a current sensor is a setting of it (100 and up). Without one, or with an
//! input that floats (fault 6), there is no stall by current and no overload, and fault 4 needs the
//! error of fault 2 too; a snapshot says of which channels that is so, and which are limited, and why.
//!
//! What cannot be told, with a current sensor and without:
//!
//! | fault | with | without |
//! |---|---|---|
//! | 1 | a short between two readings of the converter (1 ms) | all of it |
//! | 2 | a motor that draws less than setting 51 of it when it is held; one held by less than 0.25 A, or within 128 counts or 8 counts/s of its set-point, or whose drive a host turns round more often than every 6 s; in PWM without a sensor a motor that turns at less than two thirds of its free speed looks like a held one | all of it: a held shaft in a closed loop is fault 4, in PWM nothing |
//! | 3 | a swapped sensor while the loop asks for less than the dead band; a hand that drives the shaft back against the loop looks like one | the same |
//! | 4 | below the dead band; below the duty whose held current friction draws (6 % on the default wheel); a sensor that counts, but wrongly; a potentiometer that trembles under a drive that turns round | the same, and whatever keeps the error below setting 78 |
//! | 5 | what else heats a motor, and how hot it was at boot | all of it |
//! | 6 | an input that floats below 0.25 A, or only while the channel is driven; in PWM without a sensor, until the channel is off | of no interest |
//!
//! Where a range has two ends, what lies beyond the far one is an input that is not wired: a
//! battery of 0 V runs no board. An input that floats at mid-scale reads 12 V, 4.5 V, 8 and 23
//! degrees. What sensors read before their first reading is not wired either.

use crate::channel::Channel;

/// A fault, with its number: a channel's below 16, the board's from 16 on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u8)]
pub enum Fault {
    /// A channel's motor draws too much.
    OverCurrent = 1,
    /// A channel is driven and does not turn.
    Stall = 2,
    /// A channel does not follow its set-point.
    TrackingError = 3,
    /// A channel's sensor says what cannot be.
    SensorLost = 4,
    /// A channel's motor draws too much for ever, however little it is driven.
    Overload = 5,
    /// A channel's current input reads a current where none can be.
    CurrentSensor = 6,
    /// The motors' battery is low.
    MotorBatteryLow = 16,
    /// The motors' battery is too high.
    MotorBatteryHigh = 17,
    /// The servos' battery is low.
    ServoBatteryLow = 18,
    /// The main board's battery is low.
    MainBatteryLow = 19,
    /// A motor driver board is too hot.
    DriverTooHot = 20,
    /// The surroundings are too hot.
    AmbientTooHot = 21,
    /// The host has fallen silent.
    LinkLoss = 22,
    /// A control period began too late.
    PeriodMissed = 23,
    /// Bytes of the host were lost.
    ReceiveOverrun = 24,
    /// The stored settings were damaged or foreign: the board runs on defaults.
    SettingsCorrupt = 25,
    /// The watchdog has restarted the board.
    WatchdogReset = 26,
}

impl Fault {
    /// All faults, in the order of their numbers.
    pub const ALL: &[Self] = &[
        Self::OverCurrent,
        Self::Stall,
        Self::TrackingError,
        Self::SensorLost,
        Self::Overload,
        Self::CurrentSensor,
        Self::MotorBatteryLow,
        Self::MotorBatteryHigh,
        Self::ServoBatteryLow,
        Self::MainBatteryLow,
        Self::DriverTooHot,
        Self::AmbientTooHot,
        Self::LinkLoss,
        Self::PeriodMissed,
        Self::ReceiveOverrun,
        Self::SettingsCorrupt,
        Self::WatchdogReset,
    ];

    /// Its number.
    pub const fn number(self) -> u8 {
        self as u8
    }
}

impl core::fmt::Display for Fault {
    /// Its name.
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::OverCurrent => "over current",
            Self::Stall => "stall",
            Self::TrackingError => "tracking error",
            Self::SensorLost => "sensor lost",
            Self::Overload => "overload",
            Self::CurrentSensor => "current sensor",
            Self::MotorBatteryLow => "motor battery low",
            Self::MotorBatteryHigh => "motor battery high",
            Self::ServoBatteryLow => "servo battery low",
            Self::MainBatteryLow => "main battery low",
            Self::DriverTooHot => "driver too hot",
            Self::AmbientTooHot => "ambient too hot",
            Self::LinkLoss => "link loss",
            Self::PeriodMissed => "period missed",
            Self::ReceiveOverrun => "receive overrun",
            Self::SettingsCorrupt => "settings corrupt",
            Self::WatchdogReset => "watchdog reset",
        })
    }
}

/// A fault that has tripped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FaultRecord {
    /// Which.
    pub fault: Fault,
    /// Of which channel; `None` is the board.
    pub channel: Option<Channel>,
    /// Uptime in ms when it tripped.
    pub uptime_ms: u32,
    /// What was true then, by the fault: the extension's table of faults names the values.
    pub values: [i16; 3],
}

/// What a fault keeps off while it is latched.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stops {
    /// Nothing: it is recorded.
    Nothing,
    /// Its DC channel.
    Channel,
    /// All DC channels.
    Motors,
    /// All DC channels and all servos.
    MotorsAndServos,
}

/// What this fault stops.
pub const fn stops(fault: Fault) -> Stops {
    match fault {
        Fault::OverCurrent
        | Fault::Stall
        | Fault::TrackingError
        | Fault::SensorLost
        | Fault::Overload => Stops::Channel,
        Fault::MotorBatteryLow
        | Fault::MotorBatteryHigh
        | Fault::MainBatteryLow
        | Fault::DriverTooHot
        | Fault::AmbientTooHot
        | Fault::PeriodMissed => Stops::Motors,
        Fault::ServoBatteryLow => Stops::MotorsAndServos,
        Fault::CurrentSensor
        | Fault::LinkLoss
        | Fault::ReceiveOverrun
        | Fault::SettingsCorrupt
        | Fault::WatchdogReset => Stops::Nothing,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// For people who read no Rust.
    const PAGE: &str = include_str!("../../../protocol/README.md");

    #[test]
    fn the_page_of_the_wire_tells_what_each_fault_stops() {
        let (_, section) = PAGE.split_once("\n## Faults by number\n").expect("the heading");
        let section = section.split("\n## ").next().unwrap();
        let is_row = |line: &&str| line.starts_with("| ") && !line.starts_with("| number");
        let rows: Vec<Vec<_>> =
            section.lines().filter(is_row).map(|row| row.split(" | ").collect()).collect();
        assert_eq!(rows.len(), Fault::ALL.len());
        for (row, &fault) in rows.iter().zip(Fault::ALL) {
            let stops = match stops(fault) {
                Stops::Nothing => "nothing",
                Stops::Channel => "its channel",
                Stops::Motors => "all motors",
                Stops::MotorsAndServos => "all motors and servos",
            };
            assert_eq!((row[0], row[3]), (&*format!("| {}", fault.number()), stops));
        }
    }
}
