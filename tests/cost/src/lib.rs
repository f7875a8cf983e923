//! What our code costs, beside the best of its peers: the same work for all of them, counted in
//! instructions on a Cortex-M4 (`image`, run by `.ci/cost`) and timed on a computer
//! (`cargo bench -p cost`).
//!
//! Vocabulary: a *case* is one piece of work with a name, `subject/who`; a *peer* is somebody
//! else's way to do it, or the ordinary way; a *floor* is the least that the machine allows,
//! written by hand and of no other use. Where a peer does less than ours, its documentation says
//! so.
//!
//! - [`pid`]: six channels of the controller's kernel;
//! - [`tick`]: the whole controller, one period;
//! - [`reception`]: frames found in a stream, and checksums;
//! - [`sending`]: telemetry put into frames.
//!
//! What needs interrupts and executors is only in the image: `src/image/live.rs`.
#![cfg_attr(not(test), no_std)]

pub mod pid;
pub mod reception;
pub mod sending;
pub mod tick;

/// Whoever counts or times cases.
pub trait Meter {
    /// Runs `work` as often as it wants to. A call does `units` units of work: channels, bytes, or
    /// one of something.
    fn case(&mut self, name: &str, units: usize, work: impl FnMut());
}

/// Every case that needs no executor.
pub fn all(meter: &mut impl Meter) {
    pid::cases(meter);
    tick::cases(meter);
    reception::cases(meter);
    sending::cases(meter);
}
