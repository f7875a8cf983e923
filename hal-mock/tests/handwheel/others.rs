//! Other hosts, Ctrl-C, and the other boards.

use std::cell::RefCell;
use std::io;
use std::sync::atomic::Ordering;
use std::thread;
use std::time::Duration;

use hal_mock::board::{Make, VirtualBoard};
use handwheel::cli::Interrupt;
use handwheel::session::Session;
use handwheel::transport::Transport;
use handwheel::{Client, Link};
use protocol::extension::{Mode, VERSION};
use protocol::pms5005::{Addressing, Command, Move, Quantity, Scope};
use serde_json::{Value, json};

use crate::commands::directory;
use crate::program::Board;
use crate::{handwheel, interruptible};

fn tcp(board: &Board) -> String {
    format!("tcp:{}", board.place("TCP"))
}

fn board() -> Board {
    Board::start(&["--udp", "127.0.0.1:0", "--line-rate", "0"])
}

#[test]
fn ctrl_c_stops_the_motor_and_is_no_failure() {
    let board = board();
    for words in ["velocity 1 4000", "position 1 16000", "step 1 velocity 3000 --for 60s"] {
        let (link, interrupt) = (tcp(&board), Interrupt::default());
        let ctrl_c = interrupt.clone();
        let driver = thread::spawn(move || interruptible(&link, words, interrupt));
        board.until(|state| state["motors"][0]["velocity"].as_f64().unwrap() > 500.0);
        // The step has samples by then.
        thread::sleep(Duration::from_millis(300));
        assert!(!ctrl_c.ends_program.load(Ordering::Relaxed));
        ctrl_c.wanted.store(true, Ordering::Relaxed);
        let said = driver.join().unwrap();
        assert_eq!(said.status, 0, "{said:?}");
        assert!(said.out.contains("motor 1 stands"), "{said:?}");
        board.until(|state| state["motors"][0]["enabled"] == false);
        assert_eq!(handwheel(&tcp(&board), "faults clear").status, 0);
    }
}

#[test]
fn a_motor_runs_on_for_longer_than_the_boards_patience_while_it_is_held() {
    let board = board();
    let link = tcp(&board);
    assert_eq!(handwheel(&link, "set link timeout 300").status, 0);
    let said = handwheel(&link, "--json velocity 1 4000 --for 3s");
    assert!(said.json()["turned"].as_i64().unwrap() > 8000, "{said:?}");
}

#[test]
fn who_watches_keeps_nothing_running_and_says_who_drives() {
    let board = board();
    let mut host = board.tcp();
    // A host that drives, and dies.
    let mut buffer = [0; 100];
    let targets = [Some(2000), None, None, None, None, None];
    let drive = protocol::pms5005::Command::Move(protocol::pms5005::Move {
        quantity: protocol::pms5005::Quantity::Velocity,
        addressing: protocol::pms5005::Addressing::List,
        targets,
        periods: 0,
    });
    let drive = drive.encode(0, &mut buffer).unwrap().to_vec();
    let drives = || std::io::Write::write_all(&mut &host, &drive).unwrap();
    drives();
    let said = handwheel(&tcp(&board), "info");
    assert!(said.out.contains("another host drives motor 1"), "{said:?}");
    drives();
    let said = handwheel(&tcp(&board), "get link timeout");
    assert!(said.err.contains("another host drives motor 1"), "{said:?}");
    drives();
    let said = handwheel(&tcp(&board), "--json watch --for 4s");
    let states: Vec<Value> = said.out.lines().map(|l| serde_json::from_str(l).unwrap()).collect();
    assert_eq!(states[0]["driven_by_another_host"], json!([1]));
    let last = states.last().unwrap();
    assert_eq!((&last["driven_by_another_host"], &last["host_silent"]), (&json!([]), &json!(true)));
    board.until(|state| state["motors"][0]["enabled"] == false);
    std::io::Read::read(&mut host, &mut buffer).unwrap();
}

#[test]
fn a_stop_of_another_holds_and_the_driver_says_why_it_ended() {
    let board = board();
    let link = tcp(&board);
    let driver = thread::spawn({
        let link = link.clone();
        move || handwheel(&link, "velocity 1 4000")
    });
    board.until(|state| state["motors"][0]["velocity"].as_f64().unwrap() > 500.0);
    let stop = handwheel(&link, "--json stop");
    assert_eq!((stop.status, &stop.json()["confirmed"]), (0, &json!(true)));
    let said = driver.join().unwrap();
    assert!(said.status == 1 && said.err.contains("motor 1 does not run"), "{said:?}");
    board.until(|state| state["motors"][0]["enabled"] == false);
}

#[test]
fn a_stop_that_another_host_undoes_is_not_confirmed() {
    let board = board();
    let host = board.tcp();
    let mut buffer = [0; 100];
    let pwm = protocol::pms5005::Command::Move(protocol::pms5005::Move {
        quantity: protocol::pms5005::Quantity::Pwm,
        addressing: protocol::pms5005::Addressing::List,
        targets: [None, Some(24_000), None, None, None, None],
        periods: 0,
    });
    let pwm = pwm.encode(255, &mut buffer).unwrap().to_vec();
    let done = std::sync::Arc::new(std::sync::atomic::AtomicBool::new(false));
    let goes_on = done.clone();
    let other = thread::spawn(move || {
        while !goes_on.load(Ordering::Relaxed) {
            std::io::Write::write_all(&mut &host, &pwm).unwrap();
            thread::sleep(Duration::from_millis(5));
        }
    });
    let said = handwheel(&tcp(&board), "--json stop");
    done.store(true, Ordering::Relaxed);
    other.join().unwrap();
    assert_eq!((said.status, &said.json()["confirmed"]), (3, &json!(false)));
}

#[test]
fn a_fault_is_told_with_its_values_and_what_to_check() {
    let board = board();
    let link = tcp(&board);
    assert_eq!(handwheel(&link, "set stall time 300").status, 0);
    board.ask(json!({"set": {"jam": [true, false, false, false, false, false]}}));
    let said = handwheel(&link, "velocity 1 8000 --for 15s");
    assert!(said.status == 1 && said.err.contains("fault 2, stall"), "{said:?}");
    let faults = handwheel(&link, "--json faults").json();
    let fault = &faults["faults"][0];
    assert_eq!((&fault["name"], &fault["channel"]), (&json!("stall"), &json!(1)));
    assert!(fault["values"]["current (A/D)"].as_i64().unwrap() > 0, "{fault}");
    assert!(handwheel(&link, "info").out.contains("free it"));
    assert_eq!(handwheel(&link, "faults clear").status, 0);
}

#[test]
fn a_pioneer_arm_gets_info_watch_stop_faults_and_settings() {
    let board = Board::start(&["pioneer-arm", "--line-rate", "0"]);
    let files = directory("arm");
    let serial = format!("serial:{}", board.place("serial"));
    for link in [tcp(&board), serial] {
        let info = handwheel(&link, "--json info").json();
        assert_eq!((&info["board"], &info["powered"]), (&json!("a Pioneer Arm"), &json!(false)));
        assert_eq!(
            (&info["joints"][5]["home"], &info["extension"]),
            (&json!(127), &json!(VERSION))
        );
        assert!(handwheel(&link, "info").out.contains("joints 1 to 6 at 127"));
        let watched = handwheel(&link, "--json watch --for 1s").out;
        assert!(watched.lines().all(|line| line.contains("\"positions\":[127,")), "{watched}");
        assert!(!watched.is_empty());
        assert_eq!(handwheel(&link, "stop").status, 0);
        assert_eq!(handwheel(&link, "--json faults").json()["faults"], json!([]));
        let said = handwheel(&link, "set joint home 2 90");
        assert!(said.status == 0 && said.out.contains("next start"), "{said:?}");
        handwheel(&link, "velocity 1 100 --for 1s").failed("a Pioneer Arm has no motors");
    }
    let link = tcp(&board);
    let file = files.join("arm.toml").display().to_string();
    assert_eq!(handwheel(&link, &format!("backup {file}")).status, 0);
    assert_eq!(handwheel(&link, "reset").status, 0);
    assert_eq!(handwheel(&link, &format!("diff {file}")).status, 3);
    assert_eq!(handwheel(&link, &format!("restore {file}")).status, 0);
    assert_eq!(handwheel(&link, &format!("diff {file}")).status, 0);
    assert_eq!(handwheel(&link, "reset").status, 0);
    std::fs::remove_file(file).unwrap();
    std::fs::remove_dir_all(files).unwrap();
}

#[test]
fn an_arm_that_another_host_has_is_left_to_it() {
    let board = Board::start(&["pioneer-arm", "--line-rate", "0"]);
    let mut host = board.tcp();
    for id in [0, 1, 2, 1] {
        let mut buffer = [0; 20];
        let packet = protocol::arcos::Packet { id, data: &[] };
        std::io::Write::write_all(&mut host, packet.encode(&mut buffer).unwrap()).unwrap();
        thread::sleep(Duration::from_millis(200));
    }
    let said = handwheel(&tcp(&board), "info");
    assert!(said.status == 0 && said.out.contains("another host has its session open"), "{said:?}");
    // It was not closed: standard packets go on.
    let again = handwheel(&tcp(&board), "--json info").json();
    assert_eq!(again["another_host_has_the_session"], true);
}

#[test]
fn a_cm5_gets_info_and_watch_and_says_what_it_has_not() {
    let board = Board::start(&["cm5", "--servos", "3,7"]);
    let serial = format!("serial:{}@1000000", board.place("serial"));
    for link in [tcp(&board), serial] {
        assert_eq!(handwheel(&link, "--json info").json()["servos"], json!([3, 7]));
    }
    handwheel(&tcp(&board), "get").failed("constants of its firmware");
    handwheel(&tcp(&board), "stop").failed("a CM-5 has no motors");
    handwheel(&tcp(&board), "faults").failed("a CM-5 has no faults");

    let link = tcp(&board);
    let watch = thread::spawn(move || handwheel(&link, "--json watch --for 4s"));
    thread::sleep(Duration::from_millis(1500));
    // Its host, whose answer to the hello begins the reports.
    let mut host = board.tcp();
    let limits = [protocol::cm5::Limits::new(0, 1023).unwrap()];
    let mut buffer = [0; 20];
    let answer = protocol::cm5::HelloAnswer::encode(0, &limits, &mut buffer).unwrap();
    std::io::Write::write_all(&mut host, answer).unwrap();
    let watched = watch.join().unwrap().out;
    let last: Value = serde_json::from_str(watched.lines().last().unwrap()).unwrap();
    assert_eq!(
        (&last["servos"][1]["id"], &last["servos"][1]["voltage_v"]),
        (&json!(7), &json!(12.0))
    );
}

thread_local! {
    static BOARD: RefCell<VirtualBoard> = RefCell::new(VirtualBoard::new(Make { line_rate: 0, ..Make::default() }));
}

/// The line to this thread's board, whose time passes while somebody reads.
struct Virtual;

impl Transport for Virtual {
    fn read(&mut self, buffer: &mut [u8], patience: Duration) -> io::Result<usize> {
        BOARD.with_borrow_mut(|board| {
            let end = embassy_time::Instant::now()
                + embassy_time::Duration::from_micros(patience.as_micros() as u64);
            loop {
                if let Some((_, frame)) = board.line.host_receives() {
                    buffer[..frame.len()].copy_from_slice(&frame);
                    return Ok(frame.len());
                }
                if embassy_time::Instant::now() >= end {
                    return Ok(0);
                }
                board.run_for(embassy_time::Duration::from_millis(1));
            }
        })
    }

    fn write(&mut self, frame: &[u8]) -> io::Result<()> {
        BOARD.with_borrow(|board| board.line.host_sends(frame));
        Ok(())
    }
}

#[test]
fn a_motor_that_was_stopped_an_instant_ago_is_no_other_hosts() {
    let say = |command: Command| {
        let mut buffer = [0; 100];
        BOARD.with_borrow(|board| board.line.host_sends(command.encode(0, &mut buffer).unwrap()));
    };
    let link = Link::Other("virtual".into());
    let mut client = Client::over(link, Box::new(Virtual), Session::new()).unwrap();
    // Acknowledged, a stop is carried out in the next control period: the state of this one does not know it.
    for (look, runs) in [(Client::state as fn(&mut _) -> _, true), (Client::state_at_rest, false)] {
        let targets = [None, Some(2000), None, None, None, None];
        let (quantity, addressing) = (Quantity::Velocity, Addressing::List);
        say(Command::Move(Move { quantity, addressing, targets, periods: 0 }));
        BOARD.with_borrow_mut(|board| board.run_for(embassy_time::Duration::from_millis(100)));
        say(Command::Run { scope: Scope::All, run: false });
        let state = look(&mut client).unwrap().unwrap();
        assert_eq!(state.channels[1].mode != Mode::Off, runs, "{state:?}");
    }
}
