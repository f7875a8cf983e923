//! Roll call: the controller's tasks watch each other, and one that hangs takes the board down.
//!
//! Control calls the roll every period, on its own executor above the others, and drives nothing
//! any more when one of them has been silent for `LONGEST_SILENCE`. Supervision, in the thread,
//! sees whether control still calls; if not, it makes the board safe in its place. It cannot while
//! control is in a loop: for that a board has an exception above control (`board::heartbeat`).
//! Whoever has hung once is not trusted again: the watchdog is fed no more.
//!
//! | hangs | outputs are off | by |
//! |---|---|---|
//! | a task but control, or its executor | within 91 ms | control |
//! | control, waiting for what never comes | within 80 ms | supervision |
//! | control, in a loop without end | within 80 ms | the board |
//! | whoever, in a loop where no exception comes through | with the reset | the watchdog |
//!
//! None comes through critical sections, and embassy's interrupt handlers are as high; ours in both
//! are a few instructions.
//!
//! The reset comes [`WATCHDOG_PERIOD`](super::WATCHDOG_PERIOD) after the watchdog was fed last, and
//! that is before the outputs went off: within 500 ms.

use core::cell::Cell;

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::RawMutex;
use embassy_time::{Duration, Timer};

/// Who must answer, beside control.
#[derive(Clone, Copy)]
pub(super) enum Task {
    Sensors,
    Display,
    Receive,
    Transmit,
    Supervision,
}

const TASKS: usize = 5;

/// Control periods that a task may be silent: a check-in period (50 ms) and the longest turn of
/// work, a ranger's of 40 ms.
const LONGEST_SILENCE: u8 = 90;
/// What stands in place of a silence before a task has answered for the first time: some need
/// longer to begin. One that never does lets the watchdog starve.
const NOT_BEGUN: u8 = u8::MAX;
/// Supervision looks so often, and finds control dead after twice as long at the most.
const LOOK_PERIOD: Duration = Duration::from_millis(40);

/// Who has answered when control called the roll.
pub struct Roll<M: RawMutex>(Mutex<M, Cell<State>>);

#[derive(Clone, Copy)]
struct State {
    /// Control periods since each has answered.
    silence: [u8; TASKS],
    /// Control has called since supervision looked.
    called: bool,
    has_hung: bool,
}

impl<M: RawMutex> Roll<M> {
    pub(super) const fn new() -> Self {
        let silence = [NOT_BEGUN; TASKS];
        Self(Mutex::new(Cell::new(State { silence, called: false, has_hung: false })))
    }

    fn change<T>(&self, change: impl FnOnce(&mut State) -> T) -> T {
        self.0.lock(|cell| {
            let mut state = cell.get();
            let result = change(&mut state);
            cell.set(state);
            result
        })
    }

    /// A task answers.
    pub(super) fn answer(&self, task: Task) {
        self.change(|state| {
            if let Some(silence) = state.silence.get_mut(task as usize) {
                *silence = 0;
            }
        });
    }

    /// Control calls, once a period: whether anything may be driven.
    pub(super) fn call(&self) -> bool {
        self.change(|state| {
            state.called = true;
            for silence in state.silence.iter_mut().filter(|silence| **silence != NOT_BEGUN) {
                if *silence < LONGEST_SILENCE {
                    *silence += 1;
                } else {
                    state.has_hung = true;
                }
            }
            !state.has_hung
        })
    }

    /// Control holds commands back and calls nobody, since who waits for a command to be carried
    /// out has not hung: whether anything may be driven.
    pub(super) fn pause(&self) -> bool {
        self.change(|state| {
            state.called = true;
            !state.has_hung
        })
    }

    /// Supervision looks: whether control is alive, and whether all are.
    fn look(&self) -> (bool, bool) {
        self.change(|state| {
            let called = core::mem::take(&mut state.called);
            let all_begun = !state.silence.contains(&NOT_BEGUN);
            // Before the first look control may not have begun.
            state.has_hung |= !called && all_begun;
            (called || !all_begun, called && all_begun && !state.has_hung)
        })
    }

    /// Calls `feed` as long as nobody has hung, and `make_safe` when control has.
    pub(super) async fn supervise(&self, mut feed: impl FnMut(), mut make_safe: impl FnMut()) -> ! {
        loop {
            self.answer(Task::Supervision);
            Timer::after(LOOK_PERIOD).await;
            let (control_is_alive, all_are) = self.look();
            if !control_is_alive {
                make_safe();
            }
            if all_are {
                feed();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use embassy_sync::blocking_mutex::raw::NoopRawMutex;

    use super::*;

    const ALL: [Task; TASKS] =
        [Task::Sensors, Task::Display, Task::Receive, Task::Transmit, Task::Supervision];

    #[test]
    fn nobody_hangs_while_commands_are_held_back_for_however_long() {
        let roll = Roll::<NoopRawMutex>::new();
        ALL.into_iter().for_each(|task| roll.answer(task));
        for _ in 0..20 {
            for _ in 0..100 {
                assert!(roll.pause());
            }
            assert_eq!(roll.look(), (true, true));
        }
        assert!(roll.call());
    }

    #[test]
    fn who_has_hung_drives_nothing_though_commands_are_held_back() {
        let roll = Roll::<NoopRawMutex>::new();
        ALL.into_iter().for_each(|task| roll.answer(task));
        while roll.call() {}
        assert!(!roll.pause());
    }
}
