//! What keeps people and metal safe when the host or the road does not.
//!
//! - [`LinkWatch`]: a host that falls silent is noticed;
//! - [`CollisionGuard`]: the wheels do not drive towards an obstacle.

use crate::ports::Sensors;
use crate::settings::CollisionSettings;

/// Notices that the host has fallen silent.
///
/// It watches the count of valid frames that the link has received, so a link that hangs is the
/// same as a host that does.
#[derive(Clone, Copy, Debug, Default)]
pub struct LinkWatch {
    frames: u32,
    /// Control periods since the last frame; `None` before the first.
    silence: Option<u16>,
    lost: bool,
}

/// What a period has brought.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LinkEvent {
    /// The host has just fallen silent.
    Lost,
    /// Nothing new.
    None,
}

impl LinkWatch {
    /// One period: `frames` is the count of valid frames for us so far, `timeout` the silence
    /// allowed in control periods (0: any).
    pub fn step(&mut self, frames: u32, timeout: u16) -> LinkEvent {
        if frames != self.frames {
            self.frames = frames;
            self.silence = Some(0);
            self.lost = false;
            return LinkEvent::None;
        }
        let Some(silence) = &mut self.silence else { return LinkEvent::None };
        *silence = silence.saturating_add(1);
        if timeout > 0 && *silence >= timeout && !self.lost {
            self.lost = true;
            return LinkEvent::Lost;
        }
        LinkEvent::None
    }

    /// Whether the host, once heard, is silent for too long.
    pub fn is_lost(&self) -> bool {
        self.lost
    }
}

/// Holds the wheels back from obstacles (sub-command 13).
///
/// Per direction of the robot there is one state, forward blocked or not, with hysteresis. It
/// forbids drive, it never causes any: a wheel that may not be driven forward is neutral, or
/// drives backwards.
#[derive(Clone, Copy, Debug, Default)]
pub struct CollisionGuard {
    /// Whether a host has switched it on.
    pub enabled: bool,
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
        self.enabled && self.blocked
    }

    /// Whether forward drive is forbidden now.
    pub fn is_blocking(&self) -> bool {
        self.enabled && self.blocked
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Settings;

    #[test]
    fn silence_is_noticed_once_after_exactly_the_timeout() {
        let mut watch = LinkWatch::default();
        for _ in 0..5000 {
            assert_eq!(watch.step(0, 2000), LinkEvent::None, "no host was ever there");
        }
        watch.step(1, 2000);
        let lost: Vec<_> = (1..5000).filter(|_| watch.step(1, 2000) == LinkEvent::Lost).collect();
        assert_eq!(lost, [2000]);
        assert!(watch.is_lost());
        watch.step(2, 2000);
        assert!(!watch.is_lost());
        assert!((0..65_000).all(|_| watch.step(2, 0) == LinkEvent::None), "0 is never");
    }

    #[test]
    fn the_guard_has_hysteresis_and_starts_at_its_thresholds() {
        let settings = Settings::DEFAULT.control.collision;
        let mut guard = CollisionGuard { enabled: true, ..Default::default() };
        let mut blocks = |sonar, ir_range| {
            let sensors = Sensors { sonar_cm: [sonar; 6], ir_range, ..Sensors::UNKNOWN };
            guard.step(&sensors, &settings)
        };
        assert!(!blocks(31, 0) && blocks(30, 0) && blocks(35, 0) && !blocks(36, 0));
        assert!(!blocks(255, 1677) && blocks(255, 1678) && blocks(255, 1388) && !blocks(255, 1387));
    }

    #[test]
    fn sensors_that_do_not_look_forward_do_not_count() {
        let settings =
            CollisionSettings { sonar_forward: 0b111, ..Settings::DEFAULT.control.collision };
        let mut guard = CollisionGuard { enabled: true, ..Default::default() };
        let behind = Sensors { sonar_cm: [255, 255, 255, 5, 5, 5], ..Sensors::UNKNOWN };
        assert!(!guard.step(&behind, &settings));
    }
}
