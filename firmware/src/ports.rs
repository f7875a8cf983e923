//! Ports: what hardware must offer. A board, QEMU and the virtual board differ in these and in
//! their clock, in nothing else.
//!
//! The host link needs no trait of ours: it is `embedded_io_async`'s `Read` and `Write`, where
//! one `write` call is one frame. Nor does the flash: it is `embedded_storage`'s
//! `NorFlash`, which blocks.

use crate::channel::{CHANNELS, ENCODERS};
use crate::units::{Duty, ServoPulse};

/// What is measured afresh for every control period. Aligned, and so copied word by word.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(align(4))]
pub struct MotionInputs {
    /// Potentiometers 1 to 6, A/D counts 0 to 4095.
    pub potentiometers: [u16; CHANNELS],
    /// Motor currents 1 to 6, A/D counts 0 to 4095.
    pub currents: [u16; CHANNELS],
    /// Quadrature counters of channels 0 and 1, 16 bits, wrapping.
    pub encoders: [u16; ENCODERS],
}

/// What is measured as fast as it comes, several times a second. Aligned, and so copied word by
/// word.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(align(4))]
pub struct Sensors {
    /// Custom A/D channels, A/D counts 0 to 4095.
    pub custom_ad: [u16; 8],
    /// Input port, bit 0 is input 0.
    pub gpio_in: u8,
    /// Ultrasonic ranges in cm, 255 when nothing is in range.
    pub sonar_cm: [u8; 6],
    /// Human sensors: alarm 1, motion 1, alarm 2, motion 2, A/D counts.
    pub human: [u16; 4],
    /// Tilt X and Y, A/D counts.
    pub tilt: [u16; 2],
    /// Temperatures of the motor drivers, A/D counts.
    pub overheat: [u16; 2],
    /// Ambient temperature, A/D counts.
    pub temperature: u16,
    /// Infrared range, A/D counts: the nearer, the more.
    pub ir_range: u16,
    /// Infrared remote control: key code, and 255 while the key is held.
    pub ir_command: [u8; 4],
    /// Main board, motor and servo batteries, A/D counts.
    pub battery: [u16; 3],
    /// Vcc and the potentiometers' Vref, A/D counts.
    pub reference: [u16; 2],
}

impl Sensors {
    /// Before the first reading: no obstacle, nothing else known.
    pub const UNKNOWN: Self = Self {
        custom_ad: [0; 8],
        gpio_in: 0,
        sonar_cm: [255; 6],
        human: [0; 4],
        tilt: [0; 2],
        overheat: [0; 2],
        temperature: 0,
        ir_range: 0,
        ir_command: [0; 4],
        battery: [0; 3],
        reference: [0; 2],
    };
}

/// One DC bridge. Disabled means that it neither drives nor brakes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MotorOutput {
    /// Its drive. Neutral whenever it is disabled.
    pub duty: Duty,
    /// Its enable line.
    pub enabled: bool,
}

/// Everything the controller drives. The default is the safe state: bridges neutral and disabled,
/// servos without pulses, outputs low. Aligned, and so copied word by word.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(align(4))]
pub struct Outputs {
    /// DC channels 0 to 5.
    pub motors: [MotorOutput; CHANNELS],
    /// Servo channels 0 to 5; `None` is no pulse.
    pub servos: [Option<ServoPulse>; CHANNELS],
    /// Output port, bit 0 is GPIO0.
    pub gpio: u8,
}

impl Outputs {
    /// Whether nothing is driven: every bridge disabled, every servo without pulses.
    pub fn are_off(&self) -> bool {
        self.motors.iter().all(|motor| !motor.enabled) && self.servos.iter().all(Option::is_none)
    }
}

/// The bank of motion hardware: one call each way a control period, so that a period is one
/// coherent picture.
pub trait MotionPort {
    /// Reads the inputs. Called at the beginning of every control period; must not block.
    fn sample(&mut self) -> MotionInputs;
    /// Sets all outputs. Called once every control period; must not block.
    fn drive(&mut self, outputs: &Outputs);
}

/// The sensors that take their time.
#[allow(async_fn_in_trait)] // polled in place on one executor; no Send is asked for
pub trait SensorPort {
    /// One reading of all of them, whenever it is complete.
    async fn read(&mut self) -> Sensors;
}

/// The 128 x 64 display.
#[allow(async_fn_in_trait)] // as above
pub trait LcdPort {
    /// Shows frame `number` (0 to 15: even left, odd right, from the top): 64 columns of 8
    /// pixels, the least significant bit on top. A display that fails keeps its old picture.
    async fn show(&mut self, number: u8, columns: &[u8; 64]);
}

/// What the processor can start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Program {
    /// This firmware, from its beginning.
    Firmware,
    /// The ROM's loader for new firmware over USB.
    DfuLoader,
}

/// Why the board has started.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ResetCause {
    /// Not known.
    Unknown,
    /// Power came on, or came back.
    Power,
    /// The reset pin.
    Pin,
    /// The program restarted itself.
    Software,
    /// The watchdog: a task had hung, or the program had failed.
    Watchdog,
}

/// The processor and its watchdog.
pub trait SystemPort {
    /// Feeds the watchdog before flash is erased: it must bear
    /// [`ERASE_PERIOD`](crate::liveness::ERASE_PERIOD) until it is fed again.
    fn before_erase(&mut self);
    /// Whether this program can be started.
    fn can_start(&self, program: Program) -> bool;
    /// Starts it. On hardware this does not return.
    fn start(&mut self, program: Program);
}
