//! `watch`: the machine state live: a table on a terminal, CSV, or JSON, one object a line.
//!
//! It keeps nothing running, and says so when another host drives. What is wrong is always visible.

use std::fmt::Write as _;
use std::time::{Duration, Instant};

use protocol::arcos::{ArmStatus, Dialect, MotionBits};
use protocol::extension::{MachineState, flag};
use protocol::pms5005::Report;
use serde_json::{Value, json};

use super::{Context, DONE, Outcome, drives, numbers};
use crate::client::{Client, Servo, driven};
use crate::error::Error;
use crate::session::Personality;
use crate::state::Uptime;
use crate::words;

/// How often a terminal is drawn, and a block is printed where there is none.
const DRAW: Duration = Duration::from_millis(100);
const PRINT: Duration = Duration::from_secs(1);
/// How often an arm is asked.
const ASK_ARM: Duration = Duration::from_millis(200);
/// For how long another host may ask an arm for nothing until it counts as silent.
const SILENCE: Duration = Duration::from_secs(2);

/// When it ends, and when the next block is due.
struct Pace {
    end: Option<Instant>,
    next: Instant,
    csv: bool,
}

impl Context<'_, '_> {
    pub fn watch(&mut self, csv: bool, time: Option<Duration>) -> Outcome {
        self.holds();
        let mut client = self.connect()?;
        let now = Instant::now();
        let mut pace = Pace { end: time.map(|time| now + time), next: now, csv };
        match client.personality() {
            Personality::Pms5005 if client.has_state() => self.watch_states(&mut client, &mut pace),
            Personality::Pms5005 => self.watch_telemetry(&mut client, &mut pace),
            Personality::Arcos => self.watch_arm(&mut client, &mut pace),
            Personality::Cm5 => self.watch_servos(&mut client, &mut pace),
        }
    }

    fn is_over(&self, pace: &Pace) -> bool {
        self.interrupted() || pace.end.is_some_and(|end| Instant::now() >= end)
    }

    /// One line for programs, or a block for people when it is due.
    fn show(
        &mut self,
        pace: &mut Pace,
        object: Value,
        csv: &dyn Fn() -> String,
        block: &dyn Fn() -> String,
    ) -> Result<(), Error> {
        let gone = |error: std::io::Error| match error.kind() {
            std::io::ErrorKind::BrokenPipe => Error::NobodyReads,
            _ => Error::File(format!("standard output: {error}")),
        };
        if self.json {
            writeln!(self.io.out, "{object}").map_err(gone)?;
        } else if pace.csv {
            writeln!(self.io.out, "{}", csv()).map_err(gone)?;
        } else if Instant::now() >= pace.next {
            let draws = self.io.is_terminal;
            pace.next = Instant::now() + if draws { DRAW } else { PRINT };
            // From the top, each line and what is below it wiped.
            let text = match draws {
                true => format!("\x1b[H{}\x1b[J", block().replace('\n', "\x1b[K\n")),
                false => block(),
            };
            writeln!(self.io.out, "{text}").map_err(gone)?;
        }
        self.io.out.flush().map_err(gone)
    }

    fn watch_states(&mut self, client: &mut Client, pace: &mut Pace) -> Outcome {
        if pace.csv && !self.json {
            self.say(&csv_header());
        }
        let title = client.link().to_string();
        let mut clock = Uptime::default();
        let mut others = Vec::new();
        for state in client.states()? {
            let state = state?;
            // A table has no place for it.
            let driven = driven(&state);
            if pace.csv && !self.json && driven != others && !driven.is_empty() {
                self.remark(&drives(&driven));
            }
            others = driven;
            let time_ms = clock.unwrap(state.time_ms);
            self.show(pace, object(&state, time_ms), &|| csv(&state, time_ms), &|| {
                block(&state, time_ms, &title)
            })?;
            if self.is_over(pace) {
                break;
            }
        }
        Ok(DONE)
    }

    /// What older boards tell.
    fn watch_telemetry(&mut self, client: &mut Client, pace: &mut Pace) -> Outcome {
        if pace.csv && !self.json {
            let names = (1..=6).map(|n| format!("pot_{n},current_a_{n}")).collect::<Vec<_>>();
            self.say(&format!("count_1,speed_1,count_2,speed_2,{}", names.join(",")));
        }
        for report in client.reports()? {
            if let Report::Motors(told) = report? {
                let speeds = told.encoders.map(|e| {
                    let speed = i32::from(e.speed);
                    (e.count, if e.positive { speed } else { -speed })
                });
                let [(count_1, speed_1), (count_2, speed_2)] = speeds;
                let amperes = told.currents.map(words::amperes);
                let object = json!({
                    "counts": [count_1, count_2], "speeds": [speed_1, speed_2],
                    "potentiometers": told.potentiometers, "currents_a": amperes,
                });
                let pairs = || told.potentiometers.iter().zip(amperes);
                self.show(
                    pace,
                    object,
                    &|| {
                        let rest: Vec<_> = pairs().map(|(p, a)| format!("{p},{a:.3}")).collect();
                        format!("{count_1},{speed_1},{count_2},{speed_2},{}", rest.join(","))
                    },
                    &|| {
                        let mut text = format!(
                            "older firmware: telemetry only\nencoder 1 at {count_1}, {speed_1} counts/s; encoder 2 at {count_2}, {speed_2} counts/s\n"
                        );
                        for (n, (pot, a)) in (1..).zip(pairs()) {
                            let _ = writeln!(text, "motor {n}: potentiometer {pot}, {a:.2} A");
                        }
                        text
                    },
                )?;
            }
            if self.is_over(pace) {
                break;
            }
        }
        Ok(DONE)
    }

    /// An arm whose session is ours is asked; of another host's session only what it asks for is seen, as a
    /// question would be a sign of life, unless that host is silent.
    fn watch_arm(&mut self, client: &mut Client, pace: &mut Pace) -> Outcome {
        let mut is_guest = client.is_guest();
        let mut heard = Instant::now();
        if is_guest {
            self.remark("another host has the arm's session open: only what it asks for is seen");
        }
        if pace.csv && !self.json {
            self.say("powered,connected,p1,p2,p3,p4,p5,p6,m1,m2,m3,m4,m5,m6");
        }
        while !self.is_over(pace) {
            let status = match is_guest {
                true => {
                    match client.overheard_arm(ASK_ARM, Dialect::Manual(MotionBits::OneToSix))? {
                        Some(status) => {
                            heard = Instant::now();
                            status
                        }
                        None => {
                            if heard.elapsed() > SILENCE {
                                self.remark("its host is silent: the arm is asked from here");
                                is_guest = false;
                            }
                            continue;
                        }
                    }
                }
                false => {
                    std::thread::sleep(ASK_ARM);
                    client.arm_status()?
                }
            };
            let object = json!({
                "powered": status.powered, "connected": status.connected,
                "positions": status.positions, "moving": status.moving,
            });
            self.show(pace, object, &|| arm_csv(&status), &|| arm_block(&status))?;
        }
        Ok(DONE)
    }

    fn watch_servos(&mut self, client: &mut Client, pace: &mut Pace) -> Outcome {
        if pace.csv && !self.json {
            self.say("id,position,speed,load,voltage_dv,temperature_c");
        }
        for servos in client.servos()? {
            let servos = servos?;
            let list: Vec<_> = servos
                .iter()
                .map(|servo| {
                    let mut told = servo.json();
                    told["reports"] = servo.registers.is_some().into();
                    told
                })
                .collect();
            self.show(
                pace,
                json!({ "servos": list }),
                &|| servos.iter().map(servo_csv).collect::<Vec<_>>().join("\n"),
                &|| servos.iter().map(servo_line).collect(),
            )?;
            if self.is_over(pace) {
                break;
            }
        }
        Ok(DONE)
    }
}

fn block(state: &MachineState, time_ms: u64, title: &str) -> String {
    let [main, motors, servos] = words::volts(state.battery);
    let mut text = format!(
        "{title}   {}   board {main:.1} V   motors {motors:.1} V   servos {servos:.1} V   refused {}\n",
        words::duration(time_ms),
        state.refused
    );
    let mut warn = |bit: u8, warning: &str| {
        if state.flags & bit != 0 {
            let _ = writeln!(text, "! {warning}");
        }
    };
    warn(flag::FAULT, "a fault is on record: `handwheel faults` says which, and what to do");
    warn(flag::OBSTACLE, "the collision protection sees an obstacle");
    warn(flag::LINK_LOST, "no host drives: silent for longer than the link timeout");
    let others = driven(state);
    if !others.is_empty() {
        let _ = writeln!(text, "{}", drives(&others));
    }
    text += "motor  mode      set-point   position   velocity   duty %   current A   why\n";
    for (n, channel) in (1..).zip(&state.channels) {
        let _ = writeln!(
            text,
            "{n:<6} {:9} {:>9} {:>10} {:>10} {:>8.1} {:>11.2}   {}",
            words::mode(channel.mode),
            channel.set_point,
            channel.position,
            channel.velocity,
            words::percent(channel.duty),
            words::amperes(channel.current),
            words::reason(channel).unwrap_or_default()
        );
    }
    let pulses = state.servos.map(|counts| match counts {
        0 => "off".into(),
        counts => format!("{:.0}", pulse_us(counts)),
    });
    let _ = writeln!(text, "servos 1 to 6, us: {}", pulses.join("  "));
    text
}

fn pulse_us(counts: u16) -> f64 {
    f64::from(counts) / 2.25
}

fn object(state: &MachineState, time_ms: u64) -> Value {
    let [main, motors, servos] = words::volts(state.battery);
    let channels = (1..).zip(&state.channels).map(|(n, channel)| {
        json!({
            "motor": n,
            "mode": words::mode(channel.mode),
            "set_point": channel.set_point,
            "position": channel.position,
            "velocity": channel.velocity,
            "duty_percent": words::percent(channel.duty),
            "current_a": words::amperes(channel.current),
            "reason": words::reason(channel),
        })
    });
    json!({
        "time_ms": time_ms,
        "host_silent": state.flags & flag::LINK_LOST != 0,
        "obstacle": state.flags & flag::OBSTACLE != 0,
        "fault": state.flags & flag::FAULT != 0,
        "refused": state.refused,
        "batteries_v": { "board": main, "motors": motors, "servos": servos },
        "motors": channels.collect::<Vec<_>>(),
        "servos_us": state.servos.map(pulse_us),
        "driven_by_another_host": numbers(&driven(state)),
    })
}

fn csv_header() -> String {
    let mut text = String::from("time_ms,flags,refused,board_v,motors_v,servos_v");
    for n in 1..=6 {
        let _ = write!(
            text,
            ",mode_{n},set_point_{n},position_{n},velocity_{n},duty_percent_{n},current_a_{n},reason_{n}"
        );
    }
    (1..=6).for_each(|n| {
        let _ = write!(text, ",servo_us_{n}");
    });
    text
}

fn csv(state: &MachineState, time_ms: u64) -> String {
    let [main, motors, servos] = words::volts(state.battery);
    let mut text =
        format!("{time_ms},{},{},{main:.2},{motors:.2},{servos:.2}", state.flags, state.refused);
    for channel in &state.channels {
        let _ = write!(
            text,
            ",{},{},{},{},{:.2},{:.3},\"{}\"",
            words::mode(channel.mode),
            channel.set_point,
            channel.position,
            channel.velocity,
            words::percent(channel.duty),
            words::amperes(channel.current),
            words::reason(channel).unwrap_or_default().replace('"', "'")
        );
    }
    for counts in state.servos {
        let _ = write!(text, ",{:.0}", pulse_us(counts));
    }
    text
}

fn arm_csv(status: &ArmStatus) -> String {
    let positions = status.positions.map(|position| position.to_string()).join(",");
    let moving = status.moving.map(|moves| u8::from(moves).to_string()).join(",");
    format!("{},{},{positions},{moving}", u8::from(status.powered), u8::from(status.connected))
}

fn arm_block(status: &ArmStatus) -> String {
    let power = if status.powered { "on" } else { "off" };
    let arm = if status.connected { "connected" } else { "not connected" };
    let mut text = format!("arm {arm}, power {power}\n");
    for (n, (position, moves)) in (1..).zip(status.positions.iter().zip(status.moving)) {
        let _ =
            writeln!(text, "joint {n}: {position:>3} ticks{}", if moves { ", moving" } else { "" });
    }
    text
}

fn servo_csv(servo: &Servo) -> String {
    let registers = servo.registers.map(|all| all.map(|r| r.to_string()).join(","));
    format!("{},{}", servo.id, registers.unwrap_or_else(|| ",,,,".into()))
}

fn servo_line(servo: &Servo) -> String {
    match servo.registers {
        Some([position, speed, load, voltage, temperature]) => format!(
            "servo {:3}: position {position:4}, speed {speed:4}, load {load:4}, {:.1} V, {temperature} C\n",
            servo.id,
            f64::from(voltage) / 10.0
        ),
        None => format!(
            "servo {:3}: no report (it does not answer, or the CM-5 waits for its host)\n",
            servo.id
        ),
    }
}
