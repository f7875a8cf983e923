//! The session: who is acknowledged when, what telemetry comes, and what happens to both on a
//! line that is full.

use std::num::NonZeroU8;

use embassy_time::{Duration, Instant};
use firmware::controller::Snapshot;
use firmware::personality::Boot;
use firmware::personality::pms5005::Pms5005;
use firmware::personality::{MAX_FRAME, Session};
use firmware::settings::Settings;
use firmware::units::CountsPerSecond;
use hal_mock::board::Make;
use protocol::pms5005::{ACK, Command, Frame, Quantity, Repeat, Report, Reports, did};
use tests::Link::Silent;
use tests::{At, Bench, Received};

fn telemetry(reports: Reports, repeat: Repeat) -> Command<'static> {
    Command::Telemetry { reports, repeat }
}

fn times(count: u8) -> Repeat {
    Repeat::Times(NonZeroU8::new(count).unwrap())
}

/// When the frames of a DID came, in ms.
fn arrivals(frames: &[Received], did: u8) -> Vec<u64> {
    frames.iter().filter(|f| f.did == did && f.res == 255).map(|f| f.at.as_millis()).collect()
}

#[test]
fn at_boot_all_telemetry_comes_every_50_ms() {
    let mut bench = Bench::new();
    bench.run_ms(1020);
    let frames = bench.received();
    for did in [did::MOTORS, did::CUSTOM_IO, did::SENSORS] {
        let at = arrivals(&frames, did);
        assert_eq!(at.len(), 20, "DID {did}");
        assert!(at.windows(2).all(|pair| (49..=51).contains(&(pair[1] - pair[0]))), "{at:?}");
    }
    assert_eq!(frames.len(), 60, "and nothing else: {frames:?}");
}

#[test]
fn telemetry_comes_as_often_as_it_was_asked_for() {
    let mut bench = Bench::quiet();
    bench.send(telemetry(Reports::Sensors, times(3)));
    bench.run_ms(1000);
    let frames = bench.received();
    assert!(frames[0].is_ack(), "the acknowledgement comes first");
    let at = arrivals(&frames, did::SENSORS);
    assert_eq!(at.len(), 3);
    assert!(at.windows(2).all(|pair| (49..=51).contains(&(pair[1] - pair[0]))), "{at:?}");

    // 127 is the three of them; one of them can be stopped alone.
    bench.send(telemetry(Reports::All, Repeat::Continuous));
    bench.send(telemetry(Reports::CustomIo, Repeat::Stop));
    bench.run_ms(1000);
    let frames = bench.received();
    assert!((19..=21).contains(&arrivals(&frames, did::MOTORS).len()));
    assert!((19..=21).contains(&arrivals(&frames, did::SENSORS).len()));
    assert!(arrivals(&frames, did::CUSTOM_IO).len() <= 1);
    assert!(frames.iter().all(|frame| frame.did != did::ALL_REPORTS));
}

#[test]
fn asking_often_does_not_make_telemetry_come_more_often() {
    let mut bench = Bench::quiet();
    for _ in 0..100 {
        bench.send(telemetry(Reports::Motors, Repeat::Continuous));
        bench.run_ms(10);
    }
    let count = arrivals(&bench.received(), did::MOTORS).len();
    assert!((19..=21).contains(&count), "{count} in a second");
}

#[test]
fn the_telemetry_period_is_a_setting() {
    let mut make = Make::default();
    make.settings.link.telemetry_period_ms = 20;
    let mut bench = Bench::with(make);
    bench.run_ms(1010);
    assert_eq!(arrivals(&bench.received(), did::MOTORS).len(), 50);
}

#[test]
fn without_telemetry_a_ping_comes_at_least_once_a_second() {
    let mut bench = Bench::quiet();
    bench.run_ms(10_000);
    let frames = bench.received();
    assert!(frames.iter().all(|f| (f.rid, f.res, f.did, &f.data[..]) == (0, 0, 255, &[0])));
    let gaps: Vec<_> = frames.windows(2).map(|p| (p[1].at - p[0].at).as_millis()).collect();
    assert!((9..=12).contains(&gaps.len()) && gaps.iter().all(|gap| (800..=1000).contains(gap)));
}

#[test]
fn with_telemetry_no_ping_is_needed() {
    let mut bench = Bench::new();
    bench.run_ms(5020);
    let frames = bench.received();
    assert_eq!(frames.len(), 300, "three every 50 ms");
    assert!(frames.iter().all(|frame| frame.did != did::SETUP));
}

#[test]
fn a_frame_with_reserved_byte_255_is_carried_out_without_an_acknowledgement() {
    let mut bench = Bench::quiet();
    let mut buffer = [0; 16];
    let frame = Command::GpioOutputs(0xA5).encode(255, &mut buffer).unwrap();
    bench.board.line.host_sends(frame);
    bench.run_ms(20);
    assert_eq!(bench.acks(), 0);
    assert_eq!(bench.board.plant.borrow().outputs.gpio, 0xA5);
}

#[test]
fn pings_are_answered_at_once_but_what_may_be_an_ack_only_five_times_a_second() {
    let mut bench = Bench::quiet();
    for _ in 0..100 {
        bench.send(Command::Ping);
        bench.run_ms(10);
    }
    assert_eq!(bench.acks(), 100);
    for _ in 0..100 {
        bench.send(Command::PingOrAck);
        bench.run_ms(10);
    }
    assert_eq!(bench.acks(), 5);
}

/// A host that answers every frame it gets with 255/1. Frames a second, both directions together.
fn exchange(bench: &mut Bench, seconds: u64) -> (usize, usize) {
    let (mut ours, mut theirs) = (0, 0);
    for _ in 0..seconds * 1000 {
        bench.run_ms(1);
        for _ in bench.received() {
            ours += 1;
            theirs += 1;
            bench.send(Command::PingOrAck);
        }
    }
    (ours / seconds as usize, theirs / seconds as usize)
}

#[test]
fn a_host_that_answers_everything_does_not_start_an_avalanche() {
    let mut bench = Bench::quiet();
    bench.send(Command::GpioOutputs(1));
    let (ours, theirs) = exchange(&mut bench, 20);
    assert!((1..50).contains(&(ours + theirs)), "{ours} + {theirs} frames a second");

    // With all telemetry on these are 60 frames a second more each way, and no more than that.
    let mut bench = Bench::new();
    let (ours, _) = exchange(&mut bench, 20);
    assert!((60..=66).contains(&ours), "{ours} frames a second from us");
}

#[test]
fn every_command_on_a_saturated_line_is_acknowledged_in_order_for_an_hour() {
    let mut bench = Bench::new();
    let line_rate = 11_520.0;
    let (mut sent, mut acks, mut telemetry_frames, mut telemetry_bytes) = (0u64, 0u64, 0u64, 0u64);
    let seconds = 3600;
    // DID 28 with one servo is 12 bytes: 960 a second. Positions count up, so that a command that
    // is lost, doubled or out of order shows in the pulse.
    let position = |n: u64| 1000 + (n % 5000) as i16;
    let mut looked = 0;
    for _ in 0..seconds * 100 {
        while bench.board.line.backlog() < 240 {
            bench.drive(Quantity::Servo, 0, position(sent), 0);
            sent += 1;
        }
        bench.run_ms(10);
        for frame in bench.received() {
            if frame.is_ack() {
                acks += 1;
            } else {
                assert!(frame.report().is_some(), "nothing else on the line");
                telemetry_frames += 1;
                telemetry_bytes += 9 + frame.data.len() as u64;
            }
        }
        if acks % 960 == 0 && acks > 0 {
            // Carried out so far: between what is acknowledged and what has been sent.
            let pulse = bench.pulse(0).unwrap();
            assert!((acks..=sent).any(|n| n > 0 && pulse == position(n - 1) as u16));
            looked += 1;
        }
    }
    assert!(looked > 100, "{looked} looks at what was carried out");
    // What is still on its way.
    bench.run_ms(200);
    let late = bench.received();
    acks += late.iter().filter(|frame| frame.is_ack()).count() as u64;
    let link = bench.board.link();
    assert_eq!((acks, u64::from(link.acks_sent)), (sent, sent));
    assert_eq!((link.acks_dropped, link.bad_frames, link.bytes_skipped), (0, 0, 0));
    assert!(sent as f64 >= 0.999 * 960.0 * seconds as f64, "the line was saturated: {sent}");
    assert_eq!(bench.pulse(0), Some(position(sent - 1) as u16), "the last one counts");

    // Telemetry takes what acknowledgements leave, and is skipped where that is not enough.
    let left = line_rate * seconds as f64 - 10.0 * acks as f64;
    let allowed = left / (telemetry_bytes as f64 / telemetry_frames as f64);
    let share = telemetry_frames as f64 / allowed;
    println!("{telemetry_frames} telemetry frames of {allowed:.0} that fit: {share:.4}");
    assert!((0.99..=1.001).contains(&share), "{share}");
    assert!(link.telemetry_skipped > 0);
    // The three take turns.
    let per_report = telemetry_bytes as f64 / telemetry_frames as f64;
    assert!((38.9..39.1).contains(&per_report), "117 bytes for the three: {per_report}");
}

#[test]
fn commands_faster_than_acknowledgements_lose_those_and_nothing_else() {
    // Without data a command is 9 bytes: 1280 a second, but only 1152 acknowledgements fit.
    let mut bench = Bench::new();
    let mut sent = 0u32;
    for _ in 0..2000 {
        while bench.board.line.backlog() < 240 {
            bench.send(telemetry(Reports::Motors, Repeat::Continuous));
            sent += 1;
        }
        bench.run_ms(10);
        bench.received();
    }
    bench.run_ms(2000);
    let link = bench.board.link();
    assert_eq!((link.frames_for_us, link.bad_frames), (sent, 0));
    assert!(link.acks_dropped > 0);
    assert_eq!(link.acks_sent + link.acks_dropped, sent);
}

#[test]
fn as_many_acknowledgements_wait_as_the_page_of_the_wire_says() {
    let mut session = Pms5005::new(Settings::DEFAULT, Boot::default(), Instant::MIN);
    let mut ping = [0; 10];
    let ping = Command::Ping.encode(0, &mut ping).unwrap();
    let mut send = || session.receive(&mut &ping[..], Instant::MIN);
    assert!((0..1152).all(|_| send().is_none()));
    assert_eq!(session.counters().acks_dropped, 0);
    session.receive(&mut &ping[..], Instant::MIN);
    assert_eq!(session.counters().acks_dropped, 1);
}

#[test]
fn on_a_line_without_a_speed_limit_a_thousand_commands_at_once_are_all_acknowledged() {
    let mut bench = Bench::with(Make { line_rate: 0, ..Make::default() });
    for n in 0..1000 {
        bench.drive(Quantity::Servo, 0, 1000 + n, 0);
    }
    bench.run_ms(1500);
    assert_eq!(bench.acks(), 1000);
    assert_eq!(bench.pulse(0), Some(1999));
}

#[test]
fn a_session_without_a_board_answers_at_the_time_it_is_told() {
    // The session has no clock of its own: the same bytes at the same times, the same answers.
    let at = Instant::from_millis;
    let mut session = Pms5005::new(Settings::DEFAULT, Boot::default(), at(0));
    let mut out = [0; MAX_FRAME];
    assert_eq!(session.transmit(at(49), &At(Snapshot::BOOT), &mut out), None);
    assert_eq!(session.sends_at(), at(50));
    let mut dids = Vec::new();
    while let Some(frame) = session.transmit(at(50), &At(Snapshot::BOOT), &mut out) {
        dids.push(Frame::parse(frame).unwrap().did);
    }
    assert_eq!(dids, [did::MOTORS, did::CUSTOM_IO, did::SENSORS]);

    // Three periods late: one frame each, two skipped each, and the rhythm is kept.
    let late = at(100) + Duration::from_millis(120);
    while session.transmit(late, &At(Snapshot::BOOT), &mut out).is_some() {}
    let counters = session.counters();
    assert_eq!((counters.telemetry_sent, counters.telemetry_skipped), (6, 6));
    assert_eq!(session.sends_at(), at(250));

    // An acknowledgement is due at once.
    let (mut ping, now) = ([0; 10], at(230));
    let mut bytes: &[u8] = Command::Ping.encode(0, &mut ping).unwrap();
    assert_eq!(session.receive(&mut bytes, now), None);
    assert!(session.sends_at() <= now);
    assert_eq!(session.transmit(now, &At(Snapshot::BOOT), &mut out), Some(&ACK[..]));
    assert_eq!(session.sends_at(), at(250));
}

#[test]
fn an_encoder_that_counts_wildly_is_reported_at_the_end_of_the_scale() {
    let mut snapshot = Snapshot::BOOT;
    for (velocity, positive) in [(CountsPerSecond::MAX, true), (CountsPerSecond::MIN, false)] {
        snapshot.encoders[0].velocity = velocity;
        let mut session = Pms5005::new(Settings::DEFAULT, Boot::default(), Instant::MIN);
        let mut out = [0; MAX_FRAME];
        let frame = session.transmit(Instant::from_millis(50), &At(snapshot), &mut out).unwrap();
        let frame = Frame::parse(frame).unwrap();
        let Some(Report::Motors(report)) = Report::parse(frame.did, frame.data) else { panic!() };
        assert_eq!((report.encoders[0].speed, report.encoders[0].positive), (32_767, positive));
    }
}

#[test]
fn reports_that_were_due_together_tell_of_one_moment_unless_that_is_a_period_ago() {
    let at = Instant::from_millis;
    let moment = |value: u16| {
        let mut snapshot = Snapshot::BOOT;
        (snapshot.sensors.custom_ad[0], snapshot.sensors.temperature) = (value, value);
        At(snapshot)
    };
    let mut session = Pms5005::new(Settings::DEFAULT, Boot::default(), at(0));
    let mut report = |now, board: &At| {
        let mut out = [0; MAX_FRAME];
        let frame = Frame::parse(session.transmit(now, board, &mut out).unwrap()).unwrap();
        Report::parse(frame.did, frame.data).unwrap()
    };
    assert!(matches!(report(at(50), &moment(1)), Report::Motors(_)));
    let Report::CustomIo(custom) = report(at(53), &moment(2)) else { panic!("its turn") };
    assert_eq!(custom.custom_ad[0], 1);
    let Report::Sensors(sensors) = report(at(101), &moment(3)) else { panic!("its turn") };
    assert_eq!(sensors.temperature, 3, "the line was blocked for 48 ms");
}

#[test]
fn what_one_frame_has_asked_for_is_told_of_one_moment() {
    let mut bench = Bench::quiet();
    let potentiometer = |bench: &Bench, value| {
        bench.board.plant.borrow_mut().overrides.potentiometers[0] = Some(value);
    };
    potentiometer(&bench, 100);
    bench.send_raw(did::CUSTOM_IO, &[1]); // the sensors' turn is next, and the motors' behind it
    bench.run_ms(70); // told 20 ms ago: it is due again later than the others
    bench.received();
    let sent = bench.board.link().telemetry_sent;
    bench.send_raw(did::ALL_REPORTS, &[1]);
    bench.until(Silent, 60, |bench| bench.board.link().telemetry_sent > sent);
    potentiometer(&bench, 200);
    bench.run_ms(20);
    let reports: Vec<_> = bench.received().iter().filter_map(Received::report).collect();
    let [Report::Sensors(_), Report::Motors(motors), Report::CustomIo(_)] = &reports[..] else {
        panic!("{reports:?}")
    };
    assert_eq!(motors.potentiometers[0], 100);
    bench.send_raw(did::MOTORS, &[1]);
    bench.run_ms(60);
    let later = bench.received().iter().find_map(Received::report);
    assert!(matches!(later, Some(Report::Motors(motors)) if motors.potentiometers[0] == 200));
}
