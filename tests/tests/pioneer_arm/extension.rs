//! The board's settings, health and faults in ARCOS packets: byte by byte against the table of
//! `protocol::arcos::extension`, and what comes of each request.

use super::*;
use firmware::channel::Scope;
use firmware::command::Command;
use firmware::controller::Snapshot;
use firmware::personality::{Boot, Effect, Session};
use firmware::settings::Settings;
use firmware::units::ServoPulse;
use hal_mock::flash::Flash;
use protocol::arcos::{ArmInfo, extension};
use protocol::extension::{
    Action, Answer, Assignments, Fault, Health, Latched, Origin, Outcome, Refusals, Request,
    ResetCause, VERSION, Verdict,
};
use protocol::pms5005::Repeat;
use tests::extension::assign;

/// The numbers of joint 1's home, lowest and highest position.
const HOME: u16 = 129;
const MIN: u16 = 130;
const MAX: u16 = 132;

/// The packet of a request; what it asks is what the board reads in it.
fn written(request: Request<'_>) -> Vec<u8> {
    let bytes = extension::encode_request(&request, &mut [0; 200]).unwrap().to_vec();
    let packet = Packet::parse(&bytes).unwrap();
    assert_eq!(extension::parse_request(&packet), Some(Ok(request)));
    bytes
}

#[test]
fn requests_byte_by_byte() {
    let data = assign(&[(32, 20)]);
    let set = Request::Set(Assignments::parse(&data).unwrap());
    for (request, bytes) in [
        (Request::Setting(32), &[0xFA, 0xFB, 7, 96, 0x2B, 2, 32, 0, 0x62, 0x4B][..]),
        (Request::Identity, &[0xFA, 0xFB, 5, 97, 0x2B, 0, 0x61, 0x2B]),
        (Request::Health(Repeat::Continuous), &[0xFA, 0xFB, 5, 98, 0x2B, 0, 0x62, 0x2B]),
        (Request::Health(Repeat::Stop), &[0xFA, 0xFB, 6, 98, 0x2B, 1, 0, 0x63, 0x2B]),
        (Request::Counters, &[0xFA, 0xFB, 5, 99, 0x2B, 0, 0x63, 0x2B]),
        (Request::Fault(3), &[0xFA, 0xFB, 6, 100, 0x2B, 1, 3, 0x65, 0x2E]),
        (Request::Do(Action::Save), &[0xFA, 0xFB, 6, 101, 0x2B, 1, 0x82, 0x66, 0xAD]),
        (set, &[0xFA, 0xFB, 12, 101, 0x2B, 7, 0x80, 32, 0, 20, 0, 0, 0, 0xA0, 0xAB]),
    ] {
        assert_eq!(written(request), bytes, "{request:?}");
    }
    // No argument at all, and a type byte with nothing behind it, are no bytes too.
    for data in [&[][..], &[0x2B]] {
        let identity = Packet { id: 97, data };
        assert_eq!(extension::parse_request(&identity), Some(Ok(Request::Identity)));
    }
    for id in [95, 102, 111] {
        assert_eq!(extension::parse_request(&Packet { id, data: &[] }), None, "{id}");
    }
}

#[test]
fn answers_are_the_pms5005s_data_in_packets_of_the_same_number() {
    let outcome = Outcome { did: 7, first: 0x82, verdict: Verdict::Done, setting: 0 };
    let health =
        Health { uptime_ms: 1, worst_latency_us: 2, stack_used: 3, faults: 4, periods_missed: 5 };
    for (answer, bytes) in [
        (Answer::Outcome(outcome), &[0xFA, 0xFB, 8, 101, 7, 0x82, 0, 0, 0, 0xE7, 0x07][..]),
        (
            Answer::Health(health),
            &[0xFA, 0xFB, 16, 98, 1, 0, 0, 0, 2, 0, 3, 0, 4, 5, 0, 0, 0, 0x67, 0x0A],
        ),
    ] {
        let mut out = [0; 200];
        let packet = extension::encode_answer(&answer, &mut out).unwrap();
        assert_eq!(packet, bytes);
        let packet = Packet::parse(packet).unwrap();
        assert_eq!(Answer::parse(packet.id, packet.data), Some(answer));
    }
}

#[test]
fn a_host_reads_sets_saves_and_has_its_settings_after_a_restart_and_no_joint_jumps_for_it() {
    let flash = Flash::empty();
    let mut host = Host::with_flash(Make::default(), flash.clone());
    host.open();
    assert_eq!((host.value(0), host.value(HOME), host.value(112)), (2000, 127, 0));
    host.power_up();
    let mut watch = NoJump::new(&host);
    let ours = [(112, 2), (HOME, 100), (MIN, 50), (MAX, 200), (133, 90)];
    assert_eq!(host.set(&ours), (Verdict::Done, 0));
    assert_eq!(host.value(HOME), 100, "told at once");
    host.send(ArmCommand::Home(ALL));
    host.go(1, 210);
    host.run_alive_with(2000, |host| watch.look(host));
    assert_eq!((host.ticks(1), host.pulses()[0]), (210, Some(pulse(210))), "in force later");

    let upkeep = [Action::Save, Action::FactoryReset, Action::Reboot, Action::RebootIntoDfu];
    for action in upkeep {
        assert_eq!(host.act(action), Verdict::OutputsOn, "{action:?} with servo power");
    }
    assert_eq!(flash.image(), Flash::empty().image());
    host.send(ArmCommand::Park);
    host.run_alive_with(2500, |host| watch.look(host));
    assert_eq!(host.act(Action::Save), Verdict::Done);
    assert_eq!(host.act(Action::RebootIntoDfu), Verdict::NotAvailable);
    assert_eq!(host.act(Action::Reboot), Verdict::Done);
    host.run_ms(150);

    host.received();
    host.open();
    assert_eq!(
        host.ask_raw(97, &[]).1[3..],
        [VERSION, ResetCause::Software as u8, Origin::Stored as u8]
    );
    host.received();
    host.send(ArmCommand::Info);
    host.run_ms(20);
    let info = host.heard(ArmInfo::ID);
    let Some(ArmInfo::Arm { joints, .. }) = ArmInfo::parse(&info.packet()) else { panic!() };
    let joint = joints[0];
    assert_eq!((joint.home, joint.min, joint.max, joint.ticks_per_90), (100, 50, 200, 90));
    assert_eq!((joints[1].home, joints[1].max), (127, 255));
    // Good and initialised: ARIA's dialect.
    assert_eq!(host.status_bytes(), [0, 0b11, 100, 127, 127, 127, 127, 127]);
    host.power_up();
    assert_eq!(host.pulses()[0], Some((3375 - 27 * 2250 / 90) as u16));

    // Another board with the same flash; then the defaults again.
    let mut host = Host::with_flash(Make::default(), flash.clone());
    host.open();
    assert_eq!((host.value(HOME), host.ticks(1)), (100, 100));
    assert_eq!(host.act(Action::FactoryReset), Verdict::Done);
    assert_eq!(host.value(HOME), 127);
    let mut host = Host::with_flash(Make::default(), flash);
    host.open();
    assert_eq!(host.ticks(1), 127);
}

#[test]
fn bad_requests_change_nothing_are_counted_and_told_why() {
    let mut host = Host::opened();
    let cut_short = &assign(&[(HOME, 100)])[..6];
    for (number, text, verdict, setting) in [
        (101, &assign(&[(HOME, 100), (999, 1)])[..], Verdict::NoSuchSetting, 999),
        (101, &assign(&[(HOME, 100), (MIN, 256)]), Verdict::OutOfRange, MIN),
        (101, &assign(&[(HOME, 100), (MIN, 101)]), Verdict::Contradiction, HOME),
        (101, cut_short, Verdict::BadLength, 0),
        (101, &[0x86], Verdict::BadLength, 0),
        (101, &[0x87], Verdict::Unknown, 0),
        // The manual's parameters are no arm's.
        (101, &[6, 0, 1], Verdict::Unknown, 0),
        (101, &[], Verdict::Unknown, 0),
        (96, &[], Verdict::BadLength, 0),
        (96, &[15, 0], Verdict::NoSuchSetting, 15),
        (97, &[0], Verdict::BadLength, 0),
        (98, &[1, 1], Verdict::BadLength, 0),
        (100, &[], Verdict::BadLength, 0),
        (103, &[1], Verdict::BadLength, 0),
    ] {
        let before = host.link().link.refused;
        assert_eq!(host.outcome(number, text), (verdict, setting), "{number} {text:?}");
        assert_eq!(host.link().link.refused - before, 1, "{number} {text:?}");
    }
    // Arguments of other types, and what is none.
    for data in [&[0x3B, 1, 0][..], &[0x1B, 1, 0], &[0x2B, 2, 0], &[0xAA]] {
        for id in 96..=101 {
            host.received();
            host.send_bytes(Packet { id, data }.encode(&mut [0; 20]).unwrap());
            host.run_ms(40);
            let told = host.heard(101);
            let did = if id == 101 { 7 } else { id };
            let bad = Verdict::BadLength.number();
            assert_eq!(told.packet().data, [did, 0, bad, 0, 0], "{id} {data:02x?}");
        }
    }
    assert_eq!((host.value(HOME), host.value(MIN)), (127, 0));
    assert_eq!(host.link().link.unknown, 0);
    // By reason; an order to an arm without power is none of the packets above.
    host.send(ArmCommand::Home(Joints::All));
    host.run_ms(20);
    let (told, data) = host.ask_raw(103, &[]);
    let Some(Answer::Refusals(refusals)) = Answer::parse(told, &data) else { panic!() };
    let Refusals { length, sub_command, setting, not_now, .. } = refusals;
    assert_eq!((length, sub_command, setting, not_now), (7 + 24, 3, 4, 1));
    // The machine state is not an arm's.
    host.send_bytes(Packet { id: 102, data: &[] }.encode(&mut [0; 20]).unwrap());
    host.run_ms(40);
    assert_eq!(host.link().link.unknown, 1);
}

#[test]
fn health_comes_at_once_and_then_once_a_cycle_as_often_as_it_is_asked_for() {
    let mut host = Host::opened();
    let count = |host: &mut Host, ms| {
        host.received();
        host.run_alive_ms(ms);
        host.ids().iter().filter(|&&id| id == 98).count()
    };
    let ask = |host: &mut Host, repeat| host.send_bytes(&written(Request::Health(repeat)));
    ask(&mut host, Repeat::Times(3.try_into().unwrap()));
    assert_eq!((count(&mut host, 15), count(&mut host, 1000)), (1, 2));
    ask(&mut host, Repeat::Continuous);
    assert_eq!(count(&mut host, 1005), 11);
    ask(&mut host, Repeat::Stop);
    assert_eq!(count(&mut host, 1000), 0);
    // The next host has not asked.
    ask(&mut host, Repeat::Continuous);
    host.run_ms(50);
    host.send_bare(command::CLOSE);
    host.run_ms(100);
    host.received();
    host.open();
    assert_eq!(count(&mut host, 1000), 0);
    host.send_bytes(&written(Request::Health(Repeat::Times(1.try_into().unwrap()))));
    host.run_ms(20);
    let told = host.heard(98);
    let Packet { id, data } = told.packet();
    let Some(Answer::Health(health)) = Answer::parse(id, data) else { panic!() };
    let now = Instant::now().as_millis() as u32;
    assert!((now - 25..=now).contains(&health.uptime_ms), "{health:?} at {now}");
    assert_eq!(health.faults, 0);
}

#[test]
fn a_fault_is_told_with_its_values_and_can_be_cleared_but_the_arm_still_needs_init() {
    let mut host = Host::powered();
    let none = Latched { place: 0, total: 0, record: None };
    assert_eq!(host.fault(0), none);
    host.board.plant.borrow_mut().overrides.battery[2] = Some(1700);
    host.run_alive_ms(1100);
    let record = host.fault(0).record.unwrap();
    assert_eq!((record.fault, record.channel), (Fault::ServoBatteryLow, None));
    assert_eq!(record.values, [1700, 0, 0]);
    assert!((1000..1200).contains(&record.uptime_ms), "{record:?}");
    assert_eq!(host.fault(1), Latched { place: 1, total: 1, record: None });
    host.board.plant.borrow_mut().overrides.battery[2] = None;
    host.run_alive_ms(100);
    assert_eq!(host.act(Action::ClearFaults), Verdict::Done);
    assert_eq!(host.fault(0), none);
    host.send(ArmCommand::Power(true));
    host.run_alive_ms(50);
    assert!(!host.arm().powered && host.arm().good && !host.arm().initialised);
    host.send(ArmCommand::Init);
    host.run_alive_ms(750);
    host.power_up();
    assert_eq!(host.pulses(), AT_HOME);
}

#[test]
fn a_trip_that_is_cleared_before_the_arm_looks_has_taken_the_power_all_the_same() {
    for phase in 0..20 {
        let mut host = Host::powered();
        host.run_alive_ms(phase);
        host.board.plant.borrow_mut().overrides.battery[2] = Some(1700);
        // A host that clears in every period, from before the trip until its cause is gone.
        for ms in 0..1200 {
            if ms == 1050 {
                host.board.plant.borrow_mut().overrides.battery[2] = None;
            }
            if ms >= 950 {
                host.send_bytes(&written(Request::Do(Action::ClearFaults)));
            }
            host.run_alive_ms(1);
        }
        assert_eq!(host.pulses(), NO_PULSES, "it has tripped");
        assert!(host.board.snapshot().faults.iter().next().is_none(), "and was cleared");
        host.go(2, 200);
        host.run_alive_ms(100);
        assert_eq!((host.pulses(), host.link().power_lost), (NO_PULSES, 1), "phase {phase}");
        assert!(!host.arm().powered && !host.arm().initialised, "phase {phase}");
        host.send(ArmCommand::Init);
        host.run_alive_ms(750);
        host.send(ArmCommand::Power(true));
        host.run_alive_ms(100);
        assert_eq!((host.pulses(), host.arm().powered), (AT_HOME, true), "phase {phase}");
    }
}

#[test]
fn pulses_that_an_upkeep_holds_back_are_not_lost_and_those_that_go_missing_for_20_ms_are() {
    let start = Instant::from_secs(1);
    let at = |ms| start + Duration::from_millis(ms);
    let mut session = PioneerArm::new(Settings::DEFAULT, Boot::default(), start);
    let mut snapshot = Snapshot::BOOT;
    snapshot.sensors.gpio_in = 0xFE; // the arm is there
    let ask = |session: &mut PioneerArm, bytes: &[u8], ms, snapshot: &Snapshot| {
        let mut bytes = bytes;
        while session.receive(&mut bytes, at(ms)).is_some() {}
        while session.advance(at(ms), || *snapshot).is_some() {}
        (session.counters().arm.powered, session.counters().power_lost)
    };
    let open =
        Packet { id: command::OPEN, data: &[0x3B, 1, 0] }.encode(&mut [0; 9]).unwrap().to_vec();
    for sync in SYNC.into_iter().map(|sync| Packet { id: sync.id, data: &[] }) {
        ask(&mut session, sync.encode(&mut [0; 6]).unwrap(), 0, &snapshot);
    }
    ask(&mut session, &open, 0, &snapshot);
    // A save that takes as long as an erase may, and power behind it in one write.
    let mut both = written(Request::Do(Action::Save));
    both.extend_from_slice(ArmCommand::Power(true).encode(&mut [0; 9]).unwrap());
    ask(&mut session, &both, 0, &snapshot);
    for ms in 0..1900 {
        assert_eq!(ask(&mut session, &[], ms, &snapshot), (true, 0), "{ms}");
    }
    session.upkeep_done(Ok(()));
    for ms in 1900..1920 {
        assert_eq!(ask(&mut session, &[], ms, &snapshot), (true, 0), "{ms}");
    }
    let pulse = ServoPulse::from_raw(3375);
    snapshot.outputs.servos = [Some(pulse); 6];
    for ms in 1920..1940 {
        assert_eq!(ask(&mut session, &[], ms, &snapshot), (true, 0), "{ms}");
    }
    // One of them is enough, and the others' pulses are taken then. The arm looks every 20 ms.
    snapshot.outputs.servos[3] = None;
    let off = Effect::Control(Command::Run { scope: Scope::All, run: false });
    let taken_at = (1940..).find(|&ms| session.advance(at(ms), || snapshot) == Some(off));
    assert!((1960..=1980).contains(&taken_at.unwrap()), "{taken_at:?}");
    assert_eq!(ask(&mut session, &[], 1980, &snapshot), (false, 1));
}

#[test]
fn counters_are_what_the_session_has_counted() {
    let mut host = Host::opened();
    host.send_bare(200);
    host.send_int(command::STATUS, 9);
    host.send(ArmCommand::Home(ALL));
    host.run_ms(20);
    let (id, data) = host.ask_raw(99, &[]);
    let answer = Answer::parse(id, &data);
    let Some(Answer::Counters(counters)) = answer else { panic!("{answer:?}") };
    let link = host.link();
    assert_eq!((counters.unknown, counters.refused), (1, 2));
    assert_eq!((counters.frames_ok, counters.answers_sent), (link.link.frames_ok, 1));
    assert!(counters.telemetry_sent > 0 && counters.acks_sent == 0);
}

#[test]
fn outside_a_session_the_extension_is_silent_and_what_it_owes_is_forgotten() {
    let mut host = Host::new();
    host.send_bytes(&written(Request::Identity));
    host.run_ms(100);
    assert_eq!((host.ids(), host.link().out_of_turn), (vec![], 1));
    host.open();
    (0..5).for_each(|_| host.send_bytes(&written(Request::Counters)));
    host.send_bytes(&written(Request::Fault(0)));
    host.send_bytes(&written(Request::Do(Action::Save)));
    host.send_bare(command::CLOSE);
    host.run_ms(200);
    host.received();
    host.open();
    host.run_alive_ms(500);
    assert_eq!(host.ids(), [Standard::ID; 5]);
    assert_eq!(host.fault(0).total, 0, "it can be asked for again");
}

#[test]
fn requests_faster_than_the_line_are_bounded_and_starve_nobody() {
    let make = Make { line_rate: 9600, ..Make::default() };
    let mut host = Host::with(make);
    host.run_ms(100);
    for sync in SYNC {
        host.send_bare(sync.id);
        host.run_ms(50);
    }
    host.send_int(command::OPEN, 1);
    host.run_ms(100);
    host.received();
    // What the line takes in ten seconds.
    for _ in 0..600 {
        host.send_bytes(&written(Request::Counters));
        host.send_int(command::STATUS, 1);
    }
    host.run_ms(10_000);
    let packets = host.received();
    let longest_gap = |id| {
        let times: Vec<_> = packets.iter().filter(|p| p.id == id).map(|p| p.at).collect();
        assert!(times.len() > 40, "{} packets {id}", times.len());
        times.windows(2).map(|pair| (pair[1] - pair[0]).as_millis()).max().unwrap()
    };
    assert!(longest_gap(ArmStatus::ID) <= 250 && longest_gap(99) <= 300);
    assert!(longest_gap(Standard::ID) <= 250);
    let link = host.link();
    assert!(link.link.answers_dropped > 0 && link.link.refused == 0);
}
