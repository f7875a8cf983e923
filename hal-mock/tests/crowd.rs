//! Clients that nobody asked for: too many, silent, greedy, or a web page's. Whoever comes, a host
//! that speaks finds its place and its turn.
#![cfg(unix)]

mod program;

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{Shutdown, TcpStream, UdpSocket};
use std::process::Stdio;
use std::time::{Duration, Instant};

use program::{Board, PATIENCE, program};
use protocol::pms5005 as wire;
use serde_json::{Value, json};

fn gpio(outputs: u8) -> Vec<u8> {
    wire::Command::GpioOutputs(outputs).encode(0, &mut [0; 300]).unwrap().to_vec()
}

/// `READ position` to servo 1, and the length of what it answers.
const READ: [u8; 8] = [0xFF, 0xFF, 1, 4, 2, 36, 2, 0xD2];
const ANSWER: usize = 8;

#[track_caller]
fn is_answered(host: &mut TcpStream) {
    host.write_all(&READ).unwrap();
    host.read_exact(&mut [0; ANSWER]).expect("an answer");
}

/// Whether the other side ends the connection, whatever it says before.
fn ends(mut stream: &TcpStream) -> bool {
    let mut buffer = [0; 4096];
    let start = Instant::now();
    while start.elapsed() < PATIENCE {
        match stream.read(&mut buffer) {
            Ok(0) => return true,
            Ok(_) => {}
            Err(e) => return e.kind() == std::io::ErrorKind::ConnectionReset,
        }
    }
    false
}

#[test]
fn clients_that_come_and_go_without_a_word_keep_no_place() {
    for personality in ["ax12-bus", "pioneer-arm"] {
        let board = Board::start(&[personality]);
        (0..40).for_each(|_| drop(board.tcp()));
        let state = board.until(|state| state["host"]["tcp"] == 0);
        assert_eq!(state["host"]["refused"], 0);
    }
}

#[test]
fn clients_that_stay_and_say_nothing_lock_nobody_out() {
    let board = Board::start(&["ax12-bus"]);
    let mut silent: Vec<_> = (0..16).map(|_| board.tcp()).collect();
    board.until(|state| state["host"]["tcp"] == 16);
    is_answered(&mut board.tcp());
    assert!(ends(&silent.remove(0)), "the oldest one has gone");
    // The same for the inspector's.
    let _silent: Vec<_> =
        (0..16).map(|_| TcpStream::connect(board.place("inspect")).unwrap()).collect();
    board.state();
}

#[test]
fn who_finds_no_place_among_clients_that_speak_is_told_of_in_the_log() {
    let mut command = program(&["ax12-bus"]);
    let mut board = Board::spawn(command.env("RUST_LOG", "warn").stderr(Stdio::piped()));
    let mut hosts: Vec<_> = (0..16).map(|_| board.tcp()).collect();
    // Everybody hears the answers to all.
    for (k, host) in hosts.iter_mut().enumerate() {
        is_answered(host);
        host.read_exact(&mut vec![0; k * ANSWER]).unwrap();
    }
    let late = board.tcp();
    let address = late.local_addr().unwrap();
    assert!(ends(&late));
    // One that has shut down its side has been answered: it makes room.
    hosts[3].shutdown(Shutdown::Write).unwrap();
    board.until(|state| state["host"]["refused"] == 1);
    std::thread::sleep(Duration::from_millis(100));
    is_answered(&mut board.tcp());
    let log = board.log_after_end();
    assert!(log.contains(&format!("TCP client {address} is refused")), "{log}");
}

#[test]
fn a_datagram_of_whole_frames_is_taken_up_to_the_longest_there_is() {
    let board = Board::start(&["--udp", "127.0.0.1:0", "--line-rate", "0"]);
    let udp = UdpSocket::bind("127.0.0.1:0").unwrap();
    udp.connect(board.place("UDP")).unwrap();
    let frame = gpio(7);
    let count = if cfg!(target_os = "linux") { 65_507 } else { 9216 } / frame.len();
    udp.send(&frame.repeat(count)).unwrap();
    board.until(|state| state["link"]["frames_ok"] == count && state["gpio_out"] == 7);
}

#[test]
fn a_datagram_of_anything_else_is_dropped_whole_and_starves_nobody() {
    let board = Board::start(&["--udp", "127.0.0.1:0"]);
    let udp = UdpSocket::bind("127.0.0.1:0").unwrap();
    udp.connect(board.place("UDP")).unwrap();
    let mut host = board.tcp();
    let (mut sent, start) = (0, Instant::now());
    while start.elapsed() < Duration::from_secs(2) {
        // A header whose rest never comes.
        udp.send(&[0x5E, 2, 1, 0, 31, 255]).unwrap();
        sent += 1;
        host.write_all(&gpio(sent as u8)).unwrap();
        std::thread::sleep(Duration::from_millis(50));
    }
    for wrong in [&gpio(1)[1..], &[&gpio(1)[..], b"x"].concat(), b"", &[0x5E; 65_000][..9000]] {
        udp.send(wrong).unwrap();
        sent += 1;
    }
    let state = board.until(|state| state["host"]["datagrams_dropped"] == sent);
    assert_eq!(state["link"]["frames_ok"], sent - 4);
    assert_eq!(
        (&state["link"]["bad_frames"], &state["link"]["bytes_skipped"]),
        (&json!(0), &json!(0))
    );
    assert_eq!(state["host"]["udp"], 0, "nor has it made a peer");
}

#[test]
fn inspectors_that_ask_a_lot_leave_the_board_its_time() {
    let board = Board::start(&["pms5005", "--udp", "127.0.0.1:0"]);
    let mut host = board.tcp();
    let before = board.state()["t_ms"].as_u64().unwrap();
    let start = Instant::now();
    let question = b"{\"get\":\"state\"}\n".repeat(64);
    let mut clients: Vec<_> = (0..14)
        .map(|_| {
            let mut stream = TcpStream::connect(board.place("inspect")).unwrap();
            stream.set_read_timeout(Some(PATIENCE)).unwrap();
            stream.write_all(&question).unwrap();
            stream
        })
        .collect();
    // A host's commands go their way meanwhile.
    let asked = Instant::now();
    host.write_all(&gpio(0x3C)).unwrap();
    host.read_exact(&mut [0; 10]).unwrap();
    assert!(asked.elapsed() < Duration::from_millis(500), "{:?}", asked.elapsed());
    let last = clients
        .iter_mut()
        .map(|stream| {
            let lines = BufReader::new(stream).lines().take(64);
            let state: Value = serde_json::from_str(&lines.last().unwrap().unwrap()).unwrap();
            state["t_ms"].as_u64().unwrap()
        })
        .max();
    let (real, simulated) = (start.elapsed().as_millis() as u64, last.unwrap() - before);
    assert!(simulated > real * 3 / 4, "{simulated} of {real} ms");
}

#[test]
fn a_last_line_without_its_end_is_answered_and_one_that_is_too_long_is_told_so() {
    let board = Board::start(&["cm5"]);
    let ask = |question: &[u8]| {
        let mut stream = TcpStream::connect(board.place("inspect")).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        stream.write_all(question).unwrap();
        stream.shutdown(Shutdown::Write).unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        answer
    };
    assert!(ask(b"{\"get\":\"state\"}").contains("t_ms"));
    assert_eq!(ask(b"{\"set\":{}}\n{\"set\":{}}"), "{\"ok\":true}\n{\"ok\":true}\n");
    assert!(ask(&[b' '; 66_000]).contains("65536"));
}

#[test]
fn an_unknown_name_is_answered_with_those_that_exist_and_each_of_these_exists() {
    for (personality, some) in [
        ("pms5005", "sonar_cm"),
        ("pioneer-arm", "arm_link"),
        ("cm5", "jammed"),
        ("ax12-bus", "unplug"),
    ] {
        let board = Board::start(&[personality]);
        let answer = board.ask(json!({"set": {"bogus": 1}}));
        let error = answer["error"].as_str().unwrap();
        let (_, names) = error.split_once("there are ").expect(error);
        assert!(names.contains(some) && names.contains("link"), "{error}");
        for name in names.split(", ") {
            let answer = board.ask(json!({"set": {name: "nonsense"}}));
            let error = answer["error"].as_str().unwrap();
            assert!(error.starts_with(&format!("{name}: expected")), "{error}");
        }
    }
}

#[test]
fn the_state_tells_what_is_overridden() {
    let overridden = |board: &Board, set: Value| {
        assert_eq!(board.ask(json!({"set": set})), json!({"ok": true}));
        board.state()["overridden"].clone()
    };
    let board = Board::start(&["--udp", "127.0.0.1:0"]);
    assert_eq!(board.state()["overridden"], json!({}));
    let set = json!({"sonar_cm": [20, null, null, null, null, null], "temperature": 7,
        "jam": [true, null, false, null, null, null], "link": false});
    assert_eq!(overridden(&board, set.clone()), set);
    let none = json!({"sonar_cm": null, "temperature": null, "jam": null, "link": true});
    assert_eq!(overridden(&board, none), json!({}));

    let board = Board::start(&["pioneer-arm"]);
    let set = json!({"arm_link": false, "battery": [null, null, 1700]});
    assert_eq!(overridden(&board, set.clone()), set);
    assert_eq!(overridden(&board, json!({"arm_link": null, "battery": null})), json!({}));

    let board = Board::start(&["cm5"]);
    let set = json!({"unplug": [2], "jammed": [3], "flipped_ppm": 5});
    assert_eq!(overridden(&board, set.clone()), set);
    let none = json!({"replug": [2], "jammed": [], "flipped_ppm": null});
    assert_eq!(overridden(&board, none), json!({}));
}

#[test]
fn the_hosts_link_can_be_cut_and_mended() {
    let board = Board::start(&["--udp", "127.0.0.1:0"]);
    let mut host = board.tcp();
    host.write_all(&gpio(1)).unwrap();
    board.until(|state| state["gpio_out"] == 1);
    board.ask(json!({"set": {"link": false}}));
    host.write_all(&gpio(2)).unwrap();
    // What had left the board before may still come, and then nothing.
    let mut buffer = [0; 4096];
    host.set_read_timeout(Some(Duration::from_millis(300))).unwrap();
    while host.read(&mut buffer).is_ok_and(|count| count > 0) {}
    board.until(|state| state["faults"] == json!(["link_loss"]));
    assert_eq!(board.state()["gpio_out"], 1);
    board.ask(json!({"set": {"link": true}}));
    host.set_read_timeout(Some(PATIENCE)).unwrap();
    assert!(host.read(&mut buffer).unwrap() > 0);
    host.write_all(&gpio(3)).unwrap();
    board.until(|state| state["gpio_out"] == 3);
}

#[test]
fn a_web_page_is_not_obeyed() {
    let board = Board::start(&["--udp", "127.0.0.1:0"]);
    for method in ["POST", "GET", "OPTIONS", "PUT"] {
        let head = format!("{method} / HTTP/1.1\r\nHost: localhost\r\n\r\n");
        for place in ["TCP", "inspect"] {
            let mut page = TcpStream::connect(board.place(place)).unwrap();
            page.set_read_timeout(Some(PATIENCE)).unwrap();
            // In one piece, and byte by byte.
            let cut = if method == "POST" { 0 } else { 3 };
            for byte in head[..cut].bytes() {
                page.write_all(&[byte]).unwrap();
                std::thread::sleep(Duration::from_millis(3));
            }
            let body = [&gpio(9)[..], b"\n{\"set\":{\"link\":false}}\n"].concat();
            let _ = page.write_all(&[&head.as_bytes()[cut..], &body].concat());
            assert!(ends(&page), "{method} to {place}");
        }
    }
    let state = board.state();
    assert_eq!((&state["gpio_out"], &state["overridden"]), (&json!(0), &json!({})));
    assert_eq!(
        (&state["link"]["bytes_skipped"], &state["host"]["refused"]),
        (&json!(0), &json!(4))
    );
    // A host that begins with the same letters in the middle of something else is none.
    let mut host = board.tcp();
    host.write_all(b"P").unwrap();
    std::thread::sleep(Duration::from_millis(20));
    host.write_all(&gpio(4)).unwrap();
    board.until(|state| state["gpio_out"] == 4);
}
