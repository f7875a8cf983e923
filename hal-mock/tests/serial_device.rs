//! The serial device under hosts that treat it as a terminal: what they flush, and how they leave it.
#![cfg(unix)]

mod program;

use std::fs::File;
use std::io::{Read, Write};
use std::os::unix::fs::symlink;
use std::time::{Duration, Instant};

use program::{Board, PATIENCE};
use protocol::pms5005::{Command, LcdFrame};
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
    const FRAMES: u64 = 300;
    let board = Board::start(&["--udp", "127.0.0.1:0", "--line-rate", "57600"]);
    let mut host = board.serial();
    let columns = [0x55; LcdFrame::COLUMNS];
    for _ in 0..FRAMES {
        tcflush(&host, QueueSelector::OFlush).unwrap();
        let mut buffer = [0; 100];
        let picture = Command::Lcd(LcdFrame { number: 0, columns: &columns });
        host.write_all(picture.encode(0, &mut buffer).unwrap()).unwrap();
        // Two and a half times faster than the line.
        std::thread::sleep(Duration::from_millis(5));
    }
    let start = Instant::now();
    let frames = || board.state()["link"]["frames_ok"].as_u64().unwrap();
    let (mut before, mut now) = (0, frames());
    while now > before && now < FRAMES && start.elapsed() < PATIENCE {
        std::thread::sleep(Duration::from_secs(1));
        (before, now) = (now, frames());
    }
    // What the kernel is late to pass on when these machines are busy is lost; without the thread
    // more than a third is, on any.
    assert!(now > FRAMES * 8 / 10, "{now} of {FRAMES}");
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
