//! Shows a board's settings, or sets one: start the virtual board (`cargo run --release -p
//! hal-mock`), then `cargo run -p protocol --example settings [NUMBER VALUE]`. What was set is
//! saved too, so a board that drives something refuses it.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::Duration;

use protocol::pms5005::extension::{Action, Answer, Assignments, Request, Verdict};
use protocol::pms5005::{Command, Data, Frame, Receiver};

const ADDRESS: &str = "127.0.0.1:5005";

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut board = TcpStream::connect(ADDRESS).map_err(|e| format!("{ADDRESS}: {e}"))?;
    board.set_read_timeout(Some(Duration::from_secs(2)))?;
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if let [number, value] = &arguments[..] {
        let mut data = Data::new();
        Assignments::emit(number.parse()?, value.parse()?, &mut data)?;
        for request in [Request::Set(Assignments::parse(&data)?), Request::Do(Action::Save)] {
            ask(&mut board, request, |answer| match answer {
                Answer::Outcome(outcome) if outcome.verdict == Verdict::Done => Some(Ok(())),
                Answer::Outcome(outcome) => Some(Err(format!("{:?}", outcome.verdict))),
                _ => None,
            })??;
        }
    }
    let mut next = Some(0);
    while let Some(number) = next {
        next = ask(&mut board, Request::Setting(number), |answer| {
            let Answer::Setting(s) = answer else { return None };
            let (low, high) = s.range;
            let (name, unit) = (s.to_string(), s.unit);
            println!("{:3} {name:24} {:8} {unit:?}, {low} to {high}", s.number, s.value);
            Some(s.next)
        })?;
    }
    Ok(())
}

/// Sends a request and waits for the answer that `wanted` takes.
fn ask<T>(
    board: &mut TcpStream,
    request: Request<'_>,
    wanted: impl Fn(Answer<'_>) -> Option<T>,
) -> Result<T, Box<dyn std::error::Error>> {
    let mut buffer = [0; 300];
    board.write_all(Command::Extension(request).encode(0, &mut buffer)?)?;
    let mut receiver = Receiver::new();
    loop {
        let count = board.read(&mut buffer)?;
        let mut bytes = &buffer[..count];
        while let Some(frame) = receiver.receive(&mut bytes) {
            let answer = Frame::parse(frame).and_then(|f| Answer::parse(f.did, f.data));
            if let Some(found) = answer.and_then(&wanted) {
                return Ok(found);
            }
        }
    }
}
