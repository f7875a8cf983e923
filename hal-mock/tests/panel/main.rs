//! The page's panel against the virtual board, on virtual time: what pages may do, and that what they drive stops.
#![cfg(unix)]

mod driving;
mod jobs;
mod others;
mod races;
mod settings;

use embassy_time::Duration;
use hal_mock::board::{Make, VirtualBoard};
use handwheel::Link;
use handwheel::web::{PageId, Panel};
use serde_json::{Value, json};

/// A board, its panel, and what pages were told.
struct Desk {
    board: VirtualBoard,
    panel: Panel,
    /// The pages that say that they are alive, every 50 ms.
    alive: Vec<PageId>,
    told: Vec<(PageId, Value)>,
    ms: u64,
    next: u64,
    /// What the board says does not come.
    is_deaf: bool,
}

const ONE: PageId = 1;
const TWO: PageId = 2;

impl Desk {
    /// With a page that has been told everything.
    fn new() -> Self {
        Self::of(VirtualBoard::new(Make::default()))
    }

    fn of(board: VirtualBoard) -> Self {
        let link: Link = "tcp:127.0.0.1:5005".parse().unwrap();
        let mut panel = Panel::new(link, true);
        panel.link_is_open(std::time::Duration::ZERO);
        let mut desk = Self {
            board,
            panel,
            alive: Vec::new(),
            told: Vec::new(),
            ms: 0,
            next: 1,
            is_deaf: false,
        };
        desk.open(ONE);
        desk.run(4000);
        assert!(!desk.last(ONE, "settings")["settings"].as_array().unwrap().is_empty());
        desk
    }

    fn now(&self) -> std::time::Duration {
        std::time::Duration::from_millis(self.ms)
    }

    fn open(&mut self, page: PageId) {
        self.panel.open(page);
        self.alive.push(page);
    }

    fn close(&mut self, page: PageId) {
        self.alive.retain(|alive| *alive != page);
        self.panel.close(page, self.now());
    }

    fn run(&mut self, ms: u64) {
        for _ in 0..ms {
            self.ms += 1;
            if self.ms.is_multiple_of(50) {
                for page in self.alive.clone() {
                    self.panel.hear(page, r#"{"do":"alive"}"#, self.now());
                }
            }
            self.panel.advance(self.now());
            while let Some(bytes) = self.panel.take_output() {
                self.board.line.host_sends(&bytes);
            }
            self.board.run_for(Duration::from_millis(1));
            while let Some((_, frame)) = self.board.line.host_receives() {
                if !self.is_deaf {
                    self.panel.receive(&frame, self.now());
                }
            }
            while let Some((page, text)) = self.panel.take_message() {
                let told: Value = serde_json::from_str(&text).unwrap();
                let is_second = told["id"].is_u64()
                    && self.told.iter().any(|(to, old)| *to == page && old["id"] == told["id"]);
                assert!(!is_second, "answered twice: {told}");
                self.told.push((page, told));
            }
        }
    }

    /// Says something; the number of its question.
    fn say(&mut self, page: PageId, mut what: Value) -> u64 {
        let id = self.next;
        self.next += 1;
        what["id"] = id.into();
        self.panel.hear(page, &what.to_string(), self.now());
        id
    }

    /// What the panel wants to write now is lost on the line.
    fn lose_output(&mut self) {
        self.panel.advance(self.now());
        while self.panel.take_output().is_some() {}
    }

    /// Says something, and waits for its answer.
    #[track_caller]
    fn ask(&mut self, page: PageId, what: Value) -> Result<Value, String> {
        let id = self.say(page, what.clone());
        for _ in 0..8000 {
            self.run(1);
            if let Some(answer) = self.answer(page, id) {
                return answer;
            }
        }
        panic!("no answer to {what}");
    }

    fn answer(&self, page: PageId, id: u64) -> Option<Result<Value, String>> {
        let (_, told) = self.told.iter().find(|(to, told)| *to == page && told["id"] == id)?;
        Some(match told.get("error") {
            Some(error) => Err(error.as_str().unwrap().to_owned()),
            None => Ok(told["ok"].clone()),
        })
    }

    /// What a page was told last of this.
    #[track_caller]
    fn last(&self, page: PageId, what: &str) -> &Value {
        let is_it = |(to, told): &&(PageId, Value)| *to == page && told["tell"] == what;
        &self.told.iter().rev().find(is_it).unwrap_or_else(|| panic!("{what} was not told")).1
    }

    fn notes(&self) -> Vec<&str> {
        let notes = self.told.iter().filter(|(to, told)| *to == ONE && told["tell"] == "note");
        notes.map(|(_, told)| told["text"].as_str().unwrap()).collect()
    }

    /// The duty of a motor, 1 to 6, in percent; `None` when its bridge is off.
    fn duty(&self, motor: usize) -> Option<f64> {
        let drive = self.board.plant.borrow().outputs.motors[motor - 1];
        drive.enabled.then(|| f64::from(drive.duty.raw()) / 163.84)
    }

    fn drives(&self, motor: usize) -> bool {
        self.duty(motor).is_some_and(|duty| duty.abs() > 1.0)
    }

    /// Arms a page, and has it run motor 1.
    #[track_caller]
    fn drive(&mut self, page: PageId) {
        self.ask(page, json!({ "do": "arm" })).unwrap();
        self.ask(page, json!({ "do": "drive", "motor": 1, "velocity": 4000 })).unwrap();
        self.run(500);
        assert!(self.drives(1));
    }
}
