//! The flash that holds the settings: sectors 1 to 3 of the STM32F4, 16 KiB each, between the
//! vectors and the program (memory.x). It can touch no other.
//!
//! The core stands still when it fetches from a flash that is at work: for 16 us (100 at the most)
//! a word, for 250 ms (500 at the most) an erase, with 32 bits at a time, which take a supply of
//! 2.7 V. embassy's clock cannot bear to miss its interrupts for more than 65 ms, and would run
//! backwards later on; so it is stopped for an erase, and uptime is that much behind.
//!
//! Why not embassy's driver: it erases 8 bits at a time, which takes up to 800 ms, and leaves what
//! was erased in the data cache (RM0090 section 3.6.4, and the data sheet's times).

use core::ptr;
use core::sync::atomic::Ordering;

use cortex_m::asm;
use embassy_stm32::Peri;
use embassy_stm32::pac::flash::regs::{Cr, Sr};
use embassy_stm32::pac::flash::vals::Psize;
use embassy_stm32::pac::{FLASH, TIM5};
use embassy_stm32::peripherals;
use embedded_storage::nor_flash::{
    ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash, check_erase, check_read, check_write,
};

use super::line::CORE_STOOD_STILL;

/// Where the first of the sectors begins.
const BEGIN: usize = 0x0800_4000;
/// Its number.
const FIRST_SECTOR: u8 = 1;
/// Bytes of a sector.
const SECTOR: usize = 16 * 1024;
/// Bytes in all.
pub const SIZE: usize = 3 * SECTOR;

/// What unlocks the control register, the one after the other (RM0090 section 3.6.1).
const KEY1: u32 = 0x4567_0123;
const KEY2: u32 = 0xCDEF_89AB;
/// What has gone wrong; ones clear it.
const ERRORS: u32 = 0xF2;

/// The settings' sectors; offsets are from the first one's beginning.
pub struct Flash(());

impl Flash {
    pub(super) fn new(_flash: Peri<'static, peripherals::FLASH>) -> Self {
        Self(())
    }
}

impl ErrorType for Flash {
    type Error = NorFlashErrorKind;
}

impl ReadNorFlash for Flash {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        check_read(self, offset, bytes.len())?;
        let from = (BEGIN + offset as usize) as *const u8;
        for (i, byte) in bytes.iter_mut().enumerate() {
            // SAFETY: flash within the checked bounds. Volatile, because erasing changes it.
            *byte = unsafe { from.add(i).read_volatile() };
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        SIZE
    }
}

impl NorFlash for Flash {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = SECTOR;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        check_erase(self, from, to)?;
        let sectors = from / SECTOR as u32..to / SECTOR as u32;
        sectors.into_iter().try_for_each(|sector| erase(FIRST_SECTOR + sector as u8))
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        check_write(self, offset, bytes.len())?;
        let to = (BEGIN + offset as usize) as *mut u32;
        let (words, _) = bytes.as_chunks();
        let mut program = by_words();
        program.set_pg(true);
        unlocked(program, || {
            words.iter().enumerate().try_for_each(|(i, &word)| {
                // SAFETY: a word of the flash within the checked bounds, which holds nothing but
                // settings; nobody has a reference to it.
                unsafe { ptr::write_volatile(to.add(i), u32::from_le_bytes(word)) };
                finished()
            })
        })
    }
}

/// Erases a sector, with the clock stopped.
fn erase(sector: u8) -> Result<(), NorFlashErrorKind> {
    let mut erase = by_words();
    erase.set_ser(true);
    erase.set_snb(sector);
    let clock = TIM5.cr1().read();
    TIM5.cr1().modify(|w| w.set_cen(false));
    let result = unlocked(erase, || {
        erase.set_strt(true);
        FLASH.cr().write_value(erase);
        finished()
    });
    forget_cached();
    CORE_STOOD_STILL.store(true, Ordering::Relaxed);
    TIM5.cr1().write_value(clock);
    result
}

/// The control register's 32 bits at a time.
fn by_words() -> Cr {
    let mut control = Cr(0);
    control.set_psize(Psize::PSIZE32);
    control
}

/// Does something with the control register unlocked and set to this, and locks it again.
fn unlocked(
    control: Cr,
    act: impl FnOnce() -> Result<(), NorFlashErrorKind>,
) -> Result<(), NorFlashErrorKind> {
    if FLASH.cr().read().lock() {
        FLASH.keyr().write_value(KEY1);
        FLASH.keyr().write_value(KEY2);
    }
    FLASH.sr().write_value(Sr(ERRORS));
    FLASH.cr().write_value(control);
    let result = act();
    FLASH.cr().write(|w| w.set_lock(true));
    result
}

/// Waits until the flash has done what it was told. Were it never to, the watchdog would bite.
fn finished() -> Result<(), NorFlashErrorKind> {
    asm::dsb();
    loop {
        let status = FLASH.sr().read();
        if !status.bsy() {
            return if status.0 & ERRORS == 0 { Ok(()) } else { Err(NorFlashErrorKind::Other) };
        }
    }
}

/// Empties the data cache, which an erase does not (RM0090 section 3.6.4). It has to be off for it.
fn forget_cached() {
    let before = FLASH.acr().read();
    FLASH.acr().modify(|w| w.set_dcen(false));
    FLASH.acr().modify(|w| w.set_dcrst(true));
    FLASH.acr().modify(|w| w.set_dcrst(false));
    FLASH.acr().write_value(before);
}
