//! What can go wrong: numbers that never change, and what is told of each.
//!
//! A fault is *latched*: it stays in the list, with the values of the moment it tripped, until the
//! host clears it. Readings are A/D counts as in the telemetry.

use crate::data::{Data, EncodeError, Field, codes, record};

/// A fault's number, and the names of the values that are told with it.
macro_rules! faults {
    ($($(#[doc = $doc:literal])+ $name:ident = $number:literal, [$($value:literal),*];)+) => {
        codes! {
            /// What has gone wrong (byte 3 of DID 100), and the values of its bytes 9 to 14.
            Fault { $(#[doc = concat!($($doc,)+ " Values:" $(, " ", $value, ";")*)] $name = $number,)+ }
        }

        impl Fault {
            /// The names and units of the values that are told with it, as many as it has.
            pub const fn values(self) -> &'static [&'static str] {
                match self {
                    $(Self::$name => &[$($value),*],)+
                }
            }
        }
    };
}

faults! {
    /// A channel's motor draws too much.
    OverCurrent = 1, ["current (A/D)", "duty (1/16384)", "position (counts)"];
    /// A channel is driven and does not turn.
    Stall = 2, ["current (A/D)", "duty (1/16384)", "position (counts)"];
    /// A channel does not follow its set-point.
    TrackingError = 3, ["error (counts, or counts/s)", "duty (1/16384)", "position (counts)"];
    /// A channel's sensor says what cannot be.
    SensorLost = 4, ["position (counts)", "duty (1/16384)", "last good position (counts)"];
    /// A channel's motor draws too much for ever, however little it is driven.
    Overload = 5, ["current (A/D)", "duty (1/16384)", "position (counts)"];
    /// A channel's current input reads a current where none can be.
    CurrentSensor = 6, ["current (A/D)"];
    /// The motors' battery is low.
    MotorBatteryLow = 16, ["battery (A/D)"];
    /// The motors' battery is too high.
    MotorBatteryHigh = 17, ["battery (A/D)"];
    /// The servos' battery is low.
    ServoBatteryLow = 18, ["battery (A/D)"];
    /// The main board's battery is low.
    MainBatteryLow = 19, ["battery (A/D)"];
    /// A motor driver board is too hot.
    DriverTooHot = 20, ["driver 1 (A/D)", "driver 2 (A/D)"];
    /// The surroundings are too hot.
    AmbientTooHot = 21, ["temperature (A/D)"];
    /// The host has fallen silent.
    LinkLoss = 22, ["silence (ms)"];
    /// A control period began too late.
    PeriodMissed = 23, ["latency (us)"];
    /// Bytes of the host were lost.
    ReceiveOverrun = 24, [];
    /// The stored settings were damaged or foreign: the board runs on defaults.
    SettingsCorrupt = 25, [];
    /// The watchdog has restarted the board.
    WatchdogReset = 26, [];
}

/// Byte 4 of DID 100 for a fault of the board.
const NO_CHANNEL: u8 = 255;

impl Field for Option<u8> {
    fn put(&self, data: &mut Data) -> Result<(), EncodeError> {
        self.unwrap_or(NO_CHANNEL).put(data)
    }

    fn take(data: &mut &[u8]) -> Option<Self> {
        let channel = u8::take(data)?;
        Some((channel != NO_CHANNEL).then_some(channel))
    }
}

record! {
    /// A fault that has tripped.
    pub struct FaultRecord {
        /// Which.
        pub fault: Fault,
        /// Of which channel, from 0; `None` is the board.
        pub channel: Option<u8>,
        /// Uptime in ms when it tripped.
        pub uptime_ms: u32,
        /// What was true then: the values that [`Fault::values`] names, 0 beyond them.
        pub values: [i16; 3],
    }
}
