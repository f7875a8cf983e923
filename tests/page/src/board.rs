//! The virtual board's program as a child. *Truth* is what its inspector tells of the simulated world.

use std::io::{BufRead, BufReader, Write, copy, sink};
use std::net::TcpStream;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::time::Duration;

use protocol::pms5005::{Addressing, CHANNELS, Command as Frame, Move, Quantity};
use serde_json::{Value, json};

use crate::{PATIENCE, until};

/// A host speaks more often than the board's link timeout, 2 s.
const SIGN_OF_LIFE: Duration = Duration::from_millis(200);

/// A running board, with a file of settings.
pub struct Board {
    child: Child,
    settings: PathBuf,
    /// Where it listens; after a restart the same.
    tcp: String,
    web: String,
    inspect: String,
}

impl Board {
    /// Starts it on free ports, with its defaults.
    pub fn start() -> Self {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let number = COUNT.fetch_add(1, Ordering::Relaxed);
        let name = format!("page-{}-{number}.settings", std::process::id());
        let settings = std::env::temp_dir().join(name);
        // One that a run left here, which had this process's number.
        let _ = std::fs::remove_file(&settings);
        let free = || "127.0.0.1:0".to_owned();
        Self::spawn(settings, free(), free(), free())
    }

    fn spawn(settings: PathBuf, tcp: String, web: String, inspect: String) -> Self {
        let program = std::env::var_os("VIRTUAL_BOARD").expect("VIRTUAL_BOARD: run .ci/chromium");
        let mut child = Command::new(program)
            .args(["--udp", "127.0.0.1:0", "--tcp", &tcp, "--web", &web, "--inspect", &inspect])
            .arg("--settings")
            .arg(&settings)
            .stdout(Stdio::piped())
            .spawn()
            .expect("VIRTUAL_BOARD is the virtual board");
        let mut out = BufReader::new(child.stdout.take().unwrap());
        let mut board = Self { child, settings, tcp, web, inspect };
        loop {
            let mut line = String::new();
            assert!(out.read_line(&mut line).unwrap() > 0, "the board has ended at its start");
            match line.replace(',', "").split_whitespace().collect::<Vec<_>>()[..] {
                ["TCP", place, ..] => board.tcp = place.to_owned(),
                ["page", address, ..] => {
                    let place = address.trim_start_matches("http://").trim_end_matches('/');
                    board.web = place.to_owned();
                }
                ["inspect", place, ..] => {
                    board.inspect = place.to_owned();
                    break;
                }
                _ => {}
            }
        }
        std::thread::spawn(move || copy(&mut out, &mut sink()));
        board
    }

    /// Kills it (SIGKILL).
    pub fn kill(&mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }

    /// Starts it again after [`kill`](Self::kill): the same places, the same settings.
    pub fn start_again(&mut self) {
        let [tcp, web, inspect] = [&self.tcp, &self.web, &self.inspect].map(Clone::clone);
        *self = Self::spawn(std::mem::take(&mut self.settings), tcp, web, inspect);
    }

    /// Where its page is.
    pub fn address(&self) -> String {
        format!("http://{}/", self.web)
    }

    /// The simulated truth.
    pub fn truth(&self) -> Value {
        let mut stream = TcpStream::connect(&self.inspect).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        stream.write_all(format!("{}\n", json!({"get": "state"})).as_bytes()).unwrap();
        let mut answer = String::new();
        BufReader::new(stream).read_line(&mut answer).unwrap();
        serde_json::from_str(&answer).unwrap()
    }

    /// Motor 1's true velocity, in counts/s.
    pub fn velocity(&self) -> f64 {
        self.truth()["motors"][0]["velocity"].as_f64().unwrap()
    }

    /// Whether motor 1 is truly off and stands.
    pub fn stands(&self) -> bool {
        let motor = &self.truth()["motors"][0];
        let is = |name: &str| motor[name].as_f64().unwrap();
        motor["enabled"] == false && is("duty") == 0.0 && is("velocity").abs() < 1.0
    }

    /// Waits until motor 1 truly stands.
    #[track_caller]
    pub fn until_it_stands(&self) {
        until("motor 1 stands", || self.stands().then_some(()));
    }

    /// Another host on its TCP line: drives motor 1 at 2000 counts/s with one command, and then only says that
    /// it is there. It goes on until it is dropped.
    pub fn other_host_drives(&self) -> OtherHost {
        let mut stream = TcpStream::connect(&self.tcp).unwrap();
        let mut targets = [None; CHANNELS];
        targets[0] = Some(2000);
        let (quantity, addressing) = (Quantity::Velocity, Addressing::List);
        let drive = Frame::Move(Move { quantity, addressing, targets, periods: 0 });
        stream.write_all(drive.encode(0, &mut [0; 264]).unwrap()).unwrap();
        // Telemetry is thrown away, so that none of it holds the board up.
        let mut telemetry = stream.try_clone().unwrap();
        std::thread::spawn(move || copy(&mut telemetry, &mut sink()));
        let (ends, ended) = channel::<()>();
        std::thread::spawn(move || {
            let mut buffer = [0; 264];
            let ping = Frame::Ping.encode(0, &mut buffer).unwrap();
            while let Err(std::sync::mpsc::RecvTimeoutError::Timeout) =
                ended.recv_timeout(SIGN_OF_LIFE)
            {
                // The board may be gone.
                if stream.write_all(ping).is_err() {
                    break;
                }
            }
            let _ = stream.shutdown(std::net::Shutdown::Both);
        });
        until("another host's motor runs", || (self.velocity() > 1800.0).then_some(()));
        OtherHost { _ends: ends }
    }
}

impl Drop for Board {
    fn drop(&mut self) {
        // It may have ended already, and may have saved nothing.
        let _ = self.child.kill();
        let _ = self.child.wait();
        if !self.settings.as_os_str().is_empty() {
            let _ = std::fs::remove_file(&self.settings);
        }
    }
}

/// See [`Board::other_host_drives`].
pub struct OtherHost {
    _ends: Sender<()>,
}
