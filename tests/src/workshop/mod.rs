//! A workshop with 200 drives that nobody who writes a tuner has seen, and a bench that judges what tuning
//! makes of them (`benches/tuning.rs`).
//!
//! ```text
//!   plant ──> motor, encoder          what is true, and what is wrong
//!     └─────> rig ──> firmware, line, Session <── tuner
//!              └────> judge           what the loop makes of a step, by the shaft's true speed
//! ```
//!
//! - [`plant`]: how the drives are drawn, and for which of them K and tau are defined;
//! - [`motor`], [`encoder`]: their physics;
//! - [`rig`]: one of them under the firmware's own tasks, with a host on the line;
//! - [`tuner`]: the one call of the tuner;
//! - [`judge`]: overshoot, settling, steady error, and how noise is treated.
//!
//! The model is not that of [`foreign`](crate::foreign) nor that of `hal_mock::plant`, and shares no code with
//! them. **Whoever writes the tuner reads [`rig`], [`tuner`] and [`judge`] at most.**

pub mod encoder;
pub mod judge;
pub mod motor;
pub mod plant;
pub mod random;
pub mod rig;
pub mod tuner;
