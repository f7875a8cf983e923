//! A debug probe on the bench: it reads the log out of a core that runs (RTT), and halts it.
//!
//! | what it does | how here | source |
//! |---|---|---|
//! | attach | reads RAM over the core's back; the firmware is told nothing but the log's flags | SEGGER_RTT.h |
//! | the log | the first up-buffer of `_SEGGER_RTT`; frames of defmt, by the symbols of `.defmt` | defmt's book, rzcobs |
//! | halt | the core stands still, time and peripherals go on; what `DBGMCU_APB1_FZ` freezes stands still too (`part`) | RM0090 38.16 |
//!
//! | left out | reason |
//! |---|---|
//! | `DHCSR` and what else belongs to the core's debug port | rigless: a debugger stops its time, from outside; no image reads it |
//! | breakpoints, steps, a reset that keeps the core halted | nobody needs them: a reset lets go of it here |
//! | values in a frame of the log | only which line of the log it is |

use object::{Object, ObjectSection, ObjectSymbol};
use rigless::soc::Width;

use super::Bench;

/// Places in the control block, in bytes: behind the identifier and two counts, and in what follows, the
/// first up-channel's name, buffer, size, where the firmware writes, where the probe reads, flags.
const BUFFER: u64 = 28;
const SIZE: u64 = 32;
const WRITE: u64 = 36;
const READ: u64 = 40;
const FLAGS: u64 = 44;

/// What the flags ask of a firmware whose buffer is full: 0 drops the line, 2 waits for the probe.
pub const BLOCK: u64 = 2;

/// A probe that is attached.
pub struct Probe {
    block: u64,
    /// Read, and not yet a whole frame.
    bytes: Vec<u8>,
    /// Whether the end of a frame has been read: what was written over before is none.
    is_in_step: bool,
    /// Places in `.defmt`, and what is logged there.
    lines: Vec<(u64, String)>,
}

impl Probe {
    /// Attaches to a board that runs, and asks for what it is to do when nobody reads.
    pub fn attach(bench: &Bench, flags: u64) -> Self {
        let block = bench.symbol("_SEGGER_RTT");
        let file = object::File::parse(bench.elf()).expect("an ELF file");
        let section = file.section_by_name(".defmt").expect("the image logs").index();
        let symbols = file.symbols().filter(|symbol| symbol.section_index() == Some(section));
        let text = |name: &str| {
            let from = name.split_once(r#""data":""#)?.1;
            Some(from.split_once(r#"","#)?.0.to_string())
        };
        let lines =
            symbols.filter_map(|symbol| Some((symbol.address(), text(symbol.name().ok()?)?)));
        let probe = Self { block, bytes: Vec::new(), is_in_step: false, lines: lines.collect() };
        probe.write(bench, FLAGS, flags);
        probe
    }

    fn read(&self, bench: &Bench, place: u64) -> u64 {
        let at = self.block + place;
        bench.with(move |stand| stand.host.read(at, Width::W32).expect("it is in RAM"))
    }

    fn write(&self, bench: &Bench, place: u64, value: u64) {
        let at = self.block + place;
        bench.with(move |stand| stand.host.write(at, Width::W32, value).expect("it is in RAM"));
    }

    /// Reads what has been logged, as the texts of the lines, their values left open.
    ///
    /// # Panics
    /// If something that is no line is in the log.
    pub fn log(&mut self, bench: &Bench) -> Vec<String> {
        let [buffer, size, end, begin] =
            [BUFFER, SIZE, WRITE, READ].map(|place| self.read(bench, place));
        let count = (end + size - begin) % size;
        self.bytes.extend(bench.with(move |stand| {
            let byte = |n| stand.host.read(buffer + (begin + n) % size, Width::W8).unwrap() as u8;
            (0..count).map(byte).collect::<Vec<u8>>()
        }));
        self.write(bench, READ, end);
        let mut texts = Vec::new();
        while let Some(end) = self.bytes.iter().position(|&byte| byte == 0) {
            let frame: Vec<u8> = self.bytes.drain(..=end).collect();
            if std::mem::replace(&mut self.is_in_step, true) && end > 0 {
                texts.push(self.text(&rzcobs(&frame[..end]).expect("a frame")));
            }
        }
        texts
    }

    fn text(&self, frame: &[u8]) -> String {
        let place = frame.first_chunk().map(|&place| u16::from_le_bytes(place).into());
        let line = self.lines.iter().find(|line| Some(line.0) == place);
        line.unwrap_or_else(|| panic!("no line of the log: {frame:?}")).1.clone()
    }
}

/// The bytes of a frame, which come from its end (the crate rzcobs' description); `None` if it is none.
fn rzcobs(frame: &[u8]) -> Option<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut from = frame.iter().rev().copied();
    while let Some(code) = from.next() {
        match code {
            0 => return None,
            // A bit for each of seven: a zero that was left out, or a byte.
            0x01..=0x7F => {
                for bit in (0..7).rev() {
                    bytes.push(if code >> bit & 1 == 0 { from.next()? } else { 0 });
                }
            }
            0x80..=0xFE => {
                bytes.push(0);
                (0..(code & 0x7F) + 7)
                    .try_for_each(|_| from.next().map(|byte| bytes.push(byte)))?;
            }
            0xFF => (0..134).try_for_each(|_| from.next().map(|byte| bytes.push(byte)))?,
        }
    }
    bytes.reverse();
    Some(bytes)
}
