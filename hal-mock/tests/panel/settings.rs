//! Settings: all or none, saved, in files.

use serde_json::{Value, json};

use super::{Desk, ONE};

impl Desk {
    pub(crate) fn setting(&self, name: &str) -> Value {
        let settings = self.last(ONE, "settings")["settings"].as_array().unwrap();
        settings.iter().find(|setting| setting["name"] == name).unwrap().clone()
    }

    pub(crate) fn arm(&mut self) {
        self.ask(ONE, json!({"do": "arm"})).unwrap();
    }
}

#[test]
fn a_setting_is_told_with_range_default_group_and_unit() {
    let desk = Desk::new();
    assert_eq!(
        desk.setting("telemetry period"),
        json!({
            "name": "telemetry period", "group": "host", "value": 50, "default": 50,
            "low": 1, "high": 60_000, "unit": "ms",
        })
    );
    assert_eq!(desk.setting("velocity Kp 3")["group"], "gains");
    assert_eq!(desk.last(ONE, "settings")["unsaved"], false);
}

#[test]
fn what_is_set_is_in_force_and_unsaved_until_it_is_saved() {
    let mut desk = Desk::new();
    desk.arm();
    desk.ask(ONE, json!({"do": "set", "values": {"velocity Kp 1": 80, "velocity Ki 1": 20}}))
        .unwrap();
    assert_eq!(desk.setting("velocity Kp 1")["value"], 80);
    assert_eq!(desk.last(ONE, "settings")["unsaved"], true);
    desk.ask(ONE, json!({"do": "save"})).unwrap();
    desk.run(10);
    assert_eq!(desk.last(ONE, "settings")["unsaved"], false);
    // A board that starts anew has it.
    desk.board.start_again(firmware::ports::ResetCause::Power);
    desk.run(200);
    desk.ask(ONE, json!({"do": "settings"})).unwrap();
    desk.run(4000);
    assert_eq!(desk.setting("velocity Kp 1")["value"], 80);
}

#[test]
fn of_a_change_that_is_refused_nothing_stays() {
    let mut desk = Desk::new();
    desk.arm();
    // The second contradicts: low above high. They go in one request.
    let values = json!({"sonar stop": 40, "sonar clear": 20});
    let error = desk.ask(ONE, json!({"do": "set", "values": values})).unwrap_err();
    assert!(error.contains("contradicts") && error.contains("as before"), "{error}");
    desk.ask(ONE, json!({"do": "settings"})).unwrap();
    desk.run(4000);
    assert_eq!(
        (&desk.setting("sonar stop")["value"], &desk.setting("sonar clear")["value"]),
        (&json!(30), &json!(35))
    );
    // In two requests: the first is undone.
    let mut values = json!({"sonar stop": 20, "integral share 6": 7});
    for n in 1..=6 {
        for name in ["slew time", "acceleration", "position Kp", "position Kd", "velocity Kp"] {
            values[format!("{name} {n}")] = 9.into();
        }
    }
    values["soft limit low 1"] = 900.into();
    values["soft limit high 1"] = 100.into();
    let error = desk.ask(ONE, json!({"do": "set", "values": values})).unwrap_err();
    assert!(error.contains("as before"), "{error}");
    desk.ask(ONE, json!({"do": "settings"})).unwrap();
    desk.run(4000);
    let settings = desk.last(ONE, "settings")["settings"].as_array().unwrap();
    assert!(settings.iter().all(|setting| setting["value"] == setting["default"]));
}

#[test]
fn a_backup_is_compared_and_restored_whole() {
    let mut desk = Desk::new();
    desk.arm();
    let backup = desk.ask(ONE, json!({"do": "backup"})).unwrap();
    desk.ask(ONE, json!({"do": "set", "values": {"telemetry period": 20, "sensor 1": 2}})).unwrap();
    let differ = json!([
        {"name": "telemetry period", "board": 20, "file": 50},
        {"name": "sensor 1", "board": 2, "file": 0},
    ]);
    let told = desk.ask(ONE, json!({"do": "diff", "text": backup})).unwrap();
    let sorted = |told: &Value| {
        let mut list: Vec<_> = told.as_array().unwrap().iter().map(Value::to_string).collect();
        list.sort();
        list
    };
    assert_eq!(sorted(&told["differ"]), sorted(&differ));
    desk.ask(ONE, json!({"do": "restore", "text": backup})).unwrap();
    assert_eq!(desk.setting("telemetry period")["value"], 50);
    assert_eq!(desk.last(ONE, "settings")["unsaved"], false);
    let told = desk.ask(ONE, json!({"do": "diff", "text": backup})).unwrap();
    assert_eq!(told, json!({"differ": [], "missing": []}));
}

#[test]
fn nothing_is_restored_or_saved_while_something_is_driven() {
    let mut desk = Desk::new();
    let backup = desk.ask(ONE, json!({"do": "backup"})).unwrap();
    desk.drive(ONE);
    desk.ask(ONE, json!({"do": "set", "values": {"telemetry period": 20}})).unwrap();
    let error = desk.ask(ONE, json!({"do": "restore", "text": backup})).unwrap_err();
    assert!(error.contains("nothing was changed"), "{error}");
    let error = desk.ask(ONE, json!({"do": "save"})).unwrap_err();
    assert!(error.contains("must be off"), "{error}");
    assert_eq!(desk.setting("telemetry period")["value"], 20);
    assert!(desk.drives(1));
}

#[test]
fn the_defaults_come_back_and_are_told() {
    let mut desk = Desk::new();
    desk.arm();
    desk.ask(ONE, json!({"do": "set", "values": {"telemetry period": 20}})).unwrap();
    desk.ask(ONE, json!({"do": "reset"})).unwrap();
    desk.run(4000);
    assert_eq!(desk.setting("telemetry period")["value"], 50);
    assert_eq!(desk.last(ONE, "settings")["unsaved"], false);
}

#[test]
fn a_stop_interrupts_a_change_and_says_so() {
    let mut desk = Desk::new();
    desk.arm();
    let set = desk.say(ONE, json!({"do": "set", "values": {"telemetry period": 20}}));
    desk.ask(ONE, json!({"do": "stop"})).unwrap();
    let error = desk.answer(ONE, set).unwrap().unwrap_err();
    assert!(error.contains("interrupted"), "{error}");
    desk.run(4000);
    // What came of it is read anew.
    let value = desk.setting("telemetry period")["value"].clone();
    assert!(value == 20 || value == 50);
}
