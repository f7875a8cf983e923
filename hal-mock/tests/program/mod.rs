//! The virtual board's program as a child: where it listens, its inspector, its end.
//!
//! Every board listens on ports of its own. Waits have generous limits, since these machines are
//! slow at times; what is tested is that things happen, not how fast.
#![allow(dead_code, reason = "every test uses its part of it")]

use std::collections::HashMap;
use std::fs::File;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, ChildStdout, Command, Output, Stdio};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

/// How long to wait for anything.
pub const PATIENCE: Duration = Duration::from_secs(20);

/// The program with these options.
pub fn program(options: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_virtual-board"));
    command.args(options);
    command
}

/// A running board.
pub struct Board {
    child: Child,
    out: BufReader<ChildStdout>,
    /// The first line it printed.
    pub title: String,
    /// Where it listens: "serial", "TCP", "UDP", "inspect".
    places: HashMap<String, String>,
}

impl Board {
    /// Starts it with an inspector.
    pub fn start(options: &[&str]) -> Self {
        Self::spawn(&mut program(options))
    }

    /// As [`start`](Self::start), of a command made otherwise.
    pub fn spawn(command: &mut Command) -> Self {
        command.args(["--tcp", "127.0.0.1:0", "--inspect", "127.0.0.1:0"]);
        if !command.get_args().any(|option| option == "--web") {
            command.arg("--headless");
        }
        let mut child = command.stdout(Stdio::piped()).spawn().unwrap();
        let out = BufReader::new(child.stdout.take().unwrap());
        let mut board = Self { child, out, title: String::new(), places: HashMap::new() };
        board.title = board.line();
        while !board.places.contains_key("inspect") {
            let line = board.line().replace("serial device", "serial").replace(',', "");
            let mut words = line.split_whitespace().map(str::to_owned);
            board.places.insert(words.next().expect("a place"), words.next().unwrap());
        }
        board
    }

    fn line(&mut self) -> String {
        let mut line = String::new();
        self.out.read_line(&mut line).unwrap();
        line.trim().to_owned()
    }

    /// Where it listens.
    pub fn place(&self, kind: &str) -> &str {
        &self.places[kind]
    }

    /// Whether it listens there at all.
    pub fn has(&self, kind: &str) -> bool {
        self.places.contains_key(kind)
    }

    /// A client of its line.
    pub fn tcp(&self) -> TcpStream {
        let stream = TcpStream::connect(self.place("TCP")).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        stream
    }

    /// Its serial device.
    pub fn serial(&self) -> File {
        File::options().read(true).write(true).open(self.place("serial")).unwrap()
    }

    /// Sends a line to its inspector; the line that comes back.
    pub fn ask_line(&self, question: &str) -> String {
        let mut stream = TcpStream::connect(self.place("inspect")).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        stream.write_all(format!("{question}\n").as_bytes()).unwrap();
        let mut answer = String::new();
        BufReader::new(stream).read_line(&mut answer).unwrap();
        answer
    }

    /// Asks its inspector.
    pub fn ask(&self, question: Value) -> Value {
        serde_json::from_str(&self.ask_line(&question.to_string())).unwrap()
    }

    /// The simulated truth.
    pub fn state(&self) -> Value {
        self.ask(json!({"get": "state"}))
    }

    /// Waits until the state shows something.
    pub fn until(&self, what: impl Fn(&Value) -> bool) -> Value {
        let start = Instant::now();
        loop {
            let state = self.state();
            if what(&state) {
                return state;
            }
            assert!(start.elapsed() < PATIENCE, "it never came: {state}");
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    /// Its process.
    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// Sends it a signal, and does not wait.
    pub fn kill(&mut self, signal: i32) {
        let pid = self.pid().to_string();
        Command::new("kill").args([format!("-{signal}"), pid]).status().unwrap();
    }

    /// Ends it; what it wrote to standard error, which must be a pipe.
    pub fn log_after_end(&mut self) -> String {
        self.kill(15);
        let mut text = String::new();
        self.child.stderr.take().unwrap().read_to_string(&mut text).unwrap();
        text
    }

    /// Sends a signal; the exit code and what was printed since.
    pub fn signal(mut self, signal: i32) -> (Option<i32>, String) {
        self.kill(signal);
        let mut text = String::new();
        self.out.read_to_string(&mut text).unwrap();
        (self.child.wait().unwrap().code(), text)
    }
}

impl Drop for Board {
    fn drop(&mut self) {
        // It may have ended already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The command line was refused, with words that name what is wrong, and nothing else was said.
#[track_caller]
pub fn refused(output: &Output, names: &str) {
    has_ended(output, 2, names);
}

/// It has ended with one line that names what keeps it from running, and said nothing else.
#[track_caller]
pub fn cannot_run(output: &Output, names: &str) {
    has_ended(output, 1, names);
    assert_eq!(output.stderr.iter().filter(|byte| **byte == b'\n').count(), 1);
}

#[track_caller]
fn has_ended(output: &Output, code: i32, names: &str) {
    let error = String::from_utf8(output.stderr.clone()).unwrap();
    assert_eq!(output.status.code(), Some(code), "{error}");
    assert!(error.contains(names), "{names}: {error}");
    assert!(output.stdout.is_empty());
}
