//! The window onto the simulated truth: one JSON object a line each way, loopback only.
//!
//! `{"get":"state"}` answers the state; `{"set":{...}}` changes the simulated world and answers
//! `{"ok":true}`, or `{"error":"..."}` with nothing changed. The board comes first: one question of
//! all clients' is answered a turn, and one of a client that has read its last answer.

use hal_mock::machine::{Machine, ask};
use rustix::fd::BorrowedFd;
use serde_json::{Value, json};

use crate::door::{Address, Door, Guest, Said};
use crate::links::Links;

/// The longest question.
const LONGEST_LINE: usize = 1 << 16;

/// The window.
pub struct Inspector {
    door: Door,
    clients: Vec<Client>,
    /// The client that is asked first.
    turn: usize,
}

struct Client {
    guest: Guest,
    question: Vec<u8>,
    answer: Vec<u8>,
    /// It has asked all it has to ask.
    has_ended: bool,
}

impl AsRef<Guest> for Client {
    fn as_ref(&self) -> &Guest {
        &self.guest
    }
}

impl Inspector {
    /// Opens the window, or says in one line why not.
    pub fn open(address: &str) -> Result<Self, String> {
        let address = Address::new("--inspect", Some(address), address);
        Ok(Self { door: Door::open("inspector's", address)?, clients: Vec::new(), turn: 0 })
    }

    /// Where it is, for the user.
    pub fn place(&self) -> String {
        format!("inspect {}", self.door.place())
    }

    /// What can bring questions, to wait for.
    pub fn watch<'a>(&'a self, fds: &mut Vec<BorrowedFd<'a>>) {
        fds.push(self.door.watch());
        let reading = self.clients.iter().filter(|client| client.answer.is_empty());
        fds.extend(reading.filter_map(|client| client.guest.watch()));
    }

    /// Answers a question, without waiting for anybody.
    pub fn serve(&mut self, machine: &mut dyn Machine, links: &Links) {
        self.door.admit(&mut self.clients, |guest| Client {
            guest,
            question: Vec::new(),
            answer: Vec::new(),
            has_ended: false,
        });
        self.clients.retain_mut(Client::listen);
        let count = self.clients.len();
        for place in (0..count).map(|k| (self.turn + k) % count) {
            let client = &mut self.clients[place];
            if let Some(question) = client.next_question() {
                client.answer = answer(&question, machine, links).into_bytes();
                client.answer.push(b'\n');
                self.turn = place + 1;
                break;
            }
        }
    }
}

impl Client {
    /// Hands over the last answer, and then hears the next question. Whether the client is still
    /// there.
    fn listen(&mut self) -> bool {
        if !self.answer.is_empty() {
            let Some(count) = self.guest.write(&self.answer) else { return false };
            self.answer.drain(..count);
        }
        if !self.answer.is_empty() || self.question.contains(&b'\n') {
            return true;
        }
        if self.has_ended {
            return !self.question.is_empty();
        }
        let mut buffer = [0; 4096];
        match self.guest.read(&mut buffer) {
            Said::Bytes(count) => self.question.extend(&buffer[..count]),
            Said::Nothing => {}
            Said::End => self.has_ended = true,
            Said::Gone => return false,
        }
        true
    }

    /// A whole question of a client that has its last answer. The last one may have no end.
    fn next_question(&mut self) -> Option<Vec<u8>> {
        if !self.answer.is_empty() {
            return None;
        }
        loop {
            let line = self.question.iter().position(|&byte| byte == b'\n');
            let end = match line {
                Some(end) => end + 1,
                None if self.question.len() > LONGEST_LINE => {
                    self.has_ended = true;
                    self.question.len()
                }
                None if self.has_ended && !self.question.is_empty() => self.question.len(),
                None => return None,
            };
            let question: Vec<u8> = self.question.drain(..end).collect();
            if end > LONGEST_LINE || !question.trim_ascii().is_empty() {
                return Some(question);
            }
        }
    }
}

fn answer(line: &[u8], machine: &mut dyn Machine, links: &Links) -> String {
    let result = if line.len() > LONGEST_LINE {
        Err(format!("a question is {LONGEST_LINE} bytes long at the most"))
    } else {
        serde_json::from_slice::<Value>(line)
            .map_err(|e| format!("not a JSON object: {e}"))
            .and_then(|question| ask(&question, machine, || links.state()))
    };
    match result {
        Ok(answer) => answer.to_string(),
        Err(error) => json!({ "error": error }).to_string(),
    }
}
