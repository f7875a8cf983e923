//! The faults of a DC channel, and its limits, which are none.

use super::*;

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
        assert_eq!((record.fault, record.channel), (Fault::OverCurrent, Some(0)));
        assert_eq!(record.values[..2], [4000, 0]);
        change(&bench, |all| all.currents[0] = None);
        off_until_cleared_and_then_runs_again(&mut bench, 0, clear);
    }
}

#[test]
fn a_current_that_is_over_for_a_moment_or_just_below_is_no_fault() {
    // Not of this kind: what it is instead, a held shaft or a hot motor, is told apart below.
    let mut bench = with_settings(&[(52, 0), (92, 0)]);
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
}

/// A board with these settings.
fn with_settings(settings: &[(u16, i32)]) -> Bench {
    let mut make = Make::default();
    settings.iter().for_each(|&(number, value)| make.settings.set(number, value).unwrap());
    Bench::with(make)
}

/// A wheel that PWM turns at full duty, watched by its encoder; all of a motor's current is `ad`.
fn turns_and_draws(bench: &mut Bench, ad: u16) {
    bench.configure(&[Parameter::Sensor(WHEEL, Sensor::Encoder)]);
    bench.drive(Quantity::Pwm, 0, 32_767, 0);
    bench.run_alive_ms(500);
    change(bench, |all| all.currents[0] = Some(ad));
}

#[test]
fn an_overload_is_limited_to_the_continuous_current_and_is_no_fault() {
    // 3 A for ever, into a shaft that is held; nothing else would end it.
    let mut bench = with_settings(&[(52, 0)]);
    change(&bench, |all| all.jam[0] = Some(true));
    bench.drive(Quantity::Pwm, 0, 32_767, 0);
    let limiting = |bench: &Bench| bench.board.snapshot().channels[0].reason;
    let current = |bench: &Bench| bench.board.snapshot().motion.currents[0];
    // From cold: 10 s * ln(1 / (1 - (2.5 / 2.9)^2)).
    let after = bench.until(Alive, 20_000, |bench| limiting(bench) == Some(Reason::Overload));
    assert!((13_000..14_500).contains(&after), "{after}");
    bench.run_alive_ms(4000);
    let duty = bench.bridge(0).0;
    // It settles, and is heard no more.
    bench.run_alive_with(60_000, |bench| {
        assert!((1740..=1825).contains(&current(bench)), "{}", current(bench));
        assert_eq!(bench.bridge(0), (duty, true));
    });
    assert_eq!((limiting(&bench), latched(&bench)), (Some(Reason::Overload), vec![]));
    // What is off cools, and no faster: in 2 s a fifth of it, in a minute all. To be as hot again takes
    // 10 s * ln((2.9^2 - 0.8 * 2.5^2) / (2.9^2 - 2.5^2)).
    for (off, soonest, latest) in [(2000, 4000, 5200), (60_000, 13_000, 14_500)] {
        bench.send(Command::Run { scope: Scope::Motor(WHEEL), run: false });
        bench.run_alive_ms(off);
        bench.drive(Quantity::Pwm, 0, 32_767, 0);
        bench.run_alive_ms(10);
        let again = bench.until(Alive, 20_000, |bench| {
            limiting(bench) == Some(Reason::Overload) && current(bench) < 2080
        });
        assert!((soonest..latest).contains(&again), "{again} after {off} off");
    }
    // Let go, it has all its drive again.
    change(&bench, |all| all.jam[0] = None);
    bench.run_alive_ms(10_000);
    assert_eq!((bench.bridge(0), limiting(&bench)), ((16_383, true), None));
}

#[test]
fn what_an_overload_has_taken_is_given_back_when_the_current_falls_however_hot_the_motor_is() {
    let mut bench = Bench::new();
    let is_limited =
        |bench: &Bench| bench.board.snapshot().channels[0].reason == Some(Reason::Overload);
    turns_and_draws(&mut bench, 2100);
    bench.until(Alive, 30_000, is_limited);
    bench.run_alive_ms(500);
    let taken = 16_383 - bench.bridge(0).0;
    assert!((800..1500).contains(&taken), "{taken}");
    // Four fifths of the continuous current: as hot as it is, the motor needs seconds to cool.
    change(&bench, |all| all.currents[0] = Some(1456));
    let back = bench.until(Alive, 5000, |bench| bench.bridge(0).0 == 16_383);
    assert!(back < 700, "{back}");
}

#[test]
fn a_current_that_does_not_follow_its_drive_is_an_overload() {
    for clear in WAYS {
        let mut bench = Bench::new();
        turns_and_draws(&mut bench, 2000);
        // Hot after 10 s * ln(1 / (1 - (2.5 / 2.75)^2)) = 17.6 s, and limited for 2 s.
        let off = until_off(&mut bench, 0, 30_000);
        assert!((19_000..=21_000).contains(&off), "{off}");
        let record = first_record(&mut bench);
        assert_eq!((record.fault, record.channel), (Fault::Overload, Some(0)));
        assert_eq!(record.values[0], 2000);
        change(&bench, |all| all.currents[0] = None);
        off_until_cleared_and_then_runs_again(&mut bench, 0, clear);
    }
    // As much as it bears, and a minute of less.
    let mut bench = Bench::new();
    turns_and_draws(&mut bench, 1815);
    bench.run_alive_ms(60_000);
    assert_eq!((bench.bridge(0), latched(&bench)), ((16_383, true), vec![]));
}

#[test]
fn a_current_input_that_floats_is_on_record_and_counts_as_none() {
    let mut bench = Bench::new();
    change(&bench, |all| all.currents[0] = Some(2048));
    let is_none = |bench: &Bench| bench.board.snapshot().no_current_sensor[0];
    let after = bench.until(Alive, 1000, is_none);
    assert!((495..=505).contains(&after), "{after}");
    let record = first_record(&mut bench);
    assert_eq!((record.fault, record.channel), (Fault::CurrentSensor, Some(0)));
    assert_eq!(record.values[0], 2048);
    // It stops nothing, and 2.8 A for ever are neither a stall nor an overload.
    bench.drive(Quantity::Pwm, 0, 32_767, 0);
    bench.run_alive_ms(60_000);
    assert_eq!(bench.bridge(0), (16_383, true));
    assert_eq!(latched(&bench), [(Fault::CurrentSensor, Some(0))]);
    // A resume leaves it on record, a host that clears does not; and it is told once.
    by_resuming_all(&mut bench);
    bench.run_alive_ms(100);
    assert_eq!(latched(&bench), [(Fault::CurrentSensor, Some(0))]);
    by_clearing(&mut bench);
    bench.run_alive_ms(5000);
    assert_eq!((latched(&bench), is_none(&bench)), (vec![], true));
    // Nor does it count, or is it told again, because the bridge goes off or another sensor is chosen.
    bench.configure(&[Parameter::Sensor(WHEEL, Sensor::Encoder)]);
    bench.run_alive_with(100, |bench| assert!(is_none(bench)));
    bench.send(Command::Run { scope: Scope::Motor(WHEEL), run: false });
    bench.run_alive_with(1000, |bench| assert!(is_none(bench)));
    assert_eq!(latched(&bench), []);
    bench.drive(Quantity::Pwm, 0, 32_767, 0);
    // Over-current is limited whatever the input is worth.
    change(&bench, |all| all.currents[0] = Some(4000));
    bench.run_alive_ms(200);
    assert_eq!(bench.board.snapshot().channels[0].reason, Some(Reason::OverCurrent));
    change(&bench, |all| all.currents[0] = None);
    bench.run_alive_ms(2000);
    assert!(is_none(&bench), "nobody knows while it is driven");
    bench.send(Command::Run { scope: Scope::Motor(WHEEL), run: false });
    bench.run_alive_ms(600);
    assert!(!is_none(&bench), "wired again");
    // Neither does a stop that clears what has stopped the channel.
    let mut bench = Bench::new();
    change(&bench, |all| all.currents[0] = Some(2048));
    bench.run_alive_ms(600);
    bench.drive(Quantity::Pwm, 0, 32_767, 0);
    change(&bench, |all| all.currents[0] = Some(4000));
    bench.run_alive_ms(2100);
    let both = [(Fault::OverCurrent, Some(0)), (Fault::CurrentSensor, Some(0))];
    assert_eq!((latched(&bench), bench.bridge(0)), (both.to_vec(), (0, false)));
    change(&bench, |all| all.currents[0] = Some(2048));
    bench.run_alive_ms(1100);
    bench.drive(Quantity::Pwm, 0, 16_384, 0);
    bench.run_alive_ms(50);
    assert_eq!(latched(&bench), both[1..]);
    assert_eq!(first_record(&mut bench).fault, Fault::CurrentSensor);
    // A shaft that nobody measures may turn: what it makes then says nothing of the input.
    let mut bench = Bench::new();
    bench.drive(Quantity::Pwm, 0, 16_384, 0);
    bench.run_alive_ms(10);
    change(&bench, |all| all.currents[0] = Some(1000));
    bench.run_alive_ms(5000);
    assert_eq!((latched(&bench), is_none(&bench)), (vec![], false));
    // Near zero is no current, and neither is what a shaft that is stopped makes while it turns.
    let mut bench = Bench::new();
    change(&bench, |all| all.currents[0] = Some(181));
    bench.run_alive_ms(5000);
    change(&bench, |all| all.currents[0] = None);
    bench.configure(&[Parameter::Sensor(WHEEL, Sensor::Encoder)]);
    bench.drive(Quantity::Pwm, 0, 32_767, 0);
    bench.run_alive_ms(1000);
    bench.drive(Quantity::Pwm, 0, 16_384, 0);
    bench.run_alive_ms(5000);
    assert_eq!((latched(&bench), is_none(&bench)), (vec![], false));
}

#[test]
fn a_channel_that_is_resumed_leaves_all_others_records_and_what_stopped_nothing() {
    let mut bench = Bench::new();
    change(&bench, |all| all.currents[0] = Some(2048));
    bench.run_alive_ms(600); // an input that floats
    bench.drive(Quantity::Pwm, 0, 32_767, 0);
    bench.drive(Quantity::Pwm, 1, 32_767, 0);
    change(&bench, |all| (all.currents[0], all.currents[1]) = (Some(4000), Some(4000)));
    bench.run_alive_ms(2100);
    by_resuming_the_wheel(&mut bench);
    bench.run_alive_ms(50);
    let left = [(Fault::CurrentSensor, Some(0)), (Fault::OverCurrent, Some(1))];
    assert_eq!(latched(&bench), left);
    let records = [0, 1, 2].map(|place| bench.fault(place).record);
    let records = records.map(|record| record.map(|of| (of.fault, of.channel)));
    assert_eq!(records, [Some(left[0]), Some(left[1]), None]);
}

#[test]
fn a_channel_without_a_current_sensor_says_so_and_still_loses_its_encoder() {
    let without = [(100, 0)];
    let mut bench = with_settings(&without);
    bench.run_alive_ms(10);
    let none = bench.board.snapshot().no_current_sensor;
    assert_eq!(none, [true, false, false, false, false, false]);
    // What it reads is nothing to nobody.
    change(&bench, |all| (all.currents[0], all.jam[0]) = (Some(2048), Some(true)));
    bench.run_alive_ms(2000);
    bench.drive(Quantity::Pwm, 0, 32_767, 0);
    bench.run_alive_ms(60_000);
    assert_eq!((bench.bridge(0), latched(&bench)), ((16_383, true), vec![]));

    let mut bench = with_settings(&without);
    bench.drive(Quantity::Velocity, 0, 100, 0);
    bench.run_alive_ms(1000);
    let stays = bench.position(0) as u16;
    change(&bench, |all| (all.encoders[0], all.currents[0]) = (Some(stays), Some(2048)));
    let off = until_off(&mut bench, 0, 5000);
    assert!((2000..=3000).contains(&off), "{off}");
    assert_eq!(latched(&bench), [(Fault::SensorLost, Some(0))]);
    // Within the band it may be a load that is held.
    let mut bench = with_settings(&without);
    change(&bench, |all| (all.encoders[0], all.currents[0]) = (Some(0), Some(0)));
    bench.drive(Quantity::Position, 0, 120, 0);
    bench.run_alive_ms(10_000);
    assert_eq!(latched(&bench), []);
    bench.drive(Quantity::Position, 0, 140, 0);
    let off = until_off(&mut bench, 0, 5000);
    assert!((1990..=2100).contains(&off), "{off}");
}

#[test]
fn a_shaft_that_nobody_measures_and_that_draws_a_held_ones_current_is_a_stall() {
    for pwm in [32_767, 16_384 - 8000] {
        let mut bench = Bench::new();
        change(&bench, |all| all.jam[0] = Some(true));
        bench.drive(Quantity::Pwm, 0, pwm, 0);
        bench.run_alive_ms(10);
        let off = 10 + until_off(&mut bench, 0, 8000);
        assert!((6000..=6020).contains(&off), "{off}");
        assert_eq!(latched(&bench), [(Fault::Stall, Some(0))]);
    }
    // Turning round begins anew, and one that turns is none at all.
    let mut bench = Bench::new();
    change(&bench, |all| all.jam[0] = Some(true));
    for k in 0..6 {
        bench.drive(Quantity::Pwm, 0, [16_384 + 9000, 16_384 - 9000][k % 2], 0);
        bench.run_alive_ms(5500);
    }
    change(&bench, |all| all.jam[0] = None);
    bench.run_alive_ms(30_000);
    assert_eq!(latched(&bench), []);
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
        assert_eq!((record.fault, record.channel), (Fault::Stall, Some(0)));
        let [current, duty, _] = record.values;
        assert!((2000..2200).contains(&current) && duty > 16_000, "{record:?}");
        off_until_cleared_and_then_runs_again(&mut bench, 0, clear);
    }
}

#[test]
fn a_shaft_that_is_held_fast_at_all_the_drive_there_is_is_a_stall_either_way() {
    for (target, full) in [(i16::MAX, 16_384), (-i16::MAX, -16_384)] {
        let mut bench = Bench::new();
        change(&bench, |all| all.jam[0] = Some(true));
        bench.drive(Quantity::Velocity, 0, target, 0);
        bench.run_alive_ms(500);
        assert_eq!(bench.bridge(0), (full, true));
        let off = 500 + until_off(&mut bench, 0, 8000);
        assert!((6000..=6050).contains(&off), "{target}: {off}");
        assert_eq!(latched(&bench), [(Fault::Stall, Some(0))]);
    }
}

#[test]
fn a_joint_that_is_held_off_its_set_point_is_a_stall_at_any_duty() {
    for error in [140, 320] {
        let mut bench = Bench::new();
        change(&bench, |all| all.jam[JOINT] = Some(true));
        bench.drive(Quantity::Position, JOINT, 2048 + error, 0);
        bench.run_alive_ms(10);
        let off = 10 + until_off(&mut bench, JOINT, 8000);
        assert!((6000..=6050).contains(&off), "{error} off: {off}");
        assert_eq!(latched(&bench), [(Fault::Stall, Some(2))]);
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
    // A joint that is kept from its set-point by as much as a load would.
    let mut bench = Bench::new();
    change(&bench, |all| all.jam[JOINT] = Some(true));
    bench.drive(Quantity::Position, JOINT, 2048 + 120, 0);
    bench.run_alive_ms(20_000);
    assert!((2900..3100).contains(&bench.bridge(JOINT).0), "{:?}", bench.bridge(JOINT));
    assert_eq!(latched(&bench), []);
}

/// A bench with a wheel that is wired the other way round, which nobody has told it. Setting 3 tells
/// how fast it is.
fn reversed(full_speed: u16) -> Bench {
    let mut make = Make { scene: Scene::default(), ..Make::default() };
    let wheel = MotorScene::with(ShaftSensor::Encoder);
    make.scene.motors[0] = MotorScene { reversed: true, full_speed: full_speed.into(), ..wheel };
    make.settings.control.full_speed_encoder = full_speed.into();
    Bench::with(make)
}

#[test]
fn a_shaft_that_runs_away_from_its_set_point_is_a_tracking_error() {
    // Off before it has gone as far as it comes in 0.2 s; and not before it has gone as far as in 0.1 s.
    let cases = [
        (16_384, Quantity::Velocity, 20),
        (16_384, Quantity::Velocity, 200),
        (16_384, Quantity::Velocity, 4000),
        (16_384, Quantity::Position, 100),
        (16_384, Quantity::Position, 4000),
        (1500, Quantity::Velocity, 200),
        (1500, Quantity::Position, 1000),
    ];
    for (full_speed, quantity, target) in cases {
        let mut bench = reversed(full_speed);
        bench.configure(&[Parameter::Sensor(WHEEL, Sensor::Encoder)]);
        bench.drive(quantity, 0, target, 0);
        bench.run_alive_ms(10);
        until_off(&mut bench, 0, 10_000);
        let (way, full_speed) = (-bench.position(0), i64::from(full_speed));
        let is_right = (full_speed / 10..=full_speed / 5).contains(&way);
        assert!(is_right, "{full_speed} {quantity:?} {target}: {way} counts");
        let record = first_record(&mut bench);
        assert_eq!((record.fault, record.channel), (Fault::TrackingError, Some(0)));
        off_until_cleared_and_then_runs_again(&mut bench, 0, by_clearing);
    }
    // The same by a polarity that does not fit.
    for quantity in [Quantity::Velocity, Quantity::Position] {
        let mut bench = Bench::new();
        bench.configure(&[
            Parameter::Sensor(WHEEL, Sensor::Encoder),
            Parameter::Polarity(WHEEL, Polarity::Negative),
        ]);
        bench.drive(quantity, 0, 4000, 0);
        bench.run_alive_ms(10);
        until_off(&mut bench, 0, 10_000);
        let way = -bench.position(0);
        assert!((1638..=3277).contains(&way), "{quantity:?}: {way} counts");
    }
    // A host that turns round all the time hides it for no more than half a second of full speed.
    for (quantity, back) in [(Quantity::Velocity, -2000), (Quantity::Position, 0)] {
        let mut bench = reversed(16_384);
        bench.configure(&[Parameter::Sensor(WHEEL, Sensor::Encoder)]);
        let mut farthest = 0;
        for k in 0..40 {
            bench.drive(quantity, 0, [2000, back][k % 2], 0);
            bench.run_alive_with(100, |bench| farthest = farthest.max(bench.position(0).abs()));
        }
        assert_eq!(latched(&bench), [(Fault::TrackingError, Some(0))], "{quantity:?}");
        assert!(farthest <= 8192, "{quantity:?}: {farthest} counts");
    }
}

#[test]
fn a_load_that_falls_twice_as_fast_as_it_is_let_down_is_a_tracking_error() {
    let mut scene = Scene::default();
    scene.motors[0] = MotorScene { load: 0.9, ..MotorScene::with(ShaftSensor::Encoder) };
    let mut bench = Bench::with(Make { scene, ..Make::default() });
    bench.configure(&[Parameter::Sensor(WHEEL, Sensor::Encoder)]);
    bench.drive(Quantity::Position, 0, 0, 0);
    bench.run_alive_ms(1000);
    // At half of the voltage full drive no longer holds it: it falls with 6500 counts/s.
    change(&bench, |all| all.battery_v[1] = Some(6.0));
    bench.drive(Quantity::Position, 0, 20_768, 4000); // 12,000 down
    let start = bench.position(0);
    until_off(&mut bench, 0, 4000);
    let way = start - bench.position(0);
    assert_eq!(latched(&bench), [(Fault::TrackingError, Some(0))]);
    // What it comes in 150 ms at full speed, and not as far again.
    assert!((2457..=3277).contains(&way), "{way} counts");
}

#[test]
fn a_joint_with_its_potentiometer_the_wrong_way_round_is_a_tracking_error() {
    // It has half its track to go: 0.2 s at full speed are 819 counts of 2048.
    let mut scene = Scene::default();
    let joint = MotorScene::with(ShaftSensor::Potentiometer);
    scene.motors[JOINT] = MotorScene { reversed: true, ..joint };
    for target in [2048 + 100, 4000] {
        let mut bench = Bench::with(Make { scene, ..Make::default() });
        bench.drive(Quantity::Position, JOINT, target, 0);
        bench.run_alive_ms(10);
        until_off(&mut bench, JOINT, 5000);
        let way = 2048 - bench.position(JOINT);
        assert!((400..=819).contains(&way), "{target}: {way} counts");
        assert_eq!(latched(&bench), [(Fault::TrackingError, Some(2))]);
    }
}

#[test]
fn the_largest_kd_of_a_velocity_loop_makes_no_drive_swing() {
    // It counts as 2047, which is full drive at 128 (counts/s) per ms.
    let mut bench = Bench::new();
    bench.configure(&[Parameter::Gain(WHEEL, Loop::Velocity, Gain::Derivative(65_535))]);
    bench.drive(Quantity::Velocity, 0, 6000, 0);
    bench.run_alive_ms(3000);
    bench.run_alive_with(7000, |bench| {
        let velocity = bench.velocity(0);
        assert!((5900.0..6100.0).contains(&velocity), "{velocity}");
    });
    assert_eq!(latched(&bench), []);
}

/// Whole Ki, as hosts of old send it: a word of hundredths.
fn integral(ki: u16) -> Gain {
    let [integer, fraction] = (100 * ki).to_le_bytes();
    Gain::Integral { integer, fraction }
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
    ] {
        let mut bench = Bench::new();
        bench.configure(&[
            Parameter::Sensor(WHEEL, Sensor::Encoder),
            Parameter::Gain(WHEEL, control_loop, Gain::Proportional(kp)),
            Parameter::Gain(WHEEL, control_loop, Gain::Derivative(kd)),
            Parameter::Gain(WHEEL, control_loop, integral(ki)),
        ]);
        bench.drive(quantity, 0, 6000, 0);
        bench.run_alive_ms(10);
        let off = 10 + until_off(&mut bench, 0, 10_000);
        assert!((1500..=3500).contains(&off), "{quantity:?} {kp} {kd} {ki}: {off}");
        assert_eq!(latched(&bench), [(Fault::TrackingError, Some(0))]);
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
    // The wrong way round for a moment, and then put right.
    let mut bench = reversed(16_384);
    bench.drive(Quantity::Velocity, 0, 4000, 0);
    bench.run_alive_ms(150);
    assert!(bench.velocity(0) < -8000.0, "{}", bench.velocity(0));
    bench.configure(&[Parameter::Polarity(WHEEL, Polarity::Negative)]);
    bench.run_alive_ms(2000);
    assert!((3900.0..4100.0).contains(&bench.velocity(0)) && latched(&bench).is_empty());
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
        assert_eq!((record.fault, record.channel), (Fault::SensorLost, Some(0)));
        off_until_cleared_and_then_runs_again(&mut bench, 0, clear);
    }
}

#[test]
fn an_encoder_that_is_pulled_is_missed_at_any_speed() {
    // Slow loops wind up slowly; below 6 % of full drive friction draws what a held shaft does.
    for (velocity, soonest, latest) in [(20, 4000, 5000), (100, 2200, 3000), (400, 1700, 3000)] {
        let mut bench = Bench::new();
        bench.drive(Quantity::Velocity, 0, velocity, 0);
        bench.run_alive_ms(2000);
        let stays = bench.position(0) as u16;
        change(&bench, |all| all.encoders[0] = Some(stays));
        let off = until_off(&mut bench, 0, 10_000);
        assert!((soonest..=latest).contains(&off), "{velocity}: {off}");
        assert_eq!(latched(&bench), [(Fault::SensorLost, Some(0))]);
    }
    for error in [50, 100] {
        let mut bench = Bench::new();
        change(&bench, |all| all.encoders[0] = Some(0));
        bench.drive(Quantity::Position, 0, error, 0);
        bench.run_alive_ms(10);
        let off = 10 + until_off(&mut bench, 0, 5000);
        assert!((2000..=2300).contains(&off), "{error}: {off}");
        assert_eq!(latched(&bench), [(Fault::SensorLost, Some(0))]);
    }
}

#[test]
fn an_encoder_that_is_pulled_is_missed_however_often_the_drive_turns_round() {
    let mut bench = Bench::new();
    change(&bench, |all| all.encoders[0] = Some(0));
    for k in 0..20 {
        bench.drive(Quantity::Velocity, 0, if k % 2 == 0 { 8000 } else { -8000 }, 0);
        bench.run_alive_ms(300);
    }
    assert_eq!(latched(&bench), [(Fault::SensorLost, Some(0))]);
}

#[test]
fn a_loop_that_takes_over_from_pwm_has_its_time_to_see_motion() {
    let mut bench = Bench::new();
    bench.configure(&[Parameter::Sensor(WHEEL, Sensor::Encoder)]);
    change(&bench, |all| all.encoders[0] = Some(0));
    bench.drive(Quantity::Pwm, 0, 16_384 + 12_000, 0);
    bench.run_alive_ms(10_000);
    assert_eq!(latched(&bench), []);
    bench.drive(Quantity::Velocity, 0, 8000, 0);
    let off = until_off(&mut bench, 0, 3000);
    assert!((500..=1000).contains(&off), "{off}");
    assert_eq!(latched(&bench), [(Fault::SensorLost, Some(0))]);
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
        change(&bench, |all| all.potentiometers[2] = Some(reads));
        bench.drive(Quantity::Position, 2, target, 0);
        bench.run_alive_ms(5);
        // 250 ms, from when the motor has started and draws less than a shaft that is held fast.
        let off = until_off(&mut bench, 2, 1000);
        assert!((255..=275).contains(&off), "{off}");
        assert_eq!(latched(&bench), [(Fault::SensorLost, Some(2))]);
    }
}

#[test]
fn a_wheel_over_a_potentiometer_that_was_chosen_and_is_not_there_stops_by_itself() {
    for target in [4095, 2500] {
        let mut bench = Bench::new();
        bench.configure(&[Parameter::Sensor(WHEEL, Sensor::SinglePotentiometer)]);
        bench.drive(Quantity::Position, 0, target, 0);
        bench.run_alive_ms(5);
        let off = until_off(&mut bench, 0, 3000);
        assert!((480..=700).contains(&off), "{target}: {off}");
        assert_eq!(latched(&bench), [(Fault::SensorLost, Some(0))]);
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
    assert_eq!(latched(&bench), []);
    assert!((1900.0..2100.0).contains(&bench.velocity(0)), "{}", bench.velocity(0));
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
    let mut scene = Scene::default();
    scene.motors[JOINT..].fill(MotorScene::with(ShaftSensor::None));
    let mut bench = Bench::with(Make { scene, ..Make::default() });
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
fn a_soft_limit_that_brakes_a_swapped_wheel_the_wrong_way_is_a_tracking_error() {
    for pwm in [32_767, 16_384 + 4000] {
        let mut scene = Scene::default();
        scene.motors[0] =
            MotorScene { reversed: true, start: 6000, ..MotorScene::with(ShaftSensor::Encoder) };
        let mut settings = Settings::DEFAULT;
        settings.control.soft_limits[0] = SoftLimits { low: 4000, high: 9000 };
        let mut bench = Bench::with(Make { scene, settings, ..Make::default() });
        bench.configure(&[Parameter::Sensor(WHEEL, Sensor::Encoder)]);
        bench.drive(Quantity::Pwm, 0, pwm, 0);
        bench.run_alive_ms(10);
        until_off(&mut bench, 0, 3000);
        let beyond = 4000 - bench.position(0);
        assert!((0..=3277).contains(&beyond), "{pwm}: {beyond} counts beyond");
        assert_eq!(first_record(&mut bench).fault, Fault::TrackingError);
    }
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
        assert!((-16..=16).contains(&past), "{past} counts past {end}");
        let (duty, enabled) = bench.bridge(JOINT);
        assert!(enabled && duty.abs() < 500, "held back, not off: {duty}");
    }
    assert_eq!(latched(&bench), []);
}

#[test]
fn a_shaft_that_stands_before_a_soft_limit_with_the_drive_that_is_left_is_no_stall() {
    let mut settings = Settings::DEFAULT;
    settings.control.soft_limits[0] = SoftLimits { low: 1000, high: 9000 };
    let scene_at = |start| {
        let mut scene = Scene::default();
        scene.motors[0] = MotorScene { start, ..MotorScene::with(ShaftSensor::Encoder) };
        scene
    };
    // Held fast 50 counts before the limit, where some of the drive is left, it draws the current of that.
    for (start, pwm, way) in [(8950, 32_767, 1), (1050, 1, -1)] {
        let mut bench = Bench::with(Make { scene: scene_at(start), settings, ..Make::default() });
        bench.configure(&[Parameter::Sensor(WHEEL, Sensor::Encoder)]);
        change(&bench, |all| all.jam[0] = Some(true));
        bench.drive(Quantity::Pwm, 0, pwm, 0);
        bench.run_alive_ms(20_000);
        let (duty, enabled) = bench.bridge(0);
        assert!(enabled && (4000..12_000).contains(&(duty * way)), "{duty}");
        assert_eq!(latched(&bench), []);
    }
}

#[test]
fn a_channel_that_is_latched_takes_no_part_in_a_command_and_the_others_do() {
    let mut bench = Bench::new();
    bench.configure(&[Parameter::Sensor(WHEEL, Sensor::SinglePotentiometer)]);
    bench.drive(Quantity::Position, 0, 4095, 0);
    bench.drive(Quantity::Velocity, 1, 2000, 0);
    bench.run_alive_ms(1500);
    assert_eq!(latched(&bench), [(Fault::SensorLost, Some(0))]);
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
