//! Nothing moves after a stop before a motion command does, whatever else comes, in any order and
//! any period.
//!
//! A stop is a silent host, a fault, a neutral PWM, a velocity of 0, or a suspension of a channel that
//! one of these is stopping. A suspension of a running channel only pauses it. And a stop by the host is
//! how an old one, which knows no resume, clears a latch.

use firmware::settings::Settings;
use hal_mock::board::Make;
use proptest::prelude::*;
use protocol::extension::{Action, Assignments, Request};
use protocol::pms5005::{
    Addressing, Channel, Command, Data, Gain, Loop, Method, Move, Parameter, Polarity, Quantity,
    Repeat, Reports, Scope, Sensor,
};
use tests::Bench;
use tests::extension::assign;

const WHEEL: usize = 0;
/// After a stop a wheel at full speed coasts for a while.
const COASTS_MS: u64 = 1500;

/// A line without a speed limit: all that is sent at once comes in one period. And silence stops
/// timed moves too.
fn bench() -> Bench {
    let mut settings = Settings::DEFAULT;
    settings.control.longest_move = 0;
    Bench::with(Make { line_rate: 0, settings, ..Make::default() })
}

fn run(scope: Scope, run: bool) -> Command<'static> {
    Command::Run { scope, run }
}

/// How the wheel is set going.
#[derive(Clone, Copy, Debug)]
enum Motion {
    Pwm,
    Velocity,
    Position,
}

fn set_going(bench: &mut Bench, motion: Motion) {
    let wheel = Channel::ALL[WHEEL];
    match motion {
        Motion::Pwm => bench.drive(Quantity::Pwm, WHEEL, 32_767, 0),
        Motion::Velocity => bench.drive(Quantity::Velocity, WHEEL, 5000, 0),
        Motion::Position => {
            bench.configure(&[Parameter::Sensor(wheel, Sensor::Encoder)]);
            bench.drive(Quantity::Position, WHEEL, 12_000, 20_000);
        }
    }
    bench.run_alive_ms(600);
    assert!(bench.velocity(WHEEL) > 300.0, "{motion:?}: {}", bench.velocity(WHEEL));
}

/// What stops it.
#[derive(Clone, Copy, Debug)]
enum Stop {
    Silence,
    Fault,
    NeutralPwm,
    VelocityZero,
    SuspendWhileStopping,
}

fn stop(bench: &mut Bench, stop: Stop) {
    match stop {
        Stop::Silence | Stop::SuspendWhileStopping => {
            let lost = bench.board.snapshot().counters.links_lost;
            while bench.board.snapshot().counters.links_lost == lost {
                bench.run_ms(1);
            }
            if matches!(stop, Stop::SuspendWhileStopping) {
                bench.run_ms(20);
                bench.send(run(Scope::All, false));
                bench.run_ms(1);
            }
        }
        Stop::Fault => {
            // A driver that is too hot for a second.
            bench.board.plant.borrow_mut().overrides.overheat[0] = Some(1000);
            while !bench.board.snapshot().faults.stops_motor(firmware::channel::Channel::ALL[WHEEL])
            {
                bench.run_alive_ms(1);
            }
            bench.board.plant.borrow_mut().overrides.overheat[0] = None;
        }
        Stop::NeutralPwm => bench.drive(Quantity::Pwm, WHEEL, 16_384, 0),
        Stop::VelocityZero => bench.drive(Quantity::Velocity, WHEEL, 0, 0),
    }
    bench.run_ms(1);
}

fn settings(number: u16, value: i32) -> Data {
    let mut data = Data::new();
    Assignments::emit(number, value, &mut data).unwrap();
    data
}

/// Everything that is no motion command, from a host that is there.
fn no_motion() -> impl Strategy<Value = fn(&mut Bench)> {
    fn configure(bench: &mut Bench, parameter: Parameter) {
        bench.configure(&[parameter]);
    }
    prop::sample::select(vec![
        (|b| b.send(run(Scope::All, true))) as fn(&mut Bench),
        |b| b.send(run(Scope::All, true)),
        |b| b.send(run(Scope::Motor(Channel::ALL[WHEEL]), true)),
        |b| b.send(run(Scope::All, false)),
        |b| b.send(run(Scope::Motor(Channel::ALL[WHEEL]), false)),
        |b| configure(b, Parameter::Method(Channel::ALL[WHEEL], Method::Pwm)),
        |b| configure(b, Parameter::Method(Channel::ALL[WHEEL], Method::Velocity)),
        |b| configure(b, Parameter::Method(Channel::ALL[WHEEL], Method::Position)),
        |b| configure(b, Parameter::Sensor(Channel::ALL[WHEEL], Sensor::Encoder)),
        |b| configure(b, Parameter::Sensor(Channel::ALL[WHEEL], Sensor::SinglePotentiometer)),
        |b| configure(b, Parameter::Polarity(Channel::ALL[WHEEL], Polarity::Negative)),
        |b| configure(b, Parameter::Polarity(Channel::ALL[WHEEL], Polarity::Positive)),
        |b| {
            let gain = Gain::Proportional(500);
            configure(b, Parameter::Gain(Channel::ALL[WHEEL], Loop::Velocity, gain));
        },
        |b| {
            let gain = Gain::Integral { integer: 5, fraction: 0 };
            configure(b, Parameter::Gain(Channel::ALL[WHEEL], Loop::Position, gain));
        },
        |b| configure(b, Parameter::CollisionProtection(true)),
        |b| b.send(Command::Ping),
        |b| b.send(Command::GpioOutputs(0x55)),
        |b| b.drive(Quantity::Servo, 2, 3000, 0), // a servo's motion is none of a motor's
        |b| b.send(Command::Telemetry { reports: Reports::All, repeat: Repeat::Stop }),
        |b| b.send(Command::Extension(Request::Do(Action::ClearFaults))),
        |b| b.send(Command::Extension(Request::Do(Action::Save))),
        |b| b.send_raw(7, &settings(3, 8000)),
        |b| b.send_raw(7, &settings(1, 300)),
        |b| b.send_raw(7, &settings(6, 700)),
        |b| b.send_raw(7, &settings(180, 500)),
        |b| b.send_raw(7, &settings(181, 2000)),
        |b| b.send_raw(7, &assign(&[(81, 31_767), (80, 1000)])),
        |b| b.send_raw(7, &assign(&[(81, 9000), (80, 4000)])),
        |b| b.run_ms(1),
        |b| b.run_ms(40),
        |b| b.run_alive_ms(300),
        |b| b.run_ms(2100),
    ])
}

/// Whether the wheel is still driven, or still turns: from then on nothing may change that.
fn assert_at_rest(bench: &mut Bench, what: &str) {
    let at = bench.position(WHEEL);
    bench.run_alive_ms(1000);
    let moved = bench.position(WHEEL) - at;
    assert!(moved.abs() <= 20, "{what}: moved {moved} counts, {:?}", bench.bridge(WHEEL));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..Default::default() })]
    #[test]
    fn nothing_but_a_motion_command_moves_what_was_stopped(
        motion in prop::sample::select(vec![Motion::Pwm, Motion::Velocity, Motion::Position]),
        by in prop::sample::select(vec![
            Stop::Silence, Stop::Fault, Stop::NeutralPwm, Stop::VelocityZero,
            Stop::SuspendWhileStopping,
        ]),
        late in 0..120_u64,
        events in prop::collection::vec(no_motion(), 0..12),
    ) {
        let mut bench = bench();
        set_going(&mut bench, motion);
        stop(&mut bench, by);
        bench.run_ms(late);
        for event in events {
            event(&mut bench);
        }
        bench.run_alive_ms(COASTS_MS);
        assert_at_rest(&mut bench, &format!("{motion:?} stopped by {by:?}"));

        // And a motion command moves it, of whatever method and by whatever sensor it is now.
        bench.send(Command::Extension(Request::Do(Action::ClearFaults)));
        let wheel = Channel::ALL[WHEEL];
        bench.configure(&[Parameter::Method(wheel, Method::Pwm)]);
        bench.send_raw(7, &assign(&[(80, 0), (81, 0), (180, 0)]));
        bench.drive(Quantity::Pwm, WHEEL, 16_384 + 8000, 0);
        bench.run_alive_ms(200);
        prop_assert!(bench.velocity(WHEEL) > 1000.0, "{}", bench.velocity(WHEEL));
    }
}

#[test]
fn a_suspension_and_a_resume_in_one_write_do_not_undo_a_stop_by_silence() {
    for late in 0..60 {
        let mut bench = bench();
        set_going(&mut bench, Motion::Pwm);
        stop(&mut bench, Stop::Silence);
        bench.run_ms(late);
        bench.board.line.host_sends(&[0x5E, 2, 1, 0, 0x1E, 1, 0, 0xB7, 0x5E, 0x0D]);
        bench.board.line.host_sends(&[0x5E, 2, 1, 0, 0x1E, 1, 1, 0xE9, 0x5E, 0x0D]);
        bench.run_alive_ms(200);
        assert_eq!(bench.bridge(WHEEL), (0, false), "{late} ms after the stop began");
    }
}

#[test]
fn a_method_and_a_resume_in_one_period_do_not_undo_a_stop_by_silence() {
    for late in 0..60 {
        let mut bench = bench();
        set_going(&mut bench, Motion::Velocity);
        stop(&mut bench, Stop::Silence);
        bench.run_ms(late);
        bench.configure(&[Parameter::Method(Channel::ALL[WHEEL], Method::Pwm)]);
        bench.send(run(Scope::All, true));
        bench.run_alive_ms(200);
        assert_eq!(bench.bridge(WHEEL), (0, false), "{late} ms after the stop began");
    }
}

#[test]
fn a_running_channel_that_is_suspended_is_paused_and_goes_on_when_it_is_resumed() {
    for motion in [Motion::Pwm, Motion::Velocity, Motion::Position] {
        let mut bench = bench();
        set_going(&mut bench, motion);
        bench.send(run(Scope::All, false));
        bench.run_alive_ms(COASTS_MS);
        assert_eq!(bench.bridge(WHEEL), (0, false));
        bench.send(run(Scope::All, true));
        bench.run_alive_ms(300);
        assert!(bench.velocity(WHEEL) > 300.0, "{motion:?}: {}", bench.velocity(WHEEL));
    }
}

#[test]
fn a_stop_that_is_refused_leaves_a_paused_move_as_it_was() {
    let mut bench = bench();
    set_going(&mut bench, Motion::Position);
    bench.configure(&[Parameter::Method(Channel::ALL[WHEEL], Method::Position)]);
    bench.send(run(Scope::All, false));
    bench.run_alive_ms(COASTS_MS);
    let refused = bench.board.refused();
    bench.drive(Quantity::Velocity, WHEEL, 0, 0);
    bench.run_alive_ms(20);
    assert_eq!(bench.board.refused(), refused + 1, "a position was chosen for it");
    assert_eq!(bench.bridge(WHEEL), (0, false));
    bench.send(run(Scope::All, true));
    bench.run_alive_ms(300);
    assert!(bench.velocity(WHEEL) > 300.0, "{}", bench.velocity(WHEEL));
}

#[test]
fn a_timed_move_that_silence_stops_stays_stopped_although_the_host_speaks_a_moment_later() {
    for late in 0..4 {
        let mut bench = bench();
        set_going(&mut bench, Motion::Position);
        let lost = bench.board.snapshot().counters.links_lost;
        while bench.board.snapshot().counters.links_lost == lost {
            bench.run_ms(1);
        }
        bench.run_ms(late);
        bench.send(Command::Ping);
        bench.run_ms(3);
        let stands = bench.board.snapshot().channels[WHEEL].set_point;
        bench.run_alive_ms(COASTS_MS);
        assert_eq!(bench.board.snapshot().channels[WHEEL].set_point, stands, "{late} ms later");
    }
}

#[test]
fn a_move_without_a_time_that_was_paused_is_broken_off_by_silence_as_any_other() {
    let mut bench = Bench::with(Make { line_rate: 0, ..Make::default() });
    let wheel = Channel::ALL[WHEEL];
    bench.configure(&[Parameter::Sensor(wheel, Sensor::Encoder)]);
    bench.send_raw(7, &settings(181, 2000));
    bench.drive(Quantity::Position, WHEEL, 15_000, 0);
    bench.run_alive_ms(600);
    bench.send(run(Scope::Motor(wheel), false));
    bench.run_ms(20);
    bench.send(run(Scope::Motor(wheel), true));
    let lost = bench.board.snapshot().counters.links_lost;
    while bench.board.snapshot().counters.links_lost == lost {
        bench.run_ms(1);
    }
    let stands = bench.board.snapshot().channels[WHEEL].set_point;
    bench.run_ms(500);
    assert_eq!(bench.board.snapshot().channels[WHEEL].set_point, stands);
}

#[test]
fn a_sensor_that_jumps_drives_nothing_that_stands_at_neutral() {
    for (low, high) in [(1000, 3000), (0, 2000)] {
        let mut bench = bench();
        let joint = 5;
        bench.send_raw(7, &assign(&[(88 + 2, low), (89 + 2, high)]));
        bench.drive(Quantity::Pwm, joint, 16_384 + 3000, 0);
        bench.run_alive_ms(50);
        bench.drive(Quantity::Pwm, joint, 16_384, 0);
        bench.run_alive_ms(COASTS_MS);
        for reading in [Some(1039), Some(2047), Some(2990), None, Some(0), Some(4095)] {
            bench.board.plant.borrow_mut().overrides.potentiometers[joint] = reading;
            for ms in 0..100 {
                bench.run_ms(1);
                assert_eq!(bench.bridge(joint).0, 0, "{ms} ms after it reads {reading:?}");
            }
        }
    }
}

/// Pulls the wheel's encoder under way, and plugs it in again when the channel has tripped.
fn trip(bench: &mut Bench) {
    bench.drive(Quantity::Velocity, WHEEL, 8000, 0);
    bench.run_alive_ms(800);
    let pull = |bench: &Bench, at| bench.board.plant.borrow_mut().overrides.encoders[WHEEL] = at;
    pull(bench, Some(100));
    for _ in 0..4000 {
        bench.run_alive_ms(1);
        if is_latched(bench) {
            pull(bench, None);
            return;
        }
    }
    panic!("a pulled encoder is no fault");
}

fn is_latched(bench: &Bench) -> bool {
    bench.board.snapshot().faults.stops_motor(firmware::channel::Channel::ALL[WHEEL])
}

/// The stops that an old host knows.
const STOPS: [fn(&mut Bench); 6] = [
    |b| b.send(run(Scope::All, false)),
    |b| b.send(run(Scope::Motor(Channel::ALL[WHEEL]), false)),
    |b| b.drive(Quantity::Pwm, WHEEL, 16_384, 0),
    |b| b.drive(Quantity::Pwm, WHEEL, 16_383, 0),
    |b| b.drive(Quantity::Velocity, WHEEL, 0, 0),
    |b| all_six(b, Quantity::Velocity, 0),
];

fn all_six(bench: &mut Bench, quantity: Quantity, target: i16) {
    let (addressing, targets) = (Addressing::All, [Some(target); 6]);
    bench.send(Command::Move(Move { quantity, addressing, targets, periods: 0 }));
}

#[test]
fn a_stop_a_second_after_the_trip_clears_a_channels_latch_and_moves_nothing() {
    for stop in STOPS {
        let mut bench = bench();
        trip(&mut bench);
        bench.run_alive_ms(900);
        stop(&mut bench);
        bench.run_alive_ms(50);
        assert!(is_latched(&bench), "too soon");
        bench.run_alive_ms(100);
        stop(&mut bench);
        bench.run_alive_ms(50);
        assert!(!is_latched(&bench));
        assert_eq!(bench.bridge(WHEEL), (0, false));
        bench.run_alive_ms(COASTS_MS);
        assert_at_rest(&mut bench, "cleared by a stop");
        bench.drive(Quantity::Velocity, WHEEL, 1000, 0);
        bench.run_alive_ms(800);
        assert!((950.0..1050.0).contains(&bench.velocity(WHEEL)), "{}", bench.velocity(WHEEL));
    }
}

#[test]
fn what_is_no_stop_of_this_channel_clears_nothing() {
    let no_stops: [fn(&mut Bench); 6] = [
        |b| b.drive(Quantity::Pwm, WHEEL, 0, 0), // full reverse
        |b| b.drive(Quantity::Velocity, WHEEL, 1000, 0),
        |b| b.drive(Quantity::Position, WHEEL, 0, 0),
        |b| b.drive(Quantity::Velocity, 1, 0, 0),
        |b| b.send(run(Scope::Motor(Channel::ALL[1]), false)),
        |b| b.send(Command::Ping),
    ];
    for command in no_stops {
        let mut bench = bench();
        trip(&mut bench);
        bench.run_alive_ms(2000);
        command(&mut bench);
        bench.run_alive_ms(50);
        assert!(is_latched(&bench));
        assert_eq!(bench.bridge(WHEEL), (0, false));
    }
    // Nor does a stop while the current is over its threshold.
    let mut bench = bench();
    trip(&mut bench);
    bench.run_alive_ms(2000);
    bench.board.plant.borrow_mut().overrides.currents[WHEEL] = Some(3700);
    bench.drive(Quantity::Pwm, WHEEL, 16_384, 0);
    bench.run_alive_ms(50);
    assert!(is_latched(&bench));
}

#[test]
fn a_channel_that_trips_three_times_in_a_minute_waits_for_a_resume() {
    let stop = |bench: &mut Bench| {
        bench.run_alive_ms(1100);
        bench.drive(Quantity::Pwm, WHEEL, 16_384, 0);
        bench.run_alive_ms(50);
        is_latched(bench)
    };
    let mut bench = bench();
    trip(&mut bench);
    assert!(!stop(&mut bench));
    trip(&mut bench);
    assert!(!stop(&mut bench));
    trip(&mut bench);
    assert!(stop(&mut bench) && stop(&mut bench), "three times");
    bench.send(run(Scope::All, true));
    bench.run_alive_ms(50);
    assert!(!is_latched(&bench));
    // And counts anew.
    trip(&mut bench);
    assert!(!stop(&mut bench));
    bench.run_alive_ms(61_000);
    trip(&mut bench);
    assert!(!stop(&mut bench));
    trip(&mut bench);
    assert!(!stop(&mut bench), "one of three was more than a minute ago");
}

#[test]
fn a_boards_latch_must_have_stood_for_a_second_too() {
    let mut bench = bench();
    set_going(&mut bench, Motion::Pwm);
    stop(&mut bench, Stop::Fault);
    bench.run_alive_ms(800);
    all_six(&mut bench, Quantity::Pwm, 16_384);
    bench.run_alive_ms(50);
    assert!(is_latched(&bench), "too soon");
    bench.run_alive_ms(200);
    all_six(&mut bench, Quantity::Pwm, 16_384);
    bench.run_alive_ms(50);
    assert!(!is_latched(&bench));
}

#[test]
fn a_boards_latch_is_cleared_when_its_cause_has_gone_and_every_channel_is_stopped() {
    let mut bench = bench();
    bench.run_alive_ms(100);
    bench.run_ms(2100); // a host that was silent, which stops nothing
    set_going(&mut bench, Motion::Pwm);
    stop(&mut bench, Stop::Fault);
    bench.run_alive_ms(2000);
    let last = Scope::Motor(Channel::ALL[5]);
    for channel in &Channel::ALL[..5] {
        bench.send(run(Scope::Motor(*channel), false));
    }
    bench.run_alive_ms(50);
    assert!(is_latched(&bench), "channel 5 has not been stopped");
    bench.board.plant.borrow_mut().overrides.overheat[0] = Some(1000);
    bench.run_alive_ms(1200);
    bench.send(run(last, false));
    bench.run_alive_ms(50);
    assert!(is_latched(&bench), "it is too hot again");
    // Nor does a setting that has nothing to do with it make the board forget that it is.
    bench.send_raw(7, &settings(3, 8000));
    all_six(&mut bench, Quantity::Pwm, 16_384);
    bench.run_alive_ms(50);
    assert!(is_latched(&bench));
    bench.board.plant.borrow_mut().overrides.overheat[0] = None;
    bench.run_alive_ms(50);
    bench.send(run(last, false));
    bench.run_alive_ms(50);
    assert!(is_latched(&bench), "the others were stopped while it was too hot");
    all_six(&mut bench, Quantity::Pwm, 16_384);
    bench.run_alive_ms(50);
    assert!(!is_latched(&bench));
    let left = bench.board.snapshot().shown_fault;
    let silence = left.record.map(|record| record.fault);
    assert_eq!((left.total, silence), (1, Some(firmware::safety::faults::Fault::LinkLoss)));
    bench.drive(Quantity::Pwm, WHEEL, 16_384 + 8000, 0);
    bench.run_alive_ms(50);
    assert_eq!(bench.bridge(WHEEL), (8000, true));
}
