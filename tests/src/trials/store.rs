//! The settings' store over any flash: blank, in use, damaged or foreign, with power that fails at any
//! byte of a save or of a boot.
//!
//! - Saved is what the next boot finds, whole; a save that power failed in leaves the old or the new.
//! - Flash that was damaged has one of those that were ever saved, or none, and says which: never one
//!   that is mixed of two.
//! - Whatever it holds, a save with power works, and `feed` is called before each erase.

use firmware::settings::Settings;
use firmware::settings::store::{Origin, SaveFailed, Store};
use hal_mock::flash::{Flash, SECTOR, SIZE};

use super::Choices;

/// A flash, and what may be found in it.
struct Trial {
    flash: Flash,
    /// Those that were ever saved, or begun to be; the last is the newest.
    ever: Vec<Settings>,
    /// One of these is found; `None` is that there were none.
    may_be_found: Vec<Option<Settings>>,
    /// Nobody can say any more which.
    is_damaged: bool,
    /// It was damaged once: a save may leave that where it is. And power has failed since the last save.
    was_damaged: bool,
    was_cut: bool,
}

/// Settings that are unlike all others of another `n`, and some that are chosen.
fn settings(n: usize, choices: &mut Choices) -> Settings {
    let mut settings = Settings::DEFAULT;
    let mut set = |number, value| settings.set(number, value).expect("it is in range");
    set(32, 1 + n as i32);
    set(3, 8_000_000 - n as i32);
    for _ in 0..choices.below(4) {
        let (number, most) = choices.among(&[(1, 60_000), (208, 65_535), (279, 16), (48, 4095)]);
        set(number, choices.long().rem_euclid(most + 1));
    }
    settings
}

impl Trial {
    fn new(choices: &mut Choices) -> Self {
        let (flash, is_damaged) = match choices.below(8) {
            0 => (Flash::with(&choices.bytes(255)), true),
            1 => (Flash::with(&vec![choices.byte(); choices.below(SIZE as u32) as usize]), true),
            _ => (Flash::empty(), false),
        };
        let (ever, may_be_found) = (Vec::new(), vec![None]);
        Self { flash, ever, may_be_found, is_damaged, was_damaged: is_damaged, was_cut: false }
    }

    fn store(&self) -> Store<Flash> {
        Store::new(self.flash.clone(), 0..SIZE as u32)
    }

    /// A boot, with power.
    fn load(&mut self) {
        let (found, origin) = self.store().load(|| {});
        let again = self.store().load(|| {});
        // A boot that finds damage may mend it: the next one finds nothing.
        let is_mended = self.is_damaged && again == (Settings::DEFAULT, Origin::Defaults);
        assert!(
            again == (found, origin) || (is_mended && origin == Origin::Corrupt),
            "and at every boot"
        );
        match origin {
            Origin::Stored if self.is_damaged => {
                assert!(self.ever.contains(&found), "nobody has saved these: {found:?}");
            }
            Origin::Stored => {
                assert!(self.may_be_found.contains(&Some(found)), "{found:?} were not the last");
                self.may_be_found = vec![Some(found)];
            }
            Origin::Defaults | Origin::Corrupt => {
                assert_eq!(found, Settings::DEFAULT);
                let is_known = self.is_damaged
                    || (origin == Origin::Defaults && self.may_be_found.contains(&None));
                assert!(is_known, "what was saved is lost: {origin:?}");
                if !self.is_damaged {
                    self.may_be_found = vec![None];
                }
            }
        }
    }

    fn save(&mut self, choices: &mut Choices) {
        let new = settings(self.ever.len(), choices);
        self.ever.push(new);
        let (before, mut fed) = (self.flash.erases(), 0);
        let saved = self.store().save(&new, || fed += 1);
        if self.flash.restore_power() {
            self.was_cut = true;
            if saved == Err(SaveFailed) {
                self.may_be_found.push(Some(new));
                return;
            }
        } else {
            assert_eq!(self.flash.erases() - before, fed, "the watchdog is fed before each erase");
            let most = 1 + u32::from(self.was_cut);
            assert!(self.was_damaged || fed <= most, "{fed} erases in one save");
        }
        assert_eq!(saved, Ok(()), "it is not saved, and power was there");
        (self.may_be_found, self.is_damaged) = (vec![Some(new)], false);
        self.was_cut = false;
        self.load();
    }

    fn damage(&mut self, choices: &mut Choices) {
        let mut image = self.flash.image();
        let most = if choices.one_in(2) { SIZE as u32 } else { 4 * SECTOR as u32 / 16 };
        let at = choices.below(most) as usize;
        match choices.below(3) {
            0 => image[at] ^= 1 << choices.below(8),
            1 => {
                let count = choices.among(&[1, 8, 100, 1020, 5000, SECTOR]);
                let byte = choices.among(&[0xFF, 0, 0xAA, 0xC2]);
                image[at..].iter_mut().take(count).for_each(|place| *place = byte);
            }
            _ => {
                let bytes = choices.bytes(40);
                image[at..].iter_mut().zip(bytes).for_each(|(place, byte)| *place = byte);
            }
        }
        self.flash = Flash::with(&image);
        (self.is_damaged, self.was_damaged) = (true, true);
    }
}

pub(super) fn trial(choices: &mut Choices) {
    let mut trial = Trial::new(choices);
    for _ in 0..24 {
        match choices.below(7) {
            0..3 => trial.save(choices),
            3 => trial.load(),
            4 => {
                let bytes = choices.below(1400) as usize;
                trial.flash.lose_power_after(bytes, choices.one_in(2));
                trial.save(choices);
            }
            5 => {
                // A boot that mends may be cut off too.
                let bytes = choices.below(SECTOR as u32 + 64) as usize;
                trial.flash.lose_power_after(bytes, choices.one_in(2));
                trial.store().load(|| {});
                trial.was_cut |= trial.flash.restore_power();
                trial.load();
            }
            _ => trial.damage(choices),
        }
        if choices.are_over() {
            break;
        }
    }
    trial.save(choices);
}
