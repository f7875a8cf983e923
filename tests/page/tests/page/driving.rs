//! Motors: driven, drawn, stopped.

use std::time::{Duration, Instant};

use page::{Desk, GLANCE, until};
use serde_json::{Value, json};

/// What a chart has of its line of the velocity: the rows of pixels from the highest to the lowest.
const HEIGHT_OF_CURVE: &str = "
    const canvas = document.querySelector('[data-motor=\"1\"] canvas');
    const probe = document.createElement('canvas').getContext('2d');
    probe.fillStyle = getComputedStyle(document.documentElement).getPropertyValue('--value').trim();
    probe.fillRect(0, 0, 1, 1);
    const wanted = probe.getImageData(0, 0, 1, 1).data;
    const { width, height, data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
    const rows = [];
    for (let y = 0; y < height; y += 1) {
      for (let x = 0; x < width; x += 1) {
        const at = 4 * (y * width + x);
        if ([0, 1, 2].every((i) => Math.abs(data[at + i] - wanted[i]) < 8) && data[at + 3] > 200) { rows.push(y); break; }
      }
    }
    return rows.length ? rows.at(-1) - rows[0] + 1 : 0;";

const PICTURE: &str = "return document.querySelector('[data-motor=\"1\"] canvas').toDataURL();";

const SPACE: char = ' ';

fn height_of_curve(desk: &Desk) -> u64 {
    desk.js(HEIGHT_OF_CURVE, &[]).as_u64().unwrap()
}

#[test]
fn an_armed_page_drives_a_motor_to_4000_counts_a_second_and_its_curve_moves() {
    let desk = Desk::open();
    desk.tab("motors");
    let flat = until("a flat curve", || Some(height_of_curve(&desk)).filter(|rows| *rows > 0));
    assert!(flat <= 4, "{flat} rows at rest");
    desk.while_driving(4000, || {
        until("the curve rises", || (height_of_curve(&desk) > 30).then_some(()));
        let before = desk.js(PICTURE, &[]);
        until("the curve moves on", || (desk.js(PICTURE, &[]) != before).then_some(()));
        let number = |name: &str| {
            desk.text(&format!("[data-motor='1'] [data-number={name}]")).parse().unwrap_or(0.0)
        };
        until("the numbers", || {
            let (set_point, velocity): (f64, f64) = (number("set_point"), number("velocity"));
            (set_point == 4000.0 && (velocity - 4000.0).abs() < 200.0).then_some(())
        });
    });
    desk.click("[data-motor='1'] [data-do=off]");
    desk.board.until_it_stands();
}

#[test]
fn the_space_bar_stops_whatever_has_the_focus() {
    let desk = Desk::open();
    let places: [(&str, &str); 3] =
        [("motors", "body"), ("settings", "#filter"), ("motors", "[data-motor='1'] [data-do=velocity]")];
    for (tab, focus) in places {
        let stops = desk.while_driving(4000, || {
            desk.tab(tab);
            desk.js("document.activeElement.blur(); document.querySelector(arguments[0]).focus();", &[json!(focus)]);
            let before = desk.notes("STOP: ");
            desk.press(SPACE);
            desk.board.until_it_stands();
            until("it tells so", || Some(desk.notes("STOP: ") - before).filter(|more| *more > 0))
        });
        assert_eq!(stops, 1, "with the focus in {focus}");
        assert_eq!(desk.body("armed"), "here");
        desk.until_heard();
        assert!(desk.board.stands(), "the key has pressed {focus}");
    }
    assert_eq!(desk.property("#filter", "value"), "", "the key was for the stop alone");
}

/// Whether another host's motor has gone on for a while.
fn goes_on(desk: &Desk) -> bool {
    desk.until_heard();
    let start = Instant::now();
    while start.elapsed() < Duration::from_millis(500) {
        if desk.board.velocity() < 1800.0 {
            return false;
        }
        std::thread::sleep(GLANCE);
    }
    true
}

#[test]
fn on_a_disarmed_page_the_space_bar_is_a_key_like_others_but_stop_stops() {
    let desk = Desk::open();
    let _other = desk.board.other_host_drives();
    desk.until_text("[data-motor='1'] .mode", "another host");
    desk.press(SPACE);
    assert!(goes_on(&desk));
    desk.tab("settings");
    desk.type_into("#filter", "a b");
    assert_eq!(desk.property("#filter", "value"), "a b");
    assert!(goes_on(&desk));
    assert_eq!((desk.notes("STOP"), desk.body("armed").as_str()), (0, "no"));

    desk.click("#stop");
    desk.board.until_it_stands();
    until("it tells so", || (desk.notes("STOP: the board has confirmed it") == 1).then_some(()));
    assert_eq!(desk.body("armed"), "no");
}

#[test]
fn a_step_is_drawn_with_its_figures_and_ends_at_rest() {
    let desk = Desk::open();
    step(&desk);
    desk.board.until_it_stands();
}

/// A step of motor 1 to 4000 counts/s, and its figures: the motor's gains are good for some.
pub fn step(desk: &Desk) {
    let figures = "#step-figures tbody";
    for _ in 0..3 {
        desk.arm();
        desk.tab("tune");
        desk.click("#step");
        let is_over = until("the step's end", || {
            let is_busy = desk.attribute("#step", "class").contains("busy");
            (!is_busy && desk.count("#step:not(:disabled), #step:disabled") == 1).then(|| {
                desk.text(figures).contains("4000 counts/s")
            })
        });
        if is_over {
            let script = "return [...document.querySelectorAll('#step-figures td:nth-of-type(1)')].map((td) => td.textContent);";
            let values: Value = desk.js(script, &[]);
            assert!(values.to_string().contains(" ms"), "{values}");
            return;
        }
        // The server has ended it, since the page did not answer: see the crate.
        assert!(desk.notes("did not answer") > 0, "{}", desk.text("#notes"));
    }
    panic!("no step came to its end");
}
