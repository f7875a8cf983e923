//! The CM-5's bridge, and its pass-through, between any bytes of a PC and any bytes of a bus.

use core::hint::black_box;

use embassy_time::Instant;
use firmware::bridge::pass_through::{MAX_OWN_PACKET, PassThrough};
use firmware::bridge::{Bridge, BridgeSettings, MAX_INSTRUCTION, MAX_PACKET};

use crate::any;

pub fn run() {
    let mut bridge = Bridge::new(black_box(BridgeSettings::DEFAULT), Instant::now());
    while any::<u8>() == 0 {
        bridge = black_box(bridge);
        let heard: [u8; 256] = black_box([0; 256]);
        bridge.receive(&heard, Instant::now());
        bridge.bus_hears(&heard, Instant::now());
        bridge.line_failed();
        bridge.bus_failed();
        black_box(bridge.transmit(Instant::now(), &mut [0; MAX_PACKET]));
        black_box(bridge.bus_sends(Instant::now(), &mut [0; MAX_INSTRUCTION]));
        black_box((bridge.gives_up_at(), bridge.sends_at(), bridge.bus_acts_at()));
        black_box((bridge.counters(), bridge.is_searching(), bridge.pc_is_silent()));
    }
}

pub fn run_pass_through() {
    let mut pass = PassThrough::new();
    while any::<u8>() == 0 {
        pass = black_box(pass);
        let mut heard: [u8; 64] = black_box([0; 64]);
        pass.receive(&mut heard, Instant::now());
        pass.bus_hears(&heard, Instant::now());
        pass.pc_failed();
        pass.bus_failed(Instant::now());
        black_box(pass.stop(Instant::now(), &mut [0; MAX_OWN_PACKET]));
        black_box(pass.transmit(&mut [0; 64]));
        black_box((pass.stops_at(), pass.has_answers(), pass.counters()));
        black_box(pass.wheels().count());
    }
}
