//! What can be wrong with a link, a board, or a file: one clear line with the remedy, and nothing half done.

use std::io::{Read, Write};
use std::net::{TcpListener, UdpSocket};
use std::process::{Command, Stdio};
use std::thread;
use std::time::Duration;

use serde_json::json;

use crate::commands::directory;
use crate::handwheel;
use crate::program::Board;

fn board() -> Board {
    Board::start(&["--udp", "127.0.0.1:0", "--line-rate", "0"])
}

fn tcp(board: &Board) -> String {
    format!("tcp:{}", board.place("TCP"))
}

#[test]
fn a_link_that_cannot_be_opened_is_said_so_with_the_remedy() {
    // A port that was free a moment ago.
    let free = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    handwheel(&format!("tcp:{free}"), "info").failed("nobody listens there");
    let free = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    handwheel(&format!("udp:{free}"), "info").failed("nobody listens there");
    handwheel("serial:/dev/no-such-port", "info").failed("no such device");
    handwheel("serial:/dev/null", "info").failed("see that it is a serial device");
    handwheel("/dev/ttyUSB0", "info").failed("write serial:/dev/ttyUSB0@115200");
    let said = handwheel("tcp:nowhere", "--json info");
    assert_eq!((said.status, said.err.as_str()), (1, ""));
    assert!(said.json()["error"].as_str().unwrap().contains("not a link"));
}

#[test]
fn a_port_that_somebody_has_is_refused_and_he_is_named() {
    let board = board();
    let device = board.place("serial");
    let script = format!("exec 3<>{device}; echo; exec sleep 60");
    let mut holder =
        Command::new("sh").args(["-c", &script]).stdout(Stdio::piped()).spawn().unwrap();
    holder.stdout.take().unwrap().read_exact(&mut [0]).unwrap();
    let said = handwheel(&format!("serial:{device}"), "stop");
    holder.kill().unwrap();
    said.failed(&format!("(process {}) has it; end that program first", holder.id()));
    holder.wait().unwrap();
    // One that locks it, and is this very program: nobody to be named.
    let _locked = serialport::new(device, 115_200).open().unwrap();
    handwheel(&format!("serial:{device}"), "info").failed("another program has it");
}

/// A server whose clients get these bytes, again and again.
fn server(bytes: &'static [u8]) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let link = format!("tcp:{}", listener.local_addr().unwrap());
    thread::spawn(move || {
        while let Ok((mut client, _)) = listener.accept() {
            while client.write_all(bytes).is_ok() {
                thread::sleep(Duration::from_millis(10));
            }
        }
    });
    link
}

#[test]
fn what_is_no_board_is_said_so() {
    handwheel(&server(b""), "info").failed("nobody speaks");
    handwheel(&server(b"echo:Marlin 2.1 ok T:21.0\r\n"), "info")
        .failed("none is of a board we know");
    handwheel(&server(&[0xFF, 0x5E, 0x02, 0xFA, 0xFB, 0x03]), "stop").failed("none is of a board");
}

#[test]
fn a_board_that_goes_in_the_middle_of_an_answer_is_gone() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let link = format!("tcp:{}", listener.local_addr().unwrap());
    let board = board();
    let mut upstream = board.tcp();
    let server = thread::spawn(move || {
        let (mut client, _) = listener.accept().unwrap();
        let mut buffer = [0; 100];
        let count = upstream.read(&mut buffer).unwrap();
        client.write_all(&buffer[..count]).unwrap();
        client.read_exact(&mut [0]).ok();
        client.write_all(&[0x5E, 0x02, 0, 255, 97]).ok();
    });
    handwheel(&link, "info").failed("the link is gone");
    server.join().unwrap();
}

#[test]
fn a_board_that_dies_while_it_is_driven_is_gone() {
    for udp in [false, true] {
        let mut board = board();
        let link = match udp {
            false => tcp(&board),
            true => format!("udp:{}", board.place("UDP")),
        };
        let driver = thread::spawn(move || handwheel(&link, "velocity 1 4000"));
        board.until(|state| state["motors"][0]["enabled"] == true);
        board.kill(9);
        let said = driver.join().unwrap();
        assert_eq!(said.status, 1, "{said:?}");
        assert!(said.err.contains("the link is gone") && said.err.lines().count() == 1, "{said:?}");
    }
}

#[test]
fn a_restore_is_checked_whole_before_anything_is_sent() {
    let board = board();
    let link = tcp(&board);
    let files = directory("wrong-files");
    let file = |name: &str| files.join(name).display().to_string();
    assert_eq!(handwheel(&link, &format!("backup {}", file("good"))).status, 0);
    let good = std::fs::read_to_string(file("good"))
        .unwrap()
        .replace("telemetry period\" = 50", "telemetry period\" = 20");
    let all = || handwheel(&link, "--json get").json();
    let before = all();
    let cases = [
        (good.replace("\"Ki reading\"", "\"Ki readin\""), "did you mean \"Ki reading\""),
        (good.replace("\"Ki reading\" = 2", "\"Ki reading\" = 3"), "3 is out of range, 0 to 2"),
        (good.replace("format = 1", "format = 9"), "another handwheel"),
        (good.replace("\"pms5005\"", "\"pioneer-arm\""), "a backup of a pioneer-arm"),
        (good.clone() + "\"pid of the future\" = 1\n", "no setting is called"),
        (good.replace("[settings]", "settings]"), "no TOML"),
        // Only the board knows what contradicts what: it takes none of such a request.
        (good.replace("\"soft limit low 1\" = 0", "\"soft limit low 1\" = 9"), "contradicts"),
    ];
    for (text, says) in cases {
        std::fs::write(file("bad"), text).unwrap();
        handwheel(&link, &format!("restore {}", file("bad"))).failed(says);
        assert_eq!(all(), before, "{says}");
    }
    handwheel(&link, &format!("restore {}", file("none"))).failed("there is no such file");
    std::fs::write(file("good"), good).unwrap();
    assert_eq!(handwheel(&link, "servo 1 1500us").status, 0);
    handwheel(&link, &format!("restore {}", file("good"))).failed("`handwheel stop` first");
    assert_eq!(all(), before);
    assert_eq!(handwheel(&link, "stop").status, 0);
    assert_eq!(handwheel(&link, &format!("restore {}", file("good"))).status, 0);
    assert_eq!(handwheel(&link, "--json get telemetry period").json()["settings"][0]["value"], 20);
    std::fs::remove_dir_all(files).unwrap();
}

#[test]
fn a_later_request_that_is_refused_undoes_those_before() {
    let board = board();
    let link = tcp(&board);
    let files = directory("undo");
    let file = files.join("all").display().to_string();
    assert_eq!(handwheel(&link, &format!("backup {file}")).status, 0);
    let mut text = std::fs::read_to_string(&file).unwrap();
    // Sixty differ: two requests. The last contradicts: channel 6 has no encoder.
    for number in 1..=6 {
        for name in [
            "position Kp",
            "position Kd",
            "velocity Kp",
            "velocity Kd",
            "slew time",
            "acceleration",
        ] {
            let line = |value: i32| format!("\"{name} {number}\" = {value}\n");
            for old in [50, 5, 0] {
                text = text.replace(&line(old), &line(7));
            }
        }
    }
    text = text.replace("\"sensor 6\" = 0", "\"sensor 6\" = 3");
    std::fs::write(&file, text).unwrap();
    let before = handwheel(&link, "--json get").json();
    handwheel(&link, &format!("restore {file}")).failed("contradicts");
    assert_eq!(handwheel(&link, "--json get").json(), before);
    std::fs::remove_dir_all(files).unwrap();
}

#[test]
fn names_and_values_that_are_none_are_answered_with_what_is() {
    let board = board();
    let link = tcp(&board);
    handwheel(&link, "get telemetri period").failed("did you mean \"telemetry period\"");
    handwheel(&link, "set soft limt low 1 5").failed("did you mean \"soft limit low 1\"");
    handwheel(&link, "set telemetry period 0").failed("out of range, 1 to 60000");
    handwheel(&link, "servo 1 100us").failed("223 to 3111");
    handwheel(&link, "zero 3").failed("refuses");
    handwheel(&link, "lcd /no/such/file.png").failed("No such file");
    for (words, says) in [
        ("velocity 7 1", "they are 1 to 6"),
        ("velocity 0 1", "they are 1 to 6"),
        ("velocity 1 40000", "40000"),
        ("pwm 1 50", "50%"),
        ("pwm 1 -101%", "-100% to 100%"),
        ("velocity 1 5 --for 2", "2s or 500ms"),
        ("velocty 1 5", "velocity"),
        ("gpio 256", "0 to 255"),
    ] {
        let said = handwheel(&link, words);
        assert_eq!((said.status, said.out.as_str()), (2, ""), "{words}: {said:?}");
        assert!(said.err.contains(says), "{words}: {said:?}");
    }
    let state = board.state();
    assert_eq!((&state["link"]["links_lost"], &state["gpio_out"]), (&json!(0), &json!(0)));
}

#[test]
fn a_command_that_the_board_refuses_fails_and_says_why() {
    let board = board();
    let link = tcp(&board);
    let said = handwheel(&link, "position 3 5000 --for 5s");
    assert!(said.status == 1 && said.err.contains("beyond the sensor's scale"), "{said:?}");
    assert_eq!(handwheel(&link, "set method 1 1").status, 0);
    let said = handwheel(&link, "velocity 1 4000 --for 5s");
    assert!(said.status == 1 && said.err.contains("\"method\" is set to another"), "{said:?}");
}
