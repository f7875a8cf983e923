//! The bus of AX-12 servos that the options ask for, and how its adapter's line is served.

use hal_mock::machine::Ax12Bus;
use hal_mock::plant::Ax12;
use hal_mock::servo_bus::Make;
use protocol::dynamixel::{Dynamixel, MAX_PACKET, Packet};

use crate::follow::{Follower, Format, Frames};
use crate::machine::Served;
use crate::options::Options;

/// The bus that the options ask for, or in one line what is wrong with them.
pub fn machine(options: &Options) -> Result<Box<dyn Served>, String> {
    let servos = options.servos()?.into_iter().map(Ax12::new).collect();
    let (baud, faults, seed) = (options.line_rate(), options.bus_faults()?, options.seed(None));
    Ok(Box::new(Ax12Bus::new(Make { baud, faults, seed, ..Make::default() }, servos)))
}

/// Tells the packets of a master apart.
pub fn follower() -> Box<dyn Follower> {
    Box::new(Frames::<Dynamixel, MAX_PACKET>::new(FORMAT))
}

impl Served for Ax12Bus {
    fn follower(&self) -> Box<dyn Follower> {
        follower()
    }
}

/// The packets of a master, for the log.
const FORMAT: Format = Format {
    sealed: |packet| Some(Packet::parse(packet)?.encode(&mut [0; MAX_PACKET]).ok()?.to_vec()),
    checksum: (1, 0),
    remark: |_| None,
};
