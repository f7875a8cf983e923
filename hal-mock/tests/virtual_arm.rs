//! `virtual-board pioneer-arm` as a user runs it: a host over TCP and over the serial device, the
//! inspector, the options of this personality. What happens when is tested on virtual time, in
//! `tests/tests/pioneer_arm/`; here it is that things happen.
#![cfg(unix)]

mod program;

use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use program::{Board, PATIENCE, program, refused};
use protocol::arcos::{
    ArmCommand, ArmInfo, ArmStatus, JointNumber, Names, Packet, Receiver, StatusRequest, extension,
};
use protocol::extension::{Action, Assignments, Request, Verdict};
use protocol::pms5005::Data;
use serde_json::json;

fn arm(options: &[&str]) -> Board {
    let board = Board::start(&[&["pioneer-arm"], options].concat());
    assert_eq!(board.title, "Pioneer Arm at your service:");
    board
}

/// A host with an open session.
struct Host<S> {
    stream: S,
    receiver: Receiver,
}

impl<S: Read + Write> Host<S> {
    fn open(stream: S) -> Self {
        let mut host = Self { stream, receiver: Receiver::new() };
        for number in 0..3 {
            host.send_bare(number);
            let answer = host.receive(number);
            if number == 2 {
                let packet = Packet { id: 2, data: &answer };
                assert_eq!(Names::parse(&packet).unwrap().class, "Pioneer");
            }
        }
        host.send_bare(1);
        host.receive(0x32);
        host
    }

    fn send_bare(&mut self, id: u8) {
        let packet = Packet { id, data: &[] }.encode(&mut [0; 6]).unwrap().to_vec();
        self.stream.write_all(&packet).unwrap();
    }

    fn send(&mut self, command: ArmCommand) {
        self.stream.write_all(command.encode(&mut [0; 9]).unwrap()).unwrap();
    }

    /// Reads until a packet with this id has come; its data. The host is alive meanwhile.
    fn receive(&mut self, id: u8) -> Vec<u8> {
        let start = Instant::now();
        let mut buffer = [0; 256];
        while start.elapsed() < PATIENCE {
            let count = self.stream.read(&mut buffer).unwrap();
            let mut bytes = &buffer[..count];
            while let Some(packet) = self.receiver.receive(&mut bytes) {
                let packet = Packet::parse(packet).unwrap();
                if packet.id == id {
                    return packet.data.to_vec();
                }
            }
        }
        panic!("no packet with id {id}");
    }

    /// Asks for ARMpac until it shows something.
    fn until(&mut self, what: impl Fn(&[u8]) -> bool) -> Vec<u8> {
        let start = Instant::now();
        loop {
            self.send(ArmCommand::Status(StatusRequest::Once));
            let status = self.receive(ArmStatus::ID);
            if what(&status) {
                return status;
            }
            assert!(start.elapsed() < PATIENCE, "it never came: {status:?}");
        }
    }
}

fn over_tcp(board: &Board) -> Host<TcpStream> {
    Host::open(board.tcp())
}

fn position(joint: u8, ticks: u8) -> ArmCommand {
    ArmCommand::Position { joint: JointNumber::new(joint).unwrap(), ticks }
}

#[test]
fn a_host_moves_a_joint_and_the_inspector_sees_it() {
    let board = arm(&[]);
    let mut host = over_tcp(&board);
    let state = board.state();
    assert_eq!(state["joints"].as_array().unwrap().len(), 6);
    assert_eq!(
        state["joints"][1],
        json!({
            "ticks": 127, "moving": false, "powered": false, "pulse_us": 0.0, "at_us": 1500.0,
        })
    );
    host.send(ArmCommand::Power(true));
    host.send(position(2, 147));
    let status = host.until(|status| status[3] == 147 && status[1] == 0);
    assert_eq!(status, [0b11, 0, 127, 147, 127, 127, 127, 127]);
    let state = board.state();
    let joint = &state["joints"][1];
    assert_eq!(
        (&joint["ticks"], &joint["moving"], &joint["powered"]),
        (&json!(147), &json!(false), &json!(true),)
    );
    assert_eq!((&state["faults"], &state["link"]["refused"]), (&json!([]), &json!(0)));
}

#[test]
fn the_arms_cable_can_be_cut_and_mended() {
    let board = arm(&[]);
    let mut host = over_tcp(&board);
    host.send(ArmCommand::Power(true));
    host.until(|status| status[0] == 0b11);
    assert_eq!(board.ask(json!({"set": {"arm_link": false}})), json!({"ok": true}));
    host.until(|status| status[0] == 0);
    host.send(ArmCommand::Info);
    let info = host.receive(ArmInfo::ID);
    assert_eq!(info, b"No arm\0\0");
    assert_eq!(board.state()["faults"], json!(["no_arm"]));

    assert_eq!(board.ask(json!({"set": {"arm_link": true}})), json!({"ok": true}));
    host.send(ArmCommand::Init);
    host.until(|status| status[0] == 0b10);
    host.send(ArmCommand::Power(true));
    host.until(|status| status[0] == 0b11);

    for (change, named) in [(json!({"arm_link": 1}), "arm_link"), (json!({"jam": []}), "jam")] {
        let answer = board.ask(json!({"set": change}));
        assert!(answer["error"].as_str().unwrap().contains(named), "{answer}");
    }
}

#[test]
fn a_low_servo_battery_stops_the_arm_until_it_is_good_again_and_init_has_come() {
    let board = arm(&["--dialect", "aria"]);
    let mut host = over_tcp(&board);
    host.send(ArmCommand::Power(true));
    host.send(position(2, 147));
    host.until(|status| status[..4] == [0, 0b0111, 127, 147]);
    board.ask(json!({"set": {"battery": [null, null, 1700]}}));
    // Neither good nor initialised nor powered; and the joint is where it was.
    host.until(|status| status[..4] == [0, 0, 127, 147]);
    let state = board.state();
    assert_eq!(state["joints"][1]["powered"], json!(false));
    assert_eq!(state["faults"], json!(["needs_init", "servo_battery_low"]));
    host.send(ArmCommand::Power(true));
    host.send(position(2, 127));
    host.until(|status| status[..4] == [0, 0, 127, 147]);

    board.ask(json!({"set": {"battery": null}}));
    std::thread::sleep(Duration::from_millis(100));
    host.send(ArmCommand::Init);
    host.until(|status| status[1] == 0b0011);
    host.send(ArmCommand::Power(true));
    host.send(position(2, 127));
    host.until(|status| status[..4] == [0, 0b0111, 127, 127]);
    assert_eq!(board.state()["faults"], json!([]));
}

#[test]
fn the_dialect_is_an_option_and_the_serial_device_carries_the_session_too() {
    for (dialect, status) in [("aria", [0, 0b0111]), ("manual-b0", [0b11, 0])] {
        let board = arm(&["--dialect", dialect, "--line-rate", "9600"]);
        let mut host = Host::open(board.serial());
        host.send(ArmCommand::Power(true));
        host.until(|now| now[..2] == status);
    }
}

#[test]
fn settings_are_kept_in_a_file_and_a_dialect_on_the_command_line_goes_before_them() {
    let file = std::env::temp_dir().join(format!("arm-settings-{}", std::process::id()));
    let path = file.to_str().unwrap();
    let board = arm(&["--settings", path]);
    let mut host = over_tcp(&board);
    let mut data = Data::new();
    // ARIA's dialect, joint 2's home.
    for (number, value) in [(112, 2), (137, 90)] {
        Assignments::emit(number, value, &mut data).unwrap();
    }
    let set = Request::Set(Assignments::parse(&data).unwrap());
    for request in [set, Request::Do(Action::Save)] {
        host.stream.write_all(extension::encode_request(&request, &mut [0; 40]).unwrap()).unwrap();
        assert_eq!(host.receive(101)[2], Verdict::Done.number(), "{request:?}");
    }
    drop(board);
    for (options, status) in [
        (&["--settings", path][..], [0, 0b0011, 127, 90]),
        (&["--settings", path, "--dialect", "manual"], [0b10, 0, 127, 90]),
    ] {
        let board = arm(options);
        let mut host = over_tcp(&board);
        assert_eq!(host.until(|_| true)[..4], status);
        // A save keeps what was stored, whatever the command line says.
        let save = Request::Do(Action::Save);
        host.stream.write_all(extension::encode_request(&save, &mut [0; 40]).unwrap()).unwrap();
        assert_eq!(host.receive(101)[2], Verdict::Done.number());
    }
    let board = arm(&["--settings", path]);
    assert_eq!(over_tcp(&board).until(|_| true)[..4], [0, 0b0011, 127, 90]);
    drop(board);
    std::fs::remove_file(file).unwrap();
}

#[test]
fn options_that_are_not_the_arms_are_refused() {
    for (options, names) in [
        (&["--udp", "127.0.0.1:0"][..], "--udp: not for pioneer-arm"),
        (&["--dialect", "klingon"], "manual-b0"),
    ] {
        refused(&program(&[&["pioneer-arm"], options].concat()).output().unwrap(), names);
    }
    let output = program(&["--dialect", "aria"]).output().unwrap();
    refused(&output, "--dialect: not for pms5005, only for pioneer-arm");
}
