//! A board, its flash, and a page that may be its host.

use std::cell::Cell;
use std::rc::Rc;

use embassy_time::{Duration, Instant};
use firmware::personality::pioneer_arm::PioneerArm;
use hal_mock::board::{self, VirtualBoard};
use hal_mock::flash::Flash;
use hal_mock::machine::{self, Cm5, Machine, PassThrough};
use hal_mock::plant::Ax12;
use hal_mock::{cm5_board, pass_through_board};
use handwheel::Link;
use handwheel::web::{PageId, Panel};
use serde_json::{Value, json};

/// How often a page and its board hear each other, and how often it is told of the world.
const TICK: Duration = Duration::from_millis(5);
const WORLD: Duration = Duration::from_millis(200);
/// There is one page.
const PAGE: PageId = 1;
/// The servos of a CM-5, as of the program `virtual-board`.
const SERVOS: std::ops::RangeInclusive<u8> = 1..=6;

/// See the [module](self).
pub struct Board {
    machine: Box<dyn Machine>,
    flash: Flash,
    /// The flash has changed since it was last asked for.
    is_new: Rc<Cell<bool>>,
    page: Option<Page>,
}

struct Page {
    panel: Panel,
    /// When it is told of the world next.
    world: Instant,
}

impl Board {
    /// One that has just been switched on, with what its flash holds. `what` is its personality, and the speed of its
    /// host's line in baud if that is not the usual: `pms5005 0` takes no time. Or in one line what is wrong with it.
    pub fn start(what: &str, flash: &[u8]) -> Result<Self, String> {
        let mut words = what.split_whitespace();
        let personality = words.next().unwrap_or_default();
        let line_rate = words.next().map(str::parse).transpose();
        let line_rate: Option<u32> = line_rate.map_err(|_| format!("{what}: no line rate"))?;
        let is_new = Rc::new(Cell::new(false));
        let changes = is_new.clone();
        let keep = move |_: &[u8], _| {
            changes.set(true);
            Ok(())
        };
        let flash = Flash::kept(flash, Box::new(keep));
        let usual = board::Make::default();
        let make = board::Make { line_rate: line_rate.unwrap_or(usual.line_rate), ..usual };
        let servos = SERVOS.map(Ax12::new).collect();
        let machine: Box<dyn Machine> = match personality {
            "pms5005" => Box::new(VirtualBoard::with_flash(make, flash.clone())),
            "pioneer-arm" => {
                Box::new(VirtualBoard::with_session(make, flash.clone(), PioneerArm::new))
            }
            "cm5" => {
                let usual = cm5_board::Make::default();
                let line_rate = line_rate.unwrap_or(usual.line_rate);
                Box::new(Cm5::new(cm5_board::Make { servos, line_rate, ..usual }))
            }
            "cm5-pass-through" => {
                let usual = pass_through_board::Make::default();
                let line_rate = line_rate.unwrap_or(usual.line_rate);
                Box::new(PassThrough::new(pass_through_board::Make { servos, line_rate, ..usual }))
            }
            _ => {
                return Err(format!(
                    "{what}: no personality; pms5005, pioneer-arm, cm5 or cm5-pass-through"
                ));
            }
        };
        Ok(Self { machine, flash, is_new, page: None })
    }

    /// Lets time pass, until so many microseconds after the start.
    pub fn advance(&mut self, until_us: u64) {
        let until = Instant::from_micros(until_us);
        let Some(page) = &mut self.page else { return self.machine.run_until(until) };
        while Instant::now() < until {
            self.machine.run_until(until.min(Instant::now() + TICK));
            page.go_on(self.machine.as_mut());
        }
    }

    /// Bytes of the host.
    pub fn feed(&mut self, bytes: &[u8]) {
        self.machine.line().host_sends(bytes);
    }

    /// Bytes of the host that have not arrived at the board yet.
    pub fn backlog(&self) -> usize {
        self.machine.line().backlog()
    }

    /// The next frame that has arrived at the host.
    pub fn take(&mut self) -> Option<Vec<u8>> {
        self.machine.line().host_receives().map(|(_, frame)| frame)
    }

    /// What the flash holds, if that has changed since the last time.
    pub fn new_flash(&mut self) -> Option<Vec<u8>> {
        self.is_new.take().then(|| self.flash.image())
    }

    /// An inspector's answer to its question.
    pub fn ask(&mut self, question: &str) -> String {
        let result = serde_json::from_str(question)
            .map_err(|error| format!("not a JSON object: {error}"))
            .and_then(|question| ask(&question, self.machine.as_mut()));
        result.unwrap_or_else(|error| json!({ "error": error })).to_string()
    }

    /// A page is the host from now on.
    pub fn open_page(&mut self) {
        let mut panel = Panel::new(Link::Other("this page".into()), true);
        panel.link_is_open(now());
        panel.open(PAGE);
        self.page = Some(Page { panel, world: Instant::now() });
    }

    /// Takes a message of the page.
    pub fn page_says(&mut self, message: &str) {
        if let Some(page) = &mut self.page {
            page.panel.hear(PAGE, message, now());
        }
    }

    /// The next message to the page.
    pub fn page_hears(&mut self) -> Option<String> {
        self.page.as_mut()?.panel.take_message().map(|(_, message)| message)
    }
}

impl Page {
    /// Carries what page, board and world have to say to each other.
    fn go_on(&mut self, machine: &mut dyn Machine) {
        while let Some((_, frame)) = machine.line().host_receives() {
            self.panel.receive(&frame, now());
        }
        self.panel.advance(now());
        while let Some(frame) = self.panel.take_output() {
            machine.line().host_sends(&frame);
        }
        while let Some((asker, set)) = self.panel.take_world() {
            self.panel.world_answers(asker, ask(&json!({ "set": set }), machine));
            self.world = Instant::now();
        }
        if Instant::now() >= self.world {
            self.world = Instant::now() + WORLD;
            if let Ok(state) = ask(&json!({ "get": "state" }), machine) {
                self.panel.tell_world(&state);
            }
        }
    }
}

/// Nobody else is on the line.
fn ask(question: &Value, machine: &mut dyn Machine) -> Result<Value, String> {
    machine::ask(question, machine, || Value::Null)
}

/// The board's time, as a page counts it.
fn now() -> std::time::Duration {
    std::time::Duration::from_micros(Instant::now().as_micros())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What the page is told and answered until so many ms after the start.
    fn heard(board: &mut Board, until_ms: u64) -> Vec<Value> {
        board.advance(until_ms * 1000);
        std::iter::from_fn(|| board.page_hears())
            .map(|message| serde_json::from_str(&message).unwrap())
            .collect()
    }

    fn answers(heard: &[Value], id: u64) -> bool {
        heard.iter().any(|message| message["id"] == id && message.get("ok").is_some())
    }

    #[test]
    fn a_page_drives_saves_and_finds_it_saved_by_another_board() {
        let mut board = Board::start("pms5005 0", &[]).unwrap();
        board.open_page();
        let connected = |told: &Value| {
            told["tell"] == "board" && told["connected"] == true && told["is_virtual"] == true
        };
        assert!(heard(&mut board, 2000).iter().any(connected));
        board.page_says(r#"{"do":"arm","id":1}"#);
        board.page_says(r#"{"do":"set","id":2,"values":{"telemetry period":40}}"#);
        let said = heard(&mut board, 2200);
        assert!(answers(&said, 1) && answers(&said, 2));
        board.page_says(r#"{"do":"drive","id":3,"motor":1,"velocity":2000}"#);
        for ms in (2200..3000).step_by(50) {
            board.page_says(r#"{"do":"alive"}"#);
            board.advance(ms * 1000);
        }
        let velocity = |board: &mut Board| {
            let state: Value = serde_json::from_str(&board.ask(r#"{"get":"state"}"#)).unwrap();
            state["motors"][0]["velocity"].as_f64().unwrap()
        };
        assert!((velocity(&mut board) - 2000.0).abs() < 100.0);
        // The page falls silent, and is disarmed.
        heard(&mut board, 4000);
        assert_eq!(velocity(&mut board), 0.0);
        assert_eq!(board.new_flash(), None);

        board.page_says(r#"{"do":"arm","id":4}"#);
        board.page_says(r#"{"do":"save","id":5}"#);
        assert!(answers(&heard(&mut board, 4500), 5));
        let flash = board.new_flash().unwrap();
        assert_eq!(board.new_flash(), None);

        let mut board = Board::start("pms5005", &flash).unwrap();
        board.open_page();
        let saved = |told: &Value| {
            let settings = told["settings"].as_array().into_iter().flatten();
            settings.into_iter().any(|s| s["name"] == "telemetry period" && s["value"] == 40)
        };
        assert!(heard(&mut board, 5000).iter().any(saved));
    }

    #[test]
    fn what_cannot_be_started_or_asked_is_answered_in_a_line() {
        for (what, says) in [
            ("pms5006", "pms5006: no personality; pms5005, pioneer-arm,"),
            ("pms5005 fast", "pms5005 fast: no line rate"),
            ("", ": no personality"),
        ] {
            let error = Board::start(what, &[]).err().unwrap();
            assert!(error.contains(says) && error.lines().count() == 1, "{error}");
        }
        let mut board = Board::start("cm5", &[]).unwrap();
        assert!(board.ask("nothing").contains("error") && board.ask("{}").contains("expected"));
        assert_eq!(board.ask(r#"{"set":{"jammed":[3]}}"#), r#"{"ok":true}"#);
        // Without a page there is nobody to be told.
        board.page_says(r#"{"do":"stop"}"#);
        assert_eq!(board.page_hears(), None);
    }
}
