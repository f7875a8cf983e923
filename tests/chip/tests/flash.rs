//! Settings that outlive a restart, in a flash that ANDs and takes its time; and what a start knows of the
//! one before.

use chip::bench::Make;
use chip::bench::pms5005::{Heard, Host};
use chip::bench::world::F407;
use firmware::settings::Settings;
use protocol::extension::{Action, Answer, Fault, Origin, Request, ResetCause, Verdict};
use protocol::pms5005::{Command, Quantity, Scope};
use rigless::device::Level;
use rigless::soc::Width;
use rigless::soc::stm32f427::generated::iwdg;

const IMAGE: &str = "pms5005-f407";
/// Numbers of settings: the silence allowed and telemetry's period, in ms.
const LINK_TIMEOUT: u16 = 1;
const PERIOD: u16 = 32;
/// The settings' sectors, and the words before and behind them: the vectors and the program.
const SETTINGS: std::ops::Range<u64> = 0x0800_4000..0x0801_0000;
/// Bytes of each of those sectors.
const SECTOR: u64 = 0x4000;
const BLANK: u64 = 0xFFFF_FFFF;
/// The stack, and what is in it where nobody has been.
const STACK: std::ops::Range<u64> = 0x2000_0000..0x2000_4000;
const PAINT: u64 = 0x5AFE_57AC;

/// Words programmed and sectors erased since power on.
fn work(host: &Host) -> (u64, u64) {
    host.bench.with(|stand| {
        let flash = &stand.rig().chip.flash;
        (flash.words, flash.erases)
    })
}

fn words_of(host: &Host, range: std::ops::Range<u64>) -> Vec<u64> {
    host.bench.with(move |stand| {
        range.step_by(4).map(|at| stand.host.read(at, Width::W32).unwrap()).collect()
    })
}

fn resets(host: &Host) -> usize {
    host.bench.with(|stand| stand.session.resets().len())
}

/// The watchdog's prescaler and reload: 205 counts of the LSI divided by 8 are 96.5 ms of the slowest.
const USUAL: (u64, u64) = (1, 204);
/// While the flash erases.
const LENGTHENED: (u64, u64) = (1, 4095);

fn watchdog(host: &Host) -> (u64, u64) {
    host.bench.with(|stand| {
        let chip = &stand.rig().chip;
        let register = |register| chip.register("IWDG", register);
        (register(iwdg::Register::Pr), register(iwdg::Register::Rlr))
    })
}

/// What came of a request, if the frame tells it.
fn verdict(frame: &Heard) -> Option<Verdict> {
    match frame.answer() {
        Some(Answer::Outcome(outcome)) => Some(outcome.verdict),
        _ => None,
    }
}

/// Whether the flash is at more than a word, which takes 16 us.
fn is_erasing(host: &Host) -> bool {
    host.bench.with(|stand| stand.rig().chip.flash.busy_until > stand.now.0 + 100_000)
}

/// Saves. The watchdog as it was while a sector was erased, if one was.
fn save(host: &mut Host) -> Option<(u64, u64)> {
    let mut erasing = None;
    host.send(Command::Extension(Request::Do(Action::Save)));
    for _ in 0..1000 {
        host.run_for(1);
        if is_erasing(host) {
            erasing = Some(watchdog(host));
        }
        if let Some(verdict) = host.heard().iter().find_map(verdict) {
            assert_eq!(verdict, Verdict::Done);
            return erasing;
        }
    }
    panic!("not saved within a second");
}

fn is_enabled(host: &Host) -> bool {
    let (port, pin) = F407.enables[0];
    host.bench.with(move |stand| stand.rig().chip.level(port, pin)) == Level::High
}

#[test]
fn a_saved_setting_is_in_force_after_a_restart_and_nothing_else_of_the_flash_has_changed() {
    let mut host = Host::boot(IMAGE);
    let around = |host: &Host| {
        let vectors = words_of(host, SETTINGS.start - SECTOR..SETTINGS.start);
        [vectors, words_of(host, SETTINGS.end..0x0810_0000)]
    };
    let before = around(&host);
    let identity = host.identity();
    assert_eq!((identity.reset, identity.settings), (ResetCause::Power, Origin::Defaults));
    assert_eq!((host.value(PERIOD), host.faults()), (50, vec![]));
    host.set(PERIOD, 100);
    host.set(LINK_TIMEOUT, 300);
    assert_eq!(host.act(Action::Save), Verdict::Done);
    let (words, _) = work(&host);
    // Number and value of every setting, five bytes before them, and what the map puts around it; each
    // word once, in the first sector.
    let record = (5 + 6 * Settings::DEFAULT.iter().count() as u64).div_ceil(4);
    assert!((record + 1..record + 14).contains(&words), "{words} words were programmed");
    let settings = words_of(&host, SETTINGS);
    let (first, others) = settings.split_at(SECTOR as usize / 4);
    let written = first.iter().filter(|&&word| word != BLANK).count() as u64;
    assert_eq!(written, words, "a word is written twice, or outside the first sector");
    assert!(others.iter().all(|&word| word == BLANK));
    assert!(around(&host) == before, "a word outside the settings has changed");
    assert_eq!(host.act(Action::Reboot), Verdict::Done);
    host.run_for(200);
    host.heard();
    assert_eq!(resets(&host), 1);
    assert_eq!(host.value(PERIOD), 100);
    let identity = host.identity();
    assert_eq!((identity.reset, identity.settings), (ResetCause::Software, Origin::Stored));
    assert_eq!(work(&host), (words, 0), "a start that finds all in order writes nothing");
    assert_eq!(host.faults(), []);
    // The controller has them too: it stops what moves after 300 ms of silence, not after 2 s.
    host.go(Quantity::Pwm, [Some(24_576), None, None, None, None, None]);
    host.run_for(200);
    assert!(is_enabled(&host));
    host.run_for(150);
    let duty = host.bench.with(|stand| stand.rig().chip.pulses(F407.bridges[0]).unwrap().duty());
    assert!((duty - 0.5).abs() < 0.001 || !is_enabled(&host), "{duty}");
}

#[test]
fn an_erase_holds_the_core_for_250_ms_and_the_watchdog_bears_it() {
    let mut host = Host::boot(IMAGE);
    assert_eq!(watchdog(&host), USUAL);
    // Sixty saves fill a sector; the ones behind them erase.
    let (mut saves, mut erasing) = (0, None);
    while work(&host).1 == 0 {
        saves += 1;
        assert!(saves < 200, "no save erases");
        host.set(PERIOD, 50 + saves % 50);
        erasing = save(&mut host);
    }
    assert_eq!(erasing, Some(LENGTHENED));
    host.run_for(10);
    assert_eq!(watchdog(&host), USUAL);
    let erased = host.bench.with(|stand| stand.rig().chip.flash.erased.clone());
    assert_eq!(erased, [1], "the first sector is the oldest");
    let longest = host
        .bench
        .with(|stand| stand.feeds.windows(2).map(|pair| pair[1] - pair[0]).max().unwrap());
    assert!((250_000_000..270_000_000).contains(&longest), "control stood still for {longest} ns");
    assert_eq!(host.act(Action::Save), Verdict::Done);
    assert_eq!(host.value(PERIOD), 50 + saves % 50);
    assert_eq!(resets(&host), 0, "it was not bitten");
    let told: Vec<String> =
        host.bench.with(|stand| stand.session.told().map(|told| format!("{told:?}")).collect());
    assert_eq!(told, [""; 0], "no wrong key, no write while it is locked");
    assert_eq!(host.act(Action::Reboot), Verdict::Done);
    host.run_for(200);
    host.heard();
    let identity = host.identity();
    assert_eq!((identity.reset, identity.settings), (ResetCause::Software, Origin::Stored));
    assert_eq!(host.value(PERIOD), 50 + saves % 50);
}

#[test]
fn a_flash_that_takes_nothing_is_told_and_only_the_settings_sectors_are_tried() {
    let mut host = Host::boot(IMAGE);
    host.bench.with(|stand| stand.rig().chip.flash.is_worn_out = true);
    host.go(Quantity::Pwm, [Some(24_576), None, None, None, None, None]);
    assert_eq!(host.act(Action::Save), Verdict::OutputsOn);
    assert_eq!(host.act(Action::RebootIntoDfu), Verdict::OutputsOn);
    assert_eq!(work(&host), (0, 0), "with a motor on the flash is left alone");
    host.order(Command::Run { scope: Scope::All, run: false });
    // Three erases in vain hold the core for 750 ms.
    host.send(Command::Extension(Request::Do(Action::Save)));
    host.run_for(1000);
    assert_eq!(host.wait("outcome", verdict), Verdict::FlashFailed);
    let mut erased = host.bench.with(|stand| stand.rig().chip.flash.erased.clone());
    erased.sort_unstable();
    erased.dedup();
    assert_eq!(erased, [1, 2, 3]);
    // It lives on.
    host.go(Quantity::Pwm, [Some(24_576), None, None, None, None, None]);
    host.live_for(300);
    assert!(is_enabled(&host));
    assert_eq!(watchdog(&host), USUAL);
    assert_eq!(resets(&host), 0);
}

#[test]
fn damaged_settings_and_a_bite_of_the_watchdog_are_on_record() {
    let settings = b"not settings".to_vec();
    let mut host = Host::boot_with(IMAGE, Make { settings, ..Make::default() });
    assert_eq!(host.identity().settings, Origin::Corrupt);
    assert_eq!(host.value(PERIOD), 50, "the default");
    assert_eq!(host.faults(), [Fault::SettingsCorrupt]);
    let code = host.bench.patch("control_task_inner_function0E4poll", &[0xE7FE]); // b .
    host.run_for(70);
    host.bench.patch("control_task_inner_function0E4poll", &code);
    host.run_for(300);
    host.heard();
    assert_eq!(resets(&host), 1);
    assert_eq!(host.identity().reset, ResetCause::Watchdog);
    let mut faults: Vec<_> = host.faults().into_iter().map(Fault::number).collect();
    faults.sort_unstable();
    let mut expected = [Fault::SettingsCorrupt, Fault::WatchdogReset].map(Fault::number);
    expected.sort_unstable();
    assert_eq!(faults, expected);
}

#[test]
fn the_stack_s_high_water_mark_is_the_deepest_word_that_was_ever_used() {
    let mut host = Host::boot(IMAGE);
    let deepest = |host: &Host| {
        let untouched = words_of(host, STACK).into_iter().take_while(|&word| word == PAINT).count();
        STACK.end - STACK.start - 4 * untouched as u64
    };
    let used = u64::from(host.health().stack_used);
    assert!((1024..12 * 1024).contains(&used), "{used} bytes");
    // Answering may have gone deeper meanwhile, never less deep.
    assert!((used..used + 512).contains(&deepest(&host)));
    assert_eq!(host.act(Action::Save), Verdict::Done);
    let saving = u64::from(host.health().stack_used);
    assert!((used + 512..12 * 1024).contains(&saving), "{saving} bytes");
    println!("{used} bytes of stack at rest, {saving} for a save");
    host.bench.with(|stand| stand.host.write(STACK.start + 0x100, Width::W32, 0).unwrap());
    assert_eq!(u64::from(host.health().stack_used), STACK.end - STACK.start - 0x100);
}

#[test]
fn a_save_while_a_host_talks_loses_no_byte_and_costs_no_period() {
    let mut host = Host::boot(IMAGE);
    let counters = |host: &mut Host| {
        host.ask(Request::Counters, |answer| match answer {
            Answer::Counters(counters) => Some(counters),
            _ => None,
        })
    };
    let before = (counters(&mut host), host.health().periods_missed);
    host.run_for(50);
    host.heard();
    let fed = host.bench.with(|stand| stand.feeds.len());
    // What the board knows nothing of, 12 bytes each: it acknowledges every one.
    let (mut sent, mut acks, mut saves) = (0, 0, 0);
    let mut count = |host: &mut Host| {
        for frame in host.heard() {
            acks += u32::from(frame.is_ack());
            saves += match frame.answer() {
                Some(Answer::Outcome(outcome)) => u32::from(outcome.verdict == Verdict::Done),
                _ => 0,
            };
        }
    };
    for ms in 0..500 {
        if ms % 100 == 50 {
            host.send(Command::Extension(Request::Do(Action::Save)));
            sent += 1;
        }
        while host.bench.line.pending() < 64 {
            host.send_raw(31, &[1, 2, 3]);
            sent += 1;
        }
        host.run_for(1);
        count(&mut host);
    }
    while !host.bench.line.is_idle() {
        host.run_for(1);
    }
    host.run_for(300);
    count(&mut host);
    let longest = host.bench.with(move |stand| {
        stand.feeds[fed..].windows(2).map(|pair| pair[1] - pair[0]).max().unwrap()
    });
    let after = (counters(&mut host), host.health().periods_missed);
    println!("{sent} frames, {acks} acknowledged, {saves} saves, a period of {longest} ns");
    assert_eq!((saves, acks), (5, sent), "each is acknowledged");
    assert_eq!(work(&host).1, 0, "none of them has erased");
    assert_eq!(after.0.line_errors, before.0.line_errors);
    assert_eq!(after.0.bytes_skipped, before.0.bytes_skipped);
    assert_eq!(after.1, before.1, "no period was missed");
    assert!(longest < 1_500_000, "{longest} ns");
}
