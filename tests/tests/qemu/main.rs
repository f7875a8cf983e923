//! The images in QEMU.
//!
//!     .ci/images && cargo test -p tests --test qemu -- --ignored --test-threads 2
//!
//! The virtual board's image is in `simulated`. Here is the STM32F407
//! board's, in `settings` what of it outlives a start, and in `hang` a control that does not come
//! back: frames go in over its UART, and the registers that it writes come out of QEMU's log. It
//! differs from the image that is flashed only in what the machine lacks (the firmware's feature
//! `qemu`): SysTick for TIM5's compare channels, a receive interrupt and polled sending for the
//! UART's DMA.

mod chip;
mod gdb;
mod hang;
mod machine;
mod process;
mod script;
mod settings;
mod simulated;

use chip::Chip;
use gdb::{PC, SP};
use hal_mock::flash::Flash;
use machine::Machine;
use process::image;
use protocol::pms5005::{
    Addressing, CHANNELS, Command, Move, Quantity, Repeat, Report, Reports, Scope, did,
};

/// The PMS5005 with what the machine lacks replaced.
const IMAGE: &str = "pms5005-qemu";

/// The machine's clock counts instructions, 8 ns each, in place of the wall's time.
const SLOWLY: [&str; 2] = ["-icount", "shift=3"];

/// Bytes of the log that may wait for a probe (.cargo/config.toml).
const LOG_BUFFER: u32 = 256;

/// Register offsets: GPIO's BSRR, a timer's CCR1, the watchdog's KR, PR and RLR.
const BSRR: u32 = 0x18;
const CCR1: u32 = 0x34;
const KR: u32 = 0x00;
const PR: u32 = 0x04;
const RLR: u32 = 0x08;

/// The watchdog's reload while control runs: 205 counts of the LSI divided by 8.
const USUAL: u32 = 204;

/// QEMU's name for what is at the watchdog's address.
const IWDG: &str = "I2S2ext";

/// Locked anti-phase: stop is half of 4200 ticks.
const NEUTRAL: u32 = 2100;

fn go(quantity: Quantity, targets: [Option<i16>; CHANNELS]) -> Command<'static> {
    Command::Move(Move { quantity, addressing: Addressing::List, targets, periods: 0 })
}

/// Channels 0 and 4: one of TIM1 (or TIM3), one of TIM8 (or TIM12).
fn first_and_fifth(first: i16, fifth: i16) -> [Option<i16>; CHANNELS] {
    [Some(first), None, None, None, Some(fifth), None]
}

/// Safe first: enable lines PE2, PE4 to PE8 low, then the bridges neutral, the servos without
/// pulses, the output port PD8 to PD15 low.
fn assert_safe_state_is_written(machine: &mut Machine) {
    let enables = machine.written("GPIOE", BSRR, 0x01F4_0000);
    for channel in 0..4 {
        assert!(enables < machine.written("timer[1]", CCR1 + 4 * channel, NEUTRAL));
    }
    for channel in 0..2 {
        assert!(enables < machine.written("timer[8]", CCR1 + 4 * channel, NEUTRAL));
        assert!(enables < machine.written("timer[12]", CCR1 + 4 * channel, 0));
    }
    machine.written("GPIOD", BSRR, 0xFF00_0000);
    let tim3 = machine.stopped(|gdb| [0, 4, 8, 12].map(|k| gdb.word(0x4000_0434 + k)));
    assert_eq!(tim3, [0; 4]);
}

/// Everything moves, so that a safe state can be told from the one at boot.
fn set_everything_going(machine: &mut Machine) {
    machine.order(go(Quantity::Pwm, [Some(24_576); CHANNELS]));
    machine.order(go(Quantity::Servo, [Some(3375); CHANNELS]));
    machine.order(Command::GpioOutputs(0xFF));
    machine.written("timer[8]", CCR1 + 4, 3150);
    machine.written("timer[12]", CCR1 + 4, 4500);
}

#[test]
#[ignore = "needs QEMU 7.2 and the image that .ci/images builds"]
fn the_image_acknowledges_streams_and_drives_its_registers() {
    let mut machine = Machine::boot("drives", IMAGE, &[]);

    // All telemetry is on at boot.
    machine.report(|report| matches!(report, Report::Motors(_)).then_some(()));
    machine.report(|report| matches!(report, Report::CustomIo(_)).then_some(()));
    let sonar = machine.report(|report| match report {
        Report::Sensors(report) => Some(report.sonar_cm),
        _ => None,
    });
    assert_eq!(sonar, [255; 6], "no echo line ever rises");
    machine.order(Command::Ping);

    // PWM. 24576 is half forward: (1 + 1/2) / 2 of 4200; 8192 is half reverse.
    machine.forget();
    machine.order(go(Quantity::Pwm, first_and_fifth(24_576, 8192)));
    let compare = machine.written("timer[1]", CCR1, 3150);
    let enable = machine.written("GPIOE", BSRR, 1 << 2);
    assert!(compare < enable, "a bridge is enabled last");
    machine.written("timer[8]", CCR1, 1050);
    machine.written("GPIOE", BSRR, 1 << 7);
    assert!(!machine.is_written("timer[1]", CCR1 + 4), "channel 1 is left alone");

    // Servos: 3 MHz for the protocol's 2.25 MHz.
    machine.order(go(Quantity::Servo, first_and_fifth(3375, 6000)));
    machine.written("timer[12]", CCR1, 8000);
    let tim3 = machine.stopped(|gdb| (gdb.word(0x4000_0434), gdb.word(0x4000_0438)));
    assert_eq!(tim3, (4500, 0), "1.5 ms, and no pulse before the first command");

    // The output port: what is 1 is set, what is 0 is reset, in one write.
    machine.order(Command::GpioOutputs(0xA5));
    machine.written("GPIOD", BSRR, 0x5A00_A500);

    // Suspension disables first.
    machine.forget();
    machine.order(Command::Run { scope: Scope::All, run: false });
    let enable = machine.written("GPIOE", BSRR, 1 << (2 + 16));
    assert!(enable < machine.written("timer[1]", CCR1, NEUTRAL), "a bridge is disabled first");
    machine.written("GPIOE", BSRR, 1 << (7 + 16));
    machine.written("timer[8]", CCR1, NEUTRAL);
    machine.written("timer[12]", CCR1, 0);
    assert_eq!(machine.stopped(|gdb| gdb.word(0x4000_0434)), 0);

    // Every task is alive, so the watchdog is fed.
    machine.forget();
    machine.written(IWDG, KR, 0xAAAA);

    // Telemetry stops when it is told to.
    machine.order(Command::Telemetry { reports: Reports::All, repeat: Repeat::Stop });
    for _ in 0..3 {
        let (did, data, telemetry) = machine.frame();
        assert_eq!((did, data, telemetry), (255, vec![0], false), "only pings from now on");
    }
}

#[test]
#[ignore = "needs QEMU 7.2 and the image that .ci/images builds"]
fn a_silent_host_stops_the_bridges() {
    let mut machine = Machine::boot("silence", IMAGE, &[]);
    machine.order(go(Quantity::Pwm, first_and_fifth(24_576, 8192)));
    machine.written("GPIOE", BSRR, 1 << 2);
    machine.forget();
    machine.written("timer[1]", CCR1, NEUTRAL);
    machine.written("timer[8]", CCR1, NEUTRAL);
}

#[test]
#[ignore = "needs QEMU 7.2 and the image that .ci/images builds"]
fn the_flash_is_read_with_caches_and_where_it_works_with_prefetch() {
    // Five wait states; prefetch is bit 8, the instruction cache 9, the data cache 10.
    let machine = Machine::boot("cached", IMAGE, &[]);
    assert_eq!(machine.chip.flash_access(), 0x705);
    let (chip, flash) = (Chip::of_revision_a(), Flash::empty());
    let machine = Machine::boot_with("revision-a", IMAGE, &[], chip, &flash);
    assert_eq!(machine.chip.flash_access(), 0x605);
}

#[test]
#[ignore = "needs QEMU 7.2 and the image that .ci/images builds"]
fn a_debugger_that_halts_the_core_stops_the_watchdog_only_while_nothing_is_driven() {
    let mut machine = Machine::boot("halted", IMAGE, &[]);
    assert!(machine.chip.watchdog_stops_with_the_core());
    machine.serve(go(Quantity::Pwm, first_and_fifth(24_576, 8192)));
    assert!(!machine.chip.watchdog_stops_with_the_core());
    machine.serve(Command::Run { scope: Scope::All, run: false });
    assert!(machine.chip.watchdog_stops_with_the_core());
}

#[test]
#[ignore = "needs QEMU 7.2 and the image that .ci/images builds"]
fn a_log_that_nobody_reads_stops_nothing_though_the_probe_asks_it_to_block() {
    const LINES: u32 = 60;
    let control_block = gdb::symbol(&image(IMAGE), "_SEGGER_RTT");
    let mut machine = Machine::boot("log", IMAGE, &SLOWLY);
    machine.order(go(Quantity::Pwm, first_and_fifth(24_576, 8192)));
    machine.written("timer[1]", CCR1, 3150);
    let before = settings::health(&mut machine);
    machine.forget();

    // As a probe does when it attaches, which then is pulled. The flags of the first channel are
    // behind the identifier, two counts and five words of it.
    let (written, flags) = (control_block + 36, control_block + 44);
    machine.stopped(|gdb| gdb.set_bytes(flags, &2_u32.to_le_bytes()));
    let (mut at, mut logged) = (machine.stopped(|gdb| gdb.word(written)), 0);
    for _ in 0..LINES {
        machine.send_raw(did::PWM, &[9, 0, 0]); // no channel 9: refused, and a line of the log
        machine.acknowledged();
        let now = machine.stopped(|gdb| gdb.word(written));
        logged += now.wrapping_sub(at) % LOG_BUFFER;
        at = now;
    }
    assert!(logged > LOG_BUFFER, "only {logged} bytes were logged: there was room for all");

    // Control has missed no period, the motors are still on, and a command is obeyed.
    let after = settings::health(&mut machine);
    assert_eq!(after.periods_missed, before.periods_missed);
    assert!(after.uptime_ms > before.uptime_ms);
    assert!(!machine.values("timer[1]", CCR1).contains(&NEUTRAL), "channel 0 has stopped");
    machine.order(go(Quantity::Pwm, first_and_fifth(8192, 24_576)));
    machine.written("timer[1]", CCR1, 1050);
}

#[test]
#[ignore = "needs QEMU 7.2 and the image that .ci/images builds"]
fn a_stack_overflow_puts_the_outputs_into_their_safe_state() {
    let mut machine = Machine::boot("overflow", IMAGE, &[]);
    set_everything_going(&mut machine);
    machine.forget();
    // The stack grows down to the very start of SRAM: the next push has nowhere to go.
    machine.stopped(|gdb| gdb.set_register(SP, 0x2000_0008));
    assert_safe_state_is_written(&mut machine);
    machine.forget();
    std::thread::sleep(std::time::Duration::from_millis(300));
    assert!(!machine.is_written(IWDG, KR), "the watchdog is left to bite");
}

#[test]
#[ignore = "needs QEMU 7.2 and the image that .ci/images builds"]
fn a_panic_puts_the_outputs_into_their_safe_state() {
    let panic = gdb::symbol(&image(IMAGE), "panic_bounds_check");
    let mut machine = Machine::boot("panic", IMAGE, &[]);
    set_everything_going(&mut machine);
    machine.forget();
    machine.stopped(|gdb| {
        // panic_bounds_check(3, 3, location); the zeros at the end of SRAM are an empty location.
        for (register, value) in [(0, 3), (1, 3), (2, 0x2001_F000), (PC, panic)] {
            gdb.set_register(register, value);
        }
    });
    assert_safe_state_is_written(&mut machine);
    machine.forget();
    std::thread::sleep(std::time::Duration::from_millis(300));
    assert!(!machine.is_written(IWDG, KR), "the watchdog is left to bite");
}
