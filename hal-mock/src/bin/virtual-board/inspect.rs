//! The window onto the simulated truth: one JSON object a line each way, loopback only.
//!
//! `{"get":"state"}` answers the state; `{"set":{...}}` changes the simulated world and answers
//! `{"ok":true}`, or `{"error":"..."}` with nothing changed.

use std::io::{ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream, ToSocketAddrs};
use std::os::fd::{AsFd, BorrowedFd};

use serde_json::{Value, json};

use crate::links::cannot_listen;
use crate::machine::Machine;

/// Clients at a time, the longest line of one, and what may wait for one that does not read.
const MOST_CLIENTS: usize = 16;
const LONGEST_LINE: usize = 1 << 16;
const LONGEST_ANSWER: usize = 1 << 20;

/// The window.
pub struct Inspector {
    listener: TcpListener,
    clients: Vec<Client>,
}

struct Client {
    stream: TcpStream,
    question: Vec<u8>,
    answer: Vec<u8>,
}

impl Inspector {
    /// Opens the window, or says in one line why not.
    pub fn open(address: &str) -> Result<Self, String> {
        let complain = |e| cannot_listen("--inspect", address, &e);
        let addresses = address.to_socket_addrs().map_err(complain);
        if !addresses?.all(|address| address.ip().is_loopback()) {
            return Err(format!("--inspect {address}: only a loopback address will do"));
        }
        let listener = TcpListener::bind(address).map_err(complain)?;
        listener.set_nonblocking(true).map_err(complain)?;
        Ok(Self { listener, clients: Vec::new() })
    }

    /// Where it is, for the user.
    pub fn place(&self) -> String {
        let address = self.listener.local_addr();
        format!("inspect {}", address.map_or_else(|e| e.to_string(), |a| a.to_string()))
    }

    /// What can bring questions, to wait for.
    pub fn watch<'a>(&'a self, fds: &mut Vec<BorrowedFd<'a>>) {
        fds.push(self.listener.as_fd());
        fds.extend(self.clients.iter().map(|client| client.stream.as_fd()));
    }

    /// Answers what has been asked, without waiting for anybody.
    pub fn serve(&mut self, machine: &mut dyn Machine) {
        while let Ok((stream, _)) = self.listener.accept() {
            if self.clients.len() < MOST_CLIENTS && stream.set_nonblocking(true).is_ok() {
                let _ = stream.set_nodelay(true);
                self.clients.push(Client { stream, question: Vec::new(), answer: Vec::new() });
            }
        }
        self.clients.retain_mut(|client| client.serve(machine));
    }
}

impl Client {
    /// Whether the client is still there.
    fn serve(&mut self, machine: &mut dyn Machine) -> bool {
        let mut buffer = [0; 4096];
        match self.stream.read(&mut buffer) {
            Ok(0) => return false,
            Ok(count) => self.question.extend(&buffer[..count]),
            Err(e) if would_block(&e) => {}
            Err(_) => return false,
        }
        while let Some(end) = self.question.iter().position(|&byte| byte == b'\n') {
            let line: Vec<u8> = self.question.drain(..=end).collect();
            if !line.trim_ascii().is_empty() {
                let answer = answer(&line, machine);
                self.answer.extend(answer.as_bytes());
                self.answer.push(b'\n');
            }
        }
        if !self.answer.is_empty() {
            match self.stream.write(&self.answer) {
                Ok(count) => drop(self.answer.drain(..count)),
                Err(e) if would_block(&e) => {}
                Err(_) => return false,
            }
        }
        self.question.len() <= LONGEST_LINE && self.answer.len() <= LONGEST_ANSWER
    }
}

fn would_block(error: &std::io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted)
}

fn answer(line: &[u8], machine: &mut dyn Machine) -> String {
    let result = serde_json::from_slice::<Value>(line)
        .map_err(|e| format!("not a JSON object: {e}"))
        .and_then(|question| ask(&question, machine));
    match result {
        Ok(answer) => answer,
        Err(error) => json!({ "error": error }).to_string(),
    }
}

fn ask(question: &Value, machine: &mut dyn Machine) -> Result<String, String> {
    let wanted = "expected {\"get\":\"state\"} or {\"set\":{...}}";
    let object = question.as_object().filter(|object| object.len() == 1).ok_or(wanted)?;
    match object.iter().next() {
        Some((key, Value::String(what))) if key == "get" && what == "state" => {
            Ok(machine.state().to_string())
        }
        Some((key, Value::Object(changes))) if key == "set" => {
            machine.set(changes)?;
            Ok(json!({ "ok": true }).to_string())
        }
        _ => Err(wanted.into()),
    }
}
