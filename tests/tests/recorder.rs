//! The recorder over the wire: what it keeps of a motor that runs, and how a host gets all of it.

use hal_mock::board::Make;
use protocol::extension::{
    Answer, BLOCK, Block, MachineState, Mode, Outcome, Phase, Recording, Request, Row, Setup,
    Trigger, Verdict, did,
};
use protocol::pms5005::{Command, Quantity, Repeat};
use tests::Bench;
use tests::Link::{Alive, Silent};
use tests::pms5005::Received;

const VELOCITY: i16 = 4000;

fn setup(trigger: Trigger, samples: u16, before: u16) -> Setup {
    Setup { channels: 1, trigger, decimation: 1, samples, before }
}

fn answers(bench: &mut Bench) -> Vec<Answer<'static>> {
    let frames = bench.received();
    frames.iter().filter_map(|frame| owned(Answer::parse(frame.did, &frame.data)?)).collect()
}

/// The answers here that borrow nothing.
fn owned(answer: Answer<'_>) -> Option<Answer<'static>> {
    match answer {
        Answer::Recording(recording) => Some(Answer::Recording(recording)),
        Answer::Block(block) => Some(Answer::Block(block)),
        Answer::State(state) => Some(Answer::State(state)),
        Answer::Outcome(outcome) => Some(Answer::Outcome(outcome)),
        _ => None,
    }
}

/// Asks, and takes the only answer of DID 104.
fn recording(bench: &mut Bench, request: Request<'_>) -> Recording {
    bench.received();
    bench.send(Command::Extension(request));
    bench.run_ms(30);
    let all = answers(bench);
    let told = all.iter().filter_map(|answer| match answer {
        Answer::Recording(recording) => Some(*recording),
        _ => None,
    });
    let told: Vec<_> = told.collect();
    let [recording] = told[..] else { panic!("{all:?}") };
    recording
}

/// Asks for blocks, and waits long enough for them.
fn blocks(bench: &mut Bench, first: u16, count: u16) -> Vec<Block> {
    bench.received();
    bench.send(Command::Extension(Request::Blocks { first, count }));
    bench.run_ms(20 + 20 * u64::from(count));
    let answers = answers(bench).into_iter();
    answers
        .filter_map(|answer| if let Answer::Block(block) = answer { Some(block) } else { None })
        .collect()
}

fn rows(bench: &mut Bench, count: u16) -> Vec<Row> {
    let blocks = blocks(bench, 0, count.div_ceil(BLOCK as u16));
    blocks.iter().flat_map(|block| block.rows()).copied().collect()
}

#[test]
fn a_motion_command_is_recorded_period_by_period_with_what_came_before_it() {
    let mut bench = Bench::new();
    let before = recording(&mut bench, Request::Recording);
    assert_eq!((before.serial, before.phase, before.capacity), (0, Phase::None, 4096));
    let told = recording(&mut bench, Request::Record(setup(Trigger::Motion, 100, 10)));
    assert_eq!((told.serial, told.phase), (1, Phase::Waiting));
    bench.drive(Quantity::Velocity, 1, VELOCITY, 0); // not its channel
    bench.until(Alive, 50, |bench| bench.bridge(1).1);
    assert_eq!(recording(&mut bench, Request::Recording).phase, Phase::Waiting);
    bench.drive(Quantity::Velocity, 0, VELOCITY, 0);
    bench.run_ms(120);
    let told = recording(&mut bench, Request::Recording);
    assert_eq!((told.phase, told.taken, told.before), (Phase::Done, 100, 10));
    let rows = rows(&mut bench, 100);
    assert_eq!(rows.len(), 100);
    let (off, on) = rows.split_at(10);
    assert!(off.iter().all(|row| row.mode == Mode::Off && row.duty == 0), "{off:?}");
    let asked = |row: &Row| (row.mode, row.set_point) == (Mode::Velocity, VELOCITY);
    assert!(on.iter().all(asked) && on[0].duty > 0, "{on:?}");
    // Every period is there: the shaft never moves further than its fastest allows, and gets somewhere.
    let steps = on.windows(2).map(|pair| pair[1].position - pair[0].position);
    let steps: Vec<_> = steps.collect();
    assert!(steps.iter().all(|step| (-1..=9).contains(step)), "{steps:?}");
    assert!(steps.iter().sum::<i32>() > 60, "{steps:?}");
    assert!((1000..VELOCITY.into()).contains(&rows[99].velocity), "{:?}", rows[99]);
}

#[test]
fn a_fault_is_recorded_with_what_came_before_it() {
    let mut bench = Bench::new();
    recording(&mut bench, Request::Record(setup(Trigger::Fault, 200, 150)));
    bench.drive(Quantity::Velocity, 0, VELOCITY, 0);
    bench.run_ms(300);
    bench.board.plant.borrow_mut().overrides.unplugged[0] = Some(true);
    bench.until(Alive, 4000, |bench| !bench.bridge(0).1);
    bench.run_ms(100);
    let told = recording(&mut bench, Request::Recording);
    assert_eq!((told.phase, told.taken, told.before), (Phase::Done, 200, 150));
    let rows = rows(&mut bench, 200);
    assert_eq!(
        (rows[149].mode, rows[150].mode),
        (Mode::Velocity, Mode::Off),
        "the trigger's period"
    );
    assert!(rows[149].duty > 8192, "it was driven harder and harder: {}", rows[149].duty);
    assert_eq!(bench.board.snapshot().faults.count(), 1);
}

#[test]
fn a_row_says_what_the_machine_state_says_and_channels_are_side_by_side() {
    let mut bench = Bench::quiet();
    bench.drive(Quantity::Velocity, 0, VELOCITY, 0);
    bench.drive(Quantity::Pwm, 1, 20_000, 0);
    bench.run_ms(500);
    // All of the shafts' motion is over: the state of any moment is the recording's, but for positions.
    let once = Repeat::Times(std::num::NonZeroU8::MIN);
    bench.received();
    bench.send(Command::Extension(Request::State(once)));
    bench.send(Command::Extension(Request::Record(Setup {
        channels: 63,
        ..setup(Trigger::Now, 4, 0)
    })));
    bench.run_ms(40);
    let found = answers(&mut bench).into_iter().find_map(|answer| match answer {
        Answer::State(state) => Some(state),
        _ => None,
    });
    let MachineState { channels, .. } = found.unwrap();
    let rows = rows(&mut bench, 24);
    assert_eq!(rows.len(), 24);
    for (i, row) in rows.iter().enumerate() {
        let state = &channels[i % 6];
        assert_eq!((row.mode, row.set_point), (state.mode, state.set_point), "row {i}");
        assert!((row.velocity - state.velocity).abs() < 60, "row {i}: {row:?} {state:?}");
        assert!((row.duty - state.duty).abs() < 400 && row.current.abs_diff(state.current) < 40);
    }
}

#[test]
fn blocks_are_read_again_in_any_order_until_the_next_recording() {
    let mut bench = Bench::quiet();
    bench.drive(Quantity::Velocity, 0, VELOCITY, 0);
    recording(&mut bench, Request::Record(setup(Trigger::Now, 60, 0)));
    assert_eq!(blocks(&mut bench, 0, 1)[0].rows(), [], "not done");
    bench.run_ms(60);
    let all = blocks(&mut bench, 0, 8);
    let numbers: Vec<_> = all.iter().map(|block| (block.number, block.rows().len())).collect();
    assert_eq!(numbers, [0, 1, 2, 3, 4, 5, 6, 7].map(|n| (n, if n == 7 { 4 } else { 8 })));
    assert_eq!(blocks(&mut bench, 5, 2), all[5..7], "again");
    assert_eq!(blocks(&mut bench, 8, 2).iter().map(|block| block.rows().len()).max(), Some(0));
    assert_eq!(blocks(&mut bench, 65_530, 9).len(), 5, "numbers end");
    // A new recording ends what still waits, and has another number.
    bench.send(Command::Extension(Request::Blocks { first: 0, count: 60_000 }));
    bench.run_ms(30);
    recording(&mut bench, Request::Record(setup(Trigger::Now, 1, 0)));
    bench.run_ms(30);
    bench.received();
    bench.run_ms(100);
    assert_eq!(answers(&mut bench), []);
    assert_eq!(blocks(&mut bench, 0, 1)[0].serial, 2);
    // So does a request for none; one for others takes the place of what waits.
    for (first, count, told) in [(0, 0, 0), (7, 2, 2)] {
        bench.send(Command::Extension(Request::Blocks { first: 0, count: 60_000 }));
        bench.run_ms(30);
        bench.send(Command::Extension(Request::Blocks { first, count }));
        bench.run_ms(2); // what was on its way
        bench.received();
        bench.run_ms(100);
        assert_eq!(answers(&mut bench).len(), told, "{count} blocks");
    }
}

/// In which ms the last of 256 blocks, 2048 rows, has come, and how much telemetry meanwhile.
fn read_32_kib(mut bench: Bench) -> (u64, usize) {
    recording(&mut bench, Request::Record(setup(Trigger::Now, 2048, 0)));
    bench.run_ms(2100);
    bench.received();
    let begun = embassy_time::Instant::now();
    bench.send(Command::Extension(Request::Blocks { first: 0, count: 256 }));
    bench.run_ms(5000);
    let frames = bench.received();
    let blocks: Vec<_> = frames.iter().filter(|frame| frame.did == did::BLOCK).collect();
    assert_eq!(blocks.len(), 256);
    let end = blocks[255].at;
    let telemetry = frames.iter().filter(|frame| frame.at < end && frame.report().is_some());
    ((end - begun).as_millis(), telemetry.count())
}

#[test]
fn a_block_waits_for_everything_else_and_32_kib_take_some_3_s() {
    let (ms, _) = read_32_kib(Bench::quiet());
    assert!((2700..3100).contains(&ms), "{ms} ms");
    let (ms, telemetry) = read_32_kib(Bench::new());
    assert!((3400..3900).contains(&ms), "{ms} ms");
    assert!(telemetry.abs_diff(ms as usize * 60 / 1000) <= 3, "{telemetry} in {ms} ms");
}

#[test]
fn blocks_take_their_turn_among_reports_that_fill_the_line() {
    let mut make = Make::default();
    make.settings.link.telemetry_period_ms = 10; // the three reports take 40 ms
    let mut bench = Bench::with(make);
    recording(&mut bench, Request::Record(setup(Trigger::Now, 200, 0)));
    bench.run_ms(250);
    bench.received();
    bench.send(Command::Extension(Request::Blocks { first: 0, count: 25 }));
    bench.run_ms(1500);
    let frames = bench.received();
    let is_block = |frame: &Received| frame.did == did::BLOCK;
    assert_eq!(frames.iter().filter(|frame| is_block(frame)).count(), 25);
    // One round of the reports between two blocks.
    let between = frames.split(is_block).skip(1).take(24);
    let reports = between.map(|frames| frames.iter().filter(|f| f.report().is_some()).count());
    assert!(reports.clone().all(|count| count == 3), "{:?}", reports.collect::<Vec<_>>());
}

#[test]
fn what_cannot_be_recorded_is_refused_and_the_recording_before_stays() {
    let mut bench = Bench::quiet();
    recording(&mut bench, Request::Record(setup(Trigger::Now, 5, 0)));
    let bad: [(&[u8], Verdict); 9] = [
        (&[0, 0, 1, 0, 5, 0, 0, 0], Verdict::OutOfRange),
        (&[64, 0, 1, 0, 5, 0, 0, 0], Verdict::OutOfRange),
        (&[1, 3, 1, 0, 5, 0, 0, 0], Verdict::OutOfRange),
        (&[1, 0, 0, 0, 5, 0, 0, 0], Verdict::OutOfRange),
        (&[1, 1, 1, 0, 0, 0, 0, 0], Verdict::OutOfRange),
        (&[1, 1, 1, 0, 5, 0, 5, 0], Verdict::OutOfRange),
        (&[1, 0, 1, 0, 5, 0, 1, 0], Verdict::OutOfRange),
        (&[1, 0, 1, 0, 5, 0, 0], Verdict::BadLength),
        (&[1, 0, 1, 0, 5, 0, 0, 0, 0], Verdict::BadLength),
    ];
    for (data, verdict) in bad {
        bench.received();
        bench.send_raw(did::RECORDING, data);
        bench.run_ms(30);
        let outcome = Outcome { did: 104, first: data[0], verdict, setting: 0 };
        assert_eq!(answers(&mut bench), [Answer::Outcome(outcome)], "{data:?}");
    }
    let told = recording(&mut bench, Request::Recording);
    assert_eq!((told.serial, told.phase, told.samples), (1, Phase::Done, 5));
    // More than fit are cut.
    let told = recording(
        &mut bench,
        Request::Record(Setup { channels: 63, ..setup(Trigger::Fault, 5000, 4999) }),
    );
    assert_eq!((told.samples, told.phase), (682, Phase::Waiting));
}

#[test]
fn who_records_keeps_no_motor_running() {
    let mut bench = Bench::with(Make { line_rate: 0, ..Make::default() });
    bench.drive(Quantity::Velocity, 0, VELOCITY, 0);
    for _ in 0..25 {
        bench.send(Command::Extension(Request::Record(setup(Trigger::Now, 50, 0))));
        bench.send(Command::Extension(Request::Blocks { first: 0, count: 5 }));
        bench.run_with(Silent, 100, |_| {});
    }
    assert!(!bench.bridge(0).1, "silent for 2 s");
}
