//! From SYNC0 to CLOSE; what comes when; hosts that stammer, and hosts that die.

use super::*;
use protocol::arcos::{ArmInfo, JointInfo, Names};

/// The shortest standard packet: at rest, 12.0 V (the motors' battery), no sonar.
const STANDARD: [u8; 25] =
    [0xFA, 0xFB, 22, 0x32, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 120, 0, 0, 0, 0, 0, 0, 0, 0, 0x32, 0x78];

#[test]
fn a_session_from_sync0_to_close_byte_by_byte() {
    let mut host = Host::new();
    let bytes = |host: &mut Host| -> Vec<Vec<u8>> {
        host.run_ms(10);
        host.received().into_iter().map(|packet| packet.bytes).collect()
    };
    host.send_bytes(&[0xFA, 0xFB, 3, 0, 0, 0]);
    assert_eq!(bytes(&mut host), [[0xFA, 0xFB, 3, 0, 0, 0]]);
    host.send_bytes(&[0xFA, 0xFB, 3, 1, 0, 1]);
    assert_eq!(bytes(&mut host), [[0xFA, 0xFB, 3, 1, 0, 1]]);
    host.send_bytes(&[0xFA, 0xFB, 3, 2, 0, 2]);
    let names = bytes(&mut host);
    assert_eq!(names.len(), 1);
    let expected = Names { name: "Open arm", class: "Pioneer", subclass: "p3dx" };
    assert_eq!(Names::parse(&Packet::parse(&names[0]).unwrap()), Some(expected));
    host.run_ms(300);
    assert!(host.received().is_empty(), "nothing before OPEN");

    // OPEN with 1: 06 01 3B 01 00.
    host.send_bytes(&[0xFA, 0xFB, 6, 1, 0x3B, 1, 0, 0x02, 0x3B]);
    host.run_ms(1010);
    let standard = host.received();
    assert_eq!(standard.len(), 11, "one at once, and ten in a second");
    for packet in &standard {
        // The battery's reading is noisy; all else is as it stands.
        assert!((119..=121).contains(&packet.bytes[14]), "{packet:?}");
        let expected = [&STANDARD[..14], &[packet.bytes[14]], &STANDARD[15..23]].concat();
        assert_eq!(packet.bytes[..23], expected);
    }
    let gaps = standard.windows(2).map(|pair| (pair[1].at - pair[0].at).as_millis());
    assert!(gaps.clone().all(|gap| (99..=101).contains(&gap)), "{:?}", gaps.collect::<Vec<_>>());

    host.send_bytes(&[0xFA, 0xFB, 3, 2, 0, 2]); // CLOSE, once the session is open
    host.run_ms(5);
    host.received();
    host.run_ms(1000);
    assert!(host.received().is_empty(), "nothing after CLOSE");
    let link = host.link();
    assert_eq!((link.opened, link.watchdogs, link.out_of_turn, link.link.refused), (1, 0, 0, 0));
}

#[test]
fn open_without_an_argument_opens_too() {
    let mut host = Host::new();
    for sync in SYNC {
        host.send_bare(sync.id);
    }
    host.send_bare(command::OPEN);
    host.run_ms(20);
    // Without waiting for any answer: all come, in order.
    assert_eq!(host.ids(), [0, 1, 2, Standard::ID]);
}

#[test]
fn open_with_another_argument_does_not_open() {
    let mut host = Host::new();
    for sync in SYNC {
        host.send_bare(sync.id);
    }
    host.send_int(command::OPEN, 0);
    host.run_ms(20);
    assert_eq!((host.ids(), host.link().out_of_turn), (vec![0, 1, 2], 1));
}

#[test]
fn each_sync_may_be_repeated_and_sync0_begins_anew() {
    let mut host = Host::new();
    let mut answers = Vec::new();
    for number in [0, 0, 1, 1, 1, 0, 1, 2, 2, 0, 1, 2] {
        host.send_bare(number);
        host.run_ms(10);
        answers.extend(host.ids());
    }
    assert_eq!(answers, [0, 0, 1, 1, 1, 0, 1, 2, 2, 0, 1, 2]);
    assert_eq!(host.link().out_of_turn, 0);
}

#[test]
fn syncs_out_of_order_and_commands_before_open_have_no_answer_and_are_counted() {
    let mut host = Host::new();
    // SYNC1, SYNC2 and an arm command with no session; SYNC2 right after SYNC0.
    for (number, answered) in [(1, false), (2, false), (70, false), (0, true), (2, false)] {
        host.send_bare(number);
        host.run_ms(10);
        assert_eq!(!host.ids().is_empty(), answered, "{number}");
    }
    assert_eq!(host.link().out_of_turn, 4);
    host.send(ArmCommand::Power(true));
    host.run_ms(200);
    assert_eq!((host.ids(), host.pulses()), (vec![], NO_PULSES));
    // None of it is in the way of a session.
    host.open();
}

#[test]
fn garbage_between_the_syncs_is_skipped() {
    let mut host = Host::new();
    for number in 0..3 {
        host.send_bytes(&[0xFA, 0x00, 0xFB, 0xFA, 0xFA, 0xFB, 2, 9]);
        host.send_bare(number);
        host.run_ms(10);
        assert_eq!(host.ids(), [number]);
    }
    // A start that claims 249 bytes holds up what follows, until the line has paused for 100 ms.
    host.send_bytes(&[0xFA, 0xFB, 249]);
    host.send_int(command::OPEN, 1);
    host.run_ms(90);
    assert!(host.ids().is_empty());
    host.run_ms(20);
    assert_eq!(host.ids(), [Standard::ID]);
    assert_eq!((host.link().link.bad_frames, host.link().out_of_turn), (4, 0));
}

#[test]
fn status_is_answered_within_100_ms_and_info_within_300_at_any_time_and_any_speed() {
    for line_rate in [9600, 115_200] {
        let mut host = Host::with(Make { line_rate, ..Make::default() });
        host.open_blindly();
        host.run_alive_ms(500);
        for offset in (0..100).step_by(3) {
            host.run_alive_ms(400 + offset);
            host.received();
            let asked = Instant::now();
            host.send(ArmCommand::Status(StatusRequest::Once));
            host.send(ArmCommand::Info);
            host.run_ms(400);
            let packets = host.received();
            let delay = |id| {
                let mut of = packets.iter().filter(|packet| packet.id == id);
                let first = of.next().expect("an answer");
                assert_eq!(of.next(), None, "one answer");
                (first.at - asked).as_millis()
            };
            let (status, info) = (delay(ArmStatus::ID), delay(ArmInfo::ID));
            assert!(status < 100 && info < 300, "{status} ms, {info} ms at {line_rate} baud");
        }
    }
}

#[test]
fn a_host_that_releases_a_packet_with_the_next_one_has_its_status_in_time_too() {
    let mut host = Host::opened();
    for offset in (0..100).step_by(3) {
        host.run_alive_ms(200 + offset);
        host.received();
        let asked = Instant::now();
        host.send(ArmCommand::Status(StatusRequest::Once));
        host.run_ms(150);
        let packets = host.received();
        let at = packets.iter().position(|packet| packet.id == ArmStatus::ID).unwrap();
        let next = &packets[at + 1];
        assert_eq!(next.id, Standard::ID);
        // The standard packet is 2.2 ms long; it is its beginning that counts.
        let delay = (next.at - asked).as_micros() as i64 - 2200;
        assert!(delay <= 100_000, "{delay} us");
    }
}

#[test]
fn status_2_brings_an_armpac_before_every_standard_packet_until_it_is_stopped() {
    const BOTH: [u8; 2] = [ArmStatus::ID, Standard::ID];
    let mut host = Host::opened();
    host.run_ms(50);
    host.send(ArmCommand::Status(StatusRequest::Stream));
    host.run_ms(1000);
    let packets = host.received();
    // One at once, which serves the cycle under way; then a pair for each of nine cycles.
    assert_eq!([packets[0].id, packets[1].id], BOTH);
    assert_eq!(packets.len(), 20);
    for pair in packets[2..].chunks(2) {
        assert_eq!([pair[0].id, pair[1].id], BOTH);
        assert!((pair[1].at - pair[0].at).as_millis() <= 3, "of one cycle");
    }
    host.send(ArmCommand::Status(StatusRequest::Stop));
    host.run_ms(5);
    host.received();
    host.run_ms(500);
    assert_eq!(host.ids(), [Standard::ID; 5]);

    // The latest counts: one more, and the stream is over.
    host.send(ArmCommand::Status(StatusRequest::Stream));
    host.run_ms(500);
    host.received();
    host.send(ArmCommand::Status(StatusRequest::Once));
    host.run_ms(500);
    assert_eq!(host.ids().iter().filter(|&&id| id == ArmStatus::ID).count(), 1);
}

#[test]
fn a_host_that_floods_the_line_with_questions_still_gets_every_kind_of_answer() {
    let mut host = Host::with(Make { line_rate: 9600, ..Make::default() });
    host.open_blindly();
    host.run_ms(200);
    for questions in [
        &[ArmCommand::Status(StatusRequest::Once)][..],
        &[ArmCommand::Info],
        &[ArmCommand::Status(StatusRequest::Stream), ArmCommand::Info],
    ] {
        let mut ids = Vec::new();
        host.received();
        for _ in 0..500 {
            while host.board.line.backlog() < 60 {
                questions.iter().for_each(|&question| host.send(question));
            }
            host.run_ms(10);
            ids.extend(host.ids());
        }
        let share = |id| ids.iter().filter(|&&other| other == id).count();
        let standard = share(Standard::ID);
        assert!((40..=51).contains(&standard), "{standard} in 5 s, after {questions:?}");
        if questions.len() == 2 {
            let (status, info) = (share(ArmStatus::ID), share(ArmInfo::ID));
            assert!(status >= 40 && info >= 20, "{status} and {info}");
        }
    }
}

#[test]
fn info_tells_the_calibration_and_the_speeds_as_they_are() {
    let mut host = Host::opened();
    host.speed(2, 40);
    host.send(ArmCommand::Info);
    host.run_ms(20);
    let info = host.heard(ArmInfo::ID);
    let version = concat!("Open arm ", env!("CARGO_PKG_VERSION"));
    // Table 3, with n = 2 + the version's length as the place of its NUL.
    let n = 2 + version.len();
    assert_eq!(&info.bytes[2..6], [n as u8 + 39, 161, b'O', b'p']);
    assert_eq!((info.bytes[2 + n], info.bytes[2 + n + 1]), (0, 6));
    let row = |ms| [ms, 127, 0, 127, 255, 140];
    let rows = [row(20), row(40), row(20), row(20), row(20), row(20)].concat();
    assert_eq!(info.bytes[2 + n + 2..2 + n + 38], rows);
    assert_eq!(info.bytes.len(), 2 + n + 40);
    let Some(ArmInfo::Arm { joints, .. }) = ArmInfo::parse(&info.packet()) else { panic!() };
    assert_eq!(joints[1], JointInfo { ms_per_tick: 40, ..joints[0] });
}

#[test]
fn armpac_tells_motion_and_power_in_the_dialect_of_the_settings() {
    for (dialect, off, on) in
        [(0, [2, 0], [3, 0b1000]), (1, [2, 0], [3, 0b100]), (2, [0, 0b0011], [0b1000, 0b0111])]
    {
        let mut make = Make::default();
        make.settings.arm.dialect = dialect;
        let mut host = Host::with(make);
        host.open();
        assert_eq!(host.status_bytes(), [&off[..], &[127; 6]].concat(), "{dialect}");
        host.send(ArmCommand::Power(true));
        host.go(3, 227);
        host.run_alive_ms(110);
        let status = host.status_bytes();
        assert_eq!(status[..2], on, "{dialect}");
        assert!((130..=134).contains(&status[4]), "{status:?}");
        // On its way home, which ARIA can tell.
        host.send(ArmCommand::Home(ALL));
        let homing = if dialect == 2 { [0b1000, 0b1111] } else { on };
        assert_eq!(host.status_bytes()[..2], homing, "{dialect}");
    }
}

#[test]
fn any_packet_is_a_sign_of_life_and_two_seconds_without_one_are_silence() {
    let mut host = Host::opened();
    for _ in 0..5 {
        host.run_ms(1900);
        host.send_bare(command::PULSE);
    }
    for _ in 0..5 {
        host.run_ms(1900);
        host.send_bare(18); // CONFIG: not answered, but heard
    }
    host.see(Silent, |host| host.link().watchdogs, [(1990, 0), (2010, 1)]);
    // Silence is counted once, however long it is.
    host.run_ms(10_000);
    assert_eq!(host.link().watchdogs, 1);
}

#[test]
fn the_standard_packets_go_on_for_a_host_that_waits_for_one_before_it_speaks() {
    let mut host = Host::powered();
    host.send(ArmCommand::Status(StatusRequest::Stream));
    host.run_ms(2500);
    host.received();
    assert_eq!(host.link().watchdogs, 1);
    // Minutes later too, and what it has asked for comes with them.
    for ms in [10_000, 300_000] {
        host.run_ms(ms);
        let ids = host.ids();
        let standard = ids.iter().filter(|&&id| id == Standard::ID).count() as u64;
        assert!((ms / 100 - 1..=ms / 100 + 1).contains(&standard), "{standard} in {ms} ms");
        assert_eq!(ids.len() as u64, 2 * standard, "an ARMpac with each");
    }
    // It speaks in the session that it has.
    host.go(1, 130);
    host.run_ms(200);
    assert_eq!((host.ticks(1), host.link().opened, host.link().ignored), (130, 1, 0));
}
#[test]
fn commands_of_the_robots_base_are_counted_and_have_no_effect() {
    let mut host = Host::opened();
    let before = host.board.plant.borrow().outputs;
    // From 96 to 101, and 103, it is the extension's.
    for number in (3..70).chain(82..96).chain([102]).chain(104..=255) {
        host.send_int(number, 100);
    }
    host.run_ms(500);
    assert_eq!(host.link().link.unknown, 67 + 14 + 153);
    assert_eq!((host.link().link.refused, host.board.plant.borrow().outputs), (0, before));
    assert_eq!(host.ids(), [Standard::ID; 5]);
}

#[test]
fn a_host_that_dies_in_mid_move_leaves_an_arm_that_stops_holds_and_is_parked_by_autopark() {
    let mut host = Host::powered();
    host.send(ArmCommand::AutoPark(60));
    host.speed(1, 40);
    host.speed(2, 1);
    host.go(1, 227);
    host.go(2, 27);
    let mut watch = NoJump::new(&host);
    let mut run = |host: &mut Host, ms| host.run_with(Silent, ms, |host| watch.look(host));
    // Joint 1 is on its way, joint 2 has arrived.
    run(&mut host, 1990);
    assert_eq!((host.ticks(1), host.ticks(2), host.link().watchdogs), (176, 27, 0));
    assert!(host.arm().moving[0]);
    run(&mut host, 20);
    let rests = host.arm();
    assert_eq!((host.link().watchdogs, rests.moving, rests.powered), (1, [false; 6], true));
    assert!((176..=177).contains(&host.ticks(1)));
    // The controller has noticed the silence too, and both hold.
    run(&mut host, 59_000);
    assert!(host.board.snapshot().link_loss);
    assert_eq!(host.arm(), rests);
    assert_eq!((host.pulses()[0], host.pulses()[1]), (Some(pulse(host.ticks(1))), Some(pulse(27))));
    // A minute after the last step: home no faster than 20 ms a tick, and off.
    run(&mut host, 2000);
    assert!(host.arm().homing && host.arm().powered);
    run(&mut host, 3000);
    assert_eq!((host.arm().powered, host.arm().positions), (false, [127; 6]));
    assert_eq!(host.pulses(), NO_PULSES);
    assert!((host.servo(1) - 3375.0).abs() < 1.0 && (host.servo(2) - 3375.0).abs() < 1.0);
}

#[test]
fn what_goes_home_to_be_switched_off_goes_on_when_the_host_falls_silent() {
    for last in [ArmCommand::Park, ArmCommand::Power(false), ArmCommand::Init] {
        let mut host = Host::powered();
        host.go(1, 227);
        host.run_alive_ms(3000);
        host.speed(1, 40);
        host.send(last);
        host.run_ms(2100);
        assert!(host.link().watchdogs == 1 && host.arm().homing && host.arm().powered, "{last:?}");
        host.run_ms(2100);
        assert_eq!((host.arm().powered, host.ticks(1)), (false, 127), "{last:?}");
    }
}

#[test]
fn however_soon_the_controller_calls_a_host_silent_joints_go_on_for_two_seconds_and_home_to_the_end()
 {
    let mut make = Make::default();
    make.settings.control.link_timeout = 1;
    let mut host = Host::with(make);
    host.open();
    host.power_up();
    host.speed(1, 40);
    host.go(1, 227);
    host.run_ms(1990);
    assert!(host.board.snapshot().link_loss);
    assert_eq!((host.ticks(1), host.link().watchdogs), (176, 0));
    host.run_ms(1000);
    let held = host.pulses()[0];
    assert_eq!((held, host.link().watchdogs), (Some(pulse(177)), 1));
    host.send(ArmCommand::Park);
    host.see(Silent, |host| host.arm().powered, [(2000, true), (2040, true), (2070, false)]);
    assert_eq!((host.ticks(1), host.link().watchdogs), (127, 2));
}

#[test]
fn a_host_that_comes_back_after_the_silence_takes_over_an_arm_that_holds() {
    let mut host = Host::powered();
    host.speed(1, 40);
    host.go(1, 227);
    host.send(ArmCommand::Status(StatusRequest::Stream));
    host.run_ms(2500);
    let held = host.arm();
    host.received();
    // SYNC0 is echoed, and may be repeated; the packets go on.
    for _ in 0..3 {
        host.send_bare(0);
        host.run_ms(500);
        let ids = host.ids();
        assert_eq!(ids.iter().filter(|&&id| id == 0).count(), 1, "{ids:?}");
        assert_eq!(ids.iter().filter(|&&id| id == Standard::ID).count(), 5, "{ids:?}");
    }
    // SYNC1 behind it begins a new session: nothing of the old one comes any more.
    host.send_bare(1);
    host.run_ms(500);
    assert_eq!(host.ids(), [1]);
    host.send_bare(2);
    host.run_ms(10);
    assert_eq!(host.ids(), [2]);
    host.send_int(command::OPEN, 1);
    host.run_ms(500);
    assert_eq!(host.ids(), [Standard::ID; 5], "and no ARMpacs");
    assert_eq!((host.link().opened, host.link().out_of_turn, host.arm()), (2, 0, held));
    // The speed is as it was.
    host.go(1, 227);
    let before = host.ticks(1);
    host.run_alive_ms(400);
    assert!((9..=10).contains(&(host.ticks(1) - before)), "{} to {}", before, host.ticks(1));
}

#[test]
fn a_zero_after_the_silence_that_was_only_a_pulse_leaves_the_session_as_it_is() {
    let mut host = Host::powered();
    host.send(ArmCommand::AutoPark(60));
    for silence in 1..=2 {
        host.run_ms(2100);
        host.received();
        host.send_bare(command::PULSE);
        host.run_ms(10);
        assert_eq!(host.ids().iter().filter(|&&id| id == 0).count(), 1);
        // A command behind it settles the matter: 1 is OPEN again, and has no answer.
        host.go(1, 130);
        host.send_bare(command::OPEN);
        host.run_alive_ms(500);
        assert!(!host.ids().contains(&1));
        assert_eq!((host.link().watchdogs, host.link().opened), (silence, 1));
    }
    // Without a 0 before it, or with an argument, it is OPEN too.
    host.run_ms(2100);
    host.received();
    host.send_bare(1);
    host.run_ms(2100);
    host.send_bare(0);
    host.send_int(1, 1);
    host.run_ms(500);
    let ids = host.ids();
    assert!(!ids.contains(&1) && ids.contains(&Standard::ID), "{ids:?}");
    assert_eq!((host.ticks(1), host.arm().powered, host.link().out_of_turn), (130, true, 0));
}

#[test]
fn zeros_without_end_after_a_silence_keep_no_standard_packet_from_the_line() {
    let mut host = Host::with(Make { line_rate: 9600, ..Make::default() });
    host.open_blindly();
    host.run_ms(2500);
    host.received();
    for _ in 0..200 {
        while host.board.line.backlog() < 60 {
            host.send_bare(0);
        }
        host.run_ms(10);
    }
    let ids = host.ids();
    let standard = ids.iter().filter(|&&id| id == Standard::ID).count();
    assert!((18..=21).contains(&standard), "{standard} in 2 s");
}

#[test]
fn a_handshake_that_is_not_finished_is_forgotten_and_leaves_the_arm_as_it_is() {
    let mut host = Host::powered();
    host.send(ArmCommand::AutoPark(10));
    host.go(1, 130);
    host.run_ms(2500);
    host.send_bare(0);
    host.send_bare(1);
    host.run_ms(2100);
    host.received();
    host.run_ms(1000);
    assert_eq!((host.ids(), host.ticks(1), host.arm().powered), (vec![], 130, true));
    // The times of the session that is over are forgotten: not the 10 s, but the 600.
    host.run_ms(500_000);
    assert!(host.arm().powered);
    host.run_ms(110_000);
    assert_eq!((host.arm().powered, host.ticks(1)), (false, 127));
    host.received();
    host.open();
}
#[test]
fn close_parks_the_arm_and_a_new_session_has_the_default_times() {
    let mut host = Host::powered();
    host.send(ArmCommand::AutoPark(1));
    host.go(4, 157);
    host.run_alive_ms(650);
    host.send_bare(command::CLOSE);
    host.run_ms(300);
    assert!(host.arm().homing && host.arm().powered);
    host.run_ms(400);
    assert_eq!((host.pulses(), host.arm().powered), (NO_PULSES, false));

    host.received();
    host.open();
    host.send(ArmCommand::Power(true));
    host.run_alive_ms(5000);
    assert!(host.arm().powered, "not the one second of the session before");
}

#[test]
fn a_host_that_restarts_in_its_live_session_has_no_answer_until_it_closes_that() {
    let mut host = Host::powered();
    host.go(1, 227);
    host.run_ms(1900);
    host.received();
    // Its SYNC0s are PULSEs: for all of 10 s the session lives and the arm goes on.
    for _ in 0..20 {
        host.send_bare(0);
        host.run_ms(500);
        assert_eq!(host.ids(), [Standard::ID; 5]);
    }
    assert_eq!((host.link().watchdogs, host.link().out_of_turn), (0, 0));
    assert_eq!((host.ticks(1), host.arm().powered), (227, true));
    host.send_bare(command::CLOSE);
    host.run_ms(10);
    host.received();
    assert!(host.arm().homing);
    host.open();
    assert_eq!(host.link().opened, 2);
    // The arm is still on its way home, as after any CLOSE, and the new host may take it over.
    assert!(host.arm().homing && host.arm().powered);
}

#[test]
fn a_host_that_goes_through_all_its_syncs_in_a_live_session_ends_it_with_sync2() {
    let mut host = Host::powered();
    host.go(1, 227);
    host.run_ms(500);
    host.received();
    for sync in SYNC {
        host.send_bare(sync.id);
        host.run_ms(10);
    }
    assert!(host.ids().is_empty(), "none is answered, and CLOSE ends the rest");
    assert_eq!((host.link().watchdogs, host.arm().homing), (0, true));
    host.open();
}

#[test]
fn a_host_that_restarts_and_waits_for_two_seconds_is_answered() {
    let mut host = Host::powered();
    host.run_ms(1000);
    host.send_bare(0);
    host.run_ms(1990);
    host.received();
    assert_eq!((host.link().watchdogs, host.arm().powered), (0, true));
    host.run_ms(20);
    host.open();
    assert_eq!((host.link().watchdogs, host.link().opened), (1, 2));
}
