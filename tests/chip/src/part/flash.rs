//! The flash interface of an STM32F407 (RM0090 sections 3.6 and 3.9.1 to 3.9.9, the F405's and
//! F407's pages).
//!
//! | register or section | behaviour | source | test |
//! |---|---|---|---|
//! | `KEYR` | both keys in order open `CR`; a wrong one locks it until reset, and is told | 3.6.1 | `flash.rs` |
//! | `CR` | takes no write while it is locked; `LOCK` only sets | 3.9.7 | `flash.rs` |
//! | programming | a store while `PG` stands ANDs into the array, 32 bits at a time with `PSIZE` 2, and takes 16 us; another width is `PGPERR` | 3.6.2, data sheet table 40 | `flash.rs` |
//! | sector erase | `SER`, `SNB`, `STRT`: the sector's bytes are 0xFF after 250 ms for 16 KiB, 550 for 64, 1000 for 128 | 3.6.3, data sheet table 40 | `flash.rs` |
//! | `BSY` | while one of them runs; the core stands still meanwhile, since it fetches from the flash (the bench holds it) | 3.6, 3.9.5 | `flash.rs` |
//! | a reset meanwhile | the word, or the sector, stays as it was | 3.6.2, 3.6.3 | `power.rs` |
//! | `SR` | a written one clears an error | 3.9.5 | `flash.rs` |
//! | `ACR` | stored | 3.9.1 | `boot.rs` |
//!
//! | left out | source | reason |
//! |---|---|---|
//! | mass erase, option bytes, protection | 3.6.3, 3.7 | no image uses them |
//! | what a word or a sector is when power is lost while it is written | | not known; a test makes it up from `journal` |
//! | wait states, prefetch, caches | 3.5 | time here is a fixed number of instructions a second |
//! | spread of the times, wear | data sheet table 40 | the typical time; its limits are in the code's comments |

use rigless::device::{Device, DeviceContext, RegisterFile};
use rigless::soc::Width;
use rigless::soc::stm32f427::generated::flash::{Register, cr, sr};
use rigless::time::{EventId, VirtualNanos};

const KEYS: [u64; 2] = [0x4567_0123, 0xCDEF_89AB];
const WORD_NS: u64 = 16_000;

/// Where sectors 0 to 11 begin, their bytes, and how long an erase takes, in ns.
const fn sector(number: u64) -> (u64, u64, u64) {
    match number {
        0..=3 => (0x0800_0000 + number * 0x4000, 0x4000, 250_000_000),
        4 => (0x0801_0000, 0x1_0000, 550_000_000),
        _ => (0x0802_0000 + (number - 5) * 0x2_0000, 0x2_0000, 1_000_000_000),
    }
}

/// What the array is doing.
#[derive(Clone, Copy, Debug)]
enum Work {
    Program { address: u64, value: u64 },
    Erase { sector: u64 },
}

/// What has become of the array.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    /// A word is this now.
    Word {
        /// Where it is.
        address: u64,
        /// What is there.
        value: u64,
    },
    /// A sector is blank, by its number.
    Erased(u64),
}

/// The interface.
#[derive(Debug)]
pub struct Flash {
    /// Keys taken so far; 2 is open, 3 is locked until reset.
    keys: usize,
    control: u64,
    work: Option<(EventId, Work)>,
    /// Until when the core stands still, in ns.
    pub busy_until: u64,
    /// Words programmed since power on.
    pub words: u64,
    /// Sectors erased since power on.
    pub erases: u64,
    /// The sectors that were to be erased, by number.
    pub erased: Vec<u64>,
    /// Nothing changes in the array any more, though everything takes its time.
    pub is_worn_out: bool,
    /// What has become of the array since power on, in its order.
    pub journal: Vec<Change>,
    /// How many words will still be programmed: the one behind them is never finished, until a reset.
    pub hangs_after: Option<u64>,
}

impl Default for Flash {
    fn default() -> Self {
        Self {
            keys: 0,
            control: cr::LOCK.mask(),
            work: None,
            busy_until: 0,
            words: 0,
            erases: 0,
            erased: Vec::new(),
            is_worn_out: false,
            journal: Vec::new(),
            hangs_after: None,
        }
    }
}

impl Flash {
    fn begin(
        &mut self,
        work: Work,
        ns: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        let status = registers.get(Register::Sr);
        registers.set(Register::Sr, sr::BSY.set(status, 1));
        if let (Some(left), Work::Program { .. }) = (&mut self.hangs_after, work) {
            let Some(fewer) = left.checked_sub(1) else {
                self.busy_until = u64::MAX;
                return;
            };
            *left = fewer;
        }
        self.busy_until = context.now().0 + ns;
        self.work = Some((context.schedule(VirtualNanos(self.busy_until)), work));
    }

    fn error(registers: &mut RegisterFile, error: u64) {
        registers.set(Register::Sr, registers.get(Register::Sr) | error);
    }
}

impl Device for Flash {
    type Register = Register;

    fn write(
        &mut self,
        register: Self::Register,
        value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        match register {
            Register::Keyr => {
                self.keys = if KEYS.get(self.keys) == Some(&value) { self.keys + 1 } else { 3 };
                match self.keys {
                    2 => {
                        self.control = cr::LOCK.set(self.control, 0);
                    }
                    3 => context.tell("KEYR", "a wrong key: locked until reset"),
                    _ => {}
                }
            }
            Register::Cr if !cr::LOCK.is_set(self.control) => {
                self.control = cr::STRT.set(value, 0);
                if cr::LOCK.is_set(value) {
                    self.keys = 0;
                }
                if cr::STRT.is_set(value) && cr::SER.is_set(value) && self.work.is_none() {
                    let number = cr::SNB.get(value);
                    self.begin(
                        Work::Erase { sector: number },
                        sector(number).2,
                        registers,
                        context,
                    );
                }
            }
            Register::Cr => context.tell("CR", "written while it is locked"),
            _ => {}
        }
        registers.set(Register::Cr, self.control);
    }

    fn write_region(
        &mut self,
        address: u64,
        width: Width,
        value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> bool {
        if !cr::PG.is_set(self.control) || cr::LOCK.is_set(self.control) {
            Self::error(registers, sr::PGSERR.mask());
        } else if width != Width::W32 || cr::PSIZE.get(self.control) != 2 {
            Self::error(registers, sr::PGPERR.mask());
        } else {
            self.begin(Work::Program { address, value }, WORD_NS, registers, context);
        }
        true
    }

    fn on_event(
        &mut self,
        event: EventId,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        let Some((_, work)) = self.work.take_if(|(expected, _)| *expected == event) else { return };
        let status = registers.get(Register::Sr);
        registers.set(Register::Sr, sr::BSY.set(status, 0));
        match work {
            // A word of zeros is read back and ANDed where the answer comes.
            Work::Program { address, value } => {
                self.words += 1;
                self.work = None;
                context.read_from(address, Width::W32, address << 32 | value);
            }
            Work::Erase { sector: number } => {
                self.erases += 1;
                self.erased.push(number);
                if self.is_worn_out {
                    return;
                }
                self.journal.push(Change::Erased(number));
                let (begin, bytes, _) = sector(number);
                for address in (begin..begin + bytes).step_by(4) {
                    context.program(address, Width::W32, 0xFFFF_FFFF, 0);
                }
            }
        }
    }

    /// What stands where a word is to be programmed: bits go from 1 to 0 only.
    fn on_access(
        &mut self,
        token: u64,
        value: u64,
        _: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        let (address, word) = (token >> 32, token & 0xFFFF_FFFF);
        if address != 0 && !self.is_worn_out {
            self.journal.push(Change::Word { address, value: value & word });
            context.program(address, Width::W32, value & word, 0);
        }
    }

    /// Work that is under way ends with nothing done.
    fn reset(&mut self) {
        *self = Self {
            words: self.words,
            erases: self.erases,
            erased: std::mem::take(&mut self.erased),
            is_worn_out: self.is_worn_out,
            journal: std::mem::take(&mut self.journal),
            ..Self::default()
        };
    }
}
