//! The host's silence.

/// Notices that the host has fallen silent.
///
/// It watches a count of the host's signs of life, so a link that hangs is the same as a host that
/// does.
#[derive(Clone, Copy, Debug, Default)]
pub struct LinkWatch {
    signs: u32,
    /// Control periods since the last sign of life; `None` before the first.
    silence: Option<u16>,
    lost: bool,
}

/// What a period has brought.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LinkEvent {
    /// The host has just fallen silent.
    Lost,
    /// It has been silent for so long that a timed move may go on no further.
    MovesEnd,
    /// Nothing new.
    None,
}

impl LinkWatch {
    /// One period: `signs` is the count of signs of life so far, `timeout` the silence allowed in
    /// control periods (0: any), `longest_move` how long a timed move may go on without a host.
    pub fn step(&mut self, signs: u32, timeout: u16, longest_move: u16) -> LinkEvent {
        if signs != self.signs {
            self.signs = signs;
            self.silence = Some(0);
            self.lost = false;
            return LinkEvent::None;
        }
        let Some(silence) = &mut self.silence else { return LinkEvent::None };
        *silence = silence.saturating_add(1);
        if self.lost {
            let is_over = *silence == longest_move.max(timeout.saturating_add(1));
            return if is_over { LinkEvent::MovesEnd } else { LinkEvent::None };
        }
        if timeout > 0 && *silence >= timeout {
            self.lost = true;
            return LinkEvent::Lost;
        }
        LinkEvent::None
    }

    /// Whether the host, once heard, is silent for too long.
    pub fn is_lost(&self) -> bool {
        self.lost
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn silence_is_noticed_once_after_exactly_the_timeout_and_moves_end_once_too() {
        for (longest_move, moves_end) in [(3000, 3000), (2000, 2001), (0, 2001)] {
            let mut watch = LinkWatch::default();
            for _ in 0..5000 {
                assert_eq!(watch.step(0, 2000, longest_move), LinkEvent::None, "nobody was there");
            }
            watch.step(1, 2000, longest_move);
            let mut events = (1..65_000).map(|at| (at, watch.step(1, 2000, longest_move)));
            assert_eq!(events.find(|(_, e)| *e != LinkEvent::None), Some((2000, LinkEvent::Lost)));
            let next = events.find(|(_, event)| *event != LinkEvent::None);
            assert_eq!(next, Some((moves_end, LinkEvent::MovesEnd)));
            assert_eq!(events.find(|(_, event)| *event != LinkEvent::None), None);
            assert!(watch.is_lost());
            watch.step(2, 2000, longest_move);
            assert!(!watch.is_lost());
            let mut events = (0..65_000).map(|_| watch.step(2, 0, longest_move));
            assert_eq!(events.find(|event| *event != LinkEvent::None), None, "0 is never");
        }
    }
}
