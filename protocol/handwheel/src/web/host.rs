//! The board's thread: a panel with a line, pages and the time.
//!
//! The line is open while a page is; who does not look does not talk. One that is gone is opened anew once a
//! second.

use std::collections::HashMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender};
use std::time::{Duration, Instant};

use serde_json::json;

use super::panel::{PageId, Panel};
use super::server::{World, say};
use crate::error::Error;
use crate::link::Link;
use crate::transport::{self, Transport};

/// How long one read of the line waits; nothing is later than that.
const TICK: Duration = Duration::from_millis(5);
/// How often a line is opened anew, and the world told.
const AGAIN: Duration = Duration::from_secs(1);
const WORLD: Duration = Duration::from_millis(200);
/// Messages of pages that are taken in one turn.
const TURN: usize = 64;
/// How long the end waits for what is being stopped.
const END: Duration = Duration::from_secs(2);

/// What comes from the pages.
pub(super) enum Call {
    Open(PageId, SyncSender<String>),
    Said(PageId, String),
    Closed(PageId),
}

struct Host {
    link: Link,
    world: Option<World>,
    panel: Panel,
    pages: HashMap<PageId, SyncSender<String>>,
    line: Option<Box<dyn Transport>>,
    clock: Instant,
    /// When the line is opened next, and the world told.
    again: Duration,
    told: Duration,
}

/// Runs until `end`.
pub(super) fn run(link: Link, world: Option<World>, calls: &Receiver<Call>, end: &AtomicBool) {
    let mut host = Host {
        panel: Panel::new(link.clone(), world.is_some()),
        link,
        world,
        pages: HashMap::new(),
        line: None,
        clock: Instant::now(),
        again: Duration::ZERO,
        told: Duration::ZERO,
    };
    while !end.load(Ordering::Relaxed) {
        // Without a line there is nothing else to wait for.
        let patience = if host.line.is_some() { Duration::ZERO } else { 4 * TICK };
        match calls.recv_timeout(patience) {
            Ok(call) => host.take(call),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => break,
        }
        calls.try_iter().take(TURN).for_each(|call| host.take(call));
        host.go_on();
    }
    host.end();
}

impl Host {
    fn now(&self) -> Duration {
        self.clock.elapsed()
    }

    fn take(&mut self, call: Call) {
        let now = self.now();
        match call {
            Call::Open(page, says) => {
                self.pages.insert(page, says);
                self.panel.open(page);
                (self.again, self.told) = (self.again.min(now), Duration::ZERO);
            }
            Call::Closed(page) => {
                self.pages.remove(&page);
                self.panel.close(page, now);
            }
            Call::Said(page, text) => self.panel.hear(page, &text, now),
        }
    }

    fn go_on(&mut self) {
        let now = self.now();
        if self.pages.is_empty() {
            // What the last page drove is being stopped.
            if self.line.is_some() && self.panel.is_idle() {
                self.write();
                self.line = None;
                self.panel.link_is_gone("not connected".into());
            }
        } else if self.line.is_none() && now >= self.again {
            self.again = now + AGAIN;
            match transport::open(&self.link) {
                Ok(line) => {
                    self.line = Some(line);
                    self.panel.link_is_open(now);
                }
                Err(error) => self.panel.link_is_gone(error.to_string()),
            }
        }
        self.panel.advance(now);
        self.write();
        self.read();
        self.ask_the_world(now);
        while let Some((page, text)) = self.panel.take_message() {
            self.say(page, text);
        }
    }

    /// What pages drove is stopped before the line is closed, unless it is gone.
    fn end(&mut self) {
        let end = self.now() + END;
        let pages: Vec<_> = self.pages.drain().map(|(page, _)| page).collect();
        pages.into_iter().for_each(|page| self.panel.close(page, self.clock.elapsed()));
        while self.line.is_some() && !self.panel.is_idle() && self.now() < end {
            self.panel.advance(self.now());
            self.write();
            self.read();
        }
    }

    fn say(&mut self, page: PageId, text: String) {
        let has_room = self.pages.get(&page).is_none_or(|says| say(says, text));
        if !has_room {
            self.pages.remove(&page);
            self.panel.close(page, self.clock.elapsed());
        }
    }

    fn write(&mut self) {
        while let Some(bytes) = self.panel.take_output() {
            if let Some(line) = &mut self.line
                && let Err(error) = line.write(&bytes)
            {
                self.is_gone(error);
            }
        }
    }

    fn read(&mut self) {
        let Some(line) = &mut self.line else { return };
        let mut buffer = [0; 4096];
        match line.read(&mut buffer, TICK) {
            Ok(count) => {
                let now = self.clock.elapsed();
                self.panel.receive(buffer.get(..count).unwrap_or_default(), now);
            }
            Err(error) => self.is_gone(error),
        }
    }

    fn is_gone(&mut self, error: std::io::Error) {
        self.line = None;
        self.again = self.now() + AGAIN;
        self.panel.link_is_gone(Error::Gone(self.link.to_string(), error).to_string());
    }

    fn ask_the_world(&mut self, now: Duration) {
        let Some(world) = &self.world else { return };
        while let Some((asker, set)) = self.panel.take_world() {
            self.panel.world_answers(asker, world(&json!({ "set": set })));
            self.told = Duration::ZERO;
        }
        if !self.pages.is_empty() && now >= self.told {
            self.told = now + WORLD;
            if let Ok(state) = world(&json!({ "get": "state" })) {
                self.panel.tell_world(&state);
            }
        }
    }
}
