//! The page of the wire, `protocol/README.md`, against the crate: each example is encoded from its meaning
//! and decoded, and each table of bytes, numbers and codes is compared row by row with what the crate does.
//!
//! The settings' rows are compared in `firmware` (`settings::numbered`), what faults stop in
//! `firmware` (`safety::faults`), their names and remedies in `handwheel` (`words`): there is the code.

mod arcos;
mod cm5;
mod codes;
mod commands;
mod extension;
mod fields;
mod frames;
mod python;
mod text;
mod values;
