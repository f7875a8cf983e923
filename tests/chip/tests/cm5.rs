//! The CM-5's shipped image: 1 Mbaud on both sides.

use chip::bench::{Bench, Make};
use hal_mock::plant::Ax12;
use hal_mock::servo_bus::{self, ServoBus};
use protocol::cm5::{Hello, HelloAnswer, Limits, Receiver, Report, params_of};

const IMAGE: &str = "cm5-f407";

fn board(ids: &[u8]) -> Bench {
    let servos = ids.iter().map(|&id| Ax12::new(id));
    let bus = ServoBus::new(servo_bus::Make::default(), servos);
    Bench::boot_with(IMAGE, Make { servos: bus, ..Make::default() })
}

/// Runs until as many packets have come as are `wanted`, which says so of each's parameters.
fn packets(
    bench: &mut Bench,
    receiver: &mut Receiver,
    mut count: usize,
    wanted: impl Fn(&[u8]) -> bool,
) {
    for _ in 0..4000 {
        bench.run_for(1);
        for (_, byte) in bench.line.heard() {
            if let Some(packet) = receiver.receive(&mut &[byte][..]) {
                count = count.saturating_sub(wanted(params_of(packet).unwrap()).into());
            }
        }
        if count == 0 {
            return;
        }
    }
    panic!("the bridge does not say that within 4 s");
}

#[test]
fn the_bridge_finds_its_servos_at_1_mbaud_and_reports_them() {
    let mut bench = board(&[1, 7, 18]);
    let mut receiver = Receiver::new();
    packets(&mut bench, &mut receiver, 1, |params| {
        Hello::parse(params).is_some_and(|hello| hello.ids == [1, 7, 18])
    });
    let limits = [Limits::new(100, 900).unwrap(); 3];
    bench.line.send(HelloAnswer::encode(1, &limits, &mut [0; 64]).unwrap());
    packets(&mut bench, &mut receiver, 50, |params| {
        let report = Report::parse(params, 3);
        report.is_some_and(|report| report.iter().all(|servo| servo.is_some()))
    });
    let reception = receiver.reception();
    assert_eq!((reception.bad_frames, reception.bytes_skipped), (0, 0));
}

#[test]
fn the_direction_line_is_high_exactly_around_what_is_sent() {
    let mut bench = board(&[1]);
    bench.run_for(200);
    let turned = bench.with(|stand| stand.rig().world.turned.clone());
    let sent = bench.servos.sent.lock().unwrap().clone();
    assert!(sent.len() > 100 && turned.len() > 20, "it searches");
    const BYTE_NS: u64 = 10_000;
    for &(end, byte) in &sent {
        let is_high =
            |at: u64| turned.iter().take_while(|turn| turn.0 <= at).last().is_some_and(|t| t.1);
        assert!(is_high(end - BYTE_NS), "{byte:#x} begins while the line is the servos'");
        assert!(is_high(end - 1), "{byte:#x} ends while the line is the servos'");
    }
    // It is given back before a servo may answer: 22 us behind the last stop bit (facts).
    for &(at, _) in turned.iter().filter(|turn| !turn.1) {
        let last = sent.iter().rev().find(|&&(end, _)| end <= at);
        if let Some(&(end, _)) = last {
            assert!(at - end < 10_000, "{} ns behind the last stop bit", at - end);
        }
    }
}

#[test]
fn nothing_is_driven() {
    use chip::bench::world::F407;
    let mut bench = board(&[1]);
    bench.run_for(300);
    bench.with(|stand| {
        let chip = &mut stand.rig().chip;
        for (port, pin) in F407.enables {
            assert_eq!(chip.level(port, pin), rigless::device::Level::Low);
        }
        assert!(
            F407.bridges.iter().chain(&F407.servos).all(|&output| chip.pulses(output).is_none())
        );
    });
}
