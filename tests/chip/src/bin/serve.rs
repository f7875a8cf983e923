//! Offers a modelled chip's host line over TCP, for anyone who wants to talk to the firmware itself:
//!     .ci/chip serve [IMAGE [PORT]]
//! IMAGE is one of `.ci/images` (pms5005-f407), PORT is on this computer (5005). Time runs with the
//! wall's as far as the computer can follow.

use std::io::{ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use chip::bench::{Bench, image};

/// How long the chip runs between two looks at the socket.
const SLICE_MS: u64 = 1;
/// Bytes that wait for a host that does not read; behind them it is let go.
const OUTGOING: usize = 1 << 20;

fn main() -> ExitCode {
    let mut arguments = std::env::args().skip(1);
    let name = arguments.next().unwrap_or_else(|| "pms5005-f407".into());
    let port = arguments.next().unwrap_or_else(|| "5005".into());
    if arguments.next().is_some() || name.starts_with('-') {
        return fail("usage: .ci/chip serve [IMAGE [PORT]]");
    }
    if !image(&name).is_file() {
        return fail(&format!("there is no image {name} in target/images"));
    }
    let Ok(port) = port.parse::<u16>() else {
        return fail(&format!("{port} is no port: 0 to 65535"));
    };
    let listener = match TcpListener::bind(("127.0.0.1", port)) {
        Ok(listener) => listener,
        Err(error) => return fail(&format!("port {port}: {error}; choose another")),
    };
    let address = listener.local_addr().expect("it is bound");
    println!("{name} on a modelled STM32F407, its host's line at {address}; Ctrl-C ends it");
    match serve(&mut Bench::boot(&name), &listener) {
        Ok(never) => never,
        Err(error) => fail(&error.to_string()),
    }
}

fn fail(reason: &str) -> ExitCode {
    eprintln!("serve: {reason}");
    ExitCode::FAILURE
}

/// Carries bytes between the chip's line and whoever connected last, for ever.
fn serve(bench: &mut Bench, listener: &TcpListener) -> std::io::Result<ExitCode> {
    listener.set_nonblocking(true)?;
    let mut host: Option<TcpStream> = None;
    let mut outgoing = Vec::new();
    let begun = Instant::now();
    loop {
        if let Ok((stream, _)) = listener.accept() {
            stream.set_nonblocking(true)?;
            stream.set_nodelay(true)?;
            host = Some(stream);
            outgoing.clear();
        }
        bench.run_for(SLICE_MS);
        outgoing.extend(bench.line.heard().into_iter().map(|(_, byte)| byte));
        let is_there = host.as_mut().is_some_and(|stream| carry(stream, bench, &mut outgoing));
        if !is_there || outgoing.len() > OUTGOING {
            host = None;
            outgoing.clear();
        }
        let ahead = Duration::from_nanos(bench.now_ns()).saturating_sub(begun.elapsed());
        std::thread::sleep(ahead);
    }
}

/// Whether the host is still there.
fn carry(stream: &mut TcpStream, bench: &Bench, outgoing: &mut Vec<u8>) -> bool {
    let mut buffer = [0; 512];
    let read = match stream.read(&mut buffer) {
        Ok(0) => return false,
        Ok(count) => count,
        Err(error) if error.kind() == ErrorKind::WouldBlock => 0,
        Err(_) => return false,
    };
    bench.line.send(&buffer[..read]);
    match stream.write(outgoing) {
        Ok(count) => {
            outgoing.drain(..count);
            true
        }
        Err(error) => error.kind() == ErrorKind::WouldBlock,
    }
}
