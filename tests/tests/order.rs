//! What the host sends reaches the controller in the order of the line, whatever the board is doing.

use embassy_time::Instant;
use firmware::command::Command;
use firmware::personality::pms5005::Pms5005;
use firmware::personality::{Boot, Effect, Session};
use firmware::settings::HostGains;
use firmware::settings::{ControlSettings, Settings};
use hal_mock::board::Make;
use protocol::extension::{Answer, Assignments, Request, Verdict};
use protocol::pms5005::{
    self as wire, Addressing, Channel, Data, Frame, Gain, Loop, Method, Move, Parameter, Quantity,
    Sensor, did,
};
use tests::Bench;

/// Numbers of settings.
const LINK_TIMEOUT: u16 = 1;
const NO_THERMOMETER: u16 = 75;

/// A line without a speed limit, so that all that is sent comes in one chunk.
fn fast() -> Bench {
    Bench::with(Make { line_rate: 0, ..Make::default() })
}

fn methods(method: Method, channels: usize) -> Vec<Parameter> {
    Channel::ALL.into_iter().take(channels).map(|c| Parameter::Method(c, method)).collect()
}

#[test]
fn a_motion_command_behind_a_save_and_new_parameters_finds_them() {
    let mut bench = fast();
    bench.configure(&methods(Method::Velocity, 6));
    bench.run_ms(50);
    bench.send_raw(did::PARAMETERS, &[0x82]);
    bench.configure(&methods(Method::Pwm, 6));
    let targets = [Some(16384 + 2000); 6];
    let (quantity, addressing) = (Quantity::Pwm, Addressing::All);
    bench.send(wire::Command::Move(Move { quantity, addressing, targets, periods: 0 }));
    bench.run_ms(100);
    assert_eq!(bench.board.refused(), 0);
    assert_eq!([0, 1, 2, 3, 4, 5].map(|motor| bench.bridge(motor)), [(2000, true); 6]);
}

/// What a session asks of the controller for one frame, and what settings are in force then.
fn asked(did: u8, data: &[u8]) -> (Vec<Effect>, ControlSettings) {
    let mut session = Pms5005::new(Settings::DEFAULT, Boot::default(), Instant::MIN);
    let mut buffer = [0; 264];
    let frame = Frame { rid: 1, res: 0, did, data }.encode(&mut buffer).unwrap();
    let mut bytes = &frame[..];
    let asked = std::iter::from_fn(|| session.receive(&mut bytes, Instant::MIN)).collect();
    (asked, session.settings().control)
}

#[test]
fn the_parameters_of_a_frame_are_one_command_and_so_are_settings_set_together() {
    let mut data = Data::new();
    for channel in Channel::ALL {
        let proportional = Gain::Proportional(100);
        Parameter::Gain(channel, Loop::Position, proportional).emit(&mut data).unwrap();
    }
    Parameter::CollisionProtection(true).emit(&mut data).unwrap();
    let mut settings = Settings::DEFAULT;
    settings.control.collision.enabled = true;
    for channel in &mut settings.control.channels {
        channel.position = HostGains { kp: 100, ..HostGains::DEFAULT };
    }
    let asked_for = asked(did::PARAMETERS, &data);
    let one = vec![Effect::Control(Command::Adopt)];
    assert_eq!(asked_for, (one.clone(), settings.control));

    let mut settings = Settings::DEFAULT;
    let mut data = Data::new();
    // The first and the last of the controller's.
    for (number, value) in [(LINK_TIMEOUT, 100), (NO_THERMOMETER, 4000)] {
        settings.set(number, value).unwrap();
        Assignments::emit(number, value, &mut data).unwrap();
    }
    assert_ne!(settings.control.board_faults, Settings::DEFAULT.control.board_faults);
    let asked_for = asked(did::PARAMETERS, &data);
    assert_eq!(asked_for, (one, settings.control));
}

#[test]
fn the_parameters_of_a_frame_take_effect_in_one_period() {
    let all = |gain| Channel::ALL.map(|channel| Parameter::Gain(channel, Loop::Position, gain));
    let mut bench = fast();
    bench.configure(&Channel::ALL.map(|c| Parameter::Sensor(c, Sensor::SinglePotentiometer)));
    bench.configure(&all(Gain::Proportional(0)));
    bench.configure(&all(Gain::Derivative(0)));
    for channel in 0..6 {
        bench.drive(Quantity::Position, channel, 3000, 0);
    }
    bench.run_ms(20);
    assert_eq!([0, 1, 2, 3, 4, 5].map(|motor| bench.bridge(motor)), [(0, true); 6]);
    bench.configure(&all(Gain::Proportional(100)));
    for _ in 0..10 {
        bench.run_ms(1);
        let is_driven = [0, 1, 2, 3, 4, 5].map(|motor| bench.bridge(motor).0 != 0);
        if is_driven.contains(&true) {
            return assert_eq!(is_driven, [true; 6]);
        }
    }
    panic!("the gains are not in force");
}

#[test]
fn settings_sent_behind_a_factory_reset_are_refused_and_do_not_reach_the_controller() {
    let mut bench = fast();
    bench.send_raw(did::PARAMETERS, &[0x83]);
    bench.configure(&methods(Method::Pwm, 5));
    let mut data = Data::new();
    Assignments::emit(LINK_TIMEOUT, 100, &mut data).unwrap();
    bench.send_raw(did::PARAMETERS, &data);
    bench.run_ms(50);
    let outcomes: Vec<_> = bench
        .received()
        .iter()
        .filter_map(|frame| match Answer::parse(frame.did, &frame.data) {
            Some(Answer::Outcome(outcome)) => Some(outcome.verdict),
            _ => None,
        })
        .collect();
    assert_eq!(outcomes, [Verdict::Busy, Verdict::Done], "the setting, then the reset");
    bench.received();
    bench.send(wire::Command::Extension(Request::Setting(LINK_TIMEOUT)));
    bench.run_ms(20);
    let told =
        bench.received().iter().find_map(|frame| match Answer::parse(frame.did, &frame.data) {
            Some(Answer::Setting(description)) => Some(description.value),
            _ => None,
        });
    assert_eq!(told, Some(2000));
    bench.drive(Quantity::Pwm, 0, 16384 + 2000, 0);
    bench.run_ms(1500);
    assert_eq!(bench.board.snapshot().counters.links_lost, 0, "the default is in force");
}
