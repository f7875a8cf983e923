//! QEMU 7.2 with the image that the board gets.
//!
//! The machine does not model the ready bits that the start of the clocks waits for, nor the
//! flash's controller. Watchpoints on those registers stop it before every access; we tell `chip`
//! what is written, and put its answer into the register of a load. When no access has come for a
//! while, the image is through, and the watchpoints go.
//!
//! What the machine lacks altogether (TIM1, TIM8, TIM12, GPIO, I2C, DMA, the watchdog) it logs by
//! name, offset and value. That log is what the tests read.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::os::unix::net::UnixStream;
use std::sync::mpsc;
use std::time::{Duration, Instant};

use hal_mock::flash::Flash;
use protocol::pms5005::{self, Frame, Receiver, Report};

use crate::chip::{Chip, Effect, LOADER, LOADER_ENTRY, Reset, SECTOR, SETTINGS};
use crate::gdb::{Gdb, PC, SP};
use crate::process::{self, Qemu, bytes_from, version};

/// Why a version of QEMU will not do: its machine and its log are those that these tests know, or
/// they are not.
fn refusal(version: &str) -> Option<String> {
    let known = version.starts_with("QEMU emulator version 7.2.");
    (!known).then(|| {
        format!(
            "this test needs QEMU 7.2 and found '{version}'; newer ones (10.0) abort when the image \
             resets an APB2 peripheral. The image pms5005-sim does not need 7.2"
        )
    })
}

#[test]
fn another_version_is_refused_with_the_reason() {
    assert_eq!(refusal("QEMU emulator version 7.2.17 (Debian 1:7.2+dfsg-7+deb12u14)"), None);
    for other in ["QEMU emulator version 10.0.2", "QEMU emulator version 7.20.0", ""] {
        let reason = refusal(other).expect("a refusal");
        assert!(reason.contains("needs QEMU 7.2") && reason.contains(other), "{reason}");
    }
}

/// How long a test waits for what must come. The machine's clock is the wall's, less the ticks
/// that a busy computer makes it lose.
const PATIENCE: Duration = Duration::from_secs(10);

/// A load or a store: the data's register, the word's address, the instruction's bytes.
struct Access {
    is_load: bool,
    register: u8,
    address: u32,
    length: u32,
}

/// A running machine. It ends when it is dropped.
pub struct Machine {
    gdb: Gdb,
    uart: UnixStream,
    from_image: mpsc::Receiver<u8>,
    receiver: Receiver,
    log: File,
    /// The part of the log that has been read, from the last [`Machine::forget`].
    seen: String,
    /// What the machine lacks.
    pub chip: Chip,
    /// It stands in the loader.
    stands: bool,
    _qemu: Qemu,
}

impl Machine {
    /// Switches on a board with an image in which what the machine lacks is replaced, and with
    /// nothing saved. `name` is the test's, `options` are QEMU's besides those that every test
    /// needs.
    ///
    /// # Panics
    /// If QEMU is missing or of another version, or the image does not come through.
    pub fn boot(name: &str, image: &str, options: &[&str]) -> Self {
        Self::boot_with(name, image, options, Chip::new(Reset::Power), &Flash::empty())
    }

    /// The same on another chip or after another kind of reset, with what this flash holds.
    ///
    /// # Panics
    /// As above.
    pub fn boot_with(
        name: &str,
        image: &str,
        options: &[&str],
        chip: Chip,
        settings: &Flash,
    ) -> Self {
        if let Some(reason) = refusal(&version()) {
            panic!("{reason}");
        }
        let log = ["-S", "-d", "unimp,guest_errors", "-D", "log", "-serial", "null"];
        let options = [&log[..], options].concat();
        let sockets = [("-gdb", "gdb"), ("-serial", "uart")];
        let qemu = Qemu::start(name, &process::image(image), &options, &sockets);
        let uart = qemu.connect("uart");
        let mut machine = Self {
            gdb: Gdb::new(qemu.connect("gdb")),
            from_image: bytes_from(&uart),
            uart,
            receiver: Receiver::new(),
            log: File::open(qemu.path("log")).unwrap(),
            seen: String::new(),
            chip,
            stands: false,
            _qemu: qemu,
        };
        machine.gdb.set_bytes(SETTINGS.start, &settings.image());
        machine.serve_stopped();
        assert!(machine.chip.is_touched, "the image has not started its clocks");
        machine
    }

    /// Sends a command, and serves what the machine lacks until nothing has been asked of it for a
    /// while.
    pub fn serve(&mut self, command: pms5005::Command<'_>) {
        self.gdb.stop(); // or it may be faster than we are
        self.send(command);
        self.serve_stopped();
    }

    /// Sends a command that makes the image restart, and serves it through the reset and the start.
    pub fn restart(&mut self, command: pms5005::Command<'_>) {
        self.chip = Chip::new(Reset::Software);
        self.serve(command);
        assert!(self.chip.is_touched, "the image does not restart");
    }

    /// Sends a command that makes the image restart into the ROM's loader, and serves it up to the
    /// loader's entry. There the machine stands until it is reset. The stack pointer there.
    pub fn enter_loader(&mut self, command: pms5005::Command<'_>) -> u32 {
        self.chip = Chip::new(Reset::Software);
        self.serve(command);
        assert!(self.stands, "the image does not enter the loader");
        self.gdb.register(SP)
    }

    /// Resets the machine, which stands in the loader or runs, with this word of memory set, and
    /// serves the start behind it.
    pub fn reset(&mut self, reset: Reset, (address, word): (u32, u32)) {
        if !self.stands {
            self.gdb.stop();
        }
        self.gdb.set_bytes(address, &word.to_le_bytes());
        self.gdb.reset();
        self.chip = Chip::new(reset);
        self.serve_stopped();
        assert!(self.chip.is_touched, "the image does not start");
    }

    fn serve_stopped(&mut self) {
        self.watch(true);
        self.stands = false;
        let mut stops = 0;
        loop {
            self.gdb.run();
            // Between two accesses the start takes microseconds, a save 40 ms.
            let patience = if stops == 0 { PATIENCE } else { Duration::from_millis(500) };
            if !self.gdb.stops_within(patience) {
                self.gdb.stop();
                break;
            }
            stops += 1;
            assert!(stops < 1000, "the image asks for something that it never gets");
            if self.gdb.register(PC) == LOADER_ENTRY & !1 {
                self.stands = true; // there is nothing to run
                break;
            }
            self.serve_access();
        }
        self.watch(false);
        if !self.stands {
            self.gdb.run();
        }
    }

    fn watch(&mut self, on: bool) {
        Chip::watched().for_each(|bytes| self.gdb.watch(bytes, on));
        self.gdb.stop_at(LOADER_ENTRY & !1, on);
    }

    /// Does the load or store before which the machine stands.
    fn serve_access(&mut self) {
        let Access { is_load, register, address, length } = self.access();
        if is_load && address >= LOADER {
            // Nothing is there at all: the load would fail.
            let pc = self.gdb.register(PC);
            self.gdb.set_register(register, self.chip.load(address));
            self.gdb.set_register(PC, pc + length);
            return;
        }
        let stored = self.gdb.register(register);
        // It would stop here again.
        self.watch(false);
        let pc = self.gdb.register(PC);
        // Now and then QEMU says that it has made a step and stands where it stood.
        while self.gdb.register(PC) == pc {
            self.gdb.step();
        }
        self.watch(true);
        if is_load {
            self.gdb.set_register(register, self.chip.load(address));
            return;
        }
        match self.chip.store(address, stored) {
            Some(Effect::Program(address, value)) => {
                let word = self.gdb.word(address) & value;
                self.gdb.set_bytes(address, &word.to_le_bytes());
            }
            Some(Effect::Erase(sector)) => {
                let begin = SETTINGS.start + (u32::from(sector) - 1) * SECTOR;
                assert!(SETTINGS.contains(&begin), "sector {sector} is erased");
                self.gdb.set_bytes(begin, &[0xFF; SECTOR as usize]);
            }
            None => {}
        }
    }

    /// The load or store before which the machine stands: Thumb LDR and STR with an immediate
    /// offset and with a register's, 16 and 32 bits; STM of one register (ARMv7-M ARM A7.7).
    fn access(&mut self) -> Access {
        let pc = self.gdb.register(PC);
        let words = [pc & !3, (pc & !3) + 4].map(|address| u64::from(self.gdb.word(address)));
        let code = (words[0] | words[1] << 32) >> (8 * (pc & 2));
        let (first, second) = ((code & 0xFFFF) as u32, (code >> 16 & 0xFFFF) as u32); // 16 bits
        let register = |bits: u32| (bits & 0xF) as u8; // four bits
        let is_load = first & if first & 0xF000 == 0xF000 { 0x10 } else { 0x800 } != 0;
        let (register, address, length) = if matches!(first & 0xFFF0, 0xF8D0 | 0xF8C0) {
            let base = self.gdb.register(register(first));
            (register(second >> 12), base + (second & 0xFFF), 4)
        } else if first & 0xF000 == 0x6000 {
            let base = self.gdb.register(register(first >> 3 & 7));
            (register(first & 7), base + (first >> 6 & 31) * 4, 2)
        } else if matches!(first & 0xFE00, 0x5800 | 0x5000) {
            let base = self.gdb.register(register(first >> 3 & 7));
            let offset = self.gdb.register(register(first >> 6 & 7));
            (register(first & 7), base.wrapping_add(offset), 2)
        } else if matches!(first & 0xFFF0, 0xF850 | 0xF840) && second & 0x0FC0 == 0 {
            let base = self.gdb.register(register(first));
            let offset = self.gdb.register(register(second)) << (second >> 4 & 3);
            (register(second >> 12), base.wrapping_add(offset), 4)
        } else if first & 0xF800 == 0xC000 && (first & 0xFF).is_power_of_two() {
            let number = (first & 0xFF).trailing_zeros();
            (register(number), self.gdb.register(register(first >> 8 & 7)), 2)
        } else {
            panic!("an access at {pc:#x} that this test cannot decode: {first:04x} {second:04x}");
        };
        Access { is_load, register, address, length }
    }

    /// Sends what a host sends.
    pub fn send_bytes(&mut self, bytes: &[u8]) {
        self.uart.write_all(bytes).unwrap();
    }

    /// Waits for a byte to the host, until then.
    pub fn byte(&self, until: Instant) -> Option<u8> {
        self.from_image.recv_timeout(until.saturating_duration_since(Instant::now())).ok()
    }

    /// Sends a command of the host.
    pub fn send(&mut self, command: pms5005::Command<'_>) {
        let mut buffer = [0; 264];
        let frame = command.encode(0, &mut buffer).unwrap();
        self.send_bytes(frame);
    }

    /// Waits for a frame: its DID and DATA, and whether it is telemetry.
    pub fn frame(&mut self) -> (u8, Vec<u8>, bool) {
        let deadline = Instant::now() + PATIENCE;
        while let Some(byte) = self.byte(deadline) {
            if let Some(frame) = self.receiver.receive(&mut &[byte][..]) {
                let Frame { res, did, data, .. } = Frame::parse(frame).unwrap();
                return (did, data.to_vec(), res == 255);
            }
        }
        panic!("the image says nothing for {PATIENCE:?}; its log:\n{}", self.log_tail(""));
    }

    /// Waits for telemetry of which `wanted` makes something.
    pub fn report<T>(&mut self, mut wanted: impl FnMut(&Report) -> Option<T>) -> T {
        for _ in 0..100 {
            let (did, data, telemetry) = self.frame();
            let report = telemetry.then(|| Report::parse(did, &data)).flatten();
            if let Some(found) = report.as_ref().and_then(&mut wanted) {
                return found;
            }
        }
        panic!("100 frames, and not the report that was wanted");
    }

    /// Sends a command and waits for its acknowledgement.
    pub fn order(&mut self, command: pms5005::Command<'_>) {
        self.send(command);
        self.acknowledged();
    }

    /// Sends what need not be a command.
    pub fn send_raw(&mut self, did: u8, data: &[u8]) {
        let mut buffer = [0; 264];
        let frame = Frame { rid: 1, res: 0, did, data };
        self.send_bytes(frame.encode(&mut buffer).unwrap());
    }

    /// Waits for an acknowledgement.
    pub fn acknowledged(&mut self) {
        for _ in 0..100 {
            if self.frame() == (255, vec![1], false) {
                return;
            }
        }
        panic!("100 frames, and no acknowledgement");
    }

    /// The log since the last [`forget`](Self::forget).
    fn log(&mut self) -> &str {
        let mut new = Vec::new();
        self.log.read_to_end(&mut new).unwrap();
        self.seen.push_str(&String::from_utf8_lossy(&new));
        &self.seen
    }

    /// Looks only at what is logged from now on.
    pub fn forget(&mut self) {
        self.log.seek(SeekFrom::End(0)).unwrap();
        self.seen.clear();
    }

    /// Waits for a device's register to be written with a value, and says how far into the log.
    pub fn written(&mut self, device: &str, offset: u32, value: u32) -> usize {
        let line = format!(
            "{device}: unimplemented device write (size 4, offset {offset:#05x}, value {value:#010x})"
        );
        let deadline = Instant::now() + PATIENCE;
        while Instant::now() < deadline {
            if let Some(at) = self.log().find(&line) {
                return at;
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        panic!("never logged: {line}\nwrites:\n{}", self.log_tail("write"));
    }

    /// The last lines of the log with something in them.
    fn log_tail(&mut self, with: &str) -> String {
        let lines: Vec<_> = self.log().lines().filter(|line| line.contains(with)).collect();
        lines[lines.len().saturating_sub(40)..].join("\n")
    }

    /// What has been written to a device's register since the last [`forget`](Self::forget).
    pub fn values(&mut self, device: &str, offset: u32) -> Vec<u32> {
        let begin =
            format!("{device}: unimplemented device write (size 4, offset {offset:#05x}, value 0x");
        let hexadecimal = |rest: &str| u32::from_str_radix(rest.get(..8)?, 16).ok();
        self.log().split(&begin).skip(1).filter_map(hexadecimal).collect()
    }

    /// Whether the log has this since the last [`forget`](Self::forget).
    pub fn is_logged(&mut self, what: &str) -> bool {
        self.log().contains(what)
    }

    /// Whether a device has been touched since the last [`forget`](Self::forget).
    pub fn is_touched(&mut self, device: &str) -> bool {
        self.log().contains(&format!("{device}: unimplemented device"))
    }

    /// Whether a device's register has been written since the last [`forget`](Self::forget).
    pub fn is_written(&mut self, device: &str, offset: u32) -> bool {
        let begin = format!("{device}: unimplemented device write (size 4, offset {offset:#05x},");
        self.log().contains(&begin)
    }

    /// With the machine stopped in between.
    pub fn stopped<T>(&mut self, act: impl FnOnce(&mut Gdb) -> T) -> T {
        self.gdb.stop();
        let result = act(&mut self.gdb);
        self.gdb.run();
        result
    }
}
