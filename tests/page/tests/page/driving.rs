//! Motors: driven, drawn, stopped.

use std::ops::Range;
use std::time::{Duration, Instant};

use page::{Desk, GLANCE, until};
use serde_json::json;

/// Of one line on a canvas, by the canvas's selector, its colour's name and a range of columns: the highest
/// and the lowest row of its pixels in the first columns, in the last, and in all.
const LINE: &str = "
    const [selector, name, left, right] = arguments;
    const canvas = document.querySelector(selector);
    const probe = document.createElement('canvas').getContext('2d');
    probe.fillStyle = getComputedStyle(document.documentElement).getPropertyValue(name).trim();
    probe.fillRect(0, 0, 1, 1);
    const wanted = probe.getImageData(0, 0, 1, 1).data;
    const { width, height, data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
    const found = [];
    for (let x = left; x < Math.min(right, width); x += 1) {
      for (let y = 0; y < height; y += 1) {
        const at = 4 * (y * width + x);
        const off = Math.abs(data[at] - wanted[0]) + Math.abs(data[at + 1] - wanted[1]) + Math.abs(data[at + 2] - wanted[2]);
        if (off < 20 && data[at + 3] > 200) found.push([x, y]);
      }
    }
    if (!found.length) return null;
    const rows = (isIn) => found.filter(([x]) => isIn(x)).map(([, y]) => y);
    const parts = [rows((x) => x < found[0][0] + 10), rows((x) => x > found.at(-1)[0] - 10), rows(() => true)];
    return parts.map((those) => those.reduce(([top, bottom], y) => [Math.min(top, y), Math.max(bottom, y)], [height, 0]));";

/// Top and bottom: in the first columns, in the last, in all. None if nothing is drawn.
fn line(desk: &Desk, canvas: &str, color: &str, columns: Range<u32>) -> Option<[[i64; 2]; 3]> {
    let arguments = [json!(canvas), json!(color), json!(columns.start), json!(columns.end)];
    serde_json::from_value(desk.js(LINE, &arguments)).unwrap()
}

/// Motor 1's velocity on its strip chart.
fn velocity_line(desk: &Desk) -> Option<[[i64; 2]; 3]> {
    line(desk, "[data-motor='1'] canvas", "--value", 0..10_000)
}

/// The curve of a step, and how many of its columns are scales.
const CURVE: &str = "#step-curve";
const SCALES: u32 = 52;

const PICTURE: &str = "return document.querySelector('[data-motor=\"1\"] canvas').toDataURL();";

const SPACE: char = ' ';

/// Whether the curve begins low, ends high, and both are so calm that it is no noise.
fn has_risen(desk: &Desk) -> bool {
    velocity_line(desk).is_some_and(|[first, last, _]| {
        first[1] - first[0] < 6 && last[1] - last[0] < 6 && last[1] + 30 < first[0]
    })
}

#[test]
fn an_armed_page_drives_a_motor_to_4000_counts_a_second_and_its_curve_moves() {
    let desk = Desk::open();
    desk.tab("motors");
    until("a curve", || velocity_line(&desk));
    assert!(!has_risen(&desk));
    desk.while_driving(4000, |was_absent| {
        until("the curve rises", || (has_risen(&desk) || was_absent()).then_some(()));
        let before = desk.js(PICTURE, &[]);
        until("the curve moves on", || (desk.js(PICTURE, &[]) != before).then_some(()));
        let number = |name: &str| {
            desk.text(&format!("[data-motor='1'] [data-number={name}]")).parse().unwrap_or(0.0)
        };
        until("the numbers", || {
            let (set_point, velocity): (f64, f64) = (number("set_point"), number("velocity"));
            let is_so = set_point == 4000.0 && (velocity - 4000.0).abs() < 200.0;
            (is_so || was_absent()).then_some(())
        });
    });
    desk.click("[data-motor='1'] [data-do=off]");
    desk.board.until_it_stands();
}

#[test]
fn the_space_bar_stops_whatever_has_the_focus() {
    let desk = Desk::open();
    let places = [
        ("motors", "body"),
        ("settings", "#filter"),
        ("motors", "[data-motor='1'] [data-do=velocity]"),
    ];
    for (tab, focus) in places {
        let stops = desk.while_driving(4000, |was_absent| {
            desk.tab(tab);
            // A try before may have typed into it, disarmed.
            desk.js("document.querySelector('#filter').value = '';", &[]);
            desk.js(
                "document.activeElement.blur(); document.querySelector(arguments[0]).focus();",
                &[json!(focus)],
            );
            let before = desk.notes("STOP: ");
            desk.press(SPACE);
            desk.board.until_it_stands();
            until("it tells so", || {
                let more = desk.notes("STOP: ") - before;
                (more > 0 || was_absent()).then_some(more)
            })
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
    let [_, _, [top, bottom]] = line(&desk, CURVE, "--value", SCALES..10_000).expect("a curve");
    assert!(bottom - top > 80, "{top} to {bottom}");
    // The duty's scale is written in its colour, from 100 % to -100 %. It takes some 27 % to run: at the end it
    // stands above the middle, and far from the upper end.
    let [_, _, [full, back]] = line(&desk, CURVE, "--duty", 0..SCALES).expect("a scale");
    let [_, [_, duty], _] = line(&desk, CURVE, "--duty", SCALES..10_000).expect("a duty");
    let percent = 100 * (full + back - 2 * duty) / (back - full);
    assert!((10..50).contains(&percent), "{percent} % of {full} to {back}");
}

/// A step of motor 1 to 4000 counts/s, and its figures.
pub fn step(desk: &Desk) {
    for _ in 0..3 {
        desk.arm();
        desk.tab("tune");
        let before = desk.absences();
        desk.click("#step");
        until("the step's end", || {
            (!desk.attribute("#step", "class").contains("busy")).then_some(())
        });
        if desk.absences() > before {
            // The server has ended it, since the page did not answer: see the crate.
            continue;
        }
        let script = "return [...document.querySelectorAll('#step-figures tr td:nth-of-type(1)')].map((td) => td.textContent);";
        let figures: Vec<String> = serde_json::from_value(desk.js(script, &[])).unwrap();
        let [_, target, rise, overshoot, settling, ..] = &figures[..] else {
            panic!("{figures:?}")
        };
        assert_eq!(target, "4000 counts/s");
        assert!(rise.ends_with(" ms") && settling.ends_with(" ms"), "{figures:?}");
        assert!(overshoot.ends_with(" %"), "{figures:?}");
        return;
    }
    panic!("no step came to its end");
}
