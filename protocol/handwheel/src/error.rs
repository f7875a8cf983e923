//! What can go wrong between a host and a board: each is one line that names the remedy.

use protocol::extension::Verdict;

use crate::link::Link;
use crate::session::{Failure, Personality};
use crate::words;

/// Why something could not be done. Its text is one line, for people.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The link is not written as one.
    #[error(
        "{0}: not a link; write serial:/dev/ttyUSB0@115200 (on Windows serial:COM3), tcp:127.0.0.1:5005, udp:127.0.0.1:10001 or auto"
    )]
    NoLink(String),
    /// It cannot be opened; the text says why, and what to do.
    #[error("{0}")]
    CannotOpen(String),
    /// The port belongs to another program; the text names it.
    #[error("{0}")]
    Busy(String),
    /// Nothing that we know was heard.
    #[error("{0}")]
    NoBoard(String),
    /// The link ended.
    #[error("{0}: the link is gone ({1}); see that the board has power and is connected")]
    Gone(String, std::io::Error),
    /// The board is there, and does not answer this.
    #[error(
        "the board does not answer when asked for {0}; its firmware may know no such request, or the line is bad: try `handwheel info`"
    )]
    NoAnswer(&'static str),
    /// The board refuses.
    #[error("the board refuses: {}{}", words::verdict(*.verdict), about(.setting))]
    Refused {
        /// Why.
        verdict: Verdict,
        /// The setting that it is about.
        setting: Option<String>,
    },
    /// This kind of board has no such thing.
    #[error("{0} has no {1}{2}")]
    NotCarried(Personality, &'static str, &'static str),
    /// No setting has this name.
    #[error("no setting is called \"{name}\"{}", did_you_mean(.nearest))]
    UnknownName {
        /// As asked.
        name: String,
        /// The nearest that there is.
        nearest: Option<String>,
    },
    /// A value is out of its range.
    #[error("{name}: {value} is out of range, {low} to {high}")]
    OutOfRange {
        /// The setting, or what else has a range.
        name: String,
        /// As asked.
        value: i64,
        /// The least.
        low: i32,
        /// The most.
        high: i32,
    },
    /// What was driven does not run any more; the text says why.
    #[error("{0}")]
    Stopped(String),
    /// A stop was sent, and what came of it is not known.
    #[error("the stop was sent and is NOT confirmed; cut the motors' supply: {0}")]
    NotConfirmed(Box<Error>),
    /// What is no value at all; the text says how one is written.
    #[error("{0}")]
    NoValue(String),
    /// Settings that could not all be set; the text says why, and which are in force now.
    #[error("{0}")]
    NotSet(String),
    /// A file that cannot be used; the text names it, and why.
    #[error("{0}")]
    File(String),
    /// Whoever read the answer has gone, as `head` does when it has enough.
    #[error("nobody reads the answer any more")]
    NobodyReads,
}

impl Error {
    /// What an exchange's failure means for what was asked.
    pub(crate) fn of(failure: Failure, personality: Personality, what: &'static str) -> Self {
        match failure {
            Failure::NoAnswer => Self::NoAnswer(what),
            Failure::Refused(verdict, number) => {
                Self::Refused { verdict, setting: (number != 0).then(|| words::setting(number)) }
            }
            Failure::NotCarried => Self::NotCarried(personality, what, ""),
        }
    }

    /// Nobody that we know was heard on a link, on which so many bytes came.
    pub(crate) fn nobody(link: &Link, received: u64) -> Self {
        Self::NoBoard(match received {
            0 => format!(
                "{link}: open, and nobody speaks; see that the board has power, and TX and RX are not swapped"
            ),
            bytes => format!(
                "{link}: {bytes} bytes came and none is of a board we know; see the baud rate, and that this is the right device"
            ),
        })
    }

    /// Of a stop that was sent: what keeps its confirmation from coming leaves the motors' state unknown.
    pub(crate) fn of_a_stop(self) -> Self {
        match self {
            Self::NoAnswer(_) | Self::NoBoard(_) | Self::Gone(..) => {
                Self::NotConfirmed(Box::new(self))
            }
            other => other,
        }
    }
}

fn about(setting: &Option<String>) -> String {
    setting.as_ref().map_or(String::new(), |name| format!(" ({name})"))
}

fn did_you_mean(nearest: &Option<String>) -> String {
    match nearest {
        Some(nearest) => format!("; did you mean \"{nearest}\"?"),
        None => "; `handwheel get` lists them".into(),
    }
}
