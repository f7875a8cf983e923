//! The recorder of the shipped images: what it keeps is what the plant did, period by period, in memory that
//! nothing else uses; and neither it nor who reads it keeps anything waiting.

use chip::bench::pms5005::Host;
use protocol::extension::{
    Answer, Block, Health, Mode, Phase, Recording, Request, Row, Setup, Trigger,
};
use protocol::pms5005::{Addressing, Command, Move, Quantity};
use rigless::soc::Width;

const VELOCITY: i16 = 4000;
/// An encoder's counts in a control period at this speed.
const STEP: i32 = 4;
/// Core-coupled memory, and how many rows of 16 bytes are in it.
const CCM: u64 = 0x1000_0000;
const CCM_ROWS: u16 = 4096;

fn only_the_first(quantity: Quantity, value: i16) -> Command<'static> {
    let targets = [Some(value), None, None, None, None, None];
    Command::Move(Move { quantity, addressing: Addressing::List, targets, periods: 0 })
}

fn recording(host: &mut Host, request: Request<'_>) -> Recording {
    host.ask(request, |answer| match answer {
        Answer::Recording(recording) => Some(recording),
        _ => None,
    })
}

fn begin(host: &mut Host, trigger: Trigger, samples: u16, before: u16) -> Recording {
    let setup = Setup { channels: 1, trigger, decimation: 1, samples, before };
    recording(host, Request::Record(setup))
}

/// Reads the rows of so many blocks, with an order every 50 ms, each of which is acknowledged before the
/// block that follows, and telemetry at its rate.
fn read(host: &mut Host, count: u16) -> Vec<Row> {
    host.heard();
    let (begun, mut reports) = (host.bench.now_ns(), 0);
    let mut blocks: Vec<Block> = Vec::new();
    let mut order = Command::Extension(Request::Blocks { first: 0, count });
    while blocks.len() < usize::from(count) {
        let ordered = host.bench.now_ns();
        assert!(ordered - begun < 30_000_000 * u64::from(count), "{} blocks", blocks.len());
        host.send(order);
        order = Command::Ping;
        host.run_for(50);
        let heard = host.heard();
        let acks: Vec<_> = heard.iter().filter(|frame| frame.is_ack()).collect();
        let [ack] = acks[..] else { panic!("{acks:?}") };
        // A block or a report is on its way, 12 ms at the most, before it.
        assert!(ack.at_ns - ordered < 15_000_000, "{} ns", ack.at_ns - ordered);
        for frame in &heard {
            reports += u64::from(frame.report().is_some());
            if let Some(Answer::Block(block)) = frame.answer() {
                blocks.push(block);
            }
        }
    }
    let due = (host.bench.now_ns() - begun) * 60 / 1_000_000_000;
    assert!(reports.abs_diff(due) <= 3, "{reports} reports of {due}");
    let numbers: Vec<_> = blocks.iter().map(|block| block.number).collect();
    assert_eq!(numbers, (0..count).collect::<Vec<_>>(), "each, in order");
    assert!(blocks.iter().all(|block| block.serial == blocks[0].serial));
    blocks.iter().flat_map(|block| block.rows()).copied().collect()
}

fn assert_healthy(host: &mut Host) {
    let Health { faults, periods_missed, worst_latency_us, .. } = host.health();
    assert_eq!((faults, periods_missed), (0, 0));
    assert!(worst_latency_us < 1000, "{worst_latency_us} us");
}

#[test]
fn a_motion_command_is_recorded_period_by_period_as_the_plant_moves() {
    const SAMPLES: u16 = 1000;
    const BEFORE: usize = 10;
    let mut host = Host::boot("pms5005-f407");
    let told = recording(&mut host, Request::Recording);
    assert_eq!((told.serial, told.phase, told.capacity), (0, Phase::None, CCM_ROWS));
    let told = begin(&mut host, Trigger::Motion, SAMPLES, BEFORE as u16);
    assert_eq!((told.serial, told.phase), (1, Phase::Waiting));
    host.live_for(100);

    // What it does, ms by ms, as its pins and its encoder have it.
    host.send(only_the_first(Quantity::Velocity, VELOCITY));
    let mut driven = Vec::new();
    for ms in 0..1100 {
        if ms % 200 == 100 {
            host.send(Command::Ping);
        }
        host.run_for(1);
        driven.push(host.bench.with(|stand| {
            let plant = &stand.rig().world.plant;
            (plant.motors[0].position() as i32, i32::from(plant.outputs.motors[0].duty.raw()))
        }));
    }
    let told = recording(&mut host, Request::Recording);
    let all = (told.phase, told.taken, told.before);
    assert_eq!(all, (Phase::Done, SAMPLES, BEFORE as u16));

    let rows = read(&mut host, SAMPLES / 8);
    let (off, on) = rows.split_at(BEFORE);
    assert!(off.iter().all(|row| (row.mode, row.set_point, row.duty) == (Mode::Off, 0, 0)));
    assert!(on.iter().all(|row| (row.mode, row.set_point) == (Mode::Velocity, VELOCITY)));
    assert_eq!(on.len(), 990);
    // The first row with a duty is the first ms with one; then all go side by side, to the last. A position is
    // read before the duty of its period is set, and the encoder turns in the ms after the plant.
    let begun = driven.iter().position(|&(_, duty)| duty != 0).expect("it is driven");
    let positions = driven[begun - 1..].iter().map(|ms| ms.0);
    let duties = driven[begun..].iter().map(|ms| ms.1);
    for (i, ((row, position), duty)) in on.iter().zip(positions).zip(duties).enumerate() {
        let (turned, pushed) = (row.position - position, i32::from(row.duty) - duty);
        assert!(turned.abs() <= STEP, "row {i} at {position}: {row:?}");
        assert!(pushed.abs() <= 8, "row {i} with {duty} of 16384: {row:?}");
    }
    assert!((3900..4100).contains(&on[989].velocity), "{:?}", on[989]);
    assert_healthy(&mut host);
}

#[test]
fn a_full_memory_is_recorded_and_read_while_the_motor_runs() {
    let mut host = Host::boot("pms5005-f407");
    host.order(only_the_first(Quantity::Velocity, VELOCITY));
    let told = begin(&mut host, Trigger::Now, 5000, 0);
    assert_eq!(told.samples, CCM_ROWS, "what fits");
    host.live_for(4200);
    assert_eq!(recording(&mut host, Request::Recording).phase, Phase::Done);
    let rows = read(&mut host, CCM_ROWS / 8);
    assert_eq!(rows.len(), usize::from(CCM_ROWS));
    let steps: Vec<_> = rows.windows(2).map(|pair| pair[1].position - pair[0].position).collect();
    assert!(steps.iter().all(|step| (0..=2 * STEP).contains(step)), "{steps:?}");
    assert!((15_500..16_500).contains(&steps.iter().sum::<i32>()), "4 s of 4000 counts/s");
    // They lie in the core-coupled memory, which they fill.
    let words: Vec<u64> = host.bench.with(|stand| {
        let word = |i| stand.host.read(CCM + 4 * i, Width::W32).expect("it is RAM");
        (0..4 * u64::from(CCM_ROWS)).map(word).collect()
    });
    let positions = |place: usize| words[place..].iter().copied().step_by(4);
    let is_there =
        |place| positions(place).eq(rows.iter().map(|row| u64::from(row.position as u32)));
    assert!((0..4).any(is_there));
    assert_healthy(&mut host);
}

#[test]
fn the_f446_has_no_core_coupled_memory_and_room_for_2048_rows() {
    let mut host = Host::boot("pms5005-f446");
    let told = begin(&mut host, Trigger::Motion, 5000, 100);
    assert_eq!((told.capacity, told.samples, told.before), (2048, 2048, 0));
    host.live_for(150);
    host.order(only_the_first(Quantity::Velocity, VELOCITY));
    host.live_for(2100);
    let told = recording(&mut host, Request::Recording);
    assert_eq!((told.phase, told.taken), (Phase::Done, 2048));
    assert_healthy(&mut host);
}
