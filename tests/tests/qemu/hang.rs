//! Control that does not come round: wherever it is held up, the watchdog, which the machine lacks,
//! is fed no more. An instruction of the image's own becomes a jump to itself.
//!
//! The machine's clock counts instructions, so that a busy computer does not change what the image
//! sees of time. It is read from a timer that the image leaves alone.

use std::time::Duration;

use protocol::pms5005::{Quantity, did};

use crate::gdb::{Gdb, symbol};
use crate::machine::Machine;
use crate::process::image;
use crate::{
    BSRR, CCR1, IMAGE, IWDG, KR, NEUTRAL, PR, RLR, SLOWLY, USUAL, first_and_fifth, go,
    set_everything_going,
};

/// Part of the mangled name of what control calls in each of its periods, and nobody else.
const IN_CONTROL: &str = "5Shaft6update";
/// Where SysTick begins, once in a millisecond of the machine.
const TICK: &str = "SysTick";
/// `b .`
const LOOP: [u8; 2] = [0xFE, 0xE7];

/// TIM5's counter. The machine's timers count at 1 GHz, enabled or not.
const TIM5_CNT: u32 = 0x4000_0C24;

const PATIENCE: Duration = Duration::from_secs(10);

/// Lets the machine run up to an instruction.
fn run_to(gdb: &mut Gdb, address: u32) {
    gdb.stop_at(address, true);
    gdb.run();
    assert!(gdb.stops_within(PATIENCE), "{address:#x} is not reached");
    gdb.stop_at(address, false);
}

/// Control comes into the loop. Where that is, and what was there.
fn hang(gdb: &mut Gdb) -> (u32, [u8; 2]) {
    let at = symbol(&image(IMAGE), IN_CONTROL);
    run_to(gdb, at);
    let [first, second, ..] = gdb.word(at).to_le_bytes();
    gdb.set_bytes(at, &LOOP);
    (at, [first, second])
}

/// Whole milliseconds of the machine since TIM5 stood there; 4 s at the most.
fn ms_since(gdb: &mut Gdb, then: u32) -> u32 {
    gdb.word(TIM5_CNT).wrapping_sub(then) / 1_000_000
}

/// Waits until so much of the machine's time has passed.
fn pass_ms(machine: &mut Machine, ms: u32) {
    let begun = machine.stopped(|gdb| gdb.word(TIM5_CNT));
    while machine.stopped(|gdb| ms_since(gdb, begun)) < ms {
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
#[ignore = "needs QEMU 7.2 and the image that .ci/images builds"]
fn whatever_holds_control_up_for_ever_starves_a_watchdog_that_bites_within_100_ms() {
    // Control itself, an interrupt above it, and the log, which is written with interrupts off.
    for (name, held_up_in) in
        [("in-control", IN_CONTROL), ("in-interrupt", "USART2"), ("in-log", "_defmt_write")]
    {
        let mut machine = Machine::boot(name, IMAGE, &SLOWLY);
        machine.written(IWDG, PR, 1); // the LSI divided by 8
        machine.written(IWDG, RLR, USUAL); // 205 counts: 96.5 ms at 17 kHz
        set_everything_going(&mut machine);
        machine.forget();
        machine.written(IWDG, KR, 0xAAAA);
        let at = symbol(&image(IMAGE), held_up_in);
        machine.stopped(|gdb| gdb.set_bytes(at, &LOOP));
        machine.send_raw(did::PWM, &[9, 0, 0]); // no channel 9: an interrupt, and a line of the log
        pass_ms(&mut machine, 50);
        machine.forget();
        pass_ms(&mut machine, 100);
        assert!(!machine.is_written(IWDG, KR), "fed while held up in {held_up_in}");
    }
}

#[test]
#[ignore = "needs QEMU 7.2 and the image that .ci/images builds"]
fn control_that_is_slow_for_30_ms_goes_on() {
    let mut machine = Machine::boot("slow", IMAGE, &SLOWLY);
    set_everything_going(&mut machine);
    machine.forget();
    let slow = machine.stopped(|gdb| {
        let tick = symbol(&image(IMAGE), TICK);
        let (at, instruction) = hang(gdb);
        let begun = gdb.word(TIM5_CNT);
        while ms_since(gdb, begun) < 30 {
            run_to(gdb, tick);
            gdb.step(); // which may take a millisecond itself
        }
        gdb.set_bytes(at, &instruction);
        ms_since(gdb, begun)
    });
    assert!((30..=35).contains(&slow), "{slow} ms");

    // Nothing was switched off, commands are obeyed, and the watchdog is fed.
    machine.order(go(Quantity::Pwm, first_and_fifth(8192, 24_576)));
    machine.written("timer[1]", CCR1, 1050);
    assert!(!machine.values("timer[1]", CCR1).contains(&NEUTRAL));
    assert!(!machine.values("GPIOD", BSRR).contains(&0xFF00_0000));
    machine.forget();
    machine.written(IWDG, KR, 0xAAAA);
}
