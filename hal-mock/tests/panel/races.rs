//! Things that meet: what is lost, late, or in the wrong order.

use firmware::ports::ResetCause;
use serde_json::{Value, json};

use super::{Desk, ONE, TWO};

fn drive(motor: u8, velocity: i32) -> Value {
    json!({"do": "drive", "motor": motor, "velocity": velocity})
}

#[test]
fn a_motion_command_that_is_lost_is_sent_again_and_drives() {
    let mut desk = Desk::new();
    desk.ask(ONE, json!({"do": "arm"})).unwrap();
    let asked = desk.say(ONE, drive(1, 4000));
    desk.lose_output();
    desk.run(1000);
    assert_eq!(desk.answer(ONE, asked), Some(Ok(Value::Null)));
    assert!(desk.drives(1), "{:?}", desk.notes());
}

#[test]
fn an_off_takes_back_its_own_motor_s_command_alone() {
    let mut desk = Desk::new();
    desk.ask(ONE, json!({"do": "arm"})).unwrap();
    let two = desk.say(ONE, drive(2, 3000));
    let one = desk.say(ONE, drive(1, 4000));
    let off = desk.say(ONE, json!({"do": "off", "motor": 1}));
    let mut moved = false;
    for _ in 0..2000 {
        desk.run(1);
        moved |= desk.drives(1);
    }
    assert!(!moved && desk.drives(2));
    assert!(desk.answer(ONE, one).unwrap().is_err());
    assert_eq!(desk.answer(ONE, two), Some(Ok(Value::Null)));
    assert_eq!(desk.answer(ONE, off), Some(Ok(Value::Null)));
}

#[test]
fn a_step_that_is_switched_off_before_it_is_acknowledged_blocks_nothing() {
    let mut desk = Desk::new();
    desk.ask(ONE, json!({"do": "arm"})).unwrap();
    let step = desk.say(ONE, json!({"do": "step", "motor": 1, "velocity": 4000}));
    desk.ask(ONE, json!({"do": "off", "motor": 1})).unwrap();
    assert!(desk.answer(ONE, step).unwrap().unwrap_err().contains("switched off"));
    desk.ask(ONE, json!({"do": "step", "motor": 1, "velocity": 4000, "ms": 600})).unwrap();
    // Disarmed before it is acknowledged: one answer as well (the desk looks).
    desk.run(2000);
    let step = desk.say(ONE, json!({"do": "step", "motor": 1, "velocity": 4000}));
    desk.ask(ONE, json!({"do": "disarm"})).unwrap();
    desk.run(3000);
    assert!(desk.answer(ONE, step).unwrap().is_err());
    assert_eq!(desk.duty(1), None);
}

#[test]
fn a_drive_that_follows_an_off_runs_on() {
    let mut desk = Desk::new();
    desk.drive(ONE);
    let off = desk.say(ONE, json!({"do": "off", "motor": 1}));
    desk.ask(ONE, drive(1, -3000)).unwrap();
    desk.run(3000);
    assert!(desk.duty(1).unwrap() < -5.0, "{:?} {:?}", desk.duty(1), desk.notes());
    assert!(desk.answer(ONE, off).unwrap().unwrap_err().contains("driven again"));
}

#[test]
fn a_stop_is_answered_when_the_link_goes_before_the_board_answers() {
    let mut desk = Desk::new();
    desk.drive(ONE);
    let step = desk.say(ONE, json!({"do": "step", "motor": 2, "velocity": 4000}));
    let off = desk.say(ONE, json!({"do": "off", "motor": 1}));
    desk.run(2);
    let stop = desk.say(ONE, json!({"do": "stop"}));
    desk.lose_output();
    desk.panel.link_is_gone("unplugged".into());
    desk.run(10);
    assert!(desk.answer(ONE, stop).unwrap().unwrap_err().contains("NOT confirmed"));
    assert!(desk.answer(ONE, step).unwrap().is_err() && desk.answer(ONE, off).is_some());
}

#[test]
fn a_board_that_is_not_heard_any_more_is_told_to_stop_what_was_driven() {
    let mut desk = Desk::new();
    desk.ask(ONE, json!({"do": "arm"})).unwrap();
    // Its own watch over silence is off.
    desk.ask(ONE, json!({"do": "set", "values": {"link timeout": 0}})).unwrap();
    desk.ask(ONE, drive(1, 4000)).unwrap();
    desk.run(500);
    desk.is_deaf = true;
    desk.run(2500);
    assert!(desk.drives(1));
    desk.run(800);
    assert!(!desk.drives(1));
    assert_eq!(desk.last(ONE, "armed")["by"], Value::Null);
}

#[test]
fn a_board_that_starts_again_is_met_anew_and_disarmed() {
    let mut desk = Desk::new();
    desk.drive(ONE);
    desk.ask(ONE, json!({"do": "set", "values": {"telemetry period": 20}})).unwrap();
    desk.board.start_again(ResetCause::Watchdog);
    desk.run(6000);
    let board = desk.last(ONE, "board");
    assert!(board["connected"] == true && board["start"].as_str().unwrap().contains("watchdog"));
    assert_eq!(desk.last(ONE, "armed")["by"], Value::Null);
    let settings = desk.last(ONE, "settings");
    assert_eq!(settings["unsaved"], false);
    let period = settings["settings"].as_array().unwrap().iter();
    let period = period.clone().find(|setting| setting["name"] == "telemetry period").unwrap();
    assert_eq!(period["value"], 50);
}

#[test]
fn a_stop_while_the_board_is_asked_who_it_is_loses_nothing() {
    let mut desk = Desk::new();
    desk.panel.link_is_open(desk.now());
    while !desk.panel.is_connected() {
        desk.run(1);
    }
    let stop = desk.say(ONE, json!({"do": "stop"}));
    desk.run(8000);
    assert!(desk.answer(ONE, stop).unwrap().is_ok());
    assert_eq!(desk.last(ONE, "board")["extension"], 3);
    desk.drive(ONE);
}

#[test]
fn nobody_arms_before_it_is_known_who_drives() {
    let mut desk = Desk::new();
    desk.panel.link_is_open(desk.now());
    while !desk.panel.is_connected() {
        desk.run(1);
    }
    let asked = desk.say(ONE, json!({"do": "arm"}));
    desk.run(1);
    assert!(desk.answer(ONE, asked).unwrap().unwrap_err().contains("still being asked"));
    desk.run(1000);
    desk.ask(ONE, json!({"do": "arm"})).unwrap();
}

#[test]
fn a_servo_on_its_way_stays_where_it_is_when_its_page_goes() {
    let mut desk = Desk::new();
    desk.ask(ONE, json!({"do": "arm"})).unwrap();
    desk.ask(ONE, json!({"do": "servo", "servo": 2, "us": 1000})).unwrap();
    desk.run(500);
    desk.ask(ONE, json!({"do": "servo", "servo": 2, "us": 2000, "ms": 10_000})).unwrap();
    desk.run(3000);
    desk.close(ONE);
    desk.open(TWO);
    desk.run(300);
    let pulse = |desk: &Desk| desk.board.plant.borrow().outputs.servos[1].map(|p| p.raw());
    let held = pulse(&desk).unwrap();
    assert!((1200..1450).contains(&(i32::from(held) * 4 / 9)), "{held}");
    desk.run(5000);
    assert_eq!(pulse(&desk), Some(held));
    // One that is let go has no pulse.
    desk.ask(TWO, json!({"do": "arm"})).unwrap();
    desk.ask(TWO, json!({"do": "servo", "servo": 2, "us": null})).unwrap();
    desk.run(100);
    assert_eq!(pulse(&desk), None);
}

#[test]
fn settings_asked_for_twice_are_whole() {
    let mut desk = Desk::new();
    let count = desk.last(ONE, "settings")["settings"].as_array().unwrap().len();
    desk.say(ONE, json!({"do": "settings"}));
    desk.run(100);
    desk.say(ONE, json!({"do": "settings"}));
    desk.run(100);
    desk.say(ONE, json!({"do": "settings"}));
    desk.run(6000);
    let settings = desk.last(ONE, "settings")["settings"].as_array().unwrap();
    let mut names: Vec<_> = settings.iter().map(|setting| setting["name"].to_string()).collect();
    names.dedup();
    assert_eq!((settings.len(), names.len()), (count, count));
}
