//! Settings that survive: a log of records in flash, of which the last good one counts.
//!
//! Vocabulary: a *record* is all [numbered](super::table) settings as one item of
//! `sequential-storage`'s map, whose CRC-32 covers every byte of it; a *sector* is what is erased
//! at once.
//!
//! Promises, whenever power is lost (`hal-mock`'s tests try every byte of a save and of an erase):
//! - the next boot has what was saved before or what was being saved, whole;
//! - flash that holds nothing, or no more than the beginning of a first record, means defaults;
//!   flash that is damaged or foreign means defaults too, and [`Origin`] says so;
//! - a save erases one sector at the most, and none in all but one of a dozen saves: a
//!   record is appended to its sector, and the next sector was erased when this one was begun. Only
//!   the save behind one that power failed in may take two, and damaged flash more.
//!
//! The flash blocks, and so does everything here: nothing awaits, and `block_on` never waits.
//!
//! Numbers that a record does not name have their defaults, and numbers that this firmware does
//! not know are left out, so that settings outlive a change of the firmware either way.

use core::ops::Range;

use embassy_futures::block_on;
use embedded_storage::nor_flash::{ErrorType, NorFlash};
use embedded_storage_async::nor_flash as asynchronous;
use sequential_storage::Error;
use sequential_storage::cache::key_pointers::ArrayKeyPointers;
use sequential_storage::cache::{Cache, Uncached};
use sequential_storage::map::{MapConfig, MapStorage};

use super::table::COUNT;
use super::{SettingRefused, Settings};
use crate::fmt::warning;

/// What a record begins with: whose it is, and how it is laid out.
const HEADER: [u8; 5] = *b"OMSC\x01";
/// Bytes of one setting: number and value.
const ENTRY: usize = 6;
/// Room for the longest record, this firmware's or a newer one's.
const RECORD: usize = 1280;
/// The key of the only item.
const KEY: u8 = 0;

const _: () = assert!(HEADER.len() + ENTRY * COUNT + FILLER.len() < RECORD);

/// What the map puts before a record: the sector's mark, the item's header (CRC-32, length, CRC-16),
/// the key.
const MARK: usize = 4;
const BEFORE: usize = MARK + 8 + 1;
/// Bytes behind the last setting that keep a record from ending with a word. The map fills the word up with
/// zeros: one that power is lost in is nothing of the record, and so a last byte that is not blank tells that
/// the record is whole. An even number of settings needs none.
const FILLER: &[u8] = if COUNT.is_multiple_of(2) { &[] } else { &[1, 0] };
/// Where the first record ends, in whole words.
const FIRST_END: usize = (BEFORE + HEADER.len() + ENTRY * COUNT + FILLER.len()).next_multiple_of(4);

/// Where the settings in force come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    /// Nothing was ever saved: the defaults.
    Defaults,
    /// What was saved.
    Stored,
    /// What was stored is damaged or foreign: the defaults, and fault 25.
    Corrupt,
}

/// Why settings were not saved.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SaveFailed;

/// The flash itself fails.
#[derive(PartialEq, Eq)]
struct Unreadable;

/// Some sectors of a flash, two at least.
pub struct Store<F> {
    flash: F,
    range: Range<u32>,
}

impl<F: NorFlash> Store<F> {
    /// The store in these bytes of the flash: whole sectors, two at least.
    pub const fn new(flash: F, range: Range<u32>) -> Self {
        Self { flash, range }
    }

    /// What was saved last, and whether that is what it is. It may finish an erase that was
    /// interrupted, and calls `feed` before each that it begins.
    pub fn load(&mut self, mut feed: impl FnMut()) -> (Settings, Origin) {
        let never_saved = self.written() != Written::More;
        match self.stored(&mut feed) {
            Some(settings) => (settings, Origin::Stored),
            None if never_saved => (Settings::DEFAULT, Origin::Defaults),
            None => {
                warning!("the stored settings are damaged: defaults");
                (Settings::DEFAULT, Origin::Corrupt)
            }
        }
    }

    /// Saves settings, and reads them back. `feed` is called before each erase.
    ///
    /// # Errors
    /// [`SaveFailed`]: the flash does not take them.
    pub fn save(&mut self, settings: &Settings, mut feed: impl FnMut()) -> Result<(), SaveFailed> {
        // Begun anew, so that the next one is a first record again if it is torn too. Not one that lacks
        // nothing but the filling of its last word: it can be read.
        if self.written() == Written::Begun && self.holds_nothing(&mut feed) {
            self.erase(
                self.range.start..self.range.start.saturating_add(F::ERASE_SIZE as u32),
                &mut feed,
            );
        }
        // In damaged flash a try may only mend the map, or find its place spoiled: the next one goes behind
        // that, and there are no more places than these.
        let size = self.range.end.saturating_sub(self.range.start) as usize;
        if (0..=size / FIRST_END).any(|_| self.append(settings, &mut feed)) {
            return Ok(());
        }
        // Nothing readable is lost: while there was a record, the map took another one. And flash that cannot
        // be read now may hold one.
        if self.holds_nothing(&mut feed) {
            let erased = self.erase(self.range.clone(), &mut feed);
            if erased && self.append(settings, &mut feed) {
                return Ok(());
            }
        }
        Err(SaveFailed)
    }

    /// Whether a record was written and can be read.
    fn append(&mut self, settings: &Settings, feed: Feed<'_>) -> bool {
        let mut record = [0; RECORD];
        let Some(record) = write(settings, &mut record) else { return false };
        let mut buffer = [0; RECORD];
        let stored = match map(&mut self.flash, &self.range, feed) {
            Some(mut map) => block_on(map.store_item(&mut buffer, &KEY, &record)).is_ok(),
            None => false,
        };
        stored && self.fetch(&mut buffer, feed) == Ok(Some(record))
    }

    /// Whether the flash can be read, and no settings are in it.
    fn holds_nothing(&mut self, feed: Feed<'_>) -> bool {
        matches!(self.fetch(&mut [0; RECORD], feed), Ok(record) if record.and_then(read).is_none())
    }

    /// The settings of the last good record, if it is one of ours.
    fn stored(&mut self, feed: Feed<'_>) -> Option<Settings> {
        read(self.fetch(&mut [0; RECORD], feed).ok()??)
    }

    /// The last good record, if the flash can be read.
    fn fetch<'b>(
        &mut self,
        buffer: &'b mut [u8; RECORD],
        feed: Feed<'_>,
    ) -> Result<Option<&'b [u8]>, Unreadable> {
        let Some(mut map) = map(&mut self.flash, &self.range, feed) else { return Ok(None) };
        match block_on(map.fetch_item(buffer, &KEY)) {
            Ok(record) => Ok(record),
            Err(Error::Storage { .. }) => Err(Unreadable),
            Err(_) => Ok(None),
        }
    }

    /// Whether these sectors were erased.
    fn erase(&mut self, Range { start, end }: Range<u32>, feed: Feed<'_>) -> bool {
        let mut flash = Fed { flash: &mut self.flash, feed };
        block_on(asynchronous::NorFlash::erase(&mut flash, start, end)).is_ok()
    }

    /// What was ever written, whether or not it can be read.
    fn written(&mut self) -> Written {
        let mut record = [0; RECORD];
        let Some(record) = write(&Settings::DEFAULT, &mut record) else { return Written::More };
        let mut written = Written::Nothing;
        let mut buffer = [0; 64];
        for begin in self.range.clone().step_by(buffer.len()) {
            if self.flash.read(begin, &mut buffer).is_err() {
                return Written::More;
            }
            let first = begin.saturating_sub(self.range.start) as usize;
            for (at, byte) in (first..).zip(buffer).filter(|(_, byte)| *byte != 0xFF) {
                if !may_be_begun(record, at, byte) {
                    return Written::More;
                }
                written = Written::Begun;
            }
        }
        written
    }
}

/// What was ever written into the flash.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Written {
    Nothing,
    /// The beginning of a first record, and never its end.
    Begun,
    /// A record, or what is none.
    More,
}

/// Whether a byte at this place of the flash may be left of a first record that was begun and torn,
/// or of that one's erase. The place must not be in the filling of the last word, which is blank in all of them.
/// `record` is any record.
fn may_be_begun(record: &[u8], at: usize, byte: u8) -> bool {
    // The CRCs are not known, the values may be any.
    let expected = match at.checked_sub(BEFORE) {
        None => match at {
            ..MARK => Some(0),
            8 | 9 => (record.len().saturating_add(1) as u16).to_le_bytes().get(at & 1).copied(),
            12 => Some(KEY),
            _ => None,
        },
        Some(at) => match at.checked_sub(HEADER.len()) {
            Some(entries) if entries % ENTRY >= 2 => None,
            _ => record.get(at).copied(),
        },
    };
    // A byte that is half written has ones in place of zeros.
    at < FIRST_END.saturating_sub(1) && expected.is_none_or(|expected| byte & expected == expected)
}

/// The map. It remembers where the record is for as long as a call lasts: without that a save which
/// begins a sector would read all records once for each.
type Map<'a, F> =
    MapStorage<u8, Fed<'a, F>, Cache<Uncached, Uncached, ArrayKeyPointers<u8, 1>, u8>>;

/// The map over the flash; `None` if the range is no two sectors.
fn map<'a, F: NorFlash>(
    flash: &'a mut F,
    range: &Range<u32>,
    feed: Feed<'a>,
) -> Option<Map<'a, F>> {
    let config = MapConfig::try_new(range.clone()).ok()?;
    let cache = Cache::new(Uncached, Uncached, ArrayKeyPointers::new());
    Some(MapStorage::new(Fed { flash, feed }, config, cache))
}

/// The flash as the map wants it, with a watchdog that is fed before each sector's erase.
struct Fed<'a, F> {
    flash: &'a mut F,
    feed: Feed<'a>,
}

/// Feeds the watchdog. By a pointer, or an image would hold the map once for each who calls.
type Feed<'a> = &'a mut dyn FnMut();

impl<F: NorFlash> ErrorType for Fed<'_, F> {
    type Error = F::Error;
}

impl<F: NorFlash> asynchronous::ReadNorFlash for Fed<'_, F> {
    const READ_SIZE: usize = F::READ_SIZE;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), F::Error> {
        self.flash.read(offset, bytes)
    }

    fn capacity(&self) -> usize {
        self.flash.capacity()
    }
}

impl<F: NorFlash> asynchronous::NorFlash for Fed<'_, F> {
    const WRITE_SIZE: usize = F::WRITE_SIZE;
    const ERASE_SIZE: usize = F::ERASE_SIZE;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), F::Error> {
        for sector in (from..to).step_by(F::ERASE_SIZE) {
            (self.feed)();
            self.flash.erase(sector, sector.saturating_add(F::ERASE_SIZE as u32))?;
        }
        Ok(())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), F::Error> {
        self.flash.write(offset, bytes)
    }
}

/// Writes a record into `out` and answers the part it took.
fn write<'b>(settings: &Settings, out: &'b mut [u8; RECORD]) -> Option<&'b [u8]> {
    let (header, entries) = out.split_first_chunk_mut()?;
    *header = HEADER;
    let (entries, _) = entries.as_chunks_mut::<ENTRY>();
    for (entry, (number, value)) in entries.iter_mut().zip(settings.iter()) {
        let ([n0, n1], [v0, v1, v2, v3]) = (number.to_le_bytes(), value.to_le_bytes());
        *entry = [n0, n1, v0, v1, v2, v3];
    }
    let end = HEADER.len() + ENTRY * COUNT;
    out.get_mut(end..end + FILLER.len())?.copy_from_slice(FILLER);
    out.get(..end + FILLER.len())
}

/// Reads a record; `None` if it is not ours, or holds what could never have been saved.
fn read(record: &[u8]) -> Option<Settings> {
    let (entries, rest) = record.strip_prefix(&HEADER)?.as_chunks::<ENTRY>();
    let mut settings = Settings::DEFAULT;
    for &[n0, n1, v0, v1, v2, v3] in entries {
        let number = u16::from_le_bytes([n0, n1]);
        match settings.set(number, i32::from_le_bytes([v0, v1, v2, v3])) {
            Ok(()) | Err(SettingRefused::NoSuchSetting(_)) => {}
            Err(_) => return None,
        }
    }
    let is_whole = rest.is_empty() || rest == [1, 0];
    (is_whole && settings.check().is_ok()).then_some(settings)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unlike_the_defaults() -> Settings {
        let mut settings = Settings::DEFAULT;
        for (number, value) in Settings::DEFAULT.iter() {
            let (_, high) = settings.describe(number).unwrap().range;
            settings.set(number, if value == high { value - 1 } else { value + 1 }).unwrap();
        }
        settings
    }

    #[test]
    fn a_record_reads_back_as_it_was_written() {
        for settings in [Settings::DEFAULT, unlike_the_defaults()] {
            let mut buffer = [0; RECORD];
            let record = write(&settings, &mut buffer).unwrap();
            assert_eq!(read(record), Some(settings));
            // What tells a whole record from one that is torn.
            assert!(!(BEFORE + record.len()).is_multiple_of(4));
        }
    }

    #[test]
    fn a_record_of_another_firmware_keeps_what_both_know() {
        // 32, and 999 of the future; 56, 57 and 63 of the past.
        let entries = [
            [32, 0, 20, 0, 0, 0],
            [0xE7, 3, 1, 2, 3, 4],
            [56, 0, 0, 2, 0, 0],
            [57, 0, 0, 8, 0, 0],
            [63, 0, 64, 0, 0, 0],
        ];
        let record = [&HEADER[..], entries.as_flattened()].concat();
        let mut expected = Settings::DEFAULT;
        expected.set(32, 20).unwrap();
        assert_eq!(read(&record), Some(expected));
    }

    #[test]
    fn a_record_that_was_never_saved_is_not_read() {
        let mut buffer = [0; RECORD];
        let good = write(&Settings::DEFAULT, &mut buffer).unwrap().to_vec();
        assert_eq!(read(&good[..good.len() - 1]), None);
        assert_eq!(read(&[]), None);
        let mut foreign = good.clone();
        foreign[4] = 2; // another layout
        assert_eq!(read(&foreign), None);
        let mut out_of_range = good;
        out_of_range[HEADER.len() + 5] = 0x7F;
        assert_eq!(read(&out_of_range), None);
    }
}
