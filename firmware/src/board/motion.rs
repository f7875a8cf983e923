//! Bridges, servos, encoders, and what is sampled for control: `app::control`'s port.
//!
//! Promise: registers are written only when an output changes, a bridge's enable line first when
//! it goes off and last when it goes on.

use crate::channel::CHANNELS;
use embassy_stm32::gpio::{Level, Output, Pull};
use embassy_stm32::timer::GeneralInstance4Channel;
use embassy_stm32::timer::qei::{self, Qei};

use super::analog::Analog;
use super::drives::{Drives, servo_compare};
use crate::ports::{MotionInputs, MotionPort, Outputs};

/// The motion hardware, with the timers of the two encoders.
pub struct Motion<A: GeneralInstance4Channel, B: GeneralInstance4Channel> {
    drives: &'static Drives,
    analog: Analog,
    encoders: (Qei<'static, A>, Qei<'static, B>),
    directions: [Option<Output<'static>>; CHANNELS],
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
        Self { drives, analog, encoders, directions, driven: Outputs::default() }
    }
}

/// Encoder inputs, with pull-ups for open collectors.
pub fn encoder_inputs() -> qei::Config {
    qei::Config { ch1_pull: Pull::Up, ch2_pull: Pull::Up, ..Default::default() }
}

impl<A: GeneralInstance4Channel, B: GeneralInstance4Channel> MotionPort for Motion<A, B> {
    fn sample(&mut self) -> MotionInputs {
        self.analog.check();
        MotionInputs {
            potentiometers: Analog::potentiometers(),
            currents: Analog::currents(),
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
