//! What can happen to the board's files, and how it was started: it says so, and keeps serving.
#![cfg(unix)]

mod program;

use std::fs;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use program::{Board, PATIENCE, program};
use protocol::extension::{Action, Assignments, Request, Verdict};
use protocol::pms5005 as wire;
use protocol::pms5005::{Frame, Receiver};

const FREE_PORTS: [&str; 4] = ["--tcp", "127.0.0.1:0", "--udp", "127.0.0.1:0"];
const SIZE: u64 = 3 * 16 * 1024;

/// A name in a place of its own.
fn named(name: &str) -> PathBuf {
    let path = std::env::temp_dir().join(format!("virtual-board-{}-{name}", std::process::id()));
    let _ = fs::remove_file(&path);
    path
}

/// A board with settings in this file, whose log can be read when it has ended.
fn board(settings: &Path) -> Board {
    let mut command = program(&["--udp", "127.0.0.1:0", "--settings", settings.to_str().unwrap()]);
    Board::spawn(command.env("RUST_LOG", "warn").stderr(Stdio::piped()))
}

/// Asks the board for something; DATA of the answer with this DID.
fn ask(stream: &mut TcpStream, request: Request, did: u8) -> Vec<u8> {
    let request = wire::Command::Extension(request);
    stream.write_all(request.encode(0, &mut [0; 300]).unwrap()).unwrap();
    let (mut receiver, mut buffer) = (Receiver::new(), [0; 256]);
    loop {
        let count = stream.read(&mut buffer).unwrap();
        let mut bytes = &buffer[..count];
        while let Some(frame) = receiver.receive(&mut bytes) {
            let frame = Frame::parse(frame).unwrap();
            if frame.did == did {
                return frame.data.to_vec();
            }
        }
    }
}

/// Has the board save its settings; what it says to that.
fn save(stream: &mut TcpStream) -> u8 {
    ask(stream, Request::Do(Action::Save), 101)[2]
}

#[test]
fn a_settings_file_that_is_removed_fails_a_save_and_nothing_else() {
    let file = named("removed");
    let mut board = board(&file);
    let mut host = board.tcp();
    assert_eq!(save(&mut host), Verdict::Done.number());
    fs::remove_file(&file).unwrap();
    assert_ne!(save(&mut host), Verdict::Done.number());
    board.state();
    let log = board.log_after_end();
    assert!(log.contains("their file was removed"), "{log}");
}

#[test]
fn a_settings_file_that_is_cut_short_is_written_anew() {
    let file = named("cut-short");
    let mut first = board(&file);
    let mut host = first.tcp();
    assert_eq!(save(&mut host), Verdict::Done.number());
    let before = fs::read(&file).unwrap();
    fs::File::options().write(true).open(&file).unwrap().set_len(100).unwrap();
    assert_eq!(save(&mut host), Verdict::Done.number());
    let after = fs::read(&file).unwrap();
    assert_eq!((after.len() as u64, &after[..200]), (SIZE, &before[..200]));
    let log = first.log_after_end();
    assert!(log.contains("cut short"), "{log}");
    drop(first);
    drop(board(&file));
    fs::remove_file(&file).unwrap();
}

#[test]
fn what_is_no_file_is_refused_and_nobody_is_waited_for() {
    let fifo = named("fifo");
    assert!(Command::new("mkfifo").arg(&fifo).status().unwrap().success());
    for (option, path) in [
        ("--settings", fifo.to_str().unwrap()),
        ("--scene", fifo.to_str().unwrap()),
        ("--settings", "/tmp"),
    ] {
        let mut child = program(&[&FREE_PORTS[..], &[option, path]].concat())
            .stderr(Stdio::piped())
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        let start = Instant::now();
        while child.try_wait().unwrap().is_none() {
            if start.elapsed() > PATIENCE {
                child.kill().unwrap();
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        let output = child.wait_with_output().unwrap();
        let error = String::from_utf8(output.stderr).unwrap();
        assert!(error.contains(&format!("{option} {path}: must be a file")), "{error}");
    }
    fs::remove_file(&fifo).unwrap();
}

#[test]
fn the_null_device_keeps_no_settings_and_a_board_says_so_and_serves() {
    let mut board = board(Path::new("/dev/null"));
    let mut host = board.tcp();
    assert_ne!(save(&mut host), Verdict::Done.number());
    assert_ne!(save(&mut host), Verdict::Done.number(), "and goes on serving");
    let log = board.log_after_end();
    assert!(log.contains("/dev/null: keeps nothing"), "{log}");
}

#[test]
fn what_a_full_disk_has_left_of_a_settings_file_is_used_again() {
    let file = named("full-disk");
    // A limit of 4 KiB or 8 in place of a full disk; its signal is ignored.
    let script = r#"trap '' XFSZ; ulimit -f 8; exec "$0" "$@""#;
    let output = Command::new("sh")
        .args(["-c", script, env!("CARGO_BIN_EXE_virtual-board")])
        .args(FREE_PORTS)
        .args(["--seconds", "0", "--settings", file.to_str().unwrap()])
        .output()
        .unwrap();
    let error = String::from_utf8(output.stderr).unwrap();
    assert!(error.contains(file.to_str().unwrap()), "{error}");
    assert!(fs::metadata(&file).unwrap().len() < SIZE);
    let board = board(&file);
    assert_eq!(save(&mut board.tcp()), Verdict::Done.number());
    drop(board);
    fs::remove_file(&file).unwrap();
}

#[test]
fn a_signal_that_was_ignored_stays_ignored() {
    let mut command = Command::new("sh");
    // What nohup does, and a shell's & to the second.
    let script = r#"trap '' HUP INT; exec "$0" "$@""#;
    command.args(["-c", script, env!("CARGO_BIN_EXE_virtual-board"), "ax12-bus"]);
    let mut board = Board::spawn(&mut command);
    for signal in [1, 2] {
        board.kill(signal);
        std::thread::sleep(Duration::from_millis(100));
        board.state();
    }
    let (code, text) = board.signal(15);
    assert_eq!((code, text.lines().next_back()), (Some(0), Some("bye")));
}

/// A limit of the file's size in place of a disk that is full, and then is not.
#[test]
#[cfg(target_os = "linux")]
fn a_disk_that_is_full_fails_saves_until_it_has_room_again() {
    let file = named("full-for-a-while");
    drop(board(&file)); // the file is made
    let mut command = Command::new("sh");
    let script = r#"trap '' XFSZ; ulimit -S -f 8; exec "$0" "$@""#;
    command.args(["-c", script, env!("CARGO_BIN_EXE_virtual-board"), "--udp", "127.0.0.1:0"]);
    command.args(["--settings", file.to_str().unwrap()]).stderr(Stdio::piped());
    let mut full = Board::spawn(&mut command);
    let mut host = full.tcp();
    // A record takes less than a KiB.
    let saved = (0..20).take_while(|_| save(&mut host) == Verdict::Done.number()).count();
    assert!((1..20).contains(&saved), "{saved}");
    let pid = full.pid().to_string();
    let freed = Command::new("prlimit").args(["--pid", &pid, "--fsize=unlimited"]).status();
    assert!(freed.unwrap().success());
    // What the file did not take before, it takes now.
    let mut data = wire::Data::new();
    Assignments::emit(1, 1234, &mut data).unwrap();
    ask(&mut host, Request::Set(Assignments::parse(&data).unwrap()), 101);
    assert_eq!(save(&mut host), Verdict::Done.number());
    let log = full.log_after_end();
    assert!(log.contains("settings are not saved: File too large"), "{log}");
    drop(full);
    let board = board(&file);
    let mut host = board.tcp();
    assert_eq!(ask(&mut host, Request::Setting(1), 96)[4..8], 1234i32.to_le_bytes());
    fs::remove_file(&file).unwrap();
}
