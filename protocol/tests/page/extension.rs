//! The extension's requests and answers.

use std::num::NonZeroU8;

use protocol::extension::{
    Action, Answer, BLOCK, Block, ChannelState, Counters, Description, Fault, FaultRecord, Health,
    Identity, Latched, MachineState, Mode, Origin, Outcome, Phase, Reason, Recording, Refusals,
    Request, ResetCause, Row as Sample, Setup, Trigger, Unit, VERSION, Verdict, is_read,
};
use protocol::pms5005::{Command, Frame, MAX_FRAME, Refusal, Repeat, encode_answer};

use crate::fields::{Row, fields, told};
use crate::frames::sent;
use crate::text::{PAGE, bytes, table, words};

#[test]
fn the_examples_of_requests_mean_what_the_page_says() {
    let once = Repeat::Times(NonZeroU8::MIN);
    let set = [0x80, 32, 0, 20, 0, 0, 0];
    let set = protocol::extension::Assignments::parse(&set).unwrap();
    assert_eq!(set.iter().collect::<Vec<_>>(), [(32, 20)]);
    // "Motors 1 and 3 at a motion command, 300 samples 2 ms apart, 50 of them from before it."
    let setup = Setup {
        channels: 0b101,
        trigger: Trigger::Motion,
        decimation: 2,
        samples: 300,
        before: 50,
    };
    let expected = [
        ("set settings", Request::Set(set)),
        ("clear the latched faults", Request::Do(Action::ClearFaults)),
        ("save", Request::Do(Action::Save)),
        ("factory reset", Request::Do(Action::FactoryReset)),
        ("reboot", Request::Do(Action::Reboot)),
        ("reboot into the ROM's DFU loader", Request::Do(Action::RebootIntoDfu)),
        ("set the count of an encoder", Request::SetCount { channel: 0, count: 0 }),
        ("read a setting", Request::Setting(32)),
        ("identity", Request::Identity),
        ("health", Request::Health(once)),
        ("counters", Request::Counters),
        ("the record of a latched fault", Request::Fault(0)),
        ("machine state", Request::State(Repeat::Continuous)),
        ("refusals", Request::Refusals),
        ("how the recorder is", Request::Recording),
        ("start a recording", Request::Record(setup)),
        ("blocks of the recording", Request::Blocks { first: 0, count: 8 }),
    ];
    let rows = table("Requests", "DID");
    assert_eq!(rows.len(), expected.len());
    for (row, (meaning, request)) in rows.iter().zip(expected) {
        assert!(row[1].starts_with(meaning), "{}", row[1]);
        let (did, data) = (row[0].parse().unwrap(), bytes(row[3]));
        assert_eq!(Command::parse(did, &data), Ok(Command::Extension(request)), "{meaning}");
        let frame = sent(Command::Extension(request));
        assert_eq!((frame[4], &frame[6..frame.len() - 3]), (did, &*data), "{meaning}");
        assert_eq!(is_read(did), did != 7, "{meaning}: DID 7 alone is a sign of life");
    }
}

/// DATA of an answer.
fn data(answer: Answer<'_>) -> Vec<u8> {
    let frame = encode_answer(&answer, &mut [0; MAX_FRAME]).unwrap().to_vec();
    let frame = Frame::parse(&frame).unwrap();
    assert_eq!((frame.rid, frame.res, frame.did), (0, 255, answer.did()));
    assert_eq!(Answer::parse(frame.did, frame.data), Some(answer));
    frame.data.to_vec()
}

#[test]
fn the_bytes_of_a_setting_stand_where_the_page_says() {
    let base = Description {
        number: 0x0202,
        next: Some(0x0202),
        value: 0,
        range: (0, 0),
        default: 0,
        unit: Unit::Choice,
        name: "",
        member: None,
    };
    let mut expected = fields!(
        base,
        |setting: &Description<'static>| data(Answer::Setting(*setting)),
        "number" = (number),
        "next" = (next),
        "value" = (value),
        "lowest" = (range.0),
        "highest" = (range.1),
        "default" = (default),
        "unit" = (unit),
    );
    expected.push(("22 to the end".into(), "name".into(), "ASCII".into()));
    assert_eq!(told("DID 96: setting"), expected);
    let named = Description { name: "soft limit low", member: Some(1), ..base };
    assert_eq!(data(Answer::Setting(named))[21..], *b"soft limit low 1");
}

#[test]
fn the_bytes_of_identity_and_health_stand_where_the_page_says() {
    let identity = fields!(
        Identity {
            version: [0; 3],
            extension: 0,
            reset: ResetCause::Unknown,
            settings: Origin::Defaults,
        },
        |identity: &Identity| data(Answer::Identity(*identity)),
        "version" = (version),
        "extension" = (extension),
        "reset" = (reset),
        "settings" = (settings),
    );
    assert_eq!(told("DID 97: identity"), identity);
    assert!(PAGE.contains(&format!("This is version {VERSION} of the extension")));
    let health = fields!(
        Health::default(),
        |health: &Health| data(Answer::Health(*health)),
        "uptime ms" = (uptime_ms),
        "worst latency us" = (worst_latency_us),
        "stack used" = (stack_used),
        "faults" = (faults),
        "periods missed" = (periods_missed),
    );
    assert_eq!(told("DID 98: health"), health);
}

/// Counters of 4 bytes one behind the other, by the names that they have in the code.
fn counters<'a>(names: impl Iterator<Item = (&'a str, u32)>) -> Vec<Row> {
    let row = |(place, (name, _))| {
        let (first, last) = (4 * place + 1, 4 * place + 4);
        (format!("{first} to {last}"), words(name), "u32".into())
    };
    (0usize..).zip(names).map(row).collect()
}

#[test]
fn the_counters_stand_where_the_page_says() {
    // Each tells its own place.
    let numbers: Vec<u8> = (1..=18).flat_map(|n: u32| n.to_le_bytes()).collect();
    let Some(Answer::Counters(of_board)) = Answer::parse(99, &numbers) else { panic!() };
    assert_eq!(told("DID 99: counters"), counters(of_board.named()));
    assert!(of_board.named().map(|(_, value)| value).eq(1..=18));
    assert_eq!(data(Answer::Counters(of_board)), numbers);
    assert_eq!(size_of::<Counters>(), numbers.len());

    let numbers = &numbers[..36];
    let Some(Answer::Refusals(refusals)) = Answer::parse(103, numbers) else { panic!() };
    assert_eq!(told("DID 103: refusals"), counters(refusals.named()));
    assert!(refusals.named().map(|(_, value)| value).eq(1..=9));
    assert_eq!(data(Answer::Refusals(refusals)), numbers);
    assert_eq!(size_of::<Refusals>(), numbers.len());

    let reasons: Vec<_> = refusals.named().map(|(name, _)| words(name)).collect();
    for row in table("What is refused", "refused") {
        assert!(reasons.iter().any(|reason| reason == row[1]), "{}", row[1]);
    }
}

#[test]
fn the_bytes_of_a_fault_record_and_of_an_outcome_stand_where_the_page_says() {
    let record =
        FaultRecord { fault: Fault::OverCurrent, channel: None, uptime_ms: 0, values: [0; 3] };
    let latched = Latched { place: 0, total: 0x60, record: Some(record) };
    let of_list = fields!(
        latched,
        |latched: &Latched| data(Answer::Fault(*latched)),
        "place" = (place),
        "total" = (total),
    );
    let of_record = fields!(
        record,
        |record: &FaultRecord| data(Answer::Fault(Latched { record: Some(*record), ..latched })),
        "fault" = (fault),
        "channel" = (channel),
        "uptime ms" = (uptime_ms),
        "values" = (values),
    );
    assert_eq!(told("DID 100: fault record"), [of_list, of_record].concat());
    assert_eq!(data(Answer::Fault(latched))[3], 255, "the board");

    let outcome = fields!(
        Outcome { did: 0, first: 0, verdict: Verdict::Done, setting: 0 },
        |outcome: &Outcome| data(Answer::Outcome(*outcome)),
        "did" = (did),
        "first" = (first),
        "verdict" = (verdict),
        "setting" = (setting),
    );
    assert_eq!(told("DID 101: outcome"), outcome);
}

#[test]
fn the_bytes_of_the_machine_state_stand_where_the_page_says() {
    let encode = |state: &MachineState| data(Answer::State(*state));
    let state = fields!(
        MachineState::default(),
        encode,
        "time ms" = (time_ms),
        "flags" = (flags),
        "refused" = (refused),
        "battery" = (battery),
        "channels" = (channels),
        "servos" = (servos),
    );
    assert_eq!(told("DID 102: machine state"), state);
    for motor in 1..=6 {
        let of_channel = |channel: &ChannelState| {
            let mut channels = [ChannelState::default(); 6];
            channels[motor - 1] = *channel;
            let all = encode(&MachineState { channels, ..MachineState::default() });
            // "Byte 1 of motor n is byte 17 n - 6 of DATA."
            all[17 * motor - 7..][..17].to_vec()
        };
        let channel = fields!(
            ChannelState::default(),
            of_channel,
            "position" = (position),
            "velocity" = (velocity),
            "set point" = (set_point),
            "duty" = (duty),
            "current" = (current),
            "mode" = (mode),
            "reason" = (reason),
            "detail" = (detail),
        );
        assert_eq!(told("A channel of the machine state"), channel, "motor {motor}");
    }
    assert_eq!((Mode::Off.number(), Reason::None.number()), (0, 0));
}

#[test]
fn the_machine_states_that_a_line_carries_are_counted_right() {
    let state = Answer::State(MachineState::default());
    let frame = encode_answer(&state, &mut [0; MAX_FRAME]).unwrap().len();
    let telemetry = 20 * (42 + 26 + 49);
    for row in table("A channel of the machine state", "baud") {
        let [baud, beside, alone] = [0, 1, 2].map(|column| row[column].parse::<usize>().unwrap());
        let room = (baud / 10).saturating_sub(telemetry);
        assert_eq!((beside, alone), (room / frame, baud / 10 / frame), "{baud} baud");
    }
}

const NO_RECORDING: Recording = Recording {
    serial: 0,
    phase: Phase::None,
    channels: 0,
    trigger: Trigger::Now,
    decimation: 0,
    samples: 0,
    taken: 0,
    before: 0,
    triggered_ms: 0,
    capacity: 0,
};

/// DATA of a request.
fn asked(request: Request<'_>) -> Vec<u8> {
    let frame = sent(Command::Extension(request));
    frame[6..frame.len() - 3].to_vec()
}

#[test]
fn the_bytes_that_the_recorder_is_asked_by_stand_where_the_page_says() {
    let nothing =
        Setup { channels: 0, trigger: Trigger::Now, decimation: 0, samples: 0, before: 0 };
    let setup = fields!(
        nothing,
        |setup: &Setup| asked(Request::Record(*setup)),
        "channels" = (channels),
        "trigger" = (trigger),
        "decimation" = (decimation),
        "samples" = (samples),
        "before" = (before),
    );
    assert_eq!(told("DID 104, from a host: start"), setup);
    let blocks = fields!(
        (0, 0),
        |&(first, count): &(u16, u16)| asked(Request::Blocks { first, count }),
        "first" = (0),
        "count" = (1),
    );
    assert_eq!(told("DID 105, from a host: read"), blocks);
}

#[test]
fn the_bytes_that_the_recorder_tells_stand_where_the_page_says() {
    let recording = fields!(
        NO_RECORDING,
        |recording: &Recording| data(Answer::Recording(*recording)),
        "serial" = (serial),
        "phase" = (phase),
        "channels" = (channels),
        "trigger" = (trigger),
        "decimation" = (decimation),
        "samples" = (samples),
        "taken" = (taken),
        "before" = (before),
        "triggered ms" = (triggered_ms),
        "capacity" = (capacity),
    );
    assert_eq!(told("DID 104, from the board: state"), recording);
    let len = data(Answer::Recording(NO_RECORDING)).len();
    assert!(PAGE.contains(&format!("The answer to both, {len} bytes.")));

    let empty = Sample::default();
    let mut block = fields!(
        Block::new(0, 0, []),
        |block: &Block| data(Answer::Block(*block)),
        "serial" = (serial),
        "number" = (number),
    );
    let row_len = data(Answer::Block(Block::new(0, 0, [empty]))).len() - 3;
    block.push(("4 to the end".into(), "rows".into(), format!("{row_len} bytes each")));
    assert_eq!(told("DID 105, from the board: block"), block);

    // The second of a block's rows: behind serial, number and the first.
    let row = fields!(
        empty,
        |row: &Sample| data(Answer::Block(Block::new(0, 0, [empty, *row])))[3 + row_len..].to_vec(),
        "position" = (position),
        "velocity" = (velocity),
        "set point" = (set_point),
        "duty" = (duty),
        "current" = (current),
        "mode" = (mode),
    );
    assert_eq!(told("A row"), row);
    assert_eq!(row, told("A channel of the machine state")[..6]);
}

#[test]
fn the_numbers_in_the_text_about_the_recorder_are_those_of_the_wire() {
    let last = BLOCK - 1;
    let rows = format!("Block n holds rows {BLOCK} n to {BLOCK} n + {last}.");
    let block = Block::new(1, 0, [Sample::default(); BLOCK]);
    let wire = encode_answer(&Answer::Block(block), &mut [0; MAX_FRAME]).unwrap().len();
    let wire = format!("a whole one is {wire} bytes on the wire");
    let most = format!("| 0 to {BLOCK} of them, see below |");
    for text in [rows, wire, most] {
        assert!(PAGE.contains(&text), "{text}");
    }
    // What is refused, and how.
    let start = |data: &[u8]| match Command::parse(104, data) {
        Ok(Command::Extension(Request::Record(_))) => Verdict::Done,
        Err(Refusal::Extension(verdict)) => verdict,
        other => panic!("{other:?}"),
    };
    let good = [1, 1, 1, 0, 5, 0, 4, 0];
    assert_eq!(start(&good), Verdict::Done);
    let bad = [(0, 0), (0, 64), (1, 3), (1, 0), (2, 0), (4, 0), (6, 5)];
    for (place, byte) in bad {
        let mut data = good;
        data[place] = byte;
        assert_eq!(start(&data), Verdict::OutOfRange, "byte {} is {byte}", place + 1);
    }
    assert_eq!(start(&good[..7]), Verdict::BadLength);
}
