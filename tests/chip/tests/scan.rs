//! The scan of the analogue inputs: every address, from every beginning, undisturbed by the bridges.

use chip::bench::pms5005::Host;
use protocol::pms5005::{Quantity, Report};
use rigless::mcu::Operate;
use rigless::soc::Width;
use rigless::soc::stm32f427::generated::tim1::Register;

const IMAGE: &str = "pms5005-f407";

/// DMA2 stream 0, which carries the samples: its control register.
const SAMPLING: u64 = 0x4002_6410;

/// Counts of 12 bits for what stands on an input in this test, 60 mV apart.
fn put(multiplexer: usize, address: usize) -> f64 {
    60.0 + 60.0 * (16 * multiplexer + address) as f64
}

/// A board whose 48 inputs have a voltage each.
fn board() -> Host {
    let host = Host::boot(IMAGE);
    host.bench.with(|stand| {
        let world = &mut stand.rig().world;
        world.is_analog = false;
        for (multiplexer, address) in (0..48).map(|n| (n / 16, n % 16)) {
            world.voltages.put(multiplexer, address, Some(put(multiplexer, address)));
        }
    });
    host
}

/// The samples as they are in memory, by multiplexer and address: of each address B, A, C, B again.
fn samples(host: &Host) -> [[u16; 16]; 3] {
    let at = host.bench.symbol("6analog7SAMPLES");
    host.bench.with(move |stand| {
        let mut read = |n: usize| stand.host.read(at + 2 * n as u64, Width::W16).unwrap() as u16;
        [1, 0, 2].map(|place| std::array::from_fn(|address| read(4 * address + place)))
    })
}

/// Each of the 48 carries what is on its own pin.
fn assert_in_place(host: &Host, when: &str) {
    for (multiplexer, row) in samples(host).into_iter().enumerate() {
        for (address, sample) in row.into_iter().enumerate() {
            let wanted = put(multiplexer, address) * 4096.0 / 3300.0;
            let off = (f64::from(sample) - wanted).abs();
            assert!(off <= 3.0, "{when}: {multiplexer}.{address} is {sample}, not {wanted:.0}");
        }
    }
}

/// How often the image has started its scan anew.
fn restarts(host: &Host) -> u64 {
    let at = host.bench.symbol("6analog8RESTARTS");
    host.bench.with(move |stand| stand.host.read(at, Width::W32).unwrap())
}

#[test]
fn each_of_48_addresses_carries_what_is_on_its_pin() {
    let mut host = board();
    host.run_for(3);
    assert_in_place(&host, "after the start");
    // And stays in step, whatever control and the line are busy with.
    host.go(Quantity::Velocity, [Some(4000), Some(-4000), None, None, None, None]);
    host.live_for(2000);
    assert_eq!(restarts(&host), 0);
}

#[test]
fn an_open_input_keeps_what_was_sampled_before_it() {
    let mut host = board();
    host.bench.with(|stand| stand.rig().world.voltages.put(2, 9, None));
    host.run_for(3);
    let [_, _, c] = samples(&host);
    assert!(c[9].abs_diff(c[8]) <= 2, "{c:?}");
}

#[test]
fn a_scan_that_was_stopped_begins_again_in_its_place() {
    let mut host = board();
    // Whatever it was that stopped the samples' stream: the converter overruns.
    host.bench.with(|stand| {
        let now = stand.now;
        let chip = &mut stand.rig().chip;
        let control = Operate::read(chip, now, SAMPLING, Width::W32).unwrap();
        Operate::write(chip, now, SAMPLING, Width::W32, control & !1).unwrap();
    });
    host.run_for(6);
    assert_in_place(&host, "after an overrun");
}

#[test]
fn one_timer_request_too_many_or_too_few_is_noticed_within_a_period() {
    let mut host = board();
    // At sixteen places of a scan and of the PWM period.
    for n in 0..16 {
        host.bench.run_until_ns(host.bench.now_ns() + 3_000_000 + n * 53_100);
        let before = restarts(&host);
        host.bench.with(move |stand| {
            let now = stand.now;
            let chip = &mut stand.rig().chip;
            if n % 2 == 0 { chip.request_once_more(now) } else { chip.tim8.lost_updates = 1 }
        });
        // A control period until it is seen, one scan until all are new.
        host.run_for(2);
        assert_eq!(restarts(&host), before + 1, "{n}");
        assert_in_place(&host, "after a slip");
    }
}

/// How far TIM8's period begins behind TIM1's, in ns, from minus half a period to half of one.
fn phase(host: &Host) -> f64 {
    let [one, eight] = host.bench.with(|stand| stand.rig().chip.waveforms());
    assert!((one.period_ns - 50_000.0).abs() < 20.0 && one.period_ns == eight.period_ns);
    let half = one.period_ns / 2.0;
    (eight.zero_ns - one.zero_ns + half).rem_euclid(one.period_ns) - half
}

#[test]
fn both_bridge_timers_keep_their_phase_through_a_restart_of_the_scan() {
    let mut host = board();
    host.go(Quantity::Pwm, [Some(20_000); 6]);
    let before = phase(&host);
    assert!(before.abs() < 20.0, "{before} ns behind");
    // TIM8 is TIM1's slave: ITR0, trigger mode (RM0090 17.4.3).
    let slave = host.bench.with(|stand| stand.rig().chip.register("TIM8", Register::Smcr));
    assert_eq!(slave & 0x77, 0x06);
    host.bench.with(|stand| {
        let now = stand.now;
        Operate::write(&mut stand.rig().chip, now, SAMPLING, Width::W32, 0).unwrap();
    });
    host.run_for(5);
    host.go(Quantity::Pwm, [Some(21_000); 6]);
    let after = phase(&host);
    assert!((after - before).abs() < 20.0, "{before} ns before, {after} after");
}

#[test]
fn currents_are_clean_from_10_to_90_percent_of_duty() {
    let mut host = board();
    // Compare values are half the period and half the duty: 10 to 90 % high.
    for percent in (10..=90).step_by(5) {
        let duty = (percent * 32_768 / 100) as i16;
        host.go(Quantity::Pwm, [Some(duty); 6]);
        host.run_for(5);
        let currents = host.motors().currents;
        for (channel, told) in currents.into_iter().enumerate() {
            let wanted = put(1, channel) * 4096.0 / 3300.0;
            let off = (f64::from(told) - wanted).abs();
            assert!(off <= 3.0, "{percent} %: current {channel} is {told}, not {wanted:.0}");
        }
    }
}

/// Currents as control sees them, told by a motor report: asked for again until it is a new one.
fn current(host: &mut Host, channel: usize) -> f64 {
    host.heard();
    f64::from(host.motors().currents[channel])
}

#[test]
fn beyond_that_a_channel_s_own_current_is_clean_and_the_others_hold_for_10_ms() {
    let mut host = board();
    host.set(32, 20); // telemetry's shortest period, in ms
    let put = |host: &Host, channel: usize, millivolts: f64| {
        host.bench.with(move |stand| stand.rig().world.voltages.put(1, channel, Some(millivolts)));
    };
    let counts = |millivolts: f64| millivolts * 4096.0 / 3300.0;
    // 4.2 % high on channel 0: its edges fall into everybody's first sample; neutral elsewhere.
    let mut duties = [Some(16_384); 6];
    duties[0] = Some(1366); // a compare value of 175; sampling ends at 184 here, at 200 on silicon
    host.go(Quantity::Pwm, duties);
    host.run_for(40);
    put(&host, 0, 1500.0);
    put(&host, 1, 2000.0);
    // A report of the next period or two: the channel's own is fresh, and clean; another's still holds.
    let (mut own, mut others) = (Vec::new(), Vec::new());
    for _ in 0..40 {
        host.run_for(1);
        for frame in host.heard() {
            if let Some(Report::Motors(report)) = frame.report() {
                own.push((frame.at_ns, f64::from(report.currents[0])));
                others.push((frame.at_ns, f64::from(report.currents[1])));
            }
        }
    }
    assert!(own.len() >= 2, "{own:?}");
    assert!((own[own.len() - 1].1 - counts(1500.0)).abs() <= 3.0, "fresh and clean: {own:?}");
    // What an edge adds here is 500 counts at the most: behind 10 ms it is the new one, if not clean.
    let last = others[others.len() - 1].1;
    assert!((counts(2000.0) - 3.0..counts(2400.0)).contains(&last), "{others:?}");
    // Clean again, with the edge gone.
    host.go(Quantity::Pwm, [Some(16_384); 6]);
    host.run_for(5);
    assert!((current(&mut host, 1) - counts(2000.0)).abs() <= 3.0);
    // Full drive either way has no edges at all.
    for duty in [0, 32_767] {
        host.go(Quantity::Pwm, [Some(duty); 6]);
        put(&host, 2, 900.0 + f64::from(duty) / 100.0);
        host.run_for(4);
        let wanted = counts(900.0 + f64::from(duty) / 100.0);
        let told = current(&mut host, 2);
        assert!((told - wanted).abs() <= 3.0, "{told} for {wanted:.0} at {duty}");
    }
}

#[test]
fn the_first_sample_of_a_current_is_2_us_from_every_edge_in_both_ways_of_driving() {
    // How a bridge is driven is a constant of the board's file. What it changes is the compare value for a
    // duty; the samples stay where they are. So all that either way makes of 10 to 90 % is put here.
    let mut host = board();
    for percent in (10..=90).step_by(10) {
        host.bench.with(move |stand| {
            let now = stand.now;
            let chip = &mut stand.rig().chip;
            let (one, eight) = (0x4001_0034, 0x4001_0434); // CCR1 of TIM1 and TIM8
            for register in [one, one + 4, one + 8, one + 12, eight, eight + 4] {
                Operate::write(chip, now, register, Width::W32, 4200 * percent / 100).unwrap();
            }
            chip.adc1.sampled_ns = Some(Vec::new());
        });
        host.run_for(1);
        let (sampled, waveforms) = host.bench.with(|stand| {
            let chip = &mut stand.rig().chip;
            (chip.adc1.sampled_ns.take().unwrap(), chip.waveforms())
        });
        // Of the four samples of a period, the first: within 3 us behind the counter's bottom.
        let place = |at: u64| (at as f64 - waveforms[1].zero_ns).rem_euclid(50_000.0);
        let firsts: Vec<u64> = sampled.into_iter().filter(|&at| place(at) < 3000.0).collect();
        assert!(firsts.len() >= 19, "{percent} %: {} of 20 periods", firsts.len());
        for first in firsts {
            for waveform in &waveforms {
                let since = waveform.since_edge(first as f64).expect("there are edges");
                assert!(since >= 2000.0, "{percent} %: {since:.0} ns behind an edge");
            }
        }
    }
}
