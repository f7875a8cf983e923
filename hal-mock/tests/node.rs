//! `node board.mjs`, the virtual board for those who have Node and no Rust, under hosts: `handwheel` and `rustypot`,
//! a Dynamixel master that no one here wrote.
//!
//!     .ci/page && cargo test -p hal-mock --test node -- --ignored
#![cfg(unix)]

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::Duration;

use handwheel::{Client, Number, Target};
use rustypot::servo::dynamixel::ax::AxController;
use serialport::{SerialPort, TTYPort};

fn target() -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    std::env::var_os("CARGO_TARGET_DIR").map_or(root.join("target"), PathBuf::from)
}

fn node(words: &[&str]) -> Command {
    let mut command = Command::new("node");
    command.arg(target().join("one-file/board.mjs")).args(words);
    command
}

/// The board of a personality, and where it listens.
struct Board(Child, String);

impl Board {
    fn start(personality: &str) -> Self {
        let mut child = node(&[personality, "127.0.0.1:0"]).stdout(Stdio::piped()).spawn().unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
        assert_eq!(lines.next().unwrap().unwrap(), format!("{personality} at your service:"));
        let place = lines.next().unwrap().unwrap().replace("TCP", "").trim().to_owned();
        Self(child, place)
    }

    fn client(&self) -> Client {
        Client::connect(&format!("tcp:{}", self.1).parse().unwrap()).unwrap()
    }
}

impl Drop for Board {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
#[ignore = "needs Node and what .ci/page builds"]
fn handwheel_drives_it_beside_a_host_that_listens() {
    let board = Board::start("pms5005");
    let mut other = TcpStream::connect(&board.1).unwrap();
    let mut client = board.client();
    let mut drive = client.drive(Number::ONE, Target::Velocity(2000), Duration::ZERO).unwrap();
    drive.hold(Duration::from_secs(1)).unwrap();
    let stopped = drive.stop().unwrap();
    assert_eq!(stopped.stands, Some(true));
    assert!((1200..3000).contains(&stopped.position.unwrap().1), "{stopped:?}");

    // A setting is saved, and there for the next client.
    let period = client.setting("telemetry period").unwrap();
    client.set(&period.name, 40).unwrap();
    client.save().unwrap();
    drop(client);
    assert_eq!(board.client().setting("telemetry period").unwrap().value, 40);
    // The other has heard all of it.
    let mut heard = [0; 2000];
    other.read_exact(&mut heard).unwrap();
}

#[test]
#[ignore = "needs Node and what .ci/page builds"]
fn an_arm_and_a_cm5_answer() {
    let board = Board::start("pioneer-arm");
    assert_eq!(board.client().arm().unwrap().names.unwrap()[1], "Pioneer");
    let board = Board::start("cm5");
    let mut client = board.client();
    let servos = client.servos().unwrap().next().unwrap().unwrap();
    assert_eq!(servos.len(), 6);
}

#[test]
#[ignore = "needs Node and what .ci/page builds"]
fn an_independent_master_finds_reads_and_writes_the_servos_of_a_pass_through() {
    let board = Board::start("cm5-pass-through");
    let (mut ours, masters) = TTYPort::pair().unwrap();
    let mut line = TcpStream::connect(&board.1).unwrap();
    let (mut to_line, mut from_ours) =
        (line.try_clone().unwrap(), ours.try_clone_native().unwrap());
    let carry = |from: &mut dyn Read, to: &mut dyn Write| {
        let mut buffer = [0; 256];
        loop {
            match from.read(&mut buffer) {
                Ok(0) => break,
                Ok(count) => to.write_all(&buffer[..count]).unwrap(),
                Err(error) if error.kind() == std::io::ErrorKind::TimedOut => {}
                Err(_) => break,
            }
        }
    };
    thread::spawn(move || carry(&mut from_ours, &mut to_line));
    thread::spawn(move || carry(&mut line, &mut ours));

    let mut port: Box<dyn SerialPort> = Box::new(masters);
    port.set_timeout(Duration::from_millis(500)).unwrap();
    let mut master = AxController::new().with_protocol_v1().with_serial_port(port);
    assert_eq!(master.read_model_number(3).unwrap(), [12]);
    master.write_torque_enable(3, 1).unwrap();
    master.write_moving_speed(3, 1023).unwrap();
    master.write_raw_goal_position(3, 700).unwrap();
    // A position short of the goal, within the margin, the motor rests.
    let mut is_there = || {
        thread::sleep(Duration::from_millis(20));
        master.read_raw_present_position(3).unwrap() == [699]
    };
    assert!((0..1000).any(|_| is_there()));
}

#[test]
#[ignore = "needs Node and what .ci/page builds"]
fn what_is_wrong_is_said_in_a_line() {
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let place = taken.local_addr().unwrap().to_string();
    for (words, status, says) in [
        (&["pms5006"][..], 2, "usage: node board.mjs [pms5005|"),
        (&["toString", "127.0.0.1:0"], 2, "usage:"),
        (&["cm5", "here"], 2, "usage:"),
        (&["cm5", "127.0.0.1:70000"], 2, "usage:"),
        (&["cm5", "127.0.0.1:0", "more"], 2, "usage:"),
        (&["cm5", &place], 1, "EADDRINUSE"),
    ] {
        let said = node(words).output().unwrap();
        let error = String::from_utf8(said.stderr).unwrap();
        assert_eq!((said.status.code(), error.lines().count()), (Some(status), 1), "{error}");
        assert!(error.contains(says), "{error}");
    }
}

#[test]
#[ignore = "needs Node and what .ci/page builds"]
fn a_stop_does_not_wait_behind_what_another_has_sent() {
    let board = Board::start("pms5005");
    let mut client = board.client();
    // 87 seconds of the line, by one who then goes.
    let mut other = TcpStream::connect(&board.1).unwrap();
    thread::spawn(move || other.write_all(&[0x55; 1_000_000]));
    thread::sleep(Duration::from_millis(500));
    assert!(client.stop().unwrap().confirmed);
}

#[test]
#[ignore = "needs Node and what .ci/page builds"]
fn a_panic_has_its_text_whatever_is_called_next_and_another_board_starts() {
    let instance = Path::new(env!("CARGO_MANIFEST_DIR")).join("browser/instance.mjs");
    let script = format!(
        "import {{ Board }} from '{}';
         import {{ readFileSync }} from 'node:fs';
         const module = await WebAssembly.compile(readFileSync(process.argv[1]));
         const thrown = (act) => {{ try {{ act(); }} catch (error) {{ return error.message.split('\\n')[1]; }} }};
         console.log(await Board.start(module, 'nothing').catch((error) => error.message));
         const board = await Board.start(module, 'pms5005 0');
         // No bytes of this number fit into the memory.
         console.log(thrown(() => board.feed({{ length: 2 ** 32 - 1 }})));
         console.log(thrown(() => board.advance(1000)));
         const another = await Board.start(module, 'pms5005 0');
         another.advance(1e6);
         console.log(another.take().length);",
        instance.display()
    );
    let module = target().join("one-file/board.wasm");
    let words = ["--input-type=module", "-e", &script];
    let said = Command::new("node").args(words).arg(module).output().unwrap();
    let text = String::from_utf8([said.stdout, said.stderr].concat()).unwrap();
    let lines: Vec<_> = text.lines().collect();
    assert!(lines[0].starts_with("nothing: no personality"), "{text}");
    assert_eq!(lines[1..3], ["capacity overflow"; 2], "{text}");
    assert!(lines[3].parse::<u32>().unwrap() > 8, "{text}");
}
