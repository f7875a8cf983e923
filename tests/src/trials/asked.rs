//! What a channel was asked for, as the [model](super::model) remembers it.

use firmware::control::axis::SetPoint;

/// What a channel was last asked for, and so what it may do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Asked {
    /// Nothing, or it was stopped for good: it is off.
    Nothing,
    /// To move.
    Motion { timed: bool },
    /// To move, and then to pause: it is off until it is resumed.
    Pause { timed: bool },
    /// To stop. From this period on, if it is known, its set-point is 0.
    Stop { by: Option<u32> },
    /// Nothing any more: its host fell silent, under way or not. It is off from this period on.
    Silence { by: u32, under_way: bool },
    /// The same of a position loop: from this period on its set-point stays.
    Hold { by: u32, at: Option<SetPoint> },
    /// It was paused, and its move may be forgotten.
    Unknown,
}

impl Asked {
    /// What is left when it was suspended.
    pub(super) fn suspended(self) -> Self {
        match self {
            Self::Motion { timed } => Self::Pause { timed },
            Self::Stop { .. } | Self::Silence { .. } | Self::Hold { .. } => Self::Nothing,
            other => other,
        }
    }

    /// What comes back when it was resumed.
    pub(super) fn resumed(self) -> Self {
        match self {
            Self::Pause { timed } => Self::Motion { timed },
            other => other,
        }
    }
}

/// A motion command that the controller may still be about to carry out.
#[derive(Clone, Copy, Debug)]
pub(super) struct Coming {
    pub(super) is_stop: bool,
    pub(super) periods: u16,
    /// When it was given.
    pub(super) at: u32,
    /// A suspension came behind it, and then a resume.
    pub(super) is_suspended: bool,
    pub(super) is_resumed: bool,
}
