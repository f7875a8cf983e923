//! The control loops against the simulated motors, through the wire, with bounds on both sides:
//! a loop that is too good to be true fails too.

use embassy_time::Duration;
use hal_mock::board::Make;
use hal_mock::plant::{MotorScene, Scene, ShaftSensor};
use protocol::pms5005::{
    Channel, Command, Gain, Loop, Method, Parameter, Polarity, Quantity, Scope, Sensor,
};
use tests::Bench;
use tests::Link::Silent;

const WHEEL: Channel = Channel::ALL[0];

/// The manual's way to position control of motor 1 (III.1.5).
fn position_by(sensor: Sensor, bench: &mut Bench) {
    bench.configure(&[Parameter::Sensor(WHEEL, sensor)]);
    bench.configure(&[Parameter::Method(WHEEL, Method::Position)]);
}

/// A bench with another motor on channel 0, told so if it is wired the other way round.
fn with_motor(motor: MotorScene) -> Bench {
    let mut scene = Scene::default();
    scene.motors[0] = motor;
    let mut bench = Bench::with(Make { scene, ..Make::default() });
    if motor.reversed {
        bench.configure(&[Parameter::Polarity(WHEEL, Polarity::Negative)]);
    }
    bench
}

fn reversed(sensor: ShaftSensor) -> Bench {
    with_motor(MotorScene { reversed: true, ..MotorScene::with(sensor) })
}

/// Follows motor 0 for `ms`: how far it went towards `target`, and when it was last more than 2 %
/// of the way from it.
fn follow(bench: &mut Bench, target: i64, ms: u64) -> (i64, u64) {
    let start = bench.position(0);
    let way = target - start;
    let (mut peak, mut settled, mut now) = (0, 0, 0);
    bench.run_alive_with(ms, |bench| {
        now += 1;
        let covered = (bench.position(0) - start) * way.signum();
        peak = peak.max(covered);
        if (covered - way.abs()).abs() * 50 > way.abs() {
            settled = now;
        }
    });
    (peak, settled)
}

#[test]
fn a_wheel_goes_from_0_to_6000_and_settles_within_a_second() {
    for mut bench in [Bench::new(), reversed(ShaftSensor::Encoder)] {
        position_by(Sensor::Encoder, &mut bench);
        bench.drive(Quantity::Position, 0, 6000, 0);
        let (peak, settled) = follow(&mut bench, 6000, 2000);
        assert!(peak <= 6600, "overshoot: {peak}");
        // At full speed the way alone takes 366 ms.
        assert!((400..=1000).contains(&settled), "settled after {settled} ms");
    }
}

#[test]
fn a_wheel_holds_its_velocity_forward_and_backward() {
    for mut bench in [Bench::new(), reversed(ShaftSensor::Encoder)] {
        // No sub-command before: hosts expect this to work at once.
        for speed in [400, -400] {
            bench.drive(Quantity::Velocity, 0, speed, 0);
            bench.run_alive_ms(1000);
            let start = bench.position(0);
            bench.run_alive_ms(4000);
            let mean = (bench.position(0) - start) as f64 / 4.0;
            assert!((mean - f64::from(speed)).abs() <= 8.0, "{speed}: mean {mean}");
        }
    }
}

#[test]
fn a_step_of_velocity_is_followed_quickly_without_much_overshoot() {
    let mut bench = Bench::new();
    bench.drive(Quantity::Velocity, 0, 4000, 0);
    let (mut peak, mut rise, mut now) = (0.0f32, 0, 0);
    bench.run_alive_with(1000, |bench| {
        now += 1;
        peak = peak.max(bench.velocity(0));
        if bench.velocity(0) < 3600.0 {
            rise = now;
        }
    });
    assert!(peak <= 4700.0, "{peak}");
    assert!((15..=100).contains(&rise), "90 % after {rise} ms");
}

#[test]
fn the_encoder_wraps_without_a_jump() {
    let mut bench =
        with_motor(MotorScene { start: 32_700, ..MotorScene::with(ShaftSensor::Encoder) });
    position_by(Sensor::Encoder, &mut bench);
    // The shorter way is forward over 32767, by 400 counts; then back.
    for (target, way) in [(332, 400), (32_700, -400)] {
        let start = bench.position(0);
        bench.drive(Quantity::Position, 0, target, 0);
        let mut farthest = 0;
        bench.run_alive_with(1000, |bench| {
            farthest = farthest.max((bench.position(0) - start).abs());
        });
        let moved = bench.position(0) - start;
        assert!((moved - way).abs() <= 40, "to {target}: moved {moved}");
        assert!(farthest <= 440, "to {target}: strayed to {farthest}");
    }
}

#[test]
fn velocity_is_steady_over_the_wrap() {
    let mut bench =
        with_motor(MotorScene { start: 32_000, ..MotorScene::with(ShaftSensor::Encoder) });
    bench.drive(Quantity::Velocity, 0, 2000, 0);
    bench.run_alive_ms(300);
    bench.run_alive_with(700, |bench| {
        let velocity = bench.velocity(0);
        assert!((1900.0..2100.0).contains(&velocity), "{velocity}");
    });
    assert!(bench.position(0) > 33_000, "it has passed the wrap");
}

#[test]
fn a_timed_move_is_on_the_line_half_way_and_arrives() {
    let mut bench = Bench::new();
    position_by(Sensor::Encoder, &mut bench);
    bench.run_ms(50);
    bench.drive(Quantity::Position, 0, 4000, 500);
    // The frame takes 1.04 ms on the line and is carried out at the next period.
    bench.run_ms(2 + 250);
    let half = bench.position(0);
    bench.run_ms(250);
    let end = bench.position(0);
    bench.run_ms(200);
    let rest = bench.position(0);
    assert!((1900..=2100).contains(&half), "half way: {half}");
    assert!((3900..=4100).contains(&end), "at the end: {end}");
    assert!((3920..=4080).contains(&rest), "at rest: {rest}");
}

#[test]
fn servos_and_pwm_are_exactly_on_their_lines() {
    let mut bench = Bench::quiet();
    bench.drive(Quantity::Servo, 3, 2000, 0);
    bench.drive(Quantity::Pwm, 3, 16384, 0);
    bench.run_ms(10);

    // From the first of 500 periods to the last one, and not before.
    bench.drive(Quantity::Servo, 3, 4000, 500);
    bench.until(Silent, 20, |bench| bench.pulse(3) != Some(2000));
    let line = [(0, 2004), (249, 3000), (498, 3996), (499, 4000)];
    bench.see(Silent, |bench| bench.pulse(3), line.map(|(at, pulse)| (at, Some(pulse))));

    bench.drive(Quantity::Pwm, 3, 16384 + 8000, 500);
    bench.until(Silent, 20, |bench| bench.bridge(3) != (0, true));
    let line = [(0, 16), (249, 4000), (499, 8000)];
    bench.see(Silent, |bench| bench.bridge(3), line.map(|(at, duty)| (at, (duty, true))));
}

#[test]
fn a_jammed_shaft_does_not_wind_the_integrator_up() {
    for integer in [0, 1, 5, 20] {
        // Jammed at the start, on the way, and just before the target.
        for jam_after in [0, 150, 400] {
            for mut bench in [Bench::new(), reversed(ShaftSensor::Encoder)] {
                let ki = Gain::Integral { integer, fraction: 0 };
                position_by(Sensor::Encoder, &mut bench);
                bench.configure(&[Parameter::Gain(WHEEL, Loop::Position, ki)]);
                bench.drive(Quantity::Position, 0, 6000, 0);
                bench.run_ms(10 + jam_after);
                bench.board.plant.borrow_mut().overrides.jam[0] = Some(true);
                bench.run_alive_ms(5000);
                let stuck = bench.position(0);
                assert!(stuck < 5990, "it must be jammed on the way: {stuck}");
                bench.board.plant.borrow_mut().overrides.jam[0] = None;
                let mut peak = 0;
                bench.run_alive_with(3000, |bench| peak = peak.max(bench.position(0)));
                assert!((5880..=6600).contains(&peak), "Ki {integer}, {jam_after} ms: {peak}");
            }
        }
    }
}

#[test]
fn a_wheel_that_was_jammed_finds_its_velocity_again() {
    let mut bench = Bench::new();
    bench.drive(Quantity::Velocity, 0, 2000, 0);
    bench.run_ms(500);
    bench.board.plant.borrow_mut().overrides.jam[0] = Some(true);
    bench.run_alive_ms(3000);
    assert!(bench.bridge(0).0 > 16_000, "it pushes for all it is worth");
    bench.board.plant.borrow_mut().overrides.jam[0] = None;
    bench.run_alive_ms(1000);
    let velocity = bench.velocity(0);
    assert!((1900.0..2100.0).contains(&velocity), "{velocity}");
}

#[test]
fn a_position_as_a_wheels_first_command_goes_by_its_encoder() {
    for target in [1000, 6000] {
        let mut bench = Bench::new();
        bench.drive(Quantity::Position, 0, target, 2000);
        bench.run_alive_with(1000, |bench| {
            let line = bench.velocity(0);
            assert!((-100.0..4000.0).contains(&line), "{line}");
        });
        bench.run_alive_ms(2000);
        let at = bench.position(0);
        assert!((at - i64::from(target)).abs() <= 20, "{target}: {at}");
    }
}

#[test]
fn joints_with_one_potentiometer_reach_their_angle_and_stop_at_its_ends() {
    for mut bench in [
        with_motor(MotorScene::with(ShaftSensor::Potentiometer)),
        reversed(ShaftSensor::Potentiometer),
    ] {
        // The method is implied by the DID; on channel 0 so would be the encoder.
        bench.configure(&[Parameter::Sensor(Channel::ALL[0], Sensor::SinglePotentiometer)]);
        for target in [100, 4000, 2048] {
            bench.drive(Quantity::Position, 0, target, 0);
            bench.run_alive_ms(2500);
            let at = bench.position(0);
            assert!((at - i64::from(target)).abs() <= 40, "{target}: {at}");
        }
    }
}

#[test]
fn a_joint_with_two_potentiometers_turns_all_the_way_round() {
    for mut bench in [
        with_motor(MotorScene::with(ShaftSensor::DualPotentiometer)),
        reversed(ShaftSensor::DualPotentiometer),
    ] {
        position_by(Sensor::DualPotentiometer, &mut bench);
        bench.run_ms(20);
        let start = bench.position(0);
        // Eight steps of 600 counts are more than one turn of 4428, through both dead zones.
        for step in 1..=8 {
            let target = (start + step * 600).rem_euclid(4428) as i16;
            bench.drive(Quantity::Position, 0, target, 200);
            bench.run_alive_with(700, |bench| {
                let off = bench.position(0) - start - step * 600;
                assert!((-700..=60).contains(&off), "step {step}: off by {off}");
            });
            let off = bench.position(0) - start - step * 600;
            assert!(off.abs() <= 40, "step {step}: off by {off}");
        }
    }
}

#[test]
fn a_potentiometer_has_a_velocity_loop_on_the_rate_of_its_angle() {
    let mut bench = with_motor(MotorScene::with(ShaftSensor::DualPotentiometer));
    bench.configure(&[Parameter::Sensor(WHEEL, Sensor::DualPotentiometer)]);
    bench.drive(Quantity::Velocity, 0, 500, 0);
    bench.run_alive_ms(1500);
    let start = bench.position(0);
    bench.run_alive_ms(20_000);
    let mean = (bench.position(0) - start) as f64 / 20.0;
    assert!((490.0..=510.0).contains(&mean), "over two turns: {mean}");
}

#[test]
fn a_suspended_move_is_dead_and_goes_on_where_it_was() {
    let mut bench = Bench::new();
    position_by(Sensor::Encoder, &mut bench);
    bench.drive(Quantity::Position, 0, 6000, 1000);
    bench.drive(Quantity::Servo, 1, 2000, 0);
    bench.drive(Quantity::Servo, 1, 4000, 1000);
    bench.run_ms(500);
    bench.send(Command::Run { scope: Scope::All, run: false });
    bench.run_alive_ms(1500);
    let resting = bench.position(0);
    bench.run_alive_with(1000, |bench| {
        assert_eq!((bench.bridge(0), bench.pulse(1)), ((0, false), None));
        assert_eq!(bench.position(0), resting);
    });
    assert!((2700..5000).contains(&resting), "{resting}");

    bench.send(Command::Run { scope: Scope::All, run: true });
    bench.run_alive_ms(100);
    assert!(bench.bridge(0).1, "enabled again");
    let pulse = bench.pulse(1).unwrap();
    assert!((3000..3300).contains(&pulse), "the servo goes on from half way: {pulse}");
    bench.run_alive_with(1000, |bench| {
        assert!((resting..6100).contains(&bench.position(0)), "no step back");
    });
    assert!((5900..=6100).contains(&bench.position(0)), "{}", bench.position(0));
    assert_eq!(bench.pulse(1), Some(4000));
}

/// The largest change of a bridge's duty from one period to the next during `ms`.
fn largest_bump(bench: &mut Bench, ms: u64) -> i16 {
    let (mut last, mut bump) = (bench.bridge(0).0, 0);
    bench.run_alive_with(ms, |bench| {
        let duty = bench.bridge(0).0;
        bump = bump.max((duty - last).abs());
        last = duty;
    });
    bump
}

#[test]
fn changes_of_method_sensor_and_polarity_do_not_bump_the_drive() {
    // At an eighth of full drive, at half, at all of it; with the default Kd and with large ones.
    for pwm in [2048, 8192, 16383] {
        for kd in [5, 50, 500] {
            let mut bench = Bench::new();
            bench.configure(&[
                Parameter::Sensor(WHEEL, Sensor::Encoder),
                Parameter::Gain(WHEEL, Loop::Position, Gain::Derivative(kd)),
                Parameter::Gain(WHEEL, Loop::Velocity, Gain::Derivative(kd)),
            ]);
            bench.drive(Quantity::Pwm, 0, 16384 + (pwm - 1), 0);
            bench.run_alive_ms(500);
            assert_eq!(bench.bridge(0), (pwm - 1, true));
            let mut bumps = 0;
            for change in [
                Parameter::Method(WHEEL, Method::Velocity),
                Parameter::Method(WHEEL, Method::Position),
                Parameter::Method(WHEEL, Method::Pwm),
                Parameter::Polarity(WHEEL, Polarity::Negative),
                Parameter::Polarity(WHEEL, Polarity::Positive),
                Parameter::Method(WHEEL, Method::Velocity),
                Parameter::Sensor(WHEEL, Sensor::SinglePotentiometer),
            ] {
                bench.configure(&[change]);
                let bump = largest_bump(&mut bench, 5);
                // A whole crossing from full drive to full drive takes 64 periods of 512.
                assert!(bump <= 600, "{pwm}, Kd {kd}, {change:?}: {bump} of 16384");
                bumps += u32::from(bump > 0);
            }
            assert!(bumps >= 3, "{pwm}, Kd {kd}: nothing is driven");
        }
    }
}

#[test]
fn a_loop_that_is_taken_over_keeps_the_speed_it_finds() {
    let mut bench = Bench::new();
    bench.configure(&[Parameter::Sensor(WHEEL, Sensor::Encoder)]);
    bench.drive(Quantity::Pwm, 0, 16384 + 4096, 0);
    bench.run_alive_ms(500);
    let before = bench.velocity(0);
    bench.configure(&[Parameter::Method(WHEEL, Method::Velocity)]);
    bench.run_alive_ms(500);
    let after = bench.velocity(0);
    assert!(before > 3000.0 && (after - before).abs() < 0.03 * before, "{before}, {after}");
}

#[test]
fn the_same_script_gives_the_same_outputs_to_the_bit() {
    let run = || {
        let mut bench = Bench::new();
        let mut outputs = Vec::new();
        position_by(Sensor::Encoder, &mut bench);
        bench.drive(Quantity::Position, 0, 6000, 300);
        bench.drive(Quantity::Velocity, 1, -1500, 0);
        bench.drive(Quantity::Position, 2, 3000, 100);
        for _ in 0..1000 {
            bench.board.run_for(Duration::from_millis(1));
            outputs.push(bench.board.plant.borrow().outputs);
        }
        for motor in 0..3 {
            let driven = outputs.iter().filter(|o| o.motors[motor].duty.raw() != 0).count();
            assert!(driven > 500, "motor {motor}: {driven}");
        }
        outputs
    };
    assert_eq!(run(), run());
}
