//! Motion commands: DIDs 3 to 6 and 26 to 29 of Table II.1, in their two forms.

use super::command::{CHANNELS, Channel, Refusal};
use super::did;
use crate::data::{Data, EncodeError, Field};

/// The documented flag before the time of a list, and the one that some hosts use.
const TIME_FLAG: u8 = 28;
const TIME_FLAG_IN_THE_FIELD: u8 = 6;

/// In the commands for all channels: leave this one alone.
const NO_CONTROL: u16 = 0x8000;

/// What a motion command sets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Quantity {
    /// DC motor position in sensor counts, 0 to 32767; the sensor may allow less (DIDs 3, 4).
    Position,
    /// DC motor PWM, 0 to 32767, neutral at 16384 (DIDs 5, 6).
    Pwm,
    /// DC motor velocity in sensor counts per second, -32767 to 32767 (DIDs 26, 27).
    Velocity,
    /// Servo pulse width in 1/2250 ms, 500 to 7000 (DIDs 28, 29).
    Servo,
}

impl Quantity {
    /// The lowest and highest target that the wire allows.
    pub const fn range(self) -> (i16, i16) {
        match self {
            Self::Position | Self::Pwm => (0, i16::MAX),
            Self::Velocity => (-i16::MAX, i16::MAX),
            Self::Servo => (500, 7000),
        }
    }

    /// The target that a word of the wire stands for.
    fn target(self, did: u8, word: u16) -> Result<i16, Refusal> {
        let target = word.cast_signed();
        let (low, high) = self.range();
        let allowed = (low..=high).contains(&target).then_some(target);
        allowed.ok_or(Refusal::Value { did, value: word })
    }
}

/// The two forms of a motion command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Addressing {
    /// `[channel lo hi]+ [28 tlo thi]` (DIDs 3, 5, 26, 28).
    List,
    /// Six words, optionally `tlo thi` or `28 tlo thi`; 0x8000 leaves a channel alone
    /// (DIDs 4, 6, 27, 29).
    All,
}

/// A motion command: targets for some channels, to be reached in some time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Move {
    /// What the targets are.
    pub quantity: Quantity,
    /// Which form the command has on the wire; both mean the same.
    pub addressing: Addressing,
    /// Target of each channel in the units of [`Quantity`], or `None` to leave it alone.
    pub targets: [Option<i16>; CHANNELS],
    /// Control periods (1 ms) in which the set-point moves there linearly; 0 is at once.
    pub periods: u16,
}

impl Move {
    /// The quantity and the form that a motion DID stands for.
    fn kind(did: u8) -> Option<(Quantity, Addressing)> {
        let quantities = [Quantity::Position, Quantity::Pwm, Quantity::Velocity, Quantity::Servo];
        let forms = |quantity| [(quantity, Addressing::List), (quantity, Addressing::All)];
        let mut kinds = quantities.into_iter().flat_map(forms);
        kinds.find(|&(quantity, addressing)| Self::did_of(quantity, addressing) == did)
    }

    /// Its DID.
    pub fn did(&self) -> u8 {
        Self::did_of(self.quantity, self.addressing)
    }

    const fn did_of(quantity: Quantity, addressing: Addressing) -> u8 {
        match (quantity, addressing) {
            (Quantity::Position, Addressing::List) => did::POSITION,
            (Quantity::Position, Addressing::All) => did::POSITION_ALL,
            (Quantity::Pwm, Addressing::List) => did::PWM,
            (Quantity::Pwm, Addressing::All) => did::PWM_ALL,
            (Quantity::Velocity, Addressing::List) => did::VELOCITY,
            (Quantity::Velocity, Addressing::All) => did::VELOCITY_ALL,
            (Quantity::Servo, Addressing::List) => did::SERVO,
            (Quantity::Servo, Addressing::All) => did::SERVO_ALL,
        }
    }

    /// Reads DATA of a motion DID; `None` if `did` is not one.
    pub(super) fn parse(did: u8, data: &[u8]) -> Option<Result<Self, Refusal>> {
        let (quantity, addressing) = Self::kind(did)?;
        Some(match addressing {
            Addressing::List => Self::parse_list(did, quantity, data),
            Addressing::All => Self::parse_all(did, quantity, data),
        })
    }

    fn parse_list(did: u8, quantity: Quantity, data: &[u8]) -> Result<Self, Refusal> {
        let bad_length = Refusal::Length { did, len: data.len() };
        let (entries, periods) = split_time(data).ok_or(bad_length)?;
        let mut targets = [None; CHANNELS];
        for &[number, low, high] in entries {
            let channel = Channel::new(number).ok_or(Refusal::NoSuchChannel(number))?;
            let target = quantity.target(did, u16::from_le_bytes([low, high]))?;
            if let Some(slot) = targets.get_mut(channel.index())
                && slot.replace(target).is_some()
            {
                return Err(Refusal::RepeatedChannel(number));
            }
        }
        Ok(Self { quantity, addressing: Addressing::List, targets, periods })
    }

    fn parse_all(did: u8, quantity: Quantity, data: &[u8]) -> Result<Self, Refusal> {
        let bad_length = Refusal::Length { did, len: data.len() };
        let (values, time) = data.split_first_chunk::<{ 2 * CHANNELS }>().ok_or(bad_length)?;
        let periods = time_of(time).ok_or(bad_length)?;
        let mut targets = [None; CHANNELS];
        for (slot, word) in targets.iter_mut().zip(values.as_chunks::<2>().0) {
            let word = u16::from_le_bytes(*word);
            if word != NO_CONTROL {
                *slot = Some(quantity.target(did, word)?);
            }
        }
        Ok(Self { quantity, addressing: Addressing::All, targets, periods })
    }

    /// Appends DATA.
    pub(super) fn emit(&self, data: &mut Data) -> Result<(), EncodeError> {
        let (low, high) = self.quantity.range();
        for (channel, target) in Channel::ALL.into_iter().zip(self.targets) {
            match (target, self.addressing) {
                (Some(target), _) if !(low..=high).contains(&target) => {
                    return Err(EncodeError::NotRepresentable);
                }
                (Some(target), Addressing::List) => {
                    channel.number().put(data)?;
                    target.put(data)?;
                }
                (Some(target), Addressing::All) => target.put(data)?,
                (None, Addressing::List) => {}
                (None, Addressing::All) => NO_CONTROL.put(data)?,
            }
        }
        if data.is_empty() {
            return Err(EncodeError::NotRepresentable);
        }
        if self.periods > 0 {
            if self.addressing == Addressing::List {
                TIME_FLAG.put(data)?;
            }
            self.periods.put(data)?;
        }
        Ok(())
    }
}

/// Splits a list into its entries and its time. `None` when the length fits no form.
fn split_time(data: &[u8]) -> Option<(&[[u8; 3]], u16)> {
    let (triplets, rest) = data.as_chunks::<3>();
    let (entries, periods) = match (triplets, rest) {
        // A flag and a time are as long as an entry.
        ([entries @ .., last], []) if let Some(periods) = time_of(last) => (entries, periods),
        (entries, rest) => (entries, time_of(rest)?),
    };
    (!entries.is_empty()).then_some((entries, periods))
}

/// The time behind the targets, 0 when there is none: two bytes, with a flag before them or without.
/// Hosts also send the flag alone. `None` when it is none of these.
fn time_of(data: &[u8]) -> Option<u16> {
    match *data {
        [] | [TIME_FLAG | TIME_FLAG_IN_THE_FIELD] => Some(0),
        [low, high] | [TIME_FLAG | TIME_FLAG_IN_THE_FIELD, low, high] => {
            Some(u16::from_le_bytes([low, high]))
        }
        _ => None,
    }
}
