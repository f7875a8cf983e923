//! A snapshot that is read while the next one comes is one of the two, never a mix.

use std::cell::Cell;

use embassy_sync::blocking_mutex::raw::RawMutex;
use firmware::app::LatestSnapshot;
use firmware::controller::Snapshot;

thread_local! {
    /// Locks left until control interrupts the reader, and the snapshot that it has then.
    static INTERRUPT: Cell<Option<(u32, u16)>> = const { Cell::new(None) };
}

/// Interrupts that are let in between two locks, as on the board.
struct Interrupted;

static LATEST: LatestSnapshot<Interrupted> = LatestSnapshot::new();

// SAFETY: only this file's thread uses it.
unsafe impl RawMutex for Interrupted {
    const INIT: Self = Self;

    fn lock<R>(&self, f: impl FnOnce() -> R) -> R {
        match INTERRUPT.take() {
            Some((0, number)) => LATEST.set(&snapshot(number)),
            Some((left, number)) => INTERRUPT.set(Some((left - 1, number))),
            None => {}
        }
        f()
    }
}

/// A snapshot with the same number in each of its parts.
fn snapshot(number: u16) -> Snapshot {
    let mut snapshot = Snapshot::BOOT;
    snapshot.motion.currents = [number; 6];
    snapshot.encoders[1].count = number;
    snapshot.sensors.battery = [number; 3];
    snapshot.outputs.gpio = number as u8;
    snapshot.counters.periods = number.into();
    snapshot
}

#[test]
fn a_reader_that_is_interrupted_anywhere_has_the_next_snapshot_whole() {
    let mut number = 0;
    LATEST.set(&snapshot(number));
    let mut interruptions = 0;
    for locks in 0..8 {
        INTERRUPT.set(Some((locks, number + 1)));
        let read = LATEST.get();
        interruptions += u32::from(INTERRUPT.take().is_none());
        number = read.motion.currents[0];
        assert_eq!(read, snapshot(number), "interrupted before lock {locks}");
    }
    assert_eq!((number, interruptions), (4, 4), "a snapshot has four parts");
}
