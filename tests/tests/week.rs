//! A week of the virtual boards: random hosts, damaged lines, jammed shafts, pulled plugs, tasks that
//! hang and power that fails, from fixed seeds; and what holds in every millisecond of it
//! (`tests::trials`). In CI it is an hour; the week takes a quarter of an hour of a core:
//!
//! ```text
//! cargo test -p tests --test week -- --ignored --nocapture
//! ```

use std::ops::Range;
use std::thread;

use firmware::safety::faults::Fault;
use tests::trials::pms5005::Seen;
use tests::trials::{Choices, arm, cm5, pms5005};

const HOUR_MS: u64 = 3_600_000;

/// Plays a PMS5005 for so many milliseconds by each of these seeds.
fn play(seeds: Range<u64>, ms: u64) -> Vec<Seen> {
    let one = |seed| {
        let mut choices = Choices::seeded(seed);
        let mut trial = pms5005::Trial::new(&mut choices);
        while trial.seen().ms < ms {
            trial.go_on(&mut choices);
        }
        trial.end();
        trial.seen()
    };
    let seen: Vec<_> = thread::scope(|scope| {
        let named = |seed| thread::Builder::new().name(format!("seed {seed}"));
        let all: Vec<_> = seeds
            .map(|seed| named(seed).spawn_scoped(scope, move || one(seed)).expect("a thread"))
            .collect();
        all.into_iter().map(|one| one.join().expect("a seed's promise is broken")).collect()
    });
    for seen in &seen {
        println!("{seen:?}");
    }
    seen
}

/// How often a fault has tripped in all of them.
fn times(seen: &[Seen], fault: Fault) -> u32 {
    seen.iter().map(|seen| seen.faults[usize::from(fault.number())]).sum()
}

#[test]
fn no_millisecond_of_an_hour_breaks_a_promise() {
    let seen = play(1..3, HOUR_MS / 2);
    for seen in &seen {
        let ([frames, damaged], [acks, told]) = (seen.sent, seen.heard);
        assert!(frames > 30_000 && damaged > 3000 && acks > 30_000 && told > 100_000, "{seen:?}");
        let [starts, _] = seen.starts_and_saves;
        assert!(starts > 5, "{seen:?}");
    }
    for fault in [Fault::LinkLoss, Fault::SensorLost, Fault::TrackingError, Fault::DriverTooHot] {
        assert!(times(&seen, fault) > 10, "no chaos: {fault:?}");
    }
}

#[test]
fn no_millisecond_of_an_arms_half_hour_breaks_a_promise() {
    let mut choices = Choices::seeded(1);
    let mut trial = arm::Trial::new(&mut choices);
    while trial.ms() < HOUR_MS / 2 {
        trial.go_on(&mut choices);
    }
    trial.end();
}

#[test]
fn no_millisecond_of_a_cm5s_minutes_breaks_a_promise() {
    // A servo that is lost to a damaged bus may be told nothing for long: each minute is another board's.
    for seed in 1..6 {
        let mut choices = Choices::seeded(seed);
        let mut trial = cm5::Trial::new(&mut choices);
        while trial.ms < 60_000 {
            trial.go_on(&mut choices);
        }
        trial.end();
    }
}

#[test]
#[ignore = "a quarter of an hour of a core"]
fn no_millisecond_of_a_week_breaks_a_promise() {
    let seen = play(1..5, 42 * HOUR_MS);
    for &fault in Fault::ALL {
        let times = times(&seen, fault);
        println!("{fault:?}: {times} times");
        // The rarest, overload, comes nine times. No trial damages the flash of a board that is on.
        assert!(times >= 5 || fault == Fault::SettingsCorrupt, "no chaos: {fault:?} {times} times");
    }
}
