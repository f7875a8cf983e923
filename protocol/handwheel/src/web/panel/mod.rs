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
//! - signs of life are sent while something is ours, and only then.

mod board;
mod motion;
mod outputs;
mod settings;
mod stop;
mod tell;

use std::collections::VecDeque;
use std::time::Duration;

use protocol::extension::{Action, Request};
use protocol::pms5005::Command;
use serde_json::{Map, Value, json};

use crate::Number;
use crate::error::Error;
use crate::link::Link;
use crate::motion::target;
use crate::session::{Event, Failure, Greeting, HEAR, Personality, Reply, Session};

/// How long a page that drives may be silent; it speaks every 50 ms.
pub const ALIVE: Duration = Duration::from_millis(250);
/// A board that says nothing for so long is gone.
const SILENCE: Duration = Duration::from_secs(3);

/// A page, numbered by whoever holds the sockets.
pub type PageId = u64;

/// Who waits for an answer, and the number of the question, if it has one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Asker(PageId, Option<u64>);

/// What an exchange of the session is for; one each, in their order.
enum Purpose {
    /// A page waits until it is done.
    Page(Asker, &'static str),
    /// The same of a save, or a reset.
    Keep(Asker, Action),
    Servo(Asker),
    /// A part of a picture; the last one's page waits.
    Lcd(Option<Asker>),
    /// A motion command, numbered; of a step nobody waits for it.
    Drive(Number, u64, Option<Asker>),
    /// The acknowledged part of a stop of everything, and of one motor.
    Stop,
    End(Number),
    Board(board::Asked),
    /// Of this reading of all settings.
    ReadSetting(u64),
    Change,
    /// Nobody waits.
    Quiet,
}

/// Exchanges that may wait; pages that ask for more are refused.
const MOST: usize = 256;

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
        self.pages.retain(|(id, _)| *id != page);
        self.disarm_if(page, "its page was closed");
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
                self.disarm_if(asker.0, "its page was disarmed");
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

    /// What came of the oldest exchange.
    fn settle_next(&mut self, result: Result<Reply, Failure>) {
        if let Some(purpose) = self.purposes.pop_front() {
            self.settle(purpose, result);
        }
    }

    fn settle(&mut self, purpose: Purpose, result: Result<Reply, Failure>) {
        let personality = self.personality();
        let done = |result: Result<Reply, Failure>, what| {
            result.map(drop).map_err(|failure| Error::of(failure, personality, what))
        };
        let said = |result: Result<(), Error>| {
            result.map(|()| Value::Null).map_err(|error| error.to_string())
        };
        match purpose {
            Purpose::Page(asker, what) => self.answer(asker, said(done(result, what))),
            Purpose::Servo(asker) => self.answer(asker, said(done(result, "servos"))),
            Purpose::Keep(asker, action) => {
                let result = done(result, "a save of its settings");
                if result.is_ok() {
                    self.was_kept(action);
                }
                self.answer(asker, said(result));
            }
            Purpose::Lcd(asker) => {
                self.lcd_is_heard(asker, done(result, "LCD").map_err(|e| e.to_string()));
            }
            Purpose::Drive(motor, command, asker) => {
                self.driven(motor, command, asker, done(result, "a motion command"));
            }
            Purpose::Stop => self.stop_is_heard(done(result, "a stop")),
            Purpose::End(motor) => self.end_is_heard(motor, done(result, "a stop")),
            Purpose::Board(asked) => self.board_tells(asked, result),
            Purpose::ReadSetting(reading) => self.setting_is_read(reading, result),
            Purpose::Change => self.change_goes_on(result),
            Purpose::Quiet => {}
        }
    }

    /// Drops what has not been answered or sent; who waits for it is told why.
    fn forget(&mut self, why: &str) {
        self.session.forget();
        for purpose in std::mem::take(&mut self.purposes) {
            self.tell_dropped(&purpose, why);
        }
        self.settings_were_interrupted(why);
        self.board.was_interrupted();
    }

    /// Drops what these are for, and tells who waits why.
    fn withdraw(&mut self, which: impl Fn(&Purpose) -> bool, why: &str) {
        while let Some(place) = self.purposes.iter().position(&which) {
            self.session.withdraw(place);
            if let Some(purpose) = self.purposes.remove(place) {
                self.tell_dropped(&purpose, why);
            }
        }
    }

    fn tell_dropped(&mut self, purpose: &Purpose, why: &str) {
        if let Purpose::Page(asker, _)
        | Purpose::Keep(asker, _)
        | Purpose::Servo(asker)
        | Purpose::Lcd(Some(asker))
        | Purpose::Drive(_, _, Some(asker)) = purpose
        {
            self.answer(*asker, Err(format!("not done: {why}")));
        }
    }

    fn ask(&mut self, request: &Request<'_>, purpose: Purpose) {
        self.queue(purpose, |session, now| session.ask(request, now));
    }

    fn command(&mut self, command: &Command<'_>, purpose: Purpose) {
        self.queue(purpose, |session, now| session.command(command, now));
    }

    fn queue(
        &mut self,
        purpose: Purpose,
        begin: impl FnOnce(&mut Session, Duration) -> Result<(), Failure>,
    ) {
        // What the line does not carry has failed before anything was sent.
        match begin(&mut self.session, self.now) {
            Ok(()) => self.purposes.push_back(purpose),
            Err(failure) => self.settle(purpose, Err(failure)),
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

/// A whole number of an object, in its range.
fn number(object: &Map<String, Value>, key: &str, low: i64, high: i64) -> Result<i64, String> {
    let value = object.get(key).and_then(Value::as_i64);
    value
        .filter(|value| (low..=high).contains(value))
        .ok_or_else(|| format!("{key}: a whole number from {low} to {high} is wanted"))
}

/// The motor or the servo of a message.
fn member(object: &Map<String, Value>, key: &str) -> Result<Number, String> {
    let number = number(object, key, 1, 6)?;
    let number = u8::try_from(number).ok().and_then(Number::new);
    number.ok_or_else(|| format!("{key}: 1 to 6"))
}

/// A time of an object, 0 without one.
fn ms(object: &Map<String, Value>, key: &str, low: i64, high: i64) -> Result<Duration, String> {
    match object.get(key) {
        None | Some(Value::Null) => Ok(Duration::ZERO),
        Some(_) => {
            let ms = number(object, key, low, high)?;
            Ok(Duration::from_millis(ms.unsigned_abs()))
        }
    }
}

/// A text of an object.
fn text<'a>(object: &'a Map<String, Value>, key: &str) -> Result<&'a str, String> {
    object.get(key).and_then(Value::as_str).ok_or_else(|| format!("{key}: a text is wanted"))
}
