//! What opens, keeps and closes a session, and what a robot tells of itself.
//!
//! Before a session a host sends SYNC0, SYNC1 and SYNC2 and waits for the answer to each; then
//! OPEN. PULSE keeps an idle session alive, CLOSE ends it. The numbers of both sets are the same:
//! only where the session stands tells SYNC1 from an OPEN without argument. So a host that finds a
//! session of its predecessor open cannot synchronise: its SYNC0 is a PULSE, its SYNC2 a CLOSE.
//! When standard packets come instead of the answer to SYNC0, it sends CLOSE and begins again.
//! Source: facts, "Session".

use super::packet::{Packet, append_text, take_text};
use crate::data::{Data, EncodeError, Field, record};

/// SYNC0, SYNC1, SYNC2, as a host sends them; the robot's answers to the first two are the same
/// packets.
pub const SYNC: [Packet<'static>; 3] =
    [Packet { id: 0, data: &[] }, Packet { id: 1, data: &[] }, Packet { id: 2, data: &[] }];

/// The answer to SYNC2: who the robot is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Names<'a> {
    /// This robot. Hosts exist that keep no more than 19 bytes of each of the three.
    pub name: &'a str,
    /// What hosts choose their behaviour by: `Pioneer`.
    pub class: &'a str,
    /// What hosts choose their parameters by: `p3dx`.
    pub subclass: &'a str,
}

impl<'a> Names<'a> {
    /// Writes the whole packet into `out` and answers the part it took.
    pub fn encode<'b>(&self, out: &'b mut [u8]) -> Result<&'b mut [u8], EncodeError> {
        let mut data = Data::new();
        for text in [self.name, self.class, self.subclass] {
            append_text(&mut data, text)?;
        }
        Packet { id: SYNC[2].id, data: &data }.encode(out)
    }

    /// Reads the names from an intact packet; `None` if it is another.
    pub fn parse(packet: &Packet<'a>) -> Option<Self> {
        let mut data = (packet.id == SYNC[2].id).then_some(packet.data)?;
        Some(Self {
            name: take_text(&mut data)?,
            class: take_text(&mut data)?,
            subclass: take_text(&mut data)?,
        })
    }
}

record! {
    /// The standard information packet, in the shortest form that hosts accept: no sonar readings and
    /// nothing behind them.
    #[derive(Default)]
    pub struct Standard {
        /// Odometry, in the robot's units.
        pub x: u16,
        /// Odometry, in the robot's units.
        pub y: u16,
        /// Odometry, in the robot's units.
        pub heading: i16,
        /// Velocity of the left and the right wheels, in mm/s.
        pub velocities: [i16; 2],
        /// Battery, in 0.1 V.
        pub battery_dv: u8,
        /// Stalled wheels and bumpers, as bits.
        pub stall: u16,
        /// Set-point of the heading.
        pub control: i16,
        /// Motors enabled, and others, as bits.
        pub flags: u16,
        /// Compass, in 2 degrees.
        pub compass: u8,
    }
}

impl Standard {
    /// Its id for a robot that does not drive.
    pub const ID: u8 = 0x32;

    /// Writes the whole packet into `out` and answers the part it took.
    ///
    /// # Errors
    /// [`EncodeError::BufferTooShort`].
    pub fn encode<'b>(&self, out: &'b mut [u8]) -> Result<&'b mut [u8], EncodeError> {
        let mut data = Data::new();
        self.put(&mut data)?;
        NO_SONAR.put(&mut data)?;
        Packet { id: Self::ID, data: &data }.encode(out)
    }

    /// Reads an intact packet; `None` if it is another, or of another form.
    pub fn parse(packet: &Packet<'_>) -> Option<Self> {
        let mut data = (packet.id == Self::ID).then_some(packet.data)?;
        let standard = Self::take(&mut data)?;
        (data == [NO_SONAR]).then_some(standard)
    }
}

/// How many sonar readings follow.
const NO_SONAR: u8 = 0;
