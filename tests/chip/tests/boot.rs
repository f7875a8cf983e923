//! From power on to the first bytes, of every image: what the model could not stand in for.

use std::fmt::Debug;

use chip::bench::pms5005::Host;
use chip::bench::{Bench, Make};
use chip::part::pull;
use protocol::extension::{Action, Answer, Request, ResetCause, Verdict};
use protocol::pms5005::{Command, Quantity};
use rigless::device::Level;
use rigless::mcu::Operate;
use rigless::soc::Width;
use rigless::soc::stm32f427::generated::{dbg, flash, gpioa, rcc};

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
fn the_arm_the_bridge_and_the_pass_through_boot_without_a_gap() {
    for image in ["pioneer-arm-f407", "cm5-f407", "cm5-pass-through-f407"] {
        let mut bench = Bench::boot(image);
        bench.run_for(1500);
        assert_eq!(gaps(&bench), [""; 0], "{image}");
        assert!(bench.with(|stand| stand.feeds.len()) > 10, "{image} is alive");
    }
}

/// The F446 is another part: its reference manual is RM0390. What its images use of it is where and what
/// the F407's is, but for one register that embassy writes, DCKCFGR2, which this part does not have: it
/// chooses clocks of peripherals that no image uses.
#[test]
fn the_f446_s_images_run_on_the_f407_as_far_as_they_are_alike() {
    let mut host = Host::boot("pms5005-f446");
    host.go(Quantity::Pwm, [Some(24_576), None, None, None, None, Some(8192)]);
    host.live_for(600);
    let speed = host.bench.with(|stand| stand.rig().world.plant.motors[0].velocity());
    assert!((7000.0..8200.0).contains(&speed), "{speed}");
    let only = |gaps: Vec<String>| {
        assert_eq!(gaps.len(), 1, "{gaps:?}");
        assert!(gaps[0].starts_with("unmapped: Unmapped { address: 0x40023894"), "{gaps:?}");
    };
    only(gaps(&host.bench));
    let mut bench = Bench::boot("cm5-f446");
    bench.run_for(1500);
    only(gaps(&bench));
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
    for revision_a in [0x1000_6411, 0x1000_6413] {
        assert_eq!(access(revision_a), 0x605, "{revision_a:#x}");
    }
}

#[test]
fn the_host_s_line_is_pulled_up_for_when_nobody_is_there() {
    let host = Host::boot("pms5005-f407");
    let up = host.bench.with(|stand| pull(&stand.rig().chip, "GPIOA", 3));
    assert_eq!(up, 1);
}

#[test]
fn the_accelerometer_of_the_discovery_is_never_selected() {
    // PE3 is its chip select; selected, it would drive PA6, which is a ranger's trigger.
    let mut host = Host::boot("pms5005-f407");
    host.live_for(300);
    assert_eq!(host.bench.with(|stand| stand.rig().chip.level(4, 3)), Level::High);
}

/// A loader's stand-in: vectors, then code that notes the vector table's place (0xE000_ED08) and the
/// stack pointer at 0x2001_F000, and waits.
fn loader() -> Vec<u8> {
    let code: [u16; 10] = [
        0x4804, // ldr r0, [pc, #16]: VTOR's address
        0x6800, // ldr r0, [r0]
        0x4904, // ldr r1, [pc, #16]: where to note it
        0x6008, // str r0, [r1]
        0x4668, // mov r0, sp
        0x6048, // str r0, [r1, #4]
        0xE7FE, // b .
        0x46C0, 0x46C0, 0x46C0,
    ];
    let mut bytes: Vec<u8> =
        [0x2000_2D40_u32, 0x1FFF_0009].into_iter().flat_map(u32::to_le_bytes).collect();
    bytes.extend(code.into_iter().flat_map(u16::to_le_bytes));
    bytes.extend([0xE000_ED08_u32, 0x2001_F000].into_iter().flat_map(u32::to_le_bytes));
    bytes
}

#[test]
fn the_loader_is_entered_with_its_own_stack_and_its_own_vectors() {
    let make = Make { loader: loader(), ..Make::default() };
    let mut host = Host::boot_with("pms5005-f407", make);
    host.send(Command::Extension(Request::Do(Action::RebootIntoDfu)));
    host.run_for(300);
    let verdict = host.wait("outcome", |frame| match frame.answer() {
        Some(Answer::Outcome(outcome)) => Some(outcome.verdict),
        _ => None,
    });
    assert_eq!(verdict, Verdict::Done);
    let noted = host.bench.with(|stand| {
        [0x2001_F000, 0x2001_F004].map(|at| stand.host.read(at, Width::W32).unwrap())
    });
    assert_eq!(noted, [0x1FFF_0000, 0x2000_2D40]);
    let resets = host.bench.with(|stand| stand.session.resets().len());
    assert_eq!(resets, 1, "one reset, and the watchdog is not on in the loader");
    // As after a reset: no clock, no pin.
    let (clocks, modes) = host.bench.with(|stand| {
        let chip = &stand.rig().chip;
        (chip.register("RCC", rcc::Register::Cr), chip.register("GPIOE", gpioa::Register::Moder))
    });
    assert_eq!((clocks & 1 << 24, modes), (0, 0), "no PLL, every pin an input");

    // Whatever comes of it, the next reset starts the firmware.
    host.heard();
    host.bench.with(|stand| stand.reset());
    host.run_for(100);
    host.heard();
    assert_eq!(host.identity().reset, ResetCause::Software, "nobody has cleared what led there");
    // And what looks like an order is none unless a program has caused the reset.
    let order = host.bench.symbol("6system5ORDER");
    host.bench.with(move |stand| {
        stand.host.write(order, Width::W32, 0xDF0B_007E).unwrap();
        stand.reset();
    });
    host.run_for(100);
    host.heard();
    assert_eq!(host.identity().reset, ResetCause::Pin);
}

#[test]
fn what_has_no_clock_does_not_answer() {
    // The bridge starts no bridge: TIM1's clock is off, TIM5's, which is embassy's, on.
    let mut bench = Bench::boot("cm5-f407");
    bench.run_for(50);
    let answers = bench.with(|stand| {
        let now = stand.now;
        let chip = &mut stand.rig().chip;
        [0x4001_0000, 0x4000_0C00].map(|at| Operate::read(chip, now, at, Width::W32).is_ok())
    });
    assert_eq!(answers, [false, true]);
}

/// embassy's clock is TIM5's 16 bits and a count of its half periods of 32,768 us, which must be even in a
/// first half and odd in a second: else its time is 65 ms back from every half period's end until the interrupt
/// is served.
#[test]
fn embassy_s_clock_counts_no_half_period_before_the_first() {
    const TIM5_CNT: u64 = 0x4000_0C24;
    let images = [
        "pms5005-f407",
        "pms5005-f446",
        "pioneer-arm-f407",
        "cm5-f407",
        "cm5-f446",
        "cm5-pass-through-f407",
    ];
    for image in images {
        let mut bench = Bench::boot(image);
        let driver = bench.symbol("11time_driver6driver6DRIVER");
        let look = |bench: &Bench| {
            bench.with(move |stand| {
                let now = stand.now;
                let chip = &mut stand.rig().chip;
                let count = Operate::read(chip, now, TIM5_CNT, Width::W32).expect("it counts");
                let words = (0..10).map(|i| stand.host.read(driver + 4 * i, Width::W32));
                (count, words.collect::<Result<Vec<_>, _>>().expect("it is RAM"))
            })
        };
        bench.run_for(10);
        let (_, first) = look(&bench);
        // Ten half periods later one of its words is ten higher.
        bench.run_until_ns(10_000_000 + 10 * 32_768_000);
        let (count, words) = look(&bench);
        let ten: Vec<_> = first.iter().zip(&words).filter(|(a, b)| *a + 10 == **b).collect();
        let [(_, &periods)] = ten[..] else { panic!("{image}: {first:?}, then {words:?}") };
        assert_eq!((periods, count >> 15), (10, 0), "{image}");
    }
}
