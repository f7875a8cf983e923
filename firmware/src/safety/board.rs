//! The monitor of what all channels share: batteries, temperatures, control periods in time.

use protocol::pms5005::extension::Fault;

use crate::ports::Sensors;
use crate::settings::BoardFaultSettings;

/// What is looked at, one thing a period: so the time between two looks at the same one is 8 ms.
const CHECKS: usize = 8;
const LOOK_SHIFT: u32 = 3;

/// What a late period adds to the measure, and so one in eight of them never adds up.
const LATE: u16 = 8;

/// The monitor's memory.
#[derive(Clone, Copy, Debug, Default)]
pub struct BoardMonitor {
    turn: u8,
    /// For how many looks each reading has been where it must not be.
    looks: [u16; CHECKS],
    /// Up by [`LATE`] with a period that is missed, down by one with every period.
    lateness: u16,
    /// How late the last one of these was.
    latency_us: u16,
}

impl BoardMonitor {
    /// One period: what has tripped, if anything, and the first values of
    /// [`Fault::values`]. Whatever lasts, trips again and again.
    pub fn step(
        &mut self,
        now: &Sensors,
        settings: &BoardFaultSettings,
    ) -> Option<(Fault, [u16; 2])> {
        self.lateness = self.lateness.saturating_sub(1);
        self.turn = self.turn.wrapping_add(1);
        let [main, motors, servos] = now.battery;
        let [driver_1, driver_2] = now.overheat;
        let hot_from = if settings.ambient_hot > 0 { settings.ambient_hot } else { u16::MAX };
        let high_from =
            if settings.motor_battery_high > 0 { settings.motor_battery_high } else { u16::MAX };
        // Which fault it is if the reading is from here up to there; there itself is past it.
        let (fault, reading, from, to) = match self.turn & 7 {
            0 => (
                Fault::MotorBatteryLow,
                motors,
                settings.no_motor_battery,
                settings.motor_battery_low,
            ),
            1 => (Fault::MotorBatteryHigh, motors, high_from, u16::MAX),
            2 => (Fault::ServoBatteryLow, servos, settings.no_battery, settings.servo_battery_low),
            3 => (Fault::MainBatteryLow, main, settings.no_battery, settings.main_battery_low),
            4 => (Fault::DriverTooHot, driver_1, settings.no_driver, settings.driver_hot),
            5 => (Fault::DriverTooHot, driver_2, settings.no_driver, settings.driver_hot),
            6 => (Fault::AmbientTooHot, now.temperature, hot_from, settings.no_thermometer),
            _ => {
                return self
                    .is_late(settings)
                    .then_some((Fault::PeriodMissed, [self.latency_us, 0]));
            }
        };
        let looks = self.looks.get_mut(usize::from(self.turn & 7))?;
        let is_wrong = from <= reading && reading < to;
        *looks = if is_wrong { looks.saturating_add(1) } else { 0 };
        let values = if fault == Fault::DriverTooHot { now.overheat } else { [reading, 0] };
        (is_wrong && *looks > settings.lasts_ms >> LOOK_SHIFT).then_some((fault, values))
    }

    /// A control period has begun so late that it was missed.
    pub fn period_missed(&mut self, latency_us: u16) {
        self.latency_us = latency_us;
        self.lateness = self.lateness.saturating_add(LATE);
    }

    fn is_late(&self, settings: &BoardFaultSettings) -> bool {
        // Of so many in a row, each takes one back.
        let most = settings.missed_periods.saturating_mul(LATE - 1);
        most > 0 && self.lateness >= most
    }
}
