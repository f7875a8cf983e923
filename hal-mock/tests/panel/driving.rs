//! Arming, driving, stopping.

use serde_json::{Value, json};

use super::{Desk, ONE, TWO};

#[test]
fn a_page_opens_disarmed_and_can_only_watch_and_stop() {
    let mut desk = Desk::new();
    assert_eq!(desk.last(ONE, "armed")["by"], Value::Null);
    let writes = [
        json!({"do": "drive", "motor": 1, "velocity": 4000}),
        json!({"do": "off", "motor": 1}),
        json!({"do": "step", "motor": 1, "velocity": 4000}),
        json!({"do": "check", "motor": 1}),
        json!({"do": "tune", "motor": 1}),
        json!({"do": "servo", "servo": 1, "us": 1500}),
        json!({"do": "gpio", "outputs": 255}),
        json!({"do": "lcd", "image": "00"}),
        json!({"do": "zero", "motor": 1}),
        json!({"do": "clear"}),
        json!({"do": "set", "values": {"telemetry period": 20}}),
        json!({"do": "save"}),
        json!({"do": "reset"}),
        json!({"do": "restore", "text": ""}),
    ];
    for write in writes {
        let error = desk.ask(ONE, write.clone()).unwrap_err();
        assert!(error.contains("not armed"), "{write}: {error}");
    }
    desk.run(100);
    assert_eq!((desk.duty(1), desk.board.plant.borrow().outputs.gpio), (None, 0));
    let stopped = desk.ask(ONE, json!({"do": "stop"})).unwrap();
    assert_eq!(stopped, json!({"confirmed": true, "stands": true, "opposed": false}));
}

#[test]
fn one_page_is_armed_at_a_time_and_the_second_is_told_which() {
    let mut desk = Desk::new();
    desk.open(TWO);
    desk.ask(ONE, json!({"do": "arm"})).unwrap();
    let told = desk.last(TWO, "armed");
    assert_eq!((&told["by"], &told["you"]), (&json!("page 1"), &json!(false)));
    assert!(desk.ask(TWO, json!({"do": "arm"})).unwrap_err().starts_with("page 1 is armed"));
    let error = desk.ask(TWO, json!({"do": "drive", "motor": 1, "velocity": 4000})).unwrap_err();
    assert!(error.starts_with("page 1 is armed"), "{error}");
    desk.close(ONE);
    desk.ask(TWO, json!({"do": "arm"})).unwrap();
    desk.run(4000);
    assert_eq!(desk.last(TWO, "armed")["you"], true);
}

#[test]
fn a_motor_runs_until_it_is_told_otherwise_and_its_state_is_told() {
    let mut desk = Desk::new();
    desk.drive(ONE);
    desk.run(10_000);
    let motor = desk.last(ONE, "state")["motors"][0].clone();
    assert_eq!((&motor["mode"], &motor["set_point"]), (&json!("velocity"), &json!(4000)));
    assert!(
        (motor["velocity"].as_i64().unwrap() - 4000).abs() < 100 && motor["ours"] == true,
        "{motor}"
    );
    desk.ask(ONE, json!({"do": "drive", "motor": 1, "duty": -30.0})).unwrap();
    desk.run(300);
    assert!((desk.duty(1).unwrap() + 30.0).abs() < 0.1);
    desk.ask(ONE, json!({"do": "off", "motor": 1})).unwrap();
    assert_eq!(desk.duty(1), None);
    desk.run(100);
    assert_eq!(desk.last(ONE, "state")["motors"][0]["ours"], false);
}

#[test]
fn any_page_stops_everything_armed_or_not() {
    let mut desk = Desk::new();
    desk.drive(ONE);
    desk.ask(ONE, json!({"do": "drive", "motor": 2, "velocity": -3000})).unwrap();
    desk.ask(ONE, json!({"do": "servo", "servo": 3, "us": 1500})).unwrap();
    desk.run(300);
    desk.open(TWO);
    desk.say(TWO, json!({"do": "stop"}));
    desk.run(5);
    assert!(!desk.drives(1) && !desk.drives(2), "not at once");
    desk.run(2000);
    assert_eq!((desk.duty(1), desk.duty(2)), (None, None));
    assert!(desk.board.plant.borrow().outputs.servos.iter().all(Option::is_none));
    // What the first page still has to say is older than the stop.
    assert_eq!(desk.last(ONE, "armed")["by"], Value::Null);
    assert!(desk.ask(ONE, json!({"do": "servo", "servo": 3, "us": 1500})).is_err());
}

#[test]
fn a_stop_goes_before_the_drive_that_waits_for_its_answer() {
    let mut desk = Desk::new();
    desk.ask(ONE, json!({"do": "arm"})).unwrap();
    // Its acknowledgement is lost, so it would be sent again half a second later.
    let drive = desk.say(ONE, json!({"do": "drive", "motor": 1, "velocity": 4000}));
    desk.lose_output();
    desk.run(10);
    let stop = desk.say(ONE, json!({"do": "stop"}));
    let mut moved = false;
    for _ in 0..3000 {
        desk.run(1);
        moved |= desk.drives(1);
    }
    assert!(!moved);
    assert!(desk.answer(ONE, drive).unwrap().unwrap_err().contains("a stop came first"));
    assert_eq!(desk.answer(ONE, stop).unwrap().unwrap()["confirmed"], true);
}

#[test]
fn what_a_page_drives_stops_within_300_ms_when_it_does_not_answer() {
    let mut desk = Desk::new();
    desk.drive(ONE);
    desk.run(50 - desk.ms % 50);
    desk.alive.clear();
    let mut stopped = None;
    for ms in 1..=400 {
        desk.run(1);
        if !desk.drives(1) && stopped.is_none() {
            stopped = Some(ms);
        }
    }
    let after = stopped.expect("it runs on");
    assert!((250..=300).contains(&after), "after {after} ms");
    assert_eq!(desk.last(ONE, "armed")["by"], Value::Null);
    assert!(desk.notes().iter().any(|note| note.contains("did not answer")), "{:?}", desk.notes());
    // And nothing drives it again.
    desk.alive.push(ONE);
    desk.run(3000);
    assert!(!desk.drives(1));
}

#[test]
fn a_page_that_closes_or_disarms_stops_what_it_drives() {
    for closes in [true, false] {
        let mut desk = Desk::new();
        desk.open(TWO);
        desk.drive(TWO);
        match closes {
            true => desk.close(TWO),
            false => drop(desk.say(TWO, json!({"do": "disarm"}))),
        }
        desk.run(20);
        assert!(!desk.drives(1));
        desk.run(2000);
        assert_eq!(desk.duty(1), None);
        assert!(desk.notes().iter().any(|note| note.contains("what it drove is stopped")));
    }
}

#[test]
fn who_only_watches_keeps_nothing_running() {
    use protocol::pms5005::{Addressing, Command, Move, Quantity};
    let mut desk = Desk::new();
    desk.ask(ONE, json!({"do": "arm"})).unwrap();
    // Another host drives, and dies.
    let targets = [Some(4000), None, None, None, None, None];
    let drive = Command::Move(Move {
        quantity: Quantity::Velocity,
        addressing: Addressing::List,
        targets,
        periods: 0,
    });
    desk.board.line.host_sends(drive.encode(0, &mut [0; 264]).unwrap());
    desk.run(1900);
    assert!(desk.drives(1));
    desk.run(600);
    assert!(!desk.drives(1));
}

#[test]
fn a_step_tells_its_curve_and_figures_and_stops() {
    let mut desk = Desk::new();
    desk.ask(ONE, json!({"do": "arm"})).unwrap();
    let step =
        desk.ask(ONE, json!({"do": "step", "motor": 1, "velocity": 4000, "ms": 1500})).unwrap();
    // The recorder's, every 3 ms, not a machine state's every 20 ms.
    assert_eq!(step["samples"].as_array().unwrap().len(), 500, "{step}");
    assert!((20..400).contains(&step["rise_ms"].as_u64().unwrap()), "{}", step["rise_ms"]);
    let duty = step["samples"][400][2].as_f64().unwrap();
    assert!((20.0..40.0).contains(&duty), "{duty} %");
    assert!(step["steady_error"].as_f64().unwrap().abs() < 100.0);
    assert_eq!(
        (&step["unit"], &step["target"], &step["motor"]),
        (&json!("counts/s"), &json!(4000.0), &json!(1))
    );
    desk.run(1500);
    assert_eq!(desk.duty(1), None);
    // One that is stopped says so.
    let step = desk.say(ONE, json!({"do": "step", "motor": 1, "position": 3000}));
    desk.run(300);
    desk.ask(ONE, json!({"do": "stop"})).unwrap();
    assert!(desk.answer(ONE, step).unwrap().unwrap_err().contains("stop"));
}

#[test]
fn bad_messages_are_answered_in_one_line_and_change_nothing() {
    let mut desk = Desk::new();
    desk.ask(ONE, json!({"do": "arm"})).unwrap();
    let cases = [
        (json!({"do": "fly"}), "fly"),
        (json!({"motor": 1}), "do"),
        (json!({"do": "drive", "motor": 7, "velocity": 1}), "motor"),
        (json!({"do": "drive", "motor": 0, "velocity": 1}), "motor"),
        (json!({"do": "drive", "motor": 1.5, "velocity": 1}), "motor"),
        (json!({"do": "drive", "motor": 1}), "one of velocity"),
        (json!({"do": "drive", "motor": 1, "velocity": 1, "duty": 1}), "one of velocity"),
        (json!({"do": "drive", "motor": 1, "velocity": 40_000}), "velocity"),
        (json!({"do": "drive", "motor": 1, "position": -1}), "position"),
        (json!({"do": "drive", "motor": 1, "duty": 101}), "duty"),
        (json!({"do": "drive", "motor": 1, "duty": "full"}), "duty"),
        (json!({"do": "drive", "motor": 1, "velocity": 1, "ms": -5}), "ms"),
        (json!({"do": "step", "motor": 1, "duty": 10}), "step"),
        (json!({"do": "check", "motor": 1, "duty": 0}), "duty"),
        (json!({"do": "tune", "motor": 1, "duty": "full"}), "duty"),
        (json!({"do": "tune", "motor": 1, "loop": "current"}), "loop"),
        (json!({"do": "plan", "motor": 7}), "motor"),
        (json!({"do": "servo", "servo": 1, "us": 100}), "out of range"),
        (json!({"do": "gpio", "outputs": 256}), "outputs"),
        (json!({"do": "lcd", "image": "zz"}), "image"),
        (json!({"do": "lcd", "image": "00"}), "image"),
        (json!({"do": "clear", "motor": 1}), "no fault"),
        (json!({"do": "set", "values": {}}), "values"),
        (json!({"do": "set", "values": {"telemetry periot": 20}}), "telemetry period"),
        (json!({"do": "set", "values": {"telemetry period": 0}}), "out of range"),
        (json!({"do": "set", "values": {"telemetry period": 1.5}}), "whole number"),
        (json!({"do": "restore", "text": "[x]"}), "nothing was changed"),
    ];
    for (what, names) in cases {
        let error = desk.ask(ONE, what.clone()).unwrap_err();
        assert!(error.contains(names) && !error.contains('\n'), "{what}: {error}");
    }
    for text in ["", "[]", "{", "{\"do\":5}", "null"] {
        desk.panel.hear(ONE, text, desk.now());
    }
    desk.run(500);
    assert!((1..=6).all(|motor| desk.duty(motor).is_none()));
}

#[test]
fn a_picture_comes_to_the_display_as_it_was_sent() {
    let mut desk = Desk::new();
    desk.ask(ONE, json!({"do": "arm"})).unwrap();
    let bytes: Vec<u8> = (0..1024u32).map(|k| (k * 7 % 251) as u8).collect();
    let image: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
    desk.ask(ONE, json!({"do": "lcd", "image": image})).unwrap();
    desk.run(100);
    assert_eq!(desk.board.plant.borrow().lcd.as_flattened(), bytes);
    assert_eq!(desk.last(ONE, "outputs")["lcd"], image);
}
