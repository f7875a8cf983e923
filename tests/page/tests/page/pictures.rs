//! Screenshots of the page in use, light and dark, 1280 x 720; and no script that fails meanwhile.

use std::time::Duration;

use page::{Desk, until};

use crate::driving::step;

#[test]
fn every_tab_in_light_and_dark_without_an_error_of_a_script() {
    let desk = Desk::open();
    for scheme in ["light", "dark"] {
        desk.prefers(scheme);
        desk.while_driving(4000, |_| {
            // So that more than a line is to be seen.
            std::thread::sleep(Duration::from_secs(2));
            desk.keep_screenshot(&format!("motors-{scheme}"));
        });
        let stops = || desk.notes("STOP: the board has confirmed it");
        let before = stops();
        desk.click("#stop");
        // Until then it refuses to step.
        until("it tells so", || (stops() > before).then_some(()));
        step(&desk);
        desk.keep_screenshot(&format!("tune-{scheme}"));
        for tab in ["settings", "world", "io", "link"] {
            desk.tab(tab);
            let cards = format!("#panel-{tab} .card:not([hidden])");
            until(tab, || (desk.count(&cards) > 1).then_some(()));
            // What is told five times a second has come.
            std::thread::sleep(Duration::from_millis(500));
            desk.keep_screenshot(&format!("{tab}-{scheme}"));
        }
    }
    assert_eq!(desk.errors(), Vec::<String>::new());
}
