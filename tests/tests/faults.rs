//! Every fault: its cause, how long until nothing is driven (not later, and not sooner), its
//! record, what a host must do to go on; and its near miss, which must not trip.

use embassy_time::{Duration, Instant};
use firmware::safety::faults::{Stops, stops};
use firmware::settings::{Settings, SoftLimits};
use hal_mock::board::{Make, VirtualBoard};
use hal_mock::clock;
use hal_mock::flash::Flash;
use hal_mock::plant::{MotorScene, Overrides, Scene, ShaftSensor};
use protocol::pms5005::extension::{Answer, Fault, FaultRecord, ResetCause};
use protocol::pms5005::{
    Channel, Command, Gain, Loop, Method, Parameter, Quantity, Scope, Sensor, did,
};
use tests::Bench;

const WHEEL: Channel = Channel::ALL[0];
const JOINT: usize = 2;

/// The latched faults, with their channels.
fn latched(bench: &Bench) -> Vec<(Fault, Option<Channel>)> {
    bench.board.snapshot().faults.iter().collect()
}

/// What a host reads of the first latched fault (DID 100).
fn first_record(bench: &mut Bench) -> FaultRecord {
    bench.send(Command::Ping);
    bench.run_ms(20);
    bench.received();
    bench.send_raw(100, &[0]);
    bench.run_ms(200);
    let frames = bench.received();
    let answer = frames.iter().find_map(|frame| match Answer::parse(frame.did, &frame.data) {
        Some(Answer::Fault(answer)) => Some(answer),
        _ => None,
    });
    answer.expect("an answer").record.expect("a record")
}

fn change(bench: &Bench, change: impl FnOnce(&mut Overrides)) {
    change(&mut bench.board.plant.borrow_mut().overrides);
}

/// How many ms pass until this bridge is off; the host is alive.
fn until_off(bench: &mut Bench, motor: usize, most: u64) -> u64 {
    let mut passed = 0;
    while bench.bridge(motor).1 {
        assert!(passed < most, "still on after {most} ms: {:?}", latched(bench));
        if passed % 500 == 0 {
            bench.send(Command::Ping);
        }
        bench.run_ms(1);
        passed += 1;
    }
    assert_eq!(bench.bridge(motor).0, 0, "off is neutral");
    passed
}

/// Under a latch no command moves the motor; cleared, it stays off until it is commanded, and runs.
fn off_until_cleared_and_then_runs_again(bench: &mut Bench, motor: usize, by: fn(&mut Bench)) {
    for quantity in [Quantity::Pwm, Quantity::Velocity, Quantity::Position] {
        bench.drive(quantity, motor, 3000, 0);
        bench.run_alive_with(200, |bench| assert_eq!(bench.bridge(motor), (0, false)));
    }
    change(bench, |all| *all = Overrides::default());
    bench.run_alive_with(200, |bench| assert_eq!(bench.bridge(motor), (0, false)));
    by(bench);
    bench.run_alive_ms(50);
    assert_eq!(latched(bench), []);
    bench.run_alive_ms(2000);
    let at = bench.position(motor);
    bench.run_alive_ms(300);
    assert!((bench.position(motor) - at).abs() <= 2, "nothing moves");
    bench.drive(Quantity::Pwm, motor, 16384 + 8000, 0);
    bench.run_alive_ms(300);
    assert_eq!((bench.bridge(motor), latched(bench)), ((8000, true), vec![]));
}

fn by_clearing(bench: &mut Bench) {
    bench.send_raw(did::PARAMETERS, &[0x81]);
}

fn by_resuming_all(bench: &mut Bench) {
    bench.send(Command::Run { scope: Scope::All, run: true });
}

fn by_resuming_the_wheel(bench: &mut Bench) {
    bench.send(Command::Run { scope: Scope::Motor(WHEEL), run: true });
}

const WAYS: [fn(&mut Bench); 3] = [by_clearing, by_resuming_all, by_resuming_the_wheel];

#[test]
fn over_current_is_limited_at_once_and_a_fault_after_two_seconds() {
    for clear in WAYS {
        let mut bench = Bench::new();
        bench.drive(Quantity::Pwm, 0, 16384 + 16000, 0);
        bench.run_alive_ms(500);
        change(&bench, |all| all.currents[0] = Some(4000));
        bench.run_alive_ms(64);
        assert!((7000..9500).contains(&bench.bridge(0).0), "{:?}", bench.bridge(0));
        bench.run_alive_ms(70);
        assert_eq!(bench.bridge(0), (0, true), "limited to nothing, not off");
        let off = 134 + until_off(&mut bench, 0, 3000);
        assert!((1998..=2003).contains(&off), "{off}");
        let record = first_record(&mut bench);
        assert_eq!((record.fault, record.channel), (Fault::OverCurrent, Some(WHEEL)));
        assert_eq!(record.values[..2], [4000, 0]);
        off_until_cleared_and_then_runs_again(&mut bench, 0, clear);
    }
}

#[test]
fn a_current_that_is_over_for_a_moment_or_just_below_is_no_fault() {
    let mut bench = Bench::new();
    bench.drive(Quantity::Pwm, 0, 16384 + 16000, 0);
    bench.run_alive_ms(500);
    // Inrush: it is limited, and lets go again within the time that a fault takes.
    change(&bench, |all| all.currents[0] = Some(4000));
    bench.run_alive_ms(100);
    change(&bench, |all| all.currents[0] = Some(3639));
    bench.run_alive_ms(1000);
    assert_eq!((bench.bridge(0), latched(&bench)), ((16000, true), vec![]));
    bench.run_alive_ms(20_000);
    assert_eq!((bench.bridge(0), latched(&bench)), ((16000, true), vec![]));
    // What is given back within a second counts as limited: 950 ms are just too short for a fault.
    change(&bench, |all| all.currents[0] = Some(4000));
    bench.run_alive_ms(950);
    change(&bench, |all| all.currents[0] = Some(0));
    bench.run_alive_ms(2000);
    assert_eq!((bench.bridge(0), latched(&bench)), ((16000, true), vec![]));
    // An input that nothing is wired to.
    change(&bench, |all| all.currents[0] = Some(2048));
    bench.run_alive_ms(20_000);
    assert_eq!((bench.bridge(0), latched(&bench)), ((16000, true), vec![]));
}

#[test]
fn a_shaft_that_is_held_fast_for_six_seconds_is_a_stall() {
    for clear in WAYS {
        let mut bench = Bench::new();
        bench.drive(Quantity::Velocity, 0, 4000, 0);
        bench.run_alive_ms(500);
        change(&bench, |all| all.jam[0] = Some(true));
        // The loop is at half of full drive at once.
        let off = until_off(&mut bench, 0, 8000);
        assert!((6000..=6050).contains(&off), "{off}");
        let record = first_record(&mut bench);
        assert_eq!((record.fault, record.channel), (Fault::Stall, Some(WHEEL)));
        let [current, duty, _] = record.values;
        assert!((2000..2200).contains(&current) && duty > 16_000, "{record:?}");
        off_until_cleared_and_then_runs_again(&mut bench, 0, clear);
    }
}

#[test]
fn pushing_for_five_seconds_or_gently_for_ever_is_no_stall() {
    let mut bench = Bench::new();
    bench.drive(Quantity::Velocity, 0, 4000, 0);
    bench.run_alive_ms(500);
    change(&bench, |all| all.jam[0] = Some(true));
    bench.run_alive_ms(5900);
    change(&bench, |all| all.jam[0] = None);
    bench.run_alive_ms(1000);
    assert_eq!(latched(&bench), []);
    // A joint that holds a load with a little less than half of full drive.
    let mut bench = Bench::new();
    change(&bench, |all| all.jam[JOINT] = Some(true));
    bench.drive(Quantity::Position, JOINT, 2048 + 320, 0);
    bench.run_alive_ms(20_000);
    assert!((7500..8192).contains(&bench.bridge(JOINT).0), "{:?}", bench.bridge(JOINT));
    assert_eq!(latched(&bench), []);
}

/// A bench with a wheel that is wired the other way round, which nobody has told it.
fn reversed() -> Bench {
    let mut scene = Scene::default();
    scene.motors[0] = MotorScene { reversed: true, ..MotorScene::with(ShaftSensor::Encoder) };
    Bench::with(Make { scene, ..Make::default() })
}

#[test]
fn a_shaft_that_runs_away_from_its_set_point_is_a_tracking_error() {
    // To a position it runs half a turn off, and then swings there.
    for quantity in [Quantity::Velocity, Quantity::Position] {
        let mut bench = reversed();
        bench.configure(&[Parameter::Sensor(WHEEL, Sensor::Encoder)]);
        bench.drive(quantity, 0, 4000, 0);
        bench.run_alive_ms(10);
        let off = 10 + until_off(&mut bench, 0, 10_000);
        assert!((1500..=1700).contains(&off), "{quantity:?}: {off}");
        let record = first_record(&mut bench);
        assert_eq!((record.fault, record.channel), (Fault::TrackingError, Some(WHEEL)));
        off_until_cleared_and_then_runs_again(&mut bench, 0, by_clearing);
    }
}

#[test]
fn a_gain_that_makes_the_drive_swing_is_a_tracking_error() {
    let position = |kp, kd, ki| (Quantity::Position, Loop::Position, kp, kd, ki);
    let velocity = |kp, kd, ki| (Quantity::Velocity, Loop::Velocity, kp, kd, ki);
    for (quantity, control_loop, kp, kd, ki) in [
        position(50, 0, 50),
        position(50, 500, 0),
        position(65_535, 5000, 0),
        velocity(65_535, 5, 0),
        velocity(50, 5, 255),
        velocity(50, 65_535, 0),
    ] {
        let mut bench = Bench::new();
        bench.configure(&[
            Parameter::Sensor(WHEEL, Sensor::Encoder),
            Parameter::Gain(WHEEL, control_loop, Gain::Proportional(kp)),
            Parameter::Gain(WHEEL, control_loop, Gain::Derivative(kd)),
            Parameter::Gain(WHEEL, control_loop, Gain::Integral { integer: ki, fraction: 0 }),
        ]);
        bench.drive(quantity, 0, 6000, 0);
        bench.run_alive_ms(10);
        let off = 10 + until_off(&mut bench, 0, 10_000);
        assert!((1500..=3500).contains(&off), "{quantity:?} {kp} {kd} {ki}: {off}");
        assert_eq!(latched(&bench), [(Fault::TrackingError, Some(WHEEL))]);
        by_clearing(&mut bench);
        let good = Gain::Proportional(50);
        bench.configure(&[
            Parameter::Gain(WHEEL, control_loop, good),
            Parameter::Gain(WHEEL, control_loop, Gain::Derivative(5)),
            Parameter::Gain(WHEEL, control_loop, Gain::Integral { integer: 0, fraction: 0 }),
        ]);
        bench.drive(quantity, 0, 3000, 0);
        bench.run_alive_ms(5000);
        assert!(bench.bridge(0).1 && latched(&bench).is_empty(), "{quantity:?} {kp} {kd} {ki}");
    }
}

#[test]
fn a_loop_that_is_only_late_or_turns_round_is_not_astray() {
    let mut bench = Bench::new();
    // More than the motor can do, there and back; then a move in a tenth of the time it takes.
    for speed in [32_000, -32_000, 32_000, -32_000] {
        bench.drive(Quantity::Velocity, 0, speed, 0);
        bench.run_alive_ms(2000);
        assert!(bench.velocity(0).abs() > 14_000.0);
    }
    for position in [0, 16_000, 0, 16_000] {
        bench.drive(Quantity::Position, 0, position, 100);
        bench.run_alive_ms(2000);
    }
    assert_eq!(latched(&bench), []);
    // Hard moves, three a second.
    for k in 0..60 {
        bench.drive(Quantity::Position, 0, [2000, 0][k % 2], 0);
        bench.run_alive_ms(333);
    }
    assert_eq!(latched(&bench), []);
    // The wrong way round for a second, and then put right.
    let mut bench = reversed();
    bench.drive(Quantity::Velocity, 0, 4000, 0);
    bench.run_alive_ms(1400);
    assert!(bench.velocity(0) < -10_000.0 && latched(&bench).is_empty());
}

#[test]
fn an_encoder_that_is_pulled_stops_its_wheel() {
    for clear in WAYS {
        let mut bench = Bench::new();
        bench.drive(Quantity::Velocity, 0, 2000, 0);
        bench.run_alive_ms(1000);
        let stays = bench.position(0) as u16;
        change(&bench, |all| all.encoders[0] = Some(stays));
        // The loop winds up to half of full drive first.
        let off = until_off(&mut bench, 0, 3000);
        assert!((600..=900).contains(&off), "{off}");
        let record = first_record(&mut bench);
        assert_eq!((record.fault, record.channel), (Fault::SensorLost, Some(WHEEL)));
        off_until_cleared_and_then_runs_again(&mut bench, 0, clear);
    }
}

#[test]
fn a_potentiometer_whose_wire_is_off_stops_its_joint_at_once() {
    for reads in [0, 4095] {
        let mut bench = Bench::new();
        bench.drive(Quantity::Position, JOINT, 2500, 0);
        bench.run_alive_ms(1500);
        let held = bench.position(JOINT);
        change(&bench, |all| all.potentiometers[JOINT] = Some(reads));
        let off = until_off(&mut bench, JOINT, 100);
        assert!((18..=22).contains(&off), "{off}");
        let record = first_record(&mut bench);
        assert_eq!(record.fault, Fault::SensorLost);
        assert_eq!(record.values[0], reads as i16);
        assert!((i64::from(record.values[2]) - held).abs() <= 4, "the last good one: {record:?}");
        off_until_cleared_and_then_runs_again(&mut bench, JOINT, by_clearing);
    }
}

#[test]
fn a_loop_over_a_potentiometer_at_the_rail_does_not_run_for_long() {
    for (reads, target) in [(0, 3000), (4095, 1000)] {
        let mut bench = Bench::new();
        change(&bench, |all| all.potentiometers[1] = Some(reads));
        bench.drive(Quantity::Position, 1, target, 0);
        bench.run_alive_ms(5);
        let off = until_off(&mut bench, 1, 1000);
        assert!((240..=260).contains(&off), "{off}");
        assert_eq!(latched(&bench), [(Fault::SensorLost, Some(Channel::ALL[1]))]);
    }
}

#[test]
fn a_position_command_to_a_wheel_without_potentiometer_stops_by_itself() {
    // Hard, at half of full drive or more, and so softly that only the encoder tells.
    for target in [4095, 2500, 2100, 1900] {
        let mut bench = Bench::new();
        bench.drive(Quantity::Position, 0, target, 0);
        bench.run_alive_ms(5);
        let off = until_off(&mut bench, 0, 3000);
        assert!((480..=700).contains(&off), "{target}: {off}");
        assert_eq!(latched(&bench), [(Fault::SensorLost, Some(WHEEL))]);
        off_until_cleared_and_then_runs_again(&mut bench, 0, by_resuming_the_wheel);
    }
}

#[test]
fn sensors_that_stumble_or_that_nobody_uses_are_not_lost() {
    // An encoder whose plug is loose for a moment.
    let mut bench = Bench::new();
    bench.drive(Quantity::Velocity, 0, 2000, 0);
    bench.run_alive_ms(1000);
    for _ in 0..3 {
        let stays = bench.position(0) as u16;
        change(&bench, |all| all.encoders[0] = Some(stays));
        bench.run_alive_ms(450);
        change(&bench, |all| all.encoders[0] = None);
        bench.run_alive_ms(2000);
    }
    assert!((1900.0..2100.0).contains(&bench.velocity(0)) && latched(&bench).is_empty());
    let mut bench = Bench::new();
    bench.drive(Quantity::Position, JOINT, 2500, 0);
    bench.run_alive_ms(1500);
    for reads in [0, 4095, 1000] {
        change(&bench, |all| all.potentiometers[JOINT] = Some(reads));
        bench.run_alive_ms(15);
        change(&bench, |all| all.potentiometers[JOINT] = None);
        bench.run_alive_ms(1000);
    }
    // To both ends of the track, and off them again.
    for target in [0, 4095, 0, 2048] {
        bench.drive(Quantity::Position, JOINT, target, 0);
        bench.run_alive_ms(3000);
    }
    // Nothing is wired to any of them, and PWM needs none.
    change(&bench, |all| {
        (all.potentiometers, all.encoders) = ([Some(0); 6], [Some(0); 2]);
    });
    for motor in 0..6 {
        bench.drive(Quantity::Pwm, motor, 32_000, 0);
    }
    bench.run_alive_ms(20_000);
    assert!((0..6).all(|motor| bench.bridge(motor) == (32_000 - 16384, true)));
    assert_eq!(latched(&bench), []);
}

#[test]
fn soft_limits_hold_a_shaft_and_let_it_come_back() {
    let mut settings = Settings::DEFAULT;
    settings.control.soft_limits[JOINT] = SoftLimits { low: 1000, high: 3000 };
    let mut bench = Bench::with(Make { settings, ..Make::default() });
    for (beyond, end) in [(4000, 3000), (100, 1000)] {
        bench.drive(Quantity::Position, JOINT, beyond, 0);
        bench.run_alive_ms(2000);
        assert!((bench.position(JOINT) - end).abs() <= 40, "{}", bench.position(JOINT));
    }
    for (pwm, end) in [(16384 + 6000, 3000), (16384 - 6000, 1000)] {
        bench.drive(Quantity::Pwm, JOINT, pwm, 0);
        bench.run_alive_ms(3000);
        let past = (bench.position(JOINT) - end) * if end == 3000 { 1 } else { -1 };
        assert!((0..=100).contains(&past), "{past} counts past {end}");
        assert_eq!(bench.bridge(JOINT), (0, true), "held back, not off");
    }
    assert_eq!(latched(&bench), []);
}

/// A fault of the board that a reading makes: the reading that is wrong, and the next to it that is
/// not.
struct Reading {
    fault: Fault,
    set: fn(&mut Overrides, u16),
    wrong: u16,
    right: u16,
}

const READINGS: [Reading; 11] = [
    Reading {
        fault: Fault::MotorBatteryLow,
        set: |all, ad| all.battery[1] = Some(ad),
        wrong: 852,
        right: 853,
    },
    Reading {
        fault: Fault::MotorBatteryLow,
        set: |all, ad| all.battery[1] = Some(ad),
        wrong: 171,
        right: 170,
    },
    Reading {
        fault: Fault::MotorBatteryHigh,
        set: |all, ad| all.battery[1] = Some(ad),
        wrong: 2560,
        right: 2559,
    },
    Reading {
        fault: Fault::ServoBatteryLow,
        set: |all, ad| all.battery[2] = Some(ad),
        wrong: 1819,
        right: 1820,
    },
    Reading {
        fault: Fault::ServoBatteryLow,
        set: |all, ad| all.battery[2] = Some(ad),
        wrong: 455,
        right: 454,
    },
    Reading {
        fault: Fault::MainBatteryLow,
        set: |all, ad| all.battery[0] = Some(ad),
        wrong: 2001,
        right: 2002,
    },
    Reading {
        fault: Fault::MainBatteryLow,
        set: |all, ad| all.battery[0] = Some(ad),
        wrong: 455,
        right: 454,
    },
    Reading {
        fault: Fault::DriverTooHot,
        set: |all, ad| all.overheat[0] = Some(ad),
        wrong: 1095,
        right: 1096,
    },
    Reading {
        fault: Fault::DriverTooHot,
        set: |all, ad| all.overheat[1] = Some(ad),
        wrong: 400,
        right: 399,
    },
    Reading {
        fault: Fault::AmbientTooHot,
        set: |all, ad| all.temperature = Some(ad),
        wrong: 3692,
        right: 3691,
    },
    Reading {
        fault: Fault::AmbientTooHot,
        set: |all, ad| all.temperature = Some(ad),
        wrong: 4039,
        right: 4040,
    },
];

/// The defaults, and 15 V as too much for the motors.
fn with_a_highest_voltage() -> Settings {
    let mut settings = Settings::DEFAULT;
    settings.control.board_faults.motor_battery_high = 2560;
    settings
}

/// A bench on which motors and a servo are driven.
fn driving(settings: Settings) -> Bench {
    let mut bench = Bench::with(Make { settings, ..Make::default() });
    bench.drive(Quantity::Pwm, 0, 16384 + 8000, 0);
    bench.drive(Quantity::Position, JOINT, 2500, 0);
    bench.drive(Quantity::Servo, 3, 2000, 0);
    bench.run_alive_ms(500);
    bench
}

#[test]
fn batteries_and_temperatures_out_of_bounds_for_a_second_stop_everything() {
    let settings = with_a_highest_voltage();
    for Reading { fault, set, wrong, .. } in READINGS {
        for clear in [by_clearing as fn(&mut Bench), by_resuming_all] {
            let mut bench = driving(settings);
            change(&bench, |all| set(all, wrong));
            // A reading takes 20 ms here, and it is looked at every 8 ms.
            let off = until_off(&mut bench, 0, 2000);
            assert!((995..=1040).contains(&off), "{fault:?} at {wrong}: {off}");
            assert_eq!(bench.bridge(JOINT), (0, false));
            let servo_stops = stops(fault) == Stops::MotorsAndServos;
            assert_eq!(bench.pulse(3).is_none(), servo_stops, "{fault:?}");
            let record = first_record(&mut bench);
            assert_eq!((record.fault, record.channel), (fault, None));
            let cool = 1850; // the simulated drivers are at 25 degrees
            let is_driver = |ad: i16| (cool - 20..cool + 20).contains(&ad);
            match (fault, record.values) {
                (Fault::DriverTooHot, [first, second, 0]) => {
                    let hot = wrong as i16;
                    let told =
                        (first == hot && is_driver(second)) || (is_driver(first) && second == hot);
                    assert!(told && (wrong == 1095) == (first == hot), "{record:?}");
                }
                (_, values) => assert_eq!(values, [wrong as i16, 0, 0], "{fault:?}"),
            }
            // The cause is still there: it trips again, at once and without a twitch.
            clear(&mut bench);
            bench.run_alive_ms(50);
            assert_eq!(latched(&bench), [(fault, None)]);
            off_until_cleared_and_then_runs_again(&mut bench, 0, clear);
            bench.drive(Quantity::Servo, 3, 3000, 0);
            bench.run_alive_ms(50);
            assert_eq!(bench.pulse(3), Some(3000));
        }
    }
}

#[test]
fn readings_that_are_just_right_or_not_wired_or_wrong_for_a_moment_stop_nothing() {
    let goes_on = |bench: &mut Bench, what: &str| {
        assert_eq!((bench.bridge(0), latched(bench)), ((8000, true), vec![]), "{what}");
    };
    let settings = with_a_highest_voltage();
    for Reading { fault, set, wrong, right } in READINGS {
        let mut bench = driving(settings);
        for ad in [right, 0, 2047] {
            change(&bench, |all| set(all, ad));
            bench.run_alive_ms(5000);
            goes_on(&mut bench, &format!("{fault:?} at {ad}"));
        }
        for _ in 0..3 {
            change(&bench, |all| set(all, wrong));
            bench.run_alive_ms(900);
            change(&bench, |all| set(all, right));
            bench.run_alive_ms(100);
        }
        goes_on(&mut bench, &format!("{fault:?} for a moment"));
    }
}

#[test]
fn link_loss_is_on_record_and_holds_nobody_back() {
    let mut bench = driving(Settings::DEFAULT);
    bench.send(Command::Ping);
    bench.run_ms(1900);
    assert_eq!(latched(&bench), [], "not yet");
    bench.run_ms(200);
    assert_eq!((bench.bridge(0), latched(&bench)), ((0, false), vec![(Fault::LinkLoss, None)]));
    let record = first_record(&mut bench);
    assert_eq!((record.fault, record.values), (Fault::LinkLoss, [2000, 0, 0]));
    assert!((2400..=2520).contains(&record.uptime_ms), "{record:?}");
    // A host of old knows of no fault: it just drives on.
    bench.drive(Quantity::Pwm, 0, 16384 - 4000, 0);
    bench.run_alive_ms(100);
    assert_eq!(bench.bridge(0), (-4000, true));
    by_resuming_all(&mut bench);
    bench.run_alive_ms(50);
    assert_eq!(latched(&bench), [(Fault::LinkLoss, None)], "it stays on record");
    by_clearing(&mut bench);
    bench.run_alive_ms(50);
    assert_eq!((bench.bridge(0), latched(&bench)), ((-4000, true), vec![]));
}

/// What a fault that stops nothing leaves: its record, until it is cleared, and a board that drives.
fn on_record_and_no_more(bench: &mut Bench, fault: Fault, at_ms: std::ops::RangeInclusive<u32>) {
    assert_eq!(latched(bench), [(fault, None)]);
    let record = first_record(bench);
    assert_eq!((record.fault, record.channel, record.values), (fault, None, [0; 3]));
    assert!(at_ms.contains(&record.uptime_ms), "{record:?}");
    bench.drive(Quantity::Pwm, 0, 16384 - 4000, 0);
    bench.run_alive_ms(100);
    assert_eq!(bench.bridge(0), (-4000, true));
    by_resuming_all(bench);
    bench.run_alive_ms(50);
    assert_eq!(latched(bench), [(fault, None)], "a resume is for what stops");
    by_clearing(bench);
    bench.run_alive_ms(50);
    assert_eq!((bench.bridge(0), latched(bench)), ((-4000, true), vec![]));
}

#[test]
fn lost_bytes_damaged_settings_and_a_start_by_the_watchdog_are_on_record_and_hold_nobody_back() {
    let mut bench = driving(Settings::DEFAULT);
    bench.board.line.overrun();
    bench.run_ms(2);
    assert_eq!(bench.bridge(0), (8000, true));
    on_record_and_no_more(&mut bench, Fault::ReceiveOverrun, 500..=520);

    let mut bench = Bench::new();
    bench.board = VirtualBoard::with_flash(Make::default(), Flash::with(b"foreign"));
    bench.run_ms(10);
    on_record_and_no_more(&mut bench, Fault::SettingsCorrupt, 0..=0);
    // Flash that was never written is none.
    let mut bench = driving(Settings::DEFAULT);
    assert_eq!(latched(&bench), []);

    bench.board.start_again(ResetCause::Watchdog);
    bench.run_ms(10);
    assert_eq!(bench.bridge(0), (0, false));
    on_record_and_no_more(&mut bench, Fault::WatchdogReset, 0..=0);
    // Nor is any other start.
    for cause in [ResetCause::Power, ResetCause::Pin, ResetCause::Software] {
        bench.board.start_again(cause);
        bench.run_ms(10);
        assert_eq!(latched(&bench), [], "{cause:?}");
    }
}

/// Lets so many periods begin a period late, each followed by so many in time.
fn miss(bench: &mut Bench, periods: u32, in_time: u64) {
    for k in 0..periods {
        if k % 50 == 0 {
            bench.send(Command::Ping);
        }
        clock::advance_to(Instant::now() + Duration::from_micros(2100));
        bench.run_ms(0);
        bench.board.run_until(Instant::from_millis(Instant::now().as_millis() + in_time));
    }
}

#[test]
fn control_periods_that_are_missed_are_counted_and_a_fault_when_they_persist() {
    let mut bench = driving(Settings::DEFAULT);
    miss(&mut bench, 90, 0);
    assert_eq!(bench.board.snapshot().counters.periods_missed, 90);
    assert_eq!((bench.bridge(0), latched(&bench)), ((8000, true), vec![]));
    miss(&mut bench, 20, 0);
    assert_eq!((bench.bridge(0), latched(&bench)), ((0, false), vec![(Fault::PeriodMissed, None)]));
    let record = first_record(&mut bench);
    assert!((1000..=2100).contains(&record.values[0]), "{record:?}");
    bench.run_alive_ms(1000);
    off_until_cleared_and_then_runs_again(&mut bench, 0, by_clearing);
    // One in eight for a long time; and one hole of half a second.
    miss(&mut bench, 1000, 8);
    clock::advance_to(Instant::now() + Duration::from_millis(500));
    bench.run_alive_ms(1000);
    assert_eq!((bench.bridge(0), latched(&bench)), ((8000, true), vec![]));
}

#[test]
fn a_channel_that_is_latched_takes_no_part_in_a_command_and_the_others_do() {
    let mut bench = Bench::new();
    bench.drive(Quantity::Position, 0, 4095, 0);
    bench.drive(Quantity::Velocity, 1, 2000, 0);
    bench.run_alive_ms(1500);
    assert_eq!(latched(&bench), [(Fault::SensorLost, Some(WHEEL))]);
    bench.send_raw(did::PWM_ALL, &[0x40, 0x5F].repeat(6));
    bench.run_alive_ms(100);
    assert_eq!(bench.bridge(0), (0, false));
    assert!((1..6).all(|motor| bench.bridge(motor) == (0x5F40 - 16384, true)));
    // Its sensor can be put right; another channel's resume is not its own.
    bench.configure(&[Parameter::Sensor(WHEEL, Sensor::Encoder)]);
    bench.send(Command::Run { scope: Scope::Motor(Channel::ALL[1]), run: true });
    bench.run_alive_ms(100);
    assert_eq!(bench.bridge(0), (0, false));
    by_resuming_the_wheel(&mut bench);
    bench.configure(&[Parameter::Method(WHEEL, Method::Position)]);
    bench.drive(Quantity::Position, 0, 3000, 0);
    bench.run_alive_ms(2000);
    assert!((bench.position(0).rem_euclid(32_768) - 3000).abs() <= 60, "{}", bench.position(0));
}
