//! Flash that cannot be read for a while loses nothing that it held.

use std::cell::Cell;
use std::rc::Rc;

use embedded_storage::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use firmware::settings::Settings;
use firmware::settings::store::Store;
use firmware::settings::table::COUNT;
use hal_mock::flash::{Flash, FlashError, SIZE};

/// A flash whose reads fail from the `from`th on.
struct Blind {
    flash: Flash,
    reads: Rc<Cell<u32>>,
    from: u32,
}

impl ErrorType for Blind {
    type Error = FlashError;
}

impl ReadNorFlash for Blind {
    const READ_SIZE: usize = 1;
    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), FlashError> {
        self.reads.set(self.reads.get() + 1);
        if self.reads.get() > self.from {
            return Err(FlashError::NoPower);
        }
        self.flash.read(offset, bytes)
    }
    fn capacity(&self) -> usize {
        SIZE
    }
}

impl NorFlash for Blind {
    const WRITE_SIZE: usize = Flash::WRITE_SIZE;
    const ERASE_SIZE: usize = Flash::ERASE_SIZE;
    fn erase(&mut self, from: u32, to: u32) -> Result<(), FlashError> {
        self.flash.erase(from, to)
    }
    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashError> {
        self.flash.write(offset, bytes)
    }
}

/// Reads of a save until it has looked what was ever written.
const LOOKED: u32 = SIZE as u32 / 64 - 10;

fn settings(n: i32) -> Settings {
    let mut settings = Settings::DEFAULT;
    settings.set(32, n).unwrap();
    settings
}

fn load(flash: &Flash) -> Settings {
    Store::new(flash.clone(), 0..SIZE as u32).load(|| {}).0
}

fn check(image: &[u8], first_read: u32, what: &str) {
    let found = load(&Flash::with(image));
    for from in first_read.. {
        let flash = Flash::with(image);
        let blind = Blind { flash: flash.clone(), reads: Rc::default(), from };
        let saved = Store::new(blind, 0..SIZE as u32).save(&settings(999), || {});
        let now = load(&flash);
        assert!(now == found || now == settings(999), "{what}, blind from read {from}: lost");
        if saved.is_ok() {
            assert_eq!(now, settings(999));
            break;
        }
    }
}

#[test]
fn flash_that_goes_blind_in_a_save_loses_nothing_that_was_found() {
    // At the end of a first record, where its last word lacks no more than its filling.
    for cut in 6 * COUNT + 13..6 * COUNT + 24 {
        let flash = Flash::empty();
        flash.lose_power_after(cut, false);
        let _ = Store::new(flash.clone(), 0..SIZE as u32).save(&settings(1), || {});
        flash.restore_power();
        check(&flash.image(), LOOKED, &format!("the first record, cut at {cut}"));
    }
    let flash = Flash::empty();
    for n in 1..60 {
        Store::new(flash.clone(), 0..SIZE as u32).save(&settings(n), || {}).unwrap();
        if n % 13 < 2 {
            check(&flash.image(), LOOKED, &format!("{n} records"));
        }
    }
}
