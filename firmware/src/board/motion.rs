//! Bridges, servos, encoders, and what is sampled for control: `app::control`'s port.
//!
//! Promise: registers are written only when an output changes, a bridge's enable line first when
//! it goes off and last when it goes on.
//!
//! Of the two samples of a current, the one that counts is [away from](Moment) the edges of its own PWM
//! line, whatever the duty. While another line has edges in it, the last clean one holds, but not
//! for longer than [`LONGEST_HOLD`]: a current that nobody looks at protects no motor. The outputs
//! that are compared with are those of the period before: when `sample` is called they have been in
//! force for longer than the 0.8 ms of a scan, unless control was 100 us late.

use crate::channel::CHANNELS;
use embassy_stm32::gpio::{Level, Output, Pull};
use embassy_stm32::pac::timer::TimGp16;
use embassy_stm32::pac::timer::vals::FilterValue;
use embassy_stm32::timer::GeneralInstance4Channel;
use embassy_stm32::timer::qei::{self, Qei};

use super::analog::{Analog, Moment};
use super::drives::{Drives, servo_compare};
use crate::ports::{MotionInputs, MotionPort, Outputs};

/// For how many control periods a current may be old: 10 ms, to limits that take seconds.
const LONGEST_HOLD: u8 = 10;

/// A motor's current as it was last clean.
#[derive(Clone, Copy, Default)]
struct Current {
    sample: u16,
    /// For how many control periods it has held.
    held: u8,
}

impl Current {
    /// One that has held for long enough follows what is sampled until that is clean again.
    fn update(&mut self, sample: u16, is_clean: bool) {
        if is_clean {
            *self = Self { sample, held: 0 };
        } else if self.held < LONGEST_HOLD {
            self.held += 1;
        } else {
            self.sample = sample;
        }
    }
}

/// The motion hardware, with the timers of the two encoders.
pub struct Motion<A: GeneralInstance4Channel, B: GeneralInstance4Channel> {
    drives: &'static Drives,
    analog: Analog,
    encoders: (Qei<'static, A>, Qei<'static, B>),
    directions: [Option<Output<'static>>; CHANNELS],
    currents: [Current; CHANNELS],
    /// What the registers hold.
    driven: Outputs,
}

impl<A: GeneralInstance4Channel, B: GeneralInstance4Channel> Motion<A, B> {
    /// Over drives that are started, and whose pins are claimed. A bridge without a direction line
    /// needs the stage that does without.
    pub fn new(
        drives: &'static Drives,
        analog: Analog,
        encoders: (Qei<'static, A>, Qei<'static, B>),
        directions: [Option<Output<'static>>; CHANNELS],
    ) -> Self {
        for timer in [A::regs(), B::regs()] {
            // SAFETY: a general timer with four channels, which `encoders` own; the register is where
            // all of them have it (RM0090 18.4.7).
            let timer = unsafe { TimGp16::from_ptr(timer) };
            timer
                .ccmr_input(0)
                .modify(|w| (0..2).for_each(|input| w.set_icf(input, ENCODER_FILTER)));
        }
        let currents = Default::default();
        Self { drives, analog, encoders, directions, currents, driven: Outputs::default() }
    }

    /// Motor currents 1 to 6.
    fn currents(&mut self) -> [u16; CHANNELS] {
        let compares = self.driven.motors.map(|motor| self.drives.stage.compare(motor.duty));
        let look = |moment: Moment| {
            let is_clean = !compares.iter().any(|&compare| moment.has_edge(compare));
            Analog::currents(moment).map(|sample| (sample, is_clean))
        };
        let both = look(Moment::High).into_iter().zip(look(Moment::Low));
        for ((current, compare), (high, low)) in self.currents.iter_mut().zip(compares).zip(both) {
            let (sample, is_clean) = if Moment::High.has_edge(compare) { low } else { high };
            current.update(sample, is_clean);
        }
        self.currents.map(|current| current.sample)
    }
}

/// An encoder's level counts when it has been the same eight times at 10.5 MHz (84 MHz / 8): what is
/// shorter than 0.76 us is noise. So an encoder may make 2.6 million counts a second, four of which
/// have two levels of each line.
const ENCODER_FILTER: FilterValue = FilterValue::FDTS_DIV8_N8;

/// Encoder inputs, with pull-ups for open collectors.
pub fn encoder_inputs() -> qei::Config {
    qei::Config { ch1_pull: Pull::Up, ch2_pull: Pull::Up, ..Default::default() }
}

impl<A: GeneralInstance4Channel, B: GeneralInstance4Channel> MotionPort for Motion<A, B> {
    fn sample(&mut self) -> MotionInputs {
        self.analog.check();
        MotionInputs {
            potentiometers: Analog::potentiometers(),
            currents: self.currents(),
            encoders: [self.encoders.0.count(), self.encoders.1.count()],
        }
    }

    fn drive(&mut self, outputs: &Outputs) {
        let Drives { stage, enables, bridges, servos, outputs: port } = self.drives;
        let motors = outputs.motors.iter().zip(&self.driven.motors);
        let lines = bridges.iter().zip(&mut self.directions);
        for (channel, ((motor, driven), (bridge, direction))) in motors.zip(lines).enumerate() {
            if motor == driven {
                continue;
            }
            if !motor.enabled {
                enables.set(channel, false);
            }
            bridge.set(stage.compare(motor.duty));
            if let Some(direction) = direction {
                direction.set_level(Level::from(stage.forward(motor.duty)));
            }
            if motor.enabled {
                enables.set(channel, true);
            }
        }
        let wanted = outputs.servos.iter().zip(&self.driven.servos);
        for ((pulse, driven), servo) in wanted.zip(*servos) {
            if pulse != driven {
                servo.set(servo_compare(*pulse));
            }
        }
        if outputs.gpio != self.driven.gpio {
            port.write(outputs.gpio.into());
        }
        self.driven = *outputs;
    }
}
