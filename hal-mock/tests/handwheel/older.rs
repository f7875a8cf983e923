//! Older firmware gives what it can: an original without the extension, and the extension's version 1, which
//! has no machine state. Each is the virtual board behind a filter that takes from it what the old one has not.

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::thread;

use protocol::extension::{Answer, Outcome, Verdict, did};
use protocol::pms5005::{Frame, Receiver, encode_answer};
use serde_json::json;

use crate::commands::directory;
use crate::handwheel;
use crate::program::Board;

/// What a board's frame becomes; nothing if the old board has none.
type Filter = fn(&Frame<'_>) -> Option<Vec<u8>>;

fn whole(frame: &Frame<'_>) -> Option<Vec<u8>> {
    Some(frame.encode(&mut [0; 300]).ok()?.to_vec())
}

fn original(frame: &Frame<'_>) -> Option<Vec<u8>> {
    if (did::SETTING..=did::LAST).contains(&frame.did) { None } else { whole(frame) }
}

fn version_1(frame: &Frame<'_>) -> Option<Vec<u8>> {
    let answer = match Answer::parse(frame.did, frame.data) {
        Some(Answer::Identity(mut identity)) => {
            identity.extension = 1;
            Answer::Identity(identity)
        }
        Some(Answer::State(_) | Answer::Refusals(_)) => {
            Answer::Outcome(Outcome::of(frame.did, &[], Verdict::Unknown))
        }
        _ => return whole(frame),
    };
    Some(encode_answer(&answer, &mut [0; 300]).ok()?.to_vec())
}

/// The link to the board behind a filter.
fn behind(board: &Board, filter: Filter) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let link = format!("tcp:{}", listener.local_addr().unwrap());
    let address = board.place("TCP").to_owned();
    thread::spawn(move || {
        while let Ok((host, _)) = listener.accept() {
            let board = TcpStream::connect(&address).unwrap();
            let (mut from_host, mut to_board) =
                (host.try_clone().unwrap(), board.try_clone().unwrap());
            thread::spawn(move || {
                let _ = std::io::copy(&mut from_host, &mut to_board);
                let _ = to_board.shutdown(std::net::Shutdown::Both);
            });
            thread::spawn(move || pass(board, host, filter));
        }
    });
    link
}

fn pass(mut board: TcpStream, mut host: TcpStream, filter: Filter) {
    let (mut receiver, mut buffer) = (Receiver::new(), [0; 500]);
    while let Ok(count @ 1..) = board.read(&mut buffer) {
        let mut bytes = &buffer[..count];
        while let Some(frame) = receiver.receive(&mut bytes) {
            let passed = Frame::parse(frame).and_then(|frame| filter(&frame));
            if passed.is_some_and(|bytes| host.write_all(&bytes).is_err()) {
                return;
            }
        }
    }
}

fn board() -> Board {
    Board::start(&["--udp", "127.0.0.1:0", "--line-rate", "0"])
}

#[test]
fn an_original_is_driven_stopped_and_watched() {
    let board = board();
    let link = behind(&board, original);
    let info = handwheel(&link, "info");
    assert!(info.status == 0 && info.out.contains("without the extension"), "{info:?}");
    let turned = handwheel(&link, "--json velocity 1 4000 --for 500ms").json();
    assert!(turned["stands"] == true && turned["turned"].as_i64().unwrap() > 500, "{turned}");
    let joint = handwheel(&link, "velocity 3 300 --for 200ms");
    assert!(
        joint.status == 0 && joint.out.contains("nothing tells whether it stands"),
        "{joint:?}"
    );
    let stop = handwheel(&link, "--json stop");
    assert_eq!((stop.status, &stop.json()["confirmed"]), (0, &json!(true)));
    let watch = handwheel(&link, "watch --for 300ms");
    assert!(watch.status == 0 && watch.out.contains("encoder 1 at"), "{watch:?}");
    handwheel(&link, "get").failed("knows no extension");
    handwheel(&link, "faults").failed("a PMS5005 has no faults on record");
    handwheel(&link, "step 1 velocity 4000").failed("no machine state");
}

#[test]
fn version_1_of_the_extension_has_all_but_the_machine_state() {
    let board = board();
    let link = behind(&board, version_1);
    let info = handwheel(&link, "--json info").json();
    assert_eq!((&info["extension"], &info["faults"]), (&json!(1), &json!([])));
    assert_eq!(handwheel(&link, "velocity 1 4000 --for 300ms").status, 0);
    assert_eq!(handwheel(&link, "stop").status, 0);
    assert_eq!(handwheel(&link, "set telemetry period 40").status, 0);
    let files = directory("version-1");
    let file = files.join("all").display().to_string();
    for words in ["backup", "restore", "diff"] {
        let said = handwheel(&link, &format!("{words} {file}"));
        assert_eq!(said.status, 0, "{words}: {said:?}");
    }
    std::fs::remove_dir_all(files).unwrap();
    handwheel(&link, "step 1 velocity 4000").failed("no machine state");
    let check = handwheel(&link, "check 1");
    assert!(check.status == 1 && check.err.contains("has no recorder"), "{check:?}");
    assert!(handwheel(&link, "watch --for 300ms").out.contains("telemetry only"));
}
