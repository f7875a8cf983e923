//! Between the wire's words and the controller's: motion commands one way, reports the other.

use protocol::pms5005::{
    self as wire, CustomIoReport, Encoder, Gain, Loop, MotorReport, Move, Parameter, Parameters,
    Quantity, Report, Reports, SensorReport,
};

use crate::channel::{CHANNELS, Channel, Method, Polarity, Scope, Sensor};
use crate::command::Command;
use crate::controller::{EncoderReading, Snapshot};
use crate::settings::{ControlSettings, Settings};
use crate::units::Duty;

/// The wire's motion command in the controller's vocabulary; its DID is where it comes from.
pub(super) fn motion(command: &Move) -> Command {
    let origin = command.did();
    let Move { mut targets, periods, .. } = *command;
    match command.quantity {
        Quantity::Position => {
            Command::MoveMotors { method: Method::Position, targets, periods, origin }
        }
        Quantity::Velocity => {
            Command::MoveMotors { method: Method::Velocity, targets, periods, origin }
        }
        Quantity::Pwm => {
            targets.iter_mut().flatten().for_each(|target| *target = duty(*target));
            Command::MoveMotors { method: Method::Pwm, targets, periods, origin }
        }
        Quantity::Servo => Command::MoveServos { targets, periods },
    }
}

/// The settings with a frame's parameters. Of two values for the same the later counts.
pub(super) fn with_parameters(settings: &Settings, parameters: Parameters<'_>) -> Settings {
    let mut settings = *settings;
    let read_ki = ki_reading(settings.link.ki_reading);
    let ControlSettings { channels, collision, .. } = &mut settings.control;
    for parameter in parameters.iter() {
        match parameter {
            Parameter::CollisionProtection(on) => collision.enabled = on,
            Parameter::Polarity(channel, wire) => {
                of(channel, channels.each_mut()).polarity = match wire {
                    wire::Polarity::Positive => Polarity::Positive,
                    wire::Polarity::Negative => Polarity::Negative,
                };
            }
            Parameter::Sensor(channel, wire) => {
                of(channel, channels.each_mut()).sensor = Some(match wire {
                    wire::Sensor::SinglePotentiometer => Sensor::SinglePotentiometer,
                    wire::Sensor::DualPotentiometer => Sensor::DualPotentiometer,
                    wire::Sensor::Encoder => Sensor::Encoder,
                });
            }
            Parameter::Method(channel, wire) => {
                of(channel, channels.each_mut()).method = Some(match wire {
                    wire::Method::Pwm => Method::Pwm,
                    wire::Method::Position => Method::Position,
                    wire::Method::Velocity => Method::Velocity,
                });
            }
            Parameter::Gain(channel, control_loop, gain) => {
                let channel = of(channel, channels.each_mut());
                let gains = match control_loop {
                    Loop::Position => &mut channel.position,
                    Loop::Velocity => &mut channel.velocity,
                };
                match gain {
                    Gain::Proportional(kp) => gains.kp = kp,
                    Gain::Derivative(kd) => gains.kd = kd,
                    Gain::Integral { integer, fraction } => {
                        gains.ki_hundredths = read_ki([integer, fraction]);
                    }
                }
            }
        }
    }
    settings
}

/// That of the six which belongs to a channel of the wire.
fn of<T>(channel: wire::Channel, [c0, c1, c2, c3, c4, c5]: [T; CHANNELS]) -> T {
    match channel {
        wire::Channel::Channel0 => c0,
        wire::Channel::Channel1 => c1,
        wire::Channel::Channel2 => c2,
        wire::Channel::Channel3 => c3,
        wire::Channel::Channel4 => c4,
        wire::Channel::Channel5 => c5,
    }
}

/// Whom a suspend or a resume is about.
pub(super) fn scope(scope: wire::Scope) -> Scope {
    match scope {
        wire::Scope::All => Scope::All,
        wire::Scope::Motor(channel) => Scope::Motor(of(channel, Channel::ALL)),
        wire::Scope::Servo(channel) => Scope::Servo(of(channel, Channel::ALL)),
    }
}

/// How the two bytes of Ki become hundredths, by setting 2; hosts disagree.
fn ki_reading(setting: u8) -> impl Fn([u8; 2]) -> u16 {
    move |[integer, fraction]| {
        let whole = u16::from(integer) * 100;
        match setting {
            // M + N/100: the manual's "integer part, fraction part" in decimal.
            0 => whole + u16::from(fraction),
            // M + N/256: the manual's table taken as fixed point.
            1 => whole + ((u16::from(fraction) * 100) >> 8),
            // A 16-bit number of hundredths, low byte first: what public hosts send.
            _ => u16::from_le_bytes([integer, fraction]),
        }
    }
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
