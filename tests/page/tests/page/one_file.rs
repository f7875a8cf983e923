//! The virtual board and its page as one file, opened from the disk: no server, no other program.

use std::ops::Deref;
use std::time::{Duration, Instant};

use page::browser::Browser;
use page::{GLANCE, until};
use serde_json::{Value, json};

use crate::lcd;

const ENTER: char = '\u{e007}';
const GUARD: &str = "#panel-settings [data-setting='collision protection']";

/// Within what time after it is opened a motor turns.
const FIRST_MOTION: Duration = Duration::from_secs(5);

struct Page(Browser);

impl Deref for Page {
    type Target = Browser;

    fn deref(&self) -> &Browser {
        &self.0
    }
}

impl Page {
    /// Opens the file in a browser that has kept nothing, and waits until the board answers.
    #[track_caller]
    fn open() -> Self {
        let page = Self(Browser::start());
        page.load();
        page
    }

    #[track_caller]
    fn load(&self) {
        let file = std::env::var("ONE_FILE").expect("ONE_FILE: run .ci/chromium");
        self.open(&format!("file://{file}"));
        self.until_it_is("online", "yes");
    }

    #[track_caller]
    fn drive(&self, motor: usize, velocity: i32) {
        self.tab("motors");
        self.0
            .enter(&format!("[data-motor='{motor}'] [data-value=velocity]"), &velocity.to_string());
        self.click(&format!("[data-motor='{motor}'] [data-do=velocity]"));
    }

    /// The simulated truth, as the page was told it last.
    #[track_caller]
    fn truth(&self) -> Value {
        self.js_async("const { told } = await import('link.js'); return told('world')?.state;")
    }

    #[track_caller]
    fn velocity(&self) -> f64 {
        self.truth()["motors"][0]["velocity"].as_f64().unwrap_or(0.0)
    }
}

#[test]
fn it_says_what_it_is_and_a_motor_turns_within_five_seconds() {
    let page = Page(Browser::start());
    let took = (0..3).map(|_| {
        let begun = Instant::now();
        page.load();
        page.arm();
        page.drive(1, 4000);
        until("motor 1 turns", || (page.velocity() > 100.0).then_some(()));
        begun.elapsed()
    });
    let longest = took.max().unwrap();
    println!("first motion {} ms after the file is opened", longest.as_millis());
    assert!(longest < FIRST_MOTION, "{longest:?}");
    assert!(page.text("#simulation").contains("A simulation."));
    assert!(page.text("#simulation details").contains("handwheel web"));
    std::fs::write(page::screenshot_file("one-file"), page.screenshot()).unwrap();
    page.click("#stop");
    until("it stands", || (page.velocity() == 0.0).then_some(()));
    assert_eq!(page.errors(), [""; 0]);
}

#[test]
fn an_obstacle_stops_it_and_what_is_saved_is_there_when_it_is_opened_again() {
    let page = Page::open();
    page.arm();
    page.tab("settings");
    let value = || page.property(&format!("{GUARD} input"), "value");
    until("the setting", || (value() == "0").then_some(()));
    page.enter(&format!("{GUARD} input"), "1");
    page.press(ENTER);
    until("it is changed", || (page.count(&format!("{GUARD}.changed")) == 1).then_some(()));

    page.tab("world");
    page.enter("#wall", "100");
    page.click("#wall-set");
    page.until_text("#panel-world .now", "A wall is 100 cm ahead");
    let drawn = |what: &str| {
        page.js(&format!("return document.querySelector('.scene {what}').style.transform;"), &[])
    };
    let (wall, wheel) = (drawn(".wall"), drawn("g .hand"));
    page.drive(1, 4000);
    page.until_text("[data-reason='1']", "obstacle");
    until("it stands", || (page.velocity() == 0.0).then_some(()));
    let left = page.truth()["wall_cm"].as_f64().unwrap();
    assert!((5.0..31.0).contains(&left), "{left} cm before the wall");
    page.tab("world");
    until("it is drawn so", || (drawn(".wall") != wall && drawn("g .hand") != wheel).then_some(()));
    std::fs::write(page::screenshot_file("world"), page.screenshot()).unwrap();
    page.tab("motors");
    page.click("[data-motor='1'] [data-do=off]");

    page.tab("settings");
    page.until_text("#unsaved", "Not saved");
    page.click("#save");
    page.until_text("#unsaved", "All is saved");
    page.load();
    page.tab("settings");
    until("the setting", || (value() == "1").then_some(()));
    page.until_text("#unsaved", "All is saved");
    assert_eq!(page.truth()["wall_cm"], Value::Null, "the world is a new one");
    assert_eq!(page.errors(), [""; 0]);
}

#[test]
fn what_cannot_be_kept_is_said_and_what_was_damaged_is_as_never_saved() {
    let page = Page::open();
    page.js(
        "localStorage.setItem('virtual-board pms5005', '%%%');
         Storage.prototype.setItem = () => { throw new Error('full'); };",
        &[],
    );
    page.arm();
    page.tab("settings");
    until("the setting", || {
        (page.property(&format!("{GUARD} input"), "value") == "0").then_some(())
    });
    page.enter(&format!("{GUARD} input"), "1");
    page.press(ENTER);
    page.until_text("#unsaved", "Not saved");
    page.click("#save");
    page.until_text("#simulation-alert", "storage is full or forbidden");
    page.load();
    page.tab("settings");
    until("the setting", || {
        (page.property(&format!("{GUARD} input"), "value") == "0").then_some(())
    });
}

#[test]
fn a_picture_comes_to_the_lcd() {
    let page = Page::open();
    page.arm();
    page.tab("io");
    let file = std::env::temp_dir().join(format!("one-file-{}.bmp", std::process::id()));
    std::fs::write(&file, lcd::bmp()).unwrap();
    page.type_into("#picture", file.to_str().unwrap());
    page.until_text("#panel-io", "Not sent yet");
    std::fs::remove_file(&file).unwrap();
    page.click("#send-lcd");
    let shown = || lcd::held(page.truth()["lcd"].as_str().unwrap());
    until("the picture", || (shown() == lcd::picture()).then_some(()));
}

#[test]
fn in_a_hidden_tab_the_boards_time_stands() {
    let page = Page::open();
    page.arm();
    page.drive(1, 4000);
    until("motor 1 turns", || (page.velocity() > 3000.0).then_some(()));
    let window = page.window();
    let board_ms = || page.truth()["t_ms"].as_u64().unwrap();
    let before = board_ms();
    page.new_tab();
    std::thread::sleep(Duration::from_millis(4000));
    page.switch_to(&window);
    let passed = board_ms() - before;
    assert!(passed < 2000, "{passed} ms of the board's time");
    until("the page goes on", || (page.velocity() == 0.0).then_some(()));
    // What it drove was stopped when it was hidden, and nothing had fallen silent meanwhile.
    let truth = page.truth();
    assert_eq!((&truth["link"]["links_lost"], page.body("armed").as_str()), (&json!(0), "no"));
}

#[test]
fn another_controller_is_chosen_and_the_choice_is_kept() {
    let page = Page::open();
    page.js("const which = document.querySelector('#simulation-which'); which.value = 'cm5'; which.dispatchEvent(new Event('change'));", &[]);
    until("a CM-5", || (page.text("#title") == "CM-5, simulated").then_some(()));
    page.js("location.reload();", &[]);
    until("a CM-5", || (page.count("[data-id='6']") == 1).then_some(()));
    page.js("const which = document.querySelector('#simulation-which'); which.value = 'pioneer-arm'; which.dispatchEvent(new Event('change'));", &[]);
    until("an arm", || (page.count("[data-joint='6']") == 1).then_some(()));
    assert_eq!(page.errors(), [""; 0]);
}

#[test]
fn a_board_that_panics_says_why_and_starts_anew() {
    let page = Page::open();
    page.js_async(
        "const { Board } = await import('instance.mjs');
         const { hear } = Board.prototype;
         Board.prototype.hear = () => { Board.prototype.hear = hear; throw new Error('planted'); };",
    );
    page.until_text("#simulation-alert", "without what was not saved: planted");
    std::thread::sleep(GLANCE);
    page.until_it_is("online", "yes");
    page.arm();
    page.drive(1, 4000);
    until("motor 1 turns", || (page.velocity() > 100.0).then_some(()));
}
