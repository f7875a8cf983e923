//! A 128 x 64 display with an SSD1306 over I2C, in place of the original's LCD.
//!
//! Its pages are laid out as the protocol's frames: 8 rows, one byte a column, the least
//! significant bit on top. So a frame is three address bytes and one write of 64 bytes; there is
//! no frame buffer. (SSD1306 datasheet 1.1, section 9.)

use cortex_m::asm;
use embassy_stm32::i2c::{Config, Error, I2c, Master};
use embassy_stm32::mode::Blocking;
use embassy_stm32::pac::gpio::vals::{Idr, Moder};
use embassy_stm32::pac::i2c;
use embassy_stm32::time::Hertz;
use embassy_time::{Duration, Instant, Timer};

use super::boot::CORE_MHZ;
use super::drives::Lines;
use crate::ports::LcdPort;

/// The usual address, SA0 low.
const ADDRESS: u8 = 0x3C;
/// Control bytes: what follows is commands, or data.
const COMMANDS: u8 = 0x00;
const DATA: u8 = 0x40;
const PAGES: u8 = 8;

/// The sequence of the datasheet's application note with the charge pump on, page addressing
/// mode, and the panel turned so that the connector is on top.
const SET_UP: [u8; 25] = [
    COMMANDS, 0xAE, // display off
    0xD5, 0x80, // oscillator
    0xA8, 0x3F, // 64 rows
    0xD3, 0x00, // no offset
    0x40, // start line 0
    0x8D, 0x14, // charge pump on
    0x20, 0x02, // page addressing mode
    0xA1, 0xC8, // columns and rows turned
    0xDA, 0x12, // alternate COM pins
    0x81, 0x7F, // contrast
    0xD9, 0xF1, // precharge
    0xA4, 0xA6, // show the memory, not inverted
    0x2E, // no scrolling
    0xAF, // display on
];

/// The bus: 400 kHz, and a short time-out, for one without pull-ups: 18 bytes take 0.41 ms.
pub fn bus_config() -> Config {
    let mut config = Config::default();
    config.frequency = Hertz::khz(400);
    config.timeout = Duration::from_millis(2);
    config
}

/// What the bus is made of, to free it by.
pub struct Wires {
    /// The controller's.
    pub registers: i2c::I2c,
    /// SCL and SDA, open drain.
    pub lines: Lines,
}

impl Wires {
    /// Clocks on a display that was cut off in a byte and holds SDA low, nine times at the most, and
    /// ends that by a stop. Then the controller begins anew, since it may have seen half a transfer and
    /// wait for its end. Whether SDA is high then. Takes up to 0.2 ms.
    fn free(&self) -> bool {
        const SCL: usize = 0;
        const SDA: usize = 1;
        let Self { registers, lines } = self;
        let is_free = || {
            let levels = lines.port.idr().read();
            lines.pins.get(SDA).is_some_and(|&sda| levels.idr(sda.into()) == Idr::HIGH)
        };
        if !is_free() {
            registers.cr1().modify(|w| w.set_pe(false));
            let make = |mode| {
                let pins = lines.pins.iter();
                // Others on the port are claimed for ever, but nothing says that they stay so.
                critical_section::with(|_| {
                    lines
                        .port
                        .moder()
                        .modify(|w| pins.for_each(|&pin| w.set_moder(pin.into(), mode)));
                });
            };
            let set = |line, high| {
                lines.set(line, high);
                asm::delay(5 * CORE_MHZ); // half a period of 100 kHz
            };
            lines.write(0b11);
            make(Moder::OUTPUT);
            for _ in 0..9 {
                set(SCL, false);
                set(SCL, true);
                if is_free() {
                    break;
                }
            }
            for (line, high) in [(SCL, false), (SDA, false), (SCL, true), (SDA, true)] {
                set(line, high);
            }
            make(Moder::ALTERNATE);
        }
        let clock = (registers.cr2().read(), registers.ccr().read(), registers.trise().read());
        registers.cr1().write(|w| w.set_swrst(true));
        registers.cr1().write(|_| {});
        registers.cr2().write_value(clock.0);
        registers.ccr().write_value(clock.1);
        registers.trise().write_value(clock.2);
        registers.cr1().write(|w| w.set_pe(true));
        is_free()
    }
}

/// From one attempt to set up a display that does not answer to the next.
const RETRY: Duration = Duration::from_secs(1);

/// The display. One that does not answer is set up again at a later frame, on a bus that is freed
/// first.
pub struct Ssd1306 {
    bus: I2c<'static, Blocking, Master>,
    wires: Wires,
    ready: bool,
    /// When it may be tried again.
    retry: Instant,
}

impl Ssd1306 {
    /// A display that has not been spoken to yet, on a bus of [`bus_config`], which has these wires.
    ///
    /// The bus is polled: one call keeps the thread executor busy for 0.4 ms, and once a second for 2.2
    /// if nothing is there that pulls the lines up.
    pub const fn new(bus: I2c<'static, Blocking, Master>, wires: Wires) -> Self {
        Self { bus, wires, ready: false, retry: Instant::MIN }
    }

    /// Sets the display up and clears it, in 30 ms: before there are pictures, or the first would
    /// be dropped. A display that is not there yet keeps what its memory holds when it comes.
    pub async fn begin(&mut self) {
        if self.set_up().is_err() {
            return;
        }
        for number in 0..2 * PAGES {
            self.show(number, &[0; 64]).await;
        }
    }

    fn set_up(&mut self) -> Result<(), Error> {
        self.retry = Instant::now() + RETRY;
        if !self.wires.free() {
            return Err(Error::Bus);
        }
        self.bus.blocking_write(ADDRESS, &SET_UP)?;
        self.ready = true;
        Ok(())
    }

    async fn write(&mut self, number: u8, columns: &[u8; 64]) -> Result<(), Error> {
        let page = number / 2 % PAGES;
        let column = (number % 2) * 64;
        let place = [COMMANDS, 0xB0 | page, column & 0xF, 0x10 | column >> 4];
        self.bus.blocking_write(ADDRESS, &place)?;
        for part in columns.chunks(16) {
            let mut bytes = [DATA; 17];
            for (to, from) in bytes.iter_mut().skip(1).zip(part) {
                *to = *from;
            }
            self.bus.blocking_write(ADDRESS, &bytes)?;
            // Lets the link's task in between.
            Timer::after_ticks(0).await;
        }
        Ok(())
    }
}

impl LcdPort for Ssd1306 {
    async fn show(&mut self, number: u8, columns: &[u8; 64]) {
        if !self.ready && Instant::now() >= self.retry && self.set_up().is_err() {
            defmt::warn!("the display does not answer");
        }
        if self.ready && self.write(number, columns).await.is_err() {
            self.ready = false;
            defmt::warn!("the display does not answer");
        }
    }
}
