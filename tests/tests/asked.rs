//! What was asked moves as asked: set-points that wait for what is held back, ways that stay within
//! soft limits, motors that the settings do not describe, and what a channel is held to.

use std::ops::RangeInclusive;

use firmware::settings::{ChannelSettings, Settings, SoftLimits};
use hal_mock::board::Make;
use hal_mock::plant::{MotorScene, Overrides, Scene, ShaftSensor};
use protocol::pms5005::{Channel, Command, Gain, Loop, Method, Parameter, Quantity, Scope, Sensor};
use tests::Bench;
use tests::Link::{Alive, Silent};
use tests::extension::assign;

const WHEEL: Channel = Channel::ALL[0];

/// A bench with another motor on channel 0, and these settings.
fn with(motor: MotorScene, settings: Settings) -> Bench {
    let mut scene = Scene::default();
    scene.motors[0] = motor;
    Bench::with(Make { scene, settings, ..Make::default() })
}

fn wheel() -> MotorScene {
    MotorScene::with(ShaftSensor::Encoder)
}

fn change(bench: &Bench, change: impl FnOnce(&mut Overrides)) {
    change(&mut bench.board.plant.borrow_mut().overrides);
}

/// The highest speed of wheel 0 within so many ms, in counts per second.
fn peak(bench: &mut Bench, ms: u64) -> f32 {
    let mut peak = 0.0f32;
    bench.run_alive_with(ms, |bench| peak = peak.max(bench.velocity(0).abs()));
    peak
}

/// What keeps a shaft from following its set-point.
#[derive(Clone, Copy, Debug)]
enum Keeps {
    Obstacle,
    Jam,
    CurrentLimit,
    WeakSupply,
}

fn keep(bench: &Bench, by: Keeps, held: bool) {
    change(bench, |all| match by {
        Keeps::Obstacle => all.sonar_cm[0] = held.then_some(10),
        Keeps::Jam => all.jam[0] = held.then_some(true),
        Keeps::CurrentLimit => all.currents[0] = held.then_some(3700),
        Keeps::WeakSupply => all.battery_v[1] = held.then_some(0.3),
    });
}

#[test]
fn a_set_point_waits_for_what_is_held_back_and_goes_on_at_the_rate_asked() {
    for (by, ms) in [
        (Keeps::Obstacle, 5500),
        (Keeps::Jam, 300),
        (Keeps::Jam, 2000),
        (Keeps::Jam, 5500),
        (Keeps::CurrentLimit, 900),
        (Keeps::WeakSupply, 300),
        (Keeps::WeakSupply, 900),
    ] {
        let mut bench = Bench::new();
        bench.configure(&[
            Parameter::Sensor(WHEEL, Sensor::Encoder),
            Parameter::CollisionProtection(true),
        ]);
        bench.drive(Quantity::Position, 0, 12_000, 12_000);
        bench.run_alive_ms(1000);
        keep(&bench, by, true);
        bench.run_alive_ms(ms);
        let at = bench.position(0);
        assert!(at < 1200, "{by:?}: {at}");
        keep(&bench, by, false);
        // Limits are given back within a second.
        let rate = peak(&mut bench, 8000);
        assert!((950.0..=1250.0).contains(&rate), "{by:?} for {ms} ms: {rate} counts/s");
        bench.run_alive_ms(6000);
        let at = bench.position(0);
        assert!((at - 12_000).abs() <= 20, "{by:?} for {ms} ms: ends at {at}");
    }
}

#[test]
fn a_joint_that_must_first_lift_its_load_gets_there() {
    for load in [0.05, 0.15] {
        let motor = MotorScene { load, start: 500, ..MotorScene::with(ShaftSensor::Potentiometer) };
        let mut bench = with(motor, Settings::DEFAULT);
        bench.configure(&[Parameter::Sensor(WHEEL, Sensor::SinglePotentiometer)]);
        bench.drive(Quantity::Position, 0, 3000, 5000);
        bench.run_alive_ms(10_000);
        let sag = 3000 - bench.position(0);
        // A proportional controller sags by load / Kp: 655 counts for all of its drive.
        let most = (655.0 * load) as i64 + 25;
        assert!((0..=most).contains(&sag), "{load}: sags by {sag}");
    }
}

#[test]
fn a_joint_that_its_load_holds_off_keeps_the_time_of_a_move_with_it_and_against_it() {
    // It sags by 118 counts, one way or the other: more than a free shaft may be behind.
    for (load, way) in [(0.18, 1000), (0.18, -1000), (-0.18, 1000), (-0.18, -1000)] {
        let motor = MotorScene { load, ..MotorScene::with(ShaftSensor::Potentiometer) };
        let mut bench = with(motor, Settings::DEFAULT);
        bench.configure(&[Parameter::Sensor(WHEEL, Sensor::SinglePotentiometer)]);
        bench.drive(Quantity::Position, 0, 2048, 0);
        bench.run_alive_ms(2000);
        let start = bench.position(0);
        bench.drive(Quantity::Position, 0, 2048 + way, 2000);
        bench.run_alive_ms(2150);
        let short = i64::from(way) - (bench.position(0) - start);
        assert!(short.abs() <= 30, "{load}, {way}: {short} short");
    }
}

#[test]
fn a_timed_move_that_nothing_holds_back_keeps_its_time_whatever_its_rate() {
    for (way, periods) in [(200, 1000), (2000, 1000), (8000, 1000), (12_000, 1000)] {
        let mut bench = Bench::new();
        bench.configure(&[Parameter::Sensor(WHEEL, Sensor::Encoder)]);
        bench.drive(Quantity::Position, 0, way, periods);
        bench.run_alive_ms(u64::from(periods) + 300);
        let short = i64::from(way) - bench.position(0);
        assert!(short.abs() <= 20, "{way}: {short} short");
    }
}

#[test]
fn a_move_within_soft_limits_goes_the_way_that_stays_inside() {
    let mut settings = Settings::DEFAULT;
    settings.control.soft_limits[0] = SoftLimits { low: 1000, high: 31_000 };
    // The shorter way leads through 0.
    for (start, target, periods) in [(2000, 30_500, 0), (2000, 30_500, 4000), (30_500, 2000, 0)] {
        let mut bench = with(MotorScene { start, ..wheel() }, settings);
        bench.configure(&[Parameter::Sensor(WHEEL, Sensor::Encoder)]);
        bench.drive(Quantity::Position, 0, target, periods);
        bench.run_alive_with(6000, |bench| {
            let at = bench.position(0);
            assert!((1000 - 16..=31_000 + 16).contains(&at), "{start} to {target}: {at}");
        });
        let at = bench.position(0);
        assert!((at - i64::from(target)).abs() <= 30, "{start} to {target}: {at}");
    }
    // From outside it comes in by the nearer limit, if it is told to.
    for (start, near) in [(500, 1000), (32_000, 31_000)] {
        let mut bench = with(MotorScene { start, ..wheel() }, settings);
        bench.configure(&[Parameter::Sensor(WHEEL, Sensor::Encoder)]);
        bench.drive(Quantity::Pwm, 0, 16_384, 0);
        bench.run_alive_ms(500);
        assert_eq!(bench.position(0), start, "nobody asked it to move");
        bench.drive(Quantity::Position, 0, if near == 1000 { 0 } else { i16::MAX }, 0);
        bench.run_alive_ms(2000);
        let at = bench.position(0);
        assert!((at - near).abs() <= 30, "from {start}: {at}");
    }
}

#[test]
fn full_pwm_stops_at_a_soft_limit_whatever_the_inertia() {
    let mut settings = Settings::DEFAULT;
    settings.control.soft_limits[0] = SoftLimits { low: 1000, high: 31_000 };
    for inertia in [0.1, 1.0, 2.0, 4.0] {
        for (start, pwm) in [(5000, 32_767), (27_000, 1), (30_000, 32_767)] {
            let motor = wheel();
            let time_constant_s = motor.time_constant_s * inertia;
            let mut bench = with(MotorScene { start, time_constant_s, ..motor }, settings);
            bench.configure(&[Parameter::Sensor(WHEEL, Sensor::Encoder)]);
            bench.drive(Quantity::Pwm, 0, pwm, 0);
            let (mut low, mut high) = (start, start);
            bench.run_alive_with(5000, |bench| {
                low = low.min(bench.position(0));
                high = high.max(bench.position(0));
            });
            assert!(low >= 1000 - 16 && high <= 31_000 + 16, "{inertia}: {low} to {high}");
            let at = bench.position(0);
            let short = if pwm > 16_384 { 31_000 - at } else { at - 1000 };
            assert!((-16..=32).contains(&short), "{inertia}: rests {short} short");
        }
    }
}

#[test]
fn a_gain_of_0_has_no_part() {
    let mut bench = Bench::new();
    let ki =
        |integer| Parameter::Gain(WHEEL, Loop::Position, Gain::Integral { integer, fraction: 0 });
    let gain = |gain| Parameter::Gain(WHEEL, Loop::Position, gain);
    bench.configure(&[Parameter::Sensor(WHEEL, Sensor::Encoder), ki(232), ki(0)]);
    bench.configure(&[Parameter::Gain(
        WHEEL,
        Loop::Position,
        Gain::Integral { integer: 0xE8, fraction: 3 }, // 10.00, as hosts send it
    )]);
    change(&bench, |all| all.jam[0] = Some(true));
    bench.drive(Quantity::Position, 0, 300, 0);
    bench.run_alive_ms(1000);
    bench.configure(&[ki(0)]);
    bench.run_alive_ms(100);
    change(&bench, |all| all.jam[0] = None);
    bench.run_alive_ms(1000);
    assert!((bench.position(0) - 300).abs() <= 20, "{}", bench.position(0));
    bench.configure(&[gain(Gain::Proportional(0)), gain(Gain::Derivative(0))]);
    bench.drive(Quantity::Position, 0, 3000, 0);
    bench.run_alive_ms(1000);
    assert_eq!(bench.bridge(0), (0, true));
}

#[test]
fn a_setting_of_another_matter_leaves_what_an_integral_has_gathered() {
    // All of the load's drive is the integral's, and half of the speed's.
    let mut bench = with(MotorScene { load: 0.2, ..wheel() }, Settings::DEFAULT);
    bench.drive(Quantity::Velocity, 0, 4000, 0);
    bench.run_alive_ms(2000);
    bench.send_raw(7, &assign(&[(32, 40)])); // the telemetry's period
    bench.run_alive_with(500, |bench| {
        let speed = bench.velocity(0);
        assert!((3900.0..4100.0).contains(&speed), "{speed}");
    });
}

#[test]
fn a_wheel_that_is_slower_or_faster_than_the_setting_overshoots_by_a_quarter_at_most() {
    for factor in [0.3, 0.5, 1.0, 2.0, 3.0, 4.0] {
        for speed in [200, 1000, 4000, 12_000] {
            let full_speed = 16_384.0 * factor;
            if f32::from(speed) > 0.8 * full_speed {
                continue;
            }
            let mut bench = with(MotorScene { full_speed, ..wheel() }, Settings::DEFAULT);
            bench.drive(Quantity::Velocity, 0, speed, 0);
            let most = peak(&mut bench, 2500) / f32::from(speed);
            let start = bench.position(0);
            bench.run_alive_ms(2000);
            let now = (bench.position(0) - start) as f32 / 2.0 / f32::from(speed);
            assert!((0.98..=1.25).contains(&most), "{factor}, {speed}: peak {most}");
            assert!((0.98..=1.02).contains(&now), "{factor}, {speed}: at the end {now}");
        }
    }
}

/// A bench whose channel 0 is held to something.
fn held(change: impl FnOnce(&mut ChannelSettings)) -> Bench {
    let mut settings = Settings::DEFAULT;
    change(&mut settings.control.channels[0]);
    let mut bench = with(wheel(), settings);
    bench.configure(&[Parameter::Sensor(WHEEL, Sensor::Encoder)]);
    bench
}

/// The duty of bridge 0 after each of these times.
#[track_caller]
fn duties(bench: &mut Bench, timeline: &[(u64, RangeInclusive<i16>)]) {
    let mut now = 0;
    for (at, duty) in timeline {
        bench.run_with(Silent, at - now, |_| {});
        now = *at;
        let is = bench.bridge(0).0;
        assert!(duty.contains(&is), "after {at} ms: {is}, not {duty:?}");
    }
}

#[test]
fn a_slew_limit_holds_back_what_drives_and_nothing_that_stops() {
    // A second from nothing to full drive: 16 a period.
    let slewed = || held(|channel| channel.slew_ms = 1000);
    let mut bench = slewed();
    bench.drive(Quantity::Pwm, 0, 32_767, 0);
    duties(&mut bench, &[(102, 1580..=1650), (502, 7980..=8050), (1100, 16_383..=16_383)]);
    // The other way round: at once to nothing, and from there.
    bench.drive(Quantity::Pwm, 0, 1, 0);
    duties(&mut bench, &[(4, -64..=0), (104, -1680..=-1550)]);

    let running = || {
        let mut bench = slewed();
        bench.drive(Quantity::Pwm, 0, 32_767, 0);
        bench.run_alive_ms(1200);
        bench
    };
    let mut bench = running();
    bench.drive(Quantity::Pwm, 0, 16_384, 0);
    duties(&mut bench, &[(3, 0..=0)]);
    let mut bench = running();
    bench.send(Command::Run { scope: Scope::All, run: false });
    duties(&mut bench, &[(3, 0..=0)]);
    assert!(!bench.bridge(0).1);
    let mut bench = running();
    let silence = bench.until(Silent, 2100, |bench| bench.bridge(0).0 != 16_383);
    duties(&mut bench, &[(60, 0..=0)]);
    assert!(silence > 1400);
    let mut bench = running();
    bench.configure(&[Parameter::CollisionProtection(true)]);
    change(&bench, |all| all.sonar_cm[0] = Some(10));
    let stopped = bench.until(Alive, 300, |bench| bench.bridge(0).0 <= 0);
    assert!(stopped < 100, "{stopped}: as soon as the sonar has seen it");
    let mut bench = running();
    change(&bench, |all| all.overheat[0] = Some(1000));
    bench.until(Alive, 1200, |bench| bench.bridge(0) == (0, false));
    // A velocity of 0 brakes with all it has: in neutral the wheel takes 125 ms.
    for speed in [8000, -8000] {
        let mut bench = slewed();
        bench.drive(Quantity::Velocity, 0, speed, 0);
        bench.run_alive_ms(2000);
        bench.drive(Quantity::Velocity, 0, 0, 0);
        let slow = bench.until(Alive, 300, |bench| bench.velocity(0).abs() < 1000.0);
        assert!(slow < 70, "{speed}: {slow} ms");
        bench.run_alive_ms(300 - slow);
        assert!(bench.velocity(0).abs() < 400.0, "{}", bench.velocity(0));
    }
}

#[test]
fn an_acceleration_limit_bounds_the_set_point_of_both_loops() {
    // 4000 counts/s within a second.
    let limited = || held(|channel| channel.acceleration = 4000);
    let mut bench = limited();
    bench.drive(Quantity::Velocity, 0, 4000, 0);
    for (ms, line) in [(500, 2000.0), (500, 4000.0)] {
        bench.run_alive_ms(ms);
        assert!((bench.velocity(0) - line).abs() < 300.0, "{line}: {}", bench.velocity(0));
    }
    bench.run_alive_ms(500);
    bench.drive(Quantity::Velocity, 0, 0, 0);
    bench.run_alive_ms(500);
    assert!((bench.velocity(0) - 2000.0).abs() < 300.0, "{}", bench.velocity(0));
    // 4000 counts from rest to rest at 4000 counts/s^2: a second up to 4000, a second down.
    let mut bench = limited();
    bench.drive(Quantity::Position, 0, 4000, 0);
    bench.run_alive_ms(1000);
    assert!((bench.position(0) - 2000).abs() < 150, "{}", bench.position(0));
    assert!((bench.velocity(0) - 4000.0).abs() < 300.0, "{}", bench.velocity(0));
    bench.run_alive_ms(1200);
    assert!((bench.position(0) - 4000).abs() <= 20, "{}", bench.position(0));
    // A timed move keeps to its rate, and takes as much longer as it needs to get there.
    let mut bench = limited();
    bench.drive(Quantity::Position, 0, 6000, 3000);
    let rate = peak(&mut bench, 3000);
    assert!((1900.0..2300.0).contains(&rate), "{rate}");
    bench.run_alive_ms(700);
    assert!((bench.position(0) - 6000).abs() <= 20, "{}", bench.position(0));
    // Turned round in the middle it neither jumps nor overshoots.
    let mut bench = limited();
    bench.drive(Quantity::Position, 0, 6000, 0);
    bench.run_alive_ms(1000);
    bench.drive(Quantity::Position, 0, 0, 0);
    bench.run_alive_ms(3500);
    assert!(bench.position(0).abs() <= 20, "{}", bench.position(0));
}

#[test]
fn the_highest_duty_bounds_every_way_of_driving() {
    let mut bench = held(|channel| channel.highest_duty = 4096);
    for (quantity, target) in
        [(Quantity::Pwm, 32_767), (Quantity::Velocity, 16_000), (Quantity::Position, 12_000)]
    {
        bench.drive(quantity, 0, target, 0);
        let mut most = 0;
        bench.run_alive_with(700, |bench| most = most.max(bench.bridge(0).0.abs()));
        assert_eq!(most, 4096, "{quantity:?}");
    }
}

#[test]
fn the_share_of_the_integral_is_all_that_it_adds() {
    for (share, duty) in [(16_384, 16_000..=16_384), (1000, 7000..=9600)] {
        let mut bench = held(|channel| channel.integral_share = share);
        change(&bench, |all| all.jam[0] = Some(true));
        bench.drive(Quantity::Velocity, 0, 4000, 0);
        bench.run_alive_ms(3000);
        let is = bench.bridge(0).0;
        assert!(duty.contains(&is), "{share}: {is}");
    }
}

#[test]
fn a_channel_whose_last_command_is_too_old_stops_as_by_silence() {
    let mut settings = Settings::DEFAULT;
    settings.control.oldest_command = 700;
    let mut bench = with(wheel(), settings);
    // The driver is alive, the planner behind it is dead.
    bench.drive(Quantity::Pwm, 0, 24_384, 0);
    bench.drive(Quantity::Pwm, 1, 24_384, 0);
    let begins = bench.until(Alive, 2000, |bench| bench.bridge(0).0 == 8000);
    bench.drive(Quantity::Pwm, 1, 24_384, 0);
    bench.run_alive_ms(400);
    bench.drive(Quantity::Pwm, 1, 24_384, 0);
    let old = 400 + bench.until(Alive, 2000, |bench| bench.bridge(0).0 < 8000);
    assert!((695..=705).contains(&old), "after {old} ms ({begins})");
    assert_eq!(bench.bridge(1).0, 8000, "whose command is younger");
    bench.run_alive_ms(100);
    assert_eq!(bench.bridge(0), (0, false));
    // A resume does not bring it back, a motion command does.
    bench.send(Command::Run { scope: Scope::All, run: true });
    bench.run_alive_ms(100);
    assert_eq!(bench.bridge(0), (0, false));
    bench.drive(Quantity::Pwm, 0, 24_384, 0);
    bench.run_alive_ms(100);
    assert_eq!(bench.bridge(0), (8000, true));
    // A timed position move goes on to its end.
    bench.configure(&[Parameter::Sensor(WHEEL, Sensor::Encoder)]);
    bench.drive(Quantity::Pwm, 0, 16_384, 0);
    bench.run_alive_ms(500);
    let from = bench.position(0);
    let target = (from + 3000).rem_euclid(32_768) as i16;
    bench.drive(Quantity::Position, 0, target, 2000);
    bench.run_alive_ms(2500);
    assert!((bench.position(0) - from - 3000).abs() <= 20);
}

/// A bench with soft limits on channel 0, by its encoder.
fn limited(motor: MotorScene, low: i16, high: i16) -> Bench {
    let mut settings = Settings::DEFAULT;
    settings.control.soft_limits[0] = SoftLimits { low, high };
    let mut bench = with(motor, settings);
    bench.configure(&[Parameter::Sensor(WHEEL, Sensor::Encoder)]);
    bench
}

#[test]
fn a_shaft_that_is_held_outside_its_soft_limits_makes_no_turn_by_itself() {
    // Opposite the middle of these limits is count 0, where an encoder begins.
    let mut bench = limited(MotorScene { start: -6, load: -0.1, ..wheel() }, 1000, 31_767);
    bench.drive(Quantity::Velocity, 0, -20, 0);
    bench.run_alive_ms(6);
    bench.configure(&[Parameter::Method(WHEEL, Method::Position)]);
    bench.run_alive_with(3000, |bench| {
        // It may not be driven outwards, and so its load rolls it inside.
        assert!((-200..1100).contains(&bench.position(0)), "{}", bench.position(0));
    });
    // Limits that come when it holds after a silence.
    let mut bench = with(MotorScene { start: -300, load: 0.02, ..wheel() }, Settings::DEFAULT);
    bench.configure(&[Parameter::Sensor(WHEEL, Sensor::Encoder)]);
    bench.drive(Quantity::Position, 0, 10, 0);
    bench.run_ms(3500);
    let held = bench.position(0);
    bench.send_raw(7, &assign(&[(81, 31_767), (80, 1000)]));
    bench.run_alive_ms(3000);
    assert!((bench.position(0) - held).abs() <= 5, "{held} to {}", bench.position(0));
}

#[test]
fn a_load_carries_no_shaft_through_the_soft_limit_that_it_is_driven_against() {
    for (load, beyond) in [(0.05, 10), (0.1, 20), (0.2, 40)] {
        for (quantity, target) in [(Quantity::Pwm, 8000), (Quantity::Velocity, -3000)] {
            let mut bench = limited(MotorScene { start: 2500, load, ..wheel() }, 1000, 31_000);
            bench.drive(quantity, 0, target, 0);
            bench.run_alive_ms(10_000);
            let at = bench.position(0);
            assert!((1000 - beyond..=1016).contains(&at), "{quantity:?}, {load}: {at}");
            assert!(bench.bridge(0).1, "held, and no fault");
        }
    }
}

#[test]
fn what_a_soft_limit_brakes_leaves_nothing_in_an_integral() {
    let mut bench =
        limited(MotorScene { start: 15_000, time_constant_s: 0.24, ..wheel() }, 1000, 31_000);
    for target in [31_000, 20_000] {
        bench.drive(Quantity::Position, 0, target, 0);
        bench.run_alive_ms(6000);
        let off = bench.position(0) - i64::from(target);
        assert!(off.abs() <= 20, "{target}: {off} off");
    }
}

#[test]
fn a_stop_drives_no_harder_than_before_whatever_the_slew_limit_held_back() {
    let slow = |acceleration| {
        held(|channel| (channel.slew_ms, channel.acceleration) = (20_000, acceleration))
    };
    type Stop = fn(&mut Bench);
    let cases: [(Quantity, i16, u32, Stop); 4] = [
        (Quantity::Pwm, 32_767, 0, |bench| bench.run_ms(1600)),
        (Quantity::Velocity, 12_000, 0, |bench| bench.run_ms(1600)),
        (Quantity::Pwm, 32_767, 0, |bench| bench.drive(Quantity::Pwm, 0, 16_384, 500)),
        (Quantity::Velocity, 8000, 8000, |bench| bench.drive(Quantity::Velocity, 0, 0, 0)),
    ];
    for (quantity, target, acceleration, stop) in cases {
        let mut bench = slow(acceleration);
        bench.drive(quantity, 0, target, 0);
        bench.run_ms(400);
        stop(&mut bench);
        let (duty, speed) = (bench.bridge(0).0, bench.velocity(0));
        bench.run_with(Silent, 600, |bench| {
            assert!(bench.bridge(0).0 <= duty.max(2010), "{quantity:?}: {:?}", bench.bridge(0));
            assert!(bench.velocity(0) <= speed + 200.0, "{quantity:?}: {}", bench.velocity(0));
        });
    }
}

#[test]
fn what_is_outside_its_soft_limits_and_told_nothing_stays_there_whatever_its_noise() {
    for noise_lsb in [1.5, 3.0, 6.0] {
        let mut scene = Scene { noise_lsb, ..Scene::default() };
        let joint = MotorScene { start: 3200, ..MotorScene::with(ShaftSensor::Potentiometer) };
        scene.motors[2] = joint;
        let mut settings = Settings::DEFAULT;
        settings.control.soft_limits[2] = SoftLimits { low: 1000, high: 3000 };
        let mut bench = Bench::with(Make { scene, settings, ..Make::default() });
        bench.drive(Quantity::Pwm, 2, 16_384, 0);
        bench.run_alive_with(20_000, |bench| assert_eq!(bench.bridge(2).0, 0));
        assert_eq!(bench.position(2), 3200);
    }
}

#[test]
fn an_acceleration_limit_changes_no_rule_of_silence_and_needs_no_full_speed() {
    // An untimed move is none that goes on.
    let mut settings = Settings::DEFAULT;
    settings.control.full_speed_encoder = 2000;
    settings.control.channels[0].acceleration = 1000;
    let mut bench = with(wheel(), settings);
    bench.configure(&[Parameter::Sensor(WHEEL, Sensor::Encoder)]);
    bench.drive(Quantity::Position, 0, 16_000, 0);
    bench.until(Silent, 2100, |bench| bench.board.snapshot().link_loss);
    bench.run_ms(500);
    let held = bench.position(0);
    bench.run_ms(5000);
    assert!((bench.position(0) - held).abs() <= 20, "{held} to {}", bench.position(0));

    settings.control.full_speed_encoder = 0;
    let mut bench = with(wheel(), settings);
    bench.configure(&[Parameter::Sensor(WHEEL, Sensor::Encoder)]);
    bench.drive(Quantity::Position, 0, 1000, 0);
    bench.run_alive_ms(3000);
    assert!((bench.position(0) - 1000).abs() <= 20, "{}", bench.position(0));
}

#[test]
fn an_accelerated_move_keeps_its_time_without_its_host_and_its_rate_after_a_suspension() {
    // 2000 counts/s, half a second up and half a second down.
    let under_way = || {
        let mut bench = held(|channel| channel.acceleration = 4000);
        bench.drive(Quantity::Position, 0, 12_000, 6000);
        bench
    };
    let mut bench = under_way();
    bench.run_ms(7000);
    assert!((bench.position(0) - 12_000).abs() <= 20, "{}", bench.position(0));

    let mut bench = under_way();
    bench.run_alive_ms(2000);
    bench.send(Command::Run { scope: Scope::All, run: false });
    bench.run_alive_ms(500);
    bench.send(Command::Run { scope: Scope::All, run: true });
    let rate = peak(&mut bench, 6000);
    assert!((1950.0..=2300.0).contains(&rate), "{rate} counts/s");
    assert!((bench.position(0) - 12_000).abs() <= 20, "{}", bench.position(0));
}

#[test]
fn the_age_of_a_command_ends_a_timed_move_as_silence_does_and_runs_on_in_a_pause() {
    let mut settings = Settings::DEFAULT;
    (settings.control.oldest_command, settings.control.longest_move) = (700, 2000);
    let mut bench = with(wheel(), settings);
    bench.configure(&[Parameter::Sensor(WHEEL, Sensor::Encoder)]);
    bench.drive(Quantity::Position, 0, 12_000, 12_000);
    bench.run_alive_ms(6000);
    assert!((1900..2200).contains(&bench.position(0)), "{}", bench.position(0));

    bench.drive(Quantity::Pwm, 0, 24_384, 0);
    bench.run_alive_ms(200);
    bench.send(Command::Run { scope: Scope::All, run: false });
    bench.run_alive_ms(2000);
    bench.send(Command::Run { scope: Scope::All, run: true });
    bench.run_alive_with(100, |bench| assert_eq!(bench.bridge(0), (0, false)));
}

#[test]
fn a_pwm_that_is_chosen_under_way_of_a_position_move_is_neutral() {
    let mut bench = Bench::new();
    bench.configure(&[Parameter::Sensor(WHEEL, Sensor::Encoder)]);
    bench.drive(Quantity::Position, 0, 4000, 1000);
    bench.run_alive_ms(500);
    bench.configure(&[Parameter::Method(WHEEL, Method::Pwm)]);
    bench.run_alive_ms(500);
    assert_eq!((bench.bridge(0), bench.velocity(0)), ((0, true), 0.0));
}

#[test]
fn a_timed_move_gets_as_far_as_an_untimed_one_whatever_its_gain_and_its_highest_duty() {
    for (kp, highest_duty, load) in [(5, 16_384, 0.12), (50, 2650, 0.12), (200, 3000, 0.12)] {
        let ends = [20_000, 0].map(|periods| {
            let mut settings = Settings::DEFAULT;
            settings.control.channels[0].position.kp = kp;
            settings.control.channels[0].highest_duty = highest_duty;
            let joint = MotorScene::with(ShaftSensor::Potentiometer);
            let mut bench = with(MotorScene { start: 500, load, ..joint }, settings);
            bench.configure(&[Parameter::Sensor(WHEEL, Sensor::SinglePotentiometer)]);
            bench.drive(Quantity::Position, 0, 2500, periods);
            bench.run_alive_ms(40_000);
            assert!(bench.bridge(0).1, "{kp}, {highest_duty}: no fault");
            bench.position(0)
        });
        assert!(ends[0] >= ends[1] - 80, "{kp}, {highest_duty}: {ends:?}");
    }
}

#[test]
fn an_integral_does_not_break_loose_with_what_it_could_not_move() {
    let mut bench = Bench::new();
    let ki = Gain::Integral { integer: 100, fraction: 0 };
    bench.configure(&[
        Parameter::Sensor(WHEEL, Sensor::Encoder),
        Parameter::Gain(WHEEL, Loop::Position, ki),
    ]);
    bench.drive(Quantity::Position, 0, 12_000, 12_000);
    bench.run_alive_ms(1000);
    keep(&bench, Keeps::Jam, true);
    bench.run_alive_ms(4000);
    keep(&bench, Keeps::Jam, false);
    let rate = peak(&mut bench, 8000);
    assert!((950.0..=1350.0).contains(&rate), "{rate}");
}
