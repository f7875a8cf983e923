//! What a driving host notices of others, and what it says when a board does not answer.

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::atomic::Ordering;
use std::thread;
use std::time::{Duration, Instant};

use handwheel::cli::Interrupt;
use protocol::pms5005::{ACK, Addressing, Command, Move, PING, Quantity, Receiver};
use serde_json::{Value, json};

use crate::program::Board;
use crate::{handwheel, interruptible};

fn board() -> Board {
    Board::start(&["--line-rate", "0"])
}

fn tcp(board: &Board) -> String {
    format!("tcp:{}", board.place("TCP"))
}

/// A motion command of another host, which then says nothing more.
fn drive(mut host: &TcpStream, motor: usize, quantity: Quantity, value: i16) {
    let mut targets = [None; 6];
    targets[motor - 1] = Some(value);
    let addressing = Addressing::List;
    let command = Command::Move(Move { quantity, addressing, targets, periods: 0 });
    host.write_all(command.encode(255, &mut [0; 100]).unwrap()).unwrap();
}

fn turns(state: &Value) -> bool {
    state["motors"][0]["velocity"].as_f64().unwrap() > 500.0
}

#[test]
fn a_drive_ends_when_another_host_takes_its_motor() {
    let board = board();
    for (quantity, value, says) in [
        (Quantity::Velocity, -1000, "its set-point is -1000, not 4000"),
        (Quantity::Pwm, 24_384, "its mode is PWM, not velocity"),
    ] {
        let link = tcp(&board);
        let driver = thread::spawn(move || handwheel(&link, "velocity 1 4000 --for 10s"));
        board.until(turns);
        drive(&board.tcp(), 1, quantity, value);
        let said = driver.join().unwrap();
        assert_eq!(said.status, 1, "{said:?}");
        assert!(said.err.contains(&format!("another host drives motor 1: {says}")), "{said:?}");
        board.until(|state| state["motors"][0]["enabled"] == false);
    }
}

#[test]
fn a_position_that_another_host_changes_ends_the_drive() {
    let board = board();
    let link = tcp(&board);
    let driver = thread::spawn(move || handwheel(&link, "position 1 1500 --in 500ms --for 15s"));
    board.until(|state| state["motors"][0]["enabled"] == true);
    thread::sleep(Duration::from_millis(1500));
    drive(&board.tcp(), 1, Quantity::Position, 500);
    let said = driver.join().unwrap();
    assert!(said.status == 1 && said.err.contains("another host drives motor 1"), "{said:?}");
}

#[test]
fn a_motor_that_is_driven_already_is_refused() {
    let board = board();
    let host = board.tcp();
    drive(&host, 1, Quantity::Velocity, 2000);
    board.until(turns);
    drive(&host, 1, Quantity::Velocity, 2000);
    handwheel(&tcp(&board), "velocity 1 4000 --for 1s").failed("motor 1 is driven already");
}

#[test]
fn other_motors_that_are_driven_are_named_and_one_that_starts_ends_the_drive() {
    let board = board();
    let (link, host) = (tcp(&board), board.tcp());
    drive(&host, 2, Quantity::Velocity, 2000);
    let said = handwheel(&link, "velocity 1 4000 --for 300ms");
    assert_eq!(said.status, 0, "{said:?}");
    assert!(said.err.contains("another host drives motor 2"), "{said:?}");
    assert_eq!(handwheel(&link, "stop").status, 0);

    let driver = thread::spawn(move || handwheel(&link, "velocity 1 4000 --for 10s"));
    board.until(turns);
    drive(&host, 2, Quantity::Velocity, 2000);
    let said = driver.join().unwrap();
    assert!(said.status == 1 && said.err.contains("another host drives motor 2"), "{said:?}");
    // Nobody keeps either running.
    board.until(|state| state["motors"][0]["enabled"] == false);
    board.until(|state| state["motors"][1]["enabled"] == false);
}

/// A server that says these bytes once, and nothing more.
fn falls_silent(bytes: Vec<u8>) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let link = format!("tcp:{}", listener.local_addr().unwrap());
    thread::spawn(move || {
        let (mut client, _) = listener.accept().unwrap();
        client.write_all(&bytes).unwrap();
        while let Ok(1..) = client.read(&mut [0; 100]) {}
    });
    link
}

fn ping() -> Vec<u8> {
    PING.encode(&mut [0; 20]).unwrap().to_vec()
}

#[test]
fn a_board_that_falls_silent_is_no_original() {
    handwheel(&falls_silent(ping()), "info").failed("the board says nothing any more");
}

#[test]
fn a_stop_that_fails_says_what_is_at_stake() {
    let says = "the stop was sent and is NOT confirmed; cut the motors' supply";
    handwheel(&falls_silent(vec![]), "stop").failed(says);
    handwheel(&falls_silent(ping()), "stop").failed(says);
}

#[test]
fn a_stop_that_had_to_be_repeated_is_not_confirmed() {
    let board = board();
    let host = board.tcp();
    let drives = || drive(&host, 2, Quantity::Pwm, 24_000);
    drives();
    board.until(|state| state["motors"][1]["enabled"] == true);
    let said = thread::scope(|scope| {
        // A host that has not noticed the first stop, and then obeys.
        scope.spawn(|| {
            while board.state()["motors"][1]["enabled"] == true {
                drives();
                thread::sleep(Duration::from_millis(20));
            }
            thread::sleep(Duration::from_millis(100));
            drives();
        });
        handwheel(&tcp(&board), "stop")
    });
    assert_eq!(said.status, 3, "{said:?}");
    assert!(said.out.contains("NOT confirmed: another host commands"), "{said:?}");
    board.until(|state| state["motors"][1]["enabled"] == false);
}

/// The link to a board whose acknowledgements get lost.
fn without_acknowledgements(board: &Board) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let link = format!("tcp:{}", listener.local_addr().unwrap());
    let mut board = board.tcp();
    thread::spawn(move || {
        let (mut host, _) = listener.accept().unwrap();
        let (mut from_host, mut to_board) = (host.try_clone().unwrap(), board.try_clone().unwrap());
        thread::spawn(move || std::io::copy(&mut from_host, &mut to_board));
        let (mut receiver, mut buffer) = (Receiver::new(), [0; 500]);
        while let Ok(count @ 1..) = board.read(&mut buffer) {
            let mut bytes = &buffer[..count];
            while let Some(frame) = receiver.receive(&mut bytes) {
                if frame != ACK && host.write_all(frame).is_err() {
                    return;
                }
            }
        }
    });
    link
}

#[test]
fn ctrl_c_ends_the_wait_for_an_acknowledgement() {
    let board = board();
    let (link, interrupt) = (without_acknowledgements(&board), Interrupt::default());
    let ctrl_c = interrupt.clone();
    let driver = thread::spawn(move || interruptible(&link, "pwm 1 50%", interrupt));
    board.until(|state| state["motors"][0]["enabled"] == true);
    ctrl_c.wanted.store(true, Ordering::Relaxed);
    let asked = Instant::now();
    board.until(|state| state["motors"][0]["duty"] == 0.0);
    assert!(asked.elapsed() < Duration::from_secs(1), "{:?}", asked.elapsed());
    let said = driver.join().unwrap();
    assert!(said.status == 1 && said.err.contains("NOT confirmed"), "{said:?}");
}

#[test]
fn an_arm_whose_host_is_silent_is_asked() {
    let board = Board::start(&["pioneer-arm", "--line-rate", "0"]);
    let mut host = board.tcp();
    for id in [0, 1, 2, 1] {
        let packet = protocol::arcos::Packet { id, data: &[] };
        host.write_all(packet.encode(&mut [0; 20]).unwrap()).unwrap();
        thread::sleep(Duration::from_millis(200));
    }
    drop(host);
    let said = handwheel(&tcp(&board), "--json watch --for 4s");
    assert!(said.status == 0 && said.err.contains("its host is silent"), "{said:?}");
    let last: Value = serde_json::from_str(said.out.lines().last().unwrap()).unwrap();
    assert_eq!(last["positions"][0], json!(127));
}

#[test]
fn a_count_is_set_by_a_pms5005_alone_and_a_cm5_says_what_it_has_not() {
    let board = Board::start(&["pioneer-arm", "--line-rate", "0"]);
    handwheel(&tcp(&board), "zero 1").failed("a Pioneer Arm has no encoders to be set");
    let board = Board::start(&["cm5", "--servos", "3,7"]);
    handwheel(&tcp(&board), "zero 1").failed("a CM-5 has no encoders to be set");
    handwheel(&tcp(&board), "save").failed("a CM-5 has no settings");
    handwheel(&tcp(&board), "reset").failed("a CM-5 has no settings");
}

#[test]
fn what_keeps_a_set_point_back_is_no_other_host() {
    let board = board();
    let link = tcp(&board);
    assert_eq!(handwheel(&link, "set acceleration 1 1000").status, 0);
    let said = handwheel(&link, "velocity 1 4000 --for 5s");
    assert_eq!(said.status, 0, "{said:?}");
    assert_eq!(handwheel(&link, "set acceleration 1 0").status, 0);
    assert_eq!(handwheel(&link, "set stall time 10000").status, 0);
    board.ask(json!({"set": {"jam": [true, false, false, false, false, false]}}));
    let driver = thread::spawn(move || handwheel(&link, "position 1 9000 --in 1s --for 7s"));
    thread::sleep(Duration::from_secs(5));
    board.ask(json!({"set": {"jam": [false, false, false, false, false, false]}}));
    let said = driver.join().unwrap();
    assert!(!said.err.contains("another host"), "{said:?}");
}
