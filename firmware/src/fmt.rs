//! The log: `defmt` on the target, `log` on a computer, nothing otherwise.
//!
//! Values are formatted with `{}` of `defmt::Format` there and of `Debug` here.

/// Something that a user may want to know when a host misbehaves.
macro_rules! warning {
    ($text:literal $(, $value:expr)*) => {{
        #[cfg(feature = "defmt")]
        ::defmt::warn!($text $(, $value)*);
        #[cfg(all(feature = "log", not(feature = "defmt")))]
        ::log::warn!($text $(, $crate::fmt::Shown(&$value))*);
        #[cfg(not(any(feature = "defmt", feature = "log")))]
        let _ = ($(&$value,)*);
    }};
}
pub(crate) use warning;

/// Shows a value's `Debug` form for `{}`.
#[cfg(all(feature = "log", not(feature = "defmt")))]
pub(crate) struct Shown<'a, T>(pub &'a T);

#[cfg(all(feature = "log", not(feature = "defmt")))]
impl<T: core::fmt::Debug> core::fmt::Display for Shown<'_, T> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        self.0.fmt(f)
    }
}
