//! Shows the settings of a Pioneer Arm's board, or sets and saves some: start the virtual arm
//! (`cargo run --release -p hal-mock -- pioneer-arm --settings FILE`), then `cargo run -p protocol
//! --example arm_settings [NUMBER VALUE]...`. An arm with servo power refuses to save them; those
//! of its joints are in force from the next start on.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::Duration;

use protocol::arcos::{Packet, Receiver, SYNC, Standard, command, extension};
use protocol::pms5005::Data;
use protocol::pms5005::extension::{Action, Answer, Assignments, Request, Verdict};

const ADDRESS: &str = "127.0.0.1:8101";

type Anything<T> = Result<T, Box<dyn std::error::Error>>;

fn main() -> Anything<()> {
    let mut arm = TcpStream::connect(ADDRESS).map_err(|e| format!("{ADDRESS}: {e}"))?;
    arm.set_read_timeout(Some(Duration::from_secs(2)))?;
    for (packet, answer) in SYNC.map(|sync| (sync, sync.id)).into_iter().chain([OPEN]) {
        arm.write_all(packet.encode(&mut [0; 9])?)?;
        until(&mut arm, |packet| (packet.id == answer).then_some(()))?;
    }
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if !arguments.is_empty() {
        let mut data = Data::new();
        for pair in arguments.chunks(2) {
            let [number, value] = pair else { return Err("NUMBER and VALUE, please".into()) };
            Assignments::emit(number.parse()?, value.parse()?, &mut data)?;
        }
        for request in [Request::Set(Assignments::parse(&data)?), Request::Do(Action::Save)] {
            ask(&mut arm, request, |answer| match answer {
                Answer::Outcome(outcome) if outcome.verdict == Verdict::Done => Some(Ok(())),
                Answer::Outcome(outcome) => Some(Err(format!("{outcome:?}"))),
                _ => None,
            })??;
        }
    }
    let mut next = Some(0);
    while let Some(number) = next {
        next = ask(&mut arm, Request::Setting(number), |answer| {
            let Answer::Setting(s) = answer else { return None };
            let (low, high) = s.range;
            let (name, unit) = (s.to_string(), s.unit);
            println!("{:3} {name:24} {:8} {unit:?}, {low} to {high}", s.number, s.value);
            Some(s.next)
        })?;
    }
    arm.write_all(Packet { id: command::CLOSE, data: &[] }.encode(&mut [0; 6])?)?;
    Ok(())
}

/// What opens a session, and what comes then.
const OPEN: (Packet<'static>, u8) = (Packet { id: command::OPEN, data: &[] }, Standard::ID);

/// Sends a request and waits for the answer that `wanted` takes.
fn ask<T>(
    arm: &mut TcpStream,
    request: Request<'_>,
    wanted: impl Fn(Answer<'_>) -> Option<T>,
) -> Anything<T> {
    arm.write_all(extension::encode_request(&request, &mut [0; 200])?)?;
    until(arm, |packet| extension::parse_answer(packet).and_then(&wanted))
}

/// Waits for a packet that `wanted` takes.
fn until<T>(arm: &mut TcpStream, wanted: impl Fn(&Packet<'_>) -> Option<T>) -> Anything<T> {
    let mut receiver = Receiver::new();
    let mut buffer = [0; 300];
    loop {
        let count = arm.read(&mut buffer)?;
        if count == 0 {
            return Err("the arm has closed the link".into());
        }
        let mut bytes = &buffer[..count];
        while let Some(packet) = receiver.receive(&mut bytes) {
            if let Some(found) = Packet::parse(packet).as_ref().and_then(&wanted) {
                return Ok(found);
            }
        }
    }
}
