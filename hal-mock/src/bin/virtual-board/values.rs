//! Numbers and lists of the inspector's questions: the library's.

pub use hal_mock::inspector::values::*;
