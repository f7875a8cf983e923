//! Which servos turn endlessly, as far as it was seen on the bus: those whose angle limits, registers 6 to 9,
//! are all 0.
//!
//! Seen is what the PC writes (WRITE, SYNC_WRITE, REG_WRITE when its ACTION comes, RESET) and what servos
//! answer when it reads. A write that its servo answers with a refusal counts for nothing. What was
//! not seen is not 0: nobody is a turner before all four bytes have been.
//!
//! A servo that is given another ID by WRITE or SYNC_WRITE takes what is known along; with a REG_WRITE it is forgotten.
//! Nobody can see that a servo was exchanged for one with the same ID.

use core::ops::Range;

use protocol::dynamixel::{Errors, Id, Instruction, Packet, Register};

/// Servos have the IDs 0 to 253.
const IDS: usize = 254;
/// All four bytes of the limits, one bit each, that of register 6 the lowest.
const ALL: u8 = 0b1111;
/// With these errors an instruction was not obeyed.
const REFUSALS: [Errors; 3] = [Errors::RANGE, Errors::CHECKSUM, Errors::INSTRUCTION];

/// What a write says of the limits' four bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Limits {
    /// Those that it writes.
    written: u8,
    /// Of these, those that are 0 then.
    zero: u8,
}

impl Limits {
    /// All that were known are no more.
    const UNKNOWN: Self = Self { written: ALL, zero: 0 };

    fn of(address: u8, data: &[u8]) -> Self {
        let mut limits = Self::default();
        for (bit, register) in (Register::CW_LIMIT.address..).take(4).enumerate() {
            let place = register.checked_sub(address).map(usize::from);
            if let Some(&value) = place.and_then(|place| data.get(place)) {
                limits.written |= 1 << bit;
                limits.zero |= u8::from(value == 0) << bit;
            }
        }
        limits
    }
}

/// What is known of an ID.
#[derive(Clone, Copy, Debug, Default)]
struct Known {
    /// The limits' bytes that are 0.
    zero: u8,
    /// What waits for an ACTION.
    registered: Limits,
}

impl Known {
    const NOTHING: Self = Self { zero: 0, registered: Limits { written: 0, zero: 0 } };

    fn take(&mut self, Limits { written, zero }: Limits) {
        self.zero = self.zero & !written | zero;
    }
}

/// Whose answer tells something.
enum Asked {
    Nobody,
    /// This one was asked for registers.
    Read {
        id: Id,
        address: u8,
        count: u8,
    },
    /// This one may refuse what it was told; then all is as it was.
    Write {
        id: Id,
        before: Known,
    },
}

/// What is known of all servos.
pub struct Turners {
    known: [Known; IDS],
    asked: Asked,
}

impl Turners {
    /// Nothing is known.
    pub const fn new() -> Self {
        Self { known: [Known::NOTHING; IDS], asked: Asked::Nobody }
    }

    /// The turners from this ID on, in the order of their IDs.
    pub fn from(&self, first: u8) -> impl Iterator<Item = Id> {
        let turners = (0..=u8::MAX).zip(&self.known).skip(usize::from(first));
        turners.filter(|(_, known)| known.zero == ALL).filter_map(|(number, _)| Id::new(number))
    }

    /// Whatever is answered now answers nothing that was followed.
    pub fn nobody_is_asked(&mut self) {
        self.asked = Asked::Nobody;
    }

    /// The PC has told `id` this.
    pub fn follow(&mut self, id: Id, instruction: &Instruction<'_>) {
        let whom = places(id);
        if let Some(&[before]) = self.known.get(whom.clone()) {
            self.asked = Asked::Write { id, before };
        }
        match *instruction {
            Instruction::Ping => {}
            Instruction::Read { address, count } => {
                self.asked = Asked::Read { id, address, count };
            }
            Instruction::Write { address, data } => self.write(whom, address, data),
            Instruction::RegWrite { address, data } => {
                let gives_id = given_id(address, data).is_some();
                let registered = if gives_id { Limits::UNKNOWN } else { Limits::of(address, data) };
                self.of(whom).iter_mut().for_each(|known| known.registered = registered);
            }
            Instruction::Action => {
                for known in self.of(whom) {
                    let registered = core::mem::take(&mut known.registered);
                    known.take(registered);
                }
            }
            // Limits of a joint, and the ID is 1.
            Instruction::Reset => {
                self.of(whom).fill(Known::NOTHING);
                self.of(1..2).fill(Known::NOTHING);
            }
            Instruction::SyncWrite(list) => {
                for (number, data) in list.servos() {
                    let first = usize::from(number);
                    self.write(first..first + 1, list.address(), data);
                }
            }
        }
    }

    /// A servo has answered.
    pub fn hear(&mut self, status: Packet<'_>) {
        let refuses = || {
            let errors = Errors::from_bits(status.code);
            REFUSALS.into_iter().any(|refusal| errors.contains(refusal))
        };
        match self.asked {
            Asked::Read { id, address, count }
                if id == status.id && status.params.len() == usize::from(count) =>
            {
                let limits = Limits::of(address, status.params);
                self.of(places(id)).iter_mut().for_each(|known| known.take(limits));
            }
            Asked::Write { id, before } if id == status.id && refuses() => {
                self.of(places(id)).fill(before);
            }
            _ => {}
        }
        self.asked = Asked::Nobody;
    }

    fn of(&mut self, whom: Range<usize>) -> &mut [Known] {
        self.known.get_mut(whom).unwrap_or_default()
    }

    fn write(&mut self, whom: Range<usize>, address: u8, data: &[u8]) {
        let limits = Limits::of(address, data);
        self.of(whom.clone()).iter_mut().for_each(|known| known.take(limits));
        if let Some(number) = given_id(address, data) {
            let moved = self.known.get(whom.start).copied().unwrap_or_default();
            self.of(whom).fill(Known::NOTHING);
            self.of(places_of(number)).fill(moved);
        }
    }
}

/// The ID that a write to register 3 gives.
fn given_id(address: u8, data: &[u8]) -> Option<u8> {
    let place = Register::ID.address.checked_sub(address)?;
    data.get(usize::from(place)).copied()
}

/// Where the servos that an ID names are known.
fn places(id: Id) -> Range<usize> {
    if id == Id::BROADCAST { 0..IDS } else { places_of(id.number()) }
}

fn places_of(number: u8) -> Range<usize> {
    let first = usize::from(number);
    first..first + 1
}
