//! The core's words for its channels, six for DC motors and six for servos, numbered alike: which, what
//! measures one, and how it is run.

/// DC channels, and servos: there are six of each.
pub const CHANNELS: usize = 6;

/// Channels 0 and 1 have encoders.
pub const ENCODERS: usize = 2;
/// Channels 0 to 2 have pairs of potentiometers.
pub const PAIRS: usize = 3;

/// A DC or servo channel. People count from 1, wires and arrays from 0.
///
/// Six names rather than a number: an array of [`CHANNELS`] has each, and the compiler knows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[expect(missing_docs, reason = "the names say it")]
pub enum Channel {
    Channel0,
    Channel1,
    Channel2,
    Channel3,
    Channel4,
    Channel5,
}

impl Channel {
    /// All channels, in order.
    pub const ALL: [Self; CHANNELS] = [
        Self::Channel0,
        Self::Channel1,
        Self::Channel2,
        Self::Channel3,
        Self::Channel4,
        Self::Channel5,
    ];

    /// 0 to 5, for arrays of [`CHANNELS`].
    pub const fn index(self) -> usize {
        self as usize
    }
}

/// Channels: bit 0 is channel 0.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ChannelSet(u8);

impl ChannelSet {
    /// None of them.
    pub const NONE: Self = Self(0);

    /// Those of these bits; others than the channels' are taken away.
    pub const fn from_bits(bits: u8) -> Self {
        Self(bits & ((1 << CHANNELS) - 1))
    }

    /// Its bits.
    pub const fn bits(self) -> u8 {
        self.0
    }

    /// With this one.
    pub const fn with(self, channel: Channel) -> Self {
        Self(self.0 | 1 << channel.index())
    }

    /// Whether this one is among them.
    pub const fn has(self, channel: Channel) -> bool {
        self.0 >> channel.index() & 1 != 0
    }

    /// How many they are.
    pub fn count(self) -> usize {
        self.0.count_ones() as usize // 6 at the most
    }

    /// Each of them, in order.
    pub fn iter(self) -> impl Iterator<Item = Channel> {
        Channel::ALL.into_iter().filter(move |&channel| self.has(channel))
    }
}

/// Whom a command is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Scope {
    /// All DC channels and all servos.
    All,
    /// One DC channel.
    Motor(Channel),
    /// One servo.
    Servo(Channel),
}

/// How a DC channel is controlled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Method {
    /// Open loop: the command is the duty.
    Pwm,
    /// Closed loop on position.
    Position,
    /// Closed loop on velocity.
    Velocity,
}

impl Method {
    /// All methods.
    pub const ALL: [Self; 3] = [Self::Pwm, Self::Position, Self::Velocity];
}

/// What measures a DC channel's shaft.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Sensor {
    /// One potentiometer, 0 to 4095.
    SinglePotentiometer,
    /// Two potentiometers half a turn apart, 0 to 4427 and round again.
    DualPotentiometer,
    /// A quadrature encoder, 0 to 32767 and round again.
    Encoder,
}

impl Sensor {
    /// All sensors.
    pub const ALL: [Self; 3] = [Self::SinglePotentiometer, Self::DualPotentiometer, Self::Encoder];
}

/// The loop that gains belong to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Loop {
    /// That of positions.
    Position,
    /// That of velocities.
    Velocity,
}

/// Which way a bridge is wired: whether the sensor's counts rise when the duty is positive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Polarity {
    /// They rise.
    Positive,
    /// They fall.
    Negative,
}
