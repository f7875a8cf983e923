//! Hosts of virtual boards, for the tests beside it: [`host`] is what all have in common,
//! [`timeline`] what is seen when; [`Bench`], [`arm::Arm`] and [`cm5::Bench`] speak a personality's
//! words, and [`extension`] those that the first two share. [`foreign`] is a motor and a PID that the
//! controller was not written beside, [`workshop`] two hundred drives that no tuner was.
//! [`trials`] play boards, receivers, formats and files under whatever can befall them.
//!
//! - `tests/conformance/`: the manual, example by example and table by table;
//! - `tests/reception/`: properties of the receiver and of every codec;
//! - `tests/session.rs`: acknowledgements, telemetry, a saturated line;
//! - `tests/extension.rs`: settings, upkeep, health and faults over the wire;
//! - `tests/store.rs`: settings in a flash that loses power at any byte;
//! - `tests/control.rs`: the loops against the simulated motors, with bounds on both sides;
//! - `tests/safety.rs`: silence, suspension, obstacles; `tests/stops.rs`: nothing moves after a stop;
//! - `tests/asked.rs`: what was asked moves as asked; `tests/reasons.rs`: why a motor does not;
//! - `tests/refusals.rs`: what is not done; `tests/order.rs`: one frame, one period;
//! - `tests/watchdog.rs`: tasks that hang; `tests/world.rs`: a wall, and what breaks on the way to it;
//! - `tests/faults/`: every fault and its near miss, every setting of them; `tests/healthy.rs`: what
//!   is none;
//! - `tests/rooms.rs`: what each module of the firmware may import;
//! - `tests/week.rs`: hours of chaos, in CI, and a week of it; what holds all the while is [`trials`]';
//! - `tests/same_bits.rs`: one digest of the controller for every machine;
//! - `tests/arcos.rs`: ARCOS packets; `tests/pioneer_arm/`: the arm behind them, as scenarios;
//! - `tests/dynamixel.rs`, `tests/servo_bus.rs`: the packets of the servo bus, and the bus;
//! - `tests/cm5/`: the CM-5's bridge between a PC and simulated servos;
//! - `tests/qemu/`: the virtual board as an image, in QEMU; `tests/module/`: as a WebAssembly module, in Node: both
//!   with [`every_did`];
//! - `benches/tuning.rs`: what tuning makes of two hundred drives;
//! - `fuzz/`: a workspace of its own, the [`trials`] by a coverage-guided fuzzer (`.ci/fuzz`);
//! - `cost/`: a crate of its own, what the code costs in instructions;
//! - `chip/`: a workspace of its own, the images that are flashed on a modelled chip (`.ci/chip`).

pub mod arm;
pub mod cm5;
pub mod every_did;
pub mod extension;
pub mod foreign;
pub mod host;
pub mod pms5005;
pub mod timeline;
pub mod trials;
pub mod workshop;

use std::ops::Range;

use firmware::channel::Channel;
use firmware::controller::Snapshot;
use firmware::personality::{BlockRows, View};
use firmware::recorder::{Recorder, Recording};
pub use pms5005::{Bench, Received};
use protocol::extension::Fault;
pub use timeline::Link;

/// The latched faults in the extension's words: with their channels, from 0, or none for the board's.
pub fn latched(snapshot: &Snapshot) -> Vec<(Fault, Option<u8>)> {
    let name = |(fault, channel): (firmware::safety::faults::Fault, Option<Channel>)| {
        let fault = Fault::from_number(fault.number()).expect("it has the same number");
        (fault, channel.map(|channel| channel.index() as u8))
    };
    snapshot.faults.iter().map(name).collect()
}

/// A board at this moment, which has recorded nothing.
pub struct At(pub Snapshot);

impl View for At {
    fn snapshot(&self) -> Snapshot {
        self.0
    }

    fn recording(&self) -> Recording {
        Recorder::new([]).recording()
    }

    fn rows(&self, _numbers: Range<usize>) -> (u8, BlockRows) {
        (0, BlockRows::new())
    }
}
