//! The host's silence.

/// Notices that the host has fallen silent.
///
/// It watches a count of the host's signs of life, so a link that hangs is the same as a host that
/// does.
#[derive(Clone, Copy, Debug, Default)]
pub struct LinkWatch {
    signs: u32,
    /// Milliseconds since the last sign of life; `None` before the first.
    silence: Option<u16>,
    /// Periods missed before the step that comes, and before the last one.
    missed: u16,
    missed_before: u16,
    lost: bool,
    /// Timed moves have been told to end.
    moves_ended: bool,
}

/// What a period has brought. Both may come at once.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LinkEvents {
    /// The host has just fallen silent.
    pub lost: bool,
    /// It has been silent for so long that a timed move may go on no further.
    pub moves_end: bool,
}

impl LinkWatch {
    /// So many control periods have passed without a step. They count with the step after the one that
    /// comes: what has arrived meanwhile is not read yet.
    pub fn missed(&mut self, periods: u16) {
        self.missed = self.missed.saturating_add(periods);
    }

    /// One period: `signs` is the count of signs of life so far, `timeout` the silence allowed in
    /// ms (0: any), `longest_move` how long a timed move may go on without a host.
    pub fn step(&mut self, signs: u32, timeout: u16, longest_move: u16) -> LinkEvents {
        let missed = core::mem::replace(&mut self.missed_before, core::mem::take(&mut self.missed));
        if signs != self.signs {
            *self = Self { signs, silence: Some(0), ..Self::default() };
            return LinkEvents::default();
        }
        let Some(silence) = &mut self.silence else { return LinkEvents::default() };
        *silence = silence.saturating_add(missed).saturating_add(1);
        let lost = !self.lost && timeout > 0 && *silence >= timeout;
        self.lost |= lost;
        let moves_end = self.lost && !self.moves_ended && *silence >= longest_move;
        self.moves_ended |= moves_end;
        LinkEvents { lost, moves_end }
    }

    /// Whether it is silent for so long that no timed move goes on.
    pub fn moves_have_ended(&self) -> bool {
        self.moves_ended
    }

    /// Whether the host, once heard, is silent for too long.
    pub fn is_lost(&self) -> bool {
        self.lost
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOTHING: LinkEvents = LinkEvents { lost: false, moves_end: false };

    #[test]
    fn silence_is_noticed_once_after_exactly_the_timeout_and_moves_end_once_too() {
        for longest_move in [3000, 2000, 0] {
            let mut watch = LinkWatch::default();
            for _ in 0..5000 {
                assert_eq!(watch.step(0, 2000, longest_move), NOTHING, "nobody was there");
            }
            watch.step(1, 2000, longest_move);
            let mut told = (1..65_000).map(|at| (at, watch.step(1, 2000, longest_move)));
            let lost = LinkEvents { lost: true, moves_end: longest_move <= 2000 };
            assert_eq!(told.find(|(_, events)| *events != NOTHING), Some((2000, lost)));
            let moves_end = LinkEvents { lost: false, moves_end: true };
            let next = (longest_move > 2000).then_some((longest_move, moves_end));
            assert_eq!(told.find(|(_, events)| *events != NOTHING), next);
            assert_eq!(told.find(|(_, events)| *events != NOTHING), None);
            assert!(watch.is_lost());
            watch.step(2, 2000, longest_move);
            assert!(!watch.is_lost());
            let mut told = (0..65_000).map(|_| watch.step(2, 0, longest_move));
            assert_eq!(told.find(|events| *events != NOTHING), None, "0 is never");
        }
    }

    #[test]
    fn periods_that_were_missed_are_time_that_passed() {
        let mut watch = LinkWatch::default();
        watch.missed(5000);
        watch.step(1, 2000, 3000);
        let mut ms = 0;
        let mut told = Vec::new();
        while ms < 60_000 {
            // Every tenth one is 25 ms late.
            if ms % 10 == 0 {
                watch.missed(25);
                ms += 25;
            }
            ms += 1;
            let events = watch.step(1, 2000, 3000);
            told.extend((events != NOTHING).then_some((ms, events)));
        }
        let lost = LinkEvents { lost: true, moves_end: false };
        let moves_end = LinkEvents { lost: false, moves_end: true };
        assert!(
            matches!(told[..], [(2000..=2025, a), (3000..=3025, b)] if (a, b) == (lost, moves_end))
        );
    }
}
