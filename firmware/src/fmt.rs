//! The log: `defmt` on the target, `log` on a computer, nothing otherwise.
//!
//! `{}` is `defmt::Format` there and `Display` here, in words; `{:?}` is `Debug` here.

/// Something that a user may want to know when a host misbehaves.
macro_rules! warning {
    ($text:literal $(, $value:expr)*) => {{
        #[cfg(feature = "defmt")]
        ::defmt::warn!($text $(, $value)*);
        #[cfg(all(feature = "log", not(feature = "defmt")))]
        ::log::warn!($text $(, $value)*);
        #[cfg(not(any(feature = "defmt", feature = "log")))]
        let _ = ($(&$value,)*);
    }};
}
pub(crate) use warning;
