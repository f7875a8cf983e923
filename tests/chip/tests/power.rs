//! Power that is lost while settings are saved, and what the watchdog and the brown-out leave behind.
//!
//! Power comes back with the flash as it had been at that moment, word by word (`part::flash`'s journal),
//! and with anything in RAM. A word, or a sector, that power is lost in has some of its bits. A start takes
//! a second here: the image starts at some of the words, and at every one of them what it loads its
//! settings with, on this computer.

use chip::bench::pms5005::Host;
use chip::bench::world::F407;
use chip::part::flash::Change;
use firmware::settings::Settings;
use firmware::settings::store::{Origin as Loaded, Store};
use protocol::extension::{Action, Fault, Origin, Request, ResetCause, Verdict};
use protocol::pms5005::{Command, Quantity};
use rigless::device::Level;
use rigless::soc::Width;

const IMAGE: &str = "pms5005-f407";
/// The settings' sectors.
const BEGIN: u64 = 0x0800_4000;
const SECTOR: usize = 0x4000;
/// What orders the loader, where a start looks for it (`board::system`).
const START_LOADER: u64 = 0xDF0B_007E;

/// The settings' flash.
type Flash = Vec<u8>;

fn blank() -> Flash {
    vec![0xFF; 3 * SECTOR]
}

/// Settings from the beginning to the end of a record, as save `n` has them, from 1.
fn told(n: i32) -> [(u16, i32); 4] {
    [(1, 300 + n), (32, 40 + n), (93, 10 + n), (168, 1 + n)]
}

/// As nobody has saved them.
const DEFAULTS: [(u16, i32); 4] = [(1, 2000), (32, 50), (93, 10), (168, 20)];

/// The same numbers in every run.
fn random(seed: &mut u64) -> u64 {
    *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    *seed >> 33
}

/// A change that power is lost in leaves some bits as they were; one that is whole leaves none.
fn change(flash: &mut Flash, change: Change, mut as_it_was: impl FnMut() -> u32) {
    match change {
        Change::Word { address, value } => {
            let at = (address - BEGIN) as usize;
            let word: &mut [u8; 4] = flash[at..].first_chunk_mut().unwrap();
            let (was, value) = (u32::from_le_bytes(*word), value as u32);
            *word = (value | was & as_it_was()).to_le_bytes();
        }
        Change::Erased(sector) => {
            let begin = (sector as usize - 1) * SECTOR;
            for word in flash[begin..begin + SECTOR].as_chunks_mut().0 {
                *word = (u32::from_le_bytes(*word) | !as_it_was()).to_le_bytes();
            }
        }
    }
}

fn whole(flash: &mut Flash, changes: &[Change]) {
    changes.iter().for_each(|&each| change(flash, each, || 0));
}

/// Switches on, and sees what was saved last: one save of all, or the defaults of all, for 0.
fn switch_on(host: &mut Host, flash: &Flash) -> i32 {
    let flash = flash.clone();
    host.bench.with(move |stand| stand.power_cycle(&flash));
    host.heard();
    host.wait("telemetry", |frame| frame.report());
    let identity = host.identity();
    assert_eq!(identity.reset, ResetCause::Power);
    (0..6).for_each(|channel| assert!(!is_enabled(host, channel)));
    let values = values(host);
    let n = if identity.settings == Origin::Defaults { 0 } else { values[0].1 - 300 };
    let expected = if n == 0 { (Origin::Defaults, DEFAULTS) } else { (Origin::Stored, told(n)) };
    assert_eq!((identity.settings, values), expected, "a mix");
    n
}

/// What the image's own code finds in this flash, as [`switch_on`] says it, and whether it is told as damage.
fn loaded(flash: &Flash) -> (i32, bool) {
    let mut store = Store::new(hal_mock::flash::Flash::with(flash), 0..flash.len() as u32);
    let (settings, origin) = store.load(|| ());
    let n = match origin {
        Loaded::Stored => settings.describe(1).unwrap().value - 300,
        Loaded::Defaults | Loaded::Corrupt => 0,
    };
    let mut expected = Settings::DEFAULT;
    if n > 0 {
        told(n).iter().for_each(|&(number, value)| expected.set(number, value).unwrap());
    }
    assert!(settings == expected, "a mix");
    (n, origin == Loaded::Corrupt)
}

fn values(host: &mut Host) -> [(u16, i32); 4] {
    DEFAULTS.map(|(number, _)| (number, host.value(number)))
}

fn is_enabled(host: &Host, channel: usize) -> bool {
    let (port, pin) = F407.enables[channel];
    host.bench.with(move |stand| stand.rig().chip.level(port, pin)) == Level::High
}

fn journal(host: &Host) -> Vec<Change> {
    host.bench.with(|stand| stand.rig().chip.flash.journal.clone())
}

/// Saves, and answers what became of the flash since power on.
fn saved(host: &mut Host, n: i32) -> Vec<Change> {
    host.set_all(&told(n));
    assert_eq!(host.act(Action::Save), Verdict::Done);
    journal(host)
}

/// A flash with so many saves in it.
fn flash_with(host: &mut Host, saves: i32) -> Flash {
    let mut flash = blank();
    switch_on(host, &flash);
    (1..=saves).for_each(|n| assert!(!saved(host, n).is_empty()));
    whole(&mut flash, &journal(host));
    flash
}

/// Power is lost at every word of a save, before it and in it; where it is none of the save's last two,
/// what was `before` has to be there.
fn lost_at_every_word(host: &mut Host, flash: &Flash, changes: &[Change], before: i32) {
    let (count, mut seed) = (changes.len(), 1);
    println!("{count} words");
    let check = |found: i32, n: usize| {
        // Its last word is the map's own: whether it counts is no matter.
        assert!(found == before || n + 1 >= count && found == before + 1, "{found} at word {n}");
        assert!(found == before + 1 || n < count, "what is acknowledged is there");
    };
    for n in 0..=count {
        let mut flash = flash.clone();
        whole(&mut flash, &changes[..n]);
        let (found, is_damaged) = loaded(&flash);
        check(found, n);
        assert!(!is_damaged, "word {n} is told as damage");
        if n < 4 || n + 3 > count || n.is_multiple_of(count / 5) {
            check(switch_on(host, &flash), n);
        }
        for _ in 0..if n < count { 4 } else { 0 } {
            let mut flash = flash.clone();
            change(&mut flash, changes[n], || random(&mut seed) as u32);
            let (found, is_damaged) = loaded(&flash);
            check(found, n);
            // In the record's last word nobody can tell a first record that is torn from one that was damaged.
            assert!(!is_damaged || before == 0 && n + 2 >= count, "word {n} is told as damage");
        }
    }
}

#[test]
fn power_lost_at_any_word_of_the_first_save_leaves_the_defaults_or_what_was_being_saved() {
    let mut host = Host::boot(IMAGE);
    let changes = saved(&mut host, 1);
    lost_at_every_word(&mut host, &blank(), &changes, 0);
}

#[test]
fn power_lost_at_any_word_of_a_save_leaves_what_was_saved_before_or_what_was_being_saved() {
    let mut host = Host::boot(IMAGE);
    let before = flash_with(&mut host, 1);
    switch_on(&mut host, &before);
    let changes = saved(&mut host, 2);
    lost_at_every_word(&mut host, &before, &changes, 1);
}

#[test]
fn power_lost_in_saves_one_after_the_other_never_costs_what_was_acknowledged() {
    let mut host = Host::boot(IMAGE);
    // Not far from where a save begins a new sector and another is erased.
    let mut flash = flash_with(&mut host, 26);
    let (mut seed, mut acknowledged, mut erases) = (1, 26, 0);
    for n in 27..38 {
        let found = switch_on(&mut host, &flash);
        assert!(found == acknowledged || found == n - 1, "{found} after {acknowledged}");
        acknowledged = found;
        // The journal's beginning is what the start has mended; power may be lost there as well.
        let changes = saved(&mut host, n);
        let erase = changes.iter().position(|each| matches!(each, Change::Erased(_)));
        erases += usize::from(erase.is_some());
        let cut = match erase {
            Some(erase) if n % 2 == 0 => erase,
            _ => random(&mut seed) as usize % (changes.len() + 1),
        };
        whole(&mut flash, &changes[..cut]);
        match changes.get(cut) {
            Some(&torn) => {
                change(&mut flash, torn, || random(&mut seed) as u32 & random(&mut seed) as u32);
            }
            None => acknowledged = n,
        }
    }
    println!("{erases} saves erased");
    assert!(erases > 0, "no sector was erased");
    switch_on(&mut host, &flash);
    let changes = saved(&mut host, 38);
    whole(&mut flash, &changes);
    assert_eq!(switch_on(&mut host, &flash), 38);
}

#[test]
fn a_save_that_never_ends_is_the_watchdog_s_and_leaves_what_was_saved_before() {
    let mut host = Host::boot(IMAGE);
    let before = flash_with(&mut host, 1);
    for words in [0, 50] {
        switch_on(&mut host, &before);
        host.set_all(&told(2));
        let resets = |host: &Host| host.bench.with(|stand| stand.session.resets().len());
        let had = resets(&host);
        host.bench.with(move |stand| stand.rig().chip.flash.hangs_after = Some(words));
        host.send(Command::Extension(Request::Do(Action::Save)));
        host.run_for(200);
        host.heard();
        assert_eq!(resets(&host), had + 1);
        let identity = host.identity();
        assert_eq!((identity.reset, identity.settings), (ResetCause::Watchdog, Origin::Stored));
        assert_eq!(values(&mut host), told(1));
        assert_eq!(host.faults(), [Fault::WatchdogReset]);
        saved(&mut host, 3);
        assert_eq!(host.act(Action::Reboot), Verdict::Done);
        host.run_for(200);
        host.heard();
        assert_eq!(values(&mut host), told(3));
    }
}

#[test]
fn a_brown_out_is_a_start_like_any_other_with_everything_off() {
    let mut host = Host::boot(IMAGE);
    let order = host.bench.symbol("6system5ORDER");
    let mut seed = 7;
    for _ in 0..3 {
        host.go(Quantity::Pwm, [Some(24_576); 6]);
        host.bench.run_until_ns(host.bench.now_ns() + random(&mut seed) % 20_000_000);
        assert!(is_enabled(&host, 0));
        // RAM is as it was: with it an order to start the loader, which nobody has given.
        host.bench.with(move |stand| {
            stand.host.write(order, Width::W32, START_LOADER).unwrap();
            stand.brown_out();
        });
        let begun = host.bench.with(|stand| stand.rig().world.enabled.len());
        host.run_for(200);
        host.heard();
        let was_on = host
            .bench
            .with(move |stand| stand.rig().world.enabled[begun..].iter().any(|change| change.2));
        assert!(!was_on && !is_enabled(&host, 0));
        assert_eq!(host.identity().reset, ResetCause::Power);
        assert!(host.faults().is_empty(), "it is no fault of the board's");
    }
}

#[test]
fn a_brown_out_in_a_save_leaves_the_settings_before_or_those_being_saved() {
    let mut host = Host::boot(IMAGE);
    let before = flash_with(&mut host, 1);
    for us in [400, 1500, 2700, 4500] {
        switch_on(&mut host, &before);
        host.set_all(&told(2));
        host.send(Command::Extension(Request::Do(Action::Save)));
        while journal(&host).is_empty() {
            host.bench.run_until_ns(host.bench.now_ns() + 20_000);
        }
        host.bench.run_until_ns(host.bench.now_ns() + us * 1000);
        host.bench.with(|stand| stand.brown_out());
        host.run_for(200);
        host.heard();
        assert_eq!(host.identity().reset, ResetCause::Power);
        let n = host.value(1) - 300;
        assert!((1..=2).contains(&n));
        assert_eq!(values(&mut host), told(n));
    }
}
