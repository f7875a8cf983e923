//! Motion without I/O: what is asked of a motor, whether it still does that, and whether its shaft stands.
#![cfg_attr(
    not(feature = "io"),
    expect(dead_code, reason = "the client asks more of it than the panel does")
)]

pub(crate) mod shafts;
pub(crate) mod target;
pub(crate) mod watch;
