//! The CM-5 that the options ask for, a bridge or a pass-through, and how its line is served.

use hal_mock::machine::{Cm5, PassThrough};
use hal_mock::plant::Ax12;
use hal_mock::{cm5_board, pass_through_board, servo_bus};
use protocol::cm5::{self, MAX_PACKET};

use crate::ax12_bus;
use crate::follow::{Follower, Format, Frames};
use crate::machine::Served;
use crate::options::Options;

/// The CM-5 that the options ask for, or in one line what is wrong with them.
pub fn machine(options: &Options) -> Result<Box<dyn Served>, String> {
    let servos = options.servos()?.into_iter().map(Ax12::new).collect();
    let (faults, seed) = (options.bus_faults()?, options.seed(None));
    let (bus, line_rate) =
        (servo_bus::Make { faults, seed, ..servo_bus::Make::default() }, options.line_rate());
    Ok(if options.pass_through {
        Box::new(PassThrough::new(pass_through_board::Make { servos, bus, line_rate }))
    } else {
        let make = cm5_board::Make { servos, bus, line_rate, ..cm5_board::Make::default() };
        Box::new(Cm5::new(make))
    })
}

impl Served for Cm5 {
    /// A PC that reads slowly is to have the newest report: Linux takes twice this, which holds half
    /// a second of 18 servos' reports.
    fn send_buffer(&self) -> usize {
        4 << 10
    }

    fn follower(&self) -> Box<dyn Follower> {
        Box::new(Frames::<cm5::Cm5, MAX_PACKET>::new(FORMAT))
    }
}

impl Served for PassThrough {
    fn follower(&self) -> Box<dyn Follower> {
        ax12_bus::follower()
    }
}

/// The packets of a PC, for the log.
const FORMAT: Format = Format {
    sealed: |packet| {
        let params = cm5::params_of(packet)?;
        Some(cm5::encode([params], &mut [0; MAX_PACKET]).ok()?.to_vec())
    },
    checksum: (1, 0),
    remark: |_| None,
};
