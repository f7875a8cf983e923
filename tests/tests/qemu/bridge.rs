//! The CM-5's image: a PC on USART2, and a bus of simulated servos behind USART6.
//!
//! The machine does not know half duplex, so the echo comes from here, with the servos' answers
//! right behind it. It comes as late as the computer's scheduler likes, and the bridge gives up
//! after milliseconds; so the machine's clock counts instructions, which makes it slower than the
//! wall's, and the tests wait for what must come some time.

use std::io::{Read, Write};
use std::os::unix::net::UnixStream;
use std::time::{Duration, Instant};

use hal_mock::plant::Ax12;
use hal_mock::servo_bus::{Make, ServoBus};
use protocol::cm5::{Hello, HelloAnswer, Limits, Receiver, Report, params_of};

use crate::machine::Machine;
use crate::{BSRR, IWDG, KR, SLOWLY};

const IMAGE: &str = "cm5-qemu";

/// The search takes about a second of the machine's time, and a servo that it has missed is found
/// some 5 s later.
const PATIENCE: Duration = Duration::from_secs(60);

/// Serves a bus of these servos for as long as the machine runs.
fn serve(mut wire: UnixStream, servos: &[u8]) {
    let servos: Vec<_> = servos.iter().map(|&id| Ax12::new(id)).collect();
    std::thread::spawn(move || {
        let mut bus = ServoBus::new(Make::default(), servos);
        let (mut buffer, mut now_ns) = ([0; 256], 0);
        while let Ok(count @ 1..) = wire.read(&mut buffer) {
            // Every answer is complete within a millisecond.
            now_ns = bus.send(now_ns, &buffer[..count]) + 1_000_000;
            bus.advance_to(now_ns);
            let heard: Vec<_> =
                std::iter::from_fn(|| bus.receive()).map(|(_, byte)| byte).collect();
            if wire.write_all(&heard).is_err() {
                break; // the machine is gone
            }
        }
    });
}

/// The parameters of the next packet for the PC of which `wanted` makes something.
fn packet<T>(machine: &Machine, receiver: &mut Receiver, wanted: impl Fn(&[u8]) -> Option<T>) -> T {
    let deadline = Instant::now() + PATIENCE;
    while let Some(byte) = machine.byte(deadline) {
        if let Some(packet) = receiver.receive(&mut &[byte][..]) {
            let params = params_of(packet).unwrap();
            if let Some(found) = wanted(params) {
                return found;
            }
        }
    }
    panic!("the bridge does not say that for {PATIENCE:?}");
}

#[test]
#[ignore = "needs QEMU 7.2 and the image that .ci/images builds"]
fn the_bridge_finds_its_servos_and_reports_them() {
    let mut machine = Machine::boot("bridge", IMAGE, &SLOWLY);
    serve(machine.bus(), &[1, 7]);
    let mut receiver = Receiver::new();

    // The buffer's direction, PC8, is turned for every request and back again; low at boot, too.
    machine.forget();
    machine.written("GPIOC", BSRR, 1 << 8);
    machine.written("GPIOC", BSRR, 1 << (8 + 16));

    packet(&machine, &mut receiver, |params| {
        Hello::parse(params).filter(|hello| hello.ids == [1, 7]).map(drop)
    });
    let mut buffer = [0; 64];
    let answer = HelloAnswer::encode(1, &[Limits::new(100, 900).unwrap(); 2], &mut buffer).unwrap();
    machine.send_bytes(answer);
    packet(&machine, &mut receiver, |params| {
        Report::parse(params, 2)
            .filter(|report| report.iter().all(|servo| servo.is_some()))
            .map(drop)
    });

    // Both directions of the PC's line and the bus are alive, and nothing is driven.
    machine.forget();
    machine.written(IWDG, KR, 0xAAAA);
    for timer in ["timer[1]", "timer[8]", "timer[12]"] {
        assert!(!machine.is_touched(timer), "{timer} has been touched");
    }
}
