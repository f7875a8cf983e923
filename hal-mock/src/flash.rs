//! A NOR flash: three sectors of 16 KiB, as the STM32F4 has for the settings, in memory or in a
//! file.
//!
//! Erasing makes a sector all ones, writing only makes zeros of ones, in whole words of 4 bytes.
//! Power can be lost at any byte of either: what was done before stays, and the byte itself may be
//! half done. In a file, what a program did before it was killed is there for the next one. A file that
//! is taken away, or that a full disk does not take, fails a save and nothing else.

use std::cell::RefCell;
use std::fs::{File, TryLockError};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::Path;
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

struct State {
    bytes: Vec<u8>,
    file: Option<File>,
    /// The file has not taken all that was written.
    is_behind: bool,
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
    /// The file could not be written.
    File,
}

impl NorFlashError for FlashError {
    fn kind(&self) -> NorFlashErrorKind {
        match self {
            Self::Place(kind) => *kind,
            Self::NoPower | Self::File => NorFlashErrorKind::Other,
        }
    }
}

impl Flash {
    /// A flash that was never written.
    pub fn empty() -> Self {
        Self::holding(vec![0xFF; SIZE], None)
    }

    /// A flash that holds these bytes, all ones behind them.
    pub fn with(bytes: &[u8]) -> Self {
        let mut all = bytes.to_vec();
        all.resize(SIZE, 0xFF);
        Self::holding(all, None)
    }

    /// A flash in a file, which is made if it is not there.
    ///
    /// # Errors
    /// In one line, what is wrong with the file.
    pub fn open(path: &Path) -> Result<Self, String> {
        let complain = |e: std::io::Error| e.to_string();
        // Before it is opened: a FIFO would wait for somebody.
        match path.metadata().map(|metadata| metadata.file_type()) {
            #[cfg(unix)]
            Ok(kind) if std::os::unix::fs::FileTypeExt::is_char_device(&kind) => {
                log::warn!("{}: keeps nothing, and so no settings are saved", path.display());
                let file = File::options().write(true).open(path).map_err(complain)?;
                return Ok(Self::holding(vec![0xFF; SIZE], Some(file)));
            }
            Ok(kind) if !kind.is_file() => return Err("must be a file, or not be there".into()),
            Ok(_) | Err(_) => {}
        }
        let mut options = File::options();
        options.read(true).write(true).create(true).truncate(false);
        // Shared with nobody, so that nobody removes it meanwhile.
        #[cfg(windows)]
        std::os::windows::fs::OpenOptionsExt::share_mode(&mut options, 0);
        let mut file = options.open(path).map_err(complain)?;
        file.try_lock().map_err(|error| match error {
            TryLockError::WouldBlock => "another board is using it".into(),
            TryLockError::Error(error) => complain(error),
        })?;
        let mut bytes = Vec::new();
        (&file).take(SIZE as u64 + 1).read_to_end(&mut bytes).map_err(complain)?;
        // Empty, or what a full disk has left of one that was being made.
        if bytes.len() < SIZE && bytes.iter().all(|byte| *byte == 0xFF) {
            bytes = vec![0xFF; SIZE];
            file.rewind().and_then(|()| file.write_all(&bytes)).map_err(complain)?;
        }
        if bytes.len() != SIZE {
            return Err(format!("not a board's settings: must be {SIZE} bytes, or not be there"));
        }
        Ok(Self::holding(bytes, Some(file)))
    }

    fn holding(bytes: Vec<u8>, file: Option<File>) -> Self {
        let (is_behind, power, erases, writes) = (false, None, 0, 0);
        Self(Rc::new(RefCell::new(State { bytes, file, is_behind, power, erases, writes })))
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
        let kept = self.keep(at, count);
        self.is_behind = kept.is_err();
        kept.map_err(|e| {
            log::warn!("settings are not saved: {e}");
            FlashError::File
        })
    }

    /// Brings the file up to date, if there is one and it is still there.
    fn keep(&mut self, at: usize, count: usize) -> std::io::Result<()> {
        let Some(file) = &mut self.file else { return Ok(()) };
        let metadata = file.metadata()?;
        if !metadata.is_file() {
            return Err(std::io::Error::other("their file keeps nothing"));
        }
        #[cfg(unix)]
        if std::os::unix::fs::MetadataExt::nlink(&metadata) == 0 {
            return Err(std::io::Error::other("their file was removed; start the board again"));
        }
        let is_cut_short = metadata.len() != SIZE as u64;
        if is_cut_short {
            log::warn!("the file with the settings was cut short, and is written anew");
        }
        let changed = if is_cut_short || self.is_behind { 0..SIZE } else { at..at + count };
        file.seek(SeekFrom::Start(changed.start as u64))?;
        file.write_all(&self.bytes[changed])
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
