//! Tasks that hang, one after the other: nothing is driven any more within 100 ms, and the board
//! starts again. And a line that loses bytes.

use hal_mock::board::Make;
use hal_mock::tasks::Task;
use protocol::extension::{Fault, did};
use protocol::pms5005::{Command, Quantity};
use tests::Bench;

/// A bench that drives everything, `phase` ms after it was switched on.
fn driving(phase: u64) -> Bench {
    let mut bench = Bench::new();
    bench.drive(Quantity::Pwm, 0, 16384 + 8000, 0);
    bench.drive(Quantity::Velocity, 1, 3000, 0);
    bench.drive(Quantity::Servo, 3, 2000, 0);
    bench.run_ms(500 + phase);
    bench
}

fn is_off(bench: &Bench) -> bool {
    bench.board.plant.borrow().outputs.are_off()
}

fn latched(bench: &Bench) -> Vec<Fault> {
    tests::latched(&bench.board.snapshot()).into_iter().map(|(fault, _)| fault).collect()
}

#[test]
fn a_task_that_hangs_switches_everything_off_and_restarts_the_board() {
    use Task::{Control, Display, Link, Sensors};
    // Control in its last period before the watchdog's 51 ms, which then take the outputs too. A
    // task after 90 ms of silence, less the 50 that it may have waited, and 51 ms before the reset.
    for (task, off_within, reset_within) in [
        (Control, 51..=53, 51..=53),
        (Sensors, 70..=91, 121..=144),
        (Display, 40..=91, 91..=144),
        (Link, 40..=91, 91..=144),
    ] {
        let (mut offs, mut resets) = (Vec::new(), Vec::new());
        for phase in 0..60 {
            let mut bench = driving(phase);
            bench.board.watchdog.hung.set(Some(task));
            let (mut off, mut reset) = (None, None);
            for ms in 1..=1000 {
                bench.run_ms(1);
                off = off.or(is_off(&bench).then_some(ms));
                assert!(off.is_none() || is_off(&bench), "{task:?}: on again after {ms} ms");
                if reset.is_none() && latched(&bench) == [Fault::WatchdogReset] {
                    reset = Some(ms);
                }
            }
            offs.push(off.expect("off"));
            resets.push(reset.expect("a reset"));
            // It is as after any start: a command moves it again.
            bench.drive(Quantity::Pwm, 0, 16384 + 4000, 0);
            bench.run_alive_ms(1000);
            assert_eq!(bench.bridge(0), (4000, true));
            assert_eq!(latched(&bench), [Fault::WatchdogReset]);
        }
        let ends = |times: &[u64]| (*times.iter().min().unwrap(), *times.iter().max().unwrap());
        let ((first_off, last_off), (first, last)) = (ends(&offs), ends(&resets));
        println!("{task:?}: off after {first_off} to {last_off} ms, reset {first} to {last} ms");
        let are_within = off_within.contains(&first_off) && off_within.contains(&last_off);
        assert!(are_within, "{task:?}: off after {first_off} to {last_off}");
        let are_within = reset_within.contains(&first) && reset_within.contains(&last);
        assert!(are_within, "{task:?}: reset after {first} to {last}");
    }
}

#[test]
fn nothing_is_driven_before_every_task_has_begun_and_one_that_never_does_resets_the_board() {
    for task in [Task::Sensors, Task::Display] {
        let mut bench = Bench::new();
        bench.board.watchdog.hung.set(Some(task)); // before it is polled for the first time
        bench.drive(Quantity::Pwm, 0, 16384 + 8000, 0);
        let mut reset = None;
        for ms in 1..=1200 {
            bench.run_ms(1);
            assert!(is_off(&bench), "{task:?}");
            if reset.is_none() && latched(&bench) == [Fault::WatchdogReset] {
                reset = Some(ms);
            }
        }
        // Excused for a second, and then the watchdog's 51 ms.
        let reset = reset.expect("a reset");
        assert!((1050..=1056).contains(&reset), "{task:?}: {reset} ms");
        bench.drive(Quantity::Pwm, 0, 16384 + 8000, 0);
        bench.run_alive_ms(100);
        assert_eq!(bench.bridge(0), (8000, true));
    }
}

#[test]
fn the_longest_answer_on_the_slowest_line_is_no_hang() {
    let make = Make { line_rate: 19_200, ..Make::default() };
    let mut bench = Bench::with(make);
    bench.drive(Quantity::Pwm, 0, 16384 + 4000, 0);
    for _ in 0..20 {
        bench.send_raw(did::COUNTERS, &[]);
        bench.send_raw(did::STATE, &[1]);
        bench.send(Command::Ping); // who only reads is no host
        bench.run_ms(500);
        assert_eq!(bench.bridge(0), (4000, true));
    }
    let received = bench.received();
    let came = |did| received.iter().any(|frame| frame.did == did);
    assert!(came(did::COUNTERS) && came(did::STATE));
    assert_eq!(latched(&bench), []);
}

#[test]
fn a_task_that_comes_back_does_not_set_anything_in_motion_again() {
    for task in [Task::Control, Task::Sensors, Task::Display, Task::Link] {
        let mut bench = driving(0);
        bench.board.watchdog.hung.set(Some(task));
        bench.run_ms(92);
        assert!(is_off(&bench));
        bench.board.watchdog.hung.set(None);
        // The tasks have to be polled for it.
        bench.board.line.host_sends(&[0]);
        for _ in 0..600 {
            bench.run_ms(1);
            assert!(is_off(&bench), "{task:?}");
        }
        assert_eq!(latched(&bench), [Fault::WatchdogReset], "it was not trusted again: {task:?}");
    }
}

#[test]
fn tasks_that_are_busy_but_alive_let_nothing_starve() {
    let mut bench = driving(0);
    for task in [Task::Control, Task::Sensors, Task::Display, Task::Link] {
        for _ in 0..10 {
            bench.board.watchdog.hung.set(Some(task));
            bench.run_ms(35);
            bench.board.watchdog.hung.set(None);
            bench.board.line.host_sends(&[0]);
            bench.run_alive_ms(200);
            assert_eq!(bench.bridge(0), (8000, true), "{task:?}");
        }
    }
    assert_eq!(latched(&bench), []);
}

#[test]
fn a_transmitter_that_never_ends_is_a_hang_too_though_the_host_is_heard() {
    for phase in 0..20 {
        let mut bench = driving(5 * phase);
        bench.board.line.hang_transmitter(true);
        let (mut off, mut reset) = (None, None);
        for ms in 1..=700 {
            if ms % 100 == 0 {
                bench.send(Command::Ping);
            }
            bench.run_ms(1);
            off = off.or(is_off(&bench).then_some(ms));
            if reset.is_none() && latched(&bench) == [Fault::WatchdogReset] {
                reset = Some(ms);
                bench.board.line.hang_transmitter(false);
            }
        }
        // The three reports of telemetry take 9 ms of every 50; then it hangs in the next.
        let (off, reset) = (off.expect("off"), reset.expect("a reset"));
        assert!((80..=145).contains(&off) && (51..=52).contains(&(reset - off)), "{off} {reset}");
    }
}

#[test]
fn bytes_that_the_line_has_lost_are_on_record_and_stop_nothing() {
    let mut bench = driving(0);
    let before = bench.board.link().line_errors;
    bench.board.line.overrun();
    bench.run_ms(20);
    assert_eq!(bench.board.link().line_errors - before, 1);
    assert_eq!((bench.bridge(0), latched(&bench)), ((8000, true), vec![Fault::ReceiveOverrun]));
    bench.drive(Quantity::Pwm, 0, 16384 + 4000, 0);
    bench.run_alive_ms(100);
    assert_eq!(bench.bridge(0), (4000, true), "the line goes on");
}
