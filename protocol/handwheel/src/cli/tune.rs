//! `check` and `tune`: what is said before anything turns, and what was found.

use std::path::Path;
use std::sync::atomic::Ordering;
use std::time::Duration;

use serde_json::{Value, json};

use super::plot::draw;
use super::{Context, DONE, Outcome};
use crate::client::Client;
use crate::error::Error;
use crate::number::Number;
use crate::settings::LINK_TIMEOUT;
use crate::step::{Response, Sample};
use crate::tune::{
    Checked, Loop, Options, Plan, Tuned, check, highest_duty_of, plan, sensor_of, tune,
};
use crate::words;

/// How a motor is driven, and who says that it may be.
#[derive(Clone, Copy, Debug)]
pub struct Permission {
    /// The highest duty, 0 to 1.
    pub highest_duty: f64,
    /// Nobody is to be asked.
    pub yes: bool,
}

impl Context<'_, '_> {
    /// Checks the wiring of a motor.
    pub fn check(&mut self, motor: Number, set_polarity: bool, permission: Permission) -> Outcome {
        let mut client = self.connect()?;
        let duty = self.before(&mut client, motor, permission)?;
        let travel = format!(
            "a moment each way, half a second at the most; {}",
            travel(&mut client, motor, duty, 0.41)?
        );
        if !self.may(motor, duty, &travel, permission.yes) {
            return Err(Error::Stopped("nothing was done".into()));
        }
        let job = check(motor, duty, set_polarity);
        let checked = self.run_job(&mut client, motor, job)?;
        self.say_checked(motor, &checked);
        if checked.turned_round {
            self.say("its polarity was turned round; `handwheel save` keeps that");
        }
        self.tell(&checked_in_json(motor, &checked));
        Ok(DONE)
    }

    /// Tunes a motor.
    pub fn tune(
        &mut self,
        motor: Number,
        control_loop: Option<Loop>,
        apply: bool,
        svg: Option<&Path>,
        permission: Permission,
    ) -> Outcome {
        let mut client = self.connect()?;
        let highest_duty = self.before(&mut client, motor, permission)?;
        let sensor = client.numbered(sensor_of(motor))?.value;
        let travel = match plan(motor, sensor) {
            Plan::Turns(time) => {
                let seconds = time.as_secs_f64();
                let way = travel(&mut client, motor, highest_duty, seconds / 2.0)?;
                format!("it turns freely, {seconds:.0} s in all at the most, both ways; {way}")
            }
            Plan::Stays(counts) => format!("it stays within {counts} counts of where it stands"),
        };
        if !self.may(motor, highest_duty, &travel, permission.yes) {
            return Err(Error::Stopped("nothing was done".into()));
        }
        let job = tune(Options { motor, control_loop, highest_duty, apply });
        let before = client.settings()?;
        let tuned = self.run_job(&mut client, motor, job)?;
        self.say_tuned(motor, &tuned);
        let settings: Vec<_> = tuned
            .settings
            .iter()
            .map(|&(number, value)| {
                let old = before.iter().find(|setting| setting.number == number);
                let name =
                    old.map_or_else(|| words::setting(number), |setting| setting.name.clone());
                (name, old.map_or(0, |setting| setting.value), value)
            })
            .collect();
        for (name, old, new) in &settings {
            self.say(&format!("  {name}: {new} (was {old})"));
        }
        self.say(match apply {
            true => "in force; `handwheel save` keeps it, a restart brings back what was",
            false => "as it was again; with --apply it is put in force",
        });
        if let Some(file) = svg {
            let title = format!("motor {motor}: step to {}", tuned.step.target);
            draw(file, &title, tuned.control_loop.unit(), &samples(&tuned), tuned.step.target)
                .map_err(Error::File)?;
            self.say(&format!("drawn in {}", file.display()));
        }
        self.tell(&tuned_in_json(motor, &tuned, apply, &settings));
        Ok(DONE)
    }

    /// Looks at what else there is, and yields the duty that is driven at the most: the channel's own may be lower.
    fn before(
        &mut self,
        client: &mut Client,
        motor: Number,
        permission: Permission,
    ) -> Result<f64, Error> {
        client.needs_a_recorder()?;
        self.others(client)?;
        if client.numbered(LINK_TIMEOUT)?.value == 0 {
            self.remark(
                "link timeout is 0: if this program dies meanwhile, nothing stops the motor",
            );
        }
        let own = f64::from(client.numbered(highest_duty_of(motor))?.value) / 16_384.0;
        Ok(permission.highest_duty.min(own))
    }

    fn run_job<T>(
        &mut self,
        client: &mut Client,
        motor: Number,
        job: crate::tune::Job<T>,
    ) -> Result<T, Error> {
        self.holds();
        client.end_when(self.io.interrupt.wanted.clone());
        let is_quiet = self.json;
        let err = &mut *self.io.err;
        client.run(motor, job, |doing| {
            if !is_quiet {
                let _ = writeln!(err, "handwheel: motor {motor}: {doing}");
            }
        })
    }

    /// Says what is going to happen, and asks whether it may, if there is somebody to ask.
    fn may(&mut self, motor: Number, duty: f64, travel: &str, yes: bool) -> bool {
        let plan = format!(
            "motor {motor}: at most {:.0} % of full drive; {travel}. Ctrl-C stops it.",
            duty * 100.0
        );
        self.say(&plan);
        let Some(keyboard) = self.io.keyboard.as_mut().filter(|_| !yes) else { return true };
        if self.json {
            let _ = writeln!(self.io.err, "{plan}");
        }
        let _ = write!(self.io.err, "Is it free to move? [y/N] ");
        let _ = self.io.err.flush();
        let mut line = String::new();
        let _ = keyboard.read_line(&mut line); // nothing is no
        let is_free = matches!(line.trim(), "y" | "Y" | "yes");
        is_free && !self.io.interrupt.wanted.load(Ordering::Relaxed)
    }

    fn say_checked(&mut self, motor: Number, checked: &Checked) {
        let [rising, falling] = checked.ways;
        self.say(&format!(
            "motor {motor}: {} counts forward at {:.0} %, {} back at {:.0} %: its sensor counts the right way",
            rising.moved,
            rising.duty * 100.0,
            falling.moved,
            falling.duty * 100.0
        ));
        if !checked.has_current {
            self.remark(&format!(
                "motor {motor}: no current was seen; without a current sensor set \"current sensor {motor}\" to 0"
            ));
        }
    }

    fn say_tuned(&mut self, motor: Number, tuned: &Tuned) {
        self.say_checked(motor, &tuned.checked);
        let found = &tuned.fit.motor;
        let [rising, falling] = found.dead_band.map(|band| band * 100.0);
        self.say(&format!(
            "full speed            {:.0} counts/s beyond a dead band of {rising:.1} % forward, {falling:.1} % back",
            found.gain
        ));
        self.say(&format!("time constant         {:.0} ms", found.time_constant * 1000.0));
        self.say(&format!("dead time             {:.1} ms", found.dead_time * 1000.0));
        self.say(&format!("fit                   {:.1} %", tuned.fit.percent));
        self.say(&format!("lambda                {:.0} ms", tuned.design.lambda * 1000.0));
        let said = |response: &Response| {
            format!(
                "overshoot {:.1} %, settled after {}",
                response.overshoot_percent,
                response
                    .settling
                    .map_or("(never)".into(), |time| format!("{} ms", time.as_millis()))
            )
        };
        self.say(&format!("predicted             {}", said(&tuned.design.response)));
        self.say(&format!(
            "confirmed by a step   {} (to {:.0} {})",
            said(&tuned.response),
            tuned.step.target,
            tuned.control_loop.unit()
        ));
    }
}

/// How far it goes in this time, by the full speed that is set.
fn travel(client: &mut Client, motor: Number, duty: f64, seconds: f64) -> Result<String, Error> {
    let speed = crate::tune::full_speed_set(motor, |number| {
        client.numbered(number).map(|setting| setting.value)
    })?;
    let counts = duty * f64::from(speed) * seconds;
    Ok(format!(
        "{counts:.0} counts at the most if its full speed is the {speed} counts/s that is set"
    ))
}

fn samples(tuned: &Tuned) -> Vec<Sample> {
    let time = |n: u32| Duration::from_secs_f64(f64::from(n) * tuned.interval);
    let values = (0..).zip(tuned.values.iter().zip(&tuned.duties));
    values.map(|(n, (&value, &duty))| Sample { time: time(n), value, duty }).collect()
}

fn checked_in_json(motor: Number, checked: &Checked) -> Value {
    let ways = checked.ways.map(
        |way| json!({ "moved": way.moved, "current": way.current, "duty_percent": way.duty * 100.0 }),
    );
    json!({
        "motor": motor.index() + 1,
        "ways": ways,
        "has_current": checked.has_current,
        "turned_round": checked.turned_round,
    })
}

fn tuned_in_json(
    motor: Number,
    tuned: &Tuned,
    applied: bool,
    settings: &[(String, i32, i32)],
) -> Value {
    let found = &tuned.fit.motor;
    let told = |response: &Response| {
        let ms = |time: Option<Duration>| time.map(|time| time.as_millis() as u64);
        json!({
            "rise_ms": ms(response.rise),
            "overshoot_percent": response.overshoot_percent,
            "settling_ms": ms(response.settling),
            "steady_error": response.steady_error,
        })
    };
    let settings: Vec<_> = settings
        .iter()
        .map(|(name, before, value)| json!({ "name": name, "before": before, "value": value }))
        .collect();
    json!({
        "motor": motor.index() + 1,
        "checked": checked_in_json(motor, &tuned.checked),
        "gain": found.gain,
        "time_constant_s": found.time_constant,
        "dead_time_s": found.dead_time,
        "dead_band": found.dead_band,
        "fit_percent": tuned.fit.percent,
        "lambda_s": tuned.design.lambda,
        "unit": tuned.control_loop.unit(),
        "target": tuned.step.target,
        "predicted": told(&tuned.design.response),
        "measured": told(&tuned.response),
        "settings": settings,
        "applied": applied,
        "interval_s": tuned.interval,
        "values": tuned.values,
    })
}
