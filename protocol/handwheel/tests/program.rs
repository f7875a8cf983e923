//! The program itself, as a shell starts it; what its commands do is tested against the virtual board
//! (`hal-mock/tests/handwheel`).

use std::net::TcpListener;
use std::process::{Command, Output};

fn handwheel(words: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_handwheel")).args(words).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

#[test]
fn help_lists_the_commands_and_says_once_how_channels_are_counted() {
    let help = handwheel(&["--help"]);
    assert_eq!(help.status.code(), Some(0));
    let help = text(&help.stdout);
    for command in [
        "info", "watch", "pwm", "velocity", "position", "servo", "gpio", "lcd", "stop", "faults",
        "get", "set", "save", "reset", "backup", "restore", "diff", "zero", "step", "dfu",
    ] {
        assert!(help.contains(&format!("\n  {command} ")), "{command}: {help}");
    }
    assert_eq!(help.matches("1 to 6").count(), 1, "{help}");
}

#[test]
fn a_failure_is_one_line_and_a_status() {
    // A port that was free a moment ago.
    let free = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let failed = handwheel(&["--link", &format!("tcp:{free}"), "info"]);
    assert_eq!((failed.status.code(), failed.stdout.len()), (Some(1), 0));
    let error = text(&failed.stderr);
    assert!(error.lines().count() == 1 && error.contains("nobody listens there"), "{error}");
    assert_eq!(handwheel(&["fly"]).status.code(), Some(2));
}

/// A board of few words: it pings, acknowledges, and remembers what it was sent.
#[cfg(unix)]
fn board() -> (String, std::sync::mpsc::Receiver<(u8, Vec<u8>)>) {
    use std::io::{Read, Write};
    use std::time::Duration;

    use protocol::pms5005::{ACK, Frame, PING, RES_NO_ACK, Receiver};

    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let link = format!("tcp:{}", listener.local_addr().unwrap());
    let (tell, told) = std::sync::mpsc::channel();
    std::thread::spawn(move || {
        let (mut host, _) = listener.accept().unwrap();
        host.set_read_timeout(Some(Duration::from_millis(50))).unwrap();
        let (mut receiver, mut buffer) = (Receiver::new(), [0; 300]);
        while host.write_all(PING.encode(&mut [0; 20]).unwrap()).is_ok() {
            let count = match host.read(&mut buffer) {
                Ok(0) => return,
                Ok(count) => count,
                Err(_) => continue,
            };
            let mut bytes = &buffer[..count];
            while let Some(frame) = receiver.receive(&mut bytes) {
                let frame = Frame::parse(frame).unwrap();
                if frame.res != RES_NO_ACK && host.write_all(&ACK).is_err() {
                    return;
                }
                let _ = tell.send((frame.did, frame.data.to_vec()));
            }
        }
    });
    (link, told)
}

#[cfg(unix)]
#[test]
fn a_ctrl_c_of_the_shell_stops_the_motor() {
    use std::process::Stdio;
    use std::time::Duration;

    use protocol::pms5005::did;

    let (link, told) = board();
    let program = Command::new(env!("CARGO_BIN_EXE_handwheel"))
        .args(["--link", &link, "velocity", "1", "-400"])
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let next = || told.recv_timeout(Duration::from_secs(20)).unwrap();
    // Who asks only reads; then it drives: -400 is 70 FE.
    while next() != (did::VELOCITY, vec![0, 0x70, 0xFE]) {}
    // A sign of life, as long as it drives.
    assert_eq!(next(), (did::SETUP, vec![0]));
    let pid = program.id().to_string();
    Command::new("kill").args(["-INT", &pid]).status().unwrap();
    // The neutral PWM, and its bridge off.
    while next() != (did::PWM, vec![0, 0x00, 0x40]) {}
    while next() != (did::RUN, vec![0, 0]) {}
    let output = program.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0));
    assert!(text(&output.stdout).contains("motor 1 is stopped"));
    assert!(told.recv_timeout(Duration::from_secs(1)).is_err(), "it says nothing more");
}

#[cfg(unix)]
#[test]
fn a_stop_is_the_first_thing_that_is_said() {
    use protocol::pms5005::did;

    let (link, told) = board();
    let stop = handwheel(&["--link", &link, "--json", "stop"]);
    assert_eq!(stop.status.code(), Some(0), "{stop:?}");
    let said: Vec<_> = told.iter().collect();
    assert_eq!(said[0], (did::RUN, vec![0]));
    assert_eq!(said[1], (did::PWM_ALL, [0x00, 0x40].repeat(6)));
}
