//! The newest value of something, for readers that do not want to wait.
//!
//! A value is copied while interrupts are off, or it could be half of one and half of the next. For
//! so long control waits, should its period begin just then: what is large is copied in parts.

use core::cell::Cell;
use core::sync::atomic::{AtomicU32, Ordering};

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::RawMutex;

use crate::command::ENCODERS;
use crate::controller::{ControlCounters, EncoderReading, ShownFault, Snapshot};
use crate::ports::{MotionInputs, Outputs, Sensors};
use crate::safety::latch::Latched;

/// The newest value.
pub struct Latest<M: RawMutex, T: Copy>(Mutex<M, Cell<T>>);

impl<M: RawMutex, T: Copy> Latest<M, T> {
    /// With a value to begin with.
    pub const fn new(value: T) -> Self {
        Self(Mutex::new(Cell::new(value)))
    }

    /// The newest value.
    pub fn get(&self) -> T {
        self.0.lock(Cell::get)
    }

    /// Replaces the value.
    pub fn set(&self, value: T) {
        self.0.lock(|cell| cell.set(value));
    }
}

/// The newest [`Snapshot`], in parts of some 60 bytes.
///
/// Whoever reads has no higher priority than who writes: a reader that was interrupted by a new
/// snapshot reads again.
pub struct LatestSnapshot<M: RawMutex> {
    /// Another one for every snapshot; wraps.
    version: AtomicU32,
    motion: Latest<M, (MotionInputs, [EncoderReading; ENCODERS])>,
    sensors: Latest<M, Sensors>,
    outputs: Latest<M, Outputs>,
    state: Latest<M, State>,
}

/// What is left of a snapshot.
#[derive(Clone, Copy)]
struct State {
    link_loss: bool,
    obstacle: bool,
    counters: ControlCounters,
    worst_latency_us: u16,
    faults: Latched,
    shown_fault: ShownFault,
}

impl<M: RawMutex> LatestSnapshot<M> {
    /// Before the first period.
    pub const fn new() -> Self {
        let Snapshot { motion, encoders, sensors, outputs, .. } = Snapshot::BOOT;
        Self {
            version: AtomicU32::new(0),
            motion: Latest::new((motion, encoders)),
            sensors: Latest::new(sensors),
            outputs: Latest::new(outputs),
            state: Latest::new(State::of(&Snapshot::BOOT)),
        }
    }

    /// The newest one.
    pub fn get(&self) -> Snapshot {
        loop {
            let version = self.version.load(Ordering::Acquire);
            let (motion, encoders) = self.motion.get();
            let (sensors, outputs) = (self.sensors.get(), self.outputs.get());
            let State { link_loss, obstacle, counters, worst_latency_us, faults, shown_fault } =
                self.state.get();
            if self.version.load(Ordering::Acquire) == version {
                return Snapshot {
                    motion,
                    encoders,
                    sensors,
                    outputs,
                    link_loss,
                    obstacle,
                    counters,
                    worst_latency_us,
                    faults,
                    shown_fault,
                };
            }
        }
    }

    /// Replaces it.
    pub fn set(&self, snapshot: &Snapshot) {
        self.motion.set((snapshot.motion, snapshot.encoders));
        self.sensors.set(snapshot.sensors);
        self.outputs.set(snapshot.outputs);
        self.state.set(State::of(snapshot));
        self.version.fetch_add(1, Ordering::Release);
    }
}

impl<M: RawMutex> Default for LatestSnapshot<M> {
    fn default() -> Self {
        Self::new()
    }
}

impl State {
    const fn of(snapshot: &Snapshot) -> Self {
        Self {
            link_loss: snapshot.link_loss,
            obstacle: snapshot.obstacle,
            counters: snapshot.counters,
            worst_latency_us: snapshot.worst_latency_us,
            faults: snapshot.faults,
            shown_fault: snapshot.shown_fault,
        }
    }
}
