//! `faults`, `zero`, `dfu`.

use protocol::extension::FaultRecord;
use serde_json::{Map, Value, json};

use super::{ANSWER_IS_NO, Context, DONE, Outcome};
use crate::client::Client;
use crate::error::Error;
use crate::number::Number;
use crate::session::Personality;
use crate::words;

impl Context<'_, '_> {
    /// What tripped, when, the values then, what to check; or clears it.
    pub fn faults(&mut self, clear: bool) -> Outcome {
        let mut client = self.connect()?;
        needs_the_extension(&client, "faults on record")?;
        if clear {
            client.clear_faults()?;
        }
        let (faults, uptime_ms) = (client.faults()?, client.health()?.uptime_ms);
        for fault in &faults {
            self.say(&words_of(fault, uptime_ms));
        }
        if faults.is_empty() {
            self.say(if clear { "cleared; no fault is left" } else { "no faults" });
        } else if clear {
            self.say("cleared, but for these: their cause is still there");
        }
        let list: Vec<_> = faults.iter().map(|fault| object(fault, uptime_ms)).collect();
        self.tell(&json!({ "faults": list, "cleared": clear }));
        Ok(if clear && !faults.is_empty() { ANSWER_IS_NO } else { DONE })
    }

    /// Sets an encoder's count.
    pub fn zero(&mut self, motor: Number, count: i32) -> Outcome {
        let mut client = self.connect()?;
        client.set_count(motor, count)?;
        self.say(&format!("the encoder of motor {motor} is at {count}"));
        self.tell(&json!({ "motor": motor.index() + 1, "count": count }));
        Ok(DONE)
    }

    /// Enters the loader, and prints what to type next.
    pub fn dfu(&mut self) -> Outcome {
        let mut client = self.connect()?;
        needs_the_extension(&client, "loader that can be entered")?;
        client.reboot_into_dfu()?;
        let image = match client.personality() {
            Personality::Arcos => "pioneer-arm-f407",
            _ => "pms5005-f407",
        };
        let next = format!("dfu-util -a 0 -s :leave -D target/images/{image}.dfu");
        self.say(&format!("the board is in its loader (USB); type next:\n  {next}"));
        self.tell(&json!({ "next": next }));
        Ok(DONE)
    }
}

fn needs_the_extension(client: &Client, what: &'static str) -> Result<(), Error> {
    match client.identity() {
        Some(_) => Ok(()),
        None => Err(Error::NotCarried(client.personality(), what, " that this protocol tells of")),
    }
}

/// How long ago it tripped.
fn ago_ms(fault: &FaultRecord, uptime_ms: u32) -> u64 {
    uptime_ms.saturating_sub(fault.uptime_ms).into()
}

/// A fault in two lines.
pub fn words_of(fault: &FaultRecord, uptime_ms: u32) -> String {
    let values: Vec<_> =
        words::values(fault).into_iter().map(|(name, value)| format!("{name} {value}")).collect();
    let then =
        if values.is_empty() { String::new() } else { format!("; then: {}", values.join(", ")) };
    format!(
        "{} of {} (fault {}), {} ago{then}\n    {}",
        words::fault(fault.fault),
        words::whose(fault),
        fault.fault.number(),
        words::duration(ago_ms(fault, uptime_ms)),
        words::remedy(fault.fault),
    )
}

/// A fault for programs.
pub fn object(fault: &FaultRecord, uptime_ms: u32) -> Value {
    let values: Map<_, _> = words::values(fault)
        .into_iter()
        .map(|(name, value)| (name.to_owned(), value.into()))
        .collect();
    json!({
        "number": fault.fault.number(),
        "name": words::fault(fault.fault),
        "channel": fault.channel.map(|channel| u16::from(channel) + 1),
        "uptime_ms": fault.uptime_ms,
        "ago_ms": ago_ms(fault, uptime_ms),
        "values": values,
        "check": words::remedy(fault.fault),
    })
}
