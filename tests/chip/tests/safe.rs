//! What is driven when something goes wrong: nothing, and soon. Faults are put into the image's own
//! code, which from that moment on does what a broken one would.

use chip::bench::pms5005::Host;
use chip::bench::world::F407;
use chip::bench::{Bench, Stand};
use protocol::pms5005::{Command, Quantity, Scope};
use rigless::device::Level;
use rigless::soc::Width;
use rigless::soc::stm32f427::generated::dbg;

const IMAGE: &str = "pms5005-f407";

/// Within this much of the last good period everything is off.
const OFF_WITHIN_MS: f64 = 100.0;
/// What notices by itself is off in the next period: no watch over silence is as quick.
const AT_ONCE_MS: f64 = 2.5;

/// Which enable lines are high; what is driven besides.
fn driven(stand: &mut Stand<'_>) -> ([bool; 6], bool) {
    let chip = &mut stand.rig().chip;
    let enabled = F407.enables.map(|(port, pin)| chip.level(port, pin) == Level::High);
    let outputs = F407.outputs.iter().any(|&(port, pin)| chip.level(port, pin) == Level::High);
    let pulses = |chip: &mut chip::part::Stm32f407| {
        F407.servos.iter().any(|&s| chip.pulses(s).is_some_and(|pulses| pulses.width_ns > 0.0))
    };
    (enabled, outputs || pulses(chip))
}

/// A board on which everything moves.
fn going() -> Host {
    let mut host = Host::boot(IMAGE);
    host.go(Quantity::Pwm, [Some(24_576); 6]);
    host.go(Quantity::Servo, [Some(3375); 6]);
    host.order(Command::GpioOutputs(0xFF));
    host.live_for(100);
    assert_eq!(host.bench.with(driven), ([true; 6], true));
    host
}

/// Runs until nothing is driven, the host going on as before, and answers how many ms that took from
/// the last time that the watchdog was fed; then sees that it stays so until the restart is over.
fn off_after(host: &mut Host) -> f64 {
    let fault_ns = host.bench.now_ns();
    for _ in 0..200 {
        host.send(Command::Ping);
        host.run_for(1);
        if host.bench.with(driven) == ([false; 6], false) {
            break;
        }
    }
    let last_fed = host
        .bench
        .with(move |stand| stand.feeds.iter().copied().rfind(|&at| at <= fault_ns + 1_000_000));
    let off = host.bench.with(|stand| {
        let changes = &stand.rig().world.enabled;
        changes.iter().rev().find(|change| !change.2).map(|change| change.0)
    });
    let took = (off.expect("they went off") - last_fed.expect("it was fed")) as f64 / 1e6;
    for _ in 0..40 {
        host.run_for(10);
        assert_eq!(host.bench.with(driven), ([false; 6], false), "it stays off");
    }
    took
}

/// The image with a fault put where this symbol is; off within so many ms.
fn broken(part: &str, code: &[u16], within_ms: f64) {
    let mut host = going();
    host.bench.patch(part, code);
    let took = off_after(&mut host);
    assert!(took <= within_ms, "{part}: off {took:.1} ms after the last good period");
    let restarts = host.bench.with(|stand| stand.session.resets().len());
    assert!(restarts > 0, "{part}: the watchdog bites");
    println!("{part}: off {took:.1} ms after the last good period");
}

/// `b .`
const HANG: &[u16] = &[0xE7FE];
/// `cpsid i`, `b .`
const HANG_IN_CRITICAL_SECTION: &[u16] = &[0xB672, 0xE7FE];
/// `udf`
const UNDEFINED: &[u16] = &[0xDE00];
/// `push {r0-r7}` for ever.
const RECURSION: &[u16] = &[0xB4FF, 0xE7FD];
/// `sub sp, #508` and `push {r0}` for ever: most of a frame is not touched.
const RECURSION_BY_LARGE_FRAMES: &[u16] = &[0xB0FF, 0xB401, 0xE7FC];
/// Bytes of the log that may wait for a probe (.cargo/config.toml).
const LOG_BUFFER: u64 = 256;

/// `b.w` from control's step to where an index out of bounds ends.
fn branch_to_panic() -> Vec<u16> {
    let bench = Bench::boot(IMAGE);
    let [from, to] = ["control_task_inner_function0E4poll", "18panic_bounds_check"]
        .map(|part| bench.symbol(part));
    let offset = (to as i64 - from as i64 - 4) as u32;
    let bit = |n: u32| offset >> n & 1;
    let [j1, j2] = [bit(23), bit(22)].map(|i| (i ^ bit(24)) ^ 1);
    let first = 0xF000 | bit(24) << 10 | offset >> 12 & 0x3FF;
    let second = 0x9000 | j1 << 13 | j2 << 11 | offset >> 1 & 0x7FF;
    vec![first as u16, second as u16] // ARMv7-M ARM A7.7.12, encoding T4
}

#[test]
fn from_power_on_to_the_first_command_nothing_is_driven() {
    let mut bench = Bench::boot(IMAGE);
    for _ in 0..400 {
        bench.run_until_ns(bench.now_ns() + 250_000);
        assert_eq!(bench.with(driven), ([false; 6], false), "at {} us", bench.now_ns() / 1000);
    }
    // Not for a moment in between, either.
    let was_high = bench.with(|stand| stand.rig().world.enabled.iter().any(|change| change.2));
    assert!(!was_high);
    let pwm = bench.with(|stand| F407.bridges.map(|output| stand.rig().chip.pulses(output)));
    for pulses in pwm {
        let duty = pulses.expect("it runs").duty();
        assert!((duty - 0.5).abs() < 0.001, "neutral: {duty}");
    }
}

#[test]
fn a_control_that_hangs_wherever_it_does_is_off_within_100_ms() {
    broken("control_task_inner_function0E4poll", HANG, OFF_WITHIN_MS);
    broken("control_task_inner_function0E4poll", HANG_IN_CRITICAL_SECTION, OFF_WITHIN_MS);
    broken("UART4", HANG, OFF_WITHIN_MS);
}

#[test]
fn a_task_that_hangs_is_off_within_100_ms() {
    for task in [
        "link_task_inner_function0E4poll",
        "display_task_inner_function0E4poll",
        "sensing_task_inner_function0E4poll",
    ] {
        broken(task, HANG, OFF_WITHIN_MS);
    }
    broken("link_task_inner_function0E4poll", HANG_IN_CRITICAL_SECTION, OFF_WITHIN_MS);
}

#[test]
fn an_interrupt_handler_that_hangs_is_off_within_100_ms() {
    for handler in ["UART5", "DMA1_STREAM6", "TIM5"] {
        broken(handler, HANG, OFF_WITHIN_MS);
    }
    // The log is written with interrupts off.
    let mut host = going();
    host.bench.patch("_defmt_write", HANG);
    host.send_raw(protocol::pms5005::did::PWM, &[9, 0, 0]); // no channel 9: a line of the log
    host.run_for(2);
    assert!(off_after(&mut host) <= OFF_WITHIN_MS);
}

#[test]
fn control_goes_on_above_a_sensing_that_hangs_and_it_is_control_that_switches_off() {
    let mut host = going();
    host.bench.patch("UART5", HANG);
    let fault_ns = host.bench.now_ns();
    host.live_for(60);
    let fed = host.bench.with(move |stand| stand.feeds.iter().filter(|&&at| at > fault_ns).count());
    assert!((55..=65).contains(&fed), "control has run and fed {fed} times in 60 ms");
    assert_eq!(host.bench.with(driven), ([true; 6], true));
    host.live_for(40);
    assert_eq!(host.bench.with(driven), ([false; 6], false), "silent for 90 ms");
}

#[test]
fn a_hard_fault_and_a_panic_are_off_at_once() {
    for code in [UNDEFINED, &branch_to_panic()] {
        broken("control_task_inner_function0E4poll", code, AT_ONCE_MS);
    }
    broken("link_task_inner_function0E4poll", UNDEFINED, AT_ONCE_MS);
}

#[test]
fn a_stack_that_overflows_is_off_at_once_and_writes_nothing_below_sram() {
    // 32 KiB below SRAM bear a write here (`part`): what keeps the stack out of them is the MPU.
    const BELOW: std::ops::Range<u64> = 0x1FFF_8000..0x2000_0000;
    for code in [RECURSION, RECURSION_BY_LARGE_FRAMES] {
        let mut host = going();
        let words = |host: &Host| -> Vec<u64> {
            host.bench.with(|stand| {
                BELOW.step_by(4).map(|at| stand.host.read(at, Width::W32).unwrap()).collect()
            })
        };
        let before = words(&host);
        host.bench.patch("link_task_inner_function0E4poll", code);
        let took = off_after(&mut host);
        assert!(took <= AT_ONCE_MS, "off {took:.1} ms after the last good period");
        assert!(words(&host) == before, "something was written below SRAM");
        let restarts = host.bench.with(|stand| stand.session.resets().len());
        assert!(restarts > 0, "the watchdog bites");
    }
}

#[test]
fn control_that_is_slow_for_30_ms_goes_on() {
    let mut host = going();
    let code = host.bench.patch("control_task_inner_function0E4poll", HANG);
    host.run_for(30);
    host.bench.patch("control_task_inner_function0E4poll", &code);
    host.live_for(200);
    assert_eq!(host.bench.with(driven), ([true; 6], true), "nothing was switched off");
    host.go(Quantity::Pwm, [Some(8192); 6]);
    host.run_for(5);
    let duty = host.bench.with(|stand| stand.rig().chip.pulses(F407.bridges[0]).unwrap().duty());
    assert!((duty - 0.25).abs() < 0.01, "a command is obeyed: {duty}");
    assert_eq!(host.bench.with(|stand| stand.session.resets().len()), 0);
}

#[test]
fn a_silent_host_s_motors_stop_after_two_seconds() {
    let mut host = going();
    host.run_for(1800);
    assert_eq!(host.bench.with(driven).0, [true; 6]);
    host.run_for(300);
    let duties = host
        .bench
        .with(|stand| F407.bridges.map(|output| stand.rig().chip.pulses(output).unwrap().duty()));
    let (enabled, _) = host.bench.with(driven);
    for (channel, duty) in duties.into_iter().enumerate() {
        assert!(!enabled[channel] || (duty - 0.5).abs() < 0.001, "{channel}: {duty}");
    }
}

#[test]
fn a_debugger_that_halts_the_core_stops_the_watchdog_only_while_nothing_is_driven() {
    const IWDG_STOP: u64 = 1 << 12;
    let stops = |host: &Host| {
        let freeze =
            host.bench.with(|stand| stand.rig().chip.register("DBG", dbg::Register::DbgmcuApb1Fz));
        freeze & IWDG_STOP != 0
    };
    let mut host = Host::boot(IMAGE);
    assert!(stops(&host));
    host.go(Quantity::Pwm, [Some(24_576); 6]);
    host.run_for(5);
    assert!(!stops(&host));
    host.order(Command::Run { scope: Scope::All, run: false });
    host.run_for(5);
    assert!(stops(&host));
}

#[test]
fn a_log_that_a_probe_asked_to_block_stops_nothing() {
    let mut host = going();
    let control_block = host.bench.symbol("_SEGGER_RTT");
    // The flags of the first channel are behind the identifier, two counts and five words of it; 2 asks
    // the firmware to wait for room. Then the probe is pulled.
    let (written, flags) = (control_block + 36, control_block + 44);
    let logged =
        |host: &Host| host.bench.with(move |stand| stand.host.read(written, Width::W32).unwrap());
    host.bench.with(move |stand| stand.host.write(flags, Width::W32, 2).unwrap());
    let missed = host.health().periods_missed;
    let (mut at, mut total) = (logged(&host), 0);
    for _ in 0..60 {
        host.send_raw(protocol::pms5005::did::PWM, &[9, 0, 0]); // no channel 9: a line of the log
        host.run_for(5);
        let now = logged(&host);
        total += now.wrapping_sub(at) % LOG_BUFFER;
        at = now;
    }
    assert!(total > LOG_BUFFER, "only {total} bytes were logged: there was room for all");
    assert_eq!(host.health().periods_missed, missed);
    assert_eq!(host.bench.with(driven), ([true; 6], true), "nothing was switched off");
    host.go(Quantity::Pwm, [Some(8192); 6]);
    host.run_for(5);
    let duty = host.bench.with(|stand| stand.rig().chip.pulses(F407.bridges[0]).unwrap().duty());
    assert!((duty - 0.25).abs() < 0.01, "a command is obeyed: {duty}");
    assert_eq!(host.bench.with(|stand| stand.session.resets().len()), 0);
}
