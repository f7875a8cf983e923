//! The host tool against the virtual board: every command, on each of the three links; and everything that can
//! be wrong with a link, a board or a file.
#![cfg(unix)]

mod auto;
mod commands;
mod older;
mod others;
#[path = "../program/mod.rs"]
mod program;
mod review_client;
mod tune;
mod web;
mod wrong;

use handwheel::cli::{Interrupt, Surroundings, run};
use serde_json::Value;

/// What a command said, and how it ended.
#[derive(Debug)]
struct Said {
    status: u8,
    out: String,
    err: String,
}

impl Said {
    /// Its answer, which must be one object.
    fn json(&self) -> Value {
        assert_eq!(self.out.lines().count(), 1, "{self:?}");
        serde_json::from_str(&self.out).unwrap()
    }

    /// It failed with one line that holds these words, and told nothing else.
    #[track_caller]
    fn failed(&self, words: &str) {
        assert_eq!((self.status, self.out.as_str()), (1, ""), "{self:?}");
        assert!(self.err.contains(words), "{words}: {self:?}");
        assert_eq!(self.err.lines().count(), 1, "{self:?}");
    }
}

/// Runs a command line, as a shell would, on a link. Words are split at spaces.
fn handwheel(link: &str, words: &str) -> Said {
    interruptible(link, words, Interrupt::default())
}

/// The same with a Ctrl-C that the caller has.
fn interruptible(link: &str, words: &str, interrupt: Interrupt) -> Said {
    let (mut out, mut err) = (Vec::new(), Vec::new());
    let words = ["handwheel", "--link", link].into_iter().chain(words.split(' '));
    let mut surroundings = Surroundings {
        out: &mut out,
        err: &mut err,
        is_terminal: false,
        keyboard: None,
        interrupt,
    };
    let status = run(words, &mut surroundings);
    let text = |bytes| String::from_utf8(bytes).unwrap();
    Said { status, out: text(out), err: text(err) }
}
