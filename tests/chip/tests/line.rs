//! The host's line of the shipped image: full in both directions, and damaged in every way.

use chip::bench::pms5005::Host;
use protocol::extension::{Answer, Counters, Request};
use protocol::pms5005::{Addressing, Command, MAX_FRAME, Move, Quantity, Repeat};
use rigless::chip::uart::Rate;
use rigless::mcu::Operate;
use rigless::soc::Width;

const IMAGE: &str = "pms5005-f407";
/// USART2 among the part's.
const USART2: usize = 1;
/// Its third control register, and what lets it ask the DMA for a reading.
const CR3: u64 = 0x4000_4414;
const DMAR: u64 = 1 << 6;

fn counters(host: &mut Host) -> Counters {
    host.send(Command::Extension(Request::Counters));
    host.wait("counters", |frame| match frame.answer() {
        Some(Answer::Counters(counters)) => Some(counters),
        _ => None,
    })
}

#[test]
fn a_minute_of_a_full_line_in_both_directions_loses_nothing() {
    const SECONDS: u64 = 60;
    /// Bytes a second, each way.
    const FULL: u64 = 11_520;
    let mut host = Host::boot(IMAGE);
    // Telemetry every 20 ms and the machine state every 10 are more than the acknowledgements leave room for.
    host.set(32, 20);
    host.set(33, 10);
    host.send(Command::Extension(Request::State(Repeat::Continuous)));
    let motion = Command::Move(Move {
        quantity: Quantity::Pwm,
        addressing: Addressing::All,
        targets: [20_000, 12_000, 16_384, 16_384, 16_384, 16_384].map(Some),
        periods: 0,
    });
    let frame = motion.encode(0, &mut [0; MAX_FRAME]).unwrap().to_vec();
    host.run_for(100);
    let before = counters(&mut host);
    host.run_for(50);
    host.heard();
    let (mut sent, mut acks, mut heard) = (0, 0, 0);
    let begun = host.bench.now_ns();
    while host.bench.now_ns() < begun + SECONDS * 1_000_000_000 {
        while host.bench.line.pending() < 64 {
            host.bench.line.send(&frame);
            sent += 1;
        }
        host.run_for(2);
        for frame in host.heard() {
            acks += u32::from(frame.is_ack());
            heard += frame.data.len() as u64 + 9;
        }
    }
    while !host.bench.line.is_idle() {
        host.run_for(1);
    }
    host.run_for(300);
    acks += host.heard().iter().map(|frame| u32::from(frame.is_ack())).sum::<u32>();
    let after = counters(&mut host);
    let reception = host.reception();
    println!("{sent} frames, {acks} acknowledged, {heard} bytes heard");
    assert_eq!((reception.bad_frames, reception.bytes_skipped), (0, 0), "heard whole");
    assert_eq!(acks, sent, "each is acknowledged");
    assert_eq!(after.line_errors, before.line_errors);
    assert_eq!((after.bad_frames, after.bytes_skipped), (before.bad_frames, before.bytes_skipped));
    assert_eq!(after.frames_ok - before.frames_ok, sent + 1, "and the question");
    assert_eq!(after.acks_dropped, before.acks_dropped);
    assert!(u64::from(sent) * frame.len() as u64 >= SECONDS * FULL * 99 / 100, "full to the board");
    assert!(heard >= SECONDS * FULL * 99 / 100, "full from the board: {heard}");
}

/// Sends pings of which some are damaged, then good ones; the board counts and goes on.
fn damaged(noise: u32, framing: u32) -> (Counters, Counters) {
    let mut host = Host::boot(IMAGE);
    let before = counters(&mut host);
    host.bench.with(move |stand| {
        let errors = stand.rig().chip.part.usart[USART2].errors_mut();
        errors.noise = Rate { name: "noise", per_million: noise };
        errors.framing = Rate { name: "framing", per_million: framing };
    });
    for _ in 0..100 {
        host.send(Command::Ping);
        host.run_for(3);
    }
    host.bench.with(|stand| {
        let errors = stand.rig().chip.part.usart[USART2].errors_mut();
        (errors.noise, errors.framing) = (Rate::default(), Rate::default());
    });
    host.run_for(20);
    host.heard();
    for _ in 0..20 {
        host.order(Command::Ping);
    }
    (before, counters(&mut host))
}

#[test]
fn noise_and_framing_errors_are_counted_and_the_next_good_frame_is_obeyed() {
    for (noise, framing) in [(20_000, 0), (0, 20_000)] {
        let (before, after) = damaged(noise, framing);
        let errors = after.line_errors - before.line_errors;
        // 1000 bytes, one in 50 damaged; neighbours count once.
        assert!((5..=30).contains(&errors), "{errors} errors");
        assert!(after.bytes_skipped > before.bytes_skipped);
        let whole = after.frames_ok - before.frames_ok;
        assert!((85..=121).contains(&whole), "{whole} of 121 frames are whole");
    }
}

#[test]
fn a_break_is_a_framing_error_and_no_more() {
    let mut host = Host::boot(IMAGE);
    let before = counters(&mut host);
    let every = |host: &Host, per_million| {
        host.bench.with(move |stand| {
            let errors = stand.rig().chip.part.usart[USART2].errors_mut();
            errors.framing = Rate { name: "break", per_million };
        });
    };
    // A line that is low for 20 bytes: each is a zero without a stop bit.
    every(&host, Rate::EVERY_WORD);
    host.bench.line.send(&[0; 20]);
    host.run_for(4);
    every(&host, 0);
    host.run_for(2);
    host.order(Command::Ping);
    let after = counters(&mut host);
    assert!(after.line_errors > before.line_errors);
    assert_eq!(after.frames_ok - before.frames_ok, 2, "the ping and the question");
}

#[test]
fn bytes_that_the_dma_does_not_fetch_are_an_overrun_that_is_counted_and_over() {
    let mut host = Host::boot(IMAGE);
    let before = counters(&mut host);
    let fetch = |host: &Host, on: bool| {
        host.bench.with(move |stand| {
            let now = stand.now;
            let chip = &mut stand.rig().chip;
            let control = Operate::read(chip, now, CR3, Width::W32).unwrap();
            let control = if on { control | DMAR } else { control & !DMAR };
            Operate::write(chip, now, CR3, Width::W32, control).unwrap();
        });
    };
    fetch(&host, false);
    host.send(Command::Ping);
    host.run_for(3);
    fetch(&host, true);
    host.run_for(5);
    host.order(Command::Ping);
    host.order(Command::Ping);
    let after = counters(&mut host);
    assert_eq!(after.line_errors - before.line_errors, 1, "one overrun");
}
