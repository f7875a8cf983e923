//! DMA streams that go round and round without interrupts, which embassy-stm32 has no driver for.
//!
//! A stream is claimed by passing its embassy token to whoever starts it; nothing else touches it.

use embassy_stm32::Peri;
use embassy_stm32::dma::ChannelInstance;
use embassy_stm32::interrupt::typelevel::Interrupt as _;
use embassy_stm32::pac::dma::Dma;
use embassy_stm32::pac::dma::regs::Ixr;
use embassy_stm32::pac::dma::vals::{Dir, Size};
use embassy_stm32::pac::{DMA1, DMA2, Interrupt};

/// A stream of one of the two controllers. RM0090's streams are embassy's channels.
#[derive(Clone, Copy)]
pub struct Stream {
    dma: Dma,
    /// 0 to 7.
    number: usize,
}

impl Stream {
    /// The one that a token stands for, which only its interrupt tells.
    pub fn of<C: ChannelInstance>(_token: &Peri<'static, C>) -> Self {
        let (dma, number) = match C::Interrupt::IRQ {
            Interrupt::DMA1_STREAM0 => (DMA1, 0),
            Interrupt::DMA1_STREAM1 => (DMA1, 1),
            Interrupt::DMA1_STREAM2 => (DMA1, 2),
            Interrupt::DMA1_STREAM3 => (DMA1, 3),
            Interrupt::DMA1_STREAM4 => (DMA1, 4),
            Interrupt::DMA1_STREAM5 => (DMA1, 5),
            Interrupt::DMA1_STREAM6 => (DMA1, 6),
            Interrupt::DMA1_STREAM7 => (DMA1, 7),
            Interrupt::DMA2_STREAM0 => (DMA2, 0),
            Interrupt::DMA2_STREAM1 => (DMA2, 1),
            Interrupt::DMA2_STREAM2 => (DMA2, 2),
            Interrupt::DMA2_STREAM3 => (DMA2, 3),
            Interrupt::DMA2_STREAM4 => (DMA2, 4),
            Interrupt::DMA2_STREAM5 => (DMA2, 5),
            Interrupt::DMA2_STREAM6 => (DMA2, 6),
            Interrupt::DMA2_STREAM7 => (DMA2, 7),
            _ => unreachable!("a channel's interrupt is a stream's"),
        };
        Self { dma, number }
    }

    /// Items to go until the buffer's end.
    pub fn remaining(self) -> u16 {
        self.dma.st(self.number).ndtr().read().ndt()
    }

    /// Whether the stream has come to its buffer's end since the flags were last cleared.
    pub fn came_round(self) -> bool {
        self.dma.isr(self.number / 4).read().tcif(self.number % 4)
    }

    /// Clears all five of the stream's flags. Four streams share a register (RM0090 10.5.3).
    pub fn clear_flags(self) {
        let first = [0, 6, 16, 22][self.number % 4];
        self.dma.ifcr(self.number / 4).write_value(Ixr(0b11_1101 << first));
    }
}

/// What a stream does.
pub struct Round {
    /// Which stream.
    pub stream: Stream,
    /// Request ("channel" in RM0090 tables 42 and 43).
    pub request: u8,
    /// Which way.
    pub direction: Dir,
    /// Width of an item on both sides.
    pub width: Size,
    /// Address of the peripheral's register.
    pub register: u32,
    /// Address of the buffer.
    pub memory: u32,
    /// Items in the buffer.
    pub items: u16,
}

impl Round {
    /// Starts the stream from the buffer's beginning, stopping it first if it runs.
    ///
    /// # Safety
    /// `memory` holds `items` items for ever, and may be written by the DMA if the direction is
    /// from the peripheral.
    pub unsafe fn start(&self) {
        let stream = self.stream.dma.st(self.stream.number);
        stream.cr().write(|_| {});
        // The stream ends its current item first (RM0090 10.3.17): a few bus cycles. The bound is
        // for broken silicon.
        for _ in 0..1000 {
            if !stream.cr().read().en() {
                break;
            }
        }
        self.stream.clear_flags();
        stream.par().write_value(self.register);
        stream.m0ar().write_value(self.memory);
        stream.ndtr().write(|w| w.set_ndt(self.items));
        stream.cr().write(|w| {
            w.set_chsel(self.request);
            w.set_dir(self.direction);
            w.set_psize(self.width);
            w.set_msize(self.width);
            w.set_minc(true);
            w.set_circ(true);
            w.set_en(true);
        });
    }

    /// Whether a bus error has stopped the stream.
    pub fn failed(&self) -> bool {
        let Stream { dma, number } = self.stream;
        dma.isr(number / 4).read().teif(number % 4)
    }
}
