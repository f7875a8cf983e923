//! What outlives a start of the STM32F407's image: settings in flash, the cause of the reset, an
//! order for the ROM's loader; and how deep its stack has been. The extension's frames ask and
//! tell.

use std::collections::BTreeSet;

use firmware::settings::Settings;
use firmware::settings::store::Store;
use hal_mock::flash::{Flash, SIZE};
use protocol::extension::{
    Action, Answer, Assignments, Fault, Health, Identity, Latched, Origin, Request, ResetCause,
    Verdict,
};
use protocol::pms5005::{Command, Data, Quantity, Repeat, Scope, did};

use crate::chip::{Chip, Effect, LOADER_STACK, Reset, SECTOR, SETTINGS};
use crate::machine::Machine;
use crate::process::image;
use crate::{CCR1, IMAGE, IWDG, KR, NEUTRAL, RLR, USUAL, first_and_fifth, gdb, go};

/// The controller of the flash and its control register; a port's mode register; the watchdog's
/// reload register for an erase.
const FLASH: &str = "Flash Int";
const CR: u32 = 0x10;
const MODER: u32 = 0x00;
const ERASING: u32 = 4095;

/// The stack, and what is in it where nobody has been.
const STACK: std::ops::Range<u32> = 0x2000_0000..0x2000_4000;
const PAINT: u32 = 0x5AFE_57AC;

/// The order for the loader.
const START_LOADER: u32 = 0xDF0B_007E;

/// Numbers of settings.
const LINK_TIMEOUT: u16 = 1;
const TELEMETRY_PERIOD: u16 = 32;

/// Sends a request and waits for the answer of which `wanted` makes something.
fn ask<T>(
    machine: &mut Machine,
    request: Request<'_>,
    wanted: impl Fn(Answer<'_>) -> Option<T>,
) -> T {
    machine.send(Command::Extension(request));
    for _ in 0..200 {
        let (did, data, _) = machine.frame();
        if let Some(found) = Answer::parse(did, &data).and_then(&wanted) {
            return found;
        }
    }
    panic!("200 frames, and no answer to {request:?}");
}

fn value(machine: &mut Machine, number: u16) -> i32 {
    ask(machine, Request::Setting(number), |answer| match answer {
        Answer::Setting(setting) => Some(setting.value),
        _ => None,
    })
}

fn set(machine: &mut Machine, number: u16, value: i32) {
    let mut data = Data::new();
    Assignments::emit(number, value, &mut data).unwrap();
    machine.order(Command::Extension(Request::Set(Assignments::parse(&data).unwrap())));
}

fn identity(machine: &mut Machine) -> (ResetCause, Origin) {
    ask(machine, Request::Identity, |answer| match answer {
        Answer::Identity(Identity { reset, settings, .. }) => Some((reset, settings)),
        _ => None,
    })
}

/// The faults on record.
fn faults(machine: &mut Machine) -> Vec<Fault> {
    let mut faults = Vec::new();
    loop {
        let place = faults.len() as u8;
        let record = ask(machine, Request::Fault(place), |answer| match answer {
            Answer::Fault(Latched { place: told, record, .. }) if told == place => Some(record),
            _ => None,
        });
        match record {
            Some(record) => faults.push(record.fault),
            None => return faults,
        }
    }
}

pub fn health(machine: &mut Machine) -> Health {
    let once = Repeat::Times(1.try_into().unwrap());
    ask(machine, Request::Health(once), |answer| match answer {
        Answer::Health(health) => Some(health),
        _ => None,
    })
}

fn stack_used(machine: &mut Machine) -> u32 {
    health(machine).stack_used.into()
}

/// Has something done that the flash has no part in, and waits for what comes of it.
fn act(machine: &mut Machine, action: Action) -> Verdict {
    ask(machine, Request::Do(action), verdict)
}

fn verdict(answer: Answer<'_>) -> Option<Verdict> {
    match answer {
        Answer::Outcome(outcome) => Some(outcome.verdict),
        _ => None,
    }
}

/// The command to do something.
fn to(action: Action) -> Command<'static> {
    Command::Extension(Request::Do(action))
}

/// What came of it.
fn outcome(machine: &mut Machine) -> Verdict {
    loop {
        let (did, data, _) = machine.frame();
        if let Some(verdict) = Answer::parse(did, &data).and_then(verdict) {
            return verdict;
        }
    }
}

/// Has settings saved with the flash served.
fn save(machine: &mut Machine) -> Verdict {
    machine.serve(to(Action::Save));
    outcome(machine)
}

fn reboot(machine: &mut Machine) -> Verdict {
    machine.restart(to(Action::Reboot));
    outcome(machine)
}

/// The store as the computer sees it.
fn store(flash: &Flash) -> Store<Flash> {
    Store::new(flash.clone(), 0..SIZE as u32)
}

fn settings(telemetry_period: i32) -> Settings {
    let mut settings = Settings::DEFAULT;
    settings.set(TELEMETRY_PERIOD, telemetry_period).unwrap();
    settings
}

#[test]
#[ignore = "needs QEMU 7.2 and the image that .ci/images builds"]
fn saved_settings_are_in_force_after_a_reboot() {
    let mut machine = Machine::boot("saved", IMAGE, &[]);
    assert_eq!(identity(&mut machine), (ResetCause::Power, Origin::Defaults));
    assert_eq!(value(&mut machine, TELEMETRY_PERIOD), 50);
    assert_eq!(faults(&mut machine), []);

    set(&mut machine, TELEMETRY_PERIOD, 20);
    set(&mut machine, LINK_TIMEOUT, 300);
    assert_eq!(save(&mut machine), Verdict::Done);
    // Number and value of every setting, five bytes before them, and what the map puts around it;
    // each word once, in the first sector.
    let record = (5 + 6 * Settings::DEFAULT.iter().count()).div_ceil(size_of::<u32>());
    let mut words = BTreeSet::new();
    for effect in &machine.chip.effects {
        let &Effect::Program(address, _) = effect else { panic!("{effect:?}") };
        assert!((SETTINGS.start..SETTINGS.start + SECTOR).contains(&address));
        assert!(words.insert(address), "{address:#x} is written twice");
    }
    assert!((record + 1..record + 14).contains(&words.len()), "{} words", words.len());

    assert_eq!(reboot(&mut machine), Verdict::Done);
    assert_eq!(machine.chip.effects, [], "a start that finds all in order writes nothing");
    assert_eq!(identity(&mut machine), (ResetCause::Software, Origin::Stored));
    assert_eq!(value(&mut machine, TELEMETRY_PERIOD), 20);
    assert_eq!(faults(&mut machine), []);
    // The controller has them too: it stops what moves after 300 ms of silence, not after 2 s. The
    // board's own time is told by its telemetry, every 20 ms.
    machine.order(go(Quantity::Pwm, first_and_fifth(24_576, 8192)));
    machine.written("timer[1]", CCR1, 3150);
    machine.forget();
    let mut reports = 0;
    while !machine.values("timer[1]", CCR1).contains(&NEUTRAL) {
        reports += usize::from(machine.frame().0 == did::MOTORS);
    }
    assert!((10..60).contains(&reports), "after {reports} reports");
}

#[test]
#[ignore = "needs QEMU 7.2 and the image that .ci/images builds"]
fn a_full_sector_is_followed_by_the_next_with_the_watchdog_lengthened() {
    // The save that erases the sector which it will need next.
    let flash = Flash::empty();
    let mut before = Flash::empty();
    for n in 1.. {
        let last = Flash::with(&flash.image());
        store(&flash).save(&settings(n), || {}).unwrap();
        if flash.erases() > 0 {
            before = last;
            break;
        }
    }
    let (old, _) = store(&before).load(|| {});
    let mut machine = Machine::boot_with("full", IMAGE, &[], Chip::new(Reset::Power), &before);
    assert_eq!(identity(&mut machine), (ResetCause::Power, Origin::Stored));
    assert_eq!(value(&mut machine, TELEMETRY_PERIOD), i32::from(old.link.telemetry_period_ms));

    machine.forget();
    assert_eq!(save(&mut machine), Verdict::Done);
    let erased: Vec<_> =
        machine.chip.effects.iter().filter(|e| matches!(e, Effect::Erase(_))).collect();
    assert_eq!(erased, [&Effect::Erase(1)], "the first sector is the oldest");
    let lengthened = machine.written(IWDG, RLR, ERASING);
    assert!(lengthened < machine.written(FLASH, CR, 0x0001_020A), "the watchdog first");
    machine.forget();
    machine.written(IWDG, RLR, USUAL);
    assert_eq!(reboot(&mut machine), Verdict::Done);
    assert_eq!(identity(&mut machine), (ResetCause::Software, Origin::Stored));
}

#[test]
#[ignore = "needs QEMU 7.2 and the image that .ci/images builds"]
fn damaged_settings_and_a_bite_of_the_watchdog_are_on_record() {
    let flash = Flash::with(b"not settings");
    let chip = Chip::new(Reset::Watchdog);
    let mut machine = Machine::boot_with("damaged", IMAGE, &[], chip, &flash);
    assert_eq!(identity(&mut machine), (ResetCause::Watchdog, Origin::Corrupt));
    let faults: BTreeSet<_> = faults(&mut machine).into_iter().map(Fault::number).collect();
    let expected = [Fault::SettingsCorrupt, Fault::WatchdogReset].map(Fault::number);
    assert_eq!(faults, expected.into());
    assert_eq!(value(&mut machine, TELEMETRY_PERIOD), 50);
}

#[test]
#[ignore = "needs QEMU 7.2 and the image that .ci/images builds"]
fn a_flash_that_takes_nothing_is_told_and_only_the_settings_sectors_are_tried() {
    // Unserved, the flash does not change.
    let mut machine = Machine::boot("dead", IMAGE, &[]);
    machine.order(go(Quantity::Pwm, first_and_fifth(24_576, 8192)));
    machine.forget();
    assert_eq!(act(&mut machine, Action::Save), Verdict::OutputsOn);
    assert_eq!(act(&mut machine, Action::RebootIntoDfu), Verdict::OutputsOn);
    assert!(!machine.is_touched(FLASH), "with a motor on the flash is left alone");

    machine.order(Command::Run { scope: Scope::All, run: false });
    assert_eq!(act(&mut machine, Action::Save), Verdict::FlashFailed);
    let erases: BTreeSet<_> =
        machine.values(FLASH, CR).into_iter().filter(|value| value & 1 << 16 != 0).collect();
    assert_eq!(erases, [0x0001_020A, 0x0001_0212, 0x0001_021A].into(), "sectors 1, 2 and 3");

    // It lives on, and the watchdog becomes as short as it was.
    machine.forget();
    machine.order(go(Quantity::Pwm, first_and_fifth(24_576, 8192)));
    machine.written("timer[1]", CCR1, 3150);
    machine.written(IWDG, RLR, USUAL);
    machine.written(IWDG, KR, 0xAAAA);
    assert!(!machine.values(IWDG, RLR).contains(&ERASING));
}

#[test]
#[ignore = "needs QEMU 7.2 and the image that .ci/images builds"]
fn the_roms_loader_is_started_once_and_the_next_reset_starts_the_firmware() {
    let mut machine = Machine::boot("loader", IMAGE, &[]);
    machine.forget();
    assert_eq!(machine.enter_loader(to(Action::RebootIntoDfu)), LOADER_STACK);
    assert_eq!(outcome(&mut machine), Verdict::Done);
    // As after a reset: no clock, no watchdog, no pin.
    assert!(!machine.chip.is_touched, "a clock has been started");
    assert!(!machine.values(IWDG, KR).contains(&0xCCCC), "the watchdog has been started");
    assert!(!machine.is_written("GPIOE", MODER), "a pin has been claimed");
    assert!(machine.is_logged("Changing the memory mapping"), "the loader's vectors are at 0");

    machine.reset(Reset::Software, (STACK.start, 0));
    assert_eq!(identity(&mut machine), (ResetCause::Software, Origin::Defaults));

    // What looks like an order after power-on is none.
    let order = gdb::symbol(&image(IMAGE), "ORDER");
    machine.reset(Reset::Power, (order, START_LOADER));
    assert_eq!(identity(&mut machine), (ResetCause::Power, Origin::Defaults));
}

#[test]
#[ignore = "needs QEMU 7.2 and the image that .ci/images builds"]
fn the_stacks_high_water_mark_is_the_deepest_word_that_was_ever_used() {
    let mut machine = Machine::boot("stack", IMAGE, &[]);
    let used = stack_used(&mut machine);
    assert!((1024..12 * 1024).contains(&used), "{used} bytes");
    // Answering may have gone deeper meanwhile, never less deep.
    let deepest =
        machine.stopped(|gdb| STACK.step_by(4).find(|&at| gdb.word(at) != PAINT)).unwrap();
    assert!((used..used + 512).contains(&(STACK.end - deepest)), "{used} and {deepest:#x}");

    // A save is the deepest that we know of.
    assert_eq!(save(&mut machine), Verdict::Done);
    let saving = stack_used(&mut machine);
    assert!((used + 1024..12 * 1024).contains(&saving), "{saving} bytes");
    println!("{used} bytes of stack at rest, {saving} for a save");

    machine.stopped(|gdb| gdb.set_bytes(STACK.start + 0x100, &[0; 4]));
    assert_eq!(stack_used(&mut machine), STACK.end - STACK.start - 0x100);
}
