//! Motion without I/O: what is asked of a motor, whether it still does that, and whether its shaft stands.

pub(crate) mod shafts;
pub(crate) mod target;
pub(crate) mod watch;
