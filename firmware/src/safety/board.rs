//! The monitor of what all channels share: batteries, temperatures, control periods in time.

use super::faults::Fault;

use crate::ports::Sensors;
use crate::settings::BoardFaultSettings;

/// What is looked at, one thing a period: so the time between two looks at the same one is 8 ms.
const CHECKS: [Fault; 1 << LOOK_SHIFT] = [
    Fault::MotorBatteryLow,
    Fault::MotorBatteryHigh,
    Fault::ServoBatteryLow,
    Fault::MainBatteryLow,
    Fault::DriverTooHot, // driver 1
    Fault::DriverTooHot, // driver 2
    Fault::AmbientTooHot,
    Fault::PeriodMissed,
];
const LOOK_SHIFT: u32 = 3;

/// What a late period adds to the measure, and so one in eight of them never adds up.
const LATE: u16 = 8;

/// The monitor's memory.
#[derive(Clone, Copy, Debug, Default)]
pub struct BoardMonitor {
    turn: u8,
    /// For how many looks each reading has been where it must not be.
    looks: [u16; CHECKS.len()],
    /// Up by [`LATE`] with a period that is missed, down by one with every period.
    lateness: u16,
    /// How late the last one of these was.
    latency_us: u16,
}

impl BoardMonitor {
    /// One period: what has tripped, if anything, and the first values of
    /// the record of the fault. Whatever lasts, trips again and again.
    pub fn step(
        &mut self,
        now: &Sensors,
        settings: &BoardFaultSettings,
    ) -> Option<(Fault, [u16; 2])> {
        // What is beyond the threshold would keep the fault latched long after its cause is gone.
        let most = lateness_that_trips(settings).saturating_add(LATE);
        self.lateness = self.lateness.min(most).saturating_sub(1);
        self.turn = self.turn.wrapping_add(1);
        let [main, motors, servos] = now.battery;
        let [driver_1, driver_2] = now.overheat;
        let hot_from = if settings.ambient_hot > 0 { settings.ambient_hot } else { u16::MAX };
        let high_from =
            if settings.motor_battery_high > 0 { settings.motor_battery_high } else { u16::MAX };
        let check = usize::from(self.turn) % CHECKS.len();
        // It is a fault if the reading is from here up to there; there itself is past it.
        let (reading, from, to) = match check {
            0 => (motors, settings.no_motor_battery, settings.motor_battery_low),
            1 => (motors, high_from, u16::MAX),
            2 => (servos, settings.no_battery, settings.servo_battery_low),
            3 => (main, settings.no_battery, settings.main_battery_low),
            4 => (driver_1, settings.no_driver, settings.driver_hot),
            5 => (driver_2, settings.no_driver, settings.driver_hot),
            6 => (now.temperature, hot_from, settings.no_thermometer),
            _ => {
                return self
                    .is_late(settings)
                    .then_some((Fault::PeriodMissed, [self.latency_us, 0]));
            }
        };
        let (looks, &fault) = (self.looks.get_mut(check)?, CHECKS.get(check)?);
        let is_wrong = from <= reading && reading < to;
        *looks = if is_wrong { looks.saturating_add(1) } else { 0 };
        let values = if fault == Fault::DriverTooHot { now.overheat } else { [reading, 0] };
        has_lasted(*looks, settings).then_some((fault, values))
    }

    /// Whether what makes this fault is there still: it has lasted, and was so when last looked at.
    pub fn lasts(&self, fault: Fault, settings: &BoardFaultSettings) -> bool {
        let mut checks = CHECKS.iter().zip(self.looks).filter(|&(of, _)| *of == fault);
        match fault {
            Fault::PeriodMissed => self.is_late(settings),
            _ => checks.any(|(_, looks)| has_lasted(looks, settings)),
        }
    }

    /// The thresholds are others: what was looked at by the old ones does not count.
    pub fn forget_looks(&mut self) {
        self.looks = Default::default();
    }

    /// A control period has begun so late that it was missed.
    pub fn period_missed(&mut self, latency_us: u16) {
        self.latency_us = latency_us;
        self.lateness = self.lateness.saturating_add(LATE);
    }

    fn is_late(&self, settings: &BoardFaultSettings) -> bool {
        settings.missed_periods > 0 && self.lateness >= lateness_that_trips(settings)
    }
}

/// Of so many in a row, each takes one back.
fn lateness_that_trips(settings: &BoardFaultSettings) -> u16 {
    settings.missed_periods.saturating_mul(LATE - 1)
}

/// Whether a reading has been wrong for long enough.
fn has_lasted(looks: u16, settings: &BoardFaultSettings) -> bool {
    looks > settings.lasts_ms >> LOOK_SHIFT
}
