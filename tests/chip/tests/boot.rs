//! From power on to the first bytes, of every image: what the model could not stand in for.

use std::fmt::Debug;

use chip::bench::pms5005::Host;
use chip::bench::{Bench, Make};
use chip::part::pull;
use protocol::pms5005::{Command, Quantity};
use rigless::soc::stm32f427::generated::{dbg, flash};

/// What the runtime could not serve, each as text.
fn gaps(bench: &Bench) -> Vec<String> {
    bench.with(|stand| {
        let session = &stand.session;
        let mut all = Vec::new();
        let mut add = |kind: &str, gap: &dyn Debug| all.push(format!("{kind}: {gap:?}"));
        session.unmapped().iter().for_each(|gap| add("unmapped", gap));
        session.refused().iter().for_each(|gap| add("refused", &gap));
        session.unimplemented().iter().for_each(|gap| add("unimplemented", &gap));
        session.undefined().iter().for_each(|gap| add("undefined", &gap));
        session.unrouted().iter().for_each(|gap| add("unrouted", &gap));
        session.told().for_each(|gap| add("told", gap));
        session.resets().iter().for_each(|reset| add("reset", reset));
        all
    })
}

#[test]
fn the_pms5005_boots_talks_and_drives_and_asks_the_part_for_nothing_that_it_lacks() {
    let mut host = Host::boot("pms5005-f407");
    assert!(host.bench.now_ns() < 100_000_000, "the first frame comes within 100 ms");
    host.order(Command::Ping);
    host.go(Quantity::Pwm, [Some(24_576), None, None, None, None, None]);
    host.live_for(600);
    let speed = host.bench.with(|stand| stand.rig().world.plant.motors[0].velocity());
    assert!((7000.0..8200.0).contains(&speed), "half forward is half of 16384 counts/s: {speed}");
    assert_eq!(gaps(&host.bench), [""; 0]);
}

#[test]
fn the_arm_and_the_bridge_boot_without_a_gap() {
    for image in ["pioneer-arm-f407", "cm5-f407"] {
        let mut bench = Bench::boot(image);
        bench.run_for(1500);
        assert_eq!(gaps(&bench), [""; 0], "{image}");
        assert!(bench.with(|stand| stand.feeds.len()) > 10, "{image} is alive");
    }
}

/// The F446 is another part: its reference manual is RM0390. What its images use of it is where and what
/// the F407's is, but for the reset and clock controller's PLLR and DCKCFGR, which rigless' F427 has too.
#[test]
fn the_f446_s_images_run_on_the_f407_as_far_as_they_are_alike() {
    let mut host = Host::boot("pms5005-f446");
    host.go(Quantity::Pwm, [Some(24_576), None, None, None, None, Some(8192)]);
    host.live_for(600);
    let speed = host.bench.with(|stand| stand.rig().world.plant.motors[0].velocity());
    assert!((7000.0..8200.0).contains(&speed), "{speed}");
    assert_eq!(gaps(&host.bench), [""; 0]);
    let mut bench = Bench::boot("cm5-f446");
    bench.run_for(1500);
    assert_eq!(gaps(&bench), [""; 0]);
}

#[test]
fn the_flash_is_read_with_caches_and_where_it_works_with_prefetch() {
    // Five wait states; prefetch is bit 8, the instruction cache 9, the data cache 10.
    let access = |identity| {
        let mut bench = Bench::boot_with("pms5005-f407", Make { identity, ..Make::default() });
        bench.run_for(20);
        bench.with(|stand| {
            let chip = &stand.rig().chip;
            assert_ne!(chip.register("DBG", dbg::Register::DbgmcuIdcode), 0);
            chip.register("FLASH", flash::Register::Acr)
        })
    };
    assert_eq!(access(chip::part::REVISION_Z), 0x705);
    assert_eq!(access(0x1000_6411), 0x605, "revision A");
}

#[test]
fn the_host_s_line_is_pulled_up_for_when_nobody_is_there() {
    let host = Host::boot("pms5005-f407");
    let up = host.bench.with(|stand| pull(&stand.rig().chip, "GPIOA", 3));
    assert_eq!(up, 1);
}
