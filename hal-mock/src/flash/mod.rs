//! A NOR flash: three sectors of 16 KiB, as the STM32F4 has for the settings, in memory; what it holds may be
//! kept elsewhere too, as in a file.
//!
//! Erasing makes a sector all ones, writing only makes zeros of ones, in whole words of 4 bytes.
//! Power can be lost at any byte of either: what was done before stays, and the byte itself may be
//! half done.

#[cfg(feature = "host")]
mod file;

use std::cell::RefCell;
use std::ops::Range;
use std::rc::Rc;

use embedded_storage::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash, check_erase, check_read,
    check_write,
};

/// Bytes that are erased at once.
pub const SECTOR: usize = 16 * 1024;
/// Bytes in all.
pub const SIZE: usize = 3 * SECTOR;

/// A flash. Clones are handles to the same flash.
#[derive(Clone)]
pub struct Flash(Rc<RefCell<State>>);

/// Keeps what a flash holds elsewhere: is given all of it, and what of it has changed.
pub type Keep = Box<dyn FnMut(&[u8], Range<usize>) -> Result<(), FlashError>>;

struct State {
    bytes: Vec<u8>,
    keep: Option<Keep>,
    /// When power will be lost: bytes until then, and whether the next one is half done.
    power: Option<(usize, bool)>,
    erases: u32,
    writes: u32,
}

/// Why the flash did not do what it was asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FlashError {
    /// Out of bounds, or not aligned to words or sectors.
    Place(NorFlashErrorKind),
    /// There is no power.
    NoPower,
    /// It could not be kept.
    NotKept,
}

impl NorFlashError for FlashError {
    fn kind(&self) -> NorFlashErrorKind {
        match self {
            Self::Place(kind) => *kind,
            Self::NoPower | Self::NotKept => NorFlashErrorKind::Other,
        }
    }
}

impl Flash {
    /// A flash that was never written.
    pub fn empty() -> Self {
        Self::with(&[])
    }

    /// A flash that holds these bytes, all ones behind them.
    pub fn with(bytes: &[u8]) -> Self {
        let mut bytes = bytes.to_vec();
        bytes.resize(SIZE, 0xFF);
        Self(Rc::new(RefCell::new(State { bytes, keep: None, power: None, erases: 0, writes: 0 })))
    }

    /// The same, kept elsewhere from now on.
    pub fn kept(bytes: &[u8], keep: Keep) -> Self {
        let flash = Self::with(bytes);
        flash.0.borrow_mut().keep = Some(keep);
        flash
    }

    /// Loses power when so many bytes more have been written or erased; with `torn`, the next one
    /// is half done then.
    pub fn lose_power_after(&self, bytes: usize, torn: bool) {
        self.0.borrow_mut().power = Some((bytes, torn));
    }

    /// Gives power back. Whether it had been lost.
    pub fn restore_power(&self) -> bool {
        self.0.borrow_mut().power.take().is_some_and(|(left, _)| left == 0)
    }

    /// What it holds.
    pub fn image(&self) -> Vec<u8> {
        self.0.borrow().bytes.clone()
    }

    /// Sectors erased so far.
    pub fn erases(&self) -> u32 {
        self.0.borrow().erases
    }

    /// Times that it was written so far.
    pub fn writes(&self) -> u32 {
        self.0.borrow().writes
    }
}

impl State {
    /// Changes bytes one after the other, for as long as there is power.
    fn change(
        &mut self,
        at: usize,
        new: impl Fn(usize, u8) -> u8,
        count: usize,
    ) -> Result<(), FlashError> {
        let mut done = 0;
        while done < count {
            let byte = &mut self.bytes[at + done];
            let wanted = new(done, *byte);
            match &mut self.power {
                Some((0, torn)) => {
                    if std::mem::take(torn) {
                        *byte = *byte & 0xF0 | wanted & 0x0F;
                    }
                    return Err(FlashError::NoPower);
                }
                Some((left, _)) => *left -= 1,
                None => {}
            }
            *byte = wanted;
            done += 1;
        }
        match &mut self.keep {
            Some(keep) => keep(&self.bytes, at..at + count),
            None => Ok(()),
        }
    }
}

impl ErrorType for Flash {
    type Error = FlashError;
}

impl ReadNorFlash for Flash {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), FlashError> {
        check_read(self, offset, bytes.len()).map_err(FlashError::Place)?;
        let state = self.0.borrow();
        if matches!(state.power, Some((0, _))) {
            return Err(FlashError::NoPower);
        }
        let at = offset as usize;
        bytes.copy_from_slice(&state.bytes[at..at + bytes.len()]);
        Ok(())
    }

    fn capacity(&self) -> usize {
        SIZE
    }
}

impl NorFlash for Flash {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = SECTOR;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), FlashError> {
        check_erase(self, from, to).map_err(FlashError::Place)?;
        let mut state = self.0.borrow_mut();
        state.erases += (to - from) / SECTOR as u32;
        state.change(from as usize, |_, _| 0xFF, (to - from) as usize)
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashError> {
        check_write(self, offset, bytes.len()).map_err(FlashError::Place)?;
        let mut state = self.0.borrow_mut();
        state.writes += 1;
        state.change(offset as usize, |i, old| old & bytes[i], bytes.len())
    }
}
