//! The window onto the simulated truth: one JSON object a line each way, loopback only.
//!
//! `{"get":"state"}` answers the state; `{"set":{...}}` overrides what sensors read and answers
//! `{"ok":true}`, or `{"error":"..."}` with nothing changed.

use std::io::{ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream, ToSocketAddrs};
use std::os::fd::{AsFd, BorrowedFd};

use hal_mock::board::VirtualBoard;
use hal_mock::plant::Overrides;
use serde::Serialize;
use serde_json::{Map, Value, json};

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
        let addresses = address.to_socket_addrs().map_err(|e| format!("--inspect {address}: {e}"));
        if !addresses?.all(|address| address.ip().is_loopback()) {
            return Err(format!("--inspect {address}: only a loopback address will do"));
        }
        let complain = |e| format!("--inspect {address}: {e}");
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
    pub fn serve(&mut self, board: &VirtualBoard) {
        while let Ok((stream, _)) = self.listener.accept() {
            if self.clients.len() < MOST_CLIENTS && stream.set_nonblocking(true).is_ok() {
                let _ = stream.set_nodelay(true);
                self.clients.push(Client { stream, question: Vec::new(), answer: Vec::new() });
            }
        }
        self.clients.retain_mut(|client| client.serve(board));
    }
}

impl Client {
    /// Whether the client is still there.
    fn serve(&mut self, board: &VirtualBoard) -> bool {
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
                let answer = answer(&line, board);
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

fn answer(line: &[u8], board: &VirtualBoard) -> String {
    let result = serde_json::from_slice::<Value>(line)
        .map_err(|e| format!("not a JSON object: {e}"))
        .and_then(|question| ask(&question, board));
    match result {
        Ok(answer) => answer,
        Err(error) => json!({ "error": error }).to_string(),
    }
}

fn ask(question: &Value, board: &VirtualBoard) -> Result<String, String> {
    let wanted = "expected {\"get\":\"state\"} or {\"set\":{...}}";
    let object = question.as_object().filter(|object| object.len() == 1).ok_or(wanted)?;
    match object.iter().next() {
        Some((key, Value::String(what))) if key == "get" && what == "state" => {
            serde_json::to_string(&State::of(board)).map_err(|e| e.to_string())
        }
        Some((key, Value::Object(changes))) if key == "set" => {
            let mut plant = board.plant.borrow_mut();
            plant.overrides = overridden(&plant.overrides, changes)?;
            Ok(json!({ "ok": true }).to_string())
        }
        _ => Err(wanted.into()),
    }
}

/// The overrides with some of them changed; an error names the key, and nothing is changed.
fn overridden(old: &Overrides, changes: &Map<String, Value>) -> Result<Overrides, String> {
    const AD: u64 = 4095;
    let mut new = old.clone();
    for (key, value) in changes {
        match key.as_str() {
            "pot" => new.potentiometers = numbers(key, value, AD)?,
            "motor_current" => new.currents = numbers(key, value, AD)?,
            "custom_ad" => new.custom_ad = numbers(key, value, AD)?,
            "human" => new.human = numbers(key, value, AD)?,
            "tilt" => new.tilt = numbers(key, value, AD)?,
            "overheat" => new.overheat = numbers(key, value, AD)?,
            "temperature" => new.temperature = number(key, value, AD)?,
            "ir_range" => new.ir_range = number(key, value, AD)?,
            "battery" => new.battery = numbers(key, value, AD)?,
            "reference" => new.reference = numbers(key, value, AD)?,
            "sonar_cm" => new.sonar_cm = numbers(key, value, 255)?,
            "ir_command" => new.ir_command = numbers(key, value, 255)?,
            "gpio_in" => new.gpio_in = number(key, value, 255)?,
            "jam" => {
                new.jam = list(value, |value| value.as_bool())
                    .ok_or(format!("{key}: expected 6 booleans, or null"))?;
            }
            _ => return Err(format!("{key}: nothing of this name can be set")),
        }
    }
    Ok(new)
}

/// `N` numbers from 0 to `most`; null in place of one, or of all, is the simulation's own.
fn numbers<T: TryFrom<u64>, const N: usize>(
    key: &str,
    value: &Value,
    most: u64,
) -> Result<[Option<T>; N], String> {
    list(value, |value| in_range(value, most))
        .ok_or(format!("{key}: expected {N} whole numbers from 0 to {most}, or null"))
}

fn number<T: TryFrom<u64>>(key: &str, value: &Value, most: u64) -> Result<Option<T>, String> {
    match value {
        Value::Null => Ok(None),
        value => in_range(value, most)
            .map(Some)
            .ok_or(format!("{key}: expected a whole number from 0 to {most}, or null")),
    }
}

fn in_range<T: TryFrom<u64>>(value: &Value, most: u64) -> Option<T> {
    value.as_u64().filter(|&value| value <= most).and_then(|value| T::try_from(value).ok())
}

fn list<T, const N: usize>(
    value: &Value,
    element: impl Fn(&Value) -> Option<T>,
) -> Option<[Option<T>; N]> {
    let mut list = [const { None }; N];
    if !value.is_null() {
        let values = value.as_array().filter(|values| values.len() == N)?;
        for (slot, value) in list.iter_mut().zip(values).filter(|(_, value)| !value.is_null()) {
            *slot = Some(element(value)?);
        }
    }
    Some(list)
}

#[derive(Serialize)]
struct State {
    t_ms: u64,
    motors: [MotorState; 6],
    servos: [ServoState; 6],
    gpio_out: u8,
    lcd: String,
    link: LinkState,
    faults: Vec<&'static str>,
}

#[derive(Serialize)]
struct MotorState {
    /// -1 to 1.
    duty: f64,
    enabled: bool,
    /// Counts, unwrapped.
    position: i64,
    /// Counts per second.
    velocity: f32,
    current_a: f32,
}

#[derive(Serialize)]
struct ServoState {
    enabled: bool,
    pulse_us: f64,
}

#[derive(Serialize)]
struct LinkState {
    frames_ok: u32,
    bad_frames: u32,
    bytes_skipped: u32,
    acks_sent: u32,
    refused: u32,
    unknown: u32,
    not_for_us: u32,
    telemetry_sent: u32,
    telemetry_skipped: u32,
    frames_for_us: u32,
    acks_dropped: u32,
    pings_sent: u32,
    pictures_dropped: u32,
    line_errors: u32,
}

impl State {
    fn of(board: &VirtualBoard) -> Self {
        let plant = board.plant.borrow();
        let snapshot = board.snapshot();
        let link = board.link();
        let outputs = &plant.outputs;
        Self {
            t_ms: embassy_time::Instant::now().as_millis(),
            motors: std::array::from_fn(|i| MotorState {
                duty: f64::from(outputs.motors[i].duty.raw()) / 16384.0,
                enabled: outputs.motors[i].enabled,
                position: plant.motors[i].position(),
                velocity: plant.motors[i].velocity(),
                current_a: plant.motors[i].current_a(),
            }),
            servos: outputs.servos.map(|pulse| ServoState {
                enabled: pulse.is_some(),
                pulse_us: pulse.map_or(0.0, |pulse| f64::from(pulse.raw()) / 2.25),
            }),
            gpio_out: outputs.gpio,
            lcd: plant.lcd.as_flattened().iter().map(|byte| format!("{byte:02x}")).collect(),
            link: LinkState {
                frames_ok: link.frames_ok,
                bad_frames: link.bad_frames,
                bytes_skipped: link.bytes_skipped,
                acks_sent: link.acks_sent,
                refused: board.refused(),
                unknown: link.unknown,
                not_for_us: link.not_for_us,
                telemetry_sent: link.telemetry_sent,
                telemetry_skipped: link.telemetry_skipped,
                frames_for_us: link.frames_for_us,
                acks_dropped: link.acks_dropped,
                pings_sent: link.pings_sent,
                pictures_dropped: link.pictures_dropped,
                line_errors: link.line_errors,
            },
            faults: if snapshot.link_loss { vec!["link_loss"] } else { Vec::new() },
        }
    }
}
