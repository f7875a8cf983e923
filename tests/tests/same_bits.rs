//! The controller gives the same output bits for the same commands and sensor values on every
//! machine: the digest below was computed once and stands here for all of them.
//!
//! Inputs come from an integer generator, not from the simulated plant, so that nothing but the
//! controller's own arithmetic is in the digest.

use firmware::channel::{Method, Polarity, Scope, Sensor};
use firmware::command::Command;
use firmware::controller::Controller;
use firmware::ports::{MotionInputs, Sensors};
use firmware::settings::{ControlSettings, Settings};

/// FNV-1a over all outputs of all periods.
struct Digest(u64);

impl Digest {
    fn take(&mut self, value: i64) {
        for byte in value.to_le_bytes() {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01B3);
        }
    }
}

fn configure(settings: &mut ControlSettings) {
    let [c0, c1, c2, c3, ..] = &mut settings.channels;
    c0.sensor = Some(Sensor::Encoder);
    c2.sensor = Some(Sensor::DualPotentiometer);
    c0.position.ki_hundredths = 8451;
    c1.velocity.ki_hundredths = 1793;
    c1.velocity.kd = 900;
    c3.position.kp = 77;
}

/// Another polarity and another method every time.
fn toggle(settings: &mut ControlSettings, period: u32) {
    let [_, c1, c2, c3, ..] = &mut settings.channels;
    let odd = period / 1000 % 2 == 1;
    let (polarity, method) = match odd {
        true => (Polarity::Negative, Method::Velocity),
        false => (Polarity::Positive, Method::Position),
    };
    c1.polarity = polarity;
    (c2.method, c3.method) = (Some(method), Some(method));
    settings.collision.enabled = odd;
}

#[test]
fn the_controller_gives_these_bits_on_every_machine() {
    // These shafts go their own way whatever drives them, the two halves of a pair do not agree,
    // and all stand at an end at last. Those are faults, and a channel that is off has no bits.
    let mut settings = Settings::DEFAULT.control;
    let faults = &mut settings.channel_faults;
    (faults.tracking_ms, faults.sensor_ms, faults.rail_ms, faults.jump) = (0, 0, 0, 0);
    (faults.lost_ms, faults.wrong_way_ms) = (0, 0);
    let mut controller = Controller::new(settings);
    let mut digest = Digest(0xCBF2_9CE4_8422_2325);
    let mut noise = 1u32;
    let mut random = |below: u32| {
        noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (noise >> 8) % below
    };
    let mut inputs = MotionInputs::default();
    for period in 0..20_000u32 {
        for count in &mut inputs.encoders {
            *count = count.wrapping_add(random(9) as u16).wrapping_sub(3);
        }
        for reading in &mut inputs.potentiometers {
            *reading = (*reading + random(8) as u16).saturating_sub(3).min(4095);
        }
        let all = |target: i16| [Some(target), None, Some(target), Some(target), None, None];
        let mut adopted = match period % 1000 {
            0 if period == 0 => {
                configure(&mut settings);
                Some(settings)
            }
            950 => {
                toggle(&mut settings, period);
                Some(settings)
            }
            _ => None,
        };
        let commands = match period % 1000 {
            100 => Some(Command::MoveMotors {
                method: Method::Position,
                targets: all(random(4096) as i16),
                periods: 300,
                origin: 0,
            }),
            400 => Some(Command::MoveMotors {
                method: Method::Velocity,
                targets: [None, Some(random(6000) as i16 - 3000), None, None, Some(900), None],
                periods: random(100) as u16,
                origin: 0,
            }),
            700 => {
                Some(Command::MoveServos { targets: all(1000 + random(5000) as i16), periods: 250 })
            }
            800 => Some(Command::MoveMotors {
                method: Method::Pwm,
                targets: [None, None, None, None, None, Some(random(32_768) as i16 - 16_384)],
                periods: random(200) as u16,
                origin: 0,
            }),
            850 => Some(Command::Run { scope: Scope::All, run: period % 2000 < 1000 }),
            900 => Some(Command::Run { scope: Scope::All, run: true }),
            _ => adopted.map(|_| Command::Adopt),
        };
        // An obstacle comes and goes; the host falls silent for three seconds of every eight.
        let sonar_cm = [if period % 700 < 100 { 20 } else { 255 }; 6];
        let sensors = Sensors { sonar_cm, ..Sensors::UNKNOWN };
        let link_frames = period - period % 8000 + (period % 8000).min(5000);
        let snapshot =
            *controller.step(commands, || adopted.take(), &inputs, &sensors, link_frames);
        for motor in snapshot.outputs.motors {
            digest.take(motor.duty.raw().into());
        }
        for encoder in snapshot.encoders {
            digest.take(encoder.velocity.to_bits().into());
        }
        for servo in snapshot.outputs.servos {
            digest.take(servo.map_or(-1, |pulse| pulse.raw().into()));
        }
    }
    assert_eq!(digest.0, 0xE79F_3BBF_E613_924A, "{:#018x}", digest.0);
}
