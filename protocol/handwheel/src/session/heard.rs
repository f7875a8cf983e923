//! What is on the line: three receivers listen until one of them has heard a board.

use protocol::arcos::{self, Packet, Standard};
use protocol::cm5::{self, Hello};
use protocol::deframe::{Deframer, Framing};
use protocol::extension;
use protocol::pms5005::{self, Frame, RID_HOST, did};

/// Whose protocol is spoken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Personality {
    /// The WiRobot PMS5005.
    Pms5005,
    /// ARCOS, with a Pioneer Arm behind it.
    Arcos,
    /// The bridge to a bus of AX-12 servos.
    Cm5,
}

impl std::fmt::Display for Personality {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Pms5005 => "a PMS5005",
            Self::Arcos => "a Pioneer Arm",
            Self::Cm5 => "a CM-5",
        })
    }
}

/// Packets that may be a CM-5's reports, after which it is one: the format has a checksum of a byte only.
const CM5_PACKETS: u8 = 3;

/// All receivers.
#[derive(Default)]
pub(super) struct Ear {
    only: Option<Personality>,
    pms5005: pms5005::Receiver,
    arcos: arcos::Receiver,
    cm5: cm5::Receiver,
    cm5_packets: u8,
}

impl Ear {
    /// Listens to one alone from now on.
    pub(super) fn listen_to(&mut self, personality: Personality) {
        self.only = Some(personality);
    }

    /// The boards' frames in these bytes.
    pub(super) fn hear(&mut self, bytes: &[u8]) -> Vec<(Personality, Vec<u8>)> {
        let mut heard = Vec::new();
        let listens = |to| self.only.is_none_or(|only| only == to);
        if listens(Personality::Pms5005) {
            let frames = frames(&mut self.pms5005, bytes);
            heard.extend(frames.filter(|f| is_of_a_pms5005(f)).map(|f| (Personality::Pms5005, f)));
        }
        if listens(Personality::Arcos) {
            let is_known = self.only.is_some();
            let frames = frames(&mut self.arcos, bytes).filter(|f| is_known || is_of_a_robot(f));
            heard.extend(frames.map(|f| (Personality::Arcos, f)));
        }
        if listens(Personality::Cm5) {
            for frame in frames(&mut self.cm5, bytes) {
                let params = cm5::params_of(&frame).unwrap_or_default();
                if params.len().is_multiple_of(cm5::Feedback::BYTES) && !params.is_empty() {
                    self.cm5_packets = self.cm5_packets.saturating_add(1);
                }
                let is_hello = Hello::parse(params).is_some_and(|hello| !hello.ids.is_empty());
                if self.only.is_some() || is_hello || self.cm5_packets >= CM5_PACKETS {
                    heard.push((Personality::Cm5, frame));
                }
            }
        }
        heard
    }
}

fn frames<F: Framing, const N: usize>(
    receiver: &mut Deframer<F, N>,
    mut bytes: &[u8],
) -> impl Iterator<Item = Vec<u8>> {
    let mut frames = Vec::new();
    while let Some(frame) = receiver.receive(&mut bytes) {
        frames.push(frame.to_vec());
    }
    frames.into_iter()
}

/// Whether a PMS5005 has sent it, and not another host on the same line.
fn is_of_a_pms5005(frame: &[u8]) -> bool {
    Frame::parse(frame).is_some_and(|frame| {
        let known = matches!(frame.did, did::MOTORS..=did::SENSORS | did::SETUP);
        frame.rid == RID_HOST && (known || extension::is_read(frame.did))
    })
}

/// Whether a robot says so of itself: an answer to SYNC0, or a standard packet.
fn is_of_a_robot(packet: &[u8]) -> bool {
    Packet::parse(packet).is_some_and(|packet| {
        Standard::parse(&packet).is_some() || (packet.id == 0 && packet.data.is_empty())
    })
}
