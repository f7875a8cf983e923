//! The arm's own cable: what is lost with it, and how INIT and CHECK find it again.

use super::*;
use protocol::arcos::ArmInfo;

/// Asks for ARMINFOpac.
fn info_says_no_arm(host: &mut Host) -> bool {
    host.received();
    host.send(ArmCommand::Info);
    host.run_ms(20);
    let info = host.heard(ArmInfo::ID);
    ArmInfo::parse(&info.packet()) == Some(ArmInfo::NoArm)
}

#[test]
fn an_arm_that_is_lost_with_power_on_goes_home_and_off_and_takes_no_power_until_init() {
    let mut host = Host::powered();
    host.speed(1, 5);
    host.go(1, 177);
    host.run_alive_ms(400);
    let mut watch = NoJump::new(&host);
    host.connect(false);
    host.run_alive_with(60, |host| watch.look(host));
    assert!(!host.arm().connected && host.arm().homing && host.arm().powered);
    assert_eq!((host.link().arms_lost, host.status_bytes()[0]), (1, 0b01));
    watch.look(&host);
    assert!(info_says_no_arm(&mut host));
    watch.look(&host);
    // Nothing calls this park off.
    let before = host.link().ignored;
    for command in [
        ArmCommand::Power(true),
        ArmCommand::Stop(ALL),
        ArmCommand::Position { joint: number(2), ticks: 200 },
        ArmCommand::Home(ALL),
    ] {
        host.send(command);
    }
    // 50 ticks of 20 ms, however fast SPEED has it, and 60 ms for the servos to settle.
    host.run_alive_with(850, |host| watch.look(host));
    assert!(host.arm().powered);
    host.run_alive_with(200, |host| watch.look(host));
    assert_eq!((host.arm().powered, host.pulses()), (false, NO_PULSES));
    assert_eq!(host.link().ignored - before, 4);

    // The cable alone, or CHECK, does not give power back; INIT does.
    host.connect(true);
    host.send(ArmCommand::Check);
    host.run_alive_ms(300);
    assert!(host.arm().connected && !host.arm().initialised);
    host.send(ArmCommand::Power(true));
    host.run_ms(10);
    assert!(!host.arm().powered);
    host.send(ArmCommand::Init);
    host.run_alive_ms(750);
    assert!(host.arm().initialised);
    host.send(ArmCommand::Power(true));
    host.run_ms(10);
    assert_eq!((host.arm().powered, host.pulses()), (true, AT_HOME));
}

#[test]
fn an_init_that_finds_no_arm_does_not_help() {
    let mut host = Host::powered();
    host.connect(false);
    host.run_alive_ms(100);
    host.send(ArmCommand::Init);
    host.run_alive_ms(800);
    host.connect(true);
    host.send(ArmCommand::Check);
    host.run_alive_ms(300);
    host.send(ArmCommand::Power(true));
    host.run_ms(10);
    assert_eq!((host.arm().connected, host.arm().powered), (true, false));
}

#[test]
fn an_arm_that_is_lost_without_power_is_forgotten_until_check_finds_it() {
    let mut host = Host::opened();
    host.connect(false);
    host.run_alive_ms(60);
    assert_eq!((host.status_bytes()[0], host.link().arms_lost), (0, 0));
    assert!(info_says_no_arm(&mut host));
    host.connect(true);
    host.run_alive_ms(500);
    assert!(!host.arm().connected, "nobody has looked");
    // CHECK takes 200 ms, and other commands are carried out meanwhile.
    host.send(ArmCommand::Check);
    host.speed(1, 33);
    host.run_alive_ms(180);
    assert!(!host.arm().connected);
    host.run_alive_ms(40);
    assert!(host.arm().connected && host.arm().initialised);
    assert!(!info_says_no_arm(&mut host));
    host.send(ArmCommand::Power(true));
    host.run_ms(10);
    assert_eq!((host.arm().powered, host.link().ignored), (true, 0));
}

#[test]
fn a_board_without_an_arm_says_so_from_the_beginning() {
    let mut make = Make::default();
    make.scene.environment.gpio_in = 0xFF;
    let mut host = Host::with(make);
    host.run_ms(30);
    host.open();
    assert!(info_says_no_arm(&mut host));
    host.send(ArmCommand::Power(true));
    host.run_ms(20);
    assert_eq!((host.pulses(), host.link().ignored, host.link().arms_lost), (NO_PULSES, 1, 0));
}

#[test]
fn init_takes_700_ms_and_only_info_and_status_are_answered_meanwhile() {
    let mut host = Host::powered();
    host.run_ms(90);
    host.send(ArmCommand::Init);
    host.run_ms(10);
    assert!(!host.arm().powered, "it was at home");
    let ignored = [
        ArmCommand::Init,
        ArmCommand::Check,
        ArmCommand::Power(true),
        ArmCommand::Power(false),
        ArmCommand::Home(ALL),
        ArmCommand::Park,
        ArmCommand::Position { joint: number(1), ticks: 1 },
        ArmCommand::Speed { joint: number(1), ms_per_tick: 1 },
        ArmCommand::Stop(ALL),
        ArmCommand::AutoPark(1),
        ArmCommand::GripPark(1),
    ];
    for command in ignored {
        host.send(command);
    }
    host.run_alive_ms(50);
    assert_eq!(host.link().ignored, ignored.len() as u32);
    assert_eq!(host.status_bytes()[..2], [0b10, 0]);
    assert!(!info_says_no_arm(&mut host));
    // 10 + 50 + 10 + 20 ms have gone; INIT counts from its last byte, half a millisecond in.
    host.run_alive_ms(600);
    host.power_up();
    assert!(!host.arm().powered, "at 690 ms");
    host.run_ms(10);
    host.power_up();
    assert!(host.arm().powered, "at 705 ms");
}

#[test]
fn init_parks_an_arm_that_has_power() {
    let mut host = Host::powered();
    host.go(1, 187);
    host.run_alive_ms(1250);
    let mut watch = NoJump::new(&host);
    host.send(ArmCommand::Init);
    host.run_alive_with(1190, |host| watch.look(host));
    assert!(host.arm().powered && host.arm().homing, "60 ticks of 20 ms");
    host.run_alive_with(80, |host| watch.look(host));
    assert_eq!((host.arm().powered, host.pulses()), (false, NO_PULSES));
}
