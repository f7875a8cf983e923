//! The control table of the AX-12 and the values that it takes: defaults and ranges of the AX-12A in
//! the maker's current e-manual; ranges that it does not give are those of the manual of 2006 (3-4 and
//! its table "Control Table Data Range and Length for Writing"). Where they differ:
//!
//! | register | e-manual, here | manual of 2006 |
//! |---|---|---|
//! | temperature limit | 70, 0 to 100 | 85, 0 to 150 |
//! | highest voltage | 140 | 190 |
//! | alarm LED and shutdown | 36: heat, overload | 4: heat |
//! | compliance margins | 1 | 0 |
//! | compliance slopes | 0 to 254 | 1 to 254 |
//! | registered | the servo's alone | 0 to 1 |
//!
//! Three kinds: what only the servo writes; EEPROM, which outlives power-off and takes some 6 ms a
//! byte to write (facts); RAM, which begins with its default at power-on.
//!
//! Three ranges are not the manuals'. Moving speed goes to 2047, since bit 10 is the direction of an
//! endless turn (manual, "Goal Speed Setting"). Lock takes 0 as well as 1: who writes registers 47
//! to 49 at once must be able to leave it as it is. Punch takes 0 to 31, as in the manual of 2006.

/// Bytes of the control table: addresses 0 to 49.
pub const REGISTER_BYTES: usize = 50;

/// Who may write a register, and what power-off does to it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Access {
    /// The servo alone.
    ReadOnly,
    /// The master; it is kept.
    Eeprom,
    /// The master; it is lost.
    Ram,
}

/// A register.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Register {
    /// What it is called.
    pub name: &'static str,
    /// Its first byte's address.
    pub address: u8,
    /// 1 or 2 bytes, the low one first.
    pub size: u8,
    /// Who may write it.
    pub access: Access,
    /// As it leaves the factory; for RAM, at power-on.
    pub default: u16,
    /// The least value that may be written.
    pub min: u16,
    /// The greatest value that may be written.
    pub max: u16,
}

/// The table: doc comment, name, address, size, access, default, least, greatest.
macro_rules! registers {
    ($($(#[$doc:meta])* $name:ident $address:literal $size:literal $access:ident
        $default:literal $min:literal $max:literal;)*) => {
        impl Register {
            $($(#[$doc])* pub const $name: Self = Self {
                name: stringify!($name),
                address: $address,
                size: $size,
                access: Access::$access,
                default: $default,
                min: $min,
                max: $max,
            };)*

            /// All registers, by address. Bytes 10, 19 and 45 belong to none: they are reserved.
            pub const ALL: &'static [Self] = &[$(Self::$name),*];
        }
    };
}

registers! {
    /// 12 is an AX-12.
    MODEL_NUMBER 0 2 ReadOnly 12 0 0;
    /// Version of the servo's firmware; the manual has no default.
    FIRMWARE_VERSION 2 1 ReadOnly 24 0 0;
    /// Whom the servo takes itself for.
    ID 3 1 Eeprom 1 0 253;
    /// Baud rate: 2,000,000 / (value + 1).
    BAUD_RATE 4 1 Eeprom 1 0 254;
    /// Silence before an answer, in 2 us.
    RETURN_DELAY 5 1 Eeprom 250 0 254;
    /// Least goal position. With both limits 0 the servo turns endlessly.
    CW_LIMIT 6 2 Eeprom 0 0 1023;
    /// Greatest goal position.
    CCW_LIMIT 8 2 Eeprom 1023 0 1023;
    /// Highest temperature in degrees Celsius.
    TEMPERATURE_LIMIT 11 1 Eeprom 70 0 100;
    /// Lowest supply voltage in 0.1 V.
    LOW_VOLTAGE_LIMIT 12 1 Eeprom 60 50 250;
    /// Highest supply voltage in 0.1 V.
    HIGH_VOLTAGE_LIMIT 13 1 Eeprom 140 50 250;
    /// The torque limit after power-on, in 1/1023 of what the motor can do.
    MAX_TORQUE 14 2 Eeprom 1023 0 1023;
    /// What is answered: 0 only PING, 1 PING and READ, 2 everything.
    STATUS_RETURN_LEVEL 16 1 Eeprom 2 0 2;
    /// The error bits that make the LED blink.
    ALARM_LED 17 1 Eeprom 36 0 127;
    /// The error bits that switch the motor off, by a torque limit of 0.
    ALARM_SHUTDOWN 18 1 Eeprom 36 0 127;
    /// Calibration of the potentiometer; the manual has no default.
    DOWN_CALIBRATION 20 2 ReadOnly 0 0 0;
    /// Calibration of the potentiometer; the manual has no default.
    UP_CALIBRATION 22 2 ReadOnly 0 0 0;
    /// 1: the motor is driven.
    TORQUE_ENABLE 24 1 Ram 0 0 1;
    /// 1: the LED is on.
    LED 25 1 Ram 0 0 1;
    /// Error in which the motor is left alone, clockwise, in positions.
    CW_MARGIN 26 1 Ram 1 0 254;
    /// The same, counter-clockwise.
    CCW_MARGIN 27 1 Ram 1 0 254;
    /// Error beyond the margin at which the torque is full, clockwise, in positions; in seven steps,
    /// each a power of two: 0 to 3 are 2, 4 to 7 are 4, and so on up to 128.
    CW_SLOPE 28 1 Ram 32 0 254;
    /// The same, counter-clockwise.
    CCW_SLOPE 29 1 Ram 32 0 254;
    /// 0 to 1023 over 300 degrees. At power-on where the servo is.
    GOAL_POSITION 30 2 Ram 0 0 1023;
    /// In 0.111 rpm; 0 is as fast as it can. Bit 10: clockwise, if it turns endlessly.
    MOVING_SPEED 32 2 Ram 0 0 2047;
    /// In 1/1023. At power-on the maximum torque of register 14; 0 after a shutdown.
    TORQUE_LIMIT 34 2 Ram 1023 0 1023;
    /// 0 to 1023 over 300 degrees.
    PRESENT_POSITION 36 2 ReadOnly 0 0 0;
    /// In 0.111 rpm; bit 10: clockwise.
    PRESENT_SPEED 38 2 ReadOnly 0 0 0;
    /// In 1/1023; bit 10: clockwise.
    PRESENT_LOAD 40 2 ReadOnly 0 0 0;
    /// Supply in 0.1 V.
    PRESENT_VOLTAGE 42 1 ReadOnly 0 0 0;
    /// In degrees Celsius.
    PRESENT_TEMPERATURE 43 1 ReadOnly 0 0 0;
    /// 1: a REG_WRITE waits for ACTION.
    REGISTERED 44 1 ReadOnly 0 0 0;
    /// 1: on the way to the goal.
    MOVING 46 1 ReadOnly 0 0 0;
    /// 1: until power-off only registers 24 to 35 can be written.
    LOCK 47 1 Ram 0 0 1;
    /// Least drive of a moving motor, in 1/1023.
    PUNCH 48 2 Ram 32 0 1023;
}

impl Register {
    /// The register whose first byte has this address.
    pub fn at(address: u8) -> Option<Self> {
        Self::ALL.iter().copied().find(|register| register.address == address)
    }

    /// Whether a master may write this value: not if only the servo may.
    pub fn accepts(&self, value: u16) -> bool {
        self.access != Access::ReadOnly && (self.min..=self.max).contains(&value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn registers_follow_each_other_without_overlap_and_accept_their_defaults() {
        let mut reserved = vec![];
        let mut next = 0;
        for register in Register::ALL {
            assert!(matches!(register.size, 1 | 2) && register.address >= next, "{register:?}");
            reserved.extend(next..register.address);
            next = register.address + register.size;
            assert_eq!(Register::at(register.address), Some(*register));
            let writable = register.access != Access::ReadOnly;
            assert_eq!(register.accepts(register.default), writable, "{register:?}");
            assert!(!register.accepts(register.max + 1));
        }
        assert_eq!((reserved, usize::from(next)), (vec![10, 19, 45], REGISTER_BYTES));
        assert_eq!(Register::at(31), None);
    }
}
