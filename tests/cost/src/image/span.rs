//! Time between two places in the program, in ticks of the machine.

use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

use cortex_m_semihosting::hprintln;

use crate::machine::ticks;

/// The interrupt of embassy's timers, which is above control.
pub static ALARM: Span = Span::new();

/// All of them, added up.
pub struct Span {
    began: AtomicU32,
    sum: AtomicU32,
    count: AtomicU32,
    longest: AtomicU32,
}

impl Span {
    /// Nothing yet.
    pub const fn new() -> Self {
        Self {
            began: AtomicU32::new(0),
            sum: AtomicU32::new(0),
            count: AtomicU32::new(0),
            longest: AtomicU32::new(0),
        }
    }

    /// The first place.
    pub fn begin(&self) {
        self.began.store(ticks(), Relaxed);
    }

    /// The second place.
    pub fn end(&self) {
        self.add(self.lasts());
    }

    /// The second place of a span that has begun elsewhere.
    pub fn add(&self, ticks: u32) {
        self.sum.store(self.sum.load(Relaxed) + ticks, Relaxed);
        self.count.store(self.count.load(Relaxed) + 1, Relaxed);
        self.longest.store(self.longest.load(Relaxed).max(ticks), Relaxed);
    }

    /// Forgets all but the longest.
    pub fn reset(&self) {
        self.sum.store(0, Relaxed);
        self.count.store(0, Relaxed);
    }

    /// Since the span has begun.
    pub fn lasts(&self) -> u32 {
        ticks().wrapping_sub(self.began.load(Relaxed))
    }

    /// How many there were since the last time.
    pub fn count(&self) -> u32 {
        self.count.load(Relaxed)
    }

    /// The longest of all.
    pub fn longest(&self) -> u32 {
        self.longest.load(Relaxed)
    }

    /// Says the mean since the last time, as a case.
    pub fn tell(&self, name: &str, units: u32) {
        hprintln!("{} {} {} {}", name, self.sum.load(Relaxed), self.count.load(Relaxed), units);
        self.reset();
    }
}
