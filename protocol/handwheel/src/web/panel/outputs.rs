//! What an armed page writes besides motors: servos, GPIO, the LCD, counts, faults.

use std::time::Duration;

use protocol::extension::{Action, Request};
use protocol::pms5005::{Command, LcdFrame, Scope};
use serde_json::{Map, Value};

use super::exchanges::Purpose;
use super::message::{member, ms, number, text};
use super::{Asker, Panel};
use crate::Number;
use crate::motion::target;

impl Panel {
    /// What an armed page asks for, but settings.
    pub(super) fn act(
        &mut self,
        what: &str,
        asker: Asker,
        object: &Map<String, Value>,
    ) -> Result<(), String> {
        self.alive(asker.0);
        if self.motion.stop.is_some() {
            return Err("a stop is under way".into());
        }
        match what {
            "drive" => self.drive(asker, object),
            "step" => self.step(asker, object),
            "check" | "tune" => self.begin_job(what, asker, object),
            "off" => {
                let motor = member(object, "motor")?;
                self.end(motor, Some(asker), "it was switched off");
                Ok(())
            }
            "servo" => self.servo(asker, object),
            "lcd" => self.lcd(asker, object),
            "gpio" => {
                let outputs = number(object, "outputs", 0, 255)? as u8;
                self.tells.gpio = Some(outputs);
                self.command(&Command::GpioOutputs(outputs), Purpose::Page(asker, "GPIO"));
                self.tell_outputs();
                Ok(())
            }
            "zero" => {
                let motor = member(object, "motor")?;
                self.needs_no_job()?;
                let request = Request::SetCount { channel: motor.channel().number(), count: 0 };
                self.ask(&request, Purpose::Page(asker, "a new count"));
                Ok(())
            }
            "clear" => self.clear(asker, object),
            other => Err(format!("{other}: nothing of this name can be done")),
        }
    }

    fn servo(&mut self, asker: Asker, object: &Map<String, Value>) -> Result<(), String> {
        let servo = member(object, "servo")?;
        let time = ms(object, "ms", 0, i64::from(u16::MAX))?;
        let command = match object.get("us") {
            Some(Value::Null) => Command::Run { scope: Scope::Servo(servo.channel()), run: false },
            pulse => {
                let pulse = pulse.and_then(Value::as_f64);
                let pulse = pulse.ok_or("us: a pulse in microseconds is wanted, or null")?;
                target::servo(servo, pulse, time).map_err(|error| error.to_string())?
            }
        };
        self.motion.ramps[servo.index()] = self.now + time;
        self.command(&command, Purpose::Servo(asker));
        Ok(())
    }

    /// Servos that are on the way where a page has sent them stay where they are.
    pub(super) fn hold_servos(&mut self) {
        self.withdraw(|purpose| matches!(purpose, Purpose::Servo(_)), "its page was disarmed");
        for servo in Number::all() {
            let is_under_way = self.motion.ramps[servo.index()] > self.now;
            let pulse = self.tells.state.map_or(0, |state| state.servos[servo.index()]);
            let us = f64::from(pulse) / 2.25;
            if is_under_way
                && pulse > 0
                && let Ok(command) = target::servo(servo, us, Duration::ZERO)
            {
                self.command(&command, Purpose::Quiet);
            }
        }
        self.motion.ramps = Default::default();
    }

    fn clear(&mut self, asker: Asker, object: &Map<String, Value>) -> Result<(), String> {
        const WHAT: &str = "a clearing of its faults";
        if object.contains_key("motor") {
            let motor = member(object, "motor")?;
            // A resume of a motor that is only paused would move it.
            if !self.board.has_fault(motor) {
                return Err(format!("motor {motor} has no fault on record"));
            }
            let resume = Command::Run { scope: Scope::Motor(motor.channel()), run: true };
            self.command(&resume, Purpose::Page(asker, WHAT));
        } else {
            self.ask(&Request::Do(Action::ClearFaults), Purpose::Page(asker, WHAT));
        }
        self.board.look_soon(self.now);
        Ok(())
    }

    fn lcd(&mut self, asker: Asker, object: &Map<String, Value>) -> Result<(), String> {
        const BYTES: usize = 16 * LcdFrame::COLUMNS;
        let digits = text(object, "image")?;
        let byte = |pair: &[u8]| u8::from_str_radix(std::str::from_utf8(pair).ok()?, 16).ok();
        let bytes: Option<Vec<u8>> = digits.as_bytes().chunks(2).map(byte).collect();
        let bytes = bytes.filter(|bytes| bytes.len() == BYTES && digits.len() == 2 * BYTES);
        let wanted = || format!("image: {} hex digits are wanted", 2 * BYTES);
        let bytes = bytes.ok_or_else(wanted)?;
        self.tells.lcd = Some(digits.to_lowercase());
        self.tells.lcd_error = None;
        let parts = bytes.as_chunks::<{ LcdFrame::COLUMNS }>().0;
        for (number, columns) in (0u8..).zip(parts) {
            let is_last = usize::from(number) + 1 == parts.len();
            let command = Command::Lcd(LcdFrame { number, columns });
            self.command(&command, Purpose::Lcd(is_last.then_some(asker)));
        }
        self.tell_outputs();
        Ok(())
    }

    /// A part of a picture was shown, or not; the last one's answer tells of all.
    pub(super) fn lcd_is_heard(&mut self, last: Option<Asker>, result: Result<(), String>) {
        if let Err(error) = result {
            self.tells.lcd_error.get_or_insert(error);
        }
        if let Some(asker) = last {
            let result = self.tells.lcd_error.take().map_or(Ok(Value::Null), Err);
            self.answer(asker, result);
        }
    }
}
