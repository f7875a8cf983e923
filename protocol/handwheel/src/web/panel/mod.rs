//! The panel: what pages may do to a board and what they are told, without I/O.
//!
//! Bytes of the line, messages of the pages and the time go in; bytes and messages come out. Vocabulary: a page is
//! *armed* when it alone may write; what it drives is *ours*; an [`Asker`] waits for one answer.
//!
//! Promises:
//! - it opens disarmed, also after the board was gone; one page is armed at a time;
//! - a stop goes before everything else, from any page;
//! - what is ours is stopped when its page disarms, closes, or is not heard for [`ALIVE`], and when another host
//!   takes a motor of ours or starts another;
//! - signs of life are sent while something is ours, and only then;
//! - what a check or a tuning has set is set back, however it ends, unless the board is gone.

mod board;
mod exchanges;
mod found;
mod job;
mod message;
mod motion;
mod outputs;
mod settings;
mod stop;
mod tell;

use std::collections::VecDeque;
use std::time::Duration;

use serde_json::{Map, Value, json};

use crate::error::Error;
use crate::link::Link;
use crate::motion::target;
use crate::session::{Event, Greeting, HEAR, Personality, Session};

use exchanges::{MOST, Purpose};

/// How long a page that drives may be silent; it speaks every 50 ms.
pub const ALIVE: Duration = Duration::from_millis(250);
/// A board that says nothing for so long is gone.
const SILENCE: Duration = Duration::from_secs(3);

/// A page, numbered by whoever holds the sockets.
pub type PageId = u64;

/// Who waits for an answer, and the number of the question, if it has one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Asker(PageId, Option<u64>);

/// What pages may do to a board and what they are told: bytes, messages and the time go in, bytes and messages
/// come out.
pub struct Panel {
    link: Link,
    is_virtual: bool,
    session: Session,
    greeting: Option<Greeting>,
    /// Why there is no board, or none yet.
    why: Option<String>,
    opened: Duration,
    /// When bytes came last.
    heard: Duration,
    now: Duration,
    pages: Vec<(PageId, String)>,
    messages: VecDeque<(PageId, String)>,
    /// What pages ask the world.
    world: VecDeque<(Asker, Value)>,
    purposes: VecDeque<Purpose>,
    board: board::Board,
    motion: motion::Motion,
    settings: settings::Tuning,
    tells: tell::Tells,
}

impl Panel {
    /// Of the board at this link, which is not open yet. A virtual board has a world beside it.
    pub fn new(link: Link, is_virtual: bool) -> Self {
        Self {
            link,
            is_virtual,
            session: Session::new(),
            greeting: None,
            why: Some("not connected yet".into()),
            opened: Duration::ZERO,
            heard: Duration::ZERO,
            now: Duration::ZERO,
            pages: Vec::new(),
            messages: VecDeque::new(),
            world: VecDeque::new(),
            purposes: VecDeque::new(),
            board: board::Board::default(),
            motion: motion::Motion::default(),
            settings: settings::Tuning::default(),
            tells: tell::Tells::default(),
        }
    }

    /// The link was opened.
    pub fn link_is_open(&mut self, now: Duration) {
        self.now = now;
        self.listen("nobody has spoken yet".into());
    }

    /// Listens anew: to a link that was opened, or of a board that has fallen silent or started again.
    fn listen(&mut self, why: String) {
        let ours = self.motion.all_of_ours();
        let was_stopping = self.motion.stop.is_some();
        self.lose(why);
        // It may hear, though it is not heard.
        if was_stopping {
            self.send_stop();
        }
        for motor in ours {
            self.session.send(&target::neutral(motor));
            self.session.send(&target::suspend(motor));
        }
        let now = self.now;
        self.greeting = Some(Greeting::new(matches!(self.link, Link::Udp(_)), now));
        (self.opened, self.heard) = (now, now);
    }

    /// The link is gone, or cannot be opened.
    pub fn link_is_gone(&mut self, why: String) {
        self.lose(why);
        self.greeting = None;
    }

    /// A page has opened.
    pub fn open(&mut self, page: PageId) {
        let name = format!("page {page}");
        self.pages.push((page, name.clone()));
        self.tell_one(page, &json!({ "tell": "page", "name": name }));
        self.tell_all_about(page);
    }

    /// A page is gone.
    pub fn close(&mut self, page: PageId, now: Duration) {
        self.now = now;
        let why = format!("{} was closed", self.page_name(page));
        self.disarm_if(page, &why);
        self.pages.retain(|(id, _)| *id != page);
    }

    /// A page's message.
    pub fn hear(&mut self, page: PageId, text: &str, now: Duration) {
        self.now = now;
        if !self.pages.iter().any(|(id, _)| *id == page) {
            return;
        }
        let asked = serde_json::from_str(text)
            .map_err(|error| (None, format!("no JSON object: {error}")))
            .and_then(|object: Map<String, Value>| {
                let id = object.get("id").and_then(Value::as_u64);
                let asker = Asker(page, id);
                self.carry_out(asker, &object).map_err(|error| (id, error))
            });
        if let Err((id, error)) = asked {
            self.answer(Asker(page, id), Err(error));
        }
    }

    /// Does what a page asks. What is answered later, or was answered, is `Ok`.
    fn carry_out(&mut self, asker: Asker, object: &Map<String, Value>) -> Result<(), String> {
        let what = object.get("do").and_then(Value::as_str).ok_or("a `do` is wanted")?;
        match what {
            "alive" => self.alive(asker.0),
            "stop" => self.stop(asker)?,
            "arm" => self.arm(asker)?,
            "disarm" => {
                let why = format!("{} has disarmed", self.page_name(asker.0));
                self.disarm_if(asker.0, &why);
                self.answer(asker, Ok(Value::Null));
            }
            "world" => {
                let set = object.get("set").filter(|set| set.is_object());
                let set = set.ok_or("set: {KEY: VALUE, ...} is wanted")?;
                if !self.is_virtual {
                    return Err("only a virtual board has a world that can be changed".into());
                }
                self.world.push_back((asker, set.clone()));
            }
            "plan" => {
                self.needs_a_board()?;
                let plan = self.plan_of(object)?;
                self.answer(asker, Ok(plan));
            }
            "settings" | "backup" | "diff" => {
                self.needs_a_board()?;
                self.read_of_settings(what, asker, object)?;
            }
            _ => {
                self.needs_a_board()?;
                self.needs_armed(asker.0)?;
                if self.purposes.len() > MOST {
                    return Err("too much at once: wait for the answers".into());
                }
                match what {
                    "set" | "save" | "reset" | "restore" => {
                        self.change_settings(what, asker, object)?;
                    }
                    _ => self.act(what, asker, object)?,
                }
            }
        }
        Ok(())
    }

    /// Bytes have come from the board.
    pub fn receive(&mut self, bytes: &[u8], now: Duration) {
        self.now = now;
        if !bytes.is_empty() {
            self.heard = now;
        }
        self.session.receive(bytes);
        self.take_events();
    }

    /// Lets time pass.
    pub fn advance(&mut self, now: Duration) {
        self.now = now;
        if let Some(greeting) = &mut self.greeting {
            if let Some(said) = greeting.say(now) {
                self.session.say(said);
            }
            if now >= self.opened + HEAR {
                self.not_there(Error::nobody(&self.link, self.session.received()).to_string());
            }
        } else if self.is_connected() && now >= self.heard + SILENCE {
            self.listen(format!("{}: the board says nothing any more", self.link));
        }
        self.session.advance(now);
        self.take_events();
        if self.is_connected() {
            self.watch_pages();
            self.advance_motion();
            self.advance_settings();
            self.poll();
        }
    }

    /// What is to be written to the board: one frame or packet.
    pub fn take_output(&mut self) -> Option<Vec<u8>> {
        self.session.take_output()
    }

    /// What is to be said to a page.
    pub fn take_message(&mut self) -> Option<(PageId, String)> {
        self.messages.pop_front()
    }

    /// What pages want of the world: who, and what is to be set.
    pub fn take_world(&mut self) -> Option<(Asker, Value)> {
        self.world.pop_front()
    }

    /// What came of that.
    pub fn world_answers(&mut self, asker: Asker, result: Result<Value, String>) {
        self.answer(asker, result.map(|_| Value::Null));
    }

    /// The world around a virtual board, for all pages.
    pub fn tell_world(&mut self, state: &Value) {
        self.tell(&json!({ "tell": "world", "state": state }));
    }

    /// Whether a board is there.
    pub fn is_connected(&self) -> bool {
        self.why.is_none()
    }

    /// Whether nothing is under way that a line is needed for.
    pub fn is_idle(&self) -> bool {
        !self.is_connected()
            || self.motion.is_at_rest() && self.purposes.is_empty() && !self.settings.is_changing()
    }

    fn not_there(&mut self, why: String) {
        if self.why.as_ref() != Some(&why) {
            self.why = Some(why);
            self.tell_board();
        }
    }

    /// Nothing is known of a board any more.
    fn lose(&mut self, why: String) {
        self.forget("the board is gone");
        self.lose_motion(&why);
        self.session = Session::new();
        self.board = board::Board::default();
        self.settings = settings::Tuning::default();
        self.tells.forget();
        let was_armed = self.motion.armed_page().is_some();
        self.motion = motion::Motion::default();
        self.why = None;
        self.not_there(why);
        self.tell_faults();
        self.tell_settings();
        self.tell_outputs();
        if was_armed {
            self.tell_armed();
            self.note("the board was gone: disarmed");
        }
    }

    fn take_events(&mut self) {
        while let Some(event) = self.session.take_event() {
            match event {
                Event::Answered(reply) => self.settle_next(Ok(reply)),
                Event::Failed(failure) => self.settle_next(Err(failure)),
                Event::Heard(personality) => self.meet(personality),
                other => self.take_news(&other),
            }
        }
    }

    fn personality(&self) -> Personality {
        self.session.personality().unwrap_or(Personality::Pms5005)
    }

    fn needs_a_board(&self) -> Result<(), String> {
        match &self.why {
            None => Ok(()),
            Some(why) => Err(format!("no board: {why}")),
        }
    }

    fn page_name(&self, page: PageId) -> String {
        let found = self.pages.iter().find(|(id, _)| *id == page);
        found.map_or_else(|| format!("page {page}"), |(_, name)| name.clone())
    }

    fn answer_all(&mut self, askers: Vec<Asker>, result: &Result<Value, String>) {
        askers.into_iter().for_each(|asker| self.answer(asker, result.clone()));
    }

    fn answer(&mut self, asker: Asker, result: Result<Value, String>) {
        let Asker(page, id) = asker;
        let message = match (result, id) {
            (Ok(value), Some(id)) => json!({ "id": id, "ok": value }),
            (Ok(_), None) => return,
            (Err(error), id) => json!({ "id": id, "error": error }),
        };
        self.tell_one(page, &message);
    }

    fn note(&mut self, text: &str) {
        self.tell(&json!({ "tell": "note", "text": text }));
    }

    fn tell(&mut self, message: &Value) {
        let text = message.to_string();
        for (page, _) in &self.pages {
            self.messages.push_back((*page, text.clone()));
        }
    }

    fn tell_one(&mut self, page: PageId, message: &Value) {
        if self.pages.iter().any(|(id, _)| *id == page) {
            self.messages.push_back((page, message.to_string()));
        }
    }
}
