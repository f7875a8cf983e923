//! The faults of the board.

use tests::extension::assign;

use super::*;

/// What puts a reading in the place of a sensor's.
type Set = fn(&mut Overrides, u16);

const MAIN: Set = |all, ad| all.battery[0] = Some(ad);
const MOTORS: Set = |all, ad| all.battery[1] = Some(ad);
const SERVOS: Set = |all, ad| all.battery[2] = Some(ad);
const DRIVERS: [Set; 2] =
    [|all, ad| all.overheat[0] = Some(ad), |all, ad| all.overheat[1] = Some(ad)];
const AMBIENT: Set = |all, ad| all.temperature = Some(ad);

/// The faults of the board that a reading makes: the reading that is wrong, and the next to it that
/// is not.
const READINGS: [(Fault, Set, u16, u16); 11] = [
    (Fault::MotorBatteryLow, MOTORS, 852, 853),
    (Fault::MotorBatteryLow, MOTORS, 171, 170),
    (Fault::MotorBatteryHigh, MOTORS, 2560, 2559),
    (Fault::ServoBatteryLow, SERVOS, 1819, 1820),
    (Fault::ServoBatteryLow, SERVOS, 455, 454),
    (Fault::MainBatteryLow, MAIN, 2001, 2002),
    (Fault::MainBatteryLow, MAIN, 455, 454),
    (Fault::DriverTooHot, DRIVERS[0], 1095, 1096),
    (Fault::DriverTooHot, DRIVERS[1], 400, 399),
    (Fault::AmbientTooHot, AMBIENT, 3692, 3691),
    (Fault::AmbientTooHot, AMBIENT, 4039, 4040),
];

/// The defaults, and 15 V as too much for the motors.
fn with_a_highest_voltage() -> Settings {
    let mut settings = Settings::DEFAULT;
    settings.control.board_faults.motor_battery_high = 2560;
    settings
}

/// A bench on which motors and a servo are driven.
fn driving(settings: Settings) -> Bench {
    let mut bench = Bench::with(Make { settings, ..Make::default() });
    bench.drive(Quantity::Pwm, 0, 16384 + 8000, 0);
    bench.drive(Quantity::Position, JOINT, 2500, 0);
    bench.drive(Quantity::Servo, 3, 2000, 0);
    bench.run_alive_ms(500);
    bench
}

#[test]
fn batteries_and_temperatures_out_of_bounds_for_a_second_stop_everything() {
    let settings = with_a_highest_voltage();
    for (fault, set, wrong, _) in READINGS {
        for clear in [by_clearing as fn(&mut Bench), by_resuming_all] {
            let mut bench = driving(settings);
            change(&bench, |all| set(all, wrong));
            // A reading takes 20 ms here, and it is looked at every 8 ms.
            let off = until_off(&mut bench, 0, 2000);
            assert!((995..=1040).contains(&off), "{fault:?} at {wrong}: {off}");
            assert_eq!(bench.bridge(JOINT), (0, false));
            let servo_stops = fault == Fault::ServoBatteryLow;
            assert_eq!(bench.pulse(3).is_none(), servo_stops, "{fault:?}");
            let record = first_record(&mut bench);
            assert_eq!((record.fault, record.channel), (fault, None));
            let cool = 1850; // the simulated drivers are at 25 degrees
            let is_driver = |ad: i16| (cool - 20..cool + 20).contains(&ad);
            match (fault, record.values) {
                (Fault::DriverTooHot, [first, second, 0]) => {
                    let hot = wrong as i16;
                    let told =
                        (first == hot && is_driver(second)) || (is_driver(first) && second == hot);
                    assert!(told && (wrong == 1095) == (first == hot), "{record:?}");
                }
                (_, values) => assert_eq!(values, [wrong as i16, 0, 0], "{fault:?}"),
            }
            // The cause is still there, and so is the latch: nothing twitches, however often a host
            // clears and drives.
            for _ in 0..100 {
                clear(&mut bench);
                bench.drive(Quantity::Pwm, 0, 16384 + 8000, 0);
                bench.drive(Quantity::Servo, 3, 3000, 0);
                bench.run_alive_with(7, |bench| {
                    assert_eq!((bench.bridge(0), bench.bridge(JOINT)), ((0, false), (0, false)));
                    assert!(!servo_stops || bench.pulse(3).is_none(), "{fault:?}");
                });
            }
            assert_eq!(latched(&bench), [(fault, None)]);
            assert_eq!(first_record(&mut bench), record, "the first time stands");
            off_until_cleared_and_then_runs_again(&mut bench, 0, clear);
            bench.drive(Quantity::Servo, 3, 3000, 0);
            bench.run_alive_ms(50);
            assert_eq!(bench.pulse(3), Some(3000));
        }
    }
}

#[test]
fn readings_that_are_just_right_or_not_wired_or_wrong_for_a_moment_stop_nothing() {
    let goes_on = |bench: &mut Bench, what: &str| {
        assert_eq!((bench.bridge(0), latched(bench)), ((8000, true), vec![]), "{what}");
    };
    let settings = with_a_highest_voltage();
    for (fault, set, wrong, right) in READINGS {
        let mut bench = driving(settings);
        for ad in [right, 0, 2047] {
            change(&bench, |all| set(all, ad));
            bench.run_alive_ms(5000);
            goes_on(&mut bench, &format!("{fault:?} at {ad}"));
        }
        for _ in 0..3 {
            change(&bench, |all| set(all, wrong));
            bench.run_alive_ms(900);
            change(&bench, |all| set(all, right));
            bench.run_alive_ms(100);
        }
        goes_on(&mut bench, &format!("{fault:?} for a moment"));
    }
}

#[test]
fn link_loss_is_on_record_and_holds_nobody_back() {
    let mut bench = driving(Settings::DEFAULT);
    bench.send(Command::Ping);
    bench.run_ms(1900);
    assert_eq!(latched(&bench), [], "not yet");
    bench.run_ms(200);
    assert_eq!((bench.bridge(0), latched(&bench)), ((0, false), vec![(Fault::LinkLoss, None)]));
    let record = first_record(&mut bench);
    assert_eq!((record.fault, record.values), (Fault::LinkLoss, [2000, 0, 0]));
    assert!((2400..=2520).contains(&record.uptime_ms), "{record:?}");
    // A host of old knows of no fault: it just drives on.
    bench.drive(Quantity::Pwm, 0, 16384 - 4000, 0);
    bench.run_alive_ms(100);
    assert_eq!(bench.bridge(0), (-4000, true));
    by_resuming_all(&mut bench);
    bench.run_alive_ms(50);
    assert_eq!(latched(&bench), [(Fault::LinkLoss, None)], "it stays on record");
    by_clearing(&mut bench);
    bench.run_alive_ms(50);
    assert_eq!((bench.bridge(0), latched(&bench)), ((-4000, true), vec![]));
}

/// What a fault that stops nothing leaves: its record, until it is cleared, and a board that drives.
fn on_record_and_no_more(bench: &mut Bench, fault: Fault, at_ms: std::ops::RangeInclusive<u32>) {
    assert_eq!(latched(bench), [(fault, None)]);
    let record = first_record(bench);
    assert_eq!((record.fault, record.channel, record.values), (fault, None, [0; 3]));
    assert!(at_ms.contains(&record.uptime_ms), "{record:?}");
    bench.drive(Quantity::Pwm, 0, 16384 - 4000, 0);
    bench.run_alive_ms(100);
    assert_eq!(bench.bridge(0), (-4000, true));
    by_resuming_all(bench);
    bench.run_alive_ms(50);
    assert_eq!(latched(bench), [(fault, None)], "a resume is for what stops");
    by_clearing(bench);
    bench.run_alive_ms(50);
    assert_eq!((bench.bridge(0), latched(bench)), ((-4000, true), vec![]));
}

#[test]
fn lost_bytes_damaged_settings_and_a_start_by_the_watchdog_are_on_record_and_hold_nobody_back() {
    let mut bench = driving(Settings::DEFAULT);
    bench.board.line.overrun();
    bench.run_ms(2);
    assert_eq!(bench.bridge(0), (8000, true));
    on_record_and_no_more(&mut bench, Fault::ReceiveOverrun, 500..=520);

    let board = VirtualBoard::with_flash(Make::default(), Flash::with(&b"foreign".repeat(300)));
    let mut bench = Bench::of(board);
    bench.run_ms(10);
    on_record_and_no_more(&mut bench, Fault::SettingsCorrupt, 0..=0);
    // Flash that was never written is none.
    let mut bench = driving(Settings::DEFAULT);
    assert_eq!(latched(&bench), []);

    bench.board.start_again(ResetCause::Watchdog);
    bench.run_ms(10);
    assert_eq!(bench.bridge(0), (0, false));
    on_record_and_no_more(&mut bench, Fault::WatchdogReset, 0..=0);
    // Nor is any other start.
    for cause in [ResetCause::Power, ResetCause::Pin, ResetCause::Software] {
        bench.board.start_again(cause);
        bench.run_ms(10);
        assert_eq!(latched(&bench), [], "{cause:?}");
    }
}

/// Lets so many periods begin a period late, each followed by so many in time.
fn miss(bench: &mut Bench, periods: u32, in_time: u64) {
    for k in 0..periods {
        if k % 50 == 0 {
            bench.send(Command::Ping);
        }
        clock::advance_to(Instant::now() + Duration::from_micros(2100));
        bench.run_ms(0);
        bench.board.run_until(Instant::from_millis(Instant::now().as_millis() + in_time));
    }
}

#[test]
fn control_periods_that_are_missed_are_counted_and_a_fault_when_they_persist() {
    let mut bench = driving(Settings::DEFAULT);
    miss(&mut bench, 90, 0);
    assert_eq!(bench.board.snapshot().counters.periods_missed, 90);
    assert_eq!((bench.bridge(0), latched(&bench)), ((8000, true), vec![]));
    miss(&mut bench, 20, 0);
    assert_eq!((bench.bridge(0), latched(&bench)), ((0, false), vec![(Fault::PeriodMissed, None)]));
    // While they go on nobody clears it: the first record stands.
    let first = first_record(&mut bench);
    miss(&mut bench, 110, 0);
    by_clearing(&mut bench);
    miss(&mut bench, 20, 0);
    assert_eq!(first_record(&mut bench), first);
    // However many there were more, it may be cleared as soon as they are over.
    miss(&mut bench, 400, 0);
    bench.run_alive_ms(20);
    by_clearing(&mut bench);
    bench.run_alive_ms(50);
    assert_eq!(latched(&bench), []);
    miss(&mut bench, 110, 0);
    let record = first_record(&mut bench);
    assert!((1000..=2100).contains(&record.values[0]), "{record:?}");
    // Health tells how many they were in all.
    let (did, data) = bench.ask_raw(98, &[1]);
    let Some(Answer::Health(health)) = Answer::parse(did, &data) else { panic!("{did}") };
    assert_eq!((health.faults, health.periods_missed), (1, 750));
    bench.run_alive_ms(1000);
    off_until_cleared_and_then_runs_again(&mut bench, 0, by_clearing);
    // One in eight for a long time; and one hole of 45 ms: the watchdog bears no more than 51.
    miss(&mut bench, 1000, 8);
    clock::advance_to(Instant::now() + Duration::from_millis(45));
    bench.run_alive_ms(1000);
    assert_eq!((bench.bridge(0), latched(&bench)), ((8000, true), vec![]));
}

#[test]
fn a_servo_that_a_fault_stopped_does_not_go_on_with_its_move() {
    for clear in [by_clearing as fn(&mut Bench), by_resuming_all] {
        let mut bench = driving(Settings::DEFAULT);
        bench.drive(Quantity::Servo, 3, 5000, 3000);
        bench.run_alive_ms(500);
        let before = bench.pulse(3).expect("it moves");
        assert!((2400..2600).contains(&before), "{before}");
        change(&bench, |all| all.battery[2] = Some(1700));
        bench.run_alive_ms(1200);
        assert_eq!(bench.pulse(3), None);
        change(&bench, |all| *all = Overrides::default());
        bench.run_alive_ms(100);
        clear(&mut bench);
        by_resuming_all(&mut bench);
        bench.run_alive_ms(100);
        let after = bench.pulse(3).expect("resumed");
        bench.run_alive_with(2000, |bench| assert_eq!(bench.pulse(3), Some(after), "it holds"));
        assert!((3000..3800).contains(&after), "where the fault broke the move off: {after}");
    }
}

#[test]
fn a_fault_that_is_switched_off_is_cleared_at_once() {
    let mut bench = driving(Settings::DEFAULT);
    change(&bench, |all| all.battery[2] = Some(1700));
    bench.run_alive_ms(1200);
    assert_eq!(latched(&bench), [(Fault::ServoBatteryLow, None)]);
    bench.send_raw(did::PARAMETERS, &assign(&[(66, 0)]));
    by_clearing(&mut bench);
    bench.run_alive_ms(2000);
    assert_eq!(latched(&bench), []);
}
