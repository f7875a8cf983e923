//! The servos that were found, in the order of their IDs.

use protocol::cm5::{EncodeError, Hello, MAX_SERVOS, Report};
use protocol::dynamixel::Id;

use super::bus_servo::{BusServo, Standing};

/// Up to [`MAX_SERVOS`] servos; no one ever leaves.
pub struct Roster(heapless::Vec<BusServo, MAX_SERVOS>);

impl Roster {
    pub const fn new() -> Self {
        Self(heapless::Vec::new())
    }

    pub fn len(&self) -> usize {
        self.0.len()
    }

    pub fn is_full(&self) -> bool {
        self.0.is_full()
    }

    pub fn knows(&self, id: Id) -> bool {
        self.place(id).is_ok()
    }

    /// Adds a servo; `false` if there is no room, or it was there before.
    pub fn add(&mut self, id: Id) -> bool {
        match self.place(id) {
            Ok(_) => false,
            Err(place) => self.0.insert(place, BusServo::new(id)).is_ok(),
        }
    }

    pub fn get_mut(&mut self, id: Id) -> Option<&mut BusServo> {
        let place = self.place(id).ok()?;
        self.0.get_mut(place)
    }

    pub fn iter(&self) -> impl Iterator<Item = &BusServo> {
        self.0.iter()
    }

    pub fn iter_mut(&mut self) -> impl Iterator<Item = &mut BusServo> {
        self.0.iter_mut()
    }

    /// Those behind an ID; `None` is before all. New ones do not disturb such a walk.
    pub fn behind(&self, id: Option<Id>) -> impl Iterator<Item = &BusServo> {
        let place = id.map_or(0, |id| self.place(id).map_or_else(|place| place, |place| place + 1));
        self.0.iter().skip(place)
    }

    /// How many the PC has agreed on.
    pub fn agreed(&self) -> usize {
        self.iter().filter(|servo| servo.is_agreed()).count()
    }

    /// Those that the last hello has listed.
    pub fn told(&self) -> impl Iterator<Item = &BusServo> {
        self.iter().filter(|servo| servo.standing != Standing::Found)
    }

    /// Writes a hello that lists all servos; from now on the PC has been told of them.
    pub fn hello<'b>(&mut self, out: &'b mut [u8]) -> Result<&'b mut [u8], EncodeError> {
        let mut ids = heapless::Vec::<u8, MAX_SERVOS>::new();
        for servo in &mut self.0 {
            if servo.standing == Standing::Found {
                servo.standing = Standing::Told;
            }
            ids.push(servo.id.number()).map_err(|_| EncodeError::TooLong)?;
        }
        Hello { ids: &ids }.encode(out)
    }

    /// Writes a report of those that the PC has agreed on.
    pub fn report<'b>(&self, out: &'b mut [u8]) -> Result<&'b mut [u8], EncodeError> {
        let agreed = self.iter().filter(|servo| servo.is_agreed());
        Report::encode(agreed.map(|servo| servo.feedback), out)
    }

    fn place(&self, id: Id) -> Result<usize, usize> {
        self.0.binary_search_by_key(&id, |servo| servo.id)
    }
}
