//! The loop of work: goals reach the servos, reports the PC, and silence is noticed.

use firmware::bridge::{BridgeSettings, OnSilence};
use hal_mock::cm5_board::Make;
use hal_mock::servo_bus::Faults;

use super::*;

fn three() -> Bench {
    Bench::at_work(Make { servos: servos([1, 2, 3]), ..Make::default() })
}

#[test]
fn no_goal_is_sent_before_the_first_of_the_pc() {
    let mut bench = three();
    let untouched: Vec<_> = (0..3).map(|servo| bench.goal_of(servo)).collect();
    bench.board.bus.bus().servo(0).set(Register::GOAL_POSITION, 77);
    bench.run_ms(500);
    assert_eq!(bench.goal_of(0).get(Register::GOAL_POSITION), 77, "nothing overwrites it");
    assert_eq!(bench.goal_of(1), untouched[1]);
    assert_eq!(bench.goal_of(0).get(Register::TORQUE_ENABLE), 0);
}

#[test]
fn every_register_of_a_goal_reaches_its_servo_within_two_cycles_and_again_in_each() {
    let mut bench = three();
    let goals = [100, 500, 900].map(|position| {
        let values = [1, 1, 2, 3, 40, 50, position, position / 2, 1000 - position / 10, 0, 33];
        let fields = ServoGoal::REGISTERS.into_iter().zip(values);
        fields.fold(ServoGoal::default(), |goal, (register, value)| goal.with(register, value))
    });
    bench.send_goals(&goals);
    // 50 bytes take 0.5 ms, a cycle of three servos 1.4 ms, and a PING of the watch 0.7 ms.
    bench.run_ms(5);
    for (servo, goal) in goals.into_iter().enumerate() {
        assert_eq!(bench.goal_of(servo), goal);
    }
    // "Having these being updated or not": a servo that forgets is told again.
    bench.board.bus.bus().servo(1).set(Register::GOAL_POSITION, 1);
    bench.board.bus.bus().servo(1).set(Register::PUNCH, 1);
    bench.run_ms(4);
    assert_eq!(bench.goal_of(1), goals[1]);
}

#[test]
fn forty_servos_get_their_goals_in_several_packets() {
    let mut bench = Bench::at_work(Make { servos: servos(1..=40), ..Make::default() });
    let goals: Vec<_> = (0..40).map(|k| goal(20 * k)).collect();
    bench.send_goals(&goals);
    bench.run_ms(50);
    for (servo, goal) in goals.into_iter().enumerate() {
        assert_eq!(bench.goal_of(servo), goal, "servo {servo}");
    }
}

#[test]
fn goals_for_another_number_of_servos_change_nothing_and_are_counted() {
    let mut bench = three();
    bench.send_goal(goal(300));
    bench.run_ms(10);
    for count in [0, 1, 2, 4, 18] {
        bench.send_goals(&vec![goal(700); count]);
    }
    bench.send(&[1; 44]);
    bench.run_ms(100);
    let counters = bench.board.bridge().counters().pc;
    assert_eq!((counters.goals, counters.refused), (1, 6));
    assert!((0..3).all(|servo| bench.goal_of(servo) == goal(300)));
}

#[test]
fn a_goal_that_no_servo_takes_changes_nothing_and_does_not_keep_it_from_stopping() {
    let mut bench = Bench::new(servos([1]));
    bench.agree(1000, &[limits(0, 0)], 1);
    bench.run_alive_ms(500, goal(512));
    bench.send_goal(goal(0).with(Register::CW_SLOPE, 255).with(Register::CCW_SLOPE, 255));
    bench.run_ms(50);
    assert_eq!((bench.goal_of(0), bench.register(0, Register::MOVING)), (goal(512), 1));
    assert_eq!(bench.board.bridge().counters().pc.refused, 1);
    bench.run_ms(1500);
    assert_eq!(bench.register(0, Register::MOVING), 0);
}

#[test]
fn a_report_a_cycle_tells_the_registers_36_to_43_of_each_servo() {
    let mut bench = three();
    bench.board.bus.bus().servo(1).surroundings.temperature_c = 44;
    bench.board.bus.bus().servo(1).surroundings.supply_dv = 111;
    bench.run_alive_ms(2500, goal(700));
    bench.said();
    let before = bench.board.bridge().counters();
    bench.run_ms(500);
    let after = bench.board.bridge().counters();
    let cycles = after.cycles - before.cycles;
    let reports = bench.reports();
    assert!((cycles - 1..=cycles + 1).contains(&(reports.len() as u32)), "{cycles}");
    let feedback = reports.last().unwrap()[1].unwrap();
    assert_eq!(
        (feedback.get(Register::PRESENT_TEMPERATURE), feedback.get(Register::PRESENT_VOLTAGE)),
        (44, 111)
    );
    let position = bench.register(1, Register::PRESENT_POSITION);
    assert_eq!(feedback.get(Register::PRESENT_POSITION), position);
    assert!((698..=702).contains(&position), "it has arrived at {position}");
    assert_eq!(after.pc.reports_skipped, before.pc.reports_skipped);
}

#[test]
fn a_slow_line_costs_reports_and_not_a_cycle() {
    let make = |line_rate| Make { servos: servos(1..=18), line_rate, ..Make::default() };
    let fast = Bench::at_work(make(1_000_000)).rate(5000);
    let mut bench = Bench::at_work(make(57_600));
    let slow = bench.rate(5000);
    assert!((slow / fast - 1.0).abs() < 0.01, "{slow} {fast}");
    // 149 bytes take 25.87 ms: 193 of them in 5 s.
    let reports = bench.reports().len();
    assert!((191..=194).contains(&reports), "{reports}");
    assert!(bench.board.bridge().counters().pc.reports_skipped > 400);
}

#[test]
fn lock_is_passed_on_only_if_a_setting_says_so() {
    for pass_lock in [false, true] {
        let settings = BridgeSettings { pass_lock, ..BridgeSettings::DEFAULT };
        let mut bench = Bench::at_work(Make { servos: servos([1]), settings, ..Make::default() });
        bench.send_goal(goal(512).with(Register::LOCK, 1));
        bench.run_ms(20);
        assert_eq!(bench.register(0, Register::LOCK), u16::from(pass_lock));
    }
}

#[test]
fn when_the_pc_is_silent_goals_and_torque_stay_and_a_hello_comes_every_ten_seconds() {
    let mut bench = three();
    bench.send_goal(goal(900).with(Register::MOVING_SPEED, 20));
    bench.run_ms(990);
    assert!(!bench.board.bridge().pc_is_silent() && bench.hellos().is_empty());
    bench.run_ms(20);
    assert!(bench.board.bridge().pc_is_silent());
    bench.run_ms(31_000);
    assert_eq!(bench.goal_of(1), goal(900).with(Register::MOVING_SPEED, 20));
    let hellos = bench.hellos();
    assert_eq!(hellos.len(), 3, "at 11, 21 and 31 s");
    assert!(hellos.iter().all(|(_, ids)| *ids == [1, 2, 3]));
    assert_eq!(bench.board.bridge().counters().pc.silences, 1);
    // A servo that loses its goal is still told what it was.
    bench.board.bus.bus().servo(1).set(Register::TORQUE_ENABLE, 0);
    bench.run_ms(5);
    assert_eq!(bench.goal_of(1).get(Register::TORQUE_ENABLE), 1);

    bench.send_goal(goal(100));
    bench.run_ms(10);
    assert!(!bench.board.bridge().pc_is_silent());
    assert_eq!(bench.goal_of(1), goal(100));
    bench.hellos();
    bench.run_alive_ms(12_000, goal(100));
    assert!(bench.hellos().is_empty());
}

#[test]
fn a_pc_that_only_listens_hears_reports_and_as_many_hellos_as_a_setting_says() {
    for (hello_period_s, ms, hellos) in [(10, 35_000, 3), (1, 5000, 4), (0, 15_000, 0)] {
        let settings = BridgeSettings { hello_period_s, ..BridgeSettings::DEFAULT };
        let all = servos([1, 2, 3]);
        let mut bench = Bench::at_work(Make { servos: all, settings, ..Make::default() });
        bench.run_ms(ms);
        let said = bench.said();
        let times = said.iter().filter(|(_, said)| matches!(said, Said::Hello(_)));
        let times: Vec<_> = times.map(|(at, _)| at.as_millis()).collect();
        assert_eq!(times.len(), hellos, "{times:?}");
        let period = 1000 * u64::from(hello_period_s);
        assert!(times.windows(2).all(|pair| (period..period + 5).contains(&(pair[1] - pair[0]))));
        assert!(said.len() as u64 > ms / 2, "the reports go on: {}", said.len());
        // A servo that comes back is told of at once, whatever the setting.
        bench.board.bus.bus().unplug(1);
        bench.run_ms(1000);
        bench.hellos();
        bench.board.bus.bus().plug(1);
        bench.run_ms(700);
        assert_eq!(bench.hellos().first().map(|(_, ids)| ids.clone()), Some(vec![1, 2, 3]));
    }
}

#[test]
fn what_turns_endlessly_is_stopped_when_the_pc_is_silent() {
    let mut bench = Bench::new(servos([1, 2]));
    bench.agree(1000, &[limits(0, 0), limits(0, 1023)], 2);
    bench.run_alive_ms(500, goal(512));
    let stopped = goal(512).with(Register::TORQUE_ENABLE, 0);
    bench.see(Silent, |bench| bench.goal_of(0), [(0, goal(512)), (940, goal(512)), (970, stopped)]);
    assert_eq!(bench.goal_of(1), goal(512));
}

/// A PC that gave `before` goals, and another one that answers with limits and sends nothing.
fn after_a_change_of_mode(before: Limits, after: Limits) -> Bench {
    let mut bench = Bench::new(servos([1]));
    bench.agree(1000, &[before], 1);
    bench.run_alive_ms(500, goal(0).with(Register::MOVING_SPEED, 300));
    bench.run_ms(200);
    bench.answer(1, &[after]);
    bench
}

#[test]
fn a_servo_whose_mode_is_changed_does_not_move_before_its_next_goal() {
    let (wheel, joint) = (limits(0, 0), limits(0, 1023));
    for (before, after, next) in [(wheel, joint, goal(800)), (joint, wheel, goal(0))] {
        let mut bench = after_a_change_of_mode(before, after);
        bench.run_ms(50);
        assert_eq!(bench.goal_of(0).get(Register::TORQUE_ENABLE), 0, "{after:?}");
        let rests = bench.board.bus.bus().servo(0).position();
        for _ in 0..100 {
            bench.run_ms(9);
            assert_eq!(bench.goal_of(0).get(Register::TORQUE_ENABLE), 0, "{after:?}");
        }
        assert_eq!(bench.board.bus.bus().servo(0).position(), rests, "{after:?}");
        bench.send_goal(next);
        bench.run_ms(10);
        assert_eq!(bench.goal_of(0), next);
        bench.run_ms(100);
        assert_ne!(bench.board.bus.bus().servo(0).position(), rests, "{after:?}");
    }
}

#[test]
fn limits_that_leave_a_joint_a_joint_do_not_let_it_go_limp() {
    let mut bench = after_a_change_of_mode(limits(0, 1023), limits(100, 900));
    for _ in 0..100 {
        bench.run_ms(3);
        assert_eq!(bench.goal_of(0).get(Register::TORQUE_ENABLE), 1);
    }
    assert_eq!(bench.setup(0), [1, 100, 900]);
}

#[test]
fn no_limits_are_written_to_the_other_mode_before_the_torque_is_off() {
    // What the bridge found turning, as somebody else had left it.
    for lost in [false, true] {
        let mut all = servos([1]);
        all[0].write(Register::CW_LIMIT.address, &[0; 4]).unwrap();
        all[0].set(Register::TORQUE_ENABLE, 1);
        all[0].set(Register::MOVING_SPEED, 300);
        let mut bench = Bench::new(all);
        bench.run_ms(1000);
        if lost {
            let faults = Faults { dropped_ppm: 20_000, ..Faults::default() };
            bench.board.bus.bus().set_faults(faults);
        }
        bench.answer(1, &[limits(0, 1023)]);
        let mut changed = false;
        for _ in 0..3000 {
            bench.board.run_for(Duration::from_micros(100));
            changed |= bench.setup(0)[2] == 1023;
            assert!(!changed || bench.goal_of(0).get(Register::TORQUE_ENABLE) == 0);
        }
        assert!(changed);
    }
}

#[test]
fn a_setting_switches_the_torque_off_when_the_pc_is_silent() {
    let settings = BridgeSettings {
        pc_timeout_ms: 300,
        on_silence: OnSilence::TorqueOff,
        ..BridgeSettings::DEFAULT
    };
    let mut bench = Bench::at_work(Make { servos: servos([1, 2]), settings, ..Make::default() });
    bench.send_goal(goal(512));
    let off = goal(512).with(Register::TORQUE_ENABLE, 0);
    let all = |bench: &PcHost| [bench.goal_of(0), bench.goal_of(1)];
    bench.see(Silent, all, [(280, [goal(512); 2]), (310, [off; 2])]);
    bench.send_goal(goal(300));
    bench.run_ms(10);
    assert_eq!(bench.goal_of(0), goal(300));
}

#[test]
fn a_timeout_of_zero_is_never() {
    let settings = BridgeSettings { pc_timeout_ms: 0, ..BridgeSettings::DEFAULT };
    let mut bench = Bench::at_work(Make { servos: servos([1]), settings, ..Make::default() });
    bench.send_goal(goal(512));
    bench.run_ms(100_000);
    assert!(!bench.board.bridge().pc_is_silent() && bench.hellos().is_empty());
}
