//! Between the wire's words and the controller's: motion commands one way, reports the other.

use protocol::pms5005::{
    CustomIoReport, Encoder, Gain, Loop, Method, MotorReport, Move, Parameter, Parameters,
    Quantity, Report, Reports, SensorReport,
};

use crate::command::Command;
use crate::controller::{EncoderReading, Snapshot};
use crate::settings::{ControlSettings, Settings};
use crate::units::Duty;

/// The wire's motion command in the controller's vocabulary.
pub(super) fn motion(command: &Move) -> Command {
    let Move { mut targets, periods, .. } = *command;
    match command.quantity {
        Quantity::Position => Command::Drive { method: Method::Position, targets, periods },
        Quantity::Velocity => Command::Drive { method: Method::Velocity, targets, periods },
        Quantity::Pwm => {
            targets.iter_mut().flatten().for_each(|target| *target = duty(*target));
            Command::Drive { method: Method::Pwm, targets, periods }
        }
        Quantity::Servo => Command::MoveServos { targets, periods },
    }
}

/// The settings with a frame's parameters. Of two values for the same the later counts.
pub(super) fn with_parameters(settings: &Settings, parameters: Parameters<'_>) -> Settings {
    let mut settings = *settings;
    let ControlSettings { channels, collision, ki_reading, .. } = &mut settings.control;
    for parameter in parameters.iter() {
        match parameter {
            Parameter::CollisionProtection(on) => collision.enabled = on,
            Parameter::Polarity(channel, polarity) => channels[channel.index()].polarity = polarity,
            Parameter::Sensor(channel, sensor) => channels[channel.index()].sensor = Some(sensor),
            Parameter::Method(channel, method) => channels[channel.index()].method = Some(method),
            Parameter::Gain(channel, control_loop, gain) => {
                let channel = &mut channels[channel.index()];
                let gains = match control_loop {
                    Loop::Position => &mut channel.position,
                    Loop::Velocity => &mut channel.velocity,
                };
                match gain {
                    Gain::Proportional(kp) => gains.kp = kp,
                    Gain::Derivative(kd) => gains.kd = kd,
                    Gain::Integral { integer, fraction } => {
                        gains.ki_hundredths = ki_reading.hundredths([integer, fraction]);
                    }
                }
            }
        }
    }
    settings
}

/// PWM 0 to 32767 as a raw duty. Neutral is 16384; hosts use 16383 too, and both mean stop.
fn duty(pwm: i16) -> i16 {
    match pwm - Duty::FULL {
        -1 => 0,
        duty => duty,
    }
}

/// A report of what is true now.
pub(super) fn report(reports: Reports, snapshot: &Snapshot) -> Report {
    let sensors = &snapshot.sensors;
    match reports {
        Reports::CustomIo => Report::CustomIo(CustomIoReport {
            custom_ad: sensors.custom_ad,
            inputs: sensors.gpio_in,
        }),
        Reports::Sensors => Report::Sensors(SensorReport {
            sonar_cm: sensors.sonar_cm,
            human: sensors.human,
            tilt: sensors.tilt,
            overheat: sensors.overheat,
            temperature: sensors.temperature,
            ir_range: sensors.ir_range,
            ir_command: sensors.ir_command,
            battery: sensors.battery,
            reference: sensors.reference,
        }),
        Reports::Motors | Reports::All => Report::Motors(MotorReport {
            potentiometers: snapshot.motion.potentiometers,
            currents: snapshot.motion.currents,
            encoders: snapshot.encoders.map(encoder),
        }),
    }
}

/// Table II.2 wants the speed as a magnitude and a direction bit. Rest counts as positive.
fn encoder(reading: EncoderReading) -> Encoder {
    let velocity: i32 = reading.velocity.saturating_round().to_num();
    Encoder {
        count: reading.count,
        speed: velocity.unsigned_abs().min(32767) as u16, // fits by the bound
        positive: velocity >= 0,
    }
}
