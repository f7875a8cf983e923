//! Notices that the host has fallen silent.

/// Notices that the host has fallen silent.
///
/// It watches the count of valid frames that the link has received, so a link that hangs is the
/// same as a host that does.
#[derive(Clone, Copy, Debug, Default)]
pub struct LinkWatch {
    frames: u32,
    /// Control periods since the last frame; `None` before the first.
    silence: Option<u16>,
    lost: bool,
}

/// What a period has brought.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LinkEvent {
    /// The host has just fallen silent.
    Lost,
    /// Nothing new.
    None,
}

impl LinkWatch {
    /// One period: `frames` is the count of valid frames for us so far, `timeout` the silence
    /// allowed in control periods (0: any).
    pub fn step(&mut self, frames: u32, timeout: u16) -> LinkEvent {
        if frames != self.frames {
            self.frames = frames;
            self.silence = Some(0);
            self.lost = false;
            return LinkEvent::None;
        }
        let Some(silence) = &mut self.silence else { return LinkEvent::None };
        *silence = silence.saturating_add(1);
        if timeout > 0 && *silence >= timeout && !self.lost {
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
    fn silence_is_noticed_once_after_exactly_the_timeout() {
        let mut watch = LinkWatch::default();
        for _ in 0..5000 {
            assert_eq!(watch.step(0, 2000), LinkEvent::None, "no host was ever there");
        }
        watch.step(1, 2000);
        let lost: Vec<_> = (1..5000).filter(|_| watch.step(1, 2000) == LinkEvent::Lost).collect();
        assert_eq!(lost, [2000]);
        assert!(watch.is_lost());
        watch.step(2, 2000);
        assert!(!watch.is_lost());
        assert!((0..65_000).all(|_| watch.step(2, 0) == LinkEvent::None), "0 is never");
    }
}
