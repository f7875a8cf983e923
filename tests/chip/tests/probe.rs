//! A debug probe at a board: it attaches, reads the log, is pulled, and halts the core with motors on and off.
//!
//! `bench::probe` says what of a probe is modelled. Not shown here, since the model has none of it: the
//! debug port itself, breakpoints, and a halt that outlasts a reset.

use chip::bench::pms5005::Host;
use chip::bench::probe::{BLOCK, Probe};
use chip::bench::world::F407;
use protocol::extension::ResetCause;
use protocol::pms5005::{Command, Quantity, Scope, did};
use rigless::device::Level;

const IMAGE: &str = "pms5005-f407";
/// What the firmware logs when it starts, and for a motion command with a channel 9.
const STARTED: &str = "started by: {=str} (CSR {=u32:#010x})";
const REFUSED: &str = "frame not carried out: {}";

/// A command for a channel that there is not: a line of the log.
fn nonsense(host: &mut Host) {
    host.send_raw(did::PWM, &[9, 0, 0]);
    host.run_for(3);
}

fn enabled(host: &Host) -> [bool; 6] {
    host.bench.with(|stand| {
        F407.enables.map(|(port, pin)| stand.rig().chip.level(port, pin) == Level::High)
    })
}

fn resets(host: &Host) -> usize {
    host.bench.with(|stand| stand.session.resets().len())
}

fn halt(host: &Host, is_halted: bool) {
    host.bench.with(move |stand| stand.halt(is_halted));
}

#[test]
fn a_probe_reads_the_whole_log_of_a_board_that_runs() {
    let mut host = Host::boot(IMAGE);
    let mut probe = Probe::attach(&host.bench, BLOCK);
    assert_eq!(probe.log(&host.bench), [STARTED]);
    let periods = host.bench.with(|stand| stand.feeds.len());
    host.go(Quantity::Pwm, [Some(24_576); 6]);
    // More than the buffer holds, fetched as it comes.
    for _ in 0..100 {
        nonsense(&mut host);
        assert_eq!(probe.log(&host.bench), [REFUSED]);
    }
    let now = host.bench.now_ns();
    let (count, longest) = host.bench.with(move |stand| {
        let feeds = &stand.feeds[periods..];
        (feeds.len(), feeds.windows(2).map(|pair| pair[1] - pair[0]).max().unwrap())
    });
    println!("{count} periods until {now} ns, the longest {longest} ns");
    assert!(longest < 1_100_000, "no period is missed while a probe looks on: {longest} ns");
    assert_eq!((enabled(&host), resets(&host)), ([true; 6], 0));
}

#[test]
fn a_probe_that_is_pulled_in_a_log_stops_nothing_and_finds_the_log_again() {
    let mut host = Host::boot(IMAGE);
    let mut probe = Probe::attach(&host.bench, BLOCK);
    host.go(Quantity::Pwm, [Some(24_576); 6]);
    nonsense(&mut host);
    assert!(probe.log(&host.bench).ends_with(&[REFUSED.to_string()]));
    // Pulled, with the flags as it has left them: the log goes round many times over.
    drop(probe);
    (0..100).for_each(|_| nonsense(&mut host));
    assert_eq!((enabled(&host), resets(&host)), ([true; 6], 0));
    host.heard();
    host.go(Quantity::Pwm, [Some(8192); 6]);
    let mut probe = Probe::attach(&host.bench, BLOCK);
    nonsense(&mut host);
    probe.log(&host.bench); // what was written over, and what is left of it
    nonsense(&mut host);
    assert_eq!(probe.log(&host.bench), [REFUSED]);
}

#[test]
fn a_core_that_is_halted_while_a_motor_runs_is_reset_with_everything_off_within_100_ms() {
    let mut host = Host::boot(IMAGE);
    for (n, phase_us) in [0, 170, 430, 690, 950].into_iter().enumerate() {
        host.go(Quantity::Pwm, [Some(24_576), None, None, None, None, None]);
        host.live_for(50);
        host.bench.run_until_ns(host.bench.now_ns() + phase_us * 1000);
        let halted_ns = host.bench.now_ns();
        halt(&host, true);
        while enabled(&host)[0] {
            host.run_for(1);
            assert!(host.bench.now_ns() - halted_ns < 100_000_000, "on for 100 ms");
        }
        println!("off {} us after the halt", (host.bench.now_ns() - halted_ns) / 1000);
        assert_eq!(resets(&host), n + 1);
        host.run_for(200);
        host.heard();
        assert_eq!(host.identity().reset, ResetCause::Watchdog);
        assert_eq!(enabled(&host), [false; 6]);
    }
}

#[test]
fn a_core_that_is_halted_while_nothing_is_driven_goes_on_as_if_nothing_had_happened() {
    let mut host = Host::boot(IMAGE);
    host.go(Quantity::Pwm, [Some(24_576); 6]);
    host.order(Command::Run { scope: Scope::All, run: false });
    host.live_for(50);
    for (n, seconds) in [1, 3, 10].into_iter().enumerate() {
        let uptime = host.health().uptime_ms;
        let begun = host.bench.now_ns();
        halt(&host, true);
        let feeds = host.bench.with(|stand| stand.feeds.len());
        host.run_for(seconds * 1000);
        host.heard();
        assert_eq!(feeds, host.bench.with(|stand| stand.feeds.len()), "the core stands still");
        halt(&host, false);
        // Its clock has stood still with it.
        let passed = u64::from(host.health().uptime_ms - uptime);
        let lived = (host.bench.now_ns() - begun) / 1_000_000 - seconds * 1000;
        assert!(passed.abs_diff(lived) <= 60, "{passed} ms, of {lived}");
        // A period for every millisecond from now on, telemetry as before, a motor that obeys.
        let fed = host.bench.with(|stand| stand.feeds.len());
        host.live_for(200);
        let periods = host.bench.with(|stand| stand.feeds.len()) - fed;
        assert!((199..=201).contains(&periods), "{periods} periods in 200 ms");
        let reports = host.heard().iter().filter(|frame| frame.report().is_some()).count();
        assert!((9..=15).contains(&reports), "{reports} reports in 200 ms");
        host.go(Quantity::Pwm, [Some(24_576 + n as i16); 6]);
        host.run_for(5);
        assert_eq!(enabled(&host), [true; 6]);
        host.order(Command::Run { scope: Scope::All, run: false });
        host.run_for(5);
        assert_eq!(resets(&host), 0);
        assert!(host.faults().is_empty());
    }
}
