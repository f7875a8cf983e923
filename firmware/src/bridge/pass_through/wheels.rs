//! Which servos are wheels, as far as it was seen on the bus: those whose angle limits, registers 6 to 9, are
//! all 0.
//!
//! A joint that is taken for a wheel would be sent full speed, so a zero must be proved and a doubt is enough
//! against it:
//! - a byte is 0 when its servo answers so to a READ, or obeys a WRITE of 0: answers without a refusal. What
//!   nobody answers to (SYNC_WRITE, broadcasts, whatever a servo's status return level leaves out) proves nothing;
//! - it is not known to be 0 any more as soon as the PC writes something else, whether the servo obeys or not, or
//!   sends the ACTION to a REG_WRITE of something else;
//! - nothing is known of a servo that is told RESET or given another ID, nor of the one that has that ID.
//!
//! Nobody can see that a servo was exchanged for one with the same ID, or that two have the same.

use core::ops::Range;

use protocol::dynamixel::{Errors, Id, Instruction, Packet, Register};

/// Servos have the IDs 0 to 253.
const IDS: usize = 254;
/// All four bytes of the limits, one bit each, that of register 6 the lowest.
const ALL: u8 = 0b1111;
/// With these errors an instruction was not obeyed.
const REFUSALS: [Errors; 3] = [Errors::RANGE, Errors::CHECKSUM, Errors::INSTRUCTION];

/// What registers' bytes say of the limits' four.
#[derive(Clone, Copy)]
struct Limits {
    zero: u8,
    /// Something else.
    other: u8,
}

impl Limits {
    fn of(address: u8, data: &[u8]) -> Self {
        let mut limits = Self { zero: 0, other: 0 };
        for (bit, register) in (Register::CW_LIMIT.address..).take(4).enumerate() {
            match byte_at(register, address, data) {
                Some(0) => limits.zero |= 1 << bit,
                Some(_) => limits.other |= 1 << bit,
                None => {}
            }
        }
        limits
    }

    /// The same for what is written: another ID, register 3, leaves nothing known.
    fn written(address: u8, data: &[u8]) -> Self {
        if byte_at(Register::ID.address, address, data).is_some() {
            return Self { zero: 0, other: ALL };
        }
        Self::of(address, data)
    }
}

/// What bytes from `address` on say of a register's first.
fn byte_at(register: u8, address: u8, data: &[u8]) -> Option<u8> {
    data.get(usize::from(register.checked_sub(address)?)).copied()
}

/// What is known of an ID.
#[derive(Clone, Copy)]
struct Known {
    /// The limits' bytes that are 0.
    zero: u8,
    /// Those that an ACTION may make something else.
    registered: u8,
}

impl Known {
    const NOTHING: Self = Self { zero: 0, registered: 0 };

    /// The servo was told this; it may obey or not.
    fn told(&mut self, instruction: &Instruction<'_>) {
        match *instruction {
            Instruction::Write { address, data } => {
                self.zero &= !Limits::written(address, data).other;
            }
            Instruction::RegWrite { address, data } => {
                self.registered |= Limits::written(address, data).other;
            }
            Instruction::Action => self.zero &= !self.registered,
            Instruction::Reset => self.zero = 0,
            _ => {}
        }
    }

    /// Besides, it has obeyed.
    fn obeyed(&mut self, instruction: &Instruction<'_>) {
        match *instruction {
            Instruction::Write { address, data } => {
                self.zero |= Limits::written(address, data).zero;
            }
            // It keeps one.
            Instruction::RegWrite { address, data } => {
                self.registered = Limits::written(address, data).other;
            }
            Instruction::Action => self.registered = 0,
            _ => {}
        }
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
    /// This is known of it if it obeys.
    Told {
        id: Id,
        obeyed: Known,
    },
}

/// What is known of all servos.
pub struct Wheels {
    known: [Known; IDS],
    asked: Asked,
}

impl Wheels {
    /// Nothing is known.
    pub const fn new() -> Self {
        Self { known: [Known::NOTHING; IDS], asked: Asked::Nobody }
    }

    /// The wheels from this ID on, in the order of their IDs.
    pub fn from(&self, first: u8) -> impl Iterator<Item = Id> {
        let wheels = (0..=u8::MAX).zip(&self.known).skip(usize::from(first));
        wheels.filter(|(_, known)| known.zero == ALL).filter_map(|(number, _)| Id::new(number))
    }

    /// Whatever is answered now proves nothing.
    pub fn nobody_is_asked(&mut self) {
        self.asked = Asked::Nobody;
    }

    /// The PC has told `id` this, and no earlier instruction can be answered any more.
    pub fn follow(&mut self, id: Id, instruction: &Instruction<'_>) {
        match *instruction {
            Instruction::SyncWrite(list) => {
                for (number, data) in list.servos() {
                    let address = list.address();
                    self.tell(places_of(number), &Instruction::Write { address, data });
                }
            }
            _ => self.tell(places(id), instruction),
        }
        self.asked = match (instruction, self.of(places(id))) {
            (&Instruction::Read { address, count }, [_]) => Asked::Read { id, address, count },
            (_, &mut [mut obeyed]) => {
                obeyed.obeyed(instruction);
                Asked::Told { id, obeyed }
            }
            _ => Asked::Nobody,
        };
    }

    /// A servo has answered; whether it is the one that was asked.
    pub fn hear(&mut self, status: Packet<'_>) -> bool {
        let errors = Errors::from_bits(status.code);
        let obeys = !REFUSALS.into_iter().any(|refusal| errors.contains(refusal));
        let whom = places(status.id);
        match core::mem::replace(&mut self.asked, Asked::Nobody) {
            Asked::Read { id, address, count } if id == status.id => {
                if obeys && status.params.len() == usize::from(count) {
                    let Limits { zero, other } = Limits::of(address, status.params);
                    let read = |known: &mut Known| known.zero = known.zero & !other | zero;
                    self.of(whom).iter_mut().for_each(read);
                }
                true
            }
            Asked::Told { id, obeyed } if id == status.id => {
                if obeys && status.params.is_empty() {
                    self.of(whom).fill(obeyed);
                }
                true
            }
            _ => false,
        }
    }

    fn of(&mut self, whom: Range<usize>) -> &mut [Known] {
        self.known.get_mut(whom).unwrap_or_default()
    }

    fn tell(&mut self, whom: Range<usize>, instruction: &Instruction<'_>) {
        self.of(whom).iter_mut().for_each(|known| known.told(instruction));
        let given = match *instruction {
            Instruction::Write { address, data } => byte_at(Register::ID.address, address, data),
            Instruction::Reset => Some(1),
            _ => None,
        };
        if let Some(number) = given {
            self.of(places_of(number)).iter_mut().for_each(|known| known.zero = 0);
        }
    }
}

/// Where the servos that an ID names are known.
fn places(id: Id) -> Range<usize> {
    if id == Id::BROADCAST { 0..IDS } else { places_of(id.number()) }
}

fn places_of(number: u8) -> Range<usize> {
    let first = usize::from(number);
    first..first + 1
}
