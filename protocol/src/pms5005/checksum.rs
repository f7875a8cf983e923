//! The checksum of Figure II.1 over RID..DATA: CRC-8/MAXIM, that is the polynomial
//! x^8 + x^5 + x^4 + 1, reflected (0x8C), initial value 0.
//!
//! A byte takes a look-up in a table of 256, and none can begin before the one before it is done.
//! On a long frame most of them are saved: the polynomial divides x^127 + 1, so x^128 leaves the
//! same remainder as x, and a block of 16 bytes in front of another counts like one that stands in
//! the same place and is multiplied by x, which is a shift by one bit. So all blocks add up to one,
//! and only that is looked up.

use crc::{CRC_8_MAXIM_DOW, Crc, Table};

/// Four bytes.
type Word = [u8; 4];
/// 16 bytes, the first the lowest.
type Block = [u32; 4];

/// The checksum of every single byte.
static TABLE: [u8; 256] = {
    let [table] = *Crc::<u8, Table<1>>::new(&CRC_8_MAXIM_DOW).table();
    table
};

/// The checksum of these bytes.
pub fn checksum(bytes: &[u8]) -> u8 {
    let (words, bytes) = bytes.as_chunks();
    match words.split_first_chunk() {
        Some((first, words)) => of_blocks(first, words, bytes),
        None => look_up(0, words, bytes),
    }
}

/// The checksum of a block, the words behind it, which may be more blocks, and the bytes behind
/// those. Apart, so that short frames need not save its registers.
#[inline(never)]
fn of_blocks(first: &[Word; 4], mut words: &[Word], bytes: &[u8]) -> u8 {
    let mut sum = first.map(u32::from_le_bytes);
    while let Some((block, behind)) = words.split_first_chunk() {
        sum = add(times_x(sum), block.map(u32::from_le_bytes));
        words = behind;
    }
    look_up(sum.into_iter().fold(0, with_word), words, bytes)
}

/// What a checksum becomes when these words and bytes follow.
fn look_up(checksum: u8, words: &[Word], bytes: &[u8]) -> u8 {
    let words = words.iter().map(|word| u32::from_le_bytes(*word));
    let checksum = words.fold(checksum, with_word);
    bytes.iter().fold(checksum, |checksum, byte| with_byte(checksum, *byte))
}

fn add([a, b, c, d]: Block, [e, f, g, h]: Block) -> Block {
    [a ^ e, b ^ f, c ^ g, d ^ h]
}

/// A block times x, modulo x^127 + 1. Bits are reflected, as in the checksum: the first bit of all
/// is the coefficient of x^127, so it becomes that of x^1, which is the last but one.
fn times_x([a, b, c, d]: Block) -> Block {
    [a >> 1 | b << 31, b >> 1 | c << 31, c >> 1 | d << 31, d >> 1 ^ (a & 1) << 30]
}

/// What a checksum becomes when these four bytes follow, the lowest first.
fn with_word(checksum: u8, word: u32) -> u8 {
    let [a, b, c, d] = word.to_le_bytes();
    with_byte(with_byte(with_byte(with_byte(checksum, a), b), c), d)
}

/// What a checksum becomes when this byte follows.
fn with_byte(checksum: u8, byte: u8) -> u8 {
    // There is an entry for every byte.
    TABLE.get(usize::from(checksum ^ byte)).copied().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The C code of Figure II.1, transcribed.
    fn figure_ii_1(bytes: &[u8]) -> u8 {
        bytes.iter().fold(0, |register, &byte| {
            (0..8).fold(register, |register, bit| {
                let feedback = (register ^ (byte >> bit)) & 1;
                (register >> 1) ^ (feedback * 0x8C)
            })
        })
    }

    #[test]
    fn the_checksum_is_that_of_figure_ii_1() {
        let bytes: Vec<u8> = (0..=255).collect();
        for start in 0..256 {
            assert_eq!(checksum(&bytes[start..]), figure_ii_1(&bytes[start..]));
        }
    }

    #[test]
    fn every_bit_counts_as_in_the_crate_wherever_it_stands() {
        // A checksum of initial value 0 is linear: if these are right, all are.
        let crc = Crc::<u8, Table<1>>::new(&CRC_8_MAXIM_DOW);
        for length in (0..=80).chain([259]) {
            for bit in 0..8 * length {
                let mut bytes = vec![0; length];
                bytes[bit / 8] = 1 << (bit % 8);
                assert_eq!(checksum(&bytes), crc.checksum(&bytes), "bit {bit} of {length} bytes");
            }
        }
    }
}
