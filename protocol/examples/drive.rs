//! A host in forty lines: drives motor 1 of a PMS5005 at half speed for three seconds and prints
//! where its encoder is. Start the virtual board first (`cargo run --release -p hal-mock`), then
//! `cargo run -p protocol --example drive`; another address may be given as the argument.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use protocol::pms5005::{Addressing, Command, Frame, Move, Quantity, Receiver, Report};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let address = std::env::args().nth(1).unwrap_or("127.0.0.1:5005".into());
    let mut board = TcpStream::connect(&address).map_err(|e| format!("{address}: {e}"))?;
    let pwm = |value| {
        let targets = [Some(value), None, None, None, None, None];
        Command::Move(Move {
            quantity: Quantity::Pwm,
            addressing: Addressing::List,
            targets,
            periods: 500,
        })
    };
    let mut buffer = [0; 300];
    board.write_all(pwm(24_576).encode(0, &mut buffer)?)?;

    let mut receiver = Receiver::new();
    let (start, mut stopping) = (Instant::now(), false);
    while start.elapsed() < Duration::from_secs(3) {
        // A board that hears nothing for two seconds would stop the motor by itself.
        if !stopping && start.elapsed() > Duration::from_millis(1500) {
            board.write_all(pwm(16_384).encode(0, &mut buffer)?)?;
            stopping = true;
        }
        let count = board.read(&mut buffer)?;
        let mut bytes = &buffer[..count];
        while let Some(frame) = receiver.receive(&mut bytes) {
            let Some(frame) = Frame::parse(frame) else { continue };
            if let Some(Report::Motors(motors)) = Report::parse(frame.did, frame.data) {
                let [encoder, _] = motors.encoders;
                println!("count {:5}, {:5} counts/s", encoder.count, encoder.speed);
            }
        }
    }
    Ok(())
}
