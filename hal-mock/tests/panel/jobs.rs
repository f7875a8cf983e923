//! Checking and tuning from a page, and what ends them.

use serde_json::{Value, json};

use super::{Desk, ONE, TWO};

const TUNE: &str = "tune";

impl Desk {
    fn begin(&mut self, what: &str) -> u64 {
        self.arm();
        self.say(ONE, json!({"do": what, "motor": 1}))
    }

    /// Begins to tune motor 1, and waits until it drives it with this in mind.
    fn tune_until(&mut self, doing: &str) -> u64 {
        let tune = self.begin(TUNE);
        for _ in 0..20_000 {
            self.run(1);
            if self.last(ONE, "job")["doing"] == doing && self.drives(1) {
                return tune;
            }
            assert_eq!(self.answer(ONE, tune), None);
        }
        panic!("{}", self.last(ONE, "job"));
    }

    /// What settings differ from their defaults on the board, once all are read anew.
    fn changed(&mut self) -> Vec<String> {
        self.ask(ONE, json!({"do": "settings"})).unwrap();
        self.run(6000);
        let settings = self.last(ONE, "settings")["settings"].as_array().unwrap().iter();
        let changed = settings.filter(|setting| setting["value"] != setting["default"]);
        changed.map(|setting| format!("{} {}", setting["name"], setting["value"])).collect()
    }

    #[track_caller]
    fn error(&self, id: u64) -> String {
        self.answer(ONE, id).expect("no answer").unwrap_err()
    }
}

/// The settings that a tuning names, with their values of before or the new ones.
fn values(tuned: &Value, which: &str) -> Value {
    let settings = tuned["settings"].as_array().unwrap().iter();
    let pairs = settings.map(|s| (s["name"].as_str().unwrap().to_owned(), s[which].clone()));
    Value::Object(pairs.collect())
}

#[test]
fn a_wheel_is_tuned_applied_and_rolled_back() {
    let mut desk = Desk::new();
    let plan = desk.ask(ONE, json!({"do": "plan", "motor": 1})).unwrap();
    assert_eq!(plan, json!({"moves": "turns", "seconds": 30}));
    let plan = desk.ask(ONE, json!({"do": "plan", "motor": 3})).unwrap();
    assert_eq!(plan["moves"], "stays");
    desk.open(TWO);
    let tune = desk.begin(TUNE);
    let (mut most, mut doing) = (0.0_f64, Vec::new());
    while desk.answer(ONE, tune).is_none() {
        desk.run(1);
        most = most.max(desk.duty(1).unwrap_or_default().abs());
        let told = desk.last(TWO, "job")["doing"].as_str().unwrap_or_default().to_owned();
        if doing.last() != Some(&told) {
            doing.push(told);
        }
        assert!(desk.ms < 40_000);
    }
    let tuned = desk.answer(ONE, tune).unwrap().unwrap();
    assert!((49.0..50.1).contains(&most), "{most}");
    assert!(doing.iter().any(|told| told.contains("confirms")), "{doing:?}");
    assert_eq!(desk.last(TWO, "job")["motor"], Value::Null);
    assert_eq!(desk.duty(1), None);
    assert_eq!((&tuned["motor"], &tuned["loop"]), (&json!(1), &json!("velocity")));
    let fit = &tuned["fit"];
    // The virtual motor: 16,300 counts/s, 60 ms.
    assert!((16_000.0..16_600.0).contains(&fit["gain"].as_f64().unwrap()), "{fit}");
    assert!((50.0..70.0).contains(&fit["time_constant_ms"].as_f64().unwrap()), "{fit}");
    assert!(fit["percent"].as_f64().unwrap() > 95.0, "{fit}");
    for name in ["predicted", "measured"] {
        let rise = tuned[name]["rise_ms"].as_u64().unwrap();
        assert!((40..200).contains(&rise), "{name}: {}", tuned[name]);
        assert!(tuned[name]["settling_ms"].is_u64());
    }
    let curve =
        |name: &str| -> Vec<f64> { serde_json::from_value(tuned["curves"][name].clone()).unwrap() };
    let (measured, predicted) = (curve("measured"), curve("predicted"));
    assert_eq!(measured.len(), predicted.len());
    let target = tuned["target"].as_f64().unwrap();
    let ends = [measured.last(), predicted.last()].map(|end| *end.unwrap() / target);
    assert!(measured.len() > 50 && ends.iter().all(|end| (end - 1.0).abs() < 0.05), "{ends:?}");
    // Nothing has changed; what was found is set, and what was before.
    assert_eq!(desk.last(ONE, "settings")["unsaved"], false);
    let (new, before) = (values(&tuned, "value"), values(&tuned, "before"));
    let kp = desk.setting("velocity Kp 1")["value"].clone();
    assert!(new["velocity Kp 1"] != kp && before["velocity Kp 1"] == kp);
    assert_eq!(tuned["gains"]["kp"], new["velocity Kp 1"]);
    desk.ask(ONE, json!({"do": "set", "values": new})).unwrap();
    assert_eq!(desk.setting("velocity Kp 1")["value"], new["velocity Kp 1"]);
    desk.ask(ONE, json!({"do": "set", "values": before})).unwrap();
    assert_eq!(desk.changed(), [""; 0]);
    // And the panel goes on as before.
    desk.ask(ONE, json!({"do": "drive", "motor": 1, "velocity": 4000})).unwrap();
    desk.run(500);
    assert!(desk.drives(1));
    let state = desk.last(ONE, "state")["motors"][0].clone();
    assert!((state["velocity"].as_i64().unwrap() - 4000).abs() < 200, "{state}");
}

#[test]
fn a_joint_is_tuned_where_it_stands() {
    let mut desk = Desk::new();
    desk.arm();
    let tune = desk.say(ONE, json!({"do": "tune", "motor": 3}));
    while desk.answer(ONE, tune).is_none() && desk.ms < 60_000 {
        desk.run(10);
    }
    let tuned = desk.answer(ONE, tune).unwrap().unwrap();
    assert_eq!((&tuned["loop"], &tuned["gains"]["reset_ms"]), (&json!("position"), &Value::Null));
}

#[test]
fn a_check_tells_what_moved_and_a_motor_that_turns_the_wrong_way_is_refused_in_words() {
    let mut desk = Desk::new();
    desk.arm();
    let checked = desk.ask(ONE, json!({"do": "check", "motor": 1})).unwrap();
    assert_eq!((&checked["has_current"], &checked["turned_round"]), (&json!(true), &json!(false)));
    for way in checked["ways"].as_array().unwrap() {
        assert!(way["moved"].as_i64().unwrap() >= 3 && way["duty"] == 20.0, "{way}");
    }
    desk.ask(ONE, json!({"do": "set", "values": {"polarity 1": 1}})).unwrap();
    desk.ask(ONE, json!({"do": "save"})).unwrap();
    let refused = desk.ask(ONE, json!({"do": "check", "motor": 1})).unwrap_err();
    assert!(refused.contains("swap the motor's wires"), "{refused}");
    desk.run(1000);
    assert_eq!(desk.duty(1), None);
    let checked = desk.ask(ONE, json!({"do": "check", "motor": 1, "set_polarity": true})).unwrap();
    assert_eq!(checked["turned_round"], true);
    // Pages are told, and that it is not saved.
    assert_eq!(desk.setting("polarity 1")["value"], 0);
    assert_eq!(desk.last(ONE, "settings")["unsaved"], true);
}

#[test]
fn a_stop_from_another_page_stops_at_once_and_the_settings_are_set_back() {
    for doing in ["checks its wiring", "finds out what it is", "confirms them by a step"] {
        let mut desk = Desk::new();
        desk.open(TWO);
        let tune = desk.tune_until(doing);
        desk.run(100);
        let stop = desk.say(TWO, json!({"do": "stop"}));
        desk.run(5);
        assert!(!desk.drives(1), "{doing}: not at once");
        let mut moved = false;
        for _ in 0..4000 {
            desk.run(1);
            moved |= desk.drives(1);
        }
        assert!(!moved && desk.duty(1).is_none(), "{doing}");
        let error = desk.error(tune);
        assert!(error.contains("a stop came first") && !error.contains("not"), "{error}");
        let stopped = desk.answer(TWO, stop).unwrap().unwrap();
        assert_eq!(stopped, json!({"confirmed": true, "stands": true, "opposed": false}));
        assert_eq!(desk.last(ONE, "armed")["by"], Value::Null);
        assert_eq!(desk.changed(), [""; 0], "{doing}");
        assert_eq!(desk.last(ONE, "settings")["unsaved"], false);
    }
}

#[test]
fn a_stop_while_it_reads_a_recording_is_confirmed_by_the_machine_state() {
    let mut desk = Desk::new();
    let tune = desk.tune_until("finds out what it is");
    while desk.last(ONE, "job")["has_state"] == true {
        desk.run(1);
    }
    desk.run(700);
    let stopped = desk.ask(ONE, json!({"do": "stop"})).unwrap();
    assert_eq!(stopped, json!({"confirmed": true, "stands": true, "opposed": false}));
    desk.run(500);
    assert!(desk.error(tune).contains("a stop came first"));
    assert_eq!(desk.changed(), [""; 0]);
}

#[test]
fn a_stop_while_it_sets_its_settings_back_loses_nothing() {
    // A while after the first stop another one, and what was to be written then is lost.
    for late in 0..40 {
        let mut desk = Desk::new();
        let tune = desk.tune_until("finds out what it is");
        desk.ask(ONE, json!({"do": "stop"})).unwrap();
        desk.run(late);
        desk.lose_output();
        desk.ask(ONE, json!({"do": "stop"})).unwrap();
        desk.run(2000);
        assert!(desk.error(tune).contains("stop"));
        assert_eq!(desk.changed(), [""; 0], "after {late} ms");
    }
}

#[test]
fn a_page_that_falls_silent_closes_or_disarms_or_an_off_ends_it() {
    for how in ["silent", "closed", "disarmed", "off"] {
        let mut desk = Desk::new();
        desk.open(TWO);
        let tune = desk.tune_until("finds out what it is");
        desk.run(50 - desk.ms % 50);
        let bound = match how {
            "silent" => {
                desk.alive.retain(|page| *page != ONE);
                300
            }
            "closed" => {
                desk.close(ONE);
                20
            }
            "disarmed" => {
                desk.say(ONE, json!({"do": "disarm"}));
                20
            }
            _ => {
                desk.say(ONE, json!({"do": "off", "motor": 1}));
                20
            }
        };
        desk.run(bound);
        assert!(!desk.drives(1), "{how}");
        desk.run(4000);
        assert_eq!(desk.duty(1), None, "{how}");
        if how != "closed" {
            assert!(desk.error(tune).contains("stopped before its end"), "{}", desk.error(tune));
        }
        desk.open(3);
        desk.ask(3, json!({"do": "settings"})).unwrap();
        desk.run(6000);
        let settings = desk.last(3, "settings")["settings"].as_array().unwrap();
        assert!(settings.iter().all(|setting| setting["value"] == setting["default"]), "{how}");
        assert_eq!(desk.last(3, "job")["motor"], Value::Null);
    }
}

#[test]
fn a_line_that_is_cut_meanwhile_is_told_and_the_board_stops_the_motor() {
    let mut desk = Desk::new();
    let tune = desk.tune_until("finds out what it is");
    desk.board.line.cut(true);
    desk.run(2600);
    assert!(!desk.drives(1));
    desk.run(3000);
    assert_eq!(desk.duty(1), None);
    let error = desk.error(tune);
    assert!(error.contains("its own watch over silence stops motor 1"), "{error}");
    assert_eq!(desk.last(ONE, "job")["motor"], Value::Null);
    desk.board.line.cut(false);
    desk.run(6000);
    assert_eq!(desk.duty(1), None);
    desk.drive(ONE);
}

#[test]
fn a_link_that_goes_meanwhile_is_answered() {
    let mut desk = Desk::new();
    let tune = desk.tune_until("finds out what it is");
    desk.panel.link_is_gone("unplugged".into());
    desk.run(10);
    let error = desk.error(tune);
    assert!(error.starts_with("unplugged") && error.contains("highest duty 1 16384"), "{error}");
}

#[test]
fn meanwhile_nothing_else_is_driven_or_set_from_a_page() {
    let mut desk = Desk::new();
    let tune = desk.tune_until("finds out what it is");
    let others = [
        json!({"do": "tune", "motor": 2}),
        json!({"do": "check", "motor": 1}),
        json!({"do": "drive", "motor": 1, "velocity": 4000}),
        json!({"do": "drive", "motor": 2, "velocity": 4000}),
        json!({"do": "step", "motor": 1, "velocity": 4000}),
        json!({"do": "set", "values": {"velocity Kp 1": 7}}),
        json!({"do": "save"}),
        json!({"do": "zero", "motor": 1}),
    ];
    for other in others {
        let error = desk.ask(ONE, other.clone()).unwrap_err();
        assert!(error.starts_with("motor 1 is being tuned"), "{other}: {error}");
    }
    while desk.answer(ONE, tune).is_none() && desk.ms < 40_000 {
        desk.run(10);
    }
    assert!(desk.answer(ONE, tune).unwrap().is_ok());
}

#[test]
fn what_runs_already_is_neither_checked_nor_tuned() {
    let mut desk = Desk::new();
    desk.drive(ONE);
    for motor in [1, 2] {
        let error = desk.ask(ONE, json!({"do": "check", "motor": motor})).unwrap_err();
        assert!(error.contains("motor 1 still runs"), "{error}");
    }
    assert!(desk.drives(1));
}

#[test]
fn another_host_that_starts_a_motor_ends_it() {
    let mut desk = Desk::new();
    let tune = desk.tune_until("finds out what it is");
    let drive = super::others::velocity(2, 3000);
    desk.board.line.host_sends(&drive);
    desk.run(100);
    assert!(!desk.drives(1));
    desk.run(4000);
    assert!(desk.error(tune).contains("another host drives motor 2"), "{}", desk.error(tune));
    assert_eq!(desk.duty(1), None);
}
