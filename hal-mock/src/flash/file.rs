//! A flash in a file: what a program did before it was killed is there for the next one. A file that is taken
//! away, or that a full disk does not take, fails a save and nothing else.

use std::fs::{File, TryLockError};
use std::io::{Read, Seek, SeekFrom, Write};
use std::ops::Range;
use std::path::Path;

use super::{Flash, FlashError, SIZE};

impl Flash {
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
                return Ok(Kept::new(file).flash(&[]));
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
        Ok(Kept::new(file).flash(&bytes))
    }
}

struct Kept {
    file: File,
    /// It has not taken all that was written.
    is_behind: bool,
}

impl Kept {
    fn new(file: File) -> Self {
        Self { file, is_behind: false }
    }

    /// A flash that holds these bytes, and goes on in this file.
    fn flash(mut self, bytes: &[u8]) -> Flash {
        let keep = move |bytes: &[u8], changed: Range<usize>| {
            let kept = self.take(bytes, changed);
            self.is_behind = kept.is_err();
            kept.map_err(|error| {
                log::warn!("settings are not saved: {error}");
                FlashError::NotKept
            })
        };
        Flash::kept(bytes, Box::new(keep))
    }

    /// Brings the file up to date, if it is still there.
    fn take(&mut self, bytes: &[u8], changed: Range<usize>) -> std::io::Result<()> {
        let metadata = self.file.metadata()?;
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
        let changed = if is_cut_short || self.is_behind { 0..SIZE } else { changed };
        self.file.seek(SeekFrom::Start(changed.start as u64))?;
        self.file.write_all(&bytes[changed])
    }
}
