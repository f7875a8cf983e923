//! Loops of the bridge that hang, one after the other: the watchdog starves and starts the bridge
//! again, and what the servos do meanwhile. Nobody can switch them off: they hear nothing but the
//! bus.

use super::*;
use hal_mock::cm5_board::Loop;

const ALL: [Loop; 3] = [Loop::Receive, Loop::Transmit, Loop::Bus];

/// A joint on its way, and a servo that turns endlessly; the PC is alive.
fn joint_and_wheel(phase: u64) -> Bench {
    let mut bench = Bench::new(servos([1, 2]));
    bench.run_ms(1500);
    bench.answer(1, &[limits(0, 1023), limits(0, 0)]);
    bench.agreed = 2;
    bench.run_ms(300);
    bench.run_alive_ms(1000, goal(600));
    bench.run_ms(phase);
    assert_eq!((bench.goal_of(0), bench.goal_of(1)), (goal(600), goal(600)));
    bench
}

fn turns(bench: &Bench, servo: usize) -> bool {
    bench.goal_of(servo).get(Register::TORQUE_ENABLE) == 1
}

#[test]
fn a_loop_that_hangs_restarts_the_bridge_within_500_ms_and_no_joint_goes_limp() {
    for task in ALL {
        let (mut resets, mut stops) = (Vec::new(), Vec::new());
        for phase in (0..60).step_by(4) {
            let mut bench = joint_and_wheel(phase);
            bench.board.watchdog.hung.set(Some(task));
            let (mut reset, mut stop) = (None, None);
            for ms in 1..=3000 {
                bench.run_ms(1);
                if bench.board.restarts() > 0 {
                    reset.get_or_insert(ms);
                }
                if !turns(&bench, 1) {
                    stop.get_or_insert(ms);
                }
                assert_eq!(bench.goal_of(0), goal(600), "{task:?}: the joint holds");
                assert!(stop.is_none() || !turns(&bench, 1), "{task:?}: it turns again");
            }
            assert_eq!(bench.board.restarts(), 1, "{task:?}");
            resets.push(reset.expect("a reset"));
            stops.push(stop.expect("a stop"));

            // As after any start.
            bench.said();
            bench.run_ms(1000);
            assert_eq!(bench.hellos().last().unwrap().1, [1, 2]);
            bench.answer(1, &[limits(0, 1023), limits(0, 0)]);
            bench.run_ms(300);
            bench.run_alive_ms(200, goal(300));
            assert_eq!((bench.goal_of(0), bench.goal_of(1)), (goal(300), goal(300)));
        }
        resets.sort();
        stops.sort();
        let ends = |times: &[u64]| (times[0], times[times.len() - 1]);
        println!("{task:?}: reset {:?} ms, the wheel stops {:?} ms", ends(&resets), ends(&stops));
        let ((soonest, latest), (first, last)) = (ends(&resets), ends(&stops));
        // The watchdog's 250 ms, behind the 200 that a loop other than the bus's may be silent.
        let bounds = if task == Loop::Bus { 249..=251 } else { 400..=452 };
        let are_within = bounds.contains(&soonest) && bounds.contains(&latest);
        assert!(are_within, "{task:?}: {soonest} to {latest}");
        // The reset, half a second of search, a second of silence.
        assert!(first >= 1500 && last <= 2200, "{task:?}: {first} to {last}");
    }
}

#[test]
fn while_the_pcs_side_hangs_the_bus_goes_on_and_while_the_bus_hangs_it_is_silent() {
    for (task, is_silent) in [(Loop::Receive, false), (Loop::Transmit, false), (Loop::Bus, true)] {
        let mut bench = joint_and_wheel(0);
        bench.board.watchdog.hung.set(Some(task));
        bench.run_ms(10);
        let before = bench.board.bridge().counters().bus.instructions;
        bench.run_ms(200);
        let instructions = bench.board.bridge().counters().bus.instructions - before;
        assert_eq!(instructions == 0, is_silent, "{task:?}: {instructions}");
    }
}

#[test]
fn a_loop_that_is_late_is_no_hang() {
    let mut bench = joint_and_wheel(0);
    for task in ALL {
        for _ in 0..5 {
            bench.board.watchdog.hung.set(Some(task));
            bench.run_ms(145); // and a check-in period that it has waited already
            bench.board.watchdog.hung.set(None);
            // Whatever wakes a loop.
            bench.run_alive_ms(500, goal(600));
        }
    }
    assert_eq!((bench.board.restarts(), bench.goal_of(0)), (0, goal(600)));
}
