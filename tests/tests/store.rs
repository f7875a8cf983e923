//! Settings in flash: whatever happens to the power, the next boot has the old ones or the new
//! ones, and says when it has neither.

use firmware::settings::Settings;
use firmware::settings::store::{Origin, SaveFailed, Store};
use firmware::settings::table::COUNT;
use hal_mock::flash::{Flash, SECTOR, SIZE};

/// Bytes of a record in the flash, at least: six a setting, and what the map and we put around them.
const RECORD: usize = 6 * COUNT + 13;

/// Settings that are unlike all others of another `n`.
fn settings(n: u32) -> Settings {
    let mut settings = Settings::DEFAULT;
    settings.set(32, 1 + (n % 60_000) as i32).unwrap();
    settings.set(3, 8_000_000 - n as i32).unwrap();
    settings
}

fn store(flash: &Flash) -> Store<Flash> {
    Store::new(flash.clone(), 0..SIZE as u32)
}

fn load(flash: &Flash) -> (Settings, Origin) {
    store(flash).load(|| {})
}

fn save(flash: &Flash, n: u32) -> Result<(), SaveFailed> {
    store(flash).save(&settings(n), || {})
}

/// The same flash in another board.
fn copy(flash: &Flash) -> Flash {
    Flash::with(&flash.image())
}

/// Saves 1, 2, 3... until `last` says that it was the last.
fn save_until(mut last: impl FnMut(&Flash) -> bool) -> (Flash, u32) {
    let flash = Flash::empty();
    for n in 1.. {
        save(&flash, n).unwrap();
        if last(&flash) {
            return (flash, n);
        }
    }
    unreachable!()
}

/// Cuts the power at every byte of saving `n + 1` after `n`, and behind each `stride`th of these
/// cuts at each `stride`th byte of the boot too. Answers how many bytes the save took.
fn cut_everywhere(before: &Flash, n: u32, stride: usize) -> usize {
    for torn in [false, true] {
        for cut in 0.. {
            let flash = copy(before);
            flash.lose_power_after(cut, torn);
            let saved = save(&flash, n + 1);
            if !flash.restore_power() && saved.is_ok() {
                assert_eq!(load(&flash), (settings(n + 1), Origin::Stored));
                if torn {
                    return cut;
                }
                break;
            }
            assert_eq!(saved, Err(SaveFailed), "after {cut} bytes");
            recovers(&flash, n, &format!("{cut} bytes, torn: {torn}"));
            // A boot that mends may be cut off too.
            for second in (0..).step_by(stride).take_while(|_| cut % stride == 0) {
                let flash = copy(&flash);
                flash.lose_power_after(second, torn);
                load(&flash);
                if !flash.restore_power() {
                    break;
                }
                recovers(&flash, n, &format!("{cut} bytes, then {second}, torn: {torn}"));
            }
        }
    }
    unreachable!()
}

/// What was being saved behind `n` is there, or what was saved before, and the next save works.
fn recovers(flash: &Flash, n: u32, what: &str) {
    let flash = copy(flash);
    let (found, origin) = load(&flash);
    if n == 0 && found == Settings::DEFAULT {
        assert_eq!(origin, Origin::Defaults, "{what}");
    } else {
        assert!(found == settings(n) || found == settings(n + 1), "{what}: {found:?}");
        assert_eq!(origin, Origin::Stored, "{what}");
    }
    assert_eq!(load(&flash), (found, origin), "{what}: and at every boot");
    let before = flash.erases();
    save(&flash, n + 2).unwrap_or_else(|_| panic!("{what}: cannot save again"));
    let erased = flash.erases() - before;
    assert!(erased <= 2, "{what}: {erased} erases in one save");
    assert_eq!(load(&flash), (settings(n + 2), Origin::Stored), "{what}");
}

#[test]
fn a_flash_that_was_never_written_means_defaults_and_is_no_fault() {
    assert_eq!(load(&Flash::empty()), (Settings::DEFAULT, Origin::Defaults));
}

#[test]
fn what_was_saved_is_there_after_a_thousand_saves_that_wear_the_sectors_evenly() {
    let flash = Flash::empty();
    for n in 1..=1000 {
        save(&flash, n).unwrap();
        assert_eq!(load(&flash), (settings(n), Origin::Stored));
    }
    // The sectors that 1000 records fill, and one begun; behind the second, each begun erases the next.
    let filled = 1000 / (SECTOR / RECORD);
    assert_eq!(flash.erases() as usize, filled - 1);
}

#[test]
fn a_save_erases_one_sector_at_the_most_and_feeds_the_watchdog_before_it() {
    let flash = Flash::empty();
    let mut erasing = 0;
    for n in 1..=1000 {
        let (mut fed, before) = (0, flash.erases());
        store(&flash).save(&settings(n), || fed += 1).unwrap();
        assert_eq!(flash.erases() - before, fed);
        assert!(fed <= 1, "{fed} erases in one save");
        erasing += fed;
    }
    assert!(erasing > 0);
}

#[test]
fn power_lost_at_any_byte_of_the_first_save_leaves_defaults_or_the_new_ones() {
    assert!((RECORD..RECORD + 128).contains(&cut_everywhere(&Flash::empty(), 0, 1)));
}

#[test]
fn power_lost_at_any_byte_of_the_first_save_and_in_the_next_one_too_loses_nothing_that_was_found() {
    for (first, second) in (0..RECORD + 40).flat_map(|first| [(first, 0), (first, 600)]) {
        let flash = Flash::empty();
        flash.lose_power_after(first, false);
        let _ = save(&flash, 1);
        flash.restore_power();
        let (found, _) = load(&flash);
        flash.lose_power_after(second, false);
        assert_eq!(save(&flash, 2), Err(SaveFailed));
        flash.restore_power();
        assert_eq!(load(&flash).0, found, "cut at {first}, then at {second}");
    }
}

#[test]
fn power_lost_at_any_byte_of_a_save_leaves_the_old_or_the_new() {
    let (flash, n) = save_until(|flash| flash.image()[RECORD / 2] != 0xFF);
    assert!((RECORD..RECORD + 128).contains(&cut_everywhere(&flash, n, 1)));
}

#[test]
fn flash_that_cannot_be_read_is_not_taken_for_empty_and_erased() {
    let (flash, n) = save_until(|_| true);
    for cut in 0..RECORD {
        let flash = copy(&flash);
        flash.lose_power_after(cut, false);
        assert_eq!(
            (save(&flash, n + 1), flash.erases()),
            (Err(SaveFailed), 0),
            "after {cut} bytes"
        );
    }
}

#[test]
fn power_lost_at_any_byte_of_a_save_into_an_empty_sector_leaves_the_old_or_the_new() {
    // The last record of the first sector, then one of the second.
    let (full, _) = save_until(|flash| flash.image()[SECTOR] != 0xFF);
    let mut last = None;
    let (_, next) = save_until(|flash| {
        let done = flash.image() == full.image();
        if !done {
            last = Some(copy(flash));
        }
        done
    });
    assert!((RECORD..RECORD + 128).contains(&cut_everywhere(&last.unwrap(), next - 1, 1)));
}

#[test]
fn power_lost_at_any_byte_of_an_erase_leaves_the_old_or_the_new() {
    // The save that erases the sector which it will need next.
    let mut last = None;
    let (_, next) = save_until(|flash| {
        let done = flash.erases() > 0;
        if !done {
            last = Some(copy(flash));
        }
        done
    });
    let bytes = cut_everywhere(&last.unwrap(), next - 1, 1021);
    assert!((SECTOR + RECORD..SECTOR + RECORD + 128).contains(&bytes), "{bytes}");
}

#[test]
fn a_foreign_flash_means_defaults_and_a_fault_and_can_be_used() {
    let noise = |seed: u32| {
        let mut state = seed;
        let next = move || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 24) as u8
        };
        std::iter::repeat_with(next).take(SIZE).collect::<Vec<_>>()
    };
    let mut images: Vec<Vec<u8>> = (0..200).map(noise).collect();
    images.extend([
        vec![0; SIZE],
        vec![0x5E; SIZE],
        vec![0; SECTOR],
        vec![0; 100],
        b"somebody else's text".into(),
    ]);
    images.push([vec![0xFF; SIZE - 1], vec![0]].concat());
    for (i, image) in images.iter().enumerate() {
        let flash = Flash::with(image);
        assert_eq!(load(&flash), (Settings::DEFAULT, Origin::Corrupt), "image {i}");
        save(&flash, 7).unwrap_or_else(|_| panic!("image {i} cannot be used"));
        assert_eq!(load(&flash), (settings(7), Origin::Stored), "image {i}");
    }
}

#[test]
fn a_save_works_at_once_whatever_part_of_a_sector_has_become_blank() {
    for n in [3, 20, 40, 70, 90] {
        let flash = Flash::empty();
        (1..=n).for_each(|n| save(&flash, n).unwrap());
        let image = flash.image();
        for from in (0..SIZE).step_by(SECTOR / 16) {
            for count in [8, 100, RECORD, 5000, SECTOR] {
                let mut image = image.clone();
                image[from..].iter_mut().take(count).for_each(|byte| *byte = 0xFF);
                let flash = Flash::with(&image);
                let what = format!("{n} records, {count} bytes from {from}");
                save(&flash, n + 1).unwrap_or_else(|_| panic!("{what}: not saved"));
                assert_eq!(load(&flash), (settings(n + 1), Origin::Stored), "{what}");
            }
        }
    }
}

#[test]
fn a_bit_that_falls_over_costs_a_record_and_never_mixes_two() {
    let flash = Flash::empty();
    for n in 1..=3 {
        save(&flash, n).unwrap();
    }
    let image = flash.image();
    let mut seen = [0; 4];
    let used = image.iter().rposition(|&byte| byte != 0xFF).unwrap() + 1;
    for bit in 0..used * 8 {
        let mut image = image.clone();
        image[bit / 8] ^= 1 << (bit % 8);
        let (found, origin) = load(&Flash::with(&image));
        assert_eq!(origin, Origin::Stored, "bit {bit}");
        let n = (2..=3).find(|n| found == settings(*n));
        seen[n.unwrap_or_else(|| panic!("bit {bit}: {found:?}")) as usize] += 1;
    }
    assert!(seen[2] > 4000 && seen[3] > 4000, "{seen:?}");
}

#[test]
fn a_damaged_head_of_a_sector_costs_no_save_behind_it() {
    for byte in [0xC2, 0xAA, 0x00, 0x55, 0xF0] {
        for sector in 0..3 {
            for n in [0, 1, 30, 60, 90] {
                let flash = Flash::empty();
                (1..=n).for_each(|n| save(&flash, n).unwrap());
                let mut image = flash.image();
                image[sector * SECTOR..][..1020].fill(byte);
                let flash = Flash::with(&image);
                for more in 1..=100 {
                    let what = format!("{byte:02x} in sector {sector} after {n}, save {more}");
                    save(&flash, n + more).unwrap_or_else(|_| panic!("{what}: not saved"));
                    assert_eq!(load(&flash), (settings(n + more), Origin::Stored), "{what}");
                }
                assert!(flash.erases() > 0);
            }
        }
    }
}

#[test]
fn a_save_works_at_once_however_much_of_a_sector_is_damaged_before_it_gets_there() {
    for spoiled in [0, 100, 700, RECORD, 2 * RECORD + 300] {
        for (byte, count) in [(0xAA, 5000), (0xAA, 500), (0, 5000), (0xD1, SECTOR)] {
            for cut in [0, 40, 300, 700] {
                let flash = Flash::empty();
                (1..=2).for_each(|n| save(&flash, n).unwrap());
                let mut image = flash.image();
                let free = image.iter().rposition(|&byte| byte != 0xFF).unwrap() + 1;
                image[free + spoiled + RECORD / 2..][..4].fill(0xD1);
                image[free + spoiled + RECORD..]
                    .iter_mut()
                    .take(count)
                    .for_each(|place| *place = byte);
                let flash = Flash::with(&image);
                flash.lose_power_after(cut, false);
                assert_eq!(save(&flash, 3), Err(SaveFailed));
                assert!(flash.restore_power());
                for n in 4..20 {
                    let what = format!("{count} x {byte:02x} after {spoiled}, cut at {cut}, {n}");
                    save(&flash, n).unwrap_or_else(|_| panic!("{what}: not saved"));
                    assert_eq!(load(&flash), (settings(n), Origin::Stored), "{what}");
                }
            }
        }
    }
}

#[test]
fn power_lost_in_several_saves_in_a_row_leaves_what_was_saved_last() {
    for first in (0..RECORD + 40).step_by(7) {
        for (saved, then) in [(0, 3), (1, 3), (20, 60), (60, 3)] {
            let flash = Flash::empty();
            (1..=saved).for_each(|n| save(&flash, n).unwrap());
            let mut last = saved;
            for k in 0..then {
                let n = saved + 1 + k;
                flash.lose_power_after((first + 131 * k as usize) % (RECORD + 40), k % 2 == 0);
                let done = save(&flash, n);
                if flash.restore_power() {
                    assert_eq!(done, Err(SaveFailed));
                }
                let (found, origin) = load(&flash);
                let what = format!("{saved} saved, cut at {first}, {k}: {origin:?}");
                if found == settings(n) {
                    last = n;
                }
                if last == 0 {
                    assert_eq!((found, origin), (Settings::DEFAULT, Origin::Defaults), "{what}");
                } else {
                    assert_eq!((found, origin), (settings(last), Origin::Stored), "{what}");
                }
            }
            save(&flash, 999).unwrap();
            assert_eq!(load(&flash), (settings(999), Origin::Stored));
        }
    }
}
