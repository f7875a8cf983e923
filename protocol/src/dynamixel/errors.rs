//! What a servo says is wrong with it or with the instruction: the CODE of its answer.

/// The error bits of an answer (manual 3-3).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Errors(u8);

impl Errors {
    /// Nothing is wrong.
    pub const NONE: Self = Self(0);
    /// The supply is out of the limits in registers 12 and 13.
    pub const VOLTAGE: Self = Self(1 << 0);
    /// The goal is out of the angle limits.
    pub const ANGLE: Self = Self(1 << 1);
    /// Hotter than register 11 allows.
    pub const OVERHEAT: Self = Self(1 << 2);
    /// An instruction's parameter is out of its range.
    pub const RANGE: Self = Self(1 << 3);
    /// The instruction's checksum was wrong.
    pub const CHECKSUM: Self = Self(1 << 4);
    /// The load cannot be held with the torque limit.
    pub const OVERLOAD: Self = Self(1 << 5);
    /// An unknown instruction, or ACTION without a REG_WRITE.
    pub const INSTRUCTION: Self = Self(1 << 6);

    const NAMES: [(Self, &str); 7] = [
        (Self::VOLTAGE, "voltage"),
        (Self::ANGLE, "angle"),
        (Self::OVERHEAT, "overheat"),
        (Self::RANGE, "range"),
        (Self::CHECKSUM, "checksum"),
        (Self::OVERLOAD, "overload"),
        (Self::INSTRUCTION, "instruction"),
    ];

    /// As on the wire; bit 7 has no meaning and is kept.
    pub const fn from_bits(bits: u8) -> Self {
        Self(bits)
    }

    /// As on the wire.
    pub const fn bits(self) -> u8 {
        self.0
    }

    /// Whether all of `errors` are set.
    pub const fn contains(self, errors: Self) -> bool {
        self.0 & errors.0 == errors.0
    }
}

impl core::ops::BitOr for Errors {
    type Output = Self;

    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

impl core::ops::BitOrAssign for Errors {
    fn bitor_assign(&mut self, other: Self) {
        *self = *self | other;
    }
}

impl core::fmt::Display for Errors {
    /// The names of the set bits, or "none".
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let mut set = Self::NAMES.iter().filter(|(error, _)| self.contains(*error));
        f.write_str(set.next().map_or("none", |(_, name)| name))?;
        set.try_for_each(|(_, name)| write!(f, ", {name}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn error_bits_have_the_places_and_the_names_of_the_manual() {
        assert_eq!((Errors::VOLTAGE.bits(), Errors::INSTRUCTION.bits()), (0x01, 0x40));
        let errors = Errors::from_bits(0x24);
        assert!(errors.contains(Errors::OVERHEAT) && errors.contains(Errors::OVERLOAD));
        assert!(!errors.contains(Errors::OVERHEAT | Errors::RANGE));
        assert_eq!(errors.to_string(), "overheat, overload");
        assert_eq!(Errors::NONE.to_string(), "none");
    }
}
