//! Other hosts, faults, and a board that goes and comes.

use protocol::pms5005::{Addressing, Command, Move, Quantity};
use serde_json::{Value, json};

use super::{Desk, ONE};

pub(crate) fn velocity(motor: usize, velocity: i16) -> Vec<u8> {
    let mut targets = [None; 6];
    targets[motor - 1] = Some(velocity);
    let drive = Command::Move(Move {
        quantity: Quantity::Velocity,
        addressing: Addressing::List,
        targets,
        periods: 0,
    });
    drive.encode(0, &mut [0; 264]).unwrap().to_vec()
}

#[test]
fn another_host_that_takes_the_motor_or_starts_one_ends_the_drive() {
    for (motor, speed) in [(1, -2000), (2, 3000)] {
        let mut desk = Desk::new();
        desk.drive(ONE);
        desk.board.line.host_sends(&velocity(motor, speed));
        desk.run(600);
        assert!(!desk.drives(1));
        assert!(
            desk.notes().iter().any(|note| note.contains("another host")),
            "{:?}",
            desk.notes()
        );
    }
}

#[test]
fn a_motor_that_another_host_drives_is_not_taken() {
    let mut desk = Desk::new();
    desk.ask(ONE, json!({"do": "arm"})).unwrap();
    desk.board.line.host_sends(&velocity(1, 3000));
    desk.run(200);
    let drive = desk.ask(ONE, json!({"do": "drive", "motor": 1, "velocity": -4000}));
    assert!(drive.unwrap_err().contains("another host"));
    let set_point = desk.last(ONE, "state")["motors"][0]["set_point"].clone();
    assert_eq!(set_point, 3000);
}

#[test]
fn a_stop_that_another_host_drives_against_says_so() {
    let mut desk = Desk::new();
    let stop = desk.say(ONE, json!({"do": "stop"}));
    for _ in 0..60 {
        desk.board.line.host_sends(&velocity(1, 3000));
        desk.run(100);
    }
    let stopped = desk.answer(ONE, stop).unwrap().unwrap();
    assert_eq!((&stopped["confirmed"], &stopped["opposed"]), (&json!(false), &json!(true)));
}

#[test]
fn a_fault_ends_the_drive_is_told_with_its_remedy_and_cleared_alone() {
    let mut desk = Desk::new();
    desk.drive(ONE);
    desk.ask(ONE, json!({"do": "drive", "motor": 2, "velocity": 4000})).unwrap();
    {
        let plant = &mut desk.board.plant.borrow_mut().overrides;
        plant.jam = [Some(true), Some(true), None, None, None, None];
    }
    desk.run(9000);
    let faults = desk.last(ONE, "faults")["faults"].as_array().unwrap().clone();
    let of = |motor: i64| faults.iter().filter(|f| f["motor"] == motor).collect::<Vec<_>>();
    assert!(
        of(1)[0]["name"] == "stall" && of(1)[0]["remedy"].as_str().unwrap().contains("free it")
    );
    assert!(!of(2).is_empty());
    let reason = desk.last(ONE, "state")["motors"][0]["reason"].clone();
    assert!(reason.as_str().unwrap().contains("stall"), "{reason}");
    desk.board.plant.borrow_mut().overrides.jam = [None; 6];
    desk.ask(ONE, json!({"do": "clear", "motor": 1})).unwrap();
    desk.run(3000);
    let left = desk.last(ONE, "faults")["faults"].as_array().unwrap().clone();
    assert!(
        left.iter().all(|f| f["motor"] != 1) && left.iter().any(|f| f["motor"] == 2),
        "{left:?}"
    );
    assert!(!desk.drives(1) && !desk.drives(2));
    desk.ask(ONE, json!({"do": "clear"})).unwrap();
    desk.run(3000);
    let left = desk.last(ONE, "faults")["faults"].as_array().unwrap();
    assert!(left.iter().all(|f| f["motor"].is_null()), "{left:?}");
}

#[test]
fn a_board_that_falls_silent_is_gone_and_comes_back_disarmed() {
    let mut desk = Desk::new();
    desk.drive(ONE);
    desk.board.line.cut(true);
    desk.run(4000);
    let board = desk.last(ONE, "board").clone();
    assert!(
        board["connected"] == false && board["why"].as_str().unwrap().contains("says nothing"),
        "{board}"
    );
    assert_eq!(desk.last(ONE, "armed")["by"], Value::Null);
    assert_eq!(desk.duty(1), None);
    let error = desk.ask(ONE, json!({"do": "arm"})).unwrap_err();
    assert!(error.contains("no board"), "{error}");
    let error = desk.ask(ONE, json!({"do": "stop"})).unwrap_err();
    assert!(error.contains("NOT confirmed"), "{error}");
    desk.board.line.cut(false);
    desk.run(6000);
    assert_eq!(desk.last(ONE, "board")["connected"], true);
    assert_eq!(desk.last(ONE, "armed")["by"], Value::Null);
    assert_eq!(desk.duty(1), None);
    assert!(!desk.last(ONE, "settings")["settings"].as_array().unwrap().is_empty());
    desk.drive(ONE);
}

#[test]
fn sensors_health_and_who_it_is_are_told() {
    let mut desk = Desk::new();
    desk.board.plant.borrow_mut().overrides.sonar_cm = [Some(17), None, None, None, None, None];
    desk.run(2000);
    let sensors = desk.last(ONE, "sensors");
    assert_eq!((&sensors["sonar_cm"][0], &sensors["sonar_cm"][1]), (&json!(17), &json!(255)));
    assert!((sensors["ir_cm"].as_f64().unwrap() - 80.0).abs() < 2.0, "{}", sensors["ir_cm"]);
    let health = desk.last(ONE, "health");
    assert!(
        health["uptime_ms"].as_u64().unwrap() > 5000 && health["frames"].as_f64().unwrap() > 60.0,
        "{health}"
    );
    assert!(health["counters"]["frames_ok"].as_u64().unwrap() > 10);
    let board = desk.last(ONE, "board");
    assert_eq!((&board["kind"], &board["has_state"]), (&json!("pms5005"), &json!(true)));
    let states = desk.told.iter().filter(|(_, told)| told["tell"] == "state").count();
    assert!((200..=6000 / 20).contains(&states), "{states}");
}
