//! How long a command takes to what it drives, and how many a host can have carried out one by one. The
//! chip's time is a fixed number of instructions a second. What holds here with room to spare, and in
//! `.ci/cost` at a tenth of the speed, is the design's and not this clock's.

use chip::bench::pms5005::Host;
use protocol::pms5005::{
    Addressing, CHANNELS, Command, MAX_FRAME, Move, Quantity, Repeat, Reports,
};

const IMAGE: &str = "pms5005-f407";
/// A byte at 115200 baud, in ns.
const BYTE_NS: u64 = 10_000_000_000 / 115_200;
/// facts/cost.md: the last byte of a motion command to the compare register.
const LONGEST_NS: u64 = 1_500_000;
/// A command and its acknowledgement are 22 bytes: 523 a second.
const LINE_ALLOWS: f64 = 1e9 / (22 * BYTE_NS) as f64;

fn encoded(command: &Command<'_>) -> Vec<u8> {
    command.encode(0, &mut [0; MAX_FRAME]).expect("it can be encoded").to_vec()
}

fn pwm(value: i16) -> Vec<u8> {
    let mut targets = [None; CHANNELS];
    targets[0] = Some(value);
    encoded(&Command::Move(Move {
        quantity: Quantity::Pwm,
        addressing: Addressing::List,
        targets,
        periods: 0,
    }))
}

/// The same numbers in every run, below `below`.
fn random(seed: &mut u64, below: u64) -> u64 {
    *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    (*seed >> 33) % below
}

/// From the last stop bit of each of so many commands to its compare value, in ns. `schedule` sends one.
fn latencies(commands: usize, mut schedule: impl FnMut(&mut Host, &[u8])) -> Vec<u64> {
    const BATCH: usize = 500;
    let mut host = Host::boot(IMAGE);
    host.go(Quantity::Pwm, [Some(16_384), None, None, None, None, None]);
    let frames = [pwm(20_000), pwm(24_000)];
    let mut all = Vec::new();
    while all.len() < commands {
        host.bench.line.left();
        host.bench.with(|stand| stand.rig().chip.tim1.compared = Some(Vec::new()));
        (0..BATCH).for_each(|n| schedule(&mut host, &frames[n % 2]));
        while !host.bench.line.is_idle() {
            host.run_for(10);
            host.heard();
        }
        host.run_for(5);
        let bytes = host.bench.line.left();
        let ends = bytes.windows(frames[0].len()).filter_map(|sent| {
            let is_one =
                frames.iter().any(|frame| sent.iter().map(|byte| byte.1).eq(frame.iter().copied()));
            is_one.then(|| sent[sent.len() - 1].0 + BYTE_NS)
        });
        let ends: Vec<u64> = ends.collect();
        let compared = host.bench.with(|stand| stand.rig().chip.tim1.compared.take().unwrap());
        assert_eq!((ends.len(), compared.len()), (BATCH, BATCH), "each changes the duty, once");
        all.extend(ends.into_iter().zip(compared).map(|(end, (at, _))| at - end));
    }
    all
}

fn assert_within_the_goal(latencies: &[u64], when: &str) {
    let (longest, count) = (*latencies.iter().max().unwrap(), latencies.len());
    println!("{when}: the longest of {count} is {} us", longest / 1000);
    assert!(longest <= LONGEST_NS, "{when}: {longest} ns");
}

#[test]
fn a_command_is_in_the_compare_register_within_1500_us_at_any_phase_on_an_idle_line() {
    let mut seed = 1;
    let mut at = 100_000_000;
    let latencies = latencies(10_000, |host, frame| {
        at = at.max(host.bench.now_ns()) + 1_600_000 + random(&mut seed, 1_000_000);
        host.bench.line.send_at(at, frame);
    });
    assert_within_the_goal(&latencies, "idle");
}

#[test]
fn a_command_is_in_the_compare_register_within_1500_us_at_any_phase_on_a_full_line() {
    let mut seed = 2;
    let ping = encoded(&Command::Ping);
    let latencies = latencies(10_000, |host, frame| {
        (0..1 + random(&mut seed, 3)).for_each(|_| host.bench.line.send(&ping));
        host.bench.line.send(frame);
    });
    assert_within_the_goal(&latencies, "full");
}

#[test]
fn a_host_that_waits_for_each_acknowledgement_has_nine_tenths_of_what_the_line_allows() {
    const COMMANDS: i16 = 500;
    let mut host = Host::boot(IMAGE);
    host.order(Command::Telemetry { reports: Reports::All, repeat: Repeat::Stop });
    host.run_for(50);
    host.heard();
    let begun = host.bench.now_ns();
    host.bench.line.send(&pwm(20_000));
    let mut done = 0;
    while done < COMMANDS {
        host.bench.run_until_ns(host.bench.now_ns() + 10_000);
        for _ in host.heard().iter().filter(|frame| frame.is_ack()) {
            done += 1;
            host.bench.line.send(&pwm(20_000 + done));
        }
    }
    let rate = f64::from(COMMANDS) * 1e9 / (host.bench.now_ns() - begun) as f64;
    println!("{rate:.0} a second of {LINE_ALLOWS:.0}: {:.3}", rate / LINE_ALLOWS);
    assert!(rate >= 0.9 * LINE_ALLOWS, "{rate:.0} a second");
}
