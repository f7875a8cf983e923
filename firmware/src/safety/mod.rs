//! What keeps people and metal safe when the host, the road, a sensor or a battery does not.
//!
//! - [`link`]: a host that falls silent is noticed;
//! - [`collision`]: the wheels do not drive towards an obstacle;
//! - [`faults`]: what can go wrong, what it stops, and how it ends: the table and the latch;
//! - [`channel`]: the monitor of one DC channel, [`board`]: that of batteries, temperatures and
//!   control periods;

//!
//! Limits only limit, faults stop. The monitors are pure and judge one control period after the
//! other; they know no command and drive nothing.

pub mod board;
pub mod channel;
pub mod collision;
pub mod faults;
pub mod link;

pub use collision::CollisionGuard;
pub use link::{LinkEvent, LinkWatch};
