//! DMA streams that go round and round without interrupts, which embassy-stm32 has no driver for.
//!
//! A stream is claimed by passing its embassy token to whoever starts it; nothing else touches it.

use embassy_stm32::pac::dma::Dma;
use embassy_stm32::pac::dma::vals::{Dir, Size};

/// What a stream does.
pub struct Round {
    /// Controller and stream number.
    pub dma: Dma,
    /// 0 to 7.
    pub stream: usize,
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
        let stream = self.dma.st(self.stream);
        stream.cr().write(|_| {});
        // The stream ends its current item first (RM0090 10.3.17): a few bus cycles. The bound is
        // for QEMU and for broken silicon.
        for _ in 0..1000 {
            if !stream.cr().read().en() {
                break;
            }
        }
        clear_flags(self.dma, self.stream);
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
        self.dma.isr(self.stream / 4).read().teif(self.stream % 4)
    }
}

/// Whether the stream has come to its buffer's end since the flags were last cleared.
#[cfg(not(feature = "qemu"))] // for the host's line, which is without DMA there
pub fn came_round(dma: Dma, stream: usize) -> bool {
    dma.isr(stream / 4).read().tcif(stream % 4)
}

/// Clears all of the stream's flags.
pub fn clear_flags(dma: Dma, stream: usize) {
    dma.ifcr(stream / 4).write(|w| {
        w.set_tcif(stream % 4, true);
        w.set_htif(stream % 4, true);
        w.set_teif(stream % 4, true);
        w.set_dmeif(stream % 4, true);
        w.set_feif(stream % 4, true);
    });
}
