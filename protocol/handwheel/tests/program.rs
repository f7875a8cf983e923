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
