//! `info`: what it is, since when and why, how it is, and what is wrong.

use protocol::extension::{Counters, MachineState};
use serde_json::{Map, Value, json};

use super::{Context, DONE, Outcome, drives, numbers, upkeep};
use crate::client::{Client, driven};
use crate::error::Error;
use crate::session::Personality;
use crate::words;

impl Context<'_, '_> {
    /// Never keeps anything running.
    pub fn info(&mut self) -> Outcome {
        let mut client = self.connect()?;
        let personality = client.personality();
        self.say(&format!("{personality} at {}", client.link()));
        let mut object = Map::new();
        object.insert("board".into(), personality.to_string().into());
        object.insert("link".into(), client.link().to_string().into());
        match personality {
            Personality::Cm5 => self.cm5(&mut client, &mut object)?,
            Personality::Arcos => self.arm(&mut client, &mut object)?,
            Personality::Pms5005 => {}
        }
        if client.identity().is_some() {
            self.extension(&mut client, &mut object)?;
        } else if personality == Personality::Pms5005 {
            self.say("an original, or a firmware without the extension: motion and telemetry, no settings, health or faults");
        }
        if let Some(state) = client.state_at_rest()? {
            self.state(&state, &mut object);
        }
        self.tell(&Value::Object(object));
        Ok(DONE)
    }

    /// What the extension tells, on whatever line.
    fn extension(
        &mut self,
        client: &mut Client,
        object: &mut Map<String, Value>,
    ) -> Result<(), Error> {
        let Some(identity) = client.identity() else { return Ok(()) };
        let [major, minor, patch] = identity.version;
        let (health, counters, faults) = (client.health()?, client.counters()?, client.faults()?);
        let uptime = words::duration(health.uptime_ms.into());
        let stack = match health.stack_used {
            0 => "unknown".into(),
            bytes => format!("{bytes} bytes"),
        };
        self.say(&format!("firmware {major}.{minor}.{patch}, extension {}", identity.extension));
        self.say(&format!("up {uptime}; started {}", words::reset(identity.reset)));
        self.say(&format!("settings at its start: {}", words::origin(identity.settings)));
        self.say(&format!(
            "worst control latency {} us, {} control periods missed, stack used {stack}",
            health.worst_latency_us, health.periods_missed
        ));
        self.say(&line(&counters));
        // Older versions do not know why.
        let refusals = if identity.extension >= 2 { Some(client.refusals()?) } else { None };
        let reasons: Vec<_> = refusals.iter().flat_map(|all| all.named()).collect();
        let refused: Vec<_> = reasons
            .iter()
            .filter(|(_, count)| *count > 0)
            .map(|(reason, count)| format!("{count} for {}", reason.replace('_', " ")))
            .collect();
        if !refused.is_empty() {
            self.say(&format!("refused: {}", refused.join(", ")));
        }
        match faults.len() {
            0 => self.say("no faults"),
            _ => faults.iter().for_each(|f| self.say(&upkeep::words_of(f, health.uptime_ms))),
        }
        let more = usize::from(health.faults).saturating_sub(faults.len());
        if more > 0 {
            self.say(&format!("and {more} more faults, of which only the number is known"));
        }
        object.insert("firmware".into(), format!("{major}.{minor}.{patch}").into());
        object.insert("extension".into(), identity.extension.into());
        object.insert("uptime_ms".into(), health.uptime_ms.into());
        object.insert("started".into(), words::reset(identity.reset).into());
        object.insert("settings_at_its_start".into(), words::origin(identity.settings).into());
        object.insert(
            "health".into(),
            json!({
                "worst_latency_us": health.worst_latency_us,
                "periods_missed": health.periods_missed,
                "stack_used": health.stack_used,
                "faults": health.faults,
            }),
        );
        object.insert("counters".into(), counters.named().collect_object());
        object.insert("refusals".into(), reasons.into_iter().collect_object());
        let faults: Vec<_> =
            faults.iter().map(|fault| upkeep::object(fault, health.uptime_ms)).collect();
        object.insert("faults".into(), faults.into());
        Ok(())
    }

    fn state(&mut self, state: &MachineState, object: &mut Map<String, Value>) {
        let [main, motors, servos] = words::volts(state.battery);
        self.say(&format!(
            "batteries: board {main:.1} V, motors {motors:.1} V, servos {servos:.1} V"
        ));
        let others = driven(state);
        if !others.is_empty() {
            self.say(&drives(&others));
        }
        object.insert(
            "batteries_v".into(),
            json!({ "board": main, "motors": motors, "servos": servos }),
        );
        object.insert("driven_by_another_host".into(), numbers(&others));
    }

    fn arm(&mut self, client: &mut Client, object: &mut Map<String, Value>) -> Result<(), Error> {
        let is_guest = client.is_guest();
        let arm = client.arm()?;
        if let Some([name, class, subclass]) = &arm.names {
            self.say(&format!("robot {name}, {class} {subclass}"));
            object.insert("robot".into(), json!([name, class, subclass]));
        }
        if is_guest {
            self.say("another host has its session open; what is asked here counts as a sign of life for 2 s");
        }
        self.say(&match &arm.version {
            Some(version) => {
                format!("arm {version}, power {}", if arm.status.powered { "on" } else { "off" })
            }
            None => "no arm is connected".into(),
        });
        let joints = (1..).zip(arm.joints.iter().zip(arm.status.positions));
        let joints: Vec<_> = joints.map(|(n, (joint, at))| json!({
            "joint": n, "position": at, "home": joint.home, "min": joint.min, "centre": joint.centre,
            "max": joint.max, "ms_per_tick": joint.ms_per_tick, "ticks_per_90": joint.ticks_per_90,
        })).collect();
        self.say(&format!("joints 1 to 6 at {} ticks", list(&arm.status.positions)));
        object.insert("arm".into(), arm.version.into());
        object.insert("powered".into(), arm.status.powered.into());
        object.insert("joints".into(), joints.into());
        object.insert("another_host_has_the_session".into(), is_guest.into());
        Ok(())
    }

    fn cm5(&mut self, client: &mut Client, object: &mut Map<String, Value>) -> Result<(), Error> {
        let mut servos = client.servos()?;
        let ids = servos.ids()?.to_vec();
        self.say(&format!("{} servos: {}", ids.len(), list(&ids)));
        self.say("it tells no version, health or faults, and has no settings: its protocol has no words for them");
        object.insert("servos".into(), json!(ids));
        Ok(())
    }
}

fn list(numbers: &[u8]) -> String {
    numbers.iter().map(u8::to_string).collect::<Vec<_>>().join(", ")
}

fn line(counters: &Counters) -> String {
    format!(
        "line: {} frames, {} damaged, {} refused, {} not for this board; host silent {} times",
        counters.frames_ok,
        counters.bad_frames,
        counters.refused + counters.commands_refused,
        counters.not_for_us,
        counters.links_lost
    )
}

/// Named numbers as an object.
trait CollectObject {
    fn collect_object(self) -> Value;
}

impl<T: Iterator<Item = (&'static str, u32)>> CollectObject for T {
    fn collect_object(self) -> Value {
        Value::Object(self.map(|(name, count)| (name.to_owned(), count.into())).collect())
    }
}
