//! `auto`: listens, writes to nobody who has not spoken, takes the only board, and names what it found.

use std::os::fd::OwnedFd;
use std::time::Duration;

use handwheel::auto::find_among;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};

use crate::program::Board;

fn board() -> Board {
    Board::start(&["--udp", "127.0.0.1:0"])
}

/// A serial device behind which nobody speaks, or only this.
struct Mute {
    master: OwnedFd,
    device: String,
}

impl Mute {
    fn new(says: &[u8]) -> Self {
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
        grantpt(&master).unwrap();
        unlockpt(&master).unwrap();
        // What it says is not to come back as an echo.
        let mut attributes = tcgetattr(&master).unwrap();
        attributes.make_raw();
        tcsetattr(&master, OptionalActions::Now, &attributes).unwrap();
        let device = ptsname(&master, Vec::new()).unwrap().to_str().unwrap().to_owned();
        rustix::io::write(&master, says).unwrap();
        Self { master, device }
    }

    fn was_written_to(&self) -> bool {
        let now = Timespec { tv_sec: 0, tv_nsec: 0 };
        let mut fds = [PollFd::new(&self.master, PollFlags::IN)];
        poll(&mut fds, Some(&now)).unwrap();
        fds[0].revents().contains(PollFlags::IN)
    }
}

const NOWHERE: &str = "127.0.0.1:1";

#[test]
fn the_only_board_is_taken_and_a_mute_port_and_a_printer_are_not_written_to() {
    let board = board();
    let (mute, printer) = (Mute::new(b""), Mute::new(b"echo:Marlin 2.1\r\nok T:21.0 /0.0\r\n"));
    let ports = [mute.device.clone(), board.place("serial").to_owned(), printer.device.clone()];
    let mut client = find_among(&ports, NOWHERE).unwrap();
    assert_eq!(client.link().to_string(), format!("serial:{}@115200", board.place("serial")));
    assert!(client.state().unwrap().is_some());
    assert!(!mute.was_written_to() && !printer.was_written_to());
}

#[test]
fn without_a_serial_board_the_virtual_boards_address_is_tried() {
    let board = board();
    let mute = Mute::new(b"");
    let client = find_among(std::slice::from_ref(&mute.device), board.place("TCP")).unwrap();
    assert_eq!(client.link().to_string(), format!("tcp:{}", board.place("TCP")));
    assert!(!mute.was_written_to());
}

#[test]
fn where_there_is_none_what_was_found_is_named() {
    let mute = Mute::new(b"");
    let printer = Mute::new(b"ok T:21.0 /0.0 @:0\r\n");
    let ports = [mute.device.clone(), printer.device.clone()];
    let error = find_among(&ports, NOWHERE).err().unwrap().to_string();
    for part in [
        format!("{} (silent)", mute.device),
        format!("{} (no language of ours)", printer.device),
        format!("tcp:{NOWHERE} (nobody listens)"),
        "--link".into(),
    ] {
        assert!(error.contains(&part), "{part}: {error}");
    }
}

#[test]
fn of_two_boards_none_is_taken() {
    let (one, other) = (board(), board());
    std::thread::sleep(Duration::from_millis(100));
    let ports = [one.place("serial").to_owned(), other.place("serial").to_owned()];
    let error = find_among(&ports, NOWHERE).err().unwrap().to_string();
    assert!(error.contains("2 boards are there") && error.contains(&ports[1]), "{error}");
}
