//! The Pioneer Arm that the options ask for, and how its line is served.

use embassy_time::Instant;
use firmware::personality::Boot;
use firmware::personality::pioneer_arm::PioneerArm;
use firmware::settings::Settings;
use hal_mock::board::{Make, VirtualBoard};
use protocol::arcos::{Arcos, MAX_RECEIVED, Packet};

use crate::follow::{Follower, Format, Frames};
use crate::machine::Served;
use crate::options::Options;

/// The board that the options ask for, or in one line what is wrong with its file. A dialect on the
/// command line goes before the one in the settings.
pub fn machine(options: &Options) -> Result<Box<dyn Served>, String> {
    let make = Make { line_rate: options.line_rate(), seed: options.seed(None), ..Make::default() };
    let dialect = options.dialect();
    let session = move |settings: Settings, boot: Boot, now: Instant| {
        let arm = PioneerArm::new(settings, boot, now);
        match dialect {
            Some(dialect) => arm.with_dialect(dialect),
            None => arm,
        }
    };
    Ok(Box::new(VirtualBoard::with_session(make, options.flash()?, session)))
}

impl Served for VirtualBoard<PioneerArm> {
    fn follower(&self) -> Box<dyn Follower> {
        Box::new(Frames::<Arcos, MAX_RECEIVED>::new(FORMAT))
    }
}

/// The packets of a host, for the log.
const FORMAT: Format = Format {
    sealed: |packet| Some(Packet::parse(packet)?.encode(&mut [0; MAX_RECEIVED]).ok()?.to_vec()),
    checksum: (2, 0),
    remark: |_| None,
};
