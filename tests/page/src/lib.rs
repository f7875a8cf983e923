//! The page that the virtual board serves, used in a real Chromium, and what that does to a board.
//!
//! - [`board`]: the virtual board's program as a child, its simulated truth, another host on its line;
//! - [`browser`]: a Chromium of its own through chromedriver: keys, clicks, what is seen;
//! - [`Desk`]: both, and what a person does with them.
//!
//! `.ci/chromium` builds the board and runs the tests. It says in `VIRTUAL_BOARD` where the program is. Screenshots,
//! also of a page whose test has failed, are in `target/page/screenshots`. `SABOTAGE=FILE.js` runs a script
//! before those of every page, to see the tests fail:
//! ```js
//! const send = WebSocket.prototype.send; // no signs of life; or no "stop"
//! WebSocket.prototype.send = function (text) { if (!text.includes('"alive"')) send.call(this, text); };
//! ```
//!
//! Waits have generous limits: what is tested is that things happen, not how fast. But a page that drives must
//! say every 250 ms that it is alive, and on a loaded machine Chromium sometimes does not: then the server
//! rightly stops what the page drives. What was to be seen meanwhile is done once more then, three times at most
//! ([`Desk::while_driving`]); what is expected of it stays the same.

pub mod board;
pub mod browser;
mod desk;

pub use desk::{Desk, screenshot_file};

use std::time::{Duration, Instant};

/// How long to wait for anything.
pub const PATIENCE: Duration = Duration::from_secs(60);
/// Between two looks: each takes some of the time in which the page says that it is alive.
pub const GLANCE: Duration = Duration::from_millis(50);

/// Waits until `look` sees something; panics with `what` if it never does.
#[track_caller]
pub fn until<T>(what: &str, mut look: impl FnMut() -> Option<T>) -> T {
    let start = Instant::now();
    loop {
        if let Some(seen) = look() {
            return seen;
        }
        assert!(start.elapsed() < PATIENCE, "it never came: {what}");
        std::thread::sleep(GLANCE);
    }
}
