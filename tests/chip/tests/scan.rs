//! The scan of the analogue inputs: every address, from every beginning, undisturbed by the bridges.

use chip::bench::pms5005::Host;
use protocol::pms5005::Quantity;
use rigless::mcu::Operate;
use rigless::soc::Width;

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

#[test]
fn each_of_48_addresses_carries_what_is_on_its_pin() {
    let mut host = board();
    host.run_for(3);
    assert_in_place(&host, "after the start");
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
    host.run_for(3);
    host.bench.with(|stand| {
        let now = stand.now;
        stand.rig().chip.request_once_more(now);
    });
    // A control period until it is seen, and a scan until all are new.
    host.run_for(3);
    assert_in_place(&host, "after one request too many");
    host.bench.with(|stand| stand.rig().chip.tim8.lost_updates = 1);
    host.run_for(4);
    assert_in_place(&host, "after one request too few");
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
    assert!(before.abs() < 100.0, "{before} ns behind");
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

#[test]
fn beyond_that_a_channel_s_own_current_is_clean_and_the_others_hold_for_10_ms() {
    let mut host = board();
    let put_current = |host: &Host, channel: usize, millivolts: f64| {
        host.bench.with(move |stand| stand.rig().world.voltages.put(1, channel, Some(millivolts)));
    };
    let counts = |millivolts: f64| millivolts * 4096.0 / 3300.0;
    // Almost full reverse on channel 0, whose edges are in everybody's first sample; neutral elsewhere.
    let mut duties = [Some(16_384); 6];
    duties[0] = Some(5 * 327);
    host.go(Quantity::Pwm, duties);
    host.run_for(5);
    put_current(&host, 0, 1500.0);
    host.run_for(3);
    let told = host.motors().currents[0];
    assert!((f64::from(told) - counts(1500.0)).abs() <= 3.0, "fresh and clean: {told}");
    put_current(&host, 1, 2000.0);
    host.run_for(12);
    let told = host.motors().currents[1];
    // What an edge adds here is 500 counts at the most; what counts is that it is not the old one.
    assert!((counts(2000.0) - 3.0..counts(2400.0)).contains(&f64::from(told)), "{told}");
    // Full drive either way has no edges at all.
    for duty in [0, 32_767] {
        host.go(Quantity::Pwm, [Some(duty); 6]);
        put_current(&host, 2, 900.0 + f64::from(duty) / 100.0);
        host.run_for(4);
        let wanted = counts(900.0 + f64::from(duty) / 100.0);
        let told = host.motors().currents[2];
        assert!((f64::from(told) - wanted).abs() <= 3.0, "{told} for {wanted:.0} at {duty}");
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
        // The scan converts four times a period: B, A, C, B.
        let firsts = sampled.chunks(4).filter(|period| period.len() == 4).skip(1);
        for first in firsts.map(|period| period[0]) {
            let place = (first as f64 - waveforms[1].zero_ns).rem_euclid(50_000.0);
            if !(0.0..3000.0).contains(&place) {
                continue; // the chunk began within a period
            }
            for waveform in &waveforms {
                let since = waveform.since_edge(first as f64).expect("there are edges");
                assert!(since >= 2000.0, "{percent} %: {since:.0} ns behind an edge");
            }
        }
    }
}
