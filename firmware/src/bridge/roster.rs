//! The servos that were found, in the order of their IDs.

use protocol::cm5::MAX_SERVOS;
use protocol::dynamixel::Id;

use super::servo::{Servo, Standing};

/// Up to [`MAX_SERVOS`] servos; no one ever leaves.
pub struct Roster(heapless::Vec<Servo, MAX_SERVOS>);

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
            Err(place) => self.0.insert(place, Servo::new(id)).is_ok(),
        }
    }

    pub fn get_mut(&mut self, id: Id) -> Option<&mut Servo> {
        let place = self.place(id).ok()?;
        self.0.get_mut(place)
    }

    pub fn iter(&self) -> impl Iterator<Item = &Servo> {
        self.0.iter()
    }

    pub fn iter_mut(&mut self) -> impl Iterator<Item = &mut Servo> {
        self.0.iter_mut()
    }

    /// Those behind an ID; `None` is before all. New ones do not disturb such a walk.
    pub fn behind(&self, id: Option<Id>) -> impl Iterator<Item = &Servo> {
        self.iter().filter(move |servo| id.is_none_or(|id| servo.id > id))
    }

    /// How many the PC has agreed on.
    pub fn agreed(&self) -> usize {
        self.iter().filter(|servo| servo.is_agreed()).count()
    }

    /// Those that the last hello has listed.
    pub fn told(&self) -> impl Iterator<Item = &Servo> {
        self.iter().filter(|servo| servo.standing != Standing::Found)
    }

    fn place(&self, id: Id) -> Result<usize, usize> {
        self.0.binary_search_by_key(&id, |servo| servo.id)
    }
}
