//! `pwm`, `velocity`, `position`, `stop`: what turns, and how it ends.

use std::time::Duration;

use serde_json::json;

use super::{ANSWER_IS_NO, Context, DONE, Hold, Outcome, drives, time};
use crate::client::{Client, Stopped};
use crate::error::Error;
use crate::link::Link;
use crate::motion::target::Target;
use crate::number::Number;
use crate::words;

/// At the very beginning a reason may still be of what was before.
const SETTLES: Duration = Duration::from_millis(200);

impl Context<'_, '_> {
    /// Drives a motor until its time is over, or Ctrl-C, and stops it.
    pub fn motion(&mut self, motor: Number, target: Target, hold: Hold) -> Outcome {
        let mut client = self.connect()?;
        self.holds();
        let interrupted = self.io.interrupt.wanted.clone();
        client.end_when(interrupted.clone());
        let mut drive = client.drive(motor, target, hold.ramp.unwrap_or_default())?;
        let end = match hold.time {
            Some(length) => format!("for {}", time(length)),
            None => "until Ctrl-C".into(),
        };
        self.say(&format!("motor {motor}: {target}, {end}"));
        if !drive.others().is_empty() {
            self.remark(&format!(
                "{}; this drive's signs of life keep it running too, also if that host dies",
                drives(drive.others())
            ));
        }
        let mut said = None;
        let held = drive.hold_while(|elapsed, state| {
            if let Some(state) = state {
                let reason = words::reason(&state.channels[motor.index()]);
                // What hinders it is always visible, once each.
                if reason != said && reason.is_some() && elapsed > SETTLES {
                    let text = reason.as_deref().unwrap_or_default();
                    let _ = writeln!(self.io.err, "handwheel: motor {motor}: {text}");
                }
                if elapsed > SETTLES {
                    said = reason;
                }
            }
            let is_over = hold.time.is_some_and(|length| elapsed >= length);
            !is_over && !interrupted.load(std::sync::atomic::Ordering::Relaxed)
        });
        let stopped = match held {
            Ok(()) => drive.stop()?,
            // Why it does not run is what matters, unless it may run on.
            Err(why @ Error::Stopped(_)) => match drive.stop() {
                Ok(_) => return Err(why),
                Err(stop) => {
                    self.remark(&why.to_string());
                    return Err(stop);
                }
            },
            Err(why) => {
                let _ = drive.stop();
                return Err(why);
            }
        };
        Ok(self.tell_stopped(motor, target, &stopped))
    }

    pub(super) fn tell_stopped(&mut self, motor: Number, target: Target, stopped: &Stopped) -> u8 {
        let turned = stopped
            .position
            .map_or(String::new(), |(at, turned)| format!(", turned {turned} counts, now at {at}"));
        let after = stopped.after.as_millis();
        self.say(&match stopped.stands {
            Some(true) => format!("motor {motor} stands, {after} ms after the stop{turned}"),
            Some(false) => {
                format!("motor {motor} has no drive and still turns after {after} ms{turned}")
            }
            None => format!("motor {motor} is stopped; nothing tells whether it stands"),
        });
        self.tell(&json!({
            "motor": motor.index() + 1,
            "target": target.to_string(),
            "stands": stopped.stands,
            "after_ms": after as u64,
            "position": stopped.position.map(|(at, _)| at),
            "turned": stopped.position.map(|(_, turned)| turned),
        }));
        if stopped.stands == Some(false) { ANSWER_IS_NO } else { DONE }
    }

    /// Stops everything.
    pub fn stop(&mut self) -> Outcome {
        let (_, stopped) = Client::connect_and_stop(&self.link.parse::<Link>()?)?;
        let after = stopped.after.as_millis();
        self.say(&match (stopped.confirmed, stopped.stands) {
            (false, _) if stopped.is_opposed => "stop sent and NOT confirmed: another host commands, and has driven on after it; end that host, or cut the motors' supply".into(),
            (false, _) => "stop sent and NOT confirmed: something drives on; another host may send commands: end it, or cut the motors' supply".into(),
            (true, Some(true)) => format!("everything is off and stands ({after} ms)"),
            (true, Some(false)) => format!("everything is off; a shaft still turns after {after} ms"),
            (true, None) => "stop acknowledged; this board does not tell whether the shafts stand".into(),
        });
        self.tell(&json!({
            "confirmed": stopped.confirmed,
            "another_host_commands": stopped.is_opposed,
            "stands": stopped.stands,
            "after_ms": after as u64,
        }));
        let is_good = stopped.confirmed && stopped.stands != Some(false);
        Ok(if is_good { DONE } else { ANSWER_IS_NO })
    }
}
