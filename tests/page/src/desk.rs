//! A board, a browser that shows its page, and what a person does with both.

use std::ops::Deref;
use std::panic::Location;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use crate::board::Board;
use crate::browser::Browser;
use crate::until;

/// How often a drive is tried that the server ends because the page "did not answer": see the
/// [crate](crate).
const TRIES: usize = 3;

/// Where a screenshot is kept.
pub fn screenshot_file(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../target/page/screenshots");
    std::fs::create_dir_all(&folder).unwrap();
    folder.join(name).with_extension("png")
}

/// What is seen and done on every page.
impl Browser {
    /// Waits for one of the body's states: `armed`, `online`.
    #[track_caller]
    pub fn until_it_is(&self, name: &str, value: &str) {
        until(&format!("{name}: {value}"), || (self.body(name) == value).then_some(()));
    }

    /// One of the body's states.
    #[track_caller]
    pub fn body(&self, name: &str) -> String {
        self.attribute("body", &format!("data-{name}"))
    }

    /// Chooses a tab.
    #[track_caller]
    pub fn tab(&self, name: &str) {
        self.click(&format!("[data-tab={name}]"));
    }

    /// Waits until a text has something in it; the text.
    #[track_caller]
    pub fn until_text(&self, selector: &str, part: &str) -> String {
        until(&format!("{part:?} in {selector}"), || {
            Some(self.text(selector)).filter(|text| text.contains(part))
        })
    }

    /// How often a note with this text has come.
    #[track_caller]
    pub fn notes(&self, part: &str) -> u64 {
        let script = "return [...document.querySelectorAll('#notes li')]
            .filter((note) => note.dataset.text.includes(arguments[0]))
            .reduce((sum, note) => sum + Number(note.dataset.times), 0);";
        self.js(script, &[json!(part)]).as_u64().unwrap()
    }

    /// Arms this page, if it is not. A board that has just come is asked first how it is.
    #[track_caller]
    pub fn arm(&self) {
        while self.body("armed") != "here" {
            let waits = || self.notes("wait a moment");
            let before = waits();
            self.click("#arm");
            until("it is armed, or asks to wait", || {
                (self.body("armed") == "here" || waits() > before).then_some(())
            });
        }
    }
}

/// A board, and a browser that shows its page. What the browser can do, it can.
pub struct Desk {
    /// The browser; before the board, so that it ends first.
    pub browser: Browser,
    /// The board.
    pub board: Board,
    test: &'static Location<'static>,
}

impl Deref for Desk {
    type Target = Browser;

    fn deref(&self) -> &Browser {
        &self.browser
    }
}

impl Desk {
    /// A new board, and its page when it is connected.
    #[track_caller]
    pub fn open() -> Self {
        let (board, browser) = (Board::start(), Browser::start());
        let desk = Self { browser, board, test: Location::caller() };
        desk.open_page();
        desk
    }

    /// The page in this window, when it is connected.
    #[track_caller]
    pub fn open_page(&self) {
        self.browser.open(&self.board.address());
        self.until_it_is("online", "yes");
    }

    /// How often the server has ended a drive because the page was not heard for 250 ms.
    #[track_caller]
    pub fn absences(&self) -> u64 {
        self.notes("did not answer (a busy computer?)")
    }

    /// Presses motor 1's Drive for a velocity in counts/s.
    #[track_caller]
    pub fn press_drive(&self, velocity: i32) {
        self.tab("motors");
        self.enter("[data-motor='1'] [data-value=velocity]", &velocity.to_string());
        self.click("[data-motor='1'] [data-do=velocity]");
    }

    /// Arms and drives motor 1 at a velocity in counts/s until `is_seen` in the truth; the [`absences`](Self::absences)
    /// before.
    #[track_caller]
    pub fn drive_until(&self, velocity: i32, is_seen: impl Fn(&Value) -> bool) -> u64 {
        for _ in 0..TRIES {
            let before = self.absences();
            self.arm();
            self.press_drive(velocity);
            let is_driven = until("motor 1 is driven", || {
                if is_seen(&self.board.truth()) {
                    return Some(true);
                }
                (self.absences() > before).then_some(false)
            });
            if is_driven {
                return before;
            }
        }
        panic!("{TRIES} drives were ended, since the page did not answer");
    }

    /// The same until motor 1 truly runs so.
    #[track_caller]
    pub fn drive(&self, velocity: i32) -> u64 {
        let wanted = f64::from(velocity);
        self.drive_until(velocity, |truth| {
            let is = truth["motors"][0]["velocity"].as_f64().unwrap();
            (is - wanted).abs() < 0.03 * wanted.abs()
        })
    }

    /// Drives, and does something meanwhile: what it returns, if the drive was not ended before because the page
    /// did not answer. `act` is given what tells whether it was, and must come to its end even then.
    #[track_caller]
    pub fn while_driving<T>(
        &self,
        velocity: i32,
        mut act: impl FnMut(&dyn Fn() -> bool) -> T,
    ) -> T {
        for _ in 0..TRIES {
            let before = self.drive(velocity);
            let was_absent = || self.absences() > before;
            let seen = act(&was_absent);
            if !was_absent() {
                return seen;
            }
        }
        panic!("{TRIES} drives were ended meanwhile, since the page did not answer");
    }

    /// Waits until whatever the page has said so far has been obeyed.
    #[track_caller]
    pub fn until_heard(&self) {
        self.js_async("const { ask } = await import('/link.js'); await ask('settings');");
    }

    /// Keeps a picture of what is in view.
    #[track_caller]
    pub fn keep_screenshot(&self, name: &str) {
        std::fs::write(screenshot_file(name), self.screenshot()).unwrap();
    }
}

impl Drop for Desk {
    fn drop(&mut self) {
        if std::thread::panicking() {
            let file = Path::new(self.test.file()).file_stem().unwrap_or_default();
            let name = format!("failed-{}-{}", file.display(), self.test.line());
            // A second panic would hide the first.
            let picture = || self.keep_screenshot(&name);
            let _ = std::panic::catch_unwind(std::panic::AssertUnwindSafe(picture));
        }
    }
}
