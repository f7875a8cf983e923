//! Who may write, and what becomes of what a page drives when it is gone.

use std::time::{Duration, Instant};

use page::{Desk, until};

#[test]
fn the_page_connects_and_is_disarmed_with_every_control_that_writes_disabled() {
    let desk = Desk::open();
    assert!(desk.text("#link").starts_with("Connected:"), "{}", desk.text("#link"));
    assert_eq!(desk.text("#title"), desk.text("#title").trim());
    assert!(!desk.text("#title").is_empty());
    desk.until_text("#batteries", "V");
    desk.until_text("#faults", "No faults");
    assert_eq!(
        (desk.body("armed").as_str(), desk.attribute("#arm", "aria-checked").as_str()),
        ("no", "false")
    );
    // The settings' inputs are there when the board has told its settings.
    until("settings", || (desk.count("[data-setting]") > 50).then_some(()));
    let controls = desk.count("[data-writes]");
    assert!(controls > 100, "{controls}");
    assert_eq!(desk.count("[data-writes]:not(:disabled)"), 0);
    assert_eq!(desk.property("[data-motor='1'] [data-do=velocity]", "disabled"), true);
    assert_eq!(desk.property("#stop", "disabled"), false);

    desk.arm();
    assert_eq!(desk.count("[data-writes]:disabled:not(#restore)"), 0);
    desk.click("#arm");
    desk.until_it_is("armed", "no");
    assert_eq!(desk.count("[data-writes]:not(:disabled)"), 0);
}

#[test]
fn a_second_page_is_refused_by_the_name_of_the_first() {
    let desk = Desk::open();
    let name = desk.text("#link").rsplit("· ").next().unwrap().to_owned();
    assert!(name.starts_with("page "), "{name}");
    desk.arm();
    let first = desk.window();

    desk.new_window();
    desk.open_page();
    desk.until_it_is("armed", "elsewhere");
    assert_eq!(desk.text("#armed-by"), format!("Armed: {name}. This page only watches"));
    desk.click("#arm");
    let refusal = desk.until_text("#notes li.error", &name);
    assert!(refusal.contains(&format!("{name} is armed: disarm it there first")), "{refusal}");
    assert_eq!(
        (desk.body("armed").as_str(), desk.count("[data-writes]:not(:disabled)")),
        ("elsewhere", 0)
    );

    // Given back there, it can be had here.
    let second = desk.window();
    desk.switch_to(&first);
    assert_eq!(desk.body("armed"), "here");
    desk.click("#arm");
    desk.until_it_is("armed", "no");
    desk.switch_to(&second);
    desk.until_it_is("armed", "no");
    desk.arm();
}

#[test]
fn a_tab_that_is_closed_stops_the_motor_within_a_second() {
    let desk = Desk::open();
    let empty = {
        let page = desk.window();
        desk.new_window();
        let empty = desk.window();
        desk.switch_to(&page);
        empty
    };
    desk.drive(4000);
    let start = Instant::now();
    desk.close_window();
    desk.board.until_it_stands();
    let took = start.elapsed();
    desk.switch_to(&empty);
    assert!(took < Duration::from_secs(1), "{took:?}");
}

#[test]
fn a_tab_that_another_one_hides_stops_the_motor_and_is_disarmed() {
    let desk = Desk::open();
    let page = desk.window();
    desk.drive(4000);
    desk.new_tab();
    desk.board.until_it_stands();
    desk.switch_to(&page);
    desk.until_text("#notes", "This page was hidden or left: it has stopped what it drove");
    desk.until_it_is("armed", "no");
}

#[test]
fn a_page_that_hangs_is_stopped_and_disarmed() {
    let desk = Desk::open();
    // The server's doing, and not the page's: a script keeps the page's own thread busy.
    let before = desk.drive(4000);
    desk.js(
        "setTimeout(() => { for (const end = Date.now() + 3000; Date.now() < end;); }, 0);",
        &[],
    );
    desk.board.until_it_stands();
    until("it tells so", || (desk.absences() > before).then_some(()));
    desk.until_it_is("armed", "no");
}
