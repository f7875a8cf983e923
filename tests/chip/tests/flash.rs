//! Settings that outlive a restart, in a flash that ANDs and takes its time.

use chip::bench::pms5005::Host;
use protocol::extension::{Action, Answer, Assignments, Request, ResetCause, Verdict};
use protocol::pms5005::{Command, Data};
use rigless::soc::Width;

const IMAGE: &str = "pms5005-f407";
/// Telemetry's period in ms.
const PERIOD: u16 = 32;
/// The settings' sectors, and the words before and behind them: the vectors and the program.
const SETTINGS: std::ops::Range<u64> = 0x0800_4000..0x0801_0000;

/// What came of a request.
fn outcome(host: &mut Host, request: Request<'_>) -> Verdict {
    host.send(Command::Extension(request));
    host.wait("outcome", |frame| match frame.answer() {
        Some(Answer::Outcome(outcome)) => Some(outcome.verdict),
        _ => None,
    })
}

fn set(host: &mut Host, value: i32) {
    let mut data = Data::new();
    Assignments::emit(PERIOD, value, &mut data).unwrap();
    let assignments = Assignments::parse(&data).unwrap();
    assert_eq!(outcome(host, Request::Set(assignments)), Verdict::Done);
}

fn value(host: &mut Host) -> i32 {
    host.send(Command::Extension(Request::Setting(PERIOD)));
    host.wait("setting", |frame| match frame.answer() {
        Some(Answer::Setting(setting)) => Some(setting.value),
        _ => None,
    })
}

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

#[test]
fn a_saved_setting_is_in_force_after_a_restart_and_nothing_else_of_the_flash_has_changed() {
    let mut host = Host::boot(IMAGE);
    let around = |host: &Host| {
        let vectors = words_of(host, SETTINGS.start - 0x4000..SETTINGS.start);
        [vectors, words_of(host, SETTINGS.end..SETTINGS.end + 0x1_0000)]
    };
    let before = around(&host);
    set(&mut host, 100);
    assert_eq!(outcome(&mut host, Request::Do(Action::Save)), Verdict::Done);
    let (words, _) = work(&host);
    assert!((10..2000).contains(&words), "{words} words were programmed");
    assert!(words_of(&host, SETTINGS).iter().any(|&word| word != 0xFFFF_FFFF));
    assert!(around(&host) == before, "a word outside the settings has changed");
    assert_eq!(outcome(&mut host, Request::Do(Action::Reboot)), Verdict::Done);
    host.run_for(200);
    host.heard();
    assert_eq!(host.bench.with(|stand| stand.session.resets().len()), 1);
    assert_eq!(value(&mut host), 100);
    host.send(Command::Extension(Request::Identity));
    let cause = host.wait("identity", |frame| match frame.answer() {
        Some(Answer::Identity(identity)) => Some(identity.reset),
        _ => None,
    });
    assert_eq!(cause, ResetCause::Software);
}

#[test]
fn an_erase_holds_the_core_for_250_ms_and_the_watchdog_bears_it() {
    let mut host = Host::boot(IMAGE);
    // Sixty saves fill a sector; the ones behind them erase.
    let mut saves = 0;
    while work(&host).1 == 0 {
        saves += 1;
        assert!(saves < 200, "no save erases");
        set(&mut host, 50 + saves % 50);
        assert_eq!(outcome(&mut host, Request::Do(Action::Save)), Verdict::Done);
    }
    host.run_for(300);
    assert_eq!(outcome(&mut host, Request::Do(Action::Save)), Verdict::Done);
    assert_eq!(value(&mut host), 50 + saves % 50);
    assert_eq!(host.bench.with(|stand| stand.session.resets().len()), 0, "it was not bitten");
    let told: Vec<String> =
        host.bench.with(|stand| stand.session.told().map(|told| format!("{told:?}")).collect());
    assert_eq!(told, [""; 0], "no wrong key, no write while it is locked");
}
