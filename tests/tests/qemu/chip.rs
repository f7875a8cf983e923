//! What QEMU's machine lacks of the chip and the image waits for: the ready bits of the clocks, the
//! flash's controller, and the ROM's loader. Here it is told what the image writes to them, and
//! says what the image reads.
//!
//! The controller is strict: whatever RM0090 section 3.6 does not allow fails the test.

use std::ops::Range;

/// Polled registers: address, value after reset, and what a load answers after a store.
type Ready = (u32, u32, fn(u32) -> u32);
const READY: [Ready; 7] = [
    // RCC_CR: HSIRDY, HSERDY, PLLRDY and PLLI2SRDY follow their ON bits at once.
    (0x4002_3800, 0x83, |w| {
        w & !0x0A02_0002
            | (w & 1) << 1
            | (w & 1 << 16) << 1
            | (w & 1 << 24) << 1
            | (w & 1 << 26) << 1
    }),
    (0x4002_3808, 0, |w| w & !0xC | (w & 3) << 2), // RCC_CFGR: SWS is SW
    (CSR, 0, |w| w & !2 | (w & 1) << 1),           // RCC_CSR: LSIRDY is LSION
    (0x4000_7000, 0, |w| w),                       // PWR_CR: DBP reads back
    (ACR, 0, |w| w),                               // FLASH_ACR reads back
    (IDCODE, REVISION_Y, |w| w),                   // DBGMCU_IDCODE
    (APB1_FZ, 0, |w| w),                           // DBGMCU_APB1_FZ reads back
];

/// How the flash is read: wait states, prefetch, caches.
const ACR: u32 = 0x4002_3C00;

/// The chip's family and revision (RM0090 section 38.6.1).
const IDCODE: u32 = 0xE004_2000;
const REVISION_Y: u32 = 0x1003_0413;
const REVISION_A: u32 = 0x1000_0413;

/// Why the chip was reset, in its upper bits; bit 24 forgets it.
const CSR: u32 = 0x4002_3874;
const CSR_FLAGS: u32 = 0xFE00_0000;
const CSR_RMVF: u32 = 1 << 24;

/// The flags of RCC_CSR after a reset (RM0090 section 7.3.21).
#[derive(Clone, Copy)]
pub enum Reset {
    /// Power came on.
    Power = 0x0E00_0000,
    /// A program wanted it.
    Software = 0x1400_0000,
    /// The independent watchdog has bitten.
    Watchdog = 0x2400_0000,
}

/// The flash's controller: key, status and control register.
const KEYR: u32 = 0x4002_3C04;
const SR: u32 = 0x4002_3C0C;
const CR: u32 = 0x4002_3C10;
const CR_PG: u32 = 1 << 0;
const CR_SER: u32 = 1 << 1;
const CR_STRT: u32 = 1 << 16;
const CR_LOCK: u32 = 1 << 31;
/// PSIZE: 32 bits at a time.
const CR_WORDS: u32 = 2 << 8;
const KEYS: [u32; 2] = [0x4567_0123, 0xCDEF_89AB];

/// All of the flash, and the sectors that an image may change.
const FLASH: Range<u32> = 0x0800_0000..0x0810_0000;
pub const SETTINGS: Range<u32> = 0x0800_4000..0x0801_0000;
/// Bytes of each of those sectors, which begin with number 1.
pub const SECTOR: u32 = 0x4000;

/// The ROM's loader: its stack pointer and its entry.
pub const LOADER: u32 = 0x1FFF_0000;
pub const LOADER_STACK: u32 = 0x2000_2D40;
pub const LOADER_ENTRY: u32 = 0x1FFF_3DA9;

/// What stops with a core that a debugger halts; the watchdog is bit 12.
const APB1_FZ: u32 = 0xE004_2008;

/// What a store does beyond being remembered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effect {
    /// A sector becomes all ones.
    Erase(u8),
    /// This word becomes what it was and that.
    Program(u32, u32),
}

/// What the machine lacks.
pub struct Chip {
    ready: [u32; READY.len()],
    /// The control register.
    control: u32,
    /// Keys given so far.
    keys: usize,
    /// Whether a ready bit's register was written.
    pub is_touched: bool,
    /// What was done to the flash.
    pub effects: Vec<Effect>,
}

impl Chip {
    /// As it is after a reset.
    pub fn new(reset: Reset) -> Self {
        let ready = READY.map(|(address, value, _)| match address {
            CSR => value | reset as u32,
            _ => value,
        });
        Self { ready, control: CR_LOCK, keys: 0, is_touched: false, effects: Vec::new() }
    }

    /// One of the first, after power came on.
    pub fn of_revision_a() -> Self {
        let mut chip = Self::new(Reset::Power);
        for (value, (address, ..)) in chip.ready.iter_mut().zip(READY) {
            if address == IDCODE {
                *value = REVISION_A;
            }
        }
        chip
    }

    /// What the image has written to FLASH_ACR.
    pub fn flash_access(&self) -> u32 {
        self.load(ACR)
    }

    /// Whether the image lets the watchdog stand still while a debugger halts the core.
    pub fn watchdog_stops_with_the_core(&self) -> bool {
        self.load(APB1_FZ) & 1 << 12 != 0
    }

    /// What must be served: whether only stores, the first byte, the length.
    pub fn watched() -> impl Iterator<Item = (bool, u32, u32)> {
        let ready = READY.map(|(address, ..)| (false, address, 4));
        let flash =
            [(false, KEYR, 4), (false, SR, 8), (true, FLASH.start, FLASH.end - FLASH.start)];
        ready.into_iter().chain(flash).chain([(false, LOADER, 8)])
    }

    /// What a load reads.
    pub fn load(&self, address: u32) -> u32 {
        if let Some(k) = READY.iter().position(|&(ready, ..)| ready == address) {
            return READY[k].2(self.ready[k]);
        }
        match address {
            SR => 0, // it is always done, and well
            CR => self.control,
            LOADER => LOADER_STACK,
            _ if address == LOADER + 4 => LOADER_ENTRY,
            _ => panic!("a load from {address:#x}"),
        }
    }

    /// What a store does.
    pub fn store(&mut self, address: u32, value: u32) -> Option<Effect> {
        if let Some(k) = READY.iter().position(|&(ready, ..)| ready == address) {
            self.is_touched = true;
            self.ready[k] = match address {
                CSR if value & CSR_RMVF != 0 => value & !CSR_FLAGS & !CSR_RMVF,
                CSR => value & !CSR_FLAGS | self.ready[k] & CSR_FLAGS,
                _ => value,
            };
            return None;
        }
        let effect = match address {
            KEYR => {
                assert_eq!(Some(&value), KEYS.get(self.keys), "a wrong key, or one too many");
                self.keys += 1;
                if self.keys == KEYS.len() {
                    self.control &= !CR_LOCK;
                }
                return None;
            }
            SR => return None,
            CR => {
                assert_eq!(self.control & CR_LOCK, 0, "the control register is locked");
                self.control = value & !CR_STRT;
                if value & CR_LOCK != 0 {
                    self.keys = 0;
                }
                if value & CR_STRT == 0 {
                    return None;
                }
                let sector = value >> 3 & 0xF;
                assert_eq!(
                    value,
                    CR_STRT | CR_SER | CR_WORDS | sector << 3,
                    "only a sector's erase"
                );
                Effect::Erase(sector as u8)
            }
            _ if FLASH.contains(&address) => {
                assert_eq!(self.control, CR_PG | CR_WORDS, "a store to {address:#x}");
                assert!(
                    SETTINGS.contains(&address) && address.is_multiple_of(4),
                    "a store to {address:#x}"
                );
                Effect::Program(address, value)
            }
            _ => panic!("a store to {address:#x}"),
        };
        self.effects.push(effect);
        Some(effect)
    }
}
