//! `servo`, `gpio`, `lcd`: what is set and stays.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use std::time::Duration;

use serde_json::json;

use super::{Context, DONE, Outcome};
use crate::error::Error;
use crate::number::Number;
use crate::picture;

impl Context<'_, '_> {
    pub fn servo(&mut self, servo: Number, pulse: f64, ramp: Option<Duration>) -> Outcome {
        let mut client = self.connect()?;
        client.servo(servo, pulse, ramp.unwrap_or_default())?;
        self.say(&format!("servo {servo}: {pulse} us; it holds until `handwheel stop`"));
        self.tell(&json!({ "servo": servo.index() + 1, "pulse_us": pulse }));
        Ok(DONE)
    }

    pub fn gpio(&mut self, outputs: u8) -> Outcome {
        let mut client = self.connect()?;
        client.gpio(outputs)?;
        self.say(&format!("outputs 7 to 0: {outputs:08b}"));
        self.tell(&json!({ "outputs": outputs }));
        Ok(DONE)
    }

    pub fn lcd(&mut self, file: &Path) -> Outcome {
        let shown = file.display();
        let wrong = |why: String| Error::File(format!("{shown}: {why}"));
        let opened = File::open(file).map_err(|error| wrong(error.to_string()))?;
        let image = picture::read(BufReader::new(opened)).map_err(wrong)?;
        let mut client = self.connect()?;
        client.lcd(&image)?;
        self.say(&format!("{shown} is on the LCD"));
        self.tell(&json!({ "picture": shown.to_string() }));
        Ok(DONE)
    }
}
