//! What a frame or a packet carries: fields one behind the other, both directions.
//!
//! A *field* is a value with a fixed form in DATA: a number (low byte first), a byte that stands
//! for something (`codes!`), several of one kind, or a struct whose fields follow each other in the
//! order in which they are declared (`record!`). That order stands once, for writing and reading.

/// DATA under construction: as long as the longest of any format here.
pub type Data = heapless::Vec<u8, 255>;

/// Why a frame or a packet could not be written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum EncodeError {
    /// More than the format's length can tell, or than its longest frame or packet holds.
    #[error("more than fits: split the command, or shorten its text")]
    TooLong,
    /// The buffer given is shorter than the frame or packet.
    #[error("the buffer is too short for the whole of it")]
    BufferTooShort,
    /// A text holds a NUL, which would end it.
    #[error("a text may not hold a NUL: it ends there")]
    NulInText,
    /// The value has no form on the wire: an empty list, a target out of its range.
    #[error("the value has no form on the wire: see its documented range")]
    NotRepresentable,
}

/// Appends bytes to DATA.
pub(crate) fn append(data: &mut Data, bytes: &[u8]) -> Result<(), EncodeError> {
    data.extend_from_slice(bytes).map_err(|_| EncodeError::TooLong)
}

/// A value with a fixed form in DATA.
pub(crate) trait Field: Sized {
    /// Appends it.
    fn put(&self, data: &mut Data) -> Result<(), EncodeError>;

    /// Takes it from the front of `data`.
    fn take(data: &mut &[u8]) -> Option<Self>;
}

macro_rules! numbers {
    ($($number:ty),+) => {
        $(impl Field for $number {
            fn put(&self, data: &mut Data) -> Result<(), EncodeError> {
                append(data, &self.to_le_bytes())
            }

            fn take(data: &mut &[u8]) -> Option<Self> {
                let (bytes, rest) = data.split_first_chunk()?;
                *data = rest;
                Some(Self::from_le_bytes(*bytes))
            }
        })+
    };
}
numbers!(u8, u16, i16, u32, i32);

impl<T: Field + Copy + Default, const N: usize> Field for [T; N] {
    fn put(&self, data: &mut Data) -> Result<(), EncodeError> {
        self.iter().try_for_each(|field| field.put(data))
    }

    fn take(data: &mut &[u8]) -> Option<Self> {
        let mut fields = [T::default(); N];
        for field in &mut fields {
            *field = T::take(data)?;
        }
        Some(fields)
    }
}

/// A struct whose fields stand on the wire in the order in which they are declared.
macro_rules! record {
    ($(#[$meta:meta])* pub struct $name:ident {
        $($(#[$of_field:meta])* pub $field:ident: $type:ty,)+
    }) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[cfg_attr(feature = "defmt", derive(defmt::Format))]
        pub struct $name { $($(#[$of_field])* pub $field: $type,)+ }

        impl $crate::data::Field for $name {
            fn put(&self, data: &mut $crate::data::Data) -> Result<(), $crate::data::EncodeError> {
                $(self.$field.put(data)?;)+
                Ok(())
            }

            fn take(data: &mut &[u8]) -> Option<Self> {
                Some(Self { $($field: $crate::data::Field::take(data)?),+ })
            }
        }
    };
}
pub(crate) use record;

/// A record of counters, which can be walked by name.
macro_rules! counters {
    ($(#[$meta:meta])* pub struct $name:ident {
        $($(#[$of_field:meta])* pub $field:ident: u32,)+
    }) => {
        $crate::data::record! {
            $(#[$meta])*
            #[derive(Default)]
            pub struct $name { $($(#[$of_field])* pub $field: u32,)+ }
        }

        impl $name {
            /// Each by its name, in their order.
            pub fn named(&self) -> impl Iterator<Item = (&'static str, u32)> {
                [$((stringify!($field), self.$field)),+].into_iter()
            }
        }
    };
}
pub(crate) use counters;

/// Bytes of the wire that stand for one of these.
macro_rules! codes {
    ($(#[doc = $doc:literal])+ $name:ident { $($(#[doc = $what:expr])+ $variant:ident = $number:literal,)+ }) => {
        $(#[doc = $doc])+
        ///
        /// | number | meaning |
        /// |---|---|
        $(#[doc = concat!("| ", $number, " | ", $($what,)+ " |")])+
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[cfg_attr(feature = "defmt", derive(defmt::Format))]
        pub enum $name { $($(#[doc = $what])+ $variant = $number,)+ }

        impl $name {
            /// All of them, in the order of their numbers.
            pub const ALL: &[Self] = &[$(Self::$variant),+];

            /// Its number on the wire.
            pub const fn number(self) -> u8 {
                self as u8
            }

            /// What a number stands for.
            pub const fn from_number(number: u8) -> Option<Self> {
                match number {
                    $($number => Some(Self::$variant),)+
                    _ => None,
                }
            }
        }

        impl $crate::data::Field for $name {
            fn put(&self, data: &mut $crate::data::Data) -> Result<(), $crate::data::EncodeError> {
                self.number().put(data)
            }

            fn take(data: &mut &[u8]) -> Option<Self> {
                u8::take(data).and_then(Self::from_number)
            }
        }
    };
}
pub(crate) use codes;
