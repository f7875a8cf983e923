//! The faults: when each trips, and what it stops. What becomes of a fault that has tripped is
//! [`latch`](super::latch)'s.
//!
//! | fault | trips when (defaults; every number is a setting) | stops |
//! |---|---|---|
//! | 1 over-current | 5 A or more have held the drive down for 2 s; until then it is only limited | its channel |
//! | 2 stall | at half of full drive or more and with 1 A or more (of full drive's) the shaft has not moved 8 counts for 6 s | its channel |
//! | 3 tracking error | at a quarter of full drive or more, 512 counts or 2048 counts/s off, the shaft moves away from the set-point, or the drive turns round within 100 ms: 1.5 s of it, and as much again for every 3 s in between without | its channel |
//! | 4 sensor lost | in a closed loop: driven as above, but without the current of a shaft that is held fast, no motion for 500 ms (250 ms at an end of a potentiometer); or a potentiometer has jumped 128 counts in a period and has stayed there for 20 ms | its channel |
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
//! Where a range has two ends, what lies beyond the far one is an input that is not wired: a
//! battery of 0 V runs no board. An input that floats at mid-scale reads 12 V, 4.5 V, 8 and 23
//! degrees. What sensors read before their first reading is not wired either.

use protocol::pms5005::extension::Fault;

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
        Fault::OverCurrent | Fault::Stall | Fault::TrackingError | Fault::SensorLost => {
            Stops::Channel
        }
        Fault::MotorBatteryLow
        | Fault::MotorBatteryHigh
        | Fault::MainBatteryLow
        | Fault::DriverTooHot
        | Fault::AmbientTooHot
        | Fault::PeriodMissed => Stops::Motors,
        Fault::ServoBatteryLow => Stops::MotorsAndServos,
        Fault::LinkLoss | Fault::ReceiveOverrun | Fault::SettingsCorrupt | Fault::WatchdogReset => {
            Stops::Nothing
        }
    }
}
