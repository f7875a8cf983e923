//! `virtual-board ax12-bus`, and the same bus behind `cm5 --pass-through`, under a Dynamixel master that no
//! one here wrote: `rustypot`, on the serial device, in real time. What the master says and hears is its own code; the simulated
//! truth behind it comes from the inspector.
#![cfg(unix)]

mod program;

use std::time::Duration;

use program::{Board, program, refused};
use rustypot::DynamixelProtocolHandler;
use rustypot::servo::dynamixel::ax::AxController;
use serde_json::json;
use serialport::SerialPort;

/// How long the master waits for an answer: long, since these machines are slow at times.
const TIMEOUT: Duration = Duration::from_millis(500);

fn bus(servos: &str) -> Board {
    let board = Board::start(&["ax12-bus", "--servos", servos]);
    assert_eq!(board.title, "AX-12 bus at your service:");
    assert!(board.has("TCP") && !board.has("UDP"));
    board
}

fn pass_through(servos: &str) -> Board {
    let board = Board::start(&["cm5", "--pass-through", "--servos", servos]);
    assert_eq!(board.title, "CM-5 as a pass-through at your service:");
    board
}

/// Both ways to these servos, one after the other.
fn both(servos: &str) -> impl Iterator<Item = Board> {
    [bus, pass_through].into_iter().map(move |start| start(servos))
}

fn port(board: &Board) -> Box<dyn SerialPort> {
    serialport::new(board.place("serial"), 1_000_000).timeout(TIMEOUT).open().unwrap()
}

fn master(board: &Board) -> AxController {
    AxController::new().with_protocol_v1().with_serial_port(port(board))
}

#[test]
fn an_independent_master_finds_reads_and_writes_the_servos() {
    for bus in both("1-3,18") {
        let mut port = port(&bus);
        let handler = DynamixelProtocolHandler::v1();
        for (id, is_there) in [(1, true), (2, true), (3, true), (18, true), (4, false), (0, false)]
        {
            assert_eq!(handler.ping(port.as_mut(), id).unwrap(), is_there, "servo {id}");
        }
        drop(port);

        let mut master = master(&bus);
        assert_eq!(master.read_model_number(18).unwrap(), [12]);
        assert_eq!(master.read_raw_present_position(18).unwrap(), [512]);
        assert_eq!(master.read_present_voltage(18).unwrap(), [120]);
        master.write_torque_enable(18, 1).unwrap();
        master.write_moving_speed(18, 300).unwrap();
        master.write_raw_goal_position(18, 700).unwrap();
        assert_eq!(master.read_raw_goal_position(18).unwrap(), [700]);
        // A position short of the goal, within the margin, the motor rests.
        bus.until(|state| state["servos"][3]["position"] == 699.0);
        assert_eq!(master.read_raw_present_position(18).unwrap(), [699]);
        assert_eq!(master.read_moving(18).unwrap(), [0]);
        let truth = &bus.state()["servos"][3];
        assert_eq!(
            (&truth["id"], &truth["moving_speed"], &truth["speed"], &truth["torque"]),
            (&json!(18), &json!(300), &json!(0.0), &json!(true))
        );
        // Without limits it turns endlessly, clockwise with bit 10.
        master.write_raw_ccw_angle_limit(18, 0).unwrap();
        std::thread::sleep(Duration::from_millis(100)); // it is busy with its EEPROM
        master.write_moving_speed(18, 1024 + 200).unwrap();
        bus.until(|state| (state["servos"][3]["speed"].as_f64().unwrap() + 200.0).abs() < 0.5);
        // Nobody else was meant.
        assert_eq!(bus.state()["servos"][0]["goal"], 512);
    }
}

#[test]
fn an_independent_masters_sync_write_reaches_each_servo_with_its_own_value() {
    for bus in both("1-6") {
        let mut master = master(&bus);
        let ids: Vec<u8> = (1..=6).collect();
        let goals: Vec<u16> = (1..=6).map(|k| 500 + 10 * k).collect();
        master.sync_write_torque_enable(&ids, &[1; 6]).unwrap();
        master.sync_write_raw_goal_position(&ids, &goals).unwrap();
        for (index, goal) in goals.iter().enumerate() {
            // They set out from 512, and rest within the margin.
            let rests = if *goal < 512 { goal + 1 } else { goal - 1 };
            bus.until(|state| state["servos"][index]["position"] == f64::from(rests));
            assert_eq!(master.read_raw_present_position(ids[index]).unwrap(), [rests]);
        }
    }
}

#[test]
fn an_independent_master_sees_refusals_and_a_pulled_plug() {
    for bus in both("1,2") {
        let mut port = port(&bus);
        let handler = DynamixelProtocolHandler::v1();
        let (_, error) = handler.read_with_error(port.as_mut(), 1, 49, 2).unwrap();
        assert_eq!(error.byte(), 0x08, "a range error");
        let error = handler.write_with_error(port.as_mut(), 1, 30, &[0, 4]).unwrap();
        assert_eq!(error.byte(), 0x08, "1024 is no position");
        assert_eq!(handler.read(port.as_mut(), 1, 30, 2).unwrap(), [0, 2]);

        assert_eq!(bus.ask(json!({"set": {"unplug": [1]}})), json!({"ok": true}));
        assert!(
            !handler.ping(port.as_mut(), 1).unwrap() && handler.ping(port.as_mut(), 2).unwrap()
        );
        assert_eq!(bus.ask(json!({"set": {"replug": [1]}})), json!({"ok": true}));
        assert!(handler.ping(port.as_mut(), 1).unwrap());

        let error = bus.ask(json!({"set": {"unplug": [1], "jammed": [3]}}));
        assert_eq!(error["error"], "jammed: expected a list of IDs out of [1, 2]");
        assert!(handler.ping(port.as_mut(), 1).unwrap(), "and nothing was changed");
    }
}

#[test]
fn what_an_independent_master_has_left_turning_is_stopped_by_the_pass_through_2_s_later() {
    let board = pass_through("1,2");
    let mut master = master(&board);
    master.write_raw_ccw_angle_limit(1, 0).unwrap();
    std::thread::sleep(Duration::from_millis(100)); // it is busy with its EEPROM
    assert_eq!(master.read_raw_cw_angle_limit(1).unwrap(), [0]);
    for id in [1, 2] {
        master.write_torque_enable(id, 1).unwrap();
        master.write_moving_speed(id, 200).unwrap();
    }
    board.until(|state| state["servos"][0]["speed"].as_f64().unwrap() > 199.0);
    let state = board.until(|state| state["servos"][0]["speed"] == 0.0);
    assert_eq!(
        (&state["servos"][0]["moving_speed"], &state["servos"][1]["moving_speed"]),
        (&json!(0), &json!(200))
    );
    assert_eq!((&state["wheels"], &state["pass_through"]["stops"]), (&json!([1]), &json!(1)));
    drop(master);
    let (handler, mut port) = (DynamixelProtocolHandler::v1(), port(&board));
    let error = handler.write_with_error(port.as_mut(), 2, 4, &[34]).unwrap();
    assert_eq!(error.byte(), 0x10, "the checksum error");
    assert_eq!(board.state()["pass_through"]["refused_bauds"], 1);
    assert_eq!(handler.read(port.as_mut(), 2, 4, 1).unwrap(), [1]);
}

#[test]
fn a_person_can_try_the_alarms() {
    let bus = bus("1-3");
    let mut master = master(&bus);
    master.write_torque_enable(1, 1).unwrap();
    master.write_torque_enable(3, 1).unwrap();
    let ask = |changes| assert_eq!(bus.ask(json!({ "set": changes })), json!({"ok": true}));
    ask(json!({"temperature_c": {"1": 75}, "voltage_dv": {"2": 50}, "load": {"3": -1200}}));
    // The load is more than its motor can hold.
    let state = bus.until(|state| state["servos"][2]["errors"] == "overload");
    let told = |k: usize| {
        let servo = &state["servos"][k];
        json!([servo["temperature_c"], servo["voltage_dv"], servo["load"], servo["torque"]])
    };
    assert_eq!(
        [told(0), told(1), told(2)],
        [json!([75, 120, 0, false]), json!([35, 50, 0, false]), json!([35, 120, -1200, false])]
    );
    assert_eq!(state["servos"][0]["errors"], "overheat");
    assert_eq!(state["servos"][1]["errors"], "voltage");
    assert_eq!(master.read_present_temperature(1).unwrap(), [75]);
    assert_eq!(master.read_present_voltage(2).unwrap(), [50]);
    ask(json!({"temperature_c": {"1": null}, "voltage_dv": {"2": null}, "load": {"3": null}}));
    let state = bus.state();
    assert_eq!(state["servos"][0]["temperature_c"], 35);
    assert_eq!(state["servos"][2]["load"], 0);

    for wrong in [json!({"4": 75}), json!({"1": 256}), json!({"1": -1}), json!([75]), json!(75)] {
        let answer = bus.ask(json!({"set": {"jammed": [2], "temperature_c": wrong}}));
        let said = "temperature_c: expected whole numbers from 0 to 255, or null, by IDs out of \
                    [1, 2, 3], as {\"1\":85}";
        assert_eq!(answer["error"], said);
    }
    assert_eq!(bus.state()["servos"][1]["jammed"], false, "and nothing was changed");
}

#[test]
fn what_is_wrong_with_the_servos_is_named() {
    for (options, said) in [
        (
            &["ax12-bus", "--servos", "6-1"][..],
            "--servos 6-1: expected IDs from 0 to 253, as 1-6 or 1,2,5-7",
        ),
        (
            &["ax12-bus", "--servos", "254"],
            "--servos 254: expected IDs from 0 to 253, as 1-6 or 1,2,5-7",
        ),
        (
            &["ax12-bus", "--servos", "1,,2"],
            "--servos 1,,2: expected IDs from 0 to 253, as 1-6 or 1,2,5-7",
        ),
        (
            &["ax12-bus", "--line-rate", "0"],
            "--line-rate 0: a servo bus takes its time, give 9600 or more",
        ),
        (&["pms5005", "--servos", "1"], "--servos: not for pms5005, only for cm5, ax12-bus"),
        (&["ax12-bus", "--pass-through"], "--pass-through: not for ax12-bus, only for cm5"),
        (
            &["cm5", "--pass-through", "--web", "127.0.0.1:0"],
            "--web: a pass-through has no page, its PC is the servos' master",
        ),
    ] {
        let output = program(options).output().unwrap();
        refused(&output, &format!("error: {said}\n"));
    }
}
