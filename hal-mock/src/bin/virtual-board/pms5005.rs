//! The PMS5005 that the options ask for, and how its line is served.

use hal_mock::board::{Make, VirtualBoard};
use hal_mock::plant::Scene;
use hal_mock::scene_file;
use protocol::pms5005::{Frame, MAX_FRAME, Pms5005 as Framing, RID_HOST, RID_PMS5005};

use crate::follow::{Follower, Format, Frames};
use crate::machine::Served;
use crate::options::Options;

/// The board that the options ask for, or in one line what is wrong with its files.
pub fn machine(options: &Options) -> Result<Box<dyn Served>, String> {
    let scene = match &options.scene {
        None => Scene::default(),
        Some(path) => {
            let shown = path.display();
            // A FIFO would wait for somebody.
            if path.metadata().is_ok_and(|metadata| !metadata.is_file()) {
                return Err(format!("--scene {shown}: must be a file"));
            }
            let text =
                std::fs::read_to_string(path).map_err(|e| format!("--scene {shown}: {e}"))?;
            scene_file::parse(&text).map_err(|e| format!("--scene {shown}: {e}"))?
        }
    };
    let (line_rate, seed) = (options.line_rate(), options.seed(scene.seed));
    let make = Make { scene, line_rate, seed, ..Make::default() };
    Ok(Box::new(VirtualBoard::with_flash(make, options.flash()?)))
}

impl Served for VirtualBoard {
    fn follower(&self) -> Box<dyn Follower> {
        Box::new(Frames::<Framing, MAX_FRAME>::new(FORMAT))
    }
}

/// The frames of a host, for the log.
const FORMAT: Format = Format {
    sealed: |frame| Some(Frame::parse(frame)?.encode(&mut [0; MAX_FRAME]).ok()?.to_vec()),
    checksum: (3, 2),
    remark: |frame| match Frame::parse(frame)?.rid {
        RID_PMS5005 => None,
        RID_HOST => Some(format!("a frame of our own, with RID {RID_HOST}, is ignored")),
        rid => Some(format!("wrong RID: {rid} came, ours is {RID_PMS5005}, the frame is ignored")),
    },
};
