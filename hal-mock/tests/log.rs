//! What the log says of a host's mistakes, without being asked to.
#![cfg(unix)]

mod program;

use std::io::Write;
use std::net::UdpSocket;
use std::process::Stdio;
use std::time::Duration;

use program::{Board, program};
use protocol::pms5005 as wire;
use protocol::pms5005::Frame;

fn board(options: &[&str]) -> Board {
    Board::spawn(program(options).env_remove("RUST_LOG").stderr(Stdio::piped()))
}

fn framed(frame: Frame<'_>) -> Vec<u8> {
    frame.encode(&mut [0; 300]).unwrap().to_vec()
}

/// The log has a line with all of these, and a time before them.
#[track_caller]
fn says(log: &str, words: &[&str]) {
    let said = |line: &str| line.starts_with("t=") && words.iter().all(|word| line.contains(word));
    assert!(log.lines().any(said), "{words:?}: {log}");
}

#[test]
fn a_bad_checksum_a_wrong_rid_and_a_refused_value_are_told_in_words() {
    let mut board = board(&["--udp", "127.0.0.1:0"]);
    let mut host = board.tcp();
    let good = framed(Frame { rid: 1, res: 0, did: 22, data: &[7] });
    let mut bad = good.clone();
    bad[7] ^= 0x10;
    host.write_all(&bad).unwrap();
    host.write_all(&framed(Frame { rid: 9, res: 0, did: 22, data: &[7] })).unwrap();
    // Channel 9 does not exist.
    host.write_all(&framed(Frame { rid: 1, res: 0, did: 5, data: &[9, 0, 0] })).unwrap();
    host.write_all(b"hello").unwrap();
    host.write_all(&good[..6]).unwrap();
    std::thread::sleep(Duration::from_millis(200));
    let udp = UdpSocket::bind("127.0.0.1:0").unwrap();
    udp.send_to(&bad, board.place("UDP")).unwrap();
    host.write_all(wire::Command::GpioOutputs(3).encode(0, &mut [0; 16]).unwrap()).unwrap();
    board.until(|state| state["gpio_out"] == 3);
    let log = board.log_after_end();
    let (came, right) = (format!("{:02x} came", bad[7]), format!("{:02x} is right", good[7]));
    says(&log, &["bad checksum: ", &came, &right, "in 5e 02 01 00 16 01 07"]);
    says(&log, &["wrong RID: 9 came, ours is 1", "5e 02 09"]);
    says(&log, &["frame not carried out: channel 9 does not exist"]);
    says(&log, &["no frame", "68 65 6c 6c 6f"]);
    says(&log, &["the rest of a frame does not come: 5e 02 01 00 16 01"]);
    says(&log, &["datagram from ", "dropped"]);
}

#[test]
fn the_other_formats_tell_a_bad_checksum_too() {
    let bus = [0xFF, 0xFF, 1, 2, 1, 0xFA];
    let arm = [0xFA, 0xFB, 3, 0, 0, 9];
    for (personality, bytes, says_it) in [
        ("ax12-bus", &bus[..], "bad checksum: fa came, fb is right, in ff ff 01 02 01 fa"),
        ("pioneer-arm", &arm[..], "bad checksum: 00 09 came, 00 00 is right, in fa fb 03 00 00 09"),
    ] {
        let mut board = board(&[personality]);
        board.tcp().write_all(bytes).unwrap();
        std::thread::sleep(Duration::from_millis(300));
        says(&board.log_after_end(), &[says_it]);
    }
}

#[test]
fn a_thousand_warnings_of_a_kind_are_a_few_lines_and_a_count() {
    let mut board = board(&["--udp", "127.0.0.1:0", "--line-rate", "0"]);
    let unknown = framed(Frame { rid: 1, res: 255, did: 31, data: &[] });
    board.tcp().write_all(&unknown.repeat(1000)).unwrap();
    board.until(|state| state["link"]["unknown"] == 1000);
    let log = board.log_after_end();
    let lines: Vec<_> = log.lines().filter(|line| line.contains("DID 31")).collect();
    assert!((4..20).contains(&lines.len()), "{log}");
    let more = lines.iter().filter_map(|line| line.split_once("s ")?.1.split_once(" more like"));
    let left_out: usize = more.clone().map(|(count, _)| count.parse::<usize>().unwrap()).sum();
    assert_eq!(left_out + lines.len() - more.count(), 1000, "{log}");
}

#[test]
fn the_log_can_be_switched_off() {
    let mut command = program(&["--udp", "127.0.0.1:0"]);
    let mut board = Board::spawn(command.env("RUST_LOG", "off").stderr(Stdio::piped()));
    board.tcp().write_all(b"hello").unwrap();
    std::thread::sleep(Duration::from_millis(200));
    assert_eq!(board.log_after_end(), "");
}
