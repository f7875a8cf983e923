//! The few packets of the gdb remote protocol that the tests need, and of the ELF file one table.

use std::io::{ErrorKind, Read, Write};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::time::Duration;

/// A connection to QEMU's gdb server.
pub struct Gdb(UnixStream);

/// Core registers by their number.
pub const SP: u8 = 13;
/// The program counter.
pub const PC: u8 = 15;

impl Gdb {
    /// Takes over a machine that stands still.
    pub fn new(stream: UnixStream) -> Self {
        let mut gdb = Self(stream);
        // QEMU serves single registers only to those who have asked for their description.
        gdb.ask("qXfer:features:read:target.xml:0,ffb");
        gdb
    }

    fn send(&mut self, packet: &str) {
        let sum = packet.bytes().fold(0, u8::wrapping_add);
        write!(self.0, "${packet}#{sum:02x}").unwrap();
    }

    /// The next packet; `None` if none comes within the time.
    fn receive(&mut self, within: Duration) -> Option<String> {
        self.0.set_read_timeout(Some(within)).unwrap();
        let mut packet = Vec::new();
        let mut byte = [0];
        let mut begun = false;
        loop {
            match self.0.read(&mut byte) {
                Ok(0) => panic!("QEMU has closed the gdb connection"),
                Ok(_) => {}
                Err(error)
                    if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) =>
                {
                    return None;
                }
                Err(error) => panic!("gdb connection: {error}"),
            }
            match byte[0] {
                b'$' => begun = true,
                b'#' if begun => break,
                byte if begun => packet.push(byte),
                _ => {} // acknowledgements
            }
        }
        self.0.read_exact(&mut [0; 2]).unwrap(); // the checksum; a local socket loses nothing
        self.0.write_all(b"+").unwrap();
        Some(String::from_utf8(packet).unwrap())
    }

    fn ask(&mut self, packet: &str) -> String {
        self.send(packet);
        self.receive(Duration::from_secs(5)).unwrap_or_else(|| panic!("no answer to {packet}"))
    }

    fn order(&mut self, packet: &str) {
        assert_eq!(self.ask(packet), "OK", "answer to {packet}");
    }

    /// Lets the machine run.
    pub fn run(&mut self) {
        self.send("c");
    }

    /// Lets the machine do one instruction.
    pub fn step(&mut self) {
        self.ask("s");
    }

    /// Whether the machine, running, stops within the time.
    pub fn stops_within(&mut self, time: Duration) -> bool {
        self.receive(time).is_some()
    }

    /// Stops the running machine.
    pub fn stop(&mut self) {
        self.0.write_all(&[3]).unwrap();
        assert!(self.stops_within(Duration::from_secs(5)), "the machine does not stop");
    }

    /// Stops before every access to these bytes, or only before stores, or no more.
    pub fn watch(&mut self, (stores_only, address, length): (bool, u32, u32), on: bool) {
        let (set, kind) = (if on { 'Z' } else { 'z' }, if stores_only { 2 } else { 4 });
        self.order(&format!("{set}{kind},{address:x},{length:x}"));
    }

    /// Stops before the instruction at this address, or no more.
    pub fn stop_at(&mut self, address: u32, on: bool) {
        self.order(&format!("{}1,{address:x},2", if on { 'Z' } else { 'z' }));
    }

    /// Resets the machine, which stands still.
    pub fn reset(&mut self) {
        let command: String = "system_reset".bytes().map(|byte| format!("{byte:02x}")).collect();
        self.order(&format!("qRcmd,{command}"));
    }

    /// A core register.
    pub fn register(&mut self, number: u8) -> u32 {
        let answer = self.ask(&format!("p{number:x}"));
        u32::from_str_radix(&answer, 16).unwrap().swap_bytes()
    }

    /// Sets a core register.
    pub fn set_register(&mut self, number: u8, value: u32) {
        self.order(&format!("P{number:x}={:08x}", value.swap_bytes()));
    }

    /// Sets memory, read-only or not.
    pub fn set_bytes(&mut self, address: u32, bytes: &[u8]) {
        // Twice so many digits fit a packet.
        for (address, bytes) in (address..).step_by(1024).zip(bytes.chunks(1024)) {
            let digits: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
            self.order(&format!("M{address:x},{:x}:{digits}", bytes.len()));
        }
    }

    /// A word of memory.
    pub fn word(&mut self, address: u32) -> u32 {
        let answer = self.ask(&format!("m{address:x},4"));
        u32::from_str_radix(&answer, 16)
            .unwrap_or_else(|_| panic!("{address:#x}: {answer}"))
            .swap_bytes()
    }
}

/// The address of the function or variable of this name, else of the one whose mangled name contains
/// it.
pub fn symbol(elf: &Path, name: &str) -> u32 {
    let elf = std::fs::read(elf).unwrap();
    let half = |at: usize| usize::from(u16::from_le_bytes([elf[at], elf[at + 1]]));
    let word = |at: usize| u32::from_le_bytes(elf[at..at + 4].try_into().unwrap());
    let at = |at: usize| word(at) as usize;
    // ELF32: section headers of 40 bytes (type at 4, offset at 16, size at 20, link at 24).
    let section = |number: usize| at(0x20) + number * half(0x2E);
    let symbols = (0..half(0x30)).map(section).find(|&s| word(s + 4) == 2).expect("symbols");
    let names = at(section(at(symbols + 24)) + 16);
    let table = at(symbols + 16);
    let text = |symbol: usize| {
        let begin = names + at(symbol);
        let text: Vec<u8> = elf[begin..].iter().copied().take_while(|&byte| byte != 0).collect();
        String::from_utf8_lossy(&text).into_owned()
    };
    let found: Vec<usize> = (table..table + at(symbols + 20))
        .step_by(16)
        .filter(|&symbol| matches!(elf[symbol + 12] & 0xF, 1 | 2) && text(symbol).contains(name))
        .collect();
    let exact = found.iter().find(|&&symbol| text(symbol) == name);
    let symbol = *exact.or(found.first()).unwrap_or_else(|| panic!("no {name}"));
    word(symbol + 4) & !1 // without the Thumb bit
}
