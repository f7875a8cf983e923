//! `virtual-board cm5` as a PC finds it, over TCP, in real time; the simulated truth behind it
//! comes from the inspector.
#![cfg(unix)]

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use protocol::cm5::{Answer, Goal, Goals, Hello, Limits, MAX_PACKET, Packet, Receiver, Report};
use serde_json::{Value, json};

const PATIENCE: Duration = Duration::from_secs(20);

fn program(options: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_virtual-board"));
    command.arg("cm5").args(["--tcp", "127.0.0.1:0", "--headless"]).args(options);
    command
}

/// A running CM-5, and its PC.
struct Board {
    child: Child,
    inspect: String,
    pc: TcpStream,
    receiver: Receiver,
}

impl Board {
    fn start(options: &[&str]) -> Self {
        let mut child = program(options)
            .args(["--inspect", "127.0.0.1:0"])
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut out = BufReader::new(child.stdout.take().unwrap());
        let mut line = || {
            let mut line = String::new();
            out.read_line(&mut line).unwrap();
            line.trim().to_owned()
        };
        assert_eq!(line(), "CM-5 at your service:");
        assert!(line().starts_with("serial device "));
        let pc = TcpStream::connect(line().strip_prefix("TCP ").unwrap()).unwrap();
        pc.set_read_timeout(Some(PATIENCE)).unwrap();
        let inspect = line().strip_prefix("inspect ").unwrap().to_owned();
        Self { child, inspect, pc, receiver: Receiver::new() }
    }

    /// Reads until a packet has come that says something.
    fn until<T>(&mut self, mut what: impl FnMut(&[u8]) -> Option<T>) -> T {
        let start = Instant::now();
        let mut buffer = [0; 256];
        while start.elapsed() < PATIENCE {
            let count = self.pc.read(&mut buffer).unwrap();
            assert!(count > 0, "the board has closed the link");
            let mut bytes = &buffer[..count];
            while let Some(packet) = self.receiver.receive(&mut bytes) {
                if let Some(found) = what(Packet::parse(packet).unwrap().params) {
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

    fn ask(&self, question: Value) -> Value {
        let mut stream = TcpStream::connect(&self.inspect).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        stream.write_all(format!("{question}\n").as_bytes()).unwrap();
        let mut answer = String::new();
        BufReader::new(stream).read_line(&mut answer).unwrap();
        serde_json::from_str(&answer).unwrap()
    }
}

impl Drop for Board {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[test]
fn a_pc_is_greeted_drives_servos_and_sees_one_go_and_come_back() {
    let mut board = Board::start(&["--servos", "3,7-8", "--bus-faults", "stalled=1000"]);
    assert_eq!(board.hello(), [3, 7, 8]);
    let mut buffer = [0; MAX_PACKET];
    let all = [Limits::new(100, 900).unwrap()];
    board.pc.write_all(Answer::encode(1, &all, &mut buffer).unwrap()).unwrap();
    board.report(&[true; 3]);
    let goal = Goal { torque_enable: 1, slope: [32; 2], position: 300, ..Goal::default() };
    board.pc.write_all(Goals::encode(&[goal; 3], &mut buffer).unwrap()).unwrap();
    let start = Instant::now();
    let state = loop {
        let state = board.ask(json!({"get": "state"}));
        if state["servos"][1]["goal"] == 300 {
            break state;
        }
        assert!(start.elapsed() < PATIENCE, "{state}");
    };
    let servo = &state["servos"][1];
    assert_eq!((&servo["id"], &servo["bridge"]["agreed"]), (&json!(7), &json!(true)));
    assert_eq!(
        (&servo["registers"]["return_delay"], &servo["registers"]["cw_limit"]),
        (&json!(1), &json!(100))
    );
    assert_eq!(state["bridge"]["pc"]["goals"], 1);
    assert!(state["bridge"]["cycles"].as_u64() > Some(0));

    assert_eq!(board.ask(json!({"set": {"unplug": [7]}})), json!({"ok": true}));
    board.report(&[true, false, true]);
    assert_eq!(board.ask(json!({"set": {"replug": [7]}})), json!({"ok": true}));
    board.report(&[true; 3]);

    for (question, names) in [
        (json!({"set": {"unplug": [9]}}), "unplug: expected a list of IDs out of [3, 7, 8]"),
        (json!({"set": {"unplug": [3], "replug": 3}}), "replug: expected"),
        (json!({"set": {"flipped_ppm": 1_000_001}}), "flipped_ppm: expected"),
        (json!({"set": {"jam": [3]}}), "jam: nothing"),
    ] {
        let answer = board.ask(question);
        assert!(answer["error"].as_str().is_some_and(|e| e.contains(names)), "{answer}");
    }
    assert_eq!(board.ask(json!({"get": "state"}))["servos"][0]["plugged"], true);
}

#[test]
fn what_is_wrong_with_the_command_line_is_named_in_one_line() {
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
        let output = program(options).output().unwrap();
        let error = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{error}");
        assert!(error.lines().count() == 1 && error.contains(names), "{names}: {error}");
    }
}
