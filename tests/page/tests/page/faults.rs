//! What is wrong, in words; and the world that makes it so.

use page::{Desk, until};
use serde_json::{Value, json};

#[test]
fn a_jam_set_on_the_page_shows_as_a_fault_in_words_until_it_is_cleared() {
    let desk = Desk::open();
    desk.until_text("#faults", "No faults");
    desk.tab("world");
    desk.click("[data-jam='1']");
    until("the jam", || (desk.attribute("[data-jam='1']", "aria-pressed") == "true").then_some(()));

    // By its number, 2: the board may also record that its host fell silent, which is another fault.
    const STALL: &str = "#faults [data-fault='2']";
    let has_stalled = |truth: &Value| truth["faults"].to_string().to_lowercase().contains("stall");
    desk.drive_until(4000, has_stalled);
    desk.until_text(STALL, "Motor 1: stall");
    let remedy = desk.text(&format!("{STALL} span"));
    assert!(remedy.contains("free it"), "{remedy:?}");
    desk.board.until_it_stands();

    desk.tab("world");
    desk.click("[data-jam='1']");
    until("no jam", || (desk.attribute("[data-jam='1']", "aria-pressed") == "false").then_some(()));
    desk.arm();
    assert_eq!(desk.count(STALL), 1, "a fault stays until it is cleared");
    desk.click(&format!("{STALL} [data-do=clear]"));
    until("it is gone", || (desk.count(STALL) == 0).then_some(()));
    assert!(!has_stalled(&desk.board.truth()));
    // Nothing has started it again, and it can be driven.
    assert!(desk.board.stands());
    desk.drive(4000);
}

#[test]
fn what_comes_from_a_board_is_text_and_never_markup() {
    let desk = Desk::open();
    // No board says such things: they are put where the socket puts what is told.
    let markup = "<img src=x onerror='document.body.dataset.evil=1'><b class=evil>bold</b>";
    let fault = json!({ "tell": "faults", "faults": [{ "number": 9, "name": markup, "whose": markup, "motor": 1,
        "ms": 1, "remedy": markup, "values": [[markup, 1]] }] });
    let setting = json!({ "name": markup, "group": markup, "value": 1, "default": 0, "low": 0, "high": 9, "unit": markup });
    let settings = json!({ "tell": "settings", "settings": [setting], "unsaved": true });
    let note = json!({ "tell": "note", "text": markup });
    let board = json!({ "tell": "board", "link": markup, "connected": true, "kind": "pms5005", "title": markup,
        "firmware": markup, "extension": markup, "start": markup, "origin": markup, "has_state": true, "is_virtual": true });
    for tell in [&fault, &settings, &note, &board] {
        desk.js_async(&format!("const {{ tell }} = await import('/link.js'); const told = {tell}; tell(told.tell, told);"));
    }
    for place in ["#notes", "#title", "#link"] {
        desk.until_text(place, markup);
    }
    assert!(desk.text("#panel-settings").contains(markup));
    assert_eq!(desk.count(".evil, img"), 0);
    assert_eq!(desk.body("evil"), "");
}
