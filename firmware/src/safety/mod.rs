//! What keeps people and metal safe when the host, the road, a sensor or a battery does not.
//!
//! - [`link`]: a host that falls silent is noticed;
//! - [`collision`]: the wheels do not drive towards an obstacle;
//! - [`latch`]: from boot to run to fault to recovery, the state machine;
//! - [`faults`]: what can go wrong, when it trips and what it stops: the table;
//! - [`channel`]: the monitor of one DC channel, [`board`]: that of batteries, temperatures and
//!   control periods.
//!
//! Limits only limit, faults stop. The monitors are pure and judge one control period after the
//! other; they know no command and drive nothing.

pub mod board;
pub mod channel;
pub mod collision;
pub mod faults;
pub mod latch;
pub mod link;

pub use collision::CollisionGuard;
pub use link::{LinkEvents, LinkWatch};
