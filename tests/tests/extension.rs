//! The extension on the wire: byte by byte against Tables E.1 and E.2 of `protocol/README.md`, and what a
//! board does about each request.

use hal_mock::board::Make;
use hal_mock::flash::{Flash, SIZE};
use protocol::extension::{
    Action, Answer, Assignments, ChannelState, Counters, Description, Fault, FaultRecord, Health,
    Identity, Latched, MachineState, Mode, Origin, Outcome, Phase, Reason, Refusals, Request,
    ResetCause, Trigger, Unit, VERSION, Verdict,
};
use protocol::pms5005::{
    Channel, Command, EncodeError, Frame, Gain, Loop, Method, Parameter, Polarity, Quantity,
    Refusal, Repeat, Reports, Scope, Sensor, did, encode_answer,
};
use tests::Link::Silent;
use tests::extension::assign;
use tests::{Bench, Received};

/// DID and DATA of a request, as they stand in the frame.
fn written(request: Request) -> (u8, Vec<u8>) {
    let mut buffer = [0; 264];
    let frame = Command::Extension(request).encode(0, &mut buffer).unwrap();
    let frame = Frame::parse(frame).unwrap();
    assert_eq!(Command::parse(frame.did, frame.data), Ok(Command::Extension(request)));
    (frame.did, frame.data.to_vec())
}

/// DID and DATA of an answer, as they stand in the frame.
fn told(answer: Answer) -> (u8, Vec<u8>) {
    let mut buffer = [0; 264];
    let frame = encode_answer(&answer, &mut buffer).unwrap();
    let frame = Frame::parse(frame).unwrap();
    assert_eq!((frame.rid, frame.res), (0, 255));
    assert_eq!(Answer::parse(frame.did, frame.data), Some(answer));
    (frame.did, frame.data.to_vec())
}

#[test]
fn table_e_1_byte_by_byte() {
    let data = assign(&[(0x0120, -2), (16, 30)]);
    let expected = [0x80, 0x20, 0x01, 0xFE, 0xFF, 0xFF, 0xFF, 0x80, 16, 0, 30, 0, 0, 0];
    let assignments = Assignments::parse(&data).unwrap();
    assert_eq!(written(Request::Set(assignments)), (7, expected.to_vec()));
    assert_eq!(assignments.iter().collect::<Vec<_>>(), [(0x0120, -2), (16, 30)]);
    let actions = [
        (Action::ClearFaults, 0x81),
        (Action::Save, 0x82),
        (Action::FactoryReset, 0x83),
        (Action::Reboot, 0x84),
        (Action::RebootIntoDfu, 0x85),
    ];
    for (action, byte) in actions {
        assert_eq!(written(Request::Do(action)), (7, vec![byte]));
    }
    assert_eq!(written(Request::Setting(0x0201)), (96, vec![1, 2]));
    assert_eq!(written(Request::Identity), (97, vec![]));
    assert_eq!(written(Request::Health(Repeat::Continuous)), (98, vec![]));
    assert_eq!(written(Request::Health(Repeat::Stop)), (98, vec![0]));
    assert_eq!(written(Request::Counters), (99, vec![]));
    assert_eq!(written(Request::Fault(3)), (100, vec![3]));
}

#[test]
fn table_e_2_byte_by_byte() {
    let setting = Description {
        number: 0x0102,
        next: Some(0x0304),
        value: -2,
        range: (-3, 4),
        default: 0x0708_090A,
        unit: Unit::Centimetres,
        name: "abc",
        member: None,
    };
    let bytes = [
        [2, 1, 4, 3, 0xFE, 0xFF, 0xFF, 0xFF, 0xFD, 0xFF, 0xFF, 0xFF].as_slice(),
        &[4, 0, 0, 0, 0x0A, 9, 8, 7, 4, b'a', b'b', b'c'],
    ];
    assert_eq!(told(Answer::Setting(setting)), (96, bytes.concat()));
    let last = Description { next: None, ..setting };
    assert_eq!(told(Answer::Setting(last)).1[2..4], [0, 0]);
    let fifth = Description { member: Some(5), ..setting };
    assert_eq!(told(Answer::Setting(fifth)).1[21..], *b"abc 5");
    // What would read as another is not told.
    for bad in [
        Description { name: "abc 5", ..setting },
        Description { member: Some(10), ..setting },
        Description { name: "a name of more than 24 bytes", ..setting },
    ] {
        let refused = encode_answer(&Answer::Setting(bad), &mut [0; 264]).err();
        assert_eq!(refused, Some(EncodeError::NotRepresentable), "{bad}");
    }

    let identity = Identity {
        version: [1, 2, 3],
        extension: 4,
        reset: ResetCause::Watchdog,
        settings: Origin::Corrupt,
    };
    assert_eq!(told(Answer::Identity(identity)), (97, vec![1, 2, 3, 4, 4, 2]));

    let health = Health {
        uptime_ms: 0x0403_0201,
        worst_latency_us: 0x0605,
        stack_used: 0x0807,
        faults: 9,
        periods_missed: 0x0D0C_0B0A,
    };
    assert_eq!(told(Answer::Health(health)), (98, (1..=13).collect()));

    let counters =
        Counters { frames_ok: 1, bad_frames: 0x0200, links_lost: 18, ..Counters::default() };
    let (did, data) = told(Answer::Counters(counters));
    assert_eq!((did, data.len()), (99, 72));
    assert_eq!((&data[..8], &data[68..]), (&[1, 0, 0, 0, 0, 2, 0, 0][..], &[18, 0, 0, 0][..]));

    let refusals = Refusals { length: 1, channel: 0x0200, scale: 9, ..Refusals::default() };
    let (did, data) = told(Answer::Refusals(refusals));
    assert_eq!((did, data.len()), (103, 36));
    assert_eq!((&data[..8], &data[32..]), (&[1, 0, 0, 0, 0, 2, 0, 0][..], &[9, 0, 0, 0][..]));

    let channel = ChannelState {
        position: -2,
        velocity: 0x0403_0201,
        set_point: -3,
        duty: 0x0605,
        current: 0x0807,
        mode: Mode::Velocity,
        reason: Reason::OtherMethod,
        detail: 27,
    };
    let mut channels = [ChannelState::default(); 6];
    channels[5] = channel;
    let state = MachineState {
        time_ms: 0x0201,
        flags: 5,
        refused: 4,
        battery: [0x0605, 0x0807, 0x0A09],
        channels,
        servos: [0x0C0B, 0, 0, 0, 0, 7000],
    };
    let (did, data) = told(Answer::State(state));
    assert_eq!((did, data.len()), (102, 124));
    assert_eq!(data[..10], [1, 2, 5, 4, 5, 6, 7, 8, 9, 10]);
    assert!(data[10..95].iter().all(|&byte| byte == 0), "five channels that are off");
    let sixth = [254, 255, 255, 255, 1, 2, 3, 4, 253, 255, 5, 6, 7, 8, 3, 4, 27];
    assert_eq!(data[95..112], sixth);
    assert_eq!(data[112..], [11, 12, 0, 0, 0, 0, 0, 0, 0, 0, 0x58, 0x1B]);

    let record = FaultRecord {
        fault: Fault::Stall,
        channel: Some(5),
        uptime_ms: 0x0403_0201,
        values: [-1, 2, 0x0304],
    };
    let latched = Latched { place: 1, total: 2, record: Some(record) };
    let bytes = [1, 2, 2, 5, 1, 2, 3, 4, 0xFF, 0xFF, 2, 0, 4, 3];
    assert_eq!(told(Answer::Fault(latched)), (100, bytes.to_vec()));
    let of_the_board = FaultRecord { fault: Fault::LinkLoss, channel: None, ..record };
    let latched = Latched { record: Some(of_the_board), ..latched };
    assert_eq!(told(Answer::Fault(latched)).1[2..4], [22, 255]);
    assert_eq!(told(Answer::Fault(Latched { place: 2, total: 2, record: None })).1, [2, 2]);

    let outcome = Outcome { did: 7, first: 0x82, verdict: Verdict::OutputsOn, setting: 0x0201 };
    assert_eq!(told(Answer::Outcome(outcome)), (101, vec![7, 0x82, 6, 1, 2]));
}

/// What the version stands for. A DID, a code or a byte more makes this fail: raise [`VERSION`], once for
/// what is merged together, and put here what there is now.
#[test]
fn version_3_has_these_requests_codes_and_bytes() {
    let known = (96..=111).filter(|&did| {
        let unknown = Err(Refusal::Extension(Verdict::Unknown));
        Command::parse(did, &[]) != unknown
    });
    assert_eq!(known.collect::<Vec<_>>(), [96, 97, 98, 99, 100, 102, 103, 104, 105]);
    assert_eq!((0x80..=0xFF).filter(|&sub| is_sub_command(sub)).count(), 7);
    let codes = [Unit::ALL.len(), ResetCause::ALL.len(), Origin::ALL.len(), Verdict::ALL.len()];
    assert_eq!(codes, [12, 5, 3, 10]);
    assert_eq!([Fault::ALL.len(), Mode::ALL.len(), Reason::ALL.len()], [17, 4, 14]);
    let bytes = [size_of::<Counters>(), size_of::<Refusals>(), Answer::MAX_DATA];
    assert_eq!(bytes, [72, 36, 124]);
    assert_eq!([Trigger::ALL.len(), Phase::ALL.len()], [3, 4]);
    assert_eq!(VERSION, 3);
}

/// Whether DID 7 has this sub-command of the extension.
fn is_sub_command(sub: u8) -> bool {
    Command::parse(7, &[sub]) != Err(Refusal::Extension(Verdict::Unknown))
}

#[test]
fn a_host_without_the_extension_sees_an_original() {
    let mut bench = Bench::new();
    bench.run_ms(1020);
    let frames = bench.received();
    assert!(frames.iter().all(|frame| [123, 124, 125].contains(&frame.did)), "{frames:?}");
    assert_eq!(frames.len(), 60);
    // A bad frame of the manual's has no other answer than the acknowledgement.
    let mut bench = Bench::quiet();
    bench.send_raw(did::PARAMETERS, &[0x06, 0, 2]);
    bench.send_raw(31, &[1, 2]);
    bench.run_ms(40);
    let frames = bench.received();
    assert!(frames.len() == 2 && frames.iter().all(Received::is_ack), "{frames:?}");
}

#[test]
fn bad_requests_are_acknowledged_change_nothing_and_are_told_why() {
    let mut bench = Bench::quiet();
    let cut_short = &assign(&[(32, 20)])[..6];
    let mixed = [&assign(&[(32, 20)])[..], &[0x82, 0, 0, 0, 0, 0, 0]].concat();
    let bad: &[(u8, &[u8], Verdict, u16)] = &[
        (7, &assign(&[(32, 20), (999, 1)]), Verdict::NoSuchSetting, 999),
        // Of another firmware, and never given again.
        (7, &assign(&[(56, 512)]), Verdict::NoSuchSetting, 56),
        (7, &assign(&[(57, 2048)]), Verdict::NoSuchSetting, 57),
        (7, &assign(&[(63, 64)]), Verdict::NoSuchSetting, 63),
        (7, &assign(&[(32, 20), (16, 255)]), Verdict::OutOfRange, 16),
        (7, &assign(&[(32, 20), (16, 100)]), Verdict::Contradiction, 17),
        (7, cut_short, Verdict::BadLength, 0),
        (7, &mixed, Verdict::Unknown, 0),
        (7, &[0x82, 0x82], Verdict::BadLength, 0),
        (7, &[0x86], Verdict::BadLength, 0),
        (7, &[0x87], Verdict::Unknown, 0),
        (7, &[0xFF], Verdict::Unknown, 0),
        (96, &[], Verdict::BadLength, 0),
        (96, &[15, 0], Verdict::NoSuchSetting, 15),
        (97, &[0], Verdict::BadLength, 0),
        (98, &[1, 1], Verdict::BadLength, 0),
        (100, &[], Verdict::BadLength, 0),
        (101, &[], Verdict::Unknown, 0),
        (102, &[1, 1], Verdict::BadLength, 0),
        (103, &[0], Verdict::BadLength, 0),
        (106, &[], Verdict::Unknown, 0),
        (111, &[1], Verdict::Unknown, 0),
    ];
    for &(did, data, verdict, setting) in bad {
        let before = bench.board.link();
        assert_eq!(bench.outcome(did, data), (verdict, setting), "{did} {data:?}");
        let after = bench.board.link();
        let counted = after.refused + after.unknown - before.refused - before.unknown;
        assert_eq!(counted, 1, "{did} {data:?}");
    }
    assert_eq!((bench.value(32), bench.value(16)), (50, 30));
}

#[test]
fn all_settings_of_a_request_are_set_in_one_period_and_read_back() {
    let mut bench = Bench::quiet();
    assert_eq!(bench.set(&[(16, 100), (17, 120), (32, 20)]), (Verdict::Done, 0));
    let read = [16, 17, 32].map(|number| bench.value(number));
    assert_eq!(read, [100, 120, 20]);
    // The session's is in force...
    bench.send(Command::Telemetry { reports: Reports::Motors, repeat: Repeat::Continuous });
    bench.run_ms(1000);
    let count = bench.received().iter().filter(|frame| frame.report().is_some()).count();
    assert!((48..=51).contains(&count), "{count} in a second at 20 ms");
    // ...and the controller's: an obstacle at 80 cm is one now.
    bench.board.plant.borrow_mut().overrides.sonar_cm[0] = Some(80);
    bench.send_raw(did::PARAMETERS, &[0x13, 1]);
    bench.run_ms(100);
    assert!(bench.board.snapshot().obstacle);
    bench.hush();
    assert_eq!(bench.set(&[(16, 30), (17, 35)]), (Verdict::Done, 0));
    bench.run_ms(50);
    assert!(!bench.board.snapshot().obstacle);
}

#[test]
fn a_shorter_telemetry_period_does_not_wait_for_the_end_of_a_longer_one() {
    let mut bench = Bench::quiet();
    bench.set(&[(32, 60_000)]);
    bench.send(Command::Telemetry { reports: Reports::Motors, repeat: Repeat::Continuous });
    bench.run_ms(100);
    bench.set(&[(32, 100)]);
    bench.received();
    bench.run_ms(1000);
    let count = bench.received().iter().filter(|frame| frame.report().is_some()).count();
    assert!((9..=11).contains(&count), "{count} in a second at 100 ms");
}

#[test]
fn the_link_timeout_is_in_force_at_once() {
    let mut bench = Bench::quiet();
    assert_eq!(bench.set(&[(1, 300)]).0, Verdict::Done);
    bench.drive(Quantity::Pwm, 0, 20_000, 0);
    bench.see(Silent, |bench| bench.bridge(0), [(250, (3616, true)), (500, (0, false))]);
}

#[test]
fn what_is_saved_survives_a_reboot_and_what_is_not_does_not() {
    let flash = Flash::empty();
    let mut bench = Bench::with_flash(&flash);
    assert_eq!(bench.identity().settings, Origin::Defaults);
    bench.set(&[(32, 20)]);
    assert_eq!(bench.act(Action::Save), Verdict::Done);
    bench.set(&[(32, 30)]);
    assert_eq!(bench.act(Action::Reboot), Verdict::Done);
    bench.run_ms(150);
    bench.hush();
    let here = bench.identity();
    assert_eq!((here.reset, here.settings), (ResetCause::Software, Origin::Stored));
    assert_eq!(bench.value(32), 20);

    // Another board with the same flash; then the defaults again, at once and for good.
    let mut bench = Bench::with_flash(&flash);
    assert_eq!(bench.identity().reset, ResetCause::Power);
    assert_eq!(bench.value(32), 20);
    assert_eq!(bench.act(Action::FactoryReset), Verdict::Done);
    assert_eq!(bench.value(32), 50);
    let mut bench = Bench::with_flash(&flash);
    assert_eq!(bench.value(32), 50);
}

#[test]
fn settings_set_while_a_factory_reset_is_pending_are_refused_and_not_lost() {
    let mut bench = Bench::quiet();
    bench.send_raw(did::PARAMETERS, &[Action::FactoryReset.number()]);
    bench.send_raw(did::PARAMETERS, &assign(&[(32, 77)]));
    bench.run_ms(50);
    let told: Vec<_> =
        bench.received().into_iter().filter(|frame| frame.did == 101).map(|f| f.data).collect();
    let busy = Verdict::Busy.number();
    assert_eq!(told, [[7, 0x80, busy, 0, 0], [7, 0x83, Verdict::Done.number(), 0, 0]]);
    assert_eq!((bench.value(32), bench.board.link().refused), (50, 1));
    assert_eq!(bench.set(&[(32, 77)]), (Verdict::Done, 0));
    assert_eq!(bench.value(32), 77);
}

#[test]
fn a_board_that_drives_anything_is_not_saved_reset_or_rebooted() {
    let flash = Flash::empty();
    let mut bench = Bench::with_flash(&flash);
    let upkeep = [Action::Save, Action::FactoryReset, Action::Reboot, Action::RebootIntoDfu];
    for quantity in [Quantity::Pwm, Quantity::Servo] {
        bench.set(&[(32, 20)]);
        bench.drive(quantity, 2, 2000, 0);
        bench.run_ms(10);
        for action in upkeep {
            assert_eq!(bench.act(action), Verdict::OutputsOn, "{action:?} {quantity:?}");
        }
        bench.send(Command::Run { scope: Scope::All, run: false });
        bench.run_ms(10);
    }
    assert_eq!(bench.value(32), 20);
    assert_eq!(flash.image(), Flash::empty().image());
    assert_eq!(bench.act(Action::Save), Verdict::Done);
    assert_ne!(flash.image(), Flash::empty().image());
}

#[test]
fn a_motion_command_right_behind_a_save_waits_for_it_and_is_then_carried_out() {
    let mut bench = Bench::quiet();
    bench.send_raw(did::PARAMETERS, &[Action::Save.number()]);
    bench.drive(Quantity::Pwm, 0, 20_000, 0);
    bench.run_ms(50);
    let saved = bench.received().iter().any(|frame| frame.data == [7, 0x82, 0, 0, 0]);
    assert!(saved && bench.bridge(0) == (3616, true));
}

#[test]
fn a_suspension_right_before_a_save_is_carried_out_before_it() {
    for phase in 0..10 {
        let mut bench = Bench::with(Make { line_rate: 0, ..Make::default() });
        bench.drive(Quantity::Pwm, 0, 20_000, 0);
        bench.run_ms(10);
        bench.board.run_for(embassy_time::Duration::from_micros(100 * phase));
        bench.send(Command::Run { scope: Scope::All, run: false });
        bench.send_raw(did::PARAMETERS, &[Action::Save.number()]);
        bench.run_ms(50);
        assert!(bench.received().iter().any(|frame| frame.data == [7, 0x82, 0, 0, 0]), "{phase}");
    }
}

#[test]
fn the_roms_loader_is_not_available_here() {
    assert_eq!(Bench::quiet().act(Action::RebootIntoDfu), Verdict::NotAvailable);
}

#[test]
fn a_flash_without_power_is_told_and_the_old_settings_stay() {
    let flash = Flash::empty();
    let mut bench = Bench::with_flash(&flash);
    bench.set(&[(32, 20)]);
    bench.act(Action::Save);
    bench.set(&[(32, 30)]);
    flash.lose_power_after(40, false);
    assert_eq!(bench.act(Action::Save), Verdict::FlashFailed);
    flash.restore_power();
    assert_eq!(Bench::with_flash(&flash).value(32), 20);
}

#[test]
fn damaged_settings_are_a_fault_until_it_is_cleared() {
    let mut bench = Bench::with_flash(&Flash::with(&[0x55; SIZE]));
    assert_eq!(bench.identity().settings, Origin::Corrupt);
    assert_eq!(bench.ask_raw(100, &[0]).1, [0, 1, 25, 255, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
    assert_eq!(bench.act(Action::ClearFaults), Verdict::Done);
    assert_eq!(bench.ask_raw(100, &[0]).1, [0, 0]);
}

#[test]
fn a_start_by_the_watchdog_is_a_fault() {
    let mut bench = Bench::quiet();
    bench.board.start_again(firmware::ports::ResetCause::Watchdog);
    bench.run_ms(20);
    bench.hush();
    assert_eq!(bench.identity().reset, ResetCause::Watchdog);
    assert_eq!(bench.ask_raw(100, &[0]).1[..4], [0, 1, 26, 255]);
}

#[test]
fn health_comes_as_often_as_it_is_asked_for() {
    let mut bench = Bench::quiet();
    bench.send_raw(98, &[3]);
    bench.run_ms(500);
    let at: Vec<_> =
        bench.received().iter().filter(|f| f.did == 98).map(|f| f.at.as_millis()).collect();
    assert_eq!(at.len(), 3);
    assert!(at.windows(2).all(|pair| (49..=51).contains(&(pair[1] - pair[0]))), "{at:?}");
    bench.send_raw(98, &[]);
    bench.run_ms(1000);
    let frames = bench.received();
    let healths = frames.iter().filter_map(|f| Answer::parse(f.did, &f.data));
    let uptimes: Vec<_> = healths
        .map(|answer| match answer {
            Answer::Health(Health {
                uptime_ms,
                worst_latency_us: 0,
                stack_used: 0,
                faults: 0,
                ..
            }) => {
                // Virtual time stands still while it computes.
                uptime_ms
            }
            other => panic!("{other:?}"),
        })
        .collect();
    assert!((19..=21).contains(&uptimes.len()));
    assert!(uptimes.windows(2).all(|pair| (49..=51).contains(&(pair[1] - pair[0]))));
    bench.send_raw(98, &[0]);
    bench.run_ms(60);
    bench.received();
    bench.run_ms(500);
    assert!(bench.received().iter().all(|frame| frame.did != 98));
}

#[test]
fn counters_are_what_the_board_has_counted() {
    let mut bench = Bench::quiet();
    bench.send_raw(31, &[]);
    bench.send_raw(did::PWM, &[9, 0, 0]);
    bench.run_ms(20);
    let (did, data) = bench.ask_raw(99, &[]);
    let Some(Answer::Counters(counters)) = Answer::parse(did, &data) else { panic!() };
    let link = bench.board.link();
    assert_eq!((counters.unknown, counters.refused, counters.frames_ok), (1, 1, link.frames_ok));
    assert_eq!((counters.telemetry_sent, counters.answers_sent), (link.telemetry_sent, 1));
}

#[test]
fn requests_faster_than_the_line_are_bounded_and_starve_nobody() {
    let mut bench = Bench::quiet();
    for _ in 0..200 {
        bench.send_raw(99, &[]);
    }
    bench.drive(Quantity::Pwm, 0, 20_000, 0);
    bench.run_ms(1500);
    assert_eq!(bench.bridge(0), (3616, true));
    let link = bench.board.link();
    assert!(link.answers_dropped > 0);
    assert_eq!(link.answers_sent + link.answers_dropped, 200);
    assert_eq!(bench.acks(), 201);
}

#[test]
fn a_fault_that_is_asked_for_in_a_crowd_is_told_when_there_is_room_and_counted_once() {
    let mut bench = Bench::quiet();
    for k in 0..60 {
        bench.send_raw(96, &[32, 0]);
        if k == 20 {
            bench.send_raw(100, &[0]);
        }
    }
    bench.run_ms(1000);
    let frames = bench.received();
    assert_eq!(frames.iter().filter(|frame| frame.did == 100).count(), 1);
    let link = bench.board.link();
    assert!(link.answers_dropped > 0);
    assert_eq!(link.answers_sent + link.answers_dropped, 61);
}

/// Of channel 1: Kp of the velocity loop, Kd and Ki of the position loop, sensor, method, polarity.
const CHANNEL_1: [u16; 6] = [221, 219, 220, 224, 225, 226];

fn channel_1(bench: &mut Bench) -> [i32; 6] {
    CHANNEL_1.map(|number| bench.value(number))
}

#[test]
fn gains_sensor_method_and_polarity_are_settings_that_outlive_a_restart() {
    let flash = Flash::empty();
    let mut bench = Bench::with_flash(&flash);
    assert_eq!(channel_1(&mut bench), [50, 5, 0, 0, 0, 0]);
    let values = [22, 7, 170, 3, 3, 1];
    let all: Vec<_> = CHANNEL_1.into_iter().zip(values).collect();
    assert_eq!(bench.set(&all).0, Verdict::Done);
    assert_eq!(channel_1(&mut bench), values);
    assert_eq!(bench.act(Action::Save), Verdict::Done);
    let mut bench = Bench::with_flash(&flash);
    assert_eq!(channel_1(&mut bench), values);
    // They are in force: the method refuses another, the polarity turns the bridge round.
    bench.drive(Quantity::Position, 1, 100, 0);
    bench.drive(Quantity::Velocity, 1, 1000, 0);
    bench.run_alive_ms(50);
    assert_eq!(bench.board.snapshot().counters.refused.total(), 1);
    assert!(bench.bridge(1).0 < 0, "{:?}", bench.bridge(1));
    // A sensor that the channel does not have.
    assert_eq!(bench.set(&[(254, 3)]), (Verdict::Contradiction, 254));
    assert_eq!(bench.set(&[(244, 2)]), (Verdict::Contradiction, 244));
    assert_eq!(bench.set(&[(234, 2)]).0, Verdict::Done);
}

#[test]
fn the_two_bytes_of_ki_are_read_as_the_setting_says() {
    // 3 and 128: 3 + 128/100, 3 + 128/256, and 0x8003 hundredths.
    for (reading, hundredths) in [(0, 428), (1, 350), (2, 0x8003)] {
        let mut bench = Bench::quiet();
        assert_eq!(bench.set(&[(2, reading)]).0, Verdict::Done);
        let ki = Gain::Integral { integer: 3, fraction: 128 };
        bench.configure(&[Parameter::Gain(Channel::ALL[1], Loop::Position, ki)]);
        bench.run_ms(20);
        bench.received();
        assert_eq!(bench.value(220), hundredths, "reading {reading}");
    }
}

#[test]
fn what_an_old_host_configures_is_in_force_and_stored_only_if_a_save_follows() {
    let flash = Flash::empty();
    let wheel = Channel::ALL[1];
    let configure = |bench: &mut Bench| {
        bench.configure(&[
            Parameter::Gain(wheel, Loop::Velocity, Gain::Proportional(22)),
            Parameter::Gain(wheel, Loop::Position, Gain::Derivative(7)),
            Parameter::Gain(wheel, Loop::Position, Gain::Integral { integer: 170, fraction: 0 }),
            Parameter::Sensor(wheel, Sensor::Encoder),
            Parameter::Method(wheel, Method::Velocity),
            Parameter::Polarity(wheel, Polarity::Negative),
        ]);
        bench.run_ms(20);
        bench.received();
    };
    let mut bench = Bench::with_flash(&flash);
    configure(&mut bench);
    // In force, and told so.
    assert_eq!(channel_1(&mut bench), [22, 7, 170, 3, 3, 1]);
    // Not stored.
    let mut bench = Bench::with_flash(&flash);
    assert_eq!(channel_1(&mut bench), [50, 5, 0, 0, 0, 0]);
    configure(&mut bench);
    assert_eq!(bench.act(Action::Save), Verdict::Done);
    let mut bench = Bench::with_flash(&flash);
    assert_eq!(channel_1(&mut bench), [22, 7, 170, 3, 3, 1]);
    // And back to what the original is.
    assert_eq!(bench.act(Action::FactoryReset), Verdict::Done);
    assert_eq!(channel_1(&mut bench), [50, 5, 0, 0, 0, 0]);
}
