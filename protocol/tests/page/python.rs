//! The page's listings in Python. What they do is checked in Rust; where there is a `python3`, they are run.

use std::io::{ErrorKind, Read, Write};
use std::net::TcpListener;
use std::process::{Command as Process, Stdio};
use std::time::{Duration, Instant};

use protocol::pms5005::{
    Addressing, Command, Encoder, Frame, MAX_FRAME, MotorReport, Quantity, Receiver, Report,
};

use crate::commands::motion;
use crate::text::{PAGE, bytes, listings, table};

/// What Python prints, line by line; `None` where there is none.
fn python(program: &str) -> Option<Vec<String>> {
    let run = |program: &str| Process::new("python3").arg("-c").arg(program).output().ok();
    run("").filter(|output| output.status.success())?;
    let output = run(program)?;
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let printed = String::from_utf8(output.stdout).unwrap();
    Some(printed.lines().map(str::to_owned).collect())
}

fn only_listing(title: &str) -> String {
    let [listing] = <[String; 1]>::try_from(listings(title, "python")).expect("one listing");
    listing
}

/// The listing of "Checksum", transcribed.
fn checksum(body: &[u8]) -> u8 {
    let mut crc = 0;
    for byte in body {
        crc ^= byte;
        for _ in 0..8 {
            crc = (crc >> 1) ^ ((crc & 1) * 0x8C);
        }
    }
    crc
}

#[test]
fn the_checksum_is_six_lines_and_makes_the_ten_frames() {
    let listing = only_listing("Checksum");
    assert_eq!(listing.lines().count(), 6);
    assert!(only_listing("The first thing").contains(&listing), "the program has the same one");
    let frames = table("Ten frames", "frame").into_iter().map(|row| bytes(row[0]));
    let bodies: Vec<_> = frames.map(|frame| frame[2..frame.len() - 2].to_vec()).collect();
    let ends = |body: &Vec<u8>| body.split_last().map(|(crc, body)| (*crc, body.to_vec())).unwrap();
    for (crc, body) in bodies.iter().map(ends) {
        assert_eq!(checksum(&body), crc);
        // The crate agrees, here and for every other DATA.
        let frame = Frame { rid: body[0], res: body[1], did: body[2], data: &body[4..] };
        let frame = frame.encode(&mut [0; MAX_FRAME]).unwrap().to_vec();
        assert_eq!(frame[frame.len() - 3], crc);
    }
    assert_eq!(checksum(&[1, 0, 28, 3, 2, 0, 8]), 101);
    assert!(PAGE.contains("`checksum(bytes([1, 0, 28, 3, 2, 0, 8]))` is 101."));
    let (sums, bodies): (Vec<_>, Vec<_>) = bodies.iter().map(ends).unzip();
    let program = format!("{listing}\nfor body in {bodies:?}: print(checksum(bytes(body)))");
    if let Some(printed) = python(&program) {
        assert_eq!(printed, sums.iter().map(u8::to_string).collect::<Vec<_>>());
    }
}

#[test]
fn the_listings_of_arcos_and_the_cm5_make_the_packets_of_their_tables() {
    let packets = |title| table(title, "packet").into_iter().map(|row| bytes(row[0]));
    let ends = |packet: Vec<u8>| {
        let (body, sum) = packet[3..].split_last_chunk().unwrap();
        (u16::from_be_bytes(*sum), body.to_vec())
    };
    let (sums, bodies): (Vec<_>, Vec<_>) = packets("The packet").map(ends).unzip();
    let listing = only_listing("The packet");
    let program = format!("{listing}\nfor body in {bodies:?}: print(checksum(bytes(body)))");
    if let Some(printed) = python(&program) {
        assert_eq!(printed, sums.iter().map(u16::to_string).collect::<Vec<_>>());
    }
    let whole: Vec<_> = packets("Its packet").collect();
    let parameters: Vec<_> = whole.iter().map(|packet| &packet[4..packet.len() - 1]).collect();
    let listing = only_listing("Its packet");
    let program = format!("{listing}\nfor p in {parameters:?}: print(list(packet(bytes(p))))");
    if let Some(printed) = python(&program) {
        let shown = |packet: &Vec<u8>| format!("{packet:?}");
        assert_eq!(printed, whole.iter().map(shown).collect::<Vec<_>>());
    }
}

/// Beside a board that only tells a speed, since this crate has no other.
#[test]
fn the_first_program_drives_motor_1_keeps_the_link_alive_and_stops() {
    let program = only_listing("The first thing");
    assert!(program.lines().filter(|line| !line.is_empty()).count() <= 25);
    if python("").is_none() {
        return;
    }
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let here = format!("\"127.0.0.1\", {}", listener.local_addr().unwrap().port());
    let program = program.replace("\"127.0.0.1\", 5005", &here);
    let host = Process::new("python3").arg("-c").arg(program).stdout(Stdio::piped()).spawn();
    let host = host.unwrap();
    let (mut stream, _) = listener.accept().unwrap();
    stream.set_read_timeout(Some(Duration::from_millis(50))).unwrap();
    let (mut receiver, mut heard) = (Receiver::new(), Vec::new());
    let mut speed = 0;
    loop {
        let mut buffer = [0; 256];
        match stream.read(&mut buffer) {
            Ok(0) => break,
            Ok(count) => {
                let mut bytes = &buffer[..count];
                while let Some(frame) = receiver.receive(&mut bytes) {
                    let frame = Frame::parse(frame).unwrap();
                    let command = Command::parse(frame.did, frame.data).unwrap();
                    if let Command::Move(moved) = command {
                        speed = moved.targets[0].unwrap();
                    }
                    let is_ping = command == Command::PingOrAck;
                    let moved = if let Command::Move(moved) = command { Some(moved) } else { None };
                    assert!(frame.rid == 1 && is_ping != moved.is_some(), "{command:?}");
                    heard.push((Instant::now(), moved));
                }
            }
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
            Err(_) => break, // the host has closed, with bytes of ours unread
        }
        // A negative speed has its sign in the direction.
        let encoder = Encoder { count: 0, speed: speed.unsigned_abs(), positive: speed >= 0 };
        let encoders = [encoder, Encoder::default()];
        let report = Report::Motors(MotorReport { encoders, ..MotorReport::default() });
        if stream.write_all(report.encode(&mut [0; MAX_FRAME]).unwrap()).is_err() {
            break;
        }
    }
    let printed = String::from_utf8(host.wait_with_output().unwrap().stdout).unwrap();
    assert!(
        printed.contains("\n4000 counts/s\n") && printed.ends_with("\n0 counts/s\n"),
        "{printed}"
    );
    let velocity = |speed| Some(motion(Quantity::Velocity, Addressing::List, &[(0, speed)]));
    let moves: Vec<_> = heard.iter().map(|(_, moved)| *moved).filter(Option::is_some).collect();
    assert_eq!(moves, [velocity(4000), velocity(0)]);
    assert_eq!(heard.len() - moves.len(), 4, "pings");
    let pauses = heard.windows(2).map(|pair| pair[1].0 - pair[0].0);
    assert!(pauses.max().unwrap() < Duration::from_secs(2), "the link is kept alive");
}
