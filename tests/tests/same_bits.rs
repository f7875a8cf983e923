//! The controller gives the same output bits for the same commands and sensor values on every
//! machine: the digest below was computed once and stands here for all of them.
//!
//! Inputs come from an integer generator, not from the simulated plant, so that nothing but the
//! controller's own arithmetic is in the digest.

use firmware::command::{Command, Configuration, SetUp};
use firmware::controller::Controller;
use firmware::ports::{MotionInputs, Sensors};
use firmware::settings::Settings;
use protocol::pms5005::{Channel, Gain, Loop, Method, Parameter, Polarity, Scope, Sensor};

/// FNV-1a over all outputs of all periods.
struct Digest(u64);

impl Digest {
    fn take(&mut self, value: i64) {
        for byte in value.to_le_bytes() {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01B3);
        }
    }
}

fn configuration() -> SetUp {
    let mut configuration = Configuration::default();
    let [c0, c1, c2, c3, ..] = Channel::ALL;
    for parameter in [
        Parameter::Sensor(c0, Sensor::Encoder),
        Parameter::Sensor(c2, Sensor::DualPotentiometer),
        Parameter::Gain(c0, Loop::Position, Gain::Integral { integer: 3, fraction: 33 }),
        Parameter::Gain(c1, Loop::Velocity, Gain::Integral { integer: 1, fraction: 7 }),
        Parameter::Gain(c1, Loop::Velocity, Gain::Derivative(900)),
        Parameter::Gain(c3, Loop::Position, Gain::Proportional(77)),
    ] {
        configuration.add(parameter).unwrap();
    }
    SetUp::Parameters(configuration)
}

/// Another polarity and another method every time.
fn toggled(period: u32) -> SetUp {
    let mut configuration = Configuration::default();
    let [_, c1, c2, c3, ..] = Channel::ALL;
    let odd = period / 1000 % 2 == 1;
    let (polarity, method) = match odd {
        true => (Polarity::Negative, Method::Velocity),
        false => (Polarity::Positive, Method::Position),
    };
    for parameter in [
        Parameter::Polarity(c1, polarity),
        Parameter::Method(c2, method),
        Parameter::Method(c3, method),
        Parameter::CollisionProtection(odd),
    ] {
        configuration.add(parameter).unwrap();
    }
    SetUp::Parameters(configuration)
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
        let mut set_up = match period % 1000 {
            0 if period == 0 => Some(configuration()),
            950 => Some(toggled(period)),
            _ => None,
        };
        let commands = match period % 1000 {
            100 => Some(Command::Drive {
                method: Method::Position,
                targets: all(random(4096) as i16),
                periods: 300,
            }),
            400 => Some(Command::Drive {
                method: Method::Velocity,
                targets: [None, Some(random(6000) as i16 - 3000), None, None, Some(900), None],
                periods: random(100) as u16,
            }),
            700 => {
                Some(Command::MoveServos { targets: all(1000 + random(5000) as i16), periods: 250 })
            }
            800 => Some(Command::Drive {
                method: Method::Pwm,
                targets: [None, None, None, None, None, Some(random(32_768) as i16 - 16_384)],
                periods: random(200) as u16,
            }),
            850 => Some(Command::Run { scope: Scope::All, run: period % 2000 < 1000 }),
            900 => Some(Command::Run { scope: Scope::All, run: true }),
            _ => set_up.map(|_| Command::SetUp),
        };
        // An obstacle comes and goes; the host falls silent for three seconds of every eight.
        let sonar_cm = [if period % 700 < 100 { 20 } else { 255 }; 6];
        let sensors = Sensors { sonar_cm, ..Sensors::UNKNOWN };
        let link_frames = period - period % 8000 + (period % 8000).min(5000);
        let snapshot = controller.step(commands, || set_up.take(), &inputs, &sensors, link_frames);
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
    assert_eq!(digest.0, 0x08B3_3BD2_E028_224E, "{:#018x}", digest.0);
}
