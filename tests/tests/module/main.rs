//! The boards as a WebAssembly module, in Node: they say what they say on this computer, byte for byte, in the same
//! millisecond.
//!
//!     .ci/page && cargo test -p tests --test module -- --ignored

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use embassy_time::Instant;
use firmware::personality::pioneer_arm::PioneerArm;
use hal_mock::board::{Make, VirtualBoard};
use hal_mock::flash::Flash;
use hal_mock::machine::{Cm5, Machine};
use hal_mock::plant::Ax12;
use hal_mock::{clock, cm5_board};
use protocol::arcos;
use protocol::cm5::{Goals, HelloAnswer, Limits, MAX_PACKET, ServoGoal};
use protocol::dynamixel::Register;
use serde_json::json;
use tests::every_did::{ACKS, script};

/// A script: when the host says what, in ms.
type Pieces = Vec<(u64, Vec<u8>)>;

/// The end of an acknowledgement: DID 255, DATA 1.
const ACK: &str = "ff0101485e0d";

/// The board's time behind the last piece that is compared too.
const AFTERWARDS_MS: u64 = 300;

fn end(pieces: &Pieces) -> u64 {
    pieces.last().unwrap().0 + AFTERWARDS_MS
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut text, byte| {
        write!(text, "{byte:02x}").unwrap();
        text
    })
}

/// Every DID of the PMS5005, and what goes wrong on a line.
fn every_did() -> Pieces {
    let mut at = 0;
    let step = |step: tests::every_did::Step| {
        let begun = at;
        at += step.pause.as_millis() as u64;
        (begun, step.bytes)
    };
    script().into_iter().map(step).collect()
}

/// What a board on this computer answers: `MS HEX` a line.
fn native(machine: &mut dyn Machine, pieces: &Pieces) -> String {
    let mut said = String::new();
    let mut pieces_left = pieces.iter().peekable();
    for ms in 0..=end(pieces) {
        machine.run_until(Instant::from_millis(ms));
        while let Some((_, bytes)) = pieces_left.next_if(|(at, _)| *at == ms) {
            machine.line().host_sends(bytes);
        }
        while let Some((_, frame)) = machine.line().host_receives() {
            writeln!(said, "{ms} {}", hex(&frame)).unwrap();
        }
    }
    clock::reset();
    said
}

/// A file of this repository.
fn file(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path)
}

/// What the module answers.
fn module(what: &str, pieces: &Pieces) -> String {
    let target = std::env::var_os("CARGO_TARGET_DIR").map_or(file("target"), PathBuf::from);
    let pieces_in_hex: Vec<_> = pieces.iter().map(|(at, bytes)| (at, hex(bytes))).collect();
    let asked = json!({
        "module": target.join("one-file/board.wasm"), "what": what, "until": end(pieces),
        "pieces": pieces_in_hex,
    });
    let mut node = Command::new("node")
        .arg(file("tests/tests/module/replay.mjs"))
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("Node");
    node.stdin.take().unwrap().write_all(asked.to_string().as_bytes()).unwrap();
    let output = node.wait_with_output().unwrap();
    assert!(output.status.success());
    String::from_utf8(output.stdout).unwrap()
}

/// Both say the same, line by line, and enough of it.
fn same(what: &str, native: &str, pieces: &Pieces) {
    let module = module(what, pieces);
    let differs = native.lines().zip(module.lines()).find(|(native, module)| native != module);
    assert_eq!(differs, None, "{what}");
    assert_eq!(native.lines().count(), module.lines().count(), "{what}");
    println!("{what}: {} frames, all alike", native.lines().count());
}

#[test]
#[ignore = "needs Node and the module that .ci/page builds"]
fn a_pms5005_answers_every_did_with_the_same_bytes() {
    let pieces = every_did();
    for line_rate in [0, 115_200] {
        let board = || VirtualBoard::new(Make { line_rate, ..Make::default() });
        let native = native(&mut board(), &pieces);
        let acks = native.lines().filter(|line| line.ends_with(ACK)).count();
        // A paced line loses no command, but may acknowledge several at once.
        assert!(if line_rate == 0 { acks == ACKS } else { acks > 50 }, "{acks}");
        same(&format!("pms5005 {line_rate}"), &native, &pieces);
    }
}

#[test]
#[ignore = "needs Node and the module that .ci/page builds"]
fn an_arm_and_a_cm5_say_the_same() {
    // The synchronisation of ARCOS, its session opened, and a sign of life.
    let packet = |command| vec![0xFA, 0xFB, 3, command, 0, command];
    let commands = [0, 1, 2, arcos::command::OPEN, arcos::command::PULSE];
    let pieces: Pieces =
        commands.iter().zip(0..).map(|(&command, k)| (400 * k, packet(command))).collect();
    let make = Make { line_rate: 0, ..Make::default() };
    let mut arm = VirtualBoard::with_session(make, Flash::empty(), PioneerArm::new);
    let native_arm = native(&mut arm, &pieces);
    assert!(native_arm.lines().count() > 8, "{native_arm}");
    same("pioneer-arm 0", &native_arm, &pieces);

    // Its greeting is answered, then goals come 20 times a second.
    let mut buffer = [0; MAX_PACKET];
    let limits = [Limits::new(0, 1023).unwrap()];
    let answer = HelloAnswer::encode(1, &limits, &mut buffer).unwrap().to_vec();
    let goal = |place| {
        ServoGoal([0; 15]).with(Register::TORQUE_ENABLE, 1).with(Register::GOAL_POSITION, place)
    };
    let mut goals = |place| Goals::encode(&[goal(place); 6], &mut buffer).unwrap().to_vec();
    let mut pieces = vec![(1500, answer)];
    pieces.extend((0..20).map(|k| (2000 + 50 * u64::from(k), goals(300 + 20 * k))));
    let servos = (1..=6).map(Ax12::new).collect();
    let mut cm5 = Cm5::new(cm5_board::Make { servos, ..cm5_board::Make::default() });
    let native_cm5 = native(&mut cm5, &pieces);
    assert!(native_cm5.lines().count() >= 20, "{native_cm5}");
    same("cm5", &native_cm5, &pieces);
}
