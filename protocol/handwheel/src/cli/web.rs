//! `web`: serves the page.

use std::net::TcpListener;
use std::sync::atomic::Ordering;
use std::time::Duration;

use serde_json::json;

use super::{Context, DONE, Outcome};
use crate::auto;
use crate::error::Error;
use crate::link::Link;
use crate::web::{Serve, serve};

/// How soon Ctrl-C is seen.
const TICK: Duration = Duration::from_millis(20);

impl Context<'_, '_> {
    /// Until Ctrl-C.
    pub fn web(&mut self, listen: &str, names: &[String]) -> Outcome {
        let link = match self.link.parse()? {
            Link::Auto => auto::hear()?.link().clone(),
            link => link,
        };
        let listener = TcpListener::bind(listen).map_err(|error| {
            Error::CannotOpen(format!(
                "--listen {listen}: {error}; write an address and a port as 127.0.0.1:5081, port 0 takes a free one"
            ))
        })?;
        self.holds();
        let end = self.io.interrupt.wanted.clone();
        let serving = Serve { listen: listener, link, names: names.to_vec(), world: None };
        let page = serve(serving, end.clone())?;
        self.say(&format!("the page is at {}; Ctrl-C ends it", page.address));
        self.tell(&json!({ "page": page.address }));
        let _ = self.io.out.flush();
        while !end.load(Ordering::Relaxed) {
            std::thread::sleep(TICK);
        }
        page.wait();
        Ok(DONE)
    }
}
