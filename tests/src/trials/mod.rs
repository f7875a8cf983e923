//! Trials: things of ours under whatever can befall them, and what holds all the while.
//!
//! Vocabulary: a *trial* plays one thing by [`Choices`] and panics when a promise is broken. The choices
//! come from a fuzzer, which sees what they reach (`tests/fuzz`, `.ci/fuzz`), or from a seed. What is
//! chosen is a grammar's, not noise: frames and commands of the manuals, and what a line, a world and
//! a power supply do to them.

pub mod arm;
mod asked;
mod board;
mod choices;
pub mod cm5;
mod files;
mod formats;
mod host;
mod model;
pub mod pms5005;
mod reception;
mod store;
mod watched;
mod world;

pub use choices::Choices;

/// Plays one thing.
pub type Trial = fn(&mut Choices);

/// All of them, by name.
pub const ALL: [(&str, Trial); 7] = [
    ("receivers", reception::trial),
    ("formats", formats::trial),
    ("pms5005", pms5005::trial),
    ("arm", arm::trial),
    ("cm5", cm5::trial),
    ("store", store::trial),
    ("files", files::trial),
];
