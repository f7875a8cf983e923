//! Offers the host's line of the modelled chip over TCP:
//!     .ci/chip serve [IMAGE [PORT]]
fn main() {}
