//! Where a trial's choices come from: bytes, which a fuzzer makes and mends, or a small generator.

/// A source of choices.
pub struct Choices<'a>(Source<'a>);

enum Source<'a> {
    /// Until they are used up; then every choice is 0.
    Bytes(&'a [u8]),
    /// A generator's state: the sequence is the same for ever, and never ends.
    Generator(u64),
}

impl<'a> Choices<'a> {
    /// The choices that these bytes make.
    pub fn of(bytes: &'a [u8]) -> Self {
        Self(Source::Bytes(bytes))
    }

    /// A generator's choices.
    pub fn seeded(seed: u64) -> Self {
        Self(Source::Generator(seed))
    }

    /// Whether the bytes are used up. A generator's choices never are.
    pub fn are_over(&self) -> bool {
        matches!(self.0, Source::Bytes([]))
    }

    /// Whether a fuzzer makes them, and so may choose rare things as often as any.
    pub fn are_a_fuzzers(&self) -> bool {
        matches!(self.0, Source::Bytes(_))
    }

    fn next(&mut self, bytes: usize) -> u32 {
        match &mut self.0 {
            Source::Bytes(rest) => {
                let taken = rest.split_off(..bytes.min(rest.len())).unwrap_or_default();
                taken.iter().rev().fold(0, |word, byte| word << 8 | u32::from(*byte))
            }
            Source::Generator(state) => {
                *state = state
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1_442_695_040_888_963_407);
                (*state >> 32) as u32
            }
        }
    }

    /// 0 to `bound` - 1. A fuzzer spends as few bytes on it as it needs.
    pub fn below(&mut self, bound: u32) -> u32 {
        let bytes = match bound {
            ..=0x100 => 1,
            0x101..=0x1_0000 => 2,
            _ => 4,
        };
        self.next(bytes) % bound
    }

    /// Any byte.
    pub fn byte(&mut self) -> u8 {
        self.below(0x100) as u8
    }

    /// Any word.
    pub fn word(&mut self) -> u16 {
        self.below(0x1_0000) as u16
    }

    /// Any whole number.
    pub fn long(&mut self) -> i32 {
        self.next(4).cast_signed()
    }

    /// Once in `n` times.
    pub fn one_in(&mut self, n: u32) -> bool {
        self.below(n) == n - 1
    }

    /// One of them.
    pub fn among<T: Copy>(&mut self, all: &[T]) -> T {
        all[self.below(all.len() as u32) as usize]
    }

    /// One of them. A generator takes each as often as the weight beside it says, a fuzzer any as it
    /// likes.
    pub fn weighed<T: Copy>(&mut self, all: &[(u32, T)]) -> T {
        if self.are_a_fuzzers() {
            return self.among(all).1;
        }
        let mut at = self.below(all.iter().map(|(weight, _)| weight).sum());
        for (weight, one) in all {
            match at.checked_sub(*weight) {
                Some(beyond) => at = beyond,
                None => return *one,
            }
        }
        unreachable!("{at} is below their sum")
    }

    /// Up to `most` bytes, which are used up with it.
    pub fn bytes(&mut self, most: usize) -> Vec<u8> {
        let count = self.below(most as u32 + 1) as usize;
        match &mut self.0 {
            Source::Bytes(rest) => {
                rest.split_off(..count.min(rest.len())).unwrap_or_default().to_vec()
            }
            Source::Generator(_) => (0..count).map(|_| self.byte()).collect(),
        }
    }

    /// Up to `most` bytes of all that are left.
    pub fn rest(&mut self, most: usize) -> Vec<u8> {
        match &mut self.0 {
            Source::Bytes(rest) => std::mem::take(rest).iter().take(most).copied().collect(),
            Source::Generator(_) => self.bytes(most),
        }
    }
}
