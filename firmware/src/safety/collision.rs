//! Holds the wheels back from obstacles.

use crate::ports::Sensors;
use crate::settings::CollisionSettings;

/// Holds the wheels back from obstacles (sub-command 13).
///
/// Per direction of the robot there is one state, forward blocked or not, with hysteresis. It
/// forbids drive, it never causes any: a wheel that may not be driven forward is neutral, or
/// drives backwards.
#[derive(Clone, Copy, Debug, Default)]
pub struct CollisionGuard {
    blocked: bool,
}

impl CollisionGuard {
    /// One period: whether forward drive is forbidden.
    pub fn step(&mut self, sensors: &Sensors, settings: &CollisionSettings) -> bool {
        let (sonar_limit, ir_limit) = if self.blocked {
            (settings.sonar_clear_cm, settings.ir_clear)
        } else {
            (settings.sonar_stop_cm, settings.ir_stop)
        };
        let sonar = sensors
            .sonar_cm
            .iter()
            .enumerate()
            .any(|(i, &range)| (settings.sonar_forward >> i) & 1 == 1 && range <= sonar_limit);
        self.blocked = sonar || sensors.ir_range >= ir_limit;
        settings.enabled && self.blocked
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Settings;

    #[test]
    fn the_guard_has_hysteresis_and_starts_at_its_thresholds() {
        let settings = CollisionSettings { enabled: true, ..Settings::DEFAULT.control.collision };
        let mut guard = CollisionGuard::default();
        let mut blocks = |sonar, ir_range| {
            let sensors = Sensors { sonar_cm: [sonar; 6], ir_range, ..Sensors::UNKNOWN };
            guard.step(&sensors, &settings)
        };
        assert!(!blocks(31, 0) && blocks(30, 0) && blocks(35, 0) && !blocks(36, 0));
        assert!(!blocks(255, 1677) && blocks(255, 1678) && blocks(255, 1388) && !blocks(255, 1387));
    }

    #[test]
    fn sensors_that_do_not_look_forward_do_not_count() {
        let all = CollisionSettings { enabled: true, ..Settings::DEFAULT.control.collision };
        let settings = CollisionSettings { sonar_forward: 0b111, ..all };
        let mut guard = CollisionGuard::default();
        let behind = Sensors { sonar_cm: [255, 255, 255, 5, 5, 5], ..Sensors::UNKNOWN };
        assert!(!guard.step(&behind, &settings));
        assert!(guard.step(&behind, &all), "where all look forward");
    }
}
