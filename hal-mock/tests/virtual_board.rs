//! The program as a user runs it: its links, its inspector, its options, its end.
#![cfg(unix)]

mod program;

use std::fs::File;
use std::io::{Read, Write};
use std::net::{TcpStream, UdpSocket};
use std::process::Stdio;
use std::time::{Duration, Instant};

use program::{Board, PATIENCE, cannot_run, program, refused};
use protocol::extension::{Action, Assignments, Request};
use protocol::pms5005::{self as wire, Frame, Quantity, Receiver};
use serde_json::json;

const FREE_PORTS: [&str; 4] = ["--tcp", "127.0.0.1:0", "--udp", "127.0.0.1:0"];

fn pms5005(options: &[&str]) -> Board {
    let board = Board::start(&[&FREE_PORTS[2..], options].concat());
    assert_eq!(board.title, "PMS5005 at your service:");
    board
}

/// The program, on free ports, with no inspector.
fn ends(options: &[&str]) -> std::process::Output {
    program(&[&FREE_PORTS, options].concat()).output().unwrap()
}

fn encoded(command: wire::Command) -> Vec<u8> {
    command.encode(0, &mut [0; 300]).unwrap().to_vec()
}

fn gpio(outputs: u8) -> Vec<u8> {
    encoded(wire::Command::GpioOutputs(outputs))
}

/// Reads until a frame with this DID has come.
fn await_frame(stream: &mut impl Read, did: u8) -> Vec<u8> {
    let mut receiver = Receiver::new();
    let mut buffer = [0; 256];
    let start = Instant::now();
    while start.elapsed() < PATIENCE {
        let count = stream.read(&mut buffer).unwrap();
        assert!(count > 0, "the board has closed the link");
        let mut bytes = &buffer[..count];
        while let Some(frame) = receiver.receive(&mut bytes) {
            let frame = Frame::parse(frame).unwrap();
            if frame.did == did {
                return frame.data.to_vec();
            }
        }
    }
    panic!("no frame with DID {did}");
}

#[test]
fn all_three_links_carry_the_same_session() {
    let board = pms5005(&[]);
    let mut tcp = board.tcp();
    let mut serial = board.serial();
    let udp = UdpSocket::bind("127.0.0.1:0").unwrap();
    udp.set_read_timeout(Some(PATIENCE)).unwrap();
    udp.connect(board.place("UDP")).unwrap();

    tcp.write_all(&gpio(1)).unwrap();
    assert_eq!(await_frame(&mut tcp, 255), [1]);
    board.until(|state| state["gpio_out"] == 1);
    serial.write_all(&gpio(2)).unwrap();
    assert_eq!(await_frame(&mut serial, 255), [1]);
    board.until(|state| state["gpio_out"] == 2);
    udp.send(&gpio(3)).unwrap();
    board.until(|state| state["gpio_out"] == 3);
    // One frame a datagram.
    let mut buffer = [0; 2000];
    for _ in 0..20 {
        let count = udp.recv(&mut buffer).unwrap();
        assert_eq!(count, usize::from(buffer[5]) + 9);
    }
    assert!(await_frame(&mut tcp, 125).len() == 40 && await_frame(&mut serial, 123).len() == 33);
}

#[test]
fn frames_of_two_clients_that_come_in_pieces_do_not_mix() {
    let board = pms5005(&[]);
    let (mut one, mut two) = (board.tcp(), board.tcp());
    let (frame_one, frame_two) = (gpio(0x11), encoded(wire::Command::Ping));
    for _ in 0..20 {
        one.write_all(&frame_one[..5]).unwrap();
        std::thread::sleep(Duration::from_millis(2));
        two.write_all(&frame_two).unwrap();
        std::thread::sleep(Duration::from_millis(2));
        one.write_all(&frame_one[5..]).unwrap();
    }
    let state = board.until(|state| state["link"]["frames_ok"] == 40);
    assert_eq!(state["link"]["bytes_skipped"], 0);
}

#[test]
fn a_client_that_vanishes_at_any_moment_does_not_stop_the_board() {
    let board = pms5005(&[]);
    let frame = gpio(0x55);
    for cut in 0..frame.len() {
        let mut stream = board.tcp();
        stream.write_all(&frame[..cut]).unwrap();
        drop(stream);
        let mut serial = board.serial();
        serial.write_all(&frame[..cut]).unwrap();
    }
    // One that never reads, for as long as it takes to fill its buffers a little.
    let _deaf = board.tcp();
    let mut inspector = TcpStream::connect(board.place("inspect")).unwrap();
    inspector.write_all(b"{\"get\":").unwrap();
    drop(inspector);
    let mut stream = board.tcp();
    stream.write_all(&gpio(0x66)).unwrap();
    board.until(|state| state["gpio_out"] == 0x66);
    assert_eq!(await_frame(&mut stream, 124).len(), 17);
}

#[test]
fn a_client_that_has_said_all_it_has_to_say_still_hears_the_answer() {
    let board = pms5005(&[]);
    let mut stream = board.tcp();
    stream.write_all(&gpio(0x77)).unwrap();
    stream.shutdown(std::net::Shutdown::Write).unwrap();
    assert_eq!(await_frame(&mut stream, 255), [1]);
    assert_eq!(await_frame(&mut stream, 123).len(), 33);
    drop(stream);
    board.tcp().write_all(&gpio(0x78)).unwrap();
    board.until(|state| state["gpio_out"] == 0x78);
}

#[test]
fn a_client_that_floods_the_line_does_not_keep_the_others_from_it() {
    let board = pms5005(&[]);
    let mut flood = board.tcp();
    let mut reader = flood.try_clone().unwrap();
    let mut other = board.tcp();
    let stop = std::sync::atomic::AtomicBool::new(false);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            let frames = gpio(1).repeat(50);
            flood.set_write_timeout(Some(Duration::from_millis(100))).unwrap();
            while !stop.load(std::sync::atomic::Ordering::Relaxed) {
                let _ = flood.write(&frames);
            }
        });
        scope.spawn(|| {
            let mut buffer = [0; 4096];
            while !stop.load(std::sync::atomic::Ordering::Relaxed) {
                let _ = reader.read(&mut buffer);
            }
        });
        std::thread::sleep(Duration::from_millis(500));
        let start = Instant::now();
        let servo = wire::Command::Move(wire::Move {
            quantity: Quantity::Servo,
            addressing: wire::Addressing::List,
            targets: [Some(2250), None, None, None, None, None],
            periods: 0,
        });
        other.write_all(&encoded(servo)).unwrap();
        board.until(|state| state["servos"][0]["pulse_us"] == 1000.0);
        let waited = start.elapsed();
        stop.store(true, std::sync::atomic::Ordering::Relaxed);
        // A share of the line, not the end of the flood.
        assert!(waited < Duration::from_secs(5), "{waited:?}");
    });
}

#[test]
fn a_status_that_nobody_reads_does_not_hold_up_the_board() {
    // Nobody reads the log of refused frames either: it fills its pipe in no time.
    let mut command = program(&FREE_PORTS[2..]);
    let board = Board::spawn(command.env("RUST_LOG", "warn").stderr(Stdio::piped()));
    let mut stream = board.tcp();
    let unknown = Frame { rid: 1, res: 255, did: 31, data: &[] };
    let refused = unknown.encode(&mut [0; 16]).unwrap().repeat(3000);
    stream.write_all(&refused).unwrap();
    stream.write_all(&gpio(0x99)).unwrap();
    board.until(|state| state["link"]["unknown"] == 3000 && state["gpio_out"] == 0x99);
    let (code, _) = board.signal(15);
    assert_eq!(code, Some(0));
}

#[test]
fn a_host_that_opens_the_serial_device_reads_no_old_news() {
    let board = pms5005(&[]);
    let deaf = board.serial();
    std::thread::sleep(Duration::from_millis(1500));
    drop(deaf);
    std::thread::sleep(Duration::from_millis(200));
    // A frame now says what is true now.
    board.ask(json!({"set": {"gpio_in": 170}}));
    std::thread::sleep(Duration::from_millis(200));
    assert_eq!(await_frame(&mut board.serial(), 124)[16], 170);
}

#[test]
fn the_inspector_overrides_sensors_and_gives_them_back() {
    let board = pms5005(&["--seed", "3"]);
    let ok = json!({"ok": true});
    assert_eq!(
        board.ask(json!({"set": {
            "pot": [10, 20, 30, 40, 50, 60], "motor_current": [1, 2, 3, 4, 5, 6],
            "custom_ad": [1, 2, 3, 4, 5, 6, 7, 8], "human": [1, 2, 3, 4], "tilt": [5, 6],
            "overheat": [7, 8], "temperature": 9, "ir_range": 10, "battery": [11, 12, 13],
            "reference": [14, 15], "sonar_cm": [21, 22, 23, 24, 25, 26],
            "ir_command": [31, 32, 33, 255], "gpio_in": 170,
        }})),
        ok
    );
    // A client that connects when the sensors have been read again sees nothing older.
    std::thread::sleep(Duration::from_millis(200));
    let mut tcp = board.tcp();
    let motors = await_frame(&mut tcp, 123);
    assert_eq!(
        motors[..24],
        [10, 0, 20, 0, 30, 0, 40, 0, 50, 0, 60, 0, 1, 0, 2, 0, 3, 0, 4, 0, 5, 0, 6, 0]
    );
    let custom = await_frame(&mut tcp, 124);
    assert_eq!(custom, [1, 0, 2, 0, 3, 0, 4, 0, 5, 0, 6, 0, 7, 0, 8, 0, 170]);
    let sensors = await_frame(&mut tcp, 125);
    assert_eq!(sensors[..6], [21, 22, 23, 24, 25, 26]);
    assert_eq!(sensors[26..30], [31, 32, 33, 255]);
    assert_eq!(sensors[36..], [14, 0, 15, 0]);

    assert_eq!(board.ask(json!({"set": {"pot": null, "gpio_in": null}})), ok);
    std::thread::sleep(Duration::from_millis(200));
    let mut fresh = board.tcp();
    assert_ne!(await_frame(&mut fresh, 123)[..12], motors[..12]);
    assert_eq!(await_frame(&mut fresh, 124)[16], 0);
}

#[test]
fn a_bad_question_is_answered_with_an_error_that_names_it_and_changes_nothing() {
    let board = pms5005(&[]);
    for (question, names) in [
        (json!({"set": {"pot": [1, 2]}}), "pot"),
        (json!({"set": {"gpio_in": 7, "temperature": 4096}}), "temperature"),
        (json!({"set": {"gpio_in": 7, "bogus": 1}}), "bogus"),
        (json!({"set": {"jam": [1, 0, 0, 0, 0, 0]}}), "jam"),
        (json!({"set": {"sonar_cm": [256, 0, 0, 0, 0, 0]}}), "sonar_cm"),
        (json!({"get": "everything"}), "get"),
        (json!([1]), "get"),
    ] {
        let answer = board.ask(question);
        assert!(answer["error"].as_str().is_some_and(|e| e.contains(names)), "{answer}");
    }
    assert!(board.ask_line("no json").contains("error"));
    let mut tcp = board.tcp();
    assert_eq!(await_frame(&mut tcp, 124)[16], 0, "gpio_in was not set");
}

#[test]
fn the_screen_says_why_a_motor_stands_still() {
    let board = pms5005(&["--line-rate", "0"]);
    let mut tcp = board.tcp();
    let turn = wire::Move {
        quantity: Quantity::Velocity,
        addressing: wire::Addressing::List,
        targets: [Some(2000), None, None, None, None, None],
        periods: 0,
    };
    tcp.write_all(&encoded(wire::Command::Move(turn))).unwrap();
    board.until(|s| s["motors"][0]["enabled"] == true);
    tcp.write_all(&encoded(wire::Command::Run { scope: wire::Scope::All, run: false })).unwrap();
    board.until(|s| s["motors"][0]["reason"] == "suspended");
    std::thread::sleep(Duration::from_millis(1500)); // a status line a second
    let (_, screen) = board.signal(15);
    assert!(screen.contains("; motor 1: suspended"), "{screen}");
}

#[test]
fn the_state_has_every_field_and_a_jam_holds_the_shaft() {
    let board = pms5005(&["--line-rate", "0"]);
    let mut tcp = board.tcp();
    let velocity = |target| {
        encoded(wire::Command::Move(wire::Move {
            quantity: Quantity::Velocity,
            addressing: wire::Addressing::List,
            targets: [Some(target), None, None, None, None, None],
            periods: 0,
        }))
    };
    tcp.write_all(&velocity(2000)).unwrap();
    let state = board.until(|s| s["motors"][0]["velocity"].as_f64().unwrap() > 1000.0);
    assert!(state["motors"][0]["enabled"] == true && state["motors"][1]["enabled"] == false);
    assert!(state["motors"][0]["position"].is_i64());
    assert!((-1.0..=1.0).contains(&state["motors"][0]["duty"].as_f64().unwrap()));
    assert_eq!(state["motors"].as_array().unwrap().len(), 6);
    assert_eq!(state["servos"][5], json!({"enabled": false, "pulse_us": 0.0}));
    assert_eq!(state["lcd"].as_str().unwrap().len(), 2048);
    for counter in [
        "frames_ok",
        "bad_frames",
        "bytes_skipped",
        "acks_sent",
        "refused",
        "unknown",
        "not_for_us",
        "telemetry_sent",
        "telemetry_skipped",
    ] {
        assert!(state["link"][counter].is_u64(), "{counter}");
    }
    assert_eq!(state["motors"][0]["reason"], json!(null));
    board.ask(json!({"set": {"jam": [true, false, false, false, false, false]}}));
    board.until(|s| s["motors"][0]["velocity"] == 0.0 && s["motors"][0]["duty"] != 0.0);
    board.ask(json!({"set": {"motor_current": [4000, 2048, null, null, null, null]}}));
    board.until(|s| s["motors"][0]["reason"] == "limited: too much current");
    let floats = board.until(|s| s["motors"][1]["current_sensor"] == false);
    assert_eq!(floats["motors"][2]["current_sensor"], true);
    assert_eq!(floats["faults"], json!(["current_sensor 1"]));
    board.ask(json!({"set": {"motor_current": null}}));
    // Two seconds after its only frame the host is silent.
    let lost = json!(["link_loss", "current_sensor 1"]);
    let state = board.until(|s| s["faults"] == lost && s["motors"][0]["enabled"] == false);
    assert_eq!(state["link"]["links_lost"], 1);
}

#[test]
fn the_serial_device_has_a_link_that_goes_with_the_board() {
    let link = std::env::temp_dir().join(format!("virtual-board-test-{}", std::process::id()));
    for signal in [1, 2, 3, 15] {
        let board = pms5005(&["--pty", link.to_str().unwrap()]);
        let mut serial = File::options().read(true).write(true).open(&link).unwrap();
        serial.write_all(&gpio(9)).unwrap();
        board.until(|state| state["gpio_out"] == 9);
        let (code, text) = board.signal(signal);
        assert_eq!((code, text.lines().next_back()), (Some(0), Some("bye")));
        assert!(!link.is_symlink());
    }
    // What is not a board's own link is left alone; a dangling one is replaced.
    std::fs::write(&link, "somebody's file").unwrap();
    let output = ends(&["--pty", link.to_str().unwrap()]);
    cannot_run(&output, link.to_str().unwrap());
    assert_eq!(std::fs::read_to_string(&link).unwrap(), "somebody's file");
    std::fs::remove_file(&link).unwrap();
    let first = pms5005(&["--pty", link.to_str().unwrap()]);
    let output = ends(&["--pty", link.to_str().unwrap()]);
    cannot_run(&output, link.to_str().unwrap());
    assert_eq!(std::fs::read_link(&link).unwrap(), std::path::Path::new(first.place("serial")));
    drop(first); // killed: the link dangles
    assert!(link.is_symlink());
    drop(pms5005(&["--pty", link.to_str().unwrap()]));
    std::fs::remove_file(&link).unwrap();
}

fn request(request: Request) -> Vec<u8> {
    encoded(wire::Command::Extension(request))
}

#[test]
fn settings_in_a_file_are_there_at_the_next_start_and_after_a_reboot() {
    let file = std::env::temp_dir().join(format!("settings-{}", std::process::id()));
    let options = ["--settings", file.to_str().unwrap()];
    let board = pms5005(&options);
    let mut stream = board.tcp();
    let mut data = wire::Data::new();
    Assignments::emit(1, 1234, &mut data).unwrap();
    stream.write_all(&request(Request::Set(Assignments::parse(&data).unwrap()))).unwrap();
    assert_eq!(await_frame(&mut stream, 101), [7, 0x80, 0, 0, 0]);
    stream.write_all(&request(Request::Do(Action::Save))).unwrap();
    assert_eq!(await_frame(&mut stream, 101), [7, 0x82, 0, 0, 0]);

    // The file is in use; and the link outlives a reboot.
    cannot_run(&ends(&options), file.to_str().unwrap());
    stream.write_all(&request(Request::Do(Action::Reboot))).unwrap();
    assert_eq!(await_frame(&mut stream, 101), [7, 0x84, 0, 0, 0]);
    board.until(|state| state["link"]["frames_ok"] == 0);
    stream.write_all(&request(Request::Identity)).unwrap();
    assert_eq!(await_frame(&mut stream, 97)[4..], [3, 1], "software, stored");
    drop((stream, board)); // killed

    let board = pms5005(&options);
    let mut stream = board.tcp();
    stream.write_all(&request(Request::Setting(1))).unwrap();
    assert_eq!(await_frame(&mut stream, 96)[4..8], 1234i32.to_le_bytes());
    drop(board);
    std::fs::write(&file, "no settings").unwrap();
    cannot_run(&ends(&options), "49152 bytes");
    std::fs::remove_file(&file).unwrap();
}

#[test]
fn it_ends_after_its_seconds_and_says_nothing_while_nothing_happens() {
    let output = ends(&["--seconds", "2.5"]);
    let text = String::from_utf8(output.stdout).unwrap();
    assert_eq!(output.status.code(), Some(0));
    let lines: Vec<_> = text.lines().filter(|line| line.starts_with("t=")).collect();
    assert!(lines.len() == 1 && lines[0].contains("clients=0"), "{text}");
}

#[test]
fn what_happens_is_said_in_plain_lines_and_a_status_once_a_second_at_the_most() {
    let board = pms5005(&[]);
    let mut stream = board.tcp();
    for n in 0..100 {
        stream.write_all(&gpio(n)).unwrap();
        std::thread::sleep(Duration::from_millis(20));
    }
    // The host is silent for two seconds, and then is there again.
    board.until(|state| state["faults"] == json!(["link_loss"]));
    stream.write_all(&gpio(1)).unwrap();
    board.until(|state| state["faults"] == json!([]));
    let (_, text) = board.signal(15);
    assert!(!text.contains('\x1b'), "{text}");
    let said = |what: &str| text.lines().filter(|line| line.contains(what)).count();
    assert_eq!((said("s fault: link_loss"), said("s no longer: link_loss")), (1, 1), "{text}");
    assert!((3..=6).contains(&said("clients=")), "{text}");
}

#[test]
fn help_begins_with_what_the_program_does_and_the_version_is_its_own() {
    let said = |option| {
        let output = program(&[option]).output().unwrap();
        assert_eq!(output.status.code(), Some(0));
        String::from_utf8(output.stdout).unwrap()
    };
    let help = said("--help");
    assert!(help.starts_with("A simulated motion and sensing controller"), "{help}");
    let help = help.split_whitespace().collect::<Vec<_>>().join(" ");
    for limit in ["1 to 253", "0 to 1000000", "9600 or more", "Exit codes"] {
        assert!(help.contains(limit), "{limit}: {help}");
    }
    assert!(said("--version").starts_with("virtual-board "));
}

#[test]
fn the_page_is_served_unless_nobody_wants_it() {
    let says = |options: &[&str]| {
        let all = [&["--seconds", "0.1", "--tcp", "127.0.0.1:0"], options].concat();
        let output = program(&all).output().unwrap();
        assert_eq!(output.status.code(), Some(0));
        String::from_utf8(output.stdout).unwrap().contains("page http://127.0.0.1:")
    };
    assert!(says(&[]) && says(&["cm5"]) && says(&["pioneer-arm"]));
    assert!(says(&["--headless", "--web", "127.0.0.1:0"]));
    assert!(!says(&["--headless"]) && !says(&["--web", "off"]) && !says(&["ax12-bus"]));
    refused(&program(&["ax12-bus", "--web", "127.0.0.1:0"]).output().unwrap(), "--web");
    refused(&program(&["--web", "nowhere"]).output().unwrap(), "--web nowhere");
}

#[test]
fn what_is_wrong_with_the_command_line_is_named_with_a_tip() {
    for (options, names) in [
        (&["--bogus"][..], "--bogus"),
        (&["--setings", "x"], "'--settings'"),
        (&["cm6"], "[possible values: pms5005, pioneer-arm"),
        (&["--line-rate", "fast"], "--line-rate"),
        (&["--seconds", "-1"], "--seconds -1"),
        (&["--line-rate", "9600"], "19200"),
        (&["--seconds", "nan"], "--seconds"),
        (&["--seconds", "1e300"], "seconds from 0 to 1e9"),
        (&["--inspect", "0.0.0.0:0"], "--inspect 0.0.0.0:0"),
        (&["--inspect", "nowhere"], "--inspect nowhere: expected an address and a port"),
        (&["--pty"], "--pty"),
    ] {
        refused(&ends(options), names);
        refused(&ends(options), "For more information, try '--help'");
    }
    let output = program(&["--tcp", "nowhere"]).output().unwrap();
    refused(&output, "as 127.0.0.1:5005");
}

#[test]
fn what_keeps_it_from_running_is_named_in_one_line() {
    for (options, names) in [
        (&["--scene", "/no/such.toml"][..], "/no/such.toml"),
        (&["--settings", "/no/such/file"], "/no/such/file"),
    ] {
        cannot_run(&ends(options), names);
    }
    let scene = std::env::temp_dir().join(format!("scene-{}.toml", std::process::id()));
    std::fs::write(&scene, "[motor.0]\ngearbox = 3").unwrap();
    cannot_run(&ends(&["--scene", scene.to_str().unwrap()]), "gearbox");
    std::fs::remove_file(&scene).unwrap();
}

#[test]
fn a_port_that_was_asked_for_and_is_in_use_is_an_error_and_a_default_one_is_not() {
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    for option in ["--tcp", "--inspect"] {
        let free = ["--udp", "127.0.0.1:0", option, &address];
        let output = program(&free).output().unwrap();
        cannot_run(&output, &format!("{option} {address}"));
        cannot_run(&output, "port 0 takes a free one");
    }
    // Whoever else has the defaults: two boards cannot both.
    let two = [(); 2].map(|()| {
        let child = program(&["--seconds", "3"]).stdout(Stdio::piped()).spawn();
        std::thread::sleep(Duration::from_millis(500));
        child.unwrap()
    });
    let [_, second] = two.map(|child| child.wait_with_output().unwrap());
    assert_eq!(second.status.code(), Some(0));
    let text = String::from_utf8(second.stdout).unwrap();
    for place in ["127.0.0.1:5005 is in use", "127.0.0.1:10001 is in use"] {
        assert!(text.contains(place), "{text}");
    }
}
