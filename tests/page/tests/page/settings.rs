//! Settings, and a board that dies.

use page::{Desk, until};

const ROW: &str = "#panel-settings [data-setting='link timeout']";
const ENTER: char = '\u{e007}';

#[test]
fn a_saved_setting_outlasts_the_boards_death_and_the_page_comes_back_disarmed() {
    let mut desk = Desk::open();
    let input = format!("{ROW} input");
    desk.arm();
    desk.tab("settings");
    until("the setting", || (desk.property(&input, "value") == "2000").then_some(()));
    desk.enter(&input, "1500");
    desk.press(ENTER);
    until("it is changed", || (desk.count(&format!("{ROW}.changed")) == 1).then_some(()));
    desk.until_text("#unsaved", "Not saved");
    desk.click("#save");
    desk.until_text("#notes", "Saved:");
    desk.until_text("#unsaved", "All is saved");
    // One that is not saved is lost.
    let other = "#panel-settings [data-setting='velocity Kp 1']";
    desk.enter(&format!("{other} input"), "1");
    desk.press(ENTER);
    until("it is changed", || (desk.count(&format!("{other}.changed")) == 1).then_some(()));

    desk.board.kill();
    desk.until_it_is("online", "no");
    desk.until_text("#faults", "No connection to handwheel");
    assert_eq!(
        (desk.body("armed").as_str(), desk.count("[data-writes]:not(:disabled)")),
        ("no", 0)
    );
    desk.board.start_again();
    desk.until_it_is("online", "yes");
    // Before they are read anew there are none, and before that those of the board that died.
    until("the settings", || {
        let is_lost = desk.count(&format!("{other}:not(.changed)")) == 1;
        let is_kept = desk.count(&format!("{ROW}.changed")) == 1;
        (is_lost && is_kept && desk.property(&input, "value") == "1500").then_some(())
    });
    desk.until_text("#unsaved", "All is saved");
    assert_eq!(desk.body("armed"), "no");
    desk.arm();
}

#[test]
fn a_value_out_of_range_is_refused_and_goes_back() {
    let desk = Desk::open();
    let input = format!("{ROW} input");
    desk.arm();
    desk.tab("settings");
    until("the setting", || (desk.property(&input, "value") == "2000").then_some(()));
    desk.enter(&input, "60001");
    desk.press(ENTER);
    desk.until_text("#notes li.error", "link timeout: a whole number from 0 to 60000 is wanted");
    assert_eq!(desk.property(&input, "value"), "2000");
    assert_eq!(desk.count(&format!("{ROW}.changed")), 0);
}
