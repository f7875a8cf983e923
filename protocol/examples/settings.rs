//! Shows a board's settings, or sets and saves some: start the virtual board (`cargo run --release
//! -p hal-mock`) or the virtual arm (the same with `-- pioneer-arm --settings FILE`), then `cargo run
//! -p protocol --example settings [arm] [NUMBER VALUE]...`. What drives something, an arm with servo
//! power too, refuses to save; those of an arm's joints are in force from the next start on.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::Duration;

use protocol::arcos::{self, Arcos, Packet, SYNC, Standard, command};
use protocol::deframe::{Deframer, Framing};
use protocol::extension::{Action, Answer, Assignments, Request, Verdict};
use protocol::pms5005::{Command, Data, Frame, Pms5005};

type Anything<T> = Result<T, Box<dyn std::error::Error>>;

fn main() -> Anything<()> {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let is_arm = arguments.first().is_some_and(|first| first == "arm");
    let address = if is_arm { "127.0.0.1:8101" } else { "127.0.0.1:5005" };
    let mut link = TcpStream::connect(address).map_err(|e| format!("{address}: {e}"))?;
    link.set_read_timeout(Some(Duration::from_secs(2)))?;
    if is_arm {
        arguments.remove(0);
        let open = (Packet { id: command::OPEN, data: &[] }, Standard::ID);
        for (packet, answer) in SYNC.map(|sync| (sync, sync.id)).into_iter().chain([open]) {
            link.write_all(packet.encode(&mut [0; 9])?)?;
            until::<Arcos, _>(&mut link, |p| (Packet::parse(p)?.id == answer).then_some(()))?;
        }
    }
    if !arguments.is_empty() {
        let mut data = Data::new();
        for pair in arguments.chunks(2) {
            let [number, value] = pair else { return Err("NUMBER and VALUE, please".into()) };
            Assignments::emit(number.parse()?, value.parse()?, &mut data)?;
        }
        for request in [Request::Set(Assignments::parse(&data)?), Request::Do(Action::Save)] {
            ask(&mut link, is_arm, request, |answer| match answer {
                Answer::Outcome(outcome) if outcome.verdict == Verdict::Done => Some(Ok(())),
                Answer::Outcome(outcome) => Some(Err(format!("{outcome:?}"))),
                _ => None,
            })??;
        }
    }
    let mut next = Some(0);
    while let Some(number) = next {
        next = ask(&mut link, is_arm, Request::Setting(number), |answer| {
            let Answer::Setting(s) = answer else { return None };
            let (low, high) = s.range;
            let (name, unit) = (s.to_string(), s.unit);
            println!("{:3} {name:24} {:8} {unit:?}, {low} to {high}", s.number, s.value);
            Some(s.next)
        })?;
    }
    if is_arm {
        link.write_all(Packet { id: command::CLOSE, data: &[] }.encode(&mut [0; 6])?)?;
    }
    Ok(())
}

/// Sends a request and waits for the answer that `wanted` takes.
fn ask<T>(
    link: &mut TcpStream,
    is_arm: bool,
    request: Request<'_>,
    wanted: impl Fn(Answer<'_>) -> Option<T>,
) -> Anything<T> {
    let mut buffer = [0; 300];
    if is_arm {
        link.write_all(arcos::extension::encode_request(&request, &mut buffer)?)?;
        until::<Arcos, _>(link, |packet| {
            let packet = Packet::parse(packet)?;
            Answer::parse(packet.id, packet.data).and_then(&wanted)
        })
    } else {
        link.write_all(Command::Extension(request).encode(0, &mut buffer)?)?;
        until::<Pms5005, _>(link, |frame| {
            let frame = Frame::parse(frame)?;
            Answer::parse(frame.did, frame.data).and_then(&wanted)
        })
    }
}

/// Waits for a frame or a packet that `wanted` takes.
fn until<F: Framing, T>(link: &mut TcpStream, wanted: impl Fn(&[u8]) -> Option<T>) -> Anything<T> {
    let mut receiver = Deframer::<F, 300>::new();
    let mut buffer = [0; 300];
    loop {
        let count = link.read(&mut buffer)?;
        if count == 0 {
            return Err("the board has closed the link".into());
        }
        let mut bytes = &buffer[..count];
        while let Some(frame) = receiver.receive(&mut bytes) {
            if let Some(found) = wanted(frame) {
                return Ok(found);
            }
        }
    }
}
