//! Every command, on each link: what it says, what the board makes of it, how it ends.

use std::path::PathBuf;

use serde_json::{Value, json};

use crate::handwheel;
use crate::program::Board;

#[test]
fn every_command_over_tcp() {
    let board = Board::start(&["--udp", "127.0.0.1:0", "--line-rate", "0"]);
    every_command(&board, &format!("tcp:{}", board.place("TCP")));
}

#[test]
fn every_command_over_udp() {
    let board = Board::start(&["--udp", "127.0.0.1:0", "--line-rate", "0"]);
    every_command(&board, &format!("udp:{}", board.place("UDP")));
}

#[test]
fn every_command_over_a_serial_device() {
    let board = Board::start(&["--udp", "127.0.0.1:0", "--line-rate", "0"]);
    every_command(&board, &format!("serial:{}@115200", board.place("serial")));
}

/// A place for files of this test, emptied.
pub fn directory(name: &str) -> PathBuf {
    let name: String = name.chars().filter(|c| c.is_alphanumeric()).collect();
    let path = std::env::temp_dir().join(format!("handwheel-{}-{name}", std::process::id()));
    let _ = std::fs::remove_dir_all(&path);
    std::fs::create_dir_all(&path).unwrap();
    path
}

fn every_command(board: &Board, link: &str) {
    let ok = |words: &str| {
        let said = handwheel(link, words);
        assert_eq!((said.status, said.err.as_str()), (0, ""), "{words}: {said:?}");
        said
    };
    let json = |words: &str| ok(&format!("--json {words}")).json();
    let files = directory(link);
    let file = |name: &str| files.join(name).display().to_string();

    // Asked first: nothing has been sent that keeps anything running.
    let info = json("info");
    assert_eq!((&info["board"], &info["faults"]), (&json!("a PMS5005"), &json!([])));
    assert_eq!(info["driven_by_another_host"], json!([]));
    assert!(ok("info").out.contains("nothing had ever been saved"));
    assert_eq!(json("faults"), json!({ "faults": [], "cleared": false }));
    assert_eq!(ok("faults").out, "no faults\n");
    assert_eq!(board.state()["link"]["links_lost"], 0);

    // What turns, and stands.
    let turned = json("velocity 1 4000 --for 500ms");
    assert!(turned["turned"].as_i64().unwrap() > 500 && turned["stands"] == true, "{turned}");
    let back = json("velocity 1 -4000 --in 100ms --for 500ms");
    assert!(back["turned"].as_i64().unwrap() < -500, "{back}");
    board.until(|state| {
        let motor = &state["motors"][0];
        motor["enabled"] == false && motor["velocity"] == 0.0
    });
    assert!(json("pwm 2 -50% --for 400ms")["turned"].as_i64().unwrap() < -100);
    let there = json("position 1 1000 --for 1s");
    assert!((there["position"].as_i64().unwrap() - 1000).abs() < 100, "{there}");
    assert!(ok("velocity 3 500 --for 300ms").out.contains("motor 3 stands"));

    // What is set, and stays.
    ok("servo 3 1500us");
    assert_eq!(json("servo 4 1000us --in 50ms")["servo"], 4);
    ok("gpio 0xA5");
    board.until(|state| {
        let pulse = |servo: usize| &state["servos"][servo]["pulse_us"];
        *pulse(2) == 1500.0 && *pulse(3) == 1000.0 && state["gpio_out"] == 0xA5
    });
    let picture = file("picture.png");
    checkerboard(&picture);
    ok(&format!("lcd {picture}"));
    let lcd = board.until(|state| !state["lcd"].as_str().unwrap().ends_with("00"));
    assert_eq!(lcd["lcd"], "aa55".repeat(512));

    // Save is refused while a servo is on; a stop takes all off.
    handwheel(link, "save").failed("handwheel stop");
    assert_eq!(json("stop")["confirmed"], true);
    assert!(
        board.state()["servos"].as_array().unwrap().iter().all(|servo| servo["enabled"] == false)
    );
    assert!(ok("stop").out.contains("everything is off and stands"));

    // The machine state.
    let lines = ok("--json watch --for 300ms").out;
    let last: Value = serde_json::from_str(lines.lines().last().unwrap()).unwrap();
    assert!(lines.lines().count() >= 3 && last["motors"][5]["mode"] == "off", "{lines}");
    let csv = ok("watch --csv --for 200ms").out;
    let columns = |line: &str| {
        line.split('"').step_by(2).map(|part| part.matches(',').count()).sum::<usize>()
    };
    assert!(csv.lines().count() >= 3 && csv.lines().all(|line| columns(line) == 53), "{csv}");
    assert!(ok("watch --for 200ms").out.contains("servos 1 to 6"));

    // Settings.
    let drawing = file("step.svg");
    ok("zero 1");
    let step = json(&format!("step 1 velocity 2000 --for 800ms --svg {drawing}"));
    assert!(step["rise_ms"].as_u64().is_some() && step["stands"] == true, "{step}");
    assert!(step["samples_ms_value_duty"].as_array().unwrap().len() >= 20);
    assert!(std::fs::read_to_string(drawing).unwrap().contains("<polyline"));
    assert!(ok("step 1 position 500 --for 1s").out.contains("overshoot"));

    assert_eq!(json("zero 1 -77")["count"], -77);
    assert_eq!(json("get telemetry period")["settings"][0]["value"], 50);
    assert_eq!(json("get soft limit low")["settings"].as_array().unwrap().len(), 6);
    assert_eq!(json("set telemetry period 40")["before"], 50);
    ok("set soft limit high 2 3000");
    assert_eq!(json("save"), json!({ "saved": true }));
    let before = json("get")["settings"].clone();
    assert!(before.as_array().unwrap().len() > 100);

    // Backup, factory reset, restore: the same machine.
    let backup = file("backup.toml");
    ok(&format!("backup {backup}"));
    handwheel(link, &format!("backup {backup}")).failed("nothing is overwritten");
    assert_eq!(ok(&format!("diff {backup}")).out, "no difference\n");
    assert_eq!(json("reset"), json!({ "reset": true }));
    let diff = handwheel(link, &format!("--json diff {backup}"));
    assert_eq!((diff.status, diff.json()["differ"].as_array().unwrap().len()), (3, 2));
    assert_eq!(json(&format!("restore {backup}"))["saved"], true);
    assert_eq!(json("get")["settings"], before);

    assert_eq!(json("faults clear"), json!({ "faults": [], "cleared": true }));
    handwheel(link, "dfu").failed("this board cannot do it");
    std::fs::remove_dir_all(files).unwrap();
}

#[test]
fn a_restored_machine_is_the_same_after_a_restart() {
    let files = directory("restart");
    let file = |name: &str| files.join(name).display().to_string();
    let start = || {
        let flash = file("flash");
        let board =
            Board::start(&["--udp", "127.0.0.1:0", "--line-rate", "0", "--settings", &flash]);
        let link = format!("tcp:{}", board.place("TCP"));
        (board, link)
    };
    let all = |link: &str| handwheel(link, "--json get").json();
    let (board, link) = start();
    for words in ["set telemetry period 40", "set velocity Kp 1 20", "set soft limit high 2 3000"] {
        assert_eq!(handwheel(&link, words).status, 0, "{words}");
    }
    let before = all(&link);
    for words in [&format!("backup {}", file("all")), "reset", &format!("restore {}", file("all"))]
    {
        assert_eq!(handwheel(&link, words).status, 0, "{words}");
    }
    drop(board);
    let (_board, link) = start();
    assert_eq!(all(&link), before);
    assert!(handwheel(&link, "info").out.contains("settings at its start: as saved"));
    std::fs::remove_dir_all(&files).unwrap();
}

/// 128 x 64, every other pixel.
fn checkerboard(file: &str) {
    let mut encoder = png::Encoder::new(std::fs::File::create(file).unwrap(), 128, 64);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Eight);
    let pixels: Vec<u8> = (0..128 * 64).map(|k| ((k / 128 + k) % 2 * 255) as u8).collect();
    encoder.write_header().unwrap().write_image_data(&pixels).unwrap();
}
