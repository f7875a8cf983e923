//! Every threshold and every time of a fault is a setting: each is moved, and the fault moves with it.

use super::*;

/// What goes wrong.
type Cause = fn(&mut Bench);

/// With these settings, which fault this cause trips within `most` ms, and after how many.
fn trips(settings: &[(u16, i32)], cause: Cause, most: u64) -> Option<(Fault, u64)> {
    let mut make = Make::default();
    settings.iter().for_each(|&(number, value)| make.settings.set(number, value).unwrap());
    make.settings.check().unwrap();
    // Where a wheel is reversed, a cause drives the second.
    make.scene.motors[1] = MotorScene { reversed: true, ..MotorScene::with(ShaftSensor::Encoder) };
    let mut bench = Bench::with(make);
    cause(&mut bench);
    let after = bench.until_or(Alive, most, |bench| !latched(bench).is_empty())?;
    Some((latched(&bench)[0].0, after))
}

/// What trips with the defaults and what with this setting: nothing, or a fault within these ms.
struct Case {
    number: u16,
    value: i32,
    cause: Cause,
    before: Option<(Fault, [u64; 2])>,
    after: Option<(Fault, [u64; 2])>,
}

fn spinning(bench: &mut Bench) {
    bench.configure(&[Parameter::Sensor(WHEEL, Sensor::Encoder)]);
    bench.drive(Quantity::Pwm, 0, 16384 + 6000, 0);
    bench.run_alive_ms(500);
}

fn current<const AD: u16>(bench: &mut Bench) {
    spinning(bench);
    change(bench, |all| all.currents[0] = Some(AD));
}

fn jammed(bench: &mut Bench) {
    bench.drive(Quantity::Velocity, 0, 4000, 0);
    bench.run_alive_ms(500);
    change(bench, |all| all.jam[0] = Some(true));
}

/// A joint that is held so far off its set-point.
fn joint_jammed<const ERROR: i16>(bench: &mut Bench) {
    change(bench, |all| all.jam[JOINT] = Some(true));
    bench.drive(Quantity::Position, JOINT, 2048 + ERROR, 0);
}

/// A loop that drives 15 % and sees nothing move.
fn no_encoder(bench: &mut Bench) {
    change(bench, |all| all.encoders[0] = Some(0));
    bench.drive(Quantity::Position, 0, 100, 0);
}

fn encoder_pulled(bench: &mut Bench) {
    bench.drive(Quantity::Velocity, 0, 2000, 0);
    bench.run_alive_ms(1000);
    let stays = bench.position(0) as u16;
    change(bench, |all| all.encoders[0] = Some(stays));
}

fn potentiometer_stuck<const AD: u16>(bench: &mut Bench) {
    change(bench, |all| all.potentiometers[JOINT] = Some(AD));
    bench.drive(Quantity::Position, JOINT, 3000, 0);
}

fn holding(bench: &mut Bench) {
    bench.drive(Quantity::Position, JOINT, 2500, 0);
    bench.run_alive_ms(1500);
}

fn wire_off(bench: &mut Bench) {
    holding(bench);
    change(bench, |all| all.potentiometers[JOINT] = Some(4095));
}

fn jumped_by_100(bench: &mut Bench) {
    holding(bench);
    let at = bench.position(JOINT) as u16 + 100;
    change(bench, |all| all.potentiometers[JOINT] = Some(at));
}

fn runaway_velocity(bench: &mut Bench) {
    bench.drive(Quantity::Velocity, 1, 4000, 0);
}

fn runaway_position(bench: &mut Bench) {
    bench.configure(&[Parameter::Sensor(Channel::ALL[1], Sensor::Encoder)]);
    bench.drive(Quantity::Position, 1, 4000, 0);
}

fn hunting(bench: &mut Bench) {
    bench.configure(&[
        Parameter::Sensor(WHEEL, Sensor::Encoder),
        Parameter::Gain(WHEEL, Loop::Velocity, Gain::Proportional(65_535)),
    ]);
    bench.drive(Quantity::Velocity, 0, 6000, 0);
}

fn battery<const WHICH: usize, const AD: u16>(bench: &mut Bench) {
    change(bench, |all| all.battery[WHICH] = Some(AD));
}

fn driver<const AD: u16>(bench: &mut Bench) {
    change(bench, |all| all.overheat[0] = Some(AD));
}

fn ambient<const AD: u16>(bench: &mut Bench) {
    change(bench, |all| all.temperature = Some(AD));
}

/// 80 periods, each of which begins a period late.
fn late(bench: &mut Bench) {
    for _ in 0..80 {
        clock::advance_to(Instant::now() + Duration::from_micros(2100));
        bench.run_ms(0);
        bench.board.run_until(Instant::from_millis(Instant::now().as_millis()));
    }
}

#[test]
fn every_threshold_and_time_moves_its_fault_and_0_ends_it_where_that_is_said() {
    use Fault::*;
    let case = |number, value, cause, before, after| Case { number, value, cause, before, after };
    let two_seconds = Some((OverCurrent, [1998, 2003]));
    let stall = Some((Stall, [5990, 6060]));
    let lost = Some((SensorLost, [600, 900]));
    let astray = Some((TrackingError, [200, 260]));
    let hunts = Some((TrackingError, [1990, 2200]));
    let silent = Some((SensorLost, [1990, 2200]));
    let hot = Some((Overload, [4700, 5700]));
    let second = |fault| Some((fault, [990, 1040]));
    // A joint that runs off behind its potentiometer stalls at the end of its way.
    let cases = [
        case(48, 3800, current::<3700>, two_seconds, hot),
        case(48, 3500, current::<3600>, hot, two_seconds),
        case(48, 0, current::<3700>, two_seconds, hot),
        case(49, 500, current::<3700>, two_seconds, Some((OverCurrent, [498, 503]))),
        case(49, 0, current::<3700>, two_seconds, None),
        case(50, 2000, no_encoder, silent, Some((SensorLost, [500, 620]))),
        case(51, 4095, jammed, stall, Some((SensorLost, [490, 560]))),
        case(52, 1000, jammed, stall, Some((Stall, [990, 1060]))),
        case(52, 0, jammed, stall, None),
        case(53, 1500, encoder_pulled, lost, Some((SensorLost, [1600, 1900]))),
        case(53, 0, encoder_pulled, lost, Some((SensorLost, [1990, 2300]))),
        case(
            54,
            400,
            potentiometer_stuck::<4>,
            Some((SensorLost, [240, 280])),
            Some((SensorLost, [390, 430])),
        ),
        case(
            54,
            0,
            potentiometer_stuck::<4>,
            Some((SensorLost, [240, 280])),
            Some((Stall, [6400, 6700])),
        ),
        case(55, 64, jumped_by_100, silent, Some((SensorLost, [18, 22]))),
        case(55, 0, wire_off, Some((SensorLost, [18, 22])), Some((SensorLost, [240, 300]))),
        case(58, 3000, hunting, hunts, Some((TrackingError, [3490, 3700]))),
        case(58, 0, hunting, hunts, None),
        case(59, 100, wire_off, Some((SensorLost, [18, 22])), Some((SensorLost, [98, 102]))),
        case(60, 0, hunting, hunts, None),
        case(
            62,
            64,
            potentiometer_stuck::<30>,
            Some((SensorLost, [490, 530])),
            Some((SensorLost, [240, 280])),
        ),
        case(76, 500, runaway_velocity, astray, Some((TrackingError, [500, 620]))),
        case(76, 0, runaway_velocity, astray, None),
        case(76, 500, runaway_position, astray, Some((TrackingError, [500, 620]))),
        case(77, 3000, no_encoder, silent, None),
        case(77, 0, holding, None, None),
        case(78, 50, joint_jammed::<120>, None, stall),
        case(78, 400, joint_jammed::<200>, stall, None),
        case(79, 1000, no_encoder, silent, Some((SensorLost, [990, 1200]))),
        case(79, 0, no_encoder, silent, None),
        case(92, 0, current::<3600>, hot, None),
        case(92, 1000, current::<2000>, None, Some((Overload, [5000, 6000]))),
        case(93, 1, current::<2000>, None, Some((Overload, [13_000, 15_000]))),
        case(64, 1000, battery::<1, 900>, None, second(MotorBatteryLow)),
        case(64, 0, battery::<1, 800>, second(MotorBatteryLow), None),
        case(65, 2560, battery::<1, 2600>, None, second(MotorBatteryHigh)),
        case(66, 2000, battery::<2, 1900>, None, second(ServoBatteryLow)),
        case(66, 0, battery::<2, 1700>, second(ServoBatteryLow), None),
        case(67, 2100, battery::<0, 2050>, None, second(MainBatteryLow)),
        case(67, 0, battery::<0, 1900>, second(MainBatteryLow), None),
        case(68, 1200, driver::<1150>, None, second(DriverTooHot)),
        case(68, 0, driver::<1000>, second(DriverTooHot), None),
        case(69, 3600, ambient::<3650>, None, second(AmbientTooHot)),
        case(69, 0, ambient::<3700>, second(AmbientTooHot), None),
        case(70, 300, driver::<1000>, second(DriverTooHot), Some((DriverTooHot, [290, 340]))),
        case(71, 50, late, None, Some((PeriodMissed, [0, 0]))),
        case(72, 100, battery::<1, 150>, None, second(MotorBatteryLow)),
        case(73, 300, battery::<2, 400>, None, second(ServoBatteryLow)),
        case(73, 300, battery::<0, 400>, None, second(MainBatteryLow)),
        case(74, 300, driver::<350>, None, second(DriverTooHot)),
        case(75, 4090, ambient::<4060>, None, second(AmbientTooHot)),
    ];
    let mut wrong = Vec::new();
    let mut check = |settings: &[(u16, i32)], case: &Case, expected: Option<(Fault, [u64; 2])>| {
        let most = expected.map_or(7000, |(_, [_, latest])| latest + 100);
        let is = trips(settings, case.cause, most);
        let as_expected = match (is, expected) {
            (Some((fault, at)), Some((wanted, [soonest, latest]))) => {
                fault == wanted && (soonest..=latest).contains(&at)
            }
            (is, expected) => is.is_none() && expected.is_none(),
        };
        if !as_expected {
            wrong.push(format!("{} with {settings:?}: {is:?}", case.number));
        }
    };
    for case in &cases {
        check(&[], case, case.before);
        check(&[(case.number, case.value)], case, case.after);
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
    // 61 has its own test.
    let mut numbers: Vec<_> = cases.iter().map(|case| case.number).chain([61]).collect();
    numbers.dedup();
    numbers.sort();
    let of_faults = Settings::DEFAULT.iter().map(|(number, _)| number);
    let is_of_faults = |number: &u16| (48..80).contains(number) || (92..94).contains(number);
    let mut of_faults: Vec<_> = of_faults.filter(is_of_faults).collect();
    of_faults.sort();
    assert_eq!(numbers, of_faults, "none is left out");
}

#[test]
fn a_sensor_that_only_trembles_is_silent_by_as_much_as_the_setting_says() {
    for (still, is_lost) in [(8, false), (32, true)] {
        let mut make = Make { scene: Scene::default(), ..Make::default() };
        make.settings.control.channel_faults.still = still;
        let mut bench = Bench::with(make);
        encoder_pulled(&mut bench);
        let at = bench.position(0) as u16;
        for k in 0..200 {
            change(&bench, |all| all.encoders[0] = Some(at + 16 * (k % 2)));
            bench.run_alive_ms(10);
        }
        let lost = latched(&bench).contains(&(Fault::SensorLost, Some(0)));
        assert_eq!(lost, is_lost, "still within {still} counts");
    }
}
