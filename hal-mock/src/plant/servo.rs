//! A hobby servo: follows its pulse at a limited rate, and stays where it is without one.

use firmware::units::ServoPulse;

use super::STEP_S;

/// 60 degrees in 0.15 s, at 90 degrees a millisecond of pulse: counts of 1/2250 ms a second.
const SLEW_PER_S: f32 = 10_000.0;
/// Where servos stand before their first pulse: the middle, 1.5 ms.
const MIDDLE: f32 = 3375.0;

/// One servo.
#[derive(Clone, Copy, Debug)]
pub struct Servo {
    position: f32,
}

impl Default for Servo {
    fn default() -> Self {
        Self { position: MIDDLE }
    }
}

impl Servo {
    /// Where its shaft is, as the width of the pulse that would hold it there, in 1/2250 ms.
    pub fn position(&self) -> f32 {
        self.position
    }

    /// One step under a pulse.
    pub fn step(&mut self, pulse: Option<ServoPulse>) {
        if let Some(pulse) = pulse {
            let way = f32::from(pulse.raw()) - self.position;
            let most = SLEW_PER_S * STEP_S;
            self.position += way.clamp(-most, most);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_slews_sixty_degrees_in_150_ms_and_rests_without_a_pulse() {
        let mut servo = Servo::default();
        let pulse = Some(ServoPulse::from_raw(3375 + 1500));
        (0..149).for_each(|_| servo.step(pulse));
        assert!((4860.0..4875.0).contains(&servo.position()), "{}", servo.position());
        servo.step(pulse);
        assert_eq!(servo.position(), 4875.0);
        (0..100).for_each(|_| servo.step(None));
        assert_eq!(servo.position(), 4875.0);
    }
}
