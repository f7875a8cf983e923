//! A fault of the board that stops the servos: what the host sees of it, and how it goes on.

use super::*;
use protocol::extension::Fault;

/// The servos' battery, in A/D counts: 3.7 V, or as the scene has it.
fn battery(host: &Host, low: bool) {
    host.board.plant.borrow_mut().overrides.battery[2] = low.then_some(1700);
}

/// Lets the battery go low, and time pass until no servo has a pulse: in ms.
fn until_off(host: &mut Host, most: u64) -> u64 {
    battery(host, true);
    host.until(Alive, most, |host| host.pulses() == NO_PULSES)
}

fn latched(host: &Host) -> Vec<Fault> {
    tests::latched(&host.board.snapshot()).into_iter().map(|(fault, _)| fault).collect()
}

/// INIT, and what it takes.
fn init(host: &mut Host) {
    host.send(ArmCommand::Init);
    host.run_alive_ms(750);
}

fn in_dialect(dialect: u8) -> Host {
    let mut make = Make::default();
    make.settings.arm.dialect = dialect;
    let mut host = Host::with(make);
    host.open();
    host.power_up();
    host
}

#[test]
fn a_low_servo_battery_takes_the_power_within_a_second_and_the_status_says_so() {
    let (manual, aria) = (0, 2); // setting 112
    // Power and connected, motion of joint 1; or motion, then good, initialised, power.
    for (dialect, before, after) in
        [(manual, [0b11, 0b10], [0b10, 0]), (aria, [0b10, 0b0111], [0, 0])]
    {
        let mut host = in_dialect(dialect);
        host.speed(1, 50);
        host.go(1, 227);
        host.run_alive_ms(200);
        assert_eq!(host.status_bytes()[..2], before);
        let off = until_off(&mut host, 1500);
        assert!((995..=1040).contains(&off), "{off}");
        // The board took the power; the arm has seen it one step or one look later.
        host.run_ms(25);
        let status = host.status_bytes();
        assert_eq!((&status[..2], latched(&host)), (&after[..], vec![Fault::ServoBatteryLow]));
        assert!((145..=155).contains(&status[2]) && status[3..] == [127; 5], "{status:?}");
        assert_eq!(host.link().power_lost, 1);
        host.run_alive_ms(5000);
        assert_eq!(host.status_bytes(), status, "nothing goes on");
    }
}

#[test]
fn a_battery_that_is_low_for_a_moment_stops_nothing() {
    let mut host = in_dialect(2);
    host.go(1, 187);
    for _ in 0..3 {
        battery(&host, true);
        host.run_alive_ms(900);
        battery(&host, false);
        host.run_alive_ms(100);
    }
    assert_eq!((host.ticks(1), host.arm().powered, latched(&host)), (187, true, vec![]));
    assert_eq!(host.status_bytes()[..2], [0, 0b0111]);
}

#[test]
fn under_the_fault_no_command_pretends_to_move_and_only_init_without_its_cause_ends_it() {
    let mut host = Host::powered();
    host.go(1, 177);
    host.run_alive_ms(1100);
    until_off(&mut host, 1500);
    host.run_ms(25);
    let refused = |host: &mut Host| {
        let before = host.link();
        let orders = [
            ArmCommand::Power(true),
            ArmCommand::Home(ALL),
            ArmCommand::Position { joint: number(2), ticks: 200 },
            ArmCommand::Stop(ALL),
        ];
        orders.into_iter().for_each(|order| host.send(order));
        for _ in 0..1000 {
            host.run_alive_ms(1);
            assert_eq!((host.pulses(), host.arm().moving), (NO_PULSES, [false; 6]));
        }
        let after = host.link();
        assert_eq!(after.ignored - before.ignored, orders.len() as u32);
        assert_eq!(after.arm, before.arm);
        assert_eq!((after.arm.powered, after.arm.positions[0]), (false, 177));
    };
    refused(&mut host);
    init(&mut host);
    assert_eq!(latched(&host), [Fault::ServoBatteryLow], "its cause is still there");
    assert!(!host.arm().initialised && !host.arm().good && host.arm().connected);
    refused(&mut host);
    battery(&host, false);
    host.run_alive_ms(100);
    refused(&mut host);

    init(&mut host);
    assert_eq!((latched(&host), host.pulses()), (vec![], NO_PULSES), "INIT moves nothing");
    assert!(host.arm().initialised && host.arm().good && !host.arm().powered);
    // Each joint has its power where it was when it lost it.
    host.power_up();
    let mut held = AT_HOME;
    held[0] = Some(pulse(177));
    assert_eq!((host.pulses(), host.arm().powered), (held, true));
    let mut watch = NoJump::new(&host);
    host.go(1, 127);
    host.run_alive_with(1100, |host| watch.look(host));
    assert_eq!((host.pulses(), host.link().power_lost), (AT_HOME, 1));
}

#[test]
fn a_joint_that_loses_its_power_on_its_way_has_it_again_where_its_servo_was_sent_last() {
    for (ms_per_tick, parks) in [(1, false), (1, true), (7, false), (20, true)] {
        let mut host = Host::powered();
        for joint in 1..=6 {
            host.speed(joint, ms_per_tick);
            host.go(joint, 0);
        }
        host.run_alive_ms(1000);
        battery(&host, true);
        host.run_alive_ms(900);
        // To and fro until the power goes.
        let mut last = host.pulses();
        let mut targets = [255, 0].into_iter().cycle();
        while host.pulses() != NO_PULSES {
            if host.arm().moving == [false; 6] && !host.arm().homing {
                let ticks = targets.next().unwrap();
                (1..=6).for_each(|joint| host.go(joint, ticks));
                if parks {
                    host.send(ArmCommand::Park);
                }
            }
            last = host.pulses();
            host.run_ms(1);
        }
        battery(&host, false);
        host.run_alive_ms(200);
        let status = host.arm();
        assert!(!status.powered && status.moving == [false; 6] && !status.homing, "{status:?}");
        init(&mut host);
        host.power_up();
        for (before, now) in last.iter().zip(host.pulses()) {
            let jump = i32::from(now.unwrap()) - i32::from(before.unwrap());
            assert!(jump.abs() <= NoJump::TICK, "by {jump} at SPEED {ms_per_tick}");
        }
    }
}

#[test]
fn a_fault_that_comes_without_power_keeps_it_off_too() {
    let mut host = Host::opened();
    battery(&host, true);
    host.run_alive_ms(1100);
    assert_eq!((host.link().power_lost, host.arm().good), (0, false));
    // Whether it was seen or not yet.
    host.send(ArmCommand::Power(true));
    host.run_alive_ms(100);
    assert_eq!((host.pulses(), host.arm().powered), (NO_PULSES, false));
    battery(&host, false);
    host.run_alive_ms(100);
    init(&mut host);
    host.power_up();
    assert_eq!(host.pulses(), AT_HOME);
}

#[test]
fn power_that_is_asked_for_in_the_very_moment_of_the_fault_is_not_there() {
    for ms in 985..1050 {
        let mut host = Host::opened();
        battery(&host, true);
        host.run_alive_ms(ms);
        host.send(ArmCommand::Power(true));
        host.run_alive_ms(100);
        assert_eq!((host.pulses(), host.arm().powered), (NO_PULSES, false), "{ms}");
        assert!(!host.arm().initialised && host.arm().positions == [127; 6], "{ms}");
    }
}

#[test]
fn an_arm_that_loses_cable_and_power_needs_both_again() {
    let mut host = Host::powered();
    host.go(1, 227);
    host.run_alive_ms(500);
    battery(&host, true);
    host.run_alive_ms(980);
    host.connect(false);
    host.run_alive_ms(200);
    assert_eq!((host.pulses(), host.status_bytes()[0]), (NO_PULSES, 0));
    battery(&host, false);
    host.run_alive_ms(100);
    init(&mut host);
    assert!(latched(&host).is_empty() && !host.arm().initialised, "there is no arm");
    host.connect(true);
    host.run_alive_ms(50);
    init(&mut host);
    host.power_up();
    assert!(host.arm().powered && host.pulses()[0].is_some());
}
