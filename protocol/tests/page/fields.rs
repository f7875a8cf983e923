//! Where the crate puts a field: what changes in DATA when it alone is filled. And the page's table of
//! bytes beside it.

use protocol::arcos::JointInfo;
use protocol::extension::{
    ChannelState, Fault, Mode, Origin, Phase, Reason, ResetCause, Trigger, Unit, Verdict,
};

use crate::text::table;

/// A row of a table of bytes: which bytes, the field's name, its form.
pub type Row = (String, String, String);

/// A value of which every byte differs from that of 0, and what the page calls its form.
pub trait Filled {
    /// The value.
    fn filled() -> Self;

    /// Its form.
    fn form() -> String;
}

macro_rules! filled {
    ($($type:ty = $value:expr, $form:literal;)+) => {
        $(impl Filled for $type {
            fn filled() -> Self {
                $value
            }

            fn form() -> String {
                $form.into()
            }
        })+
    };
}

filled! {
    u8 = 0x55, "u8";
    u16 = 0x0101, "u16";
    i16 = 0x0101, "i16";
    u32 = 0x0101_0101, "u32";
    i32 = 0x0101_0101, "i32";
    bool = true, "bits";
    Option<u8> = Some(1), "u8";
    Option<u16> = Some(0x0101), "u16";
    Fault = Fault::WatchdogReset, "u8";
    Mode = Mode::Velocity, "u8";
    Origin = Origin::Corrupt, "u8";
    Phase = Phase::Done, "u8";
    Reason = Reason::OldCommand, "u8";
    ResetCause = ResetCause::Watchdog, "u8";
    Trigger = Trigger::Fault, "u8";
    Unit = Unit::Ticks, "u8";
    Verdict = Verdict::Busy, "u8";
    ChannelState = ChannelState {
        position: Filled::filled(),
        velocity: Filled::filled(),
        set_point: Filled::filled(),
        duty: Filled::filled(),
        current: Filled::filled(),
        mode: Filled::filled(),
        reason: Filled::filled(),
        detail: Filled::filled(),
    }, "17 bytes";
    JointInfo = JointInfo::default(), "6 bytes";
}

impl<T: Filled + Copy, const N: usize> Filled for [T; N] {
    fn filled() -> Self {
        [T::filled(); N]
    }

    fn form() -> String {
        format!("{N} x {}", T::form())
    }
}

/// The row of a field, by DATA without it and with it.
pub fn row<T: Filled>(name: &str, empty: &[u8], filled: &[u8], _: &T) -> Row {
    assert_eq!(empty.len(), filled.len(), "{name}");
    let differs = |place: &usize| empty[*place] != filled[*place];
    let places: Vec<_> = (0..empty.len()).filter(differs).collect();
    let (first, last) = (places[0] + 1, places[places.len() - 1] + 1);
    assert_eq!(places.len(), last + 1 - first, "{name} is in one piece");
    let bytes = if first == last { format!("{first}") } else { format!("{first} to {last}") };
    (bytes, name.into(), T::form())
}

/// The rows of some fields: `base`, what makes DATA of it, and of each field its name and its place in the
/// struct.
macro_rules! fields {
    ($base:expr, $encode:expr, $($name:literal = ($($path:tt)+)),+ $(,)?) => {{
        let (base, encode) = ($base, $encode);
        let empty = encode(&base);
        vec![$({
            let mut filled = base;
            filled.$($path)+ = $crate::fields::Filled::filled();
            $crate::fields::row($name, &empty, &encode(&filled), &filled.$($path)+)
        }),+]
    }};
}
pub(crate) use fields;

/// The table of bytes under this heading.
pub fn told(title: &str) -> Vec<Row> {
    let rows = table(title, "bytes");
    rows.iter().map(|row| (row[0].into(), row[1].into(), row[2].into())).collect()
}
