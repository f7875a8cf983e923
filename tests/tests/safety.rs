//! What must not move does not: silence of the host, obstacles, commands that are refused.

use embassy_time::{Duration, Instant};
use firmware::settings::Settings;
use hal_mock::board::Make;
use hal_mock::clock;
use hal_mock::plant::{Motor, MotorScene, Scene, ShaftSensor};
use protocol::extension::{Action, Request};
use protocol::pms5005::{
    Addressing, Channel, Command, Frame, Method, Move, Parameter, Polarity, Quantity, Repeat,
    Scope, Sensor, did,
};
use tests::Bench;
use tests::Link::Silent;

#[test]
fn at_boot_nothing_is_driven() {
    let mut bench = Bench::new();
    bench.run_with(Silent, 1000, |bench| {
        for i in 0..6 {
            assert_eq!((bench.bridge(i), bench.pulse(i)), ((0, false), None));
        }
    });
    // A resume does not enable what was never commanded.
    bench.send(Command::Run { scope: Scope::All, run: true });
    bench.run_ms(100);
    assert_eq!((bench.bridge(0), bench.pulse(0)), ((0, false), None));
}

/// A bench with a wheel on PWM, a wheel on velocity, a joint on its way and a servo on its way.
fn everything_moving() -> Bench {
    let mut bench = Bench::new();
    bench.drive(Quantity::Pwm, 0, 16384 + 8000, 0);
    bench.drive(Quantity::Velocity, 1, 5000, 0);
    bench.drive(Quantity::Position, 2, 1000, 0);
    bench.run_alive_ms(1000);
    bench.drive(Quantity::Position, 2, 3000, 10_000);
    bench.drive(Quantity::Servo, 3, 2000, 0);
    bench.drive(Quantity::Servo, 3, 5000, 10_000);
    bench.run_ms(10);
    bench
}

#[test]
fn a_silent_host_stops_pwm_and_velocity_within_100_ms_and_servos_where_they_are() {
    let mut bench = everything_moving();
    // The last frame came a moment ago. Until 2 s after it nothing changes.
    bench.run_ms(1980);
    assert_eq!(bench.bridge(0), (8000, true));
    assert!(bench.velocity(1) > 4800.0);
    assert!(!bench.board.snapshot().link_loss);
    bench.run_ms(120);
    assert_eq!((bench.bridge(0), bench.bridge(1)), ((0, false), (0, false)));
    assert!(bench.velocity(1).abs() < 500.0, "{}", bench.velocity(1));
    assert!(bench.board.snapshot().link_loss);
    // The servo stays where it was on its way; the joint's timed move goes on to its end, and holds.
    bench.run_ms(300);
    let (joint, servo) = (bench.position(2), bench.pulse(3));
    assert!((1400..1600).contains(&joint), "{joint}");
    bench.run_ms(9000);
    assert!(bench.bridge(2).1 && (2980..=3000).contains(&bench.position(2)));
    assert!(servo.is_some() && bench.pulse(3) == servo);
}

#[test]
fn the_stop_is_a_ramp_that_is_neither_a_jerk_nor_late() {
    let mut bench = everything_moving();
    bench.until(Silent, 2100, |bench| bench.bridge(0).0 != 8000);
    let mut duties = vec![bench.bridge(0).0];
    while bench.bridge(0).1 {
        bench.run_ms(1);
        duties.push(bench.bridge(0).0);
    }
    assert!((50..=100).contains(&duties.len()), "{} ms", duties.len());
    assert!(duties.windows(2).all(|d| d[1] <= d[0] && d[0] - d[1] <= 400), "{duties:?}");
}

#[test]
fn after_link_loss_only_a_motion_command_moves_again() {
    let mut bench = everything_moving();
    bench.run_ms(3000);
    assert!(bench.board.snapshot().link_loss);
    // Frames come again, even a resume.
    bench.run_alive_ms(500);
    assert!(bench.board.snapshot().link_loss, "stopped channels are still reported");
    bench.send(Command::Run { scope: Scope::All, run: true });
    bench.run_alive_ms(500);
    assert_eq!((bench.bridge(0), bench.bridge(1)), ((0, false), (0, false)));
    assert!(bench.velocity(1).abs() < 20.0, "{}", bench.velocity(1));
    bench.drive(Quantity::Velocity, 1, 3000, 0);
    bench.drive(Quantity::Pwm, 0, 16384 - 4000, 0);
    bench.run_alive_ms(500);
    assert!(bench.velocity(1) > 2800.0);
    assert_eq!(bench.bridge(0), (-4000, true));
    assert!(!bench.board.snapshot().link_loss);
}

/// A wheel under position control by its encoder.
fn position_by_encoder(bench: &mut Bench) {
    let wheel = Channel::ALL[0];
    bench.configure(&[
        Parameter::Sensor(wheel, Sensor::Encoder),
        Parameter::Method(wheel, Method::Position),
    ]);
}

#[test]
fn a_silent_host_breaks_off_a_move_that_had_no_time_too() {
    // Jammed on its way, or just far to go: with the host gone the shaft does not go there.
    let mut bench = Bench::new();
    position_by_encoder(&mut bench);
    bench.board.plant.borrow_mut().overrides.jam[0] = Some(true);
    bench.drive(Quantity::Position, 0, 6000, 0);
    bench.run_ms(4000);
    assert!(bench.board.snapshot().link_loss);
    bench.board.plant.borrow_mut().overrides.jam[0] = None;
    bench.run_ms(2000);
    assert!(bench.position(0).abs() <= 140, "moved {}", bench.position(0));

    let mut settings = Settings::DEFAULT;
    settings.control.link_timeout = 200;
    let mut bench = Bench::with(Make { settings, ..Make::default() });
    position_by_encoder(&mut bench);
    bench.drive(Quantity::Position, 0, 16_000, 0);
    bench.until(Silent, 2100, |bench| bench.board.snapshot().link_loss);
    // It is at full speed then, and needs some way to stop.
    let at = bench.position(0);
    bench.run_ms(3000);
    let further = bench.position(0) - at;
    assert!((0..=600).contains(&further), "from {at} {further} counts further");
}

#[test]
fn after_link_loss_a_position_that_was_held_is_left_alone_once_it_is_suspended() {
    let mut bench = Bench::new();
    position_by_encoder(&mut bench);
    bench.drive(Quantity::Position, 0, 6000, 0);
    bench.run_ms(3000);
    bench.send(Command::Run { scope: Scope::All, run: false });
    bench.run_alive_ms(100);
    // Somebody turns the wheel.
    let moved = MotorScene { start: 2000, ..MotorScene::with(ShaftSensor::Encoder) };
    bench.board.plant.borrow_mut().motors[0] = Motor::new(moved);
    bench.run_alive_ms(200);
    bench.send(Command::Run { scope: Scope::All, run: true });
    bench.run_alive_ms(1500);
    assert_eq!((bench.bridge(0), bench.position(0)), ((0, false), 2000));
}

#[test]
fn parameters_that_arrive_during_the_stop_switch_the_bridge_off() {
    let wheel = Channel::ALL[0];
    for parameter in [
        Parameter::Sensor(wheel, Sensor::SinglePotentiometer),
        Parameter::Polarity(wheel, Polarity::Negative),
        Parameter::Method(wheel, Method::Position),
    ] {
        let mut bench = Bench::new();
        bench.drive(Quantity::Velocity, 0, 5000, 0);
        bench.run_alive_ms(1000);
        bench.until(Silent, 2100, |bench| bench.board.snapshot().link_loss);
        bench.run_ms(10);
        bench.configure(&[parameter]);
        bench.run_ms(3);
        bench.run_with(Silent, 200, |bench| {
            assert_eq!(bench.bridge(0), (0, false), "{parameter:?}");
        });
    }
}

#[test]
fn a_stop_by_neutral_pwm_stays_a_stop_when_the_channel_is_resumed() {
    let wheel = Channel::ALL[0];
    for method in [Method::Position, Method::Velocity] {
        let mut bench = Bench::new();
        position_by_encoder(&mut bench);
        bench.drive(Quantity::Position, 0, 6000, 0);
        bench.run_alive_ms(1500);
        bench.configure(&[Parameter::Method(wheel, method)]);
        bench.drive(Quantity::Pwm, 0, 16384, 0);
        bench.run_alive_ms(500);
        let at = bench.position(0);
        bench.send(Command::Run { scope: Scope::All, run: false });
        bench.run_alive_ms(200);
        bench.send(Command::Run { scope: Scope::All, run: true });
        bench.run_alive_ms(1500);
        assert!((bench.position(0) - at).abs() <= 20, "{method:?}: from {at}");
    }
}

#[test]
fn choosing_a_method_does_not_set_a_stopped_wheel_in_motion() {
    let wheel = Channel::ALL[0];
    let mut bench = Bench::new();
    bench.drive(Quantity::Velocity, 0, 8000, 0);
    bench.run_alive_ms(500);
    // It still coasts when the method is chosen.
    bench.drive(Quantity::Pwm, 0, 16384, 0);
    bench.run_ms(20);
    assert!(bench.velocity(0) > 2000.0);
    bench.configure(&[Parameter::Method(wheel, Method::Velocity)]);
    bench.run_alive_ms(1000);
    assert!(bench.velocity(0).abs() < 20.0, "{}", bench.velocity(0));
}

#[test]
fn a_polarity_that_is_put_right_brings_a_runaway_wheel_back() {
    let mut scene = Scene::default();
    scene.motors[0] = MotorScene { reversed: true, ..MotorScene::with(ShaftSensor::Encoder) };
    let mut make = Make { scene, ..Make::default() };
    make.settings.control.channel_faults.wrong_way_ms = 0; // or it would be off by now
    let mut bench = Bench::with(make);
    bench.drive(Quantity::Velocity, 0, 400, 0);
    bench.run_alive_ms(1000);
    assert!(bench.velocity(0) < -10_000.0, "it runs away");
    bench.configure(&[Parameter::Polarity(Channel::ALL[0], Polarity::Negative)]);
    bench.run_alive_ms(2000);
    assert!((380.0..420.0).contains(&bench.velocity(0)), "{}", bench.velocity(0));
}

#[test]
fn an_obstacle_that_goes_away_does_not_let_a_wound_up_wheel_loose() {
    let mut bench = Bench::new();
    bench.configure(&[Parameter::CollisionProtection(true)]);
    bench.drive(Quantity::Velocity, 0, 1000, 0);
    bench.run_alive_ms(300);
    let set = |bench: &Bench, jam, sonar| {
        let overrides = &mut bench.board.plant.borrow_mut().overrides;
        (overrides.jam[0], overrides.sonar_cm[0]) = (jam, sonar);
    };
    set(&bench, Some(true), None);
    bench.run_alive_ms(2000);
    set(&bench, Some(true), Some(10));
    bench.run_alive_ms(3000);
    set(&bench, None, None);
    let mut peak = 0.0f32;
    bench.run_alive_with(1000, |bench| peak = peak.max(bench.velocity(0)));
    assert!((950.0..=1200.0).contains(&peak), "{peak}");
}

#[test]
fn a_motion_command_takes_over_in_the_middle_of_the_stop() {
    let mut bench = everything_moving();
    bench.until(Silent, 2100, |bench| bench.bridge(0).0 != 8000);
    bench.run_ms(20);
    bench.drive(Quantity::Pwm, 0, 16384 + 2000, 0);
    bench.run_ms(200);
    assert_eq!((bench.bridge(0), bench.bridge(1)), ((2000, true), (0, false)));
}

#[test]
fn a_suspended_channel_does_not_start_by_itself_after_link_loss() {
    let mut bench = everything_moving();
    bench.send(Command::Run { scope: Scope::All, run: false });
    bench.run_ms(3000);
    bench.send(Command::Run { scope: Scope::All, run: true });
    bench.run_alive_ms(500);
    assert_eq!((bench.bridge(0), bench.bridge(1)), ((0, false), (0, false)));
    assert!(bench.velocity(1).abs() < 20.0);
}

/// Whether wheel 0 still runs after 3 s in which this came ten times a second.
fn keeps_running(mut comes: impl FnMut(&mut Bench)) -> bool {
    let mut bench = everything_moving();
    for _ in 0..30 {
        comes(&mut bench);
        bench.run_ms(100);
    }
    bench.bridge(0) == (8000, true)
}

#[test]
fn whoever_talks_to_any_device_is_alive_and_garbage_or_our_own_echo_is_nobody() {
    let mut to_the_camera = [0; 10];
    Frame { rid: 8, res: 0, did: 255, data: &[0] }.encode(&mut to_the_camera).unwrap();
    assert!(keeps_running(|bench| bench.board.line.host_sends(&to_the_camera)));
    to_the_camera[6] ^= 1;
    assert!(!keeps_running(|bench| bench.board.line.host_sends(&to_the_camera)));
    assert!(!keeps_running(|bench| bench.board.line.host_sends(b"any noise")));
    // A line that echoes: our telemetry and our acknowledgements come back.
    assert!(!keeps_running(|bench| {
        while let Some((_, frame)) = bench.board.line.host_receives() {
            bench.board.line.host_sends(&frame);
        }
    }));
}

#[test]
fn who_only_watches_keeps_nothing_running() {
    assert!(keeps_running(|bench| bench.send(Command::Ping)));
    let once = Repeat::Times(1.try_into().unwrap());
    for request in [
        Request::Setting(1),
        Request::Identity,
        Request::Health(once),
        Request::Health(Repeat::Continuous),
        Request::Counters,
        Request::Fault(0),
        Request::State(once),
        Request::State(Repeat::Continuous),
        Request::Refusals,
    ] {
        assert!(!keeps_running(|bench| bench.send(Command::Extension(request))), "{request:?}");
    }
    // Not even one that asks wrongly; but one that sets is a host.
    assert!(!keeps_running(|bench| bench.send_raw(did::LCD + 77, &[1, 2, 3])));
    assert!(keeps_running(|bench| bench.send_raw(7, &[0x80, 32, 0, 50, 0, 0, 0])));
}

/// A wheel on a move of 12,000 counts in `periods`, whose host says nothing any more.
fn left_on_a_move(periods: u16, settings: Settings) -> Bench {
    left_on_a_move_to(12_000, periods, settings)
}

/// The same, to where its target says.
fn left_on_a_move_to(target: i16, periods: u16, settings: Settings) -> Bench {
    let mut bench = Bench::with(Make { settings, ..Make::default() });
    position_by_encoder(&mut bench);
    bench.drive(Quantity::Position, 0, target, periods);
    bench
}

#[test]
fn a_timed_move_of_a_silent_host_goes_on_to_its_end_and_holds() {
    let mut bench = left_on_a_move(5000, Settings::DEFAULT);
    bench.run_ms(3000);
    assert!(bench.board.snapshot().link_loss);
    assert!((6500..7500).contains(&bench.position(0)), "{}", bench.position(0));
    bench.run_ms(3000);
    assert!(bench.bridge(0).1 && (bench.position(0) - 12_000).abs() <= 20, "{}", bench.position(0));
    // As an untimed one it holds within a band, and only a motion command moves it.
    bench.send(Command::Run { scope: Scope::All, run: false });
    bench.send(Command::Run { scope: Scope::All, run: true });
    bench.run_alive_ms(100);
    assert_eq!(bench.bridge(0), (0, false));
}

#[test]
fn a_timed_move_goes_on_without_a_host_for_as_long_as_a_setting_says() {
    for (longest_move, ends_at) in [(10_000, 10_000), (4000, 4000), (1000, 2000), (0, 2000)] {
        let mut settings = Settings::DEFAULT;
        settings.control.longest_move = longest_move;
        let mut bench = left_on_a_move(20_000, settings);
        bench.run_ms(15_000);
        let line = 12_000 * ends_at / 20_000;
        assert!((bench.position(0) - line).abs() <= 150, "{longest_move}: {}", bench.position(0));
    }
}

/// Lets control be 30 ms late four times: 120 ms pass in four periods, and some between.
fn be_late(bench: &mut Bench) {
    for _ in 0..4 {
        clock::advance_to(Instant::now() + Duration::from_millis(30));
        bench.run_ms(5);
    }
}

#[test]
fn a_stop_that_time_makes_comes_in_time_although_control_was_late() {
    // The host's silence.
    let mut bench = everything_moving();
    let begun = Instant::now();
    bench.run_ms(500);
    be_late(&mut bench);
    bench.until(Silent, 2100, |bench| bench.bridge(0).0 != 8000);
    let silent = begun.elapsed().as_millis();
    assert!((1985..=2000).contains(&silent), "{silent}");
    // The stop itself.
    be_late(&mut bench);
    assert_eq!((bench.bridge(0), bench.bridge(1)), ((0, false), (0, false)));
    // The end of a timed move without a host, 10 s after its last sign of life.
    let mut bench = left_on_a_move(20_000, Settings::DEFAULT);
    let begun = Instant::now();
    bench.run_ms(5000);
    be_late(&mut bench);
    bench.run_ms(9990 - begun.elapsed().as_millis());
    assert!(bench.velocity(0) > 500.0, "{}", bench.velocity(0));
    bench.run_ms(110);
    assert!(bench.velocity(0) < 100.0, "{}", bench.velocity(0));
    // The age of a motion command.
    let mut settings = Settings::DEFAULT;
    settings.control.oldest_command = 700;
    let mut bench = Bench::with(Make { settings, ..Make::default() });
    bench.drive(Quantity::Pwm, 0, 16384 + 8000, 0);
    let begun = Instant::now();
    bench.run_ms(50);
    be_late(&mut bench);
    bench.until(Silent, 2100, |bench| bench.bridge(0).0 != 8000);
    let age = begun.elapsed().as_millis();
    assert!((700..=705).contains(&age), "{age}");
    // What a fault's record tells of it.
    let mut bench = everything_moving();
    let begun = Instant::now().as_millis();
    be_late(&mut bench);
    bench.run_ms(3000);
    let record = bench.fault(0).record.expect("a lost link");
    let lost = u64::from(record.uptime_ms) - begun;
    assert!((1985..=2000).contains(&lost), "{lost}");
}

#[test]
fn what_holds_a_timed_move_of_a_silent_host_back_ends_it() {
    let obstacle = |bench: &Bench, cm| bench.board.plant.borrow_mut().overrides.sonar_cm[0] = cm;
    let mut bench = left_on_a_move(8000, Settings::DEFAULT);
    bench.configure(&[Parameter::CollisionProtection(true)]);
    bench.run_ms(3000);
    obstacle(&bench, Some(10));
    bench.run_ms(500);
    let at = bench.position(0);
    obstacle(&bench, None);
    bench.run_ms(6000);
    assert!((bench.position(0) - at).abs() <= 140, "from {at} to {}", bench.position(0));

    let mut bench = left_on_a_move(8000, Settings::DEFAULT);
    bench.run_ms(3000);
    bench.send(Command::Run { scope: Scope::All, run: false });
    bench.run_alive_ms(500);
    let at = bench.position(0);
    bench.send(Command::Run { scope: Scope::All, run: true });
    bench.run_alive_ms(6000);
    assert_eq!((bench.position(0), bench.bridge(0)), (at, (0, false)));
}

#[test]
fn a_limit_ends_a_timed_move_of_a_silent_host_either_way_if_the_drive_comes_to_it() {
    // 12,000 counts forward, and as many back.
    for (target, way) in [(12_000, 12_000), (20_768, -12_000)] {
        let too_much = |bench: &mut Bench, ms| {
            bench.board.plant.borrow_mut().overrides.currents[0] = Some(3700);
            bench.run_ms(ms);
            bench.board.plant.borrow_mut().overrides.currents[0] = None;
        };
        let mut bench = left_on_a_move_to(target, 8000, Settings::DEFAULT);
        bench.run_ms(3000);
        too_much(&mut bench, 500);
        let at = bench.position(0);
        bench.run_ms(7000);
        assert!((bench.position(0) - at).abs() <= 140, "from {at} to {}", bench.position(0));

        // A quarter of the drive is taken, and given back: the move needs less than is left.
        let mut bench = left_on_a_move_to(target, 8000, Settings::DEFAULT);
        bench.run_ms(3000);
        too_much(&mut bench, 30);
        bench.run_ms(7000);
        assert!((bench.position(0) - way).abs() <= 20, "{way}: {}", bench.position(0));
    }
}

#[test]
fn the_silence_allowed_is_a_setting_and_0_allows_any() {
    for (link_timeout, stops_at) in [(500, Some(500)), (0, None)] {
        let mut settings = Settings::DEFAULT;
        settings.control.link_timeout = link_timeout;
        let mut bench = Bench::with(Make { settings, ..Make::default() });
        bench.drive(Quantity::Pwm, 0, 20_000, 0);
        bench.run_ms(5);
        let stopped = bench.until_or(Silent, 60_000, |bench| bench.bridge(0).0 < 3616);
        match stops_at {
            None => assert_eq!(stopped, None),
            Some(ms) => assert!(stopped.is_some_and(|at| (ms - 5..=ms + 5).contains(&(at + 4)))),
        }
    }
}

#[test]
fn the_collision_protection_stops_driving_towards_an_obstacle_and_never_backing_off() {
    for (near, far) in [(Some(20), None), (None, Some(3000))] {
        let mut bench = Bench::new();
        bench.drive(Quantity::Velocity, 0, 2000, 0);
        bench.drive(Quantity::Pwm, 1, 20_000, 0);
        bench.drive(Quantity::Pwm, 2, 20_000, 0);
        bench.run_alive_ms(500);
        let place = |bench: &Bench| {
            let overrides = &mut bench.board.plant.borrow_mut().overrides;
            overrides.sonar_cm[1] = near;
            overrides.ir_range = far;
        };
        place(&bench);
        bench.run_alive_ms(500);
        assert!(bench.velocity(0) > 1900.0, "it is off at boot");

        bench.configure(&[Parameter::CollisionProtection(true)]);
        bench.run_alive_ms(500);
        let stopped = [bench.velocity(0), bench.velocity(1)];
        assert!(stopped.iter().all(|velocity| velocity.abs() < 10.0), "{stopped:?}");
        assert_eq!(bench.bridge(2).0, 3616, "a joint is no wheel");
        assert!(bench.board.snapshot().obstacle);
        bench
            .run_alive_with(500, |bench| assert!(bench.bridge(0).0 <= 0 && bench.bridge(1).0 <= 0));

        bench.drive(Quantity::Velocity, 0, -1000, 0);
        bench.drive(Quantity::Pwm, 1, 12_000, 0);
        bench.run_alive_ms(500);
        assert!((-1100.0..-900.0).contains(&bench.velocity(0)), "{}", bench.velocity(0));
        assert_eq!(bench.bridge(1).0, 12_000 - 16384);

        // With the road clear it goes on.
        bench.board.plant.borrow_mut().overrides = Default::default();
        bench.drive(Quantity::Velocity, 0, 1500, 0);
        bench.run_alive_ms(800);
        assert!((1400.0..1600.0).contains(&bench.velocity(0)), "{}", bench.velocity(0));
    }
}

#[test]
fn the_collision_protection_knows_a_motor_that_is_wired_the_other_way_round() {
    let mut scene = Scene::default();
    scene.motors[0] = MotorScene { reversed: true, ..MotorScene::with(ShaftSensor::Encoder) };
    let mut bench = Bench::with(Make { scene, ..Make::default() });
    bench.board.plant.borrow_mut().overrides.sonar_cm = [Some(10); 6];
    let wheel = Channel::ALL[0];
    bench.configure(&[
        Parameter::Polarity(wheel, Polarity::Negative),
        Parameter::CollisionProtection(true),
    ]);
    // Raw PWM above neutral lowers the counts here: it backs off.
    bench.drive(Quantity::Pwm, 0, 20_000, 0);
    bench.run_alive_ms(300);
    assert!(bench.position(0) < -100);
    bench.drive(Quantity::Pwm, 0, 12_000, 0);
    bench.run_alive_ms(300);
    assert_eq!(bench.bridge(0).0, 0);
}

#[test]
fn a_display_that_hangs_does_not_hold_up_the_command_that_stops_a_motor() {
    let mut bench = Bench::quiet();
    bench.board.plant.borrow_mut().overrides.lcd_hangs = true;
    bench.drive(Quantity::Pwm, 0, 30_000, 0);
    for number in 0..6 {
        let mut picture = [0xAA; 65];
        picture[0] = number;
        bench.send_raw(did::LCD, &picture);
    }
    // Until it is taken for hung: 90 ms after the first picture.
    bench.run_ms(60);
    assert_eq!(bench.bridge(0), (30_000 - 16384, true));
    bench.drive(Quantity::Pwm, 0, 16384, 0);
    bench.run_ms(5);
    assert_eq!(bench.bridge(0), (0, true));
    assert_eq!(bench.acks(), 8);
    // One hangs in the display, two wait.
    assert_eq!(bench.board.link().pictures_dropped, 3);
}

#[test]
fn a_chosen_method_refuses_the_others_except_a_stop() {
    let mut bench = Bench::quiet();
    let wheel = Channel::ALL[0];
    bench.configure(&[
        Parameter::Sensor(wheel, Sensor::Encoder),
        Parameter::Method(wheel, Method::Velocity),
    ]);
    bench.drive(Quantity::Velocity, 0, 2000, 0);
    bench.run_alive_ms(500);
    bench.received();
    let before = bench.board.snapshot().counters.refused.total();
    bench.drive(Quantity::Pwm, 0, 30_000, 0);
    bench.drive(Quantity::Position, 0, 100, 0);
    // Channel 1 has chosen nothing, but a list is carried out whole or not at all.
    let targets = [Some(30_000), Some(30_000), None, None, None, None];
    bench.send(Command::Move(Move {
        quantity: Quantity::Pwm,
        addressing: Addressing::List,
        targets,
        periods: 0,
    }));
    bench.run_alive_ms(500);
    assert_eq!(bench.board.snapshot().counters.refused.total() - before, 3);
    assert!((1900.0..2100.0).contains(&bench.velocity(0)));
    assert_eq!(bench.bridge(1), (0, false));
    // Both numbers that hosts use for neutral are a stop, and a stop is always taken.
    for neutral in [16384, 16383] {
        bench.drive(Quantity::Velocity, 0, 2000, 0);
        bench.run_alive_ms(300);
        bench.drive(Quantity::Pwm, 0, neutral, 0);
        bench.run_alive_ms(20);
        assert_eq!(bench.bridge(0), (0, true));
    }
}

#[test]
fn the_extremes_of_every_field_leave_a_board_that_works() {
    let mut bench = Bench::quiet();
    let gains = |kp: u8, kd: u8, ki: u8| {
        [0x07, 0x08].map(|sub| [sub, 0, 1, kp, kp & 0x80, 2, kd, kd & 0x80, 3, ki, ki])
    };
    for data in gains(255, 255, 255) {
        bench.send_raw(did::PARAMETERS, &data);
    }
    for sensor in [0, 1, 2] {
        bench.send_raw(did::PARAMETERS, &[0x0D, 0, sensor]);
        for target in [-32_767, 32_767, 0] {
            for periods in [0, 1, 65_535] {
                bench.drive(Quantity::Velocity, 0, target, periods);
                bench.run_alive_ms(30);
                bench.drive(Quantity::Position, 0, target.max(0) >> 3, periods);
                bench.run_alive_ms(30);
            }
        }
    }
    for data in gains(50, 5, 0) {
        bench.send_raw(did::PARAMETERS, &data);
    }
    bench.drive(Quantity::Position, 0, 3000, 0);
    bench.run_alive_ms(2000);
    assert!((2960..=3040).contains(&bench.position(0).rem_euclid(32_768)));
}

#[test]
fn a_command_that_waited_while_control_was_late_is_not_left_running_by_a_silent_host() {
    for offset in (0..8000).step_by(250) {
        let mut settings = Settings::DEFAULT;
        settings.control.link_timeout = 30;
        let mut bench = Bench::with(Make { settings, ..Make::default() });
        bench.hush();
        // It waits until the save is done, and control is late meanwhile, as it is by an erase.
        bench.send_raw(did::PARAMETERS, &[Action::Save.number()]);
        bench.drive(Quantity::Pwm, 0, 16384 + 8000, 0);
        bench.board.run_for(Duration::from_micros(offset));
        clock::advance_to(Instant::now() + Duration::from_millis(45));
        bench.run_ms(2000);
        assert_eq!(bench.bridge(0), (0, false), "late {offset} us after the command");
    }
}

#[test]
fn a_host_that_spoke_in_time_is_not_silent_because_control_was_late() {
    let mut settings = Settings::DEFAULT;
    settings.control.link_timeout = 60;
    let mut bench = Bench::with(Make { settings, ..Make::default() });
    bench.drive(Quantity::Pwm, 0, 16384 + 8000, 0);
    bench.run_ms(40);
    assert_eq!(bench.bridge(0), (8000, true));
    // It arrives 41 ms after the command, while nothing of the board runs.
    bench.send(Command::Ping);
    clock::advance_to(Instant::now() + Duration::from_millis(45));
    bench.run_ms(20);
    assert_eq!((bench.bridge(0), bench.board.snapshot().counters.links_lost), ((8000, true), 0));
}
