//! Channels as people count them.

use std::fmt;
use std::str::FromStr;

use protocol::pms5005::Channel;

/// A DC channel (motor 1 to 6) or a servo channel, 1 to 6 as people count. The wire has 0 to 5.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Number(Channel);

impl Number {
    /// The first.
    pub const ONE: Self = Self(Channel::Channel0);

    /// All six, in order.
    pub fn all() -> impl Iterator<Item = Self> {
        Channel::ALL.into_iter().map(Self)
    }

    /// Number 1 to 6, if it is one.
    pub fn new(number: u8) -> Option<Self> {
        Channel::new(number.checked_sub(1)?).map(Self)
    }

    /// As on the wire, 0 to 5.
    pub fn channel(self) -> Channel {
        self.0
    }

    /// 0 to 5, for arrays of six.
    pub fn index(self) -> usize {
        self.0.index()
    }
}

impl From<Channel> for Number {
    fn from(channel: Channel) -> Self {
        Self(channel)
    }
}

impl fmt::Display for Number {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.0.number() + 1)
    }
}

impl FromStr for Number {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let number = text.parse().ok().and_then(Self::new);
        number.ok_or_else(|| format!("there is no channel {text}: they are 1 to 6"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn people_count_from_1_and_the_wire_from_0() {
        assert_eq!("1".parse::<Number>().map(|n| n.channel().number()), Ok(0));
        assert_eq!("6".parse::<Number>().map(|n| n.index()), Ok(5));
        for wrong in ["0", "7", "-1", "x", ""] {
            assert!(wrong.parse::<Number>().is_err(), "{wrong}");
        }
        assert_eq!(Number::all().map(|n| n.to_string()).collect::<String>(), "123456");
    }
}
