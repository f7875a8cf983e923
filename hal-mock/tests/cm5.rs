//! `virtual-board cm5` as a PC finds it, over TCP, in real time; the simulated truth behind it
//! comes from the inspector.
#![cfg(unix)]

mod program;

use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::Instant;

use program::{Board, PATIENCE, program, refused};
use protocol::cm5::{
    Goals, Hello, HelloAnswer, Limits, MAX_PACKET, Receiver, Report, ServoGoal, params_of,
};
use serde_json::json;

/// The PC of a running CM-5.
struct Pc {
    stream: TcpStream,
    receiver: Receiver,
}

impl Pc {
    fn of(board: &Board) -> Self {
        Self { stream: board.tcp(), receiver: Receiver::new() }
    }

    /// Reads until a packet has come that says something.
    fn until<T>(&mut self, mut what: impl FnMut(&[u8]) -> Option<T>) -> T {
        let start = Instant::now();
        let mut buffer = [0; 256];
        while start.elapsed() < PATIENCE {
            let count = self.stream.read(&mut buffer).unwrap();
            assert!(count > 0, "the board has closed the link");
            let mut bytes = &buffer[..count];
            while let Some(packet) = self.receiver.receive(&mut bytes) {
                if let Some(found) = what(params_of(packet).unwrap()) {
                    return found;
                }
            }
        }
        panic!("it never came");
    }

    fn hello(&mut self) -> Vec<u8> {
        self.until(|params| Hello::parse(params).map(|hello| hello.ids.to_vec()))
    }

    /// A report in which all servos are heard, or just those that are not stale.
    fn report(&mut self, heard: &[bool]) {
        self.until(|params| {
            let report = Report::parse(params, heard.len())?;
            report.iter().map(|servo| servo.is_some()).eq(heard.iter().copied()).then_some(())
        });
    }
}

#[test]
fn a_pc_is_greeted_drives_servos_and_sees_one_go_and_come_back() {
    let options = ["cm5", "--servos", "3,7-8", "--bus-faults", "stalled=1000"];
    let board = Board::start(&options);
    assert_eq!(board.title, "CM-5 at your service:");
    let mut pc = Pc::of(&board);
    assert_eq!(pc.hello(), [3, 7, 8]);
    let mut buffer = [0; MAX_PACKET];
    let all = [Limits::new(100, 900).unwrap()];
    pc.stream.write_all(HelloAnswer::encode(1, &all, &mut buffer).unwrap()).unwrap();
    pc.report(&[true; 3]);
    let goal = ServoGoal([1, 0, 0, 0, 32, 32, 44, 1, 0, 0, 0, 0, 0, 0, 0]);
    pc.stream.write_all(Goals::encode(&[goal; 3], &mut buffer).unwrap()).unwrap();
    let state = board.until(|state| state["servos"][1]["goal"] == 300);
    let servo = &state["servos"][1];
    assert_eq!((&servo["id"], &servo["bridge"]["agreed"]), (&json!(7), &json!(true)));
    assert_eq!(
        (&servo["registers"]["return_delay"], &servo["registers"]["cw_limit"]),
        (&json!(1), &json!(100))
    );
    assert_eq!(state["bridge"]["pc"]["goals"], 1);
    assert!(state["bridge"]["cycles"].as_u64() > Some(0));

    assert_eq!(board.ask(json!({"set": {"unplug": [7]}})), json!({"ok": true}));
    pc.report(&[true, false, true]);
    assert_eq!(board.ask(json!({"set": {"replug": [7]}})), json!({"ok": true}));
    pc.report(&[true; 3]);

    for (question, names) in [
        (json!({"set": {"unplug": [9]}}), "unplug: expected a list of IDs out of [3, 7, 8]"),
        (json!({"set": {"unplug": [3], "replug": 3}}), "replug: expected"),
        (json!({"set": {"flipped_ppm": 1_000_001}}), "flipped_ppm: expected"),
        (json!({"set": {"jam": [3]}}), "jam: nothing"),
    ] {
        let answer = board.ask(question);
        assert!(answer["error"].as_str().is_some_and(|e| e.contains(names)), "{answer}");
    }
    assert_eq!(board.state()["servos"][0]["plugged"], true);
}

/// A client whose socket holds next to nothing that it has not read.
fn narrow(place: &str) -> TcpStream {
    use rustix::net::{AddressFamily, SocketType, connect, socket, sockopt};
    let socket = socket(AddressFamily::INET, SocketType::STREAM, None).unwrap();
    sockopt::set_socket_recv_buffer_size(&socket, 4096).unwrap();
    connect(&socket, &place.parse::<std::net::SocketAddr>().unwrap()).unwrap();
    let stream = TcpStream::from(socket);
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    stream
}

#[test]
fn a_pc_that_has_not_read_for_a_while_soon_hears_the_newest_report() {
    let board = Board::start(&["cm5", "--servos", "1-18"]);
    let mut pc = Pc { stream: narrow(board.place("TCP")), receiver: Receiver::new() };
    assert_eq!(pc.hello().len(), 18);
    let mut buffer = [0; MAX_PACKET];
    let all = [Limits::new(0, 1023).unwrap()];
    pc.stream.write_all(HelloAnswer::encode(1, &all, &mut buffer).unwrap()).unwrap();
    pc.report(&[true; 18]);
    // Some 500 reports go by, of which it reads none.
    let sent = |board: &Board| board.state()["bridge"]["pc"]["reports_sent"].as_u64().unwrap();
    let before = sent(&board);
    board.until(|state| state["bridge"]["pc"]["reports_sent"].as_u64() > Some(before + 500));
    board.ask(json!({"set": {"unplug": [18]}}));
    board.until(|state| state["servos"][17]["bridge"]["missing"] == true);
    let mut old = 0;
    pc.until(|params| {
        let report = Report::parse(params, 18)?;
        let is_old = report.iter().all(|servo| servo.is_some());
        old += u32::from(is_old);
        (!is_old).then_some(())
    });
    // 12 KB hold 80.
    assert!(old < 120, "{old} reports from before");
}

#[test]
fn what_is_wrong_with_the_command_line_is_named() {
    for (options, names) in [
        (&["--servos", "5-2"][..], "--servos 5-2: expected IDs"),
        (&["--servos", "254"], "--servos 254: expected IDs"),
        (&["--servos", "0-3"], "--servos 0-3: expected IDs from 1 to 253"),
        (&["--servos", ""], "--servos : expected IDs"),
        (&["--bus-faults", "lost=3"], "--bus-faults lost=3: expected dropped="),
        (&["--bus-faults", "dropped=2000000"], "--bus-faults dropped=2000000: expected"),
        (&["--udp", "127.0.0.1:0"], "--udp: not for cm5"),
        (&["--scene", "x.toml"], "--scene: not for cm5"),
    ] {
        let options = [&["cm5", "--tcp", "127.0.0.1:0"], options].concat();
        refused(&program(&options).output().unwrap(), names);
    }
}
