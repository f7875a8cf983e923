//! Servos that go, come back, or are new, and noise on their bus.

use hal_mock::cm5_board::Make;
use hal_mock::servo_bus::Faults;

use super::*;

fn walker() -> Bench {
    Bench::at_work(Make { servos: servos(1..=18), ..Make::default() })
}

#[test]
fn a_servo_that_goes_in_mid_cycle_is_stale_at_once_and_the_others_are_not() {
    let mut bench = walker();
    bench.run_alive_ms(500, goal(512));
    bench.said();
    // A cycle takes 7.6 ms.
    bench.board.run_for(Duration::from_micros(3210));
    bench.board.bus.bus().unplug(9);
    bench.run_ms(300);
    let reports = bench.reports();
    let stale_from = reports.iter().position(|report| report[9].is_none()).expect("stale");
    assert!(stale_from <= 2, "from report {stale_from} on");
    assert!((35..=45).contains(&reports.len()), "{}", reports.len());
    for report in &reports[stale_from..] {
        assert!((0..18).all(|servo| report[servo].is_some() == (servo != 9)), "{report:?}");
    }
    assert!((0..18).filter(|k| *k != 9).all(|k| bench.counters(k).time_outs == 0));
    let gone = bench.counters(9);
    // Eight strikes in 61 ms, then probes after 10, 20, 40 and 80 ms.
    assert!((12..=13).contains(&gone.time_outs) && gone.checksum_errors == 0, "{gone:?}");
    assert!(bench.board.bridge().servos().nth(9).unwrap().is_missing());
}

#[test]
fn a_missing_servo_costs_less_than_half_a_millisecond_a_cycle_from_the_first_second_on() {
    // What one servo takes: 244 us, and 170 us of the SYNC_WRITEs; with the watch's share, 0.43 ms.
    for return_delay in [1, 254] {
        let mut bench = walker();
        bench.answer(return_delay, &[limits(0, 1023)]);
        bench.run_ms(300);
        bench.run_alive_ms(500, goal(512));
        let delay_ms = 0.002 * f64::from(return_delay);
        let one = (0.244 + 0.170 + delay_ms) * 1.04;
        let before = 1000.0 / bench.rate(5000);
        bench.board.bus.bus().unplug(9);
        let first_second = 1000.0 / bench.rate(1000);
        assert!(first_second < before - one + 0.5, "{first_second} after {before}");
        let later = 1000.0 / bench.rate(5000);
        assert!((later - (before - one)).abs() < 0.1, "{later} after {before}");
    }
}

#[test]
fn a_servo_that_hears_but_does_not_answer_is_stopped() {
    for count in [1, 6] {
        let mut bench = Bench::new(servos(1..=count));
        bench.run_ms(1500);
        // The first turns endlessly, the others are joints.
        let all: Vec<_> = (0..count).map(|k| limits(0, if k == 0 { 0 } else { 1023 })).collect();
        bench.answer(1, &all);
        bench.agreed = all.len();
        bench.run_ms(300);
        bench.run_alive_ms(500, goal(512));
        for servo in 0..all.len() {
            bench.board.bus.bus().servo(servo).set(Register::STATUS_RETURN_LEVEL, 0);
        }
        bench.run_alive_ms(500, goal(512));
        assert_eq!(
            (bench.goal_of(0).get(Register::TORQUE_ENABLE), bench.register(0, Register::MOVING)),
            (0, 0)
        );
        assert!((1..all.len()).all(|joint| bench.goal_of(joint) == goal(512)), "they hold");
        bench.run_alive_ms(100, goal(512).with(Register::TORQUE_ENABLE, 0));
        assert!((0..all.len()).all(|servo| bench.goal_of(servo).get(Register::TORQUE_ENABLE) == 0));
    }
}

#[test]
fn what_has_never_answered_a_read_is_stopped_by_silence() {
    let mut all = servos([1]);
    all[0].write(Register::CW_LIMIT.address, &[0; 4]).unwrap();
    all[0].set(Register::TORQUE_ENABLE, 1);
    all[0].set(Register::MOVING_SPEED, 300);
    all[0].set(Register::STATUS_RETURN_LEVEL, 0);
    let mut bench = Bench::new(all);
    bench.run_ms(1500);
    assert_eq!(bench.register(0, Register::MOVING), 1);
    bench.run_ms(300);
    assert_eq!(bench.register(0, Register::MOVING), 0);
}

#[test]
fn a_servo_that_is_back_takes_part_within_five_seconds_and_the_pc_hears_a_hello() {
    let mut bench = walker();
    bench.run_alive_ms(500, goal(600));
    bench.board.bus.bus().unplug(4);
    bench.run_alive_ms(3000, goal(600));
    assert!(bench.hellos().is_empty(), "a servo that is gone is no news but stale");
    // Meanwhile somebody has played with it.
    bench.board.bus.bus().servo(4).set(Register::RETURN_DELAY, 250);
    bench.board.bus.bus().servo(4).set(Register::CCW_LIMIT, 333);
    bench.board.bus.bus().plug(4);
    bench.run_alive_ms(700, goal(600));
    assert_eq!((bench.setup(4), bench.goal_of(4)), ([1, 0, 1023], goal(600)));
    assert_eq!(bench.counters(4).returns, 1);
    let said = bench.said();
    let hello: Vec<u8> = (1..=18).collect();
    assert!(said.iter().any(|(_, said)| *said == Said::Hello(hello.clone())));
    let Some((_, Said::Report(last))) = said.last() else { panic!("no report") };
    assert!(last.iter().all(Option::is_some));

    // Said every 10 s until answered; goals go on meanwhile.
    bench.run_alive_ms(30_000, goal(600));
    assert_eq!(bench.hellos().len(), 3);
    bench.answer(1, &[limits(0, 1023)]);
    bench.run_alive_ms(12_000, goal(600));
    assert!(bench.hellos().is_empty());
}

#[test]
fn a_servo_that_is_back_while_the_pc_is_silent_waits_for_a_goal() {
    let mut bench = Bench::at_work(Make { servos: servos([1, 2]), ..Make::default() });
    bench.run_alive_ms(2000, goal(900));
    bench.run_ms(2000);
    bench.board.bus.bus().unplug(1);
    bench.run_ms(2000);
    bench.board.bus.bus().plug(1);
    bench.run_ms(2000);
    assert_eq!(bench.counters(1).returns, 1);
    assert_eq!((bench.goal_of(0), bench.goal_of(1).get(Register::TORQUE_ENABLE)), (goal(900), 0));
    bench.send_goal(goal(400));
    bench.run_ms(10);
    assert_eq!([bench.goal_of(0), bench.goal_of(1)], [goal(400); 2]);
}

#[test]
fn servos_that_come_back_together_are_told_together() {
    let mut bench = walker();
    (0..18).for_each(|servo| bench.board.bus.bus().unplug(servo));
    bench.run_alive_ms(1000, goal(600));
    (0..18).for_each(|servo| bench.board.bus.bus().plug(servo));
    bench.run_alive_ms(1000, goal(600));
    let hellos = bench.hellos();
    assert!((1..=5).contains(&hellos.len()), "{}", hellos.len());
    let apart = hellos.windows(2).map(|pair| (pair[1].0 - pair[0].0).as_millis());
    assert!(apart.min() >= Some(195) || hellos.len() == 1, "hellos follow each other too closely");
    assert_eq!(bench.counters(17).returns, 1);
}

#[test]
fn with_all_servos_gone_the_pc_still_hears_and_all_come_back() {
    let mut bench = walker();
    bench.run_alive_ms(500, goal(600));
    (0..18).for_each(|servo| bench.board.bus.bus().unplug(servo));
    bench.run_alive_ms(1000, goal(600));
    bench.said();
    bench.run_alive_ms(1000, goal(600));
    let reports = bench.reports();
    assert!(reports.len() > 50 && reports.iter().flatten().all(Option::is_none));
    (0..18).for_each(|servo| bench.board.bus.bus().plug(servo));
    bench.run_alive_ms(1000, goal(600));
    assert!((0..18).all(|servo| bench.goal_of(servo) == goal(600)));
    assert!(bench.reports().last().unwrap().iter().all(Option::is_some));
    assert!((0..18).all(|servo| bench.counters(servo).returns == 1));
}

#[test]
fn a_new_servo_is_told_of_within_five_seconds_and_joins_when_the_pc_answers() {
    // From 97 to 109 are the worst: the watch has just passed them when the servo is plugged in.
    for id in [1, 253].into_iter().chain(97..=109) {
        let mut all = servos([2, 3, 4]);
        all.push(Ax12::new(id));
        let mut bench = Bench::with(Make { servos: all, ..Make::default() });
        bench.board.bus.bus().unplug(3);
        bench.run_ms(1500);
        bench.answer(1, &[limits(0, 1023)]);
        bench.agreed = 3;
        bench.run_alive_ms(1000, goal(400));
        assert_eq!(bench.hellos().len(), 1);

        bench.board.bus.bus().plug(3);
        bench.run_alive_ms(5000, goal(400));
        let mut ids = vec![2, 3, 4, id];
        ids.sort();
        let hellos = bench.hellos();
        assert!(!hellos.is_empty() && hellos.iter().all(|(_, hello)| *hello == ids), "{id}");
        assert_eq!(bench.board.bridge().counters().newcomers, 1);
        // The others have gone on, and it has not been touched.
        assert_eq!(
            (bench.goal_of(0), bench.goal_of(3).get(Register::TORQUE_ENABLE)),
            (goal(400), 0)
        );
        assert_eq!(bench.setup(3), [250, 0, 1023]);

        bench.answer(1, &[limits(100, 900)]);
        bench.agreed = 4;
        bench.run_ms(60);
        bench.board.line.host_receives();
        while bench.board.line.host_receives().is_some() {}
        bench.send_goal(goal(500));
        bench.run_ms(20);
        assert_eq!((bench.goal_of(0), bench.goal_of(3)), (goal(500), goal(500)));
        assert_eq!(bench.setup(3), [1, 100, 900]);
        assert!(bench.reports().last().unwrap().iter().all(Option::is_some));
    }
}

#[test]
fn a_late_answer_to_an_older_hello_is_refused_unless_it_is_the_short_form() {
    let fresh = || {
        let mut bench = Bench::new(servos([1, 2, 3]));
        bench.board.bus.bus().unplug(2);
        bench.run_ms(1000);
        assert_eq!(bench.hellos()[0].1, [1, 2]);
        bench.board.bus.bus().plug(2);
        bench.run_ms(5000);
        assert_eq!(bench.hellos().last().unwrap().1, [1, 2, 3]);
        bench
    };
    let mut bench = fresh();
    bench.answer(1, &[limits(100, 900); 2]);
    bench.run_ms(50);
    let counters = bench.board.bridge().counters().pc;
    assert_eq!((counters.refused, counters.answers), (1, 0));
    assert!((0..3).all(|servo| bench.setup(servo) == [250, 0, 1023]));
    bench.answer(1, &[limits(100, 900); 3]);
    bench.run_ms(100);
    assert!((0..3).all(|servo| bench.setup(servo) == [1, 100, 900]));

    // One pair for all tells nothing of how many it was meant for.
    let mut bench = fresh();
    bench.answer(1, &[limits(100, 900)]);
    bench.run_ms(100);
    assert!((0..3).all(|servo| bench.setup(servo) == [1, 100, 900]));
}

#[test]
fn an_answer_that_is_as_long_as_goals_is_taken_for_an_answer() {
    // 11 servos, of which the PC has agreed on 3: 45 bytes. The first limits are good goals, too.
    let both = [limits(0x101, 0x101), limits(0, 1023), limits(0, 0), limits(100, 900)];
    for pair in both {
        let mut bench = Bench::new(servos(1..=11));
        (3..11).for_each(|servo| bench.board.bus.bus().unplug(servo));
        bench.run_ms(1500);
        bench.answer(1, &[limits(0, 1023)]);
        bench.agreed = 3;
        bench.run_alive_ms(1000, goal(512));
        (3..11).for_each(|servo| bench.board.bus.bus().plug(servo));
        bench.run_alive_ms(5000, goal(512));
        let before = bench.board.bridge().counters().pc;
        assert_eq!(before.answers, 1, "goals are no answer though they are as long");
        bench.answer(1, &[pair; 11]);
        bench.run_ms(300);
        let after = bench.board.bridge().counters().pc;
        assert_eq!((after.answers, after.goals, after.refused), (2, before.goals, 0), "{pair:?}");
        let limits = bench.setup(10);
        assert_eq!(limits[1..], bench.setup(0)[1..]);
        assert!(bench.board.bridge().servos().all(|servo| servo.is_agreed()));
    }
}

#[test]
fn a_board_without_servos_waits_for_the_first() {
    let mut bench = Bench::with(Make { servos: servos([9]), ..Make::default() });
    bench.board.bus.bus().unplug(0);
    bench.run_ms(1000);
    bench.send(&[1]); // the answer for no servo
    bench.run_ms(3000);
    assert_eq!(bench.board.bridge().counters().pc.answers, 1);
    bench.hellos();
    bench.board.bus.bus().plug(0);
    bench.run_ms(5000);
    assert!(bench.hellos().iter().any(|(_, ids)| *ids == [9]));
}

#[test]
fn a_glitch_costs_goals_for_about_as_long_as_it_lasts() {
    for (count, glitch_ms) in [(1, 10), (6, 30), (18, 80)] {
        let mut bench = Bench::at_work(Make { servos: servos(1..=count), ..Make::default() });
        bench.run_alive_ms(500, goal(512));
        let deaf = Faults { dropped_ppm: 1_000_000, ..Faults::default() };
        bench.board.bus.bus().set_faults(deaf);
        bench.run_ms(glitch_ms);
        bench.board.bus.bus().set_faults(Faults::default());
        bench.send_goal(goal(300));
        // A probe comes after as long again as the servo was missing, and 10 ms, at the latest.
        bench.run_ms(glitch_ms + 30);
        assert!((0..count.into()).all(|servo| bench.goal_of(servo) == goal(300)), "{count}");
    }
}

#[test]
fn noise_costs_single_answers_and_neither_servos_nor_hellos() {
    for seed in 1..=3 {
        let make = hal_mock::servo_bus::Make { seed, ..Default::default() };
        let mut bench =
            Bench::at_work(Make { servos: servos(1..=18), bus: make, ..Make::default() });
        let faults = Faults { dropped_ppm: 500, flipped_ppm: 500, stalled_ppm: 5000 };
        bench.board.bus.bus().set_faults(faults);
        bench.run_alive_ms(20_000, goal(512));
        let said = bench.said();
        let (mut heard, mut stale) = (0, 0);
        for (_, said) in said {
            let Said::Report(report) = said else { panic!("a hello without news") };
            heard += report.iter().flatten().count();
            stale += report.iter().filter(|servo| servo.is_none()).count();
        }
        // Of the 22 bytes of an exchange one is damaged in 2.2 % of them.
        let share = stale as f64 / (heard + stale) as f64;
        assert!((0.015..0.035).contains(&share), "{share}");
        let counters = bench.board.bridge().counters();
        assert_eq!((counters.newcomers, bench.board.bridge().servos().count()), (0, 18));
        let of_all = |count: fn(ServoCounters) -> u32| {
            (0..18).map(|k| count(bench.counters(k))).sum::<u32>()
        };
        assert!(of_all(|c| c.checksum_errors) > 100 && of_all(|c| c.time_outs) > 100);
        // 46,000 instructions; one flipped in its code, parameters or checksum is answered: 92.
        assert!((50..140).contains(&of_all(|c| c.error_replies)));
        assert_eq!(of_all(|c| c.returns), 0);
    }
}

#[test]
fn a_servo_in_trouble_is_heard_and_its_error_bits_are_kept() {
    let mut bench = walker();
    bench.board.bus.bus().servo(2).surroundings.supply_dv = 40;
    bench.run_alive_ms(200, goal(512));
    let counters = bench.counters(2);
    assert_eq!(counters.errors_seen, protocol::dynamixel::Errors::VOLTAGE);
    assert!(counters.error_replies > 10 && bench.counters(1).error_replies == 0);
    assert!(bench.reports().last().unwrap()[2].is_some());
    // 22 us, 2 us of return delay, 14 bytes.
    assert_eq!((counters.latency_us, bench.counters(1).latency_us), (164, 164));
}

#[test]
fn stalls_of_150_us_within_an_answer_are_borne() {
    let mut bench = walker();
    let faults = Faults { stalled_ppm: 1_000_000, ..Faults::default() };
    bench.board.bus.bus().set_faults(faults);
    bench.run_alive_ms(2000, goal(512));
    let counters: Vec<_> = (0..18).map(|servo| bench.counters(servo)).collect();
    assert!(counters.iter().all(|c| c.replies > 50 && c.time_outs + c.checksum_errors == 0));
    assert!(counters.iter().all(|c| (1000..2400).contains(&c.longest_latency_us)));
}

#[test]
fn the_shutdown_of_a_servo_is_not_undone_but_by_a_newer_goal() {
    let mut bench = Bench::at_work(Make { servos: servos([1, 2]), ..Make::default() });
    bench.run_alive_ms(500, goal(600));
    bench.board.bus.bus().servo(0).surroundings.temperature_c = 90;
    // Its own shutdown takes a millisecond, the answer that tells of it one cycle.
    bench.run_ms(10);
    for _ in 0..2000 {
        bench.board.run_for(Duration::from_micros(997));
        assert_eq!(bench.goal_of(0).get(Register::TORQUE_LIMIT), 0);
    }
    bench.board.bus.bus().servo(0).surroundings.temperature_c = 60;
    bench.run_ms(1000);
    let off = goal(600).with(Register::TORQUE_LIMIT, 0);
    assert_eq!([bench.goal_of(0), bench.goal_of(1)], [off, goal(600)]);
    // A PC may insist: a joint that is overloaded must be able to back off.
    bench.send_goal(goal(500));
    bench.run_ms(10);
    assert_eq!(bench.goal_of(0), goal(500));
}

#[test]
fn an_overload_shuts_a_servo_down_as_from_the_factory_and_goals_do_not_undo_it() {
    // Whatever of the cycle it comes in.
    for us in (0..2000).step_by(250) {
        let mut bench = Bench::at_work(Make { servos: servos([1, 2]), ..Make::default() });
        bench.run_alive_ms(500, goal(600));
        bench.board.run_for(Duration::from_micros(us));
        bench.board.bus.bus().servo(0).surroundings.jammed = true;
        bench.send_goal(goal(300));
        bench.run_ms(550);
        for _ in 0..500 {
            bench.run_ms(1);
            assert_eq!(bench.goal_of(0).get(Register::TORQUE_LIMIT), 0);
        }
        assert!(bench.counters(0).errors_seen.contains(protocol::dynamixel::Errors::OVERLOAD));
        assert_eq!(bench.goal_of(1), goal(300));
        bench.board.bus.bus().servo(0).surroundings.jammed = false;
        bench.send_goal(goal(300));
        bench.run_ms(1000);
        let position = bench.register(0, Register::PRESENT_POSITION);
        assert!((299..=301).contains(&position), "{position}");
    }
}
