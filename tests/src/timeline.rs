//! Scenarios in time: what is seen when, and how long something takes. Times are in ms and begin
//! with the call.

use std::fmt::Debug;

use crate::host::{Board, Host};

/// What the host does while time passes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Link {
    /// A command without effect at once, and every 500 ms.
    Alive,
    /// Nothing.
    Silent,
}

impl<B: Board> Host<B> {
    /// Lets time pass, looking at the board after every millisecond.
    pub fn run_with(&mut self, link: Link, ms: u64, mut look: impl FnMut(&Self)) {
        for k in 0..ms {
            if link == Link::Alive && k % 500 == 0 {
                B::say_alive(self.board.line());
            }
            self.run_ms(1);
            look(self);
        }
    }

    /// Lets time pass while the host stays alive.
    pub fn run_alive_ms(&mut self, ms: u64) {
        self.run_with(Link::Alive, ms, |_| {});
    }

    /// As [`run_alive_ms`](Self::run_alive_ms), looking at the board after every millisecond.
    pub fn run_alive_with(&mut self, ms: u64, look: impl FnMut(&Self)) {
        self.run_with(Link::Alive, ms, look);
    }

    /// A timeline as data: at each of these times, this is what is seen.
    #[track_caller]
    pub fn see<T: PartialEq + Debug>(
        &mut self,
        link: Link,
        what: impl Fn(&Self) -> T,
        timeline: impl IntoIterator<Item = (u64, T)>,
    ) {
        let mut now = 0;
        for (at, expected) in timeline {
            self.run_with(link, at - now, |_| {});
            now = at;
            assert_eq!(what(self), expected, "at {at} ms");
        }
        assert!(now > 0, "an empty timeline");
    }

    /// Lets time pass until something is so: when. It may be so already.
    #[track_caller]
    pub fn until(&mut self, link: Link, most: u64, what: impl Fn(&Self) -> bool) -> u64 {
        self.until_or(link, most, what).unwrap_or_else(|| panic!("still not after {most} ms"))
    }

    /// As [`until`](Self::until), or `None` if it is never so within `most` ms.
    pub fn until_or(&mut self, link: Link, most: u64, what: impl Fn(&Self) -> bool) -> Option<u64> {
        for ms in 0..=most {
            if what(self) {
                return Some(ms);
            }
            if link == Link::Alive && ms % 500 == 0 {
                B::say_alive(self.board.line());
            }
            self.run_ms(1);
        }
        None
    }
}
