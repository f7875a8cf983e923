//! A week of the virtual board: random hosts, damaged lines, jammed shafts, pulled plugs, tasks that
//! hang and power that fails, from fixed seeds; and what holds in every period of it
//! (`tests::trials`). The whole week takes an hour of a core:
//!
//! ```text
//! cargo test -p tests --test week -- --ignored --nocapture
//! ```

use std::thread;

use firmware::safety::faults::Fault;
use tests::trials::Choices;
use tests::trials::pms5005::{Seen, Trial};

/// Plays so many hours by this seed.
fn hours(seed: u64, hours: f64) -> Seen {
    let mut choices = Choices::seeded(seed);
    let mut trial = Trial::new(&mut choices);
    while (trial.seen().ms as f64) < hours * 3_600_000.0 {
        trial.go_on(&mut choices);
    }
    trial.end();
    trial.seen()
}

/// Plays hours of several seeds at once, and tells what was seen.
fn play(seeds: std::ops::Range<u64>, each: f64) -> Seen {
    let seen: Vec<_> = thread::scope(|scope| {
        let all: Vec<_> = seeds.map(|seed| scope.spawn(move || hours(seed, each))).collect();
        all.into_iter().map(|one| one.join().unwrap()).collect()
    });
    for seen in &seen {
        println!("{seen:?}");
    }
    for fault in Fault::ALL {
        let times: u32 = seen.iter().map(|seen| seen.faults[usize::from(fault.number())]).sum();
        println!("{fault:?}: {times} times");
    }
    seen[0]
}

#[test]
fn no_period_of_an_hour_breaks_a_promise() {
    play(1..3, 0.5);
}
