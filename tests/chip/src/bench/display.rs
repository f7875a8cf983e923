//! An SSD1306 that keeps its pixels: page addressing mode, the commands that our images send, and a
//! flag for each that it does not know (SSD1306 datasheet 1.1, section 9).

use std::sync::{Arc, Mutex};

use rigless::chip::{Timeline, i2c::Peer};
use rigless::snapshot::Store;

/// The display's address.
const ADDRESS: u8 = 0x3C;

/// What it shows, and how it was told.
#[derive(Clone, Debug)]
pub struct Panel {
    /// Eight pages of 128 columns, bit 0 on top.
    pub pages: [[u8; 128]; 8],
    /// Switched on (0xAF).
    pub is_on: bool,
    /// Commands that it does not know.
    pub unknown: Vec<u8>,
    /// Whether it is there at all.
    pub is_plugged: bool,
}

impl Default for Panel {
    fn default() -> Self {
        // A memory that nobody has cleared.
        Self { pages: [[0xA5; 128]; 8], is_on: false, unknown: Vec::new(), is_plugged: true }
    }
}

/// The display. Handles are to the same panel.
#[derive(Clone, Debug, Default)]
pub struct Display {
    /// What it shows.
    pub panel: Arc<Mutex<Panel>>,
    page: usize,
    column: usize,
    is_data: Option<bool>,
    /// A command that waits for its argument.
    waiting: Option<u8>,
}

impl Display {
    fn command(&mut self, byte: u8) {
        if self.waiting.take().is_some() {
            return; // its argument changes nothing that is kept here
        }
        match byte {
            0x00..=0x0F => self.column = self.column & 0xF0 | usize::from(byte),
            0x10..=0x17 => self.column = self.column & 0x0F | usize::from(byte & 7) << 4,
            0xB0..=0xB7 => self.page = usize::from(byte & 7),
            0xAE | 0xAF => self.panel.lock().unwrap().is_on = byte == 0xAF,
            0x20 | 0x81 | 0x8D | 0xA8 | 0xD3 | 0xD5 | 0xD9 | 0xDA | 0xDB => {
                self.waiting = Some(byte)
            }
            0x40..=0x7F | 0xA0..=0xA1 | 0xA4..=0xA7 | 0xC0 | 0xC8 | 0x2E | 0xE3 => {}
            unknown => self.panel.lock().unwrap().unknown.push(unknown),
        }
    }

    fn data(&mut self, byte: u8) {
        self.panel.lock().unwrap().pages[self.page][self.column % 128] = byte;
        self.column = (self.column + 1) % 128; // the page stays, section 10.1.3
    }
}

impl Store for Display {}

impl Peer for Display {
    fn start(&mut self, address: u8, read: bool, _: &mut Timeline<'_, '_>) -> bool {
        self.is_data = None;
        self.waiting = None;
        address == ADDRESS && !read && self.panel.lock().unwrap().is_plugged
    }

    fn write(&mut self, byte: u8, _: &mut Timeline<'_, '_>) -> bool {
        match self.is_data {
            // The control byte: Co 0, then D/C.
            None => self.is_data = Some(byte & 0x40 != 0),
            Some(true) => self.data(byte),
            Some(false) => self.command(byte),
        }
        self.panel.lock().unwrap().is_plugged
    }

    fn read(&mut self, _: bool, _: &mut Timeline<'_, '_>) -> u8 {
        0
    }

    fn stop(&mut self, _: &mut Timeline<'_, '_>) {}
}
