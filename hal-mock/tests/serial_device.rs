//! The serial device under hosts that treat it as a terminal: what they flush, and how they leave it.
#![cfg(unix)]

mod program;

use std::fs::File;
use std::io::{Read, Write};
use std::os::unix::fs::symlink;
use std::time::{Duration, Instant};

use program::{Board, PATIENCE};
use protocol::pms5005::Command;
use rustix::termios::{
    InputModes, LocalModes, OptionalActions, OutputModes, QueueSelector, tcflush, tcgetattr,
    tcsetattr,
};

/// What AX-12 servos are told or asked.
fn instruction(id: u8, code: u8, params: &[u8]) -> Vec<u8> {
    let body = [&[id, params.len() as u8 + 2, code], params].concat();
    let sum = body.iter().fold(0u8, |sum, byte| sum.wrapping_add(*byte));
    [&[0xFF, 0xFF], &body[..], &[!sum]].concat()
}

#[test]
fn a_host_that_flushes_its_output_before_each_packet_takes_back_none_that_the_line_has_no_time_for()
{
    const FRAMES: u16 = 1000;
    let board = Board::start(&["--udp", "127.0.0.1:0", "--line-rate", "19200"]);
    let mut host = board.serial();
    for n in 0..FRAMES {
        tcflush(&host, QueueSelector::OFlush).unwrap();
        let mut buffer = [0; 16];
        host.write_all(Command::GpioOutputs(n as u8).encode(0, &mut buffer).unwrap()).unwrap();
        // What a host has to do between two packets. Five times faster than the line.
        std::thread::sleep(Duration::from_millis(1));
    }
    // The kernel may be late to pass something on when these machines are busy, and that is lost.
    let (mut before, start) = (0, Instant::now());
    while start.elapsed() < PATIENCE {
        let frames = board.state()["link"]["frames_ok"].as_u64().unwrap();
        if frames == u64::from(FRAMES) || frames == before && frames > 0 {
            before = frames;
            break;
        }
        before = frames;
        std::thread::sleep(Duration::from_millis(500));
    }
    println!("{before} of {FRAMES}");
    assert!(before > u64::from(FRAMES) * 9 / 10, "{before} of {FRAMES}");
}

#[test]
fn the_device_is_raw_for_the_next_host_whatever_the_last_one_has_left() {
    let board = Board::start(&["ax12-bus"]);
    let sane = LocalModes::ECHO | LocalModes::ICANON | LocalModes::ISIG;
    for _ in 0..10 {
        let host = board.serial();
        let mut attributes = tcgetattr(&host).unwrap();
        attributes.local_modes |= sane;
        attributes.input_modes |= InputModes::ICRNL | InputModes::IXON;
        attributes.output_modes |= OutputModes::OPOST | OutputModes::ONLCR;
        tcsetattr(&host, OptionalActions::Now, &attributes).unwrap();
        drop(host);
        std::thread::sleep(Duration::from_millis(20));
        let mut host = board.serial();
        let attributes = tcgetattr(&host).unwrap();
        assert!(!attributes.local_modes.intersects(sane), "{attributes:?}");
        assert!(
            attributes.input_modes.is_empty()
                && !attributes.output_modes.contains(OutputModes::OPOST)
        );
        host.write_all(&instruction(1, 1, &[])).unwrap();
        let mut answer = [0; 6];
        host.read_exact(&mut answer).unwrap();
        assert_eq!(answer, [0xFF, 0xFF, 1, 2, 0, 0xFC]);
    }
}

#[test]
fn a_killed_boards_link_is_replaced_though_another_terminal_has_its_number() {
    let link = std::env::temp_dir().join(format!("link-of-a-killed-board-{}", std::process::id()));
    let other = Board::start(&["ax12-bus"]);
    // What a kill -9 has left, and then the number was given anew: a terminal younger than the link.
    let _ = std::fs::remove_file(&link);
    let number = || other.place("serial").to_owned();
    symlink(number(), &link).unwrap();
    std::thread::sleep(Duration::from_millis(50));
    // A change of its mode makes a device as young as one that was opened anew.
    let permissions = std::fs::metadata(number()).unwrap().permissions();
    std::fs::set_permissions(number(), permissions).unwrap();
    let board = Board::start(&["ax12-bus", "--pty", link.to_str().unwrap()]);
    assert_eq!(std::fs::read_link(&link).unwrap(), std::path::Path::new(board.place("serial")));
    File::options().read(true).write(true).open(&link).unwrap();
    drop(board); // killed
    std::fs::remove_file(&link).unwrap();
}
