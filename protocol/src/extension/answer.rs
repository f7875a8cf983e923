//! What the board tells through the [extension](crate#the-extension), both directions.

use super::did;
use super::fault::FaultRecord;
use super::recorder::{Block, Recording};
use super::state::MachineState;
use crate::data::{Data, EncodeError, Field, append, codes, counters, record};

codes! {
    /// What a setting's value counts (byte 21 of DID 96).
    Unit {
        /// A choice among numbered things.
        Choice = 0,
        /// 0 is no, 1 is yes.
        Flag = 1,
        /// Bit 0 is the first of several.
        Bits = 2,
        /// Milliseconds.
        Milliseconds = 3,
        /// Centimetres.
        Centimetres = 4,
        /// A/D counts, as in the telemetry.
        AdCounts = 5,
        /// Counts of a position sensor.
        Counts = 6,
        /// Counts of a position sensor per second.
        CountsPerSecond = 7,
        /// Drive in 1/16384 of full drive.
        Duty = 8,
        /// Microseconds.
        Microseconds = 9,
        /// Seconds.
        Seconds = 10,
        /// Ticks of an arm's joint.
        Ticks = 11,
    }
}

codes! {
    /// Why the board has started (byte 5 of DID 97).
    ResetCause {
        /// Not known.
        Unknown = 0,
        /// Power came on, or came back.
        Power = 1,
        /// The reset pin.
        Pin = 2,
        /// The program restarted itself.
        Software = 3,
        /// The watchdog: a task had hung, or the program had failed.
        Watchdog = 4,
    }
}

codes! {
    /// Where the settings come from (byte 6 of DID 97).
    Origin {
        /// Nothing was ever saved: the defaults.
        Defaults = 0,
        /// What was saved.
        Stored = 1,
        /// What was stored is damaged or foreign: the defaults, and fault 25.
        Corrupt = 2,
    }
}

codes! {
    /// What came of a request (byte 3 of DID 101).
    Verdict {
        /// Done.
        Done = 0,
        /// No such DID or sub-command in this version of the extension.
        Unknown = 1,
        /// DATA fits no form of the request.
        BadLength = 2,
        /// No setting has this number.
        NoSuchSetting = 3,
        /// A value is out of its range.
        OutOfRange = 4,
        /// The value contradicts another setting's.
        Contradiction = 5,
        /// A motor or a servo is on that must be off: suspend it first (DID 30).
        OutputsOn = 6,
        /// Another request, which this one would disturb, is being carried out.
        Busy = 7,
        /// This board cannot do it.
        NotAvailable = 8,
        /// The flash memory failed; what was saved before is still there.
        FlashFailed = 9,
    }
}

impl core::fmt::Display for Verdict {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Done => "done",
            Self::Unknown => "this board's version has no such request",
            Self::BadLength => "the request has the wrong length",
            Self::NoSuchSetting => "no setting has this number",
            Self::OutOfRange => "a value is out of its range",
            Self::Contradiction => "the value contradicts another setting's",
            Self::OutputsOn => "a motor or a servo is on that must be off: suspend it first",
            Self::Busy => "another request is being carried out: wait for its answer",
            Self::NotAvailable => "this board cannot do it",
            Self::FlashFailed => "the flash failed; what was saved before is still there",
        })
    }
}

impl core::error::Error for Verdict {}

/// A setting, told in full (DID 96).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Description<'a> {
    /// Its number.
    pub number: u16,
    /// The next setting's, `None` behind the last.
    pub next: Option<u16>,
    /// Its value.
    pub value: i32,
    /// Its lowest and its highest value.
    pub range: (i32, i32),
    /// Its value until a host says otherwise.
    pub default: i32,
    /// What the values count.
    pub unit: Unit,
    /// Its name: ASCII, [`Self::LONGEST_NAME`] bytes at most.
    pub name: &'a str,
    /// Of several of this name (channels, joints), which: 0 to 9, told behind the name.
    pub member: Option<u8>,
}

impl Description<'_> {
    /// Bytes of the longest name.
    pub const LONGEST_NAME: usize = 24;
}

impl core::fmt::Display for Description<'_> {
    /// Its name, and which it is.
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self.member {
            Some(member) => write!(f, "{} {member}", self.name),
            None => f.write_str(self.name),
        }
    }
}

/// Takes " 5" from the end of a name.
fn member(name: &str) -> (&str, Option<u8>) {
    let [rest @ .., b' ', digit @ b'0'..=b'9'] = name.as_bytes() else { return (name, None) };
    let digit = digit.saturating_sub(b'0');
    name.get(..rest.len()).map_or((name, None), |name| (name, Some(digit)))
}

record! {
    /// Who the board is (DID 97).
    pub struct Identity {
        /// The firmware's version: major, minor, patch.
        pub version: [u8; 3],
        /// The extension's version.
        pub extension: u8,
        /// Why the board has started.
        pub reset: ResetCause,
        /// Where its settings come from.
        pub settings: Origin,
    }
}

record! {
    /// How the board is (DID 98).
    #[derive(Default)]
    pub struct Health {
        /// ms since it has started; wraps.
        pub uptime_ms: u32,
        /// Worst control latency since then, in microseconds.
        pub worst_latency_us: u16,
        /// The most stack that was ever used, in bytes; 0 is unknown.
        pub stack_used: u16,
        /// Latched faults, 47 at the most; [`Latched::total`] are on record.
        pub faults: u8,
        /// Control periods that began so late that they were missed; wraps.
        pub periods_missed: u32,
    }
}

counters! {
    /// Everything that a board counts (DID 99). The counters wrap.
    ///
    /// A session counts in these, and so they have one name everywhere. What is not a session's is
    /// filled in when they are told.
    pub struct Counters {
        /// Intact frames, whoever they were for.
        pub frames_ok: u32,
        /// Frames that began well and were damaged.
        pub bad_frames: u32,
        /// Bytes that were part of no intact frame.
        pub bytes_skipped: u32,
        /// Intact frames for this board.
        pub frames_for_us: u32,
        /// Intact frames for other devices on the line.
        pub not_for_us: u32,
        /// Frames for this board with a DID that is not known.
        pub unknown: u32,
        /// Frames for this board that were refused for their values or their length.
        pub refused: u32,
        /// Acknowledgements sent.
        pub acks_sent: u32,
        /// Acknowledgements that found no room to wait.
        pub acks_dropped: u32,
        /// Telemetry frames sent.
        pub telemetry_sent: u32,
        /// Telemetry frames skipped because the line was busy for a whole period.
        pub telemetry_skipped: u32,
        /// Pings sent.
        pub pings_sent: u32,
        /// Pictures that found no room to wait for the display.
        pub pictures_dropped: u32,
        /// Errors that the line itself reported: overruns, framing.
        pub line_errors: u32,
        /// Answers of the extension sent, but for health and the machine state.
        pub answers_sent: u32,
        /// Answers of the extension that found no room to wait.
        pub answers_dropped: u32,
        /// Commands refused by the controller.
        pub commands_refused: u32,
        /// Times the host fell silent.
        pub links_lost: u32,
    }
}

counters! {
    /// What was refused, by reason (DID 103). The counters wrap; together they are
    /// [`Counters::refused`] and [`Counters::commands_refused`].
    pub struct Refusals {
        /// DATA that fits no form of its DID; of an arm's command, its argument.
        pub length: u32,
        /// A channel that does not exist, or is listed twice.
        pub channel: u32,
        /// A value out of its field's range.
        pub value: u32,
        /// A sub-command of DID 7 that is not known.
        pub sub_command: u32,
        /// A setting that does not exist or contradicts another, or a value of the extension out of its range.
        pub setting: u32,
        /// What the state of things did not allow: something on that must be off, something else under
        /// way, an arm that takes no orders.
        pub not_now: u32,
        /// What this board cannot do, or its flash failed to.
        pub not_available: u32,
        /// A motion command of another method than its channel was set to.
        pub method: u32,
        /// A target beyond the sensor's scale.
        pub scale: u32,
    }
}

/// A place in the list of the latched faults' records (DID 100).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Latched {
    /// The place, from 0.
    pub place: u8,
    /// How many records there are, 16 at the most; [`Health::faults`] may be more.
    pub total: u8,
    /// What is there; `None` when the place is not below `total`.
    pub record: Option<FaultRecord>,
}

record! {
    /// What came of a request (DID 101).
    pub struct Outcome {
        /// The request's DID.
        pub did: u8,
        /// The first byte of its DATA, 0 if it had none: DID 7's sub-command.
        pub first: u8,
        /// What came of it.
        pub verdict: Verdict,
        /// The setting that it is about, 0 if none.
        pub setting: u16,
    }
}

/// A frame of the extension from the board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Answer<'a> {
    /// DID 96.
    Setting(Description<'a>),
    /// DID 97.
    Identity(Identity),
    /// DID 98.
    Health(Health),
    /// DID 99.
    Counters(Counters),
    /// DID 100.
    Fault(Latched),
    /// DID 101.
    Outcome(Outcome),
    /// DID 102.
    State(MachineState),
    /// DID 103.
    Refusals(Refusals),
    /// DID 104.
    Recording(Recording),
    /// DID 105.
    Block(Block),
}

impl<'a> Answer<'a> {
    /// Bytes of the longest DATA: the machine state.
    pub const MAX_DATA: usize = 124;

    /// Its DID.
    pub fn did(&self) -> u8 {
        match self {
            Self::Setting(_) => did::SETTING,
            Self::Identity(_) => did::IDENTITY,
            Self::Health(_) => did::HEALTH,
            Self::Counters(_) => did::COUNTERS,
            Self::Fault(_) => did::FAULT,
            Self::Outcome(_) => did::OUTCOME,
            Self::State(_) => did::STATE,
            Self::Refusals(_) => did::REFUSALS,
            Self::Recording(_) => did::RECORDING,
            Self::Block(_) => did::BLOCK,
        }
    }

    /// Appends DATA.
    ///
    /// # Errors
    /// [`EncodeError::NotRepresentable`] for a setting without number or with a name that is too long,
    /// and for a fault record that is missing below `total` or there beyond it.
    pub fn emit(&self, data: &mut Data) -> Result<(), EncodeError> {
        match self {
            Self::Setting(setting) => {
                let representable = setting.number != 0
                    && setting.next != Some(0)
                    && setting.name.bytes().all(|byte| byte.is_ascii())
                    && setting.name.len() <= Description::LONGEST_NAME
                    && (setting.member.is_some() || member(setting.name).1.is_none())
                    && setting.member.is_none_or(|member| member < 10);
                if !representable {
                    return Err(EncodeError::NotRepresentable);
                }
                setting.number.put(data)?;
                setting.next.unwrap_or(0).put(data)?;
                let (low, high) = setting.range;
                [setting.value, low, high, setting.default].put(data)?;
                setting.unit.put(data)?;
                append(data, setting.name.as_bytes())?;
                // A digit by the check above.
                let digit = |member: u8| append(data, &[b' ', b'0'.saturating_add(member)]);
                setting.member.map_or(Ok(()), digit)
            }
            Self::Identity(identity) => identity.put(data),
            Self::Health(health) => health.put(data),
            Self::Counters(counters) => counters.put(data),
            Self::Fault(latched) => {
                if latched.record.is_some() != (latched.place < latched.total) {
                    return Err(EncodeError::NotRepresentable);
                }
                [latched.place, latched.total].put(data)?;
                latched.record.map_or(Ok(()), |record| record.put(data))
            }
            Self::Outcome(outcome) => outcome.put(data),
            Self::State(state) => state.put(data),
            Self::Refusals(refusals) => refusals.put(data),
            Self::Recording(recording) => recording.put(data),
            Self::Block(block) => block.put(data),
        }
    }

    /// Reads DID and DATA of an intact frame. `None` if it is no answer of the extension.
    pub fn parse(did: u8, data: &'a [u8]) -> Option<Self> {
        let mut rest = data;
        let fields = &mut rest;
        let answer = match did {
            did::SETTING => {
                let [number, next] = Field::take(fields)?;
                let [value, low, high, default] = Field::take(fields)?;
                let unit = Unit::take(fields)?;
                let (name, member) = member(core::str::from_utf8(core::mem::take(fields)).ok()?);
                if number == 0 || name.len() > Description::LONGEST_NAME || !name.is_ascii() {
                    return None;
                }
                let next = Some(next).filter(|&next| next != 0);
                let range = (low, high);
                Self::Setting(Description {
                    number,
                    next,
                    value,
                    range,
                    default,
                    unit,
                    name,
                    member,
                })
            }
            did::IDENTITY => Self::Identity(Field::take(fields)?),
            did::HEALTH => Self::Health(Field::take(fields)?),
            did::COUNTERS => Self::Counters(Counters::take_what_is_there(fields)),
            did::FAULT => {
                let [place, total] = Field::take(fields)?;
                let record = if place < total { Some(Field::take(fields)?) } else { None };
                Self::Fault(Latched { place, total, record })
            }
            did::OUTCOME => Self::Outcome(Field::take(fields)?),
            did::STATE => Self::State(Field::take(fields)?),
            did::REFUSALS => Self::Refusals(Field::take(fields)?),
            did::RECORDING => Self::Recording(Field::take(fields)?),
            did::BLOCK => return Block::take(fields),
            _ => return None,
        };
        Some(answer) // what is behind it is of a later version
    }
}

impl Counters {
    /// An older board does not send the last ones: they are 0.
    fn take_what_is_there(data: &[u8]) -> Self {
        let mut padded = [0; size_of::<Self>()];
        padded.iter_mut().zip(data).for_each(|(byte, sent)| *byte = *sent);
        Self::take(&mut padded.as_slice()).unwrap_or_default() // as long as all of them
    }
}

impl Outcome {
    /// What came of the request with this DID and DATA.
    pub fn of(did: u8, data: &[u8], verdict: Verdict) -> Self {
        Self { did, first: data.first().copied().unwrap_or(0), verdict, setting: 0 }
    }

    /// What came of setting an encoder's count.
    pub fn of_count(verdict: Verdict) -> Self {
        Self::of(did::PARAMETERS, &[super::request::SET_COUNT], verdict)
    }

    /// What came of a sub-command of DID 7.
    pub fn of_action(action: super::Action, verdict: Verdict) -> Self {
        Self::of(did::PARAMETERS, &[action.number()], verdict)
    }
}
