//! Why a motor does not do what was asked: every reason from its cause to the machine state (DID 102) and
//! away; what that state says else, how often, and what was refused by reason (DID 103).

use hal_mock::plant::Overrides;
use protocol::extension::{
    Action, Answer, ChannelState, Fault, MachineState, Mode, Reason, Refusals, Request, Verdict,
    flag,
};
use protocol::pms5005::{
    Channel, Command, Method, Parameter, Polarity, Quantity, Scope, Sensor, did, encode_answer,
};
use tests::Bench;
use tests::Link::Silent;

const FULL: i16 = 32_767;
const WHEEL: Channel = Channel::ALL[0];

fn state(bench: &mut Bench) -> MachineState {
    let (told, data) = bench.ask_raw(102, &[1]);
    match Answer::parse(told, &data) {
        Some(Answer::State(state)) => state,
        other => panic!("{other:?}"),
    }
}

fn wheel(bench: &mut Bench) -> ChannelState {
    state(bench).channels[0]
}

fn why(bench: &mut Bench) -> (Reason, u8) {
    let wheel = wheel(bench);
    (wheel.reason, wheel.detail)
}

fn refusals(bench: &mut Bench) -> Refusals {
    let (told, data) = bench.ask_raw(103, &[]);
    match Answer::parse(told, &data) {
        Some(Answer::Refusals(refusals)) => refusals,
        other => panic!("{other:?}"),
    }
}

fn change(bench: &Bench, change: impl FnOnce(&mut Overrides)) {
    change(&mut bench.board.plant.borrow_mut().overrides);
}

fn run(bench: &mut Bench, scope: Scope, run: bool) {
    bench.send(Command::Run { scope, run });
    bench.run_ms(10);
}

fn with_encoder() -> Bench {
    let mut bench = Bench::quiet();
    bench.configure(&[Parameter::Sensor(WHEEL, Sensor::Encoder)]);
    bench.run_ms(10);
    bench
}

/// The cause of a reason, with more of it, and what ends it.
fn cause(reason: Reason) -> (Bench, u8, fn(&mut Bench)) {
    let mut bench = with_encoder();
    let mut detail = 0;
    let end: fn(&mut Bench) = match reason {
        Reason::None => unreachable!("it has no cause"),
        Reason::Fault => {
            bench.drive(Quantity::Velocity, 0, 4000, 0);
            change(&bench, |all| all.overheat[0] = Some(1000)); // for a second
            bench.run_alive_ms(1200);
            detail = Fault::DriverTooHot.number();
            |bench| {
                change(bench, |all| all.overheat[0] = None);
                bench.run_alive_ms(1200);
                assert_eq!(bench.act(Action::ClearFaults), Verdict::Done);
            }
        }
        Reason::Silence => {
            bench.drive(Quantity::Pwm, 0, FULL, 0);
            bench.run_ms(2200);
            |bench| bench.drive(Quantity::Pwm, 0, FULL, 0)
        }
        Reason::Suspended => {
            bench.drive(Quantity::Velocity, 0, 2000, 0);
            bench.run_ms(100);
            run(&mut bench, Scope::Motor(WHEEL), false);
            |bench| run(bench, Scope::Motor(WHEEL), true)
        }
        Reason::OtherMethod => {
            bench.configure(&[Parameter::Method(WHEEL, Method::Velocity)]);
            bench.drive(Quantity::Position, 0, 1000, 0);
            detail = did::POSITION;
            |bench| bench.drive(Quantity::Velocity, 0, 100, 0)
        }
        Reason::BeyondScale => {
            bench.configure(&[Parameter::Sensor(WHEEL, Sensor::SinglePotentiometer)]);
            bench.drive(Quantity::Position, 0, 4096, 0);
            detail = did::POSITION;
            |bench| bench.drive(Quantity::Pwm, 0, 16_384, 0)
        }
        Reason::Obstacle => {
            bench.configure(&[Parameter::CollisionProtection(true)]);
            change(&bench, |all| all.sonar_cm[0] = Some(10));
            bench.drive(Quantity::Velocity, 0, 2000, 0);
            |bench| change(bench, |all| all.sonar_cm[0] = None)
        }
        Reason::SoftLimit => {
            let limits = [(80, 1000), (81, 2000)];
            assert_eq!(bench.set(&limits).0, Verdict::Done);
            assert_eq!(bench.set_count(0, 1500), Verdict::Done);
            bench.drive(Quantity::Velocity, 0, 2000, 0);
            bench.run_alive_ms(2000);
            |bench| {
                bench.drive(Quantity::Velocity, 0, -200, 0);
                bench.run_ms(100);
            }
        }
        Reason::OverCurrent => {
            bench.drive(Quantity::Pwm, 0, FULL, 0);
            change(&bench, |all| all.currents[0] = Some(4000));
            bench.run_ms(50);
            |bench| {
                change(bench, |all| all.currents[0] = None);
                bench.run_alive_ms(2000);
            }
        }
        Reason::Overload => {
            assert_eq!(bench.set(&[(52, 0)]).0, Verdict::Done); // no stall
            change(&bench, |all| all.jam[0] = Some(true));
            bench.drive(Quantity::Pwm, 0, FULL, 0);
            bench.run_alive_ms(20_000);
            |bench| {
                change(bench, |all| all.jam[0] = None);
                bench.run_alive_ms(30_000);
            }
        }
        Reason::HighestDuty => {
            assert_eq!(bench.set(&[(182, 4000)]).0, Verdict::Done);
            bench.drive(Quantity::Velocity, 0, 12_000, 0);
            bench.run_alive_ms(2000);
            |bench| {
                bench.drive(Quantity::Velocity, 0, 1000, 0);
                bench.run_alive_ms(2000);
            }
        }
        Reason::FullDrive => {
            assert_eq!(bench.set(&[(52, 0)]).0, Verdict::Done); // no stall
            change(&bench, |all| all.jam[0] = Some(true));
            bench.drive(Quantity::Velocity, 0, 1000, 0);
            bench.run_alive_ms(10_000);
            |bench| {
                change(bench, |all| all.jam[0] = None);
                bench.run_alive_ms(3000);
            }
        }
        Reason::OldCommand => {
            assert_eq!(bench.set(&[(6, 500)]).0, Verdict::Done);
            bench.drive(Quantity::Velocity, 0, 1000, 0);
            bench.run_alive_ms(1000);
            |bench| bench.drive(Quantity::Velocity, 0, 1000, 0)
        }
        Reason::Slew => {
            assert_eq!(bench.set(&[(180, 60_000)]).0, Verdict::Done);
            bench.drive(Quantity::Pwm, 0, FULL, 0);
            |bench| {
                assert_eq!(bench.set(&[(180, 0)]).0, Verdict::Done);
            }
        }
    };
    bench.run_ms(100);
    (bench, detail, end)
}

#[test]
fn every_reason_is_told_from_its_cause_until_that_has_gone() {
    for &reason in &Reason::ALL[1..] {
        let (mut bench, detail, end) = cause(reason);
        assert_eq!(why(&mut bench), (reason, detail));
        assert_eq!(why(&mut bench), (reason, detail), "it stays");
        end(&mut bench);
        bench.run_ms(100);
        assert_eq!(why(&mut bench), (Reason::None, 0), "after {reason:?}");
    }
}

#[test]
fn a_channel_that_does_what_was_asked_and_one_that_was_asked_nothing_have_no_reason() {
    let mut bench = with_encoder();
    assert_eq!(why(&mut bench), (Reason::None, 0));
    run(&mut bench, Scope::All, false);
    assert_eq!(why(&mut bench), (Reason::None, 0), "it was off already");
    for (quantity, target) in
        [(Quantity::Pwm, 20_000), (Quantity::Velocity, 900), (Quantity::Position, 3000)]
    {
        bench.drive(quantity, 0, target, 0);
        bench.run_alive_ms(3000);
        assert_eq!(why(&mut bench), (Reason::None, 0), "{quantity:?}");
    }
    // At its place before the host fell silent: nothing was broken off.
    bench.run_ms(3000);
    assert_eq!(why(&mut bench), (Reason::None, 0));
    // Full drive is all there is; a stop is done when it stands.
    bench.drive(Quantity::Pwm, 0, FULL, 0);
    bench.run_alive_ms(1000);
    assert_eq!(why(&mut bench), (Reason::None, 0));
    bench.drive(Quantity::Pwm, 0, 16_384, 0);
    bench.run_alive_ms(1000);
    assert_eq!(why(&mut bench), (Reason::None, 0));
}

/// Periods of so many ms in which the wheel has a reason.
fn with_a_reason(bench: &mut Bench, ms: u64) -> usize {
    let periods = std::cell::Cell::new(0);
    let has = |bench: &Bench| bench.board.snapshot().channels[0].reason.is_some();
    bench.run_alive_with(ms, |bench| periods.set(periods.get() + usize::from(has(bench))));
    periods.get()
}

#[test]
fn at_rest_after_a_stop_nothing_is_held_back_by_anything() {
    let mut bench = with_encoder();
    bench.configure(&[Parameter::CollisionProtection(true)]);
    bench.run_ms(10);
    assert_eq!(bench.set(&[(180, 1000)]).0, Verdict::Done);
    bench.drive(Quantity::Velocity, 0, 8000, 0);
    bench.run_alive_ms(5000);
    bench.drive(Quantity::Velocity, 0, 0, 0);
    bench.run_alive_ms(5000);
    assert_eq!(with_a_reason(&mut bench, 2000), 0, "a slew time");
    change(&bench, |all| all.sonar_cm[0] = Some(10));
    assert_eq!(with_a_reason(&mut bench, 2000), 0, "an obstacle");
    let at = i32::from(bench.board.snapshot().encoders[0].count);
    assert_eq!(bench.set(&[(80, at - 1000), (81, at)]).0, Verdict::Done);
    assert_eq!(with_a_reason(&mut bench, 2000), 0, "a soft limit");
    // Nor is one that was stopped already by a silence or a suspension.
    run(&mut bench, Scope::All, false);
    bench.run_ms(3000);
    assert_eq!(
        (why(&mut bench), state(&mut bench).flags),
        ((Reason::None, 0), flag::OBSTACLE | flag::FAULT | flag::LINK_LOST)
    );
    bench.run_alive_ms(1000);
    assert_eq!(state(&mut bench).flags & flag::LINK_LOST, 0);
}

#[test]
fn a_ramp_that_is_slower_than_the_slew_time_is_not_held_back_by_it() {
    for slew in [100, 1000] {
        let mut bench = with_encoder();
        assert_eq!(bench.set(&[(180, slew)]).0, Verdict::Done);
        bench.drive(Quantity::Velocity, 0, 8000, 10_000);
        assert_eq!(with_a_reason(&mut bench, 12_000), 0, "{slew} ms");
    }
}

#[test]
fn a_position_says_why_it_is_not_reached_and_a_load_that_is_held_is_no_reason() {
    // A share of the drive for each count: at 0.1 of it 66 counts off, and no more to be had.
    for (target, reason) in
        [(1000, Reason::HighestDuty), (-1000, Reason::HighestDuty), (100, Reason::None)]
    {
        let mut bench = with_encoder();
        assert_eq!(bench.set(&[(52, 0), (182, 1638)]).0, Verdict::Done);
        change(&bench, |all| all.jam[0] = Some(true));
        bench.drive(Quantity::Position, 0, target & i16::MAX, 0);
        bench.run_alive_ms(200);
        assert_eq!(why(&mut bench).0, reason, "{target}");
    }
}

#[test]
fn a_channel_that_is_resumed_under_a_fault_stays_off_and_is_not_suspended_behind_it() {
    let mut bench = with_encoder();
    bench.drive(Quantity::Velocity, 0, 4000, 0);
    bench.run_alive_ms(200);
    run(&mut bench, Scope::All, false);
    change(&bench, |all| all.overheat[0] = Some(1000));
    bench.run_alive_ms(1200);
    run(&mut bench, Scope::All, true);
    assert_eq!(why(&mut bench), (Reason::Fault, Fault::DriverTooHot.number()));
    change(&bench, |all| all.overheat[0] = None);
    bench.run_alive_ms(1200);
    assert_eq!(bench.act(Action::ClearFaults), Verdict::Done);
    bench.run_alive_ms(100);
    assert_eq!((why(&mut bench), bench.bridge(0)), ((Reason::None, 0), (0, false)));
}

#[test]
fn a_loop_that_takes_over_from_another_is_not_held_back_meanwhile() {
    for speed in [2000, -2000] {
        let mut bench = with_encoder();
        bench.drive(Quantity::Pwm, 0, 16_384 + 8000, 0);
        bench.run_alive_ms(500);
        bench.drive(Quantity::Velocity, 0, speed, 0);
        assert_eq!(with_a_reason(&mut bench, 300), 0, "{speed}");
    }
}

#[test]
fn a_target_beyond_a_soft_limit_says_so() {
    let mut bench = with_encoder();
    assert_eq!(bench.set_count(0, 1500), Verdict::Done);
    assert_eq!(bench.set(&[(80, 1000), (81, 2000)]).0, Verdict::Done);
    bench.drive(Quantity::Position, 0, 8000, 0);
    bench.run_alive_ms(3000);
    assert_eq!(why(&mut bench), (Reason::SoftLimit, 0));
    bench.drive(Quantity::Position, 0, 1600, 0);
    bench.run_alive_ms(3000);
    assert_eq!(why(&mut bench), (Reason::None, 0));
}

#[test]
fn a_position_with_a_slew_time_is_held_as_firmly_when_the_host_is_silent() {
    let mut bench = with_encoder();
    assert_eq!(bench.set(&[(180, 500)]).0, Verdict::Done);
    bench.drive(Quantity::Position, 0, 12_000, 4000);
    bench.until(Silent, 2100, |bench| bench.board.snapshot().link_loss);
    bench.run_ms(4000);
    let at = bench.position(0);
    assert!((11_950..=12_030).contains(&at), "the move goes on to its end: {at}");
}

#[test]
fn a_count_is_set_in_the_order_of_what_is_asked_however_fast_the_line() {
    use hal_mock::board::Make;
    let frame = |command: Command| command.encode(0, &mut [0; 264]).unwrap().to_vec();
    let set = |count| frame(Command::Extension(Request::SetCount { channel: 0, count }));
    let go = |quantity, target| {
        frame(Command::Move(protocol::pms5005::Move {
            quantity,
            addressing: protocol::pms5005::Addressing::List,
            targets: [Some(target), None, None, None, None, None],
            periods: 0,
        }))
    };
    let told = |bench: &mut Bench| {
        let outcomes = bench.received().into_iter().filter(|frame| frame.did == 101);
        outcomes.map(|frame| Verdict::from_number(frame.data[2]).unwrap()).collect::<Vec<_>>()
    };
    let unpaced = || {
        let mut bench = Bench::with(Make { line_rate: 0, ..Make::default() });
        bench.hush();
        bench.configure(&[Parameter::Sensor(WHEEL, Sensor::Encoder)]);
        bench.run_ms(10);
        bench.received();
        bench
    };
    let mut bench = unpaced();
    bench.send_bytes(&[set(20_000), go(Quantity::Position, 20_500)].concat());
    bench.run_alive_ms(3000);
    assert_eq!(told(&mut bench), [Verdict::Done]);
    let position = wheel(&mut bench).position;
    assert!((20_480..=20_520).contains(&position), "{position}");
    let mut bench = unpaced();
    bench.send_bytes(&[go(Quantity::Velocity, 2000), set(7)].concat());
    bench.run_ms(20);
    assert_eq!(told(&mut bench), [Verdict::OutputsOn]);
    let suspend = frame(Command::Run { scope: Scope::All, run: false });
    bench.send_bytes(&[suspend, set(7)].concat());
    bench.run_ms(20);
    assert_eq!(told(&mut bench), [Verdict::Done]);
    bench.send_bytes(&[set(8), set(9)].concat());
    bench.run_ms(20);
    assert_eq!(told(&mut bench), [Verdict::Busy, Verdict::Done]);
}

#[test]
fn a_move_that_silence_breaks_off_says_so_until_the_next_command() {
    let mut bench = with_encoder();
    assert_eq!(bench.set(&[(5, 0)]).0, Verdict::Done); // no timed move outlives its host
    bench.drive(Quantity::Position, 0, 8000, 10_000);
    bench.until(Silent, 2100, |bench| bench.board.snapshot().link_loss);
    bench.run_ms(50);
    assert_eq!(wheel(&mut bench).mode, Mode::Position, "it holds");
    assert_eq!(why(&mut bench), (Reason::Silence, 0));
    bench.run_alive_ms(1000);
    assert_eq!(why(&mut bench), (Reason::Silence, 0), "a host that is back commands nothing by it");
    bench.drive(Quantity::Position, 0, 3000, 0);
    bench.run_alive_ms(3000);
    assert_eq!(why(&mut bench), (Reason::None, 0));
}

#[test]
fn the_most_pressing_reason_is_told() {
    let (mut bench, ..) = cause(Reason::Slew);
    bench.configure(&[Parameter::Method(WHEEL, Method::Pwm)]);
    bench.drive(Quantity::Velocity, 0, 100, 0);
    bench.run_ms(20);
    assert_eq!(why(&mut bench), (Reason::OtherMethod, did::VELOCITY));
    run(&mut bench, Scope::Motor(WHEEL), false);
    assert_eq!(why(&mut bench), (Reason::Suspended, 0));
    change(&bench, |all| all.overheat[0] = Some(1000));
    bench.run_alive_ms(1200);
    assert_eq!(why(&mut bench), (Reason::Fault, Fault::DriverTooHot.number()));
}

#[test]
fn the_state_counts_turn_by_turn_and_with_a_sign() {
    let mut bench = with_encoder();
    bench.drive(Quantity::Velocity, 0, -16_000, 0);
    bench.run_alive_ms(6000);
    let state = state(&mut bench);
    let wheel = state.channels[0];
    let (at, speed) = (bench.position(0), bench.velocity(0));
    assert!(at < -80_000, "several turns of 32768: {at}");
    assert!((i64::from(wheel.position) - at).abs() < 1000, "{} {at}", wheel.position);
    assert!((wheel.velocity as f32 - speed).abs() < 200.0, "{} {speed}", wheel.velocity);
    assert_eq!((wheel.mode, wheel.set_point), (Mode::Velocity, -16_000));
    assert!((wheel.duty - bench.bridge(0).0).abs() < 200 && wheel.current > 0);
    let other = state.channels[1];
    assert_eq!((other.mode, other.set_point, other.duty), (Mode::Off, 0, 0));
    assert_eq!((state.flags, state.refused), (0, 0));
    assert!(state.battery.iter().all(|&battery| battery > 0));
    bench.drive(Quantity::Servo, 4, 3000, 0);
    bench.send_raw(did::VELOCITY, &[9, 0, 0]);
    bench.run_ms(20);
    let state = self::state(&mut bench);
    assert_eq!((state.servos, state.refused), ([0, 0, 0, 0, 3000, 0], 1));
    bench.run_ms(3000);
    let flags = self::state(&mut bench).flags;
    assert_eq!(flags, flag::LINK_LOST | flag::FAULT, "a question is no sign of life");
}

#[test]
fn the_state_comes_once_so_many_times_or_for_ever_at_the_period_of_its_setting() {
    let mut bench = Bench::quiet();
    let count = |bench: &mut Bench, data: &[u8], ms| {
        bench.send_raw(102, data);
        bench.run_ms(ms);
        bench.received().iter().filter(|received| received.did == 102).count()
    };
    assert_eq!(count(&mut bench, &[1], 500), 1);
    assert_eq!(count(&mut bench, &[5], 500), 5);
    assert_eq!(count(&mut bench, &[], 1000), 50, "every 20 ms");
    assert!(count(&mut bench, &[0], 500) <= 1, "one may be on its way");
    assert_eq!(bench.set(&[(33, 100)]).0, Verdict::Done);
    assert_eq!(count(&mut bench, &[], 1000), 10);
    // It runs on beside a host that reads nothing else, and keeps no motor running.
    bench.drive(Quantity::Pwm, 0, FULL, 0);
    bench.run_ms(2200);
    assert_eq!(bench.bridge(0), (0, false));
}

#[test]
fn a_line_of_115200_baud_carries_as_many_states_as_the_table_says() {
    let frame =
        encode_answer(&Answer::State(MachineState::default()), &mut [0; 264]).unwrap().len();
    assert_eq!(frame, 133);
    let mut bench = Bench::new();
    assert_eq!(bench.set(&[(33, 1)]).0, Verdict::Done);
    bench.received();
    bench.send_raw(102, &[]);
    bench.run_alive_ms(10_000);
    let received = bench.received();
    let count = |did: u8| received.iter().filter(|received| received.did == did).count();
    // Beside three telemetry frames every 50 ms, none of which is late; alone 86.
    assert!((198..=201).contains(&count(123)), "{}", count(123));
    assert!((680..=700).contains(&count(102)), "{}", count(102));
}

#[test]
fn an_encoder_counts_from_where_it_is_set_and_only_while_its_channel_is_off() {
    let mut bench = with_encoder();
    assert_eq!(bench.set_count(0, 100_000), Verdict::Done);
    bench.run_ms(5);
    let at = wheel(&mut bench);
    assert_eq!((at.position, at.velocity), (100_000, 0), "no jump is a speed");
    assert_eq!(bench.board.snapshot().encoders[0].count, 1696, "of three turns and 1696");
    // Forward by 1000 is forward by 1000.
    bench.drive(Quantity::Position, 0, 2696, 0);
    bench.run_alive_ms(3000);
    let position = wheel(&mut bench).position;
    assert!((100_980..=101_020).contains(&position), "{position}");
    assert_eq!(bench.set_count(0, 0), Verdict::OutputsOn);
    assert_eq!(wheel(&mut bench).position, position);
    // A move that is paused does not go on against another zero.
    bench.drive(Quantity::Position, 0, 30_000, 20_000);
    bench.run_alive_ms(500);
    run(&mut bench, Scope::Motor(WHEEL), false);
    bench.run_alive_ms(500);
    assert_eq!(bench.set_count(0, -5), Verdict::Done);
    run(&mut bench, Scope::Motor(WHEEL), true);
    bench.run_alive_ms(500);
    assert_eq!((bench.bridge(0), wheel(&mut bench).position), ((0, false), -5));
    // Only channels 0 and 1 have encoders.
    assert_eq!(bench.set_count(2, 0), Verdict::NotAvailable);
    assert_eq!(bench.set_count(6, 0), Verdict::OutOfRange);
    assert_eq!(bench.outcome(7, &[0x86, 0]).0, Verdict::BadLength);
}

#[test]
fn what_is_refused_is_counted_by_reason() {
    type Cause = (fn(&mut Bench), fn(&mut Refusals) -> &mut u32);
    let causes: [Cause; 9] = [
        (|bench| bench.send_raw(did::VELOCITY_ALL, &[1, 2, 3]), |all| &mut all.length),
        (|bench| bench.send_raw(did::VELOCITY, &[7, 0, 0]), |all| &mut all.channel),
        (|bench| bench.send_raw(did::SERVO, &[0, 0, 0]), |all| &mut all.value),
        (|bench| bench.send_raw(did::PARAMETERS, &[0x87]), |all| &mut all.sub_command),
        (|bench| _ = bench.set(&[(999, 0)]), |all| &mut all.setting),
        (|bench| _ = bench.act(Action::Save), |all| &mut all.not_now),
        (|bench| _ = bench.set_count(2, 0), |all| &mut all.not_available),
        (|bench| bench.drive(Quantity::Velocity, 1, 5, 0), |all| &mut all.method),
        (|bench| bench.drive(Quantity::Position, 2, 5000, 0), |all| &mut all.scale),
    ];
    let mut bench = Bench::quiet();
    bench.configure(&[
        Parameter::Method(Channel::ALL[1], Method::Pwm),
        Parameter::Polarity(Channel::ALL[1], Polarity::Negative),
    ]);
    bench.drive(Quantity::Servo, 0, 3000, 0); // nothing can be saved
    bench.run_ms(20);
    let mut expected = Refusals::default();
    for (n, (cause, count)) in causes.into_iter().enumerate() {
        assert_eq!(refusals(&mut bench), expected, "before cause {n}");
        cause(&mut bench);
        bench.run_ms(20);
        *count(&mut expected) += 1;
    }
    assert_eq!(refusals(&mut bench), expected);
    assert_eq!(bench.board.refused(), 9);
    let request = Command::Extension(Request::Refusals);
    assert_eq!(Command::parse(103, &[]), Ok(request));
}

#[test]
fn a_velocity_that_full_drive_does_not_reach_is_no_slew() {
    for target in [FULL, -FULL] {
        let mut bench = Bench::quiet();
        bench.drive(Quantity::Velocity, 0, target, 0);
        bench.run_alive_ms(1000);
        assert_eq!(why(&mut bench), (Reason::FullDrive, 0));
    }
}
