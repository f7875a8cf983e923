//! The PMS5005's world as a user sets it: through the inspector, and from a scene.
#![cfg(unix)]

mod program;

use std::io::{Read, Write};

use program::{Board, cannot_run, program};
use protocol::pms5005::{Addressing, Command, Frame, Move, Quantity, Receiver};
use serde_json::{Value, json};

const OPTIONS: [&str; 4] = ["--udp", "127.0.0.1:0", "--line-rate", "0"];

fn board(options: &[&str]) -> Board {
    Board::start(&[&OPTIONS, options].concat())
}

fn set(board: &Board, what: Value) {
    assert_eq!(board.ask(json!({ "set": what })), json!({"ok": true}));
}

/// Drives both wheels with so much PWM.
fn drive(stream: &mut impl Write, pwm: i16) {
    let mut targets = [None; 6];
    targets[..2].fill(Some(pwm));
    let (quantity, addressing) = (Quantity::Pwm, Addressing::List);
    let command = Command::Move(Move { quantity, addressing, targets, periods: 0 });
    stream.write_all(command.encode(0, &mut [0; 300]).unwrap()).unwrap();
}

fn velocity(state: &Value, motor: usize) -> f64 {
    state["motors"][motor]["velocity"].as_f64().unwrap()
}

#[test]
fn the_inspector_puts_a_wall_in_the_way_and_takes_it_away() {
    let board = board(&[]);
    let mut tcp = board.tcp();
    assert_eq!(board.state()["wall_cm"], json!(null));
    set(&board, json!({"wall_cm": 20.5}));
    let state = board.state();
    assert_eq!(state["wall_cm"], 20.5);
    assert_eq!(state["overridden"], json!({"wall_cm": 20.5}));
    drive(&mut tcp, 16_384 + 8000);
    board.until(|state| state["wall_cm"].as_f64().is_some_and(|cm| cm <= 3.0));
    drive(&mut tcp, 16_384 + 8000); // it may have fallen silent
    board.until(|state| velocity(state, 0) == 0.0 && state["motors"][0]["current_a"] != 0.0);
    set(&board, json!({"wall_cm": null}));
    drive(&mut tcp, 16_384 + 8000);
    let state = board.until(|state| velocity(state, 0) > 5000.0);
    assert!(state["wall_cm"].is_null() && state["overridden"] == json!({}));
}

#[test]
fn the_inspector_changes_batteries_pulls_sensors_and_sows_noise() {
    let board = board(&[]);
    let changes = json!({
        "battery_v": [null, 6.1, 5.0], "unplugged": [true, null, false, null, null, null],
        "seed": 18_446_744_073_709_551_615u64,
    });
    set(&board, changes.clone());
    assert_eq!(board.state()["overridden"], changes);
    let mut tcp = board.tcp();
    drive(&mut tcp, 32_767);
    let state = board.until(|state| velocity(state, 1) > 6000.0);
    assert!(velocity(&state, 1) < 8400.0, "{state}");
    set(&board, json!({"battery_v": null, "unplugged": null, "seed": null}));
    drive(&mut tcp, 32_767);
    board.until(|state| velocity(state, 1) > 14_000.0 && state["overridden"] == json!({}));
}

#[test]
fn what_can_be_set_is_listed_and_what_cannot_is_named_and_changes_nothing() {
    let pms5005 = board(&[]);
    let settable = pms5005.state()["settable"].clone();
    for name in ["pot", "jam", "unplugged", "battery_v", "wall_cm", "seed", "link"] {
        assert!(settable.as_array().unwrap().contains(&name.into()), "{name}: {settable}");
    }
    for (key, value) in [
        ("wall_cm", json!(-1)),
        ("wall_cm", json!(10_001)),
        ("wall_cm", json!("far")),
        ("unplugged", json!([true])),
        ("unplugged", json!([1, 0, 0, 0, 0, 0])),
        ("battery_v", json!([7.4, -12.0, 6.0])),
        ("battery_v", json!(12)),
        ("seed", json!(1.5)),
        ("seed", json!(-1)),
    ] {
        // Whatever else would be right.
        let mut changes = json!({"gpio_in": 7, "jam": [true, null, null, null, null, null],
            "wall_cm": 50, "seed": 3});
        changes[key] = value;
        let answer = pms5005.ask(json!({ "set": changes }));
        let error = answer["error"].as_str().unwrap_or_default();
        assert!(error.starts_with(&format!("{key}: expected")), "{changes}: {answer}");
    }
    assert_eq!(pms5005.state()["overridden"], json!({}));
    for personality in ["pioneer-arm", "cm5", "ax12-bus"] {
        let state = Board::start(&[personality]).state();
        let names = state["settable"].as_array().unwrap();
        assert!(names.len() > 1 && names.contains(&"link".into()), "{personality}: {state}");
    }
}

#[test]
fn a_scene_has_the_same_from_the_start() {
    let file = std::env::temp_dir().join(format!("world-{}.toml", std::process::id()));
    let scene = ["--scene", file.to_str().unwrap()];
    let text = "seed = 7
        [environment]
        wall_cm = 9000.5
        [faults]
        jam = [false, true, false, false, false, false]";
    std::fs::write(&file, text).unwrap();
    let board = board(&scene);
    let state = board.state();
    assert_eq!((&state["wall_cm"], &state["overridden"]), (&json!(9000.5), &json!({})));
    let mut tcp = board.tcp();
    drive(&mut tcp, 16_384 + 8000);
    board.until(|state| velocity(state, 0) > 5000.0 && velocity(state, 1) == 0.0);
    set(&board, json!({"jam": [null, false, null, null, null, null]}));
    drive(&mut tcp, 16_384 + 8000);
    board.until(|state| velocity(state, 1) > 5000.0);
    drop(board);

    std::fs::write(&file, "[faults]\nlink = false").unwrap();
    let board = self::board(&scene);
    assert_eq!(board.state()["overridden"], json!({"link": false}));
    drop(board);
    std::fs::write(&file, "[faults]\nunplugged = true").unwrap();
    let output = program(&[&OPTIONS[..], &["--tcp", "127.0.0.1:0"], &scene].concat()).output();
    cannot_run(&output.unwrap(), "unplugged");
    std::fs::remove_file(&file).unwrap();
}

/// What so many frames of motor telemetry hold.
fn noise(board: &Board, frames: usize) -> Vec<Vec<u8>> {
    let (mut tcp, mut receiver, mut all) = (board.tcp(), Receiver::new(), Vec::new());
    while all.len() < frames {
        let mut buffer = [0; 256];
        let count = tcp.read(&mut buffer).unwrap();
        assert!(count > 0, "the board has closed the link");
        let mut bytes = &buffer[..count];
        while let Some(frame) = receiver.receive(&mut bytes) {
            let frame = Frame::parse(frame).unwrap();
            all.extend((frame.did == 123).then(|| frame.data.to_vec()));
        }
    }
    all
}

#[test]
fn the_seed_is_the_command_lines_or_else_the_scenes() {
    let file = std::env::temp_dir().join(format!("seed-{}.toml", std::process::id()));
    let scene = ["--scene", file.to_str().unwrap()];
    std::fs::write(&file, "noise_lsb = 500.0\nseed = 7").unwrap();
    let late = noise(&board(&scene), 40).pop().unwrap();
    std::fs::write(&file, "noise_lsb = 500.0\nseed = 9").unwrap();
    // What one has read two seconds after its start or later the other reads too.
    assert!(noise(&board(&[&scene[..], &["--seed", "7"]].concat()), 80).contains(&late));
    assert!(!noise(&board(&scene), 80).contains(&late));
    std::fs::remove_file(&file).unwrap();
}
