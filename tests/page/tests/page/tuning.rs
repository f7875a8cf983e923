//! Checking and tuning by itself.

use page::{Desk, until};

/// How often it is tried, if the page does not answer meanwhile: see the crate.
const TRIES: usize = 3;
const KP: &str = "#panel-tune [data-setting='velocity Kp 1']";
const FOUND: &str = "#tuned-settings tbody tr:first-child td:last-child";

/// Has motor 1 tuned from the page.
fn tune(desk: &Desk) {
    for _ in 0..TRIES {
        let before = desk.absences();
        desk.arm();
        desk.tab("tune");
        until("its settings", || (desk.count(KP) == 1).then_some(()));
        desk.click("#self-tune");
        let question = desk.until_text("#self-question", "Motor 1 turns freely both ways");
        assert!(question.contains("no more than 50 % duty"), "{question}");
        desk.click("#self-yes");
        desk.until_text("#job", "Motor 1, tune: ");
        let is_tuned = until("it is tuned", || {
            if desk.property("#tuned", "hidden") == false {
                return Some(true);
            }
            (desk.absences() > before).then_some(false)
        });
        if is_tuned {
            return;
        }
    }
    panic!("{TRIES} were ended, since the page did not answer");
}

#[test]
fn a_motor_that_is_tuned_from_the_page_has_its_gains_once_they_are_applied() {
    let desk = Desk::open();
    desk.tab("tune");
    assert_eq!(desk.property("#self-tune", "disabled"), true);
    tune(&desk);
    desk.until_text("#in-force", "What was before is in force");
    desk.until_text("#wiring", "Wiring as it should be");
    let input = || desk.property(&format!("{KP} input"), "value");
    let (before, found) = (input(), desk.text(FOUND));
    assert_ne!(before, found);
    assert_eq!(desk.count(&format!("{KP}.changed")), 0);
    // A curve is drawn: more than the grid's few colours.
    let drawn = "const it = document.querySelector('#tuned-curve');
        return new Set(new Uint32Array(it.getContext('2d').getImageData(0, 0, it.width, it.height).data.buffer)).size;";
    assert!(desk.js(drawn, &[]).as_u64().unwrap() > 10);
    desk.keep_screenshot("tuned");
    desk.arm();
    desk.click("#self-apply");
    desk.until_text("#in-force", "What was found is in force");
    assert_eq!(input(), found);
    desk.click("#self-back");
    desk.until_text("#in-force", "What was before is in force");
    assert_eq!(input(), before);
    desk.click("#self-apply");
    desk.until_text("#in-force", "What was found is in force");
    desk.click("#self-save");
    desk.until_text("#notes", "Saved:");
    assert_eq!(desk.errors(), Vec::<String>::new());
}
