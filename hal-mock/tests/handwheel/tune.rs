//! `check` and `tune` as a person uses them: what is said before, who is asked, what is found, how it ends.

use std::io::Cursor;
use std::sync::atomic::Ordering;
use std::thread;
use std::time::Duration;

use handwheel::cli::{Interrupt, Surroundings, run};
use serde_json::json;

use crate::commands::directory;
use crate::program::Board;
use crate::{Said, handwheel, interruptible};

fn start(options: &[&str]) -> (Board, String) {
    let board = Board::start(&[&["--udp", "127.0.0.1:0", "--line-rate", "0"], options].concat());
    let link = format!("tcp:{}", board.place("TCP"));
    (board, link)
}

/// The same at a keyboard on which this is typed.
fn typed(link: &str, words: &str, keys: &str) -> Said {
    let (mut out, mut err, mut keyboard) = (Vec::new(), Vec::new(), Cursor::new(keys.to_owned()));
    let words = ["handwheel", "--link", link].into_iter().chain(words.split(' '));
    let mut surroundings = Surroundings {
        out: &mut out,
        err: &mut err,
        is_terminal: true,
        keyboard: Some(&mut keyboard),
        interrupt: Interrupt::default(),
    };
    let status = run(words, &mut surroundings);
    let text = |bytes| String::from_utf8(bytes).unwrap();
    Said { status, out: text(out), err: text(err) }
}

#[test]
fn a_check_says_what_it_will_do_and_asks_at_a_terminal() {
    let (board, link) = start(&[]);
    for (words, keys) in [("check 1", "n\n"), ("check 1", ""), ("tune 3", "no\n")] {
        let said = typed(&link, words, keys);
        assert_eq!(said.status, 1, "{said:?}");
        assert!(said.out.contains("at most 50 % of full drive"), "{said:?}");
        assert!(said.err.contains("Is it free to move?") && said.err.contains("nothing was done"));
        assert_eq!(board.state()["motors"][0]["position"], 0.0, "nothing has turned");
    }
    let said = typed(&link, "check 1 --highest-duty 40%", "y\n");
    assert!(said.status == 0 && said.out.contains("at most 40 %"), "{said:?}");
    assert!(said.out.contains("counts the right way"), "{said:?}");
    let said = typed(&link, "check 1 --yes", "");
    assert!(said.status == 0 && !said.err.contains("free to move"), "{said:?}");
}

#[test]
fn swapped_wires_are_named_and_turned_round_if_that_is_wanted() {
    let files = directory("swapped");
    let scene = files.join("scene.toml");
    std::fs::write(&scene, "[[motor]]\nreversed = true\n").unwrap();
    let (_board, link) = start(&["--scene", &scene.display().to_string()]);
    for words in ["check 1", "tune 1"] {
        let said = handwheel(&link, words);
        assert!(said.status == 1 && said.err.contains("--set-polarity"), "{said:?}");
    }
    let checked = handwheel(&link, "--json check 1 --set-polarity").json();
    assert_eq!((&checked["turned_round"], &checked["has_current"]), (&json!(true), &json!(true)));
    assert_eq!(handwheel(&link, "--json get polarity 1").json()["settings"][0]["value"], 1);
    std::fs::remove_dir_all(files).unwrap();
}

#[test]
fn a_tuning_is_applied_only_if_that_is_wanted_and_draws_its_step() {
    let (_board, link) = start(&[]);
    let kp = || handwheel(&link, "--json get velocity Kp 1").json()["settings"][0]["value"].clone();
    let tuned = handwheel(&link, "--json tune 1").json();
    assert!(tuned["fit_percent"].as_f64().unwrap() > 95.0, "{tuned}");
    assert_eq!((&tuned["applied"], kp()), (&json!(false), json!(50)));
    let files = directory("tuned");
    let picture = files.join("step.svg");
    let said = handwheel(&link, &format!("tune 1 --apply --svg {}", picture.display()));
    assert!(said.status == 0 && said.out.contains("confirmed by a step"), "{said:?}");
    assert!(said.err.contains("finds out what it is"), "{said:?}");
    assert!(kp() != json!(50) && std::fs::read_to_string(&picture).unwrap().contains("<polyline"));
    let step = handwheel(&link, "--json step 1 velocity 4000 --for 1s").json();
    assert!(step["overshoot_percent"].as_f64().unwrap() < 10.0, "{step}");
    assert_eq!(step["samples_ms_value_duty"].as_array().unwrap().len(), 1000, "the recorder's");
    std::fs::remove_dir_all(files).unwrap();
}

#[test]
fn ctrl_c_ends_a_tuning_in_good_order() {
    let (board, link) = start(&[]);
    let interrupt = Interrupt::default();
    let (ctrl_c, at) = (interrupt.clone(), link.clone());
    let tuner = thread::spawn(move || interruptible(&at, "tune 1 --apply", interrupt));
    board.until(|state| state["motors"][0]["velocity"].as_f64().unwrap() > 2000.0);
    assert!(!ctrl_c.ends_program.load(Ordering::Relaxed));
    ctrl_c.wanted.store(true, Ordering::Relaxed);
    let said = tuner.join().unwrap();
    assert!(said.status == 1 && said.err.contains("stopped by Ctrl-C"), "{said:?}");
    board.until(|state| state["motors"][0]["enabled"] == false);
    thread::sleep(Duration::from_millis(100));
    let highest = handwheel(&link, "--json get highest duty 1").json();
    assert_eq!(highest["settings"][0]["value"], 16_384, "as it was");
}
