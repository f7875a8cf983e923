//! What the packets say, typed, both directions. The number of servos agreed on tells them apart,
//! so whoever reads goals, an answer or a report says how many there are.

use super::MAX_SERVOS;
use super::packet::encode;
use crate::dynamixel::{EncodeError, Register};

/// Why a packet of the PC is not carried out. Nothing of it may be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Refusal {
    /// So many parameters are neither goals nor an answer for the servos there are.
    #[error("{0} parameters are for another number of servos")]
    Length(usize),
    /// A return delay that the servo's register does not take.
    #[error("no servo has a return delay of {0}")]
    ReturnDelay(u8),
    /// Limits that are out of range, or the wrong way round.
    #[error("{cw} to {ccw} are no limits of a servo")]
    Limits {
        /// Clockwise.
        cw: u16,
        /// Counter-clockwise.
        ccw: u16,
    },
    /// A goal with a value that the servo's register does not take.
    #[error("{register} does not take {value}")]
    Goal {
        /// The register's name.
        register: &'static str,
        /// The value.
        value: u16,
    },
}

/// CM-5 to PC: which servos there are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Hello<'a> {
    /// Their IDs, up to [`MAX_SERVOS`].
    pub ids: &'a [u8],
}

impl<'a> Hello<'a> {
    /// Reads a packet's parameters; `None` if they are no hello.
    pub fn parse(params: &'a [u8]) -> Option<Self> {
        let (&count, ids) = params.split_first()?;
        (usize::from(count) == ids.len()).then_some(Self { ids })
    }

    /// Writes a whole packet into `out` and answers the part it took.
    pub fn encode<'b>(&self, out: &'b mut [u8]) -> Result<&'b mut [u8], EncodeError> {
        let count = u8::try_from(self.ids.len()).ok().filter(|_| self.ids.len() <= MAX_SERVOS);
        encode([&[count.ok_or(EncodeError::TooLong)?], self.ids], out)
    }
}

/// How far a servo may turn: 0 to 1023, CW not above CCW. Both 0: it turns endlessly.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Limits([u8; Self::BYTES]);

impl Limits {
    const BYTES: usize = 4;

    /// Limits, if a servo can have them.
    pub fn new(cw: u16, ccw: u16) -> Result<Self, Refusal> {
        let ([cw_low, cw_high], [ccw_low, ccw_high]) = (cw.to_le_bytes(), ccw.to_le_bytes());
        Self::parse([cw_low, cw_high, ccw_low, ccw_high])
    }

    fn parse(bytes: [u8; Self::BYTES]) -> Result<Self, Refusal> {
        let (cw, ccw) = (word(&bytes, 0, 2), word(&bytes, 2, 2));
        let in_range = Register::CW_LIMIT.accepts(cw) && Register::CCW_LIMIT.accepts(ccw);
        if in_range && cw <= ccw { Ok(Self(bytes)) } else { Err(Refusal::Limits { cw, ccw }) }
    }
}

/// The register of `size` bytes at this place, the low byte first; 0 behind the end.
fn word(bytes: &[u8], place: usize, size: u8) -> u16 {
    match (size, bytes.get(place..)) {
        (1, Some([byte, ..])) => (*byte).into(),
        (_, Some([low, high, ..])) => u16::from_le_bytes([*low, *high]),
        _ => 0,
    }
}

/// PC to CM-5: the answer to a hello.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct HelloAnswer<'a> {
    /// Of all servos, in 2 us: 0 to 254.
    pub return_delay: u8,
    /// Limits found to be good: of each servo, or one pair for all.
    limits: &'a [[u8; Limits::BYTES]],
}

impl<'a> HelloAnswer<'a> {
    /// Reads a packet's parameters as the answer to a hello of `servos` servos.
    pub fn parse(params: &'a [u8], servos: usize) -> Result<Self, Refusal> {
        let bad_length = Refusal::Length(params.len());
        let (&return_delay, limits) = params.split_first().ok_or(bad_length)?;
        let (limits, []) = limits.as_chunks() else { return Err(bad_length) };
        if limits.len() != servos && limits.len() != 1 {
            return Err(bad_length);
        }
        if !Register::RETURN_DELAY.accepts(return_delay.into()) {
            return Err(Refusal::ReturnDelay(return_delay));
        }
        limits.iter().try_for_each(|pair| Limits::parse(*pair).map(drop))?;
        Ok(Self { return_delay, limits })
    }

    /// The limits of the servo at this place in the hello.
    pub fn limits(&self, place: usize) -> Option<Limits> {
        let place = if self.limits.len() == 1 { 0 } else { place };
        self.limits.get(place).copied().map(Limits)
    }

    /// What the servo at this place is to hold in its registers 5 to 9.
    pub fn setup(&self, place: usize) -> Option<[u8; 5]> {
        let [cw_low, cw_high, ccw_low, ccw_high] = self.limits(place)?.0;
        Some([self.return_delay, cw_low, cw_high, ccw_low, ccw_high])
    }

    /// Writes a whole packet into `out` and answers the part it took: with one pair of limits, it
    /// is for all servos.
    pub fn encode<'b>(
        return_delay: u8,
        limits: &[Limits],
        out: &'b mut [u8],
    ) -> Result<&'b mut [u8], EncodeError> {
        if limits.len() > MAX_SERVOS {
            return Err(EncodeError::TooLong);
        }
        let limits = limits.iter().map(|limits| &limits.0[..]);
        encode(core::iter::once(&[return_delay][..]).chain(limits), out)
    }
}

/// What one servo is to do: its writable registers, 24 to 35 and 47 to 49, as on the wire.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ServoGoal(pub [u8; Self::BYTES]);

impl ServoGoal {
    /// On the wire.
    pub const BYTES: usize = 15;
    /// So many of them are the registers 24 to 35.
    const MOTION_BYTES: usize = 12;

    /// In the order of the wire.
    pub const REGISTERS: [Register; 11] = [
        Register::TORQUE_ENABLE,
        Register::LED,
        Register::CW_MARGIN,
        Register::CCW_MARGIN,
        Register::CW_SLOPE,
        Register::CCW_SLOPE,
        Register::GOAL_POSITION,
        Register::MOVING_SPEED,
        Register::TORQUE_LIMIT,
        Register::LOCK,
        Register::PUNCH,
    ];

    /// The value for one of [`Self::REGISTERS`].
    pub fn get(&self, register: Register) -> u16 {
        word(&self.0, Self::place(register), register.size)
    }

    /// The same goal with another value for one of [`Self::REGISTERS`].
    #[must_use]
    pub fn with(mut self, register: Register, value: u16) -> Self {
        let places = self.0.iter_mut().skip(Self::place(register)).take(register.size.into());
        places.zip(value.to_le_bytes()).for_each(|(place, byte)| *place = byte);
        self
    }

    fn place(register: Register) -> usize {
        let before = Self::REGISTERS.iter().take_while(|other| other.address != register.address);
        before.map(|other| usize::from(other.size)).sum()
    }

    /// Whether a servo takes all of it. One that does not take a value (a slope of 255, say) does
    /// nothing of the registers 24 to 35, not even stop, and cannot tell, since nobody answers a
    /// SYNC_WRITE.
    fn check(&self) -> Result<(), Refusal> {
        match Self::REGISTERS.into_iter().find(|register| !register.accepts(self.get(*register))) {
            Some(bad) => Err(Refusal::Goal { register: bad.name, value: self.get(bad) }),
            None => Ok(()),
        }
    }

    /// The registers 24 to 35, and 47 to 49.
    pub fn blocks(&self) -> (&[u8], &[u8]) {
        self.0.split_at(Self::MOTION_BYTES)
    }
}

/// PC to CM-5: what the servos are to do, all of it found to be good.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Goals<'a>(&'a [[u8; ServoGoal::BYTES]]);

impl<'a> Goals<'a> {
    /// Reads a packet's parameters as goals for `servos` servos, at least one.
    pub fn parse(params: &'a [u8], servos: usize) -> Result<Self, Refusal> {
        let (goals, []) = params.as_chunks() else { return Err(Refusal::Length(params.len())) };
        if goals.len() != servos || servos == 0 {
            return Err(Refusal::Length(params.len()));
        }
        goals.iter().try_for_each(|goal| ServoGoal(*goal).check())?;
        Ok(Self(goals))
    }

    /// One for each servo, in the order of the IDs.
    pub fn iter(&self) -> impl Iterator<Item = ServoGoal> + use<'a> {
        self.0.iter().copied().map(ServoGoal)
    }

    /// Writes a whole packet into `out` and answers the part it took.
    pub fn encode<'b>(goals: &[ServoGoal], out: &'b mut [u8]) -> Result<&'b mut [u8], EncodeError> {
        encode(goals.iter().map(|goal| goal.0), out)
    }
}

/// What one servo tells: the registers 36 to 43, as they are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Feedback(pub [u8; Self::BYTES]);

impl Feedback {
    /// In the servo, and on the wire.
    pub const BYTES: usize = 8;
    /// In the place of a servo that did not answer. No servo is at 255 degrees and 25.5 V.
    const STALE: [u8; Self::BYTES] = [0xFF; Self::BYTES];

    /// What is in one of these registers.
    pub fn get(&self, register: Register) -> u16 {
        let place = register.address.saturating_sub(Register::PRESENT_POSITION.address);
        word(&self.0, place.into(), register.size)
    }
}

/// CM-5 to PC: what the servos tell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Report<'a>(&'a [[u8; Feedback::BYTES]]);

impl<'a> Report<'a> {
    /// Reads a packet's parameters as a report of `servos` servos; `None` if they are none.
    pub fn parse(params: &'a [u8], servos: usize) -> Option<Self> {
        let (feedback, rest) = params.as_chunks();
        (feedback.len() == servos && rest.is_empty()).then_some(Self(feedback))
    }

    /// One for each servo, in the order of the IDs; `None` for one that did not answer.
    pub fn iter(&self) -> impl Iterator<Item = Option<Feedback>> + use<'a> {
        let heard = |bytes| (bytes != Feedback::STALE).then_some(Feedback(bytes));
        self.0.iter().copied().map(heard)
    }

    /// Writes a whole packet into `out` and answers the part it took.
    pub fn encode(
        feedback: impl IntoIterator<Item = Option<Feedback>>,
        out: &mut [u8],
    ) -> Result<&mut [u8], EncodeError> {
        encode(
            feedback.into_iter().map(|servo| servo.map_or(Feedback::STALE, |servo| servo.0)),
            out,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::super::{MAX_PACKET, params_of};
    use super::*;

    fn params(packet: &[u8]) -> &[u8] {
        params_of(packet).unwrap()
    }

    #[test]
    fn a_hello_is_the_count_and_the_ids() {
        let mut buffer = [0; MAX_PACKET];
        let packet = Hello { ids: &[3, 7, 9] }.encode(&mut buffer).unwrap();
        assert_eq!(packet, [0xFF, 0xFF, 0, 4, 3, 3, 7, 9, !26]);
        assert_eq!(Hello::parse(params(packet)), Some(Hello { ids: &[3, 7, 9] }));
        assert_eq!(Hello { ids: &[] }.encode(&mut buffer).unwrap(), [0xFF, 0xFF, 0, 1, 0, !1]);
        for wrong in [&[][..], &[1], &[1, 2, 3]] {
            assert_eq!(Hello::parse(wrong), None);
        }
        assert_eq!(Hello { ids: &[1; 101] }.encode(&mut buffer), Err(EncodeError::TooLong));
    }

    #[test]
    fn an_answer_holds_limits_for_each_servo_or_one_pair_for_all() {
        let (narrow, wide) = (Limits::new(0x0C8, 0x320).unwrap(), Limits::new(0, 1023).unwrap());
        let mut buffer = [0; MAX_PACKET];
        let packet = HelloAnswer::encode(1, &[narrow, wide], &mut buffer).unwrap();
        assert_eq!(packet[..13], [0xFF, 0xFF, 0, 9, 1, 0xC8, 0x00, 0x20, 0x03, 0, 0, 0xFF, 0x03]);
        let answer = HelloAnswer::parse(params(packet), 2).unwrap();
        assert_eq!(answer.return_delay, 1);
        assert_eq!([0, 1, 2].map(|k| answer.limits(k)), [Some(narrow), Some(wide), None]);
        assert_eq!(answer.setup(0), Some([1, 0xC8, 0x00, 0x20, 0x03]));

        let packet = HelloAnswer::encode(1, &[narrow], &mut buffer).unwrap();
        let answer = HelloAnswer::parse(params(packet), 18).unwrap();
        assert_eq!([0, 17].map(|k| answer.limits(k)), [Some(narrow); 2]);
    }

    #[test]
    fn an_answer_with_anything_wrong_is_refused() {
        let good = [1, 0, 0, 0xFF, 3, 0, 0, 0xFF, 3];
        assert!(HelloAnswer::parse(&good, 2).is_ok());
        for servos in [0, 1, 3] {
            assert_eq!(HelloAnswer::parse(&good, servos), Err(Refusal::Length(9)));
        }
        assert_eq!(HelloAnswer::parse(&[], 2), Err(Refusal::Length(0)));
        assert_eq!(HelloAnswer::parse(&good[..8], 2), Err(Refusal::Length(8)));
        let with = |place: usize, value| {
            let mut bytes = good;
            bytes[place] = value;
            HelloAnswer::parse(&bytes, 2).err()
        };
        assert_eq!(with(0, 255), Some(Refusal::ReturnDelay(255)));
        assert_eq!(with(8, 4), Some(Refusal::Limits { cw: 0, ccw: 0x4FF }));
        assert_eq!(with(2, 4), Some(Refusal::Limits { cw: 0x400, ccw: 0x3FF }));
        assert_eq!(with(4, 0), None, "0 to 255");
        assert_eq!(Limits::new(2, 1), Err(Refusal::Limits { cw: 2, ccw: 1 }));
    }

    #[test]
    fn goals_are_15_bytes_a_servo_in_the_order_of_the_page() {
        let values = [1, 0, 2, 3, 32, 64, 0x0200, 0x0155, 0x03FF, 0, 0x0020];
        let fields = || ServoGoal::REGISTERS.into_iter().zip(values);
        let goal = fields().fold(ServoGoal::default(), |goal, (r, value)| goal.with(r, value));
        assert!(fields().all(|(register, value)| goal.get(register) == value));
        let mut buffer = [0; MAX_PACKET];
        let packet = Goals::encode(&[goal; 2], &mut buffer).unwrap();
        let one = [1, 0, 2, 3, 32, 64, 0x00, 0x02, 0x55, 0x01, 0xFF, 0x03, 0, 0x20, 0x00];
        assert_eq!((&packet[..4], &packet[4..19]), (&[0xFF, 0xFF, 0, 30][..], &one[..]));
        let goals = Goals::parse(params(packet), 2).unwrap();
        assert_eq!(goals.iter().collect::<Vec<_>>(), [goal; 2]);
        assert_eq!(goal.blocks(), one.split_at(12));
        for servos in [0, 1, 3] {
            assert_eq!(Goals::parse(params(packet), servos), Err(Refusal::Length(30)));
        }
        assert_eq!(Goals::parse(&[0; 29], 2), Err(Refusal::Length(29)));
        assert_eq!(Goals::parse(&[], 0), Err(Refusal::Length(0)));
    }

    #[test]
    fn goals_with_a_value_that_a_servo_does_not_take_are_refused_as_a_whole() {
        let good = [1, 0, 2, 3, 32, 64, 0x00, 0x02, 0x55, 0x01, 0xFF, 0x03, 0, 0x20, 0x00];
        // Of every register the value above its greatest, and of a slope the one below its least.
        let bad: [(usize, &[u8], &str, u16); 11] = [
            (0, &[2], "TORQUE_ENABLE", 2),
            (1, &[2], "LED", 2),
            (2, &[255], "CW_MARGIN", 255),
            (3, &[255], "CCW_MARGIN", 255),
            (4, &[255], "CW_SLOPE", 255),
            (5, &[255], "CCW_SLOPE", 255),
            (6, &[0, 4], "GOAL_POSITION", 1024),
            (8, &[0, 8], "MOVING_SPEED", 2048),
            (10, &[0, 4], "TORQUE_LIMIT", 1024),
            (12, &[2], "LOCK", 2),
            (13, &[0, 4], "PUNCH", 1024),
        ];
        for (at, bytes, register, value) in bad {
            let mut params = [good, good].concat();
            assert!(Goals::parse(&params, 2).is_ok());
            params[15 + at..][..bytes.len()].copy_from_slice(bytes);
            assert_eq!(Goals::parse(&params, 2), Err(Refusal::Goal { register, value }));
        }
    }

    #[test]
    fn a_report_is_8_registers_a_servo_and_ff_for_one_that_did_not_answer() {
        let heard = Feedback([0xFF, 1, 0x55, 4, 2, 0, 96, 41]);
        let fields = [
            (Register::PRESENT_POSITION, 0x1FF),
            (Register::PRESENT_SPEED, 0x455),
            (Register::PRESENT_LOAD, 2),
            (Register::PRESENT_VOLTAGE, 96),
            (Register::PRESENT_TEMPERATURE, 41),
        ];
        assert!(fields.into_iter().all(|(register, value)| heard.get(register) == value));
        let mut buffer = [0; MAX_PACKET];
        let packet = Report::encode([Some(heard), None], &mut buffer).unwrap();
        assert_eq!(packet[..12], [0xFF, 0xFF, 0, 16, 0xFF, 1, 0x55, 4, 2, 0, 96, 41]);
        assert_eq!(packet[12..20], [0xFF; 8]);
        let report = Report::parse(params(packet), 2).unwrap();
        assert_eq!(report.iter().collect::<Vec<_>>(), [Some(heard), None]);
        assert_eq!(Report::parse(params(packet), 3), None);
        assert_eq!(Report::parse(&[0; 17], 2), None);
    }
}
