//! Control in a loop without end, which runs above everybody that could miss it but SysTick: an
//! instruction of its own becomes a jump to itself.
//!
//! The machine's clock counts instructions, so that a busy computer does not change what the image
//! sees of time. It is read from a timer that the image leaves alone.

use std::time::Duration;

use protocol::pms5005::Quantity;

use crate::gdb::{Gdb, symbol};
use crate::machine::Machine;
use crate::process::image;
use crate::{
    BSRR, CCR1, IMAGE, IWDG, KR, NEUTRAL, SLOWLY, assert_safe_state_is_written, first_and_fifth,
    go, set_everything_going,
};

/// Part of the mangled name of what control calls in each of its periods, and nobody else.
const IN_CONTROL: &str = "5Shaft6update";
/// Where SysTick begins, once in a millisecond of the machine.
const TICK: &str = "SysTick";
/// `b .`
const LOOP: [u8; 2] = [0xFE, 0xE7];

/// TIM5's counter. The machine's timers count at 1 GHz, enabled or not.
const TIM5_CNT: u32 = 0x4000_0C24;
/// The enable lines' set and reset register.
const ENABLES: (bool, u32, u32) = (true, 0x4002_1000 + BSRR, 4);

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

#[test]
#[ignore = "needs QEMU 7.2 and the image that .ci/images builds"]
fn control_in_a_loop_without_end_is_switched_off_within_80_ms_and_the_watchdog_starves() {
    let mut machine = Machine::boot("loop", IMAGE, &SLOWLY);
    set_everything_going(&mut machine);
    machine.forget();
    let off = machine.stopped(|gdb| {
        hang(gdb);
        let begun = gdb.word(TIM5_CNT);
        gdb.watch(ENABLES, true);
        gdb.run();
        assert!(gdb.stops_within(PATIENCE), "the bridges stay on");
        gdb.watch(ENABLES, false);
        ms_since(gdb, begun)
    });
    println!("off after {off} ms");
    // It has driven its port for the last time in the period before.
    assert!((58..=80).contains(&off), "{off} ms");
    assert_safe_state_is_written(&mut machine);

    machine.forget();
    let begun = machine.stopped(|gdb| gdb.word(TIM5_CNT));
    while machine.stopped(|gdb| ms_since(gdb, begun)) < 500 {
        std::thread::sleep(Duration::from_millis(20));
    }
    assert!(!machine.is_written(IWDG, KR), "the watchdog is left to bite");
}

#[test]
#[ignore = "needs QEMU 7.2 and the image that .ci/images builds"]
fn control_that_is_slow_for_50_ms_goes_on() {
    let mut machine = Machine::boot("slow", IMAGE, &SLOWLY);
    set_everything_going(&mut machine);
    machine.forget();
    let slow = machine.stopped(|gdb| {
        let tick = symbol(&image(IMAGE), TICK);
        let (at, instruction) = hang(gdb);
        let begun = gdb.word(TIM5_CNT);
        while ms_since(gdb, begun) < 50 {
            run_to(gdb, tick);
            gdb.step(); // which may take a millisecond itself
        }
        gdb.set_bytes(at, &instruction);
        ms_since(gdb, begun)
    });
    assert!((50..=55).contains(&slow), "{slow} ms");

    // Nothing was switched off, commands are obeyed, and the watchdog is fed.
    machine.order(go(Quantity::Pwm, first_and_fifth(8192, 24_576)));
    machine.written("timer[1]", CCR1, 2100);
    assert!(!machine.values("timer[1]", CCR1).contains(&NEUTRAL));
    assert!(!machine.values("GPIOD", BSRR).contains(&0xFF00_0000));
    machine.forget();
    machine.written(IWDG, KR, 0xAAAA);
}
