//! An AX-12 servo: its registers with their rules, and what they do to its shaft. It is an AX-12A as
//! the maker's current e-manual has it (`protocol/src/dynamixel/register.rs` tells where the manual of
//! 2006 differs):
//! - an error bit of register 18 (36: heat, overload) sets the torque limit to 0. The motor is driven
//!   again when the error is gone and a master writes another torque limit;
//! - an overload is over when the motor is driven and does not stall, so a motor that it has switched
//!   off keeps the bit until it is driven again;
//! - a goal that is written out of the limits is an angle error until one within them is written.
//!   Limits that move past an old goal are none.
//!
//! Vocabulary: a *refusal* is the error bits that a real servo answers to an instruction which it
//! does not carry out; nothing of such an instruction is done. *EEPROM bytes* are how many bytes a
//! write put into EEPROM: the servo is busy for some time with each.
//!
//! Not simulated: the baud rate register (it is kept, but the bus has one rate), punch, the
//! calibration, an alarm's blinking, and that torque locks the EEPROM.

mod shaft;

use core::ops::RangeInclusive;

use protocol::dynamixel::{Access, Errors, REGISTER_BYTES, Register};

pub use shaft::Surroundings;
use shaft::{Drive, Shaft};

/// What the firmware register reads.
const FIRMWARE_VERSION: u16 = 24;

/// A REG_WRITE that waits for ACTION.
#[derive(Clone, Copy, Debug)]
struct Registered {
    address: u8,
    data: [u8; REGISTER_BYTES],
    len: usize,
}

/// One servo.
#[derive(Clone, Debug)]
pub struct Ax12 {
    registers: [u8; REGISTER_BYTES],
    registered: Option<Registered>,
    /// The last goal that was written was out of the limits.
    goal_is_beyond: bool,
    shaft: Shaft,
    /// The world around it.
    pub surroundings: Surroundings,
    /// Milliseconds simulated.
    now_ms: u64,
}

impl Ax12 {
    /// A servo as from the factory, but with this ID (0 to 253), switched on in its middle.
    pub fn new(id: u8) -> Self {
        let mut servo = Self {
            registers: [0; REGISTER_BYTES],
            registered: None,
            goal_is_beyond: false,
            shaft: Shaft::default(),
            surroundings: Surroundings::default(),
            now_ms: 0,
        };
        servo.set_defaults(Access::ReadOnly);
        servo.set(Register::FIRMWARE_VERSION, FIRMWARE_VERSION);
        servo.reset();
        servo.set(Register::ID, id.into());
        servo
    }

    /// Power has come back: RAM has its defaults, the goal is where the shaft is.
    pub fn power_on(&mut self) {
        self.registered = None;
        self.set(Register::REGISTERED, 0);
        self.goal_is_beyond = false;
        self.shaft.stop();
        self.set_defaults(Access::Ram);
        self.set(Register::GOAL_POSITION, self.shaft.reading());
        self.set(Register::TORQUE_LIMIT, self.get(Register::MAX_TORQUE));
        self.show();
    }

    /// What a register holds.
    pub fn get(&self, register: Register) -> u16 {
        let at = usize::from(register.address);
        match register.size {
            1 => self.registers[at].into(),
            _ => u16::from_le_bytes([self.registers[at], self.registers[at + 1]]),
        }
    }

    /// Puts a value into a register, as no master could: no rule is asked.
    pub fn set(&mut self, register: Register, value: u16) {
        let at = usize::from(register.address);
        let size = usize::from(register.size);
        self.registers[at..at + size].copy_from_slice(&value.to_le_bytes()[..size]);
    }

    /// The number it answers to.
    pub fn id(&self) -> u8 {
        self.registers[usize::from(Register::ID.address)]
    }

    /// Where its shaft is, in positions of 300/1023 degrees, 0 at the clockwise end.
    pub fn position(&self) -> f32 {
        self.shaft.position()
    }

    /// How fast its shaft turns, in 0.111 rpm; clockwise is negative.
    pub fn speed(&self) -> f32 {
        self.shaft.signed_speed()
    }

    /// Whether its motor is driven: torque is enabled, and no shutdown has taken its limit.
    pub fn is_driven(&self) -> bool {
        self.torque_limit() > 0
    }

    /// `count` bytes from `address` on.
    ///
    /// # Errors
    /// RANGE when there are not so many, or none is asked for.
    pub fn read(&self, address: u8, count: u8) -> Result<&[u8], Errors> {
        let (from, count) = (usize::from(address), usize::from(count));
        self.registers
            .get(from..from + count)
            .filter(|bytes| !bytes.is_empty())
            .ok_or(Errors::RANGE)
    }

    /// Writes registers, all or none of them, and answers the EEPROM bytes.
    ///
    /// # Errors
    /// RANGE for values out of range, registers that the servo alone writes, reserved bytes, half
    /// of a word, and for what is locked.
    pub fn write(&mut self, address: u8, data: &[u8]) -> Result<usize, Errors> {
        let eeprom_bytes = self.check(address, data)?;
        let from = usize::from(address);
        self.registers[from..from + data.len()].copy_from_slice(data);
        let goal = usize::from(Register::GOAL_POSITION.address);
        if (from..from + data.len()).contains(&goal) {
            self.goal_is_beyond = !self.limits().contains(&self.get(Register::GOAL_POSITION));
        }
        Ok(eeprom_bytes)
    }

    /// Keeps a write until [`action`](Self::action), in place of one that is kept already.
    ///
    /// # Errors
    /// As [`write`](Self::write).
    pub fn register_write(&mut self, address: u8, data: &[u8]) -> Result<(), Errors> {
        self.check(address, data)?;
        let mut registered = Registered { address, data: [0; REGISTER_BYTES], len: data.len() };
        registered.data[..data.len()].copy_from_slice(data);
        self.registered = Some(registered);
        self.set(Register::REGISTERED, 1);
        Ok(())
    }

    /// Does the write that was kept, and answers the EEPROM bytes.
    ///
    /// # Errors
    /// INSTRUCTION when there is none; as [`write`](Self::write) when it has been locked since.
    pub fn action(&mut self) -> Result<usize, Errors> {
        let Registered { address, data, len } =
            self.registered.take().ok_or(Errors::INSTRUCTION)?;
        self.set(Register::REGISTERED, 0);
        self.write(address, &data[..len])
    }

    /// Everything back to how it left the factory, the ID too. Answers the EEPROM bytes.
    pub fn reset(&mut self) -> usize {
        let bytes = self.set_defaults(Access::Eeprom);
        self.power_on();
        bytes
    }

    /// What is wrong at this moment.
    pub fn errors(&self) -> Errors {
        let mut errors = Errors::NONE;
        let mut when = |wrong, error| {
            if wrong {
                errors |= error;
            }
        };
        let voltage =
            self.get(Register::LOW_VOLTAGE_LIMIT)..=self.get(Register::HIGH_VOLTAGE_LIMIT);
        when(!voltage.contains(&u16::from(self.surroundings.supply_dv)), Errors::VOLTAGE);
        when(self.goal_is_beyond && !self.turns_endlessly(), Errors::ANGLE);
        let limit = self.get(Register::TEMPERATURE_LIMIT);
        when(u16::from(self.surroundings.temperature_c) > limit, Errors::OVERHEAT);
        when(self.shaft.is_overloaded(), Errors::OVERLOAD);
        errors
    }

    /// Lets time pass until `ms` milliseconds after the beginning.
    pub fn advance_to(&mut self, ms: u64) {
        while self.now_ms < ms {
            self.now_ms += 1;
            let drive = self.drive();
            self.shaft.step(&drive, &self.surroundings);
            let alarm = self.errors().bits() & self.get(Register::ALARM_SHUTDOWN) as u8;
            if alarm != 0 {
                self.set(Register::TORQUE_LIMIT, 0);
            }
            self.show();
        }
    }

    /// Whether these bytes may be written there, and how many of them are EEPROM's.
    fn check(&self, address: u8, data: &[u8]) -> Result<usize, Errors> {
        let (mut at, mut rest, mut eeprom_bytes) = (address, data, 0);
        while !rest.is_empty() {
            let register = Register::at(at).ok_or(Errors::RANGE)?;
            let size = usize::from(register.size);
            let (bytes, behind) = rest.split_at_checked(size).ok_or(Errors::RANGE)?;
            let value = bytes.iter().rev().fold(0, |value, &byte| value << 8 | u16::from(byte));
            let locked = self.get(Register::LOCK) == 1 && !(24..=35).contains(&at);
            if locked || !register.accepts(value) {
                return Err(Errors::RANGE);
            }
            if register.access == Access::Eeprom {
                eeprom_bytes += size;
            }
            at += register.size;
            rest = behind;
        }
        Ok(eeprom_bytes)
    }

    /// Sets all registers of a kind to their defaults, and answers how many bytes that was.
    fn set_defaults(&mut self, access: Access) -> usize {
        let registers = Register::ALL.iter().filter(|register| register.access == access);
        registers
            .map(|&register| {
                self.set(register, register.default);
                usize::from(register.size)
            })
            .sum()
    }

    fn turns_endlessly(&self) -> bool {
        self.get(Register::CW_LIMIT) == 0 && self.get(Register::CCW_LIMIT) == 0
    }

    fn limits(&self) -> RangeInclusive<u16> {
        self.get(Register::CW_LIMIT)..=self.get(Register::CCW_LIMIT)
    }

    /// What the motor may push with.
    fn torque_limit(&self) -> u16 {
        match self.get(Register::TORQUE_ENABLE) {
            0 => 0,
            _ => self.get(Register::TORQUE_LIMIT),
        }
    }

    fn drive(&self) -> Drive {
        let torque_limit = self.torque_limit();
        let goal = self.get(Register::GOAL_POSITION);
        let limits = self.limits();
        let goal = goal.max(*limits.start()).min(*limits.end());
        let pair = |cw, ccw| [self.get(cw), self.get(ccw)];
        Drive {
            goal: (!self.turns_endlessly()).then_some(goal.into()),
            speed: self.get(Register::MOVING_SPEED),
            torque_limit: torque_limit.into(),
            margins: pair(Register::CW_MARGIN, Register::CCW_MARGIN).map(f32::from),
            slopes: pair(Register::CW_SLOPE, Register::CCW_SLOPE).map(slope_in_force),
        }
    }

    /// Puts into the registers what a master reads of the world.
    fn show(&mut self) {
        self.set(Register::PRESENT_POSITION, self.shaft.reading());
        self.set(Register::PRESENT_SPEED, self.shaft.speed());
        self.set(Register::PRESENT_LOAD, self.shaft.load());
        self.set(Register::PRESENT_VOLTAGE, self.surroundings.supply_dv.into());
        self.set(Register::PRESENT_TEMPERATURE, self.surroundings.temperature_c.into());
        self.set(Register::MOVING, self.shaft.is_moving().into());
    }
}

/// What a compliance slope counts as: the power of two at its step's beginning, 2 at the least.
fn slope_in_force(slope: u16) -> f32 {
    (1u16 << slope.max(2).ilog2()).into()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn write(servo: &mut Ax12, register: Register, value: u16) -> Result<usize, Errors> {
        servo.write(register.address, &value.to_le_bytes()[..usize::from(register.size)])
    }

    /// A servo whose motor is driven.
    fn driven() -> Ax12 {
        let mut servo = Ax12::new(1);
        write(&mut servo, Register::TORQUE_ENABLE, 1).unwrap();
        servo
    }

    #[test]
    fn every_register_takes_exactly_its_range_and_a_refusal_changes_nothing() {
        let (mut taken, mut refused) = (0, 0);
        for &register in Register::ALL {
            let is_read_only = register.access == Access::ReadOnly;
            let takes = |value| !is_read_only && (register.min..=register.max).contains(&value);
            let values = [register.min, register.max, register.default];
            for value in values.into_iter().chain([register.min.wrapping_sub(1), register.max + 1])
            {
                let mut servo = Ax12::new(7);
                let before = servo.registers;
                // A byte holds no more than 255.
                let value = if register.size == 1 { value & 0xFF } else { value };
                match write(&mut servo, register, value) {
                    Ok(eeprom_bytes) => {
                        taken += 1;
                        assert!(takes(value), "{register:?} took {value}");
                        assert_eq!(servo.get(register), value);
                        let is_eeprom = register.access == Access::Eeprom;
                        let expected = if is_eeprom { register.size.into() } else { 0 };
                        assert_eq!(eeprom_bytes, expected);
                    }
                    Err(errors) => {
                        refused += 1;
                        assert!(!takes(value), "{register:?} refused {value}");
                        assert_eq!((errors, servo.registers), (Errors::RANGE, before));
                    }
                }
            }
        }
        assert!(taken > 50 && refused > 50, "{taken} taken, {refused} refused");
    }

    #[test]
    fn a_write_is_done_as_a_whole_or_not_at_all() {
        let mut servo = Ax12::new(1);
        let before = servo.registers;
        // The last register out of range; half a word; across a reserved byte; past the end.
        let refused: [(u8, &[u8]); 6] = [
            (24, &[1, 1, 1, 1, 32, 32, 0, 2, 0, 1, 0, 4]),
            (30, &[1]),
            (31, &[1]),
            (9, &[0, 0]),
            (44, &[0, 0]),
            (48, &[0, 0, 0]),
        ];
        for (address, data) in refused {
            assert_eq!(servo.write(address, data), Err(Errors::RANGE), "{address} {data:?}");
            assert_eq!(servo.registers, before);
        }
        assert_eq!(servo.write(24, &[1, 1, 1, 1, 32, 32, 0, 2, 0, 1, 0, 3]), Ok(0));
        assert_eq!(servo.get(Register::GOAL_POSITION), 0x200);
        assert_eq!(servo.write(3, &[9, 1, 0, 0, 0, 255, 3]), Ok(7));
    }

    #[test]
    fn a_locked_servo_takes_24_to_35_until_power_comes_back() {
        let mut servo = Ax12::new(1);
        write(&mut servo, Register::LOCK, 1).unwrap();
        assert_eq!(write(&mut servo, Register::LOCK, 0), Err(Errors::RANGE));
        assert_eq!(write(&mut servo, Register::PUNCH, 0x40), Err(Errors::RANGE));
        assert_eq!(write(&mut servo, Register::ID, 2), Err(Errors::RANGE));
        assert_eq!(servo.write(24, &[1, 1, 0, 0, 32, 32, 0, 2, 0, 1, 0, 3]), Ok(0));
        servo.power_on();
        assert_eq!(write(&mut servo, Register::PUNCH, 0x40), Ok(0));
    }

    #[test]
    fn a_registered_write_waits_for_action_and_is_done_once() {
        let mut servo = Ax12::new(1);
        assert_eq!(servo.action(), Err(Errors::INSTRUCTION));
        assert_eq!(servo.register_write(30, &[0, 4]), Err(Errors::RANGE));
        assert_eq!(servo.get(Register::REGISTERED), 0);
        servo.register_write(30, &[0, 1]).unwrap();
        servo.register_write(30, &[0, 2]).unwrap();
        assert_eq!((servo.get(Register::REGISTERED), servo.get(Register::GOAL_POSITION)), (1, 512));
        servo.register_write(30, &[0x2C, 1]).unwrap();
        assert_eq!(servo.action(), Ok(0));
        assert_eq!((servo.get(Register::REGISTERED), servo.get(Register::GOAL_POSITION)), (0, 300));
        assert_eq!(servo.action(), Err(Errors::INSTRUCTION));
    }

    #[test]
    fn power_off_keeps_eeprom_and_the_place_of_the_shaft_and_nothing_else() {
        let mut servo = driven();
        write(&mut servo, Register::MAX_TORQUE, 800).unwrap();
        write(&mut servo, Register::GOAL_POSITION, 700).unwrap();
        servo.advance_to(2000);
        servo.power_on();
        assert_eq!(servo.get(Register::MAX_TORQUE), 800);
        assert_eq!(servo.get(Register::TORQUE_LIMIT), 800);
        assert_eq!(servo.get(Register::TORQUE_ENABLE), 0);
        assert_eq!(servo.get(Register::GOAL_POSITION), 699);
        assert_eq!(servo.get(Register::PRESENT_POSITION), 699);
    }

    #[test]
    fn it_goes_to_its_goal_at_its_moving_speed_and_stops_there() {
        // 100 units of 0.111 rpm are 66.6 degrees a second: 227.1 positions.
        let mut servo = driven();
        write(&mut servo, Register::MOVING_SPEED, 100).unwrap();
        write(&mut servo, Register::GOAL_POSITION, 512 + 227).unwrap();
        servo.advance_to(500);
        let half_way = servo.position() - 512.0;
        assert!((112.0..=115.0).contains(&half_way), "{half_way}");
        assert_eq!(servo.get(Register::MOVING), 1);
        assert_eq!(servo.get(Register::PRESENT_SPEED), 100);
        assert!((1..1023).contains(&servo.get(Register::PRESENT_LOAD)), "counter-clockwise");
        servo.advance_to(990);
        assert!((733..739).contains(&servo.get(Register::PRESENT_POSITION)));
        servo.advance_to(1010);
        // Within the margin of 1 the motor is left alone.
        assert_eq!(servo.get(Register::PRESENT_POSITION), 738);
        assert_eq!((servo.get(Register::MOVING), servo.get(Register::PRESENT_SPEED)), (0, 0));
        // And back: clockwise is bit 10.
        write(&mut servo, Register::GOAL_POSITION, 512).unwrap();
        servo.advance_to(1100);
        assert_eq!(servo.get(Register::PRESENT_SPEED), 1024 + 100);
        assert_eq!(servo.speed().round(), -100.0);
        assert!((1025..2048).contains(&servo.get(Register::PRESENT_LOAD)), "clockwise");
        // Without a torque it stays.
        write(&mut servo, Register::TORQUE_ENABLE, 0).unwrap();
        let rests = servo.position();
        servo.advance_to(2000);
        assert_eq!(servo.position(), rests);
    }

    #[test]
    fn a_goal_beyond_the_limits_is_an_angle_error_and_the_limit_is_where_it_stops() {
        let mut servo = driven();
        write(&mut servo, Register::CCW_LIMIT, 600).unwrap();
        write(&mut servo, Register::GOAL_POSITION, 600).unwrap();
        assert_eq!(servo.errors(), Errors::NONE);
        write(&mut servo, Register::GOAL_POSITION, 601).unwrap();
        servo.advance_to(2000);
        assert_eq!((servo.errors(), servo.get(Register::PRESENT_POSITION)), (Errors::ANGLE, 599));
        write(&mut servo, Register::GOAL_POSITION, 599).unwrap();
        assert_eq!(servo.errors(), Errors::NONE);
        // Without limits it is none, and power off forgets it.
        write(&mut servo, Register::GOAL_POSITION, 601).unwrap();
        servo.write(6, &[0, 0, 0, 0]).unwrap();
        assert_eq!(servo.errors(), Errors::NONE);
        servo.write(6, &[0, 0, 0x58, 2]).unwrap();
        assert_eq!(servo.errors(), Errors::ANGLE);
        servo.power_on();
        assert_eq!(servo.errors(), Errors::NONE);
    }

    #[test]
    fn limits_that_move_past_an_old_goal_are_no_angle_error() {
        let mut servo = driven();
        write(&mut servo, Register::GOAL_POSITION, 700).unwrap();
        write(&mut servo, Register::CCW_LIMIT, 600).unwrap();
        servo.advance_to(100);
        assert_eq!(servo.errors(), Errors::NONE);
        // Nor are they the end of one.
        write(&mut servo, Register::GOAL_POSITION, 700).unwrap();
        write(&mut servo, Register::CCW_LIMIT, 1023).unwrap();
        assert_eq!(servo.errors(), Errors::ANGLE);
        // A write that has the goal among others counts too.
        servo.write(24, &[1, 0, 1, 1, 32, 32, 0xBC, 2, 0, 0, 0xFF, 3]).unwrap();
        assert_eq!(servo.errors(), Errors::NONE);
    }

    #[test]
    fn as_from_the_factory_it_is_the_e_manuals_ax_12a() {
        let servo = Ax12::new(1);
        let values = [
            Register::TEMPERATURE_LIMIT,
            Register::HIGH_VOLTAGE_LIMIT,
            Register::ALARM_LED,
            Register::ALARM_SHUTDOWN,
            Register::CW_MARGIN,
            Register::CCW_MARGIN,
        ];
        assert_eq!(values.map(|register| servo.get(register)), [70, 140, 36, 36, 1, 1]);
        let steps = [0, 3, 4, 7, 8, 15, 16, 25, 31, 32, 63, 64, 127, 128, 254].map(slope_in_force);
        assert_eq!(steps, [2., 2., 4., 4., 8., 8., 16., 16., 16., 32., 32., 64., 64., 128., 128.]);
    }

    #[test]
    fn a_jammed_servo_pushes_with_its_torque_limit_and_reports_overload_until_freed() {
        let mut servo = driven();
        write(&mut servo, Register::ALARM_SHUTDOWN, 0).unwrap();
        servo.surroundings.jammed = true;
        write(&mut servo, Register::TORQUE_LIMIT, 500).unwrap();
        write(&mut servo, Register::GOAL_POSITION, 200).unwrap();
        servo.advance_to(400);
        assert_eq!(servo.get(Register::PRESENT_LOAD), 1024 + 500);
        assert_eq!((servo.errors(), servo.get(Register::PRESENT_POSITION)), (Errors::NONE, 512));
        servo.advance_to(600);
        assert_eq!(servo.errors(), Errors::OVERLOAD);
        servo.surroundings.jammed = false;
        servo.advance_to(3000);
        assert_eq!((servo.errors(), servo.get(Register::PRESENT_POSITION)), (Errors::NONE, 201));
    }

    #[test]
    fn an_overload_shuts_it_down_until_it_is_freed_and_given_a_torque_limit() {
        let mut servo = driven();
        servo.surroundings.jammed = true;
        write(&mut servo, Register::GOAL_POSITION, 800).unwrap();
        servo.advance_to(490);
        assert!(servo.is_driven() && servo.errors() == Errors::NONE);
        let is_shut_down = |servo: &Ax12| {
            assert_eq!((servo.errors(), servo.is_driven()), (Errors::OVERLOAD, false));
            assert_eq!(
                (servo.get(Register::TORQUE_LIMIT), servo.get(Register::PRESENT_LOAD)),
                (0, 0)
            );
            assert_eq!(servo.get(Register::TORQUE_ENABLE), 1, "the e-manual has the limit alone");
        };
        servo.advance_to(4000);
        is_shut_down(&servo);
        // Who insists while it is jammed gets no more than a push.
        write(&mut servo, Register::TORQUE_LIMIT, 1023).unwrap();
        servo.advance_to(4002);
        is_shut_down(&servo);
        servo.surroundings.jammed = false;
        servo.advance_to(5000);
        is_shut_down(&servo);
        write(&mut servo, Register::TORQUE_LIMIT, 1023).unwrap();
        servo.advance_to(7000);
        assert_eq!((servo.errors(), servo.get(Register::PRESENT_POSITION)), (Errors::NONE, 799));
    }

    #[test]
    fn a_load_that_is_too_much_is_an_overload_and_backing_off_ends_it() {
        let mut servo = driven();
        write(&mut servo, Register::TORQUE_LIMIT, 300).unwrap();
        servo.surroundings.load = -400;
        write(&mut servo, Register::GOAL_POSITION, 800).unwrap();
        servo.advance_to(600);
        assert_eq!((servo.errors(), servo.is_driven()), (Errors::OVERLOAD, false));
        // The other way the load helps against friction, and 500 hold it: to 300.
        servo.write(30, &[0x2C, 1, 0, 0, 0xF4, 1]).unwrap();
        servo.advance_to(2000);
        assert_eq!((servo.errors(), servo.get(Register::PRESENT_POSITION)), (Errors::NONE, 301));
    }

    #[test]
    fn heat_and_voltage_out_of_their_limits_are_errors() {
        let mut servo = driven();
        servo.surroundings.supply_dv = 141;
        servo.advance_to(1);
        assert_eq!((servo.errors(), servo.is_driven()), (Errors::VOLTAGE, true));
        servo.surroundings.temperature_c = 71;
        servo.surroundings.supply_dv = 59;
        servo.advance_to(2);
        assert_eq!(servo.errors(), Errors::OVERHEAT | Errors::VOLTAGE);
        assert_eq!(servo.read(42, 2), Ok(&[59, 71][..]));
        // The factory's shutdown is for heat, not for voltage.
        assert!(!servo.is_driven());
        servo.surroundings = Surroundings::default();
        servo.advance_to(3);
        assert_eq!(servo.errors(), Errors::NONE);
    }

    #[test]
    fn without_limits_it_turns_endlessly_either_way() {
        let mut servo = driven();
        servo.write(6, &[0, 0, 0, 0]).unwrap();
        assert_eq!(servo.errors(), Errors::NONE);
        for (speed, counter_clockwise) in [(300, true), (1024 + 300, false)] {
            write(&mut servo, Register::MOVING_SPEED, speed).unwrap();
            let mut turns = 0;
            let (start, mut last) = (servo.now_ms, servo.position());
            for ms in 1..=6000 {
                servo.advance_to(start + ms);
                let wrapped = servo.position() < last;
                turns += u32::from(
                    wrapped == counter_clockwise && (servo.position() - last).abs() > 600.0,
                );
                last = servo.position();
            }
            // 33.3 rpm for 6 s.
            assert!((3..=4).contains(&turns), "{turns} turns at {speed}");
            assert_eq!(servo.get(Register::PRESENT_SPEED), speed);
        }
        write(&mut servo, Register::MOVING_SPEED, 0).unwrap();
        servo.advance_to(servo.now_ms + 1);
        assert_eq!(servo.get(Register::MOVING), 0);
    }
}
