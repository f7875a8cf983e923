//! Search, hello and setup: who is on the bus, and what the PC wants of them.

use embassy_time::Duration;
use firmware::bridge::{BridgeSettings, OnSilence};
use hal_mock::cm5_board::Make;
use hal_mock::servo_bus::Faults;
use protocol::cm5::Refusal;

use super::*;

/// When the first hello must have come. An ID without a servo takes 3 PINGs of 60 us and 718 us of
/// patience each, one with a servo as from the factory 2 PINGs of 60, 522 and 60 us and pauses.
fn search_ms(servos: u64) -> std::ops::RangeInclusive<u64> {
    let most = (253 - servos) * 3 * 780 + servos * 2 * 1000;
    let least = (253 - servos) * 3 * 770 + servos * 2 * 640;
    least / 1000..=most / 1000 + 2
}

#[test]
fn the_search_finds_exactly_the_servos_there_are() {
    let hundred: Vec<u8> = (0..100).map(|k| 2 + 5 * (k / 2) + k % 2).collect();
    for ids in [vec![], vec![1], vec![253], (1..=18).collect(), hundred] {
        let mut bench = Bench::new(servos(ids.clone()));
        bench.run_ms(1500);
        let hellos = bench.hellos();
        assert_eq!(hellos[0].1, ids);
        let took = hellos[0].0.as_millis();
        assert!(search_ms(ids.len() as u64).contains(&took), "{} in {took} ms", ids.len());
    }
}

#[test]
fn servos_beyond_the_hundredth_are_counted_and_left_alone() {
    let mut bench = Bench::new(servos(1..=103));
    bench.run_ms(8000);
    let hellos = bench.hellos();
    assert!((5..=8).contains(&hellos.len()), "one a second: {}", hellos.len());
    for (_, ids) in hellos {
        assert!(ids.into_iter().eq(1..=100));
    }
    assert_eq!(bench.board.bridge().counters().without_room, 3);
}

#[test]
fn the_search_finds_the_servos_through_noise() {
    // Every 200th byte lost or damaged, and stalls: an ID is given up after three failures.
    let ids = [1, 2, 40, 41, 100, 253];
    for seed in 1..=20 {
        let faults = Faults { dropped_ppm: 2000, flipped_ppm: 3000, stalled_ppm: 100_000 };
        let bus = hal_mock::servo_bus::Make { faults, seed, ..Default::default() };
        let mut bench = Bench::with(Make { servos: servos(ids), bus, ..Make::default() });
        bench.run_ms(1500);
        assert_eq!(bench.hellos()[0].1, ids, "seed {seed}");
    }
}

#[test]
fn two_servos_with_one_id_are_found_once_and_hide_no_other() {
    // The second answers half a millisecond after the first, into whatever is sent then.
    let mut twins = servos([5, 5, 6, 7]);
    twins[0].set(Register::RETURN_DELAY, 0);
    for servo in &mut twins[2..] {
        servo.set(Register::RETURN_DELAY, 0);
    }
    let mut bench = Bench::new(twins);
    bench.run_ms(1500);
    assert_eq!(bench.hellos()[0].1, [5, 6, 7]);
    let bus = bench.board.bridge().counters().bus;
    assert!(bus.collisions + bus.stray_bytes > 0, "{bus:?}");
}

#[test]
fn the_hello_is_said_once_a_second_until_it_is_answered() {
    let mut bench = Bench::new(servos([3, 4]));
    bench.run_ms(3900);
    let hellos = bench.hellos();
    let times: Vec<_> = hellos.iter().map(|(at, _)| *at).collect();
    assert_eq!(times.len(), 4, "at 0.6, 1.6, 2.6 and 3.6 s");
    for pair in times.windows(2) {
        assert_eq!(pair[1] - pair[0], Duration::from_secs(1));
    }
    assert!(hellos.iter().all(|(_, ids)| *ids == [3, 4]));

    // The answer is late, and good all the same.
    bench.answer(1, &[limits(0, 1023), limits(200, 800)]);
    bench.agreed = 2;
    bench.run_ms(900);
    assert_eq!([bench.setup(0), bench.setup(1)], [[1, 0, 1023], [1, 200, 800]]);
    assert!(bench.hellos().is_empty());
    // It does not fall silent as long as it says something.
    bench.run_alive_ms(2000, goal(512));
    assert!(bench.hellos().is_empty());
}

#[test]
fn a_wrong_answer_changes_nothing_and_is_counted() {
    let mut bench = Bench::new(servos([3, 4]));
    bench.run_ms(1000);
    bench.hellos();
    let wrong: [&[u8]; 7] = [
        &[],
        &[1],
        &[1, 0, 0, 0xFF],
        &[1, 0, 0, 0xFF, 3, 0, 0, 0xFF, 3, 0, 0, 0xFF, 3], // three servos
        &[255, 0, 0, 0xFF, 3, 0, 0, 0xFF, 3],
        &[1, 0, 0, 0xFF, 3, 0, 0, 0x00, 4],    // 1024
        &[1, 0, 0, 0xFF, 3, 0x01, 0, 0x00, 0], // CW above CCW
    ];
    for params in wrong {
        bench.send(params);
    }
    bench.send(&[0; 30]); // goals, before anything is agreed
    bench.run_ms(2000);
    assert_eq!(bench.board.bridge().counters().pc.refused, 8);
    assert_eq!([bench.setup(0), bench.setup(1)], [[250, 0, 1023]; 2]);
    assert_eq!(bench.counters(0).replies, 1, "its limits were read once");
    assert_eq!(bench.hellos().len(), 2, "it goes on");

    // A damaged one is not even that.
    let mut buffer = [0; MAX_PACKET];
    let packet = HelloAnswer::encode(1, &[limits(0, 1023)], &mut buffer).unwrap();
    packet[5] ^= 1;
    bench.board.line.host_sends(packet);
    bench.run_ms(200);
    let counters = bench.board.bridge().counters();
    assert_eq!(
        (counters.reception.bad_frames, counters.pc.refused, counters.pc.answers),
        (1, 8, 0)
    );
}

#[test]
fn registers_are_written_only_where_they_differ() {
    let mut all = servos([1, 2, 3, 4]);
    all[1].set(Register::RETURN_DELAY, 1);
    all[2].set(Register::RETURN_DELAY, 1);
    all[2].set(Register::CCW_LIMIT, 800);
    all[3].set(Register::CW_LIMIT, 100);
    all[3].set(Register::CCW_LIMIT, 100);
    let mut bench = Bench::new(all);
    bench.run_ms(1000);
    let wanted = [limits(0, 1023), limits(0, 1023), limits(0, 1023), limits(200, 800)];
    bench.answer(1, &wanted);
    bench.agreed = 4;
    bench.run_ms(400);
    for (servo, limits) in [[0, 1023], [0, 1023], [0, 1023], [200, 800]].into_iter().enumerate() {
        assert_eq!(bench.setup(servo), [1, limits[0], limits[1]]);
    }
    let written = |bench: &Bench| [0, 1, 2, 3].map(|servo| bench.counters(servo).eeprom_bytes);
    assert_eq!(written(&bench), [1, 0, 2, 5]);

    // The same answer again asks for nothing; another one for one limit.
    bench.answer(1, &wanted);
    bench.run_ms(400);
    assert_eq!(written(&bench), [1, 0, 2, 5]);
    assert_eq!(bench.board.bridge().counters().pc.answers, 2);
    bench.answer(1, &[limits(0, 1023), limits(0, 1000), limits(0, 1023), limits(200, 800)]);
    bench.run_ms(400);
    assert_eq!(written(&bench), [1, 2, 2, 5]);
    assert_eq!(bench.setup(1), [1, 0, 1000]);
}

#[test]
fn eighteen_servos_are_set_up_within_a_quarter_of_a_second() {
    let mut bench = Bench::new(servos(1..=18));
    bench.run_ms(1000);
    bench.answer(1, &[limits(10, 1000)]);
    bench.agreed = 18;
    bench.run_ms(250);
    for servo in 0..18 {
        assert_eq!(bench.setup(servo), [1, 10, 1000]);
    }
    bench.run_ms(50);
    bench.hellos();
    bench.run_ms(50);
    let reports = bench.reports();
    assert!(reports.len() > 4 && reports.iter().flatten().all(Option::is_some));
}

#[test]
fn the_first_report_comes_when_every_servo_has_been_read() {
    for (count, within_ms) in [(1, 60), (6, 80), (18, 120), (100, 600)] {
        for line_rate in [57_600, 1_000_000] {
            let mut bench =
                Bench::with(Make { servos: servos(1..=count), line_rate, ..Make::default() });
            bench.run_ms(1700);
            bench.answer(1, &[limits(10, 1000)]);
            bench.agreed = count.into();
            bench.run_ms(within_ms + if line_rate < 100_000 { 200 } else { 0 });
            let reports = bench.reports();
            assert!(!reports.is_empty(), "{count} servos at {line_rate} baud");
            assert!(reports.iter().flatten().all(Option::is_some), "{count} at {line_rate}");
        }
    }
}

#[test]
fn a_servo_that_cannot_be_read_holds_the_first_report_up_for_a_second_at_the_most() {
    // It is gone before the PC answers.
    let mut bench = Bench::new(servos([1, 2, 3]));
    bench.run_ms(1000);
    bench.board.bus.bus().unplug(1);
    bench.answer(1, &[limits(10, 1000)]);
    bench.agreed = 3;
    bench.run_ms(120);
    let first = bench.reports()[0].iter().map(Option::is_some).collect::<Vec<_>>();
    assert_eq!(first, [true, false, true]);

    // It does not take its limits.
    let mut bench = with_a_locked_servo();
    bench.run_ms(990);
    assert!(bench.reports().is_empty());
    bench.run_ms(30);
    assert!(bench.reports()[0][0].is_some());
}

/// Two servos at work, of which the second does not take the limits that it is told.
fn with_a_locked_servo() -> Bench {
    let mut all = servos([1, 2]);
    all[1].set(Register::LOCK, 1);
    let mut bench = Bench::new(all);
    bench.run_ms(1000);
    bench.answer(250, &[limits(0, 900)]);
    bench.agreed = 2;
    bench
}

#[test]
fn a_servo_that_does_not_take_its_limits_is_not_driven_and_its_eeprom_is_spared() {
    let mut bench = with_a_locked_servo();
    bench.run_ms(500);
    bench.said();
    bench.run_alive_ms(10_000, goal(600));
    assert_eq!((bench.goal_of(0), bench.goal_of(1).get(Register::TORQUE_ENABLE)), (goal(600), 0));
    assert_eq!(bench.setup(1), [250, 0, 1023]);
    let tried = bench.counters(1);
    assert_eq!(tried.eeprom_bytes, 12, "6 writes of a limit in all");
    assert!(tried.errors_seen.contains(protocol::dynamixel::Errors::RANGE));
    let reports = bench.reports();
    assert!(reports.len() > 1000, "{}", reports.len());
    assert!(reports.iter().all(|report| report[0].is_some() && report[1].is_none()));

    // The PC's insisting changes nothing.
    for _ in 0..10 {
        bench.answer(250, &[limits(0, 900)]);
        bench.run_alive_ms(1000, goal(600));
    }
    assert_eq!(bench.counters(1).eeprom_bytes, 12);

    // A loose contact buys two writes of a limit at each return.
    for returns in 1..=3 {
        bench.board.bus.bus().servo(1).set(Register::STATUS_RETURN_LEVEL, 0);
        bench.run_alive_ms(1000, goal(600));
        bench.board.bus.bus().servo(1).set(Register::STATUS_RETURN_LEVEL, 2);
        bench.run_alive_ms(1000, goal(600));
        assert_eq!(
            (bench.counters(1).returns, bench.counters(1).eeprom_bytes),
            (returns, 12 + 4 * returns)
        );
    }

    // Power-off unlocks it.
    bench.board.bus.bus().unplug(1);
    bench.run_alive_ms(1000, goal(600));
    bench.board.bus.bus().plug(1);
    bench.run_alive_ms(1000, goal(600));
    assert_eq!((bench.setup(1), bench.goal_of(1)), ([250, 0, 900], goal(600)));
}

#[test]
fn refusals_tell_what_is_wrong() {
    assert_eq!(
        HelloAnswer::parse(&[255, 0, 0, 0, 0], 1).unwrap_err().to_string(),
        "no servo has a return delay of 255"
    );
    assert_eq!(Refusal::Length(7).to_string(), "7 parameters are for another number of servos");
}

#[test]
fn what_turns_when_the_bridge_starts_stops_unless_a_pc_agrees_in_time() {
    let wheel_and_joint = || {
        let mut all = servos([1, 2]);
        all[0].write(Register::CW_LIMIT.address, &[0; 4]).unwrap();
        for servo in &mut all {
            servo.set(Register::TORQUE_ENABLE, 1);
            servo.set(Register::MOVING_SPEED, 300);
        }
        all
    };
    let driven =
        |bench: &Bench| [0, 1].map(|servo| bench.goal_of(servo).get(Register::TORQUE_ENABLE));
    for (on_silence, expected) in [(OnSilence::Freeze, [0, 1]), (OnSilence::TorqueOff, [0, 0])] {
        let settings = BridgeSettings { on_silence, ..BridgeSettings::DEFAULT };
        let mut bench =
            Bench::with(Make { servos: wheel_and_joint(), settings, ..Make::default() });
        // The search takes 0.6 s. Goals of a PC that has not agreed are refused: no sign of life.
        bench.agreed = 2;
        bench.run_alive_ms(1500, goal(512));
        assert_eq!(driven(&bench), [1, 1]);
        bench.run_alive_ms(200, goal(512));
        assert_eq!(driven(&bench), expected);
        bench.run_alive_ms(5000, goal(512));
        assert_eq!((driven(&bench), bench.register(0, Register::MOVING)), (expected, 0));
    }

    let mut bench = Bench::new(wheel_and_joint());
    bench.run_ms(1500);
    bench.answer(1, &[limits(0, 0), limits(0, 1023)]);
    bench.agreed = 2;
    bench.run_ms(950);
    assert_eq!(driven(&bench), [1, 1]);
    bench.run_alive_ms(2000, goal(300));
    assert_eq!([bench.goal_of(0), bench.goal_of(1)], [goal(300); 2]);
}
