//! The receiver against the plainest one (`tests::trials`), for every format, and what no other receiver is
//! needed for.

use std::cell::Cell;

use protocol::deframe::{Deframer, Framing};
use protocol::pms5005;
use tests::trials::{ALL, Choices};

#[test]
fn frames_are_found_as_by_the_plainest_receiver() {
    let (_, trial) = ALL.into_iter().find(|(name, _)| *name == "receivers").unwrap();
    (0..20_000).for_each(|seed| trial(&mut Choices::seeded(seed)));
}

/// A format of which every byte of a run of FF begins a candidate, and none is a frame.
enum Flood {}

thread_local!(static JUDGED: Cell<usize> = const { Cell::new(0) });

impl Framing for Flood {
    const START: [u8; 2] = [0xFF; 2];
    const HEADER: usize = 3;

    fn length(header: &[u8]) -> Option<usize> {
        Some(header[2].into())
    }

    fn is_intact(_: &[u8]) -> bool {
        JUDGED.set(JUDGED.get() + 1);
        false
    }
}

#[test]
fn every_candidate_is_judged_as_a_whole_once() {
    let stream = [0xFF; 10_000];
    for chunk in [1, 7, 64, stream.len()] {
        JUDGED.set(0);
        let mut receiver = Deframer::<Flood, 255>::new();
        for mut piece in stream.chunks(chunk) {
            assert_eq!(receiver.receive(&mut piece), None);
        }
        assert_eq!(receiver.pending(), 254);
        assert_eq!(JUDGED.get(), stream.len() - 254, "in chunks of {chunk}");
        assert_eq!(receiver.reception().bad_frames as usize, JUDGED.get());
    }
}

#[test]
fn what_follows_a_frame_is_left_to_the_caller() {
    let stream = [pms5005::ACK; 3].concat();
    let (mut receiver, mut bytes) = (pms5005::Receiver::new(), &stream[..]);
    for behind in [20, 10, 0] {
        assert_eq!(receiver.receive(&mut bytes), Some(&pms5005::ACK[..]));
        assert_eq!((bytes.len(), receiver.pending()), (behind, 0));
    }
    assert_eq!(receiver.receive(&mut bytes), None);
}
