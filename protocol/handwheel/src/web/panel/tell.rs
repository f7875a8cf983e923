//! What pages are told: the board's words made JSON.

use std::time::Duration;

use protocol::arcos::ArmStatus;
use protocol::cm5::Feedback;
use protocol::extension::{FaultRecord, MachineState, Mode, flag};
use protocol::pms5005::{CustomIoReport, MotorReport, Report, SensorReport};
use serde_json::{Map, Value, json};

use super::{PageId, Panel};
use crate::Number;
use crate::motion::target::unwrapped;
use crate::servo::Servo;
use crate::session::{Personality, Setting};
use crate::state::Uptime;
use crate::words;

/// The least time between two messages of sensors.
const SENSORS: Duration = Duration::from_millis(100);

/// The same of states, which come every 20 ms unless the board is told otherwise.
const STATE: Duration = Duration::from_millis(18);

/// What was told last, for pages that come later.
#[derive(Default)]
pub(super) struct Tells {
    uptime: Uptime,
    pub(super) state: Option<MachineState>,
    motors: MotorReport,
    sensors: SensorReport,
    custom: CustomIoReport,
    /// When sensors are told next.
    due: Duration,
    servos: Vec<u8>,
    /// What pages have set.
    pub(super) gpio: Option<u8>,
    pub(super) lcd: Option<String>,
    /// What went wrong first with the picture that is being sent.
    pub(super) lcd_error: Option<String>,
    /// When a state is told next.
    state_due: Duration,
}

impl Tells {
    /// The board is gone; its time goes on.
    pub(super) fn forget(&mut self) {
        *self = Self { uptime: std::mem::take(&mut self.uptime), ..Self::default() };
    }
}

impl Panel {
    /// What the board is called.
    pub(super) fn title(&self) -> &'static str {
        match self.personality() {
            Personality::Pms5005 => "PMS5005",
            Personality::Arcos => "Pioneer Arm",
            Personality::Cm5 => "CM-5",
        }
    }

    fn board_json(&self) -> Value {
        let kind = match self.personality() {
            Personality::Pms5005 => "pms5005",
            Personality::Arcos => "pioneer-arm",
            Personality::Cm5 => "cm5",
        };
        let identity = self.board.identity;
        json!({
            "tell": "board", "link": self.link.to_string(), "connected": self.is_connected(),
            "why": self.why, "kind": kind, "title": self.title(),
            "firmware": identity.map(|i| i.version.map(|part| part.to_string()).join(".")),
            "extension": identity.map(|i| i.extension),
            "start": identity.map(|i| words::reset(i.reset)),
            "origin": identity.map(|i| words::origin(i.settings)),
            "has_state": self.has_state(), "is_virtual": self.is_virtual,
        })
    }

    fn armed_json(&self, page: PageId) -> Value {
        let armed = self.motion.armed_page();
        let by = armed.map(|armed| self.page_name(armed));
        json!({ "tell": "armed", "by": by, "you": armed == Some(page) })
    }

    fn faults_json(&self) -> Value {
        json!({ "tell": "faults", "faults": self.board.faults.iter().map(fault).collect::<Vec<_>>() })
    }

    fn settings_json(&self) -> Value {
        let list: Vec<_> = self.settings.list().iter().map(setting).collect();
        json!({ "tell": "settings", "settings": list, "unsaved": self.settings.unsaved })
    }

    fn outputs_json(&self) -> Value {
        json!({ "tell": "outputs", "gpio": self.tells.gpio, "lcd": self.tells.lcd })
    }

    pub(super) fn tell_all_about(&mut self, page: PageId) {
        let all = [
            self.board_json(),
            self.armed_json(page),
            self.faults_json(),
            self.settings_json(),
            self.outputs_json(),
            self.job_json(),
        ];
        all.iter().for_each(|message| self.tell_one(page, message));
    }

    pub(super) fn tell_board(&mut self) {
        let board = self.board_json();
        self.tell(&board);
    }

    pub(super) fn tell_armed(&mut self) {
        let pages: Vec<_> = self.pages.iter().map(|(page, _)| *page).collect();
        for page in pages {
            let armed = self.armed_json(page);
            self.tell_one(page, &armed);
        }
    }

    pub(super) fn tell_settings(&mut self) {
        let settings = self.settings_json();
        self.tell(&settings);
    }

    pub(super) fn tell_outputs(&mut self) {
        let outputs = self.outputs_json();
        self.tell(&outputs);
    }

    pub(super) fn tell_faults(&mut self) {
        let faults = self.faults_json();
        self.tell(&faults);
    }

    pub(super) fn tell_state(&mut self, state: &MachineState) {
        self.tells.state = Some(*state);
        let ms = self.tells.uptime.unwrap(state.time_ms);
        if self.now < self.tells.state_due {
            return;
        }
        self.tells.state_due = self.now + STATE;
        let motors: Vec<_> = Number::all()
            .map(|motor| {
                let channel = &state.channels[motor.index()];
                let set_point = match channel.mode {
                    Mode::Pwm => rounded(words::percent(channel.set_point), 100.0).into(),
                    // The wire's positions wrap; it is the turn that the shaft is on.
                    Mode::Position => unwrapped(channel.set_point.into(), channel.position).into(),
                    _ => Value::from(channel.set_point),
                };
                json!({
                    "mode": words::mode(channel.mode), "set_point": set_point,
                    "position": channel.position, "velocity": channel.velocity,
                    "duty": rounded(words::percent(channel.duty), 100.0),
                    "current": rounded(words::amperes(channel.current), 1000.0),
                    "reason": words::reason(channel), "ours": self.motion.is_ours(motor),
                })
            })
            .collect();
        let pulse = |counts: u16| (counts > 0).then(|| rounded(f64::from(counts) / 2.25, 10.0));
        self.tell(&json!({
            "tell": "state", "ms": ms,
            "silent": state.flags & flag::LINK_LOST != 0,
            "obstacle": state.flags & flag::OBSTACLE != 0,
            "fault": state.flags & flag::FAULT != 0,
            "refused": state.refused,
            "battery_v": words::volts(state.battery).map(|volts| rounded(volts, 100.0)),
            "servos_us": state.servos.map(pulse),
            "motors": motors,
        }));
    }

    pub(super) fn tell_report(&mut self, report: &Report) {
        match report {
            Report::Motors(motors) => self.tells.motors = *motors,
            Report::CustomIo(custom) => self.tells.custom = *custom,
            Report::Sensors(sensors) => self.tells.sensors = *sensors,
        }
        if self.now < self.tells.due {
            return;
        }
        self.tells.due = self.now + SENSORS;
        let Tells { motors, sensors, custom, .. } = &self.tells;
        let message = json!({
            "tell": "sensors", "sonar_cm": sensors.sonar_cm,
            "ir_cm": rounded(words::infrared_cm(sensors.ir_range), 10.0),
            "human": sensors.human, "tilt": sensors.tilt, "overheat": sensors.overheat,
            "temperature": sensors.temperature, "custom": custom.custom_ad,
            "reference": sensors.reference, "potentiometers": motors.potentiometers,
            "inputs": custom.inputs, "remote": sensors.ir_command,
        });
        self.tell(&message);
    }

    pub(super) fn tell_health(&mut self) {
        let board = &self.board;
        let object = |named: Vec<(&'static str, u32)>| {
            named
                .into_iter()
                .map(|(name, count)| (name.to_owned(), json!(count)))
                .collect::<Map<_, _>>()
        };
        let counters = board.counters.map(|all| object(all.named().collect()));
        let refusals = board.refusals.map(|all| object(all.named().collect()));
        let health = board.health;
        self.tell(&json!({
            "tell": "health",
            "uptime_ms": health.map(|h| h.uptime_ms),
            "latency_us": health.map(|h| h.worst_latency_us),
            "stack": health.map(|h| h.stack_used),
            "missed": health.map(|h| h.periods_missed),
            "faults": health.map(|h| h.faults),
            "counters": counters, "refusals": refusals,
            "frames": board.rates.0.round(), "bytes": board.rates.1.round(),
        }));
    }

    pub(super) fn tell_joints(&mut self, status: &ArmStatus) {
        let joints: Vec<_> = status
            .positions
            .iter()
            .zip(status.moving)
            .map(|(position, moving)| json!({ "position": position, "moving": moving }))
            .collect();
        self.tell(&json!({
            "tell": "joints", "powered": status.powered, "connected": status.connected,
            "joints": joints,
        }));
    }

    /// A CM-5 tells which servos there are, or how those are.
    pub(super) fn tell_servos(&mut self, ids: &[u8], told: &[Option<Feedback>]) {
        if !ids.is_empty() {
            self.tells.servos = ids.to_vec();
        }
        let told = told.iter().copied().chain(std::iter::repeat(None));
        let servos = self.tells.servos.iter().zip(told);
        let servos: Vec<_> = servos.map(|(&id, told)| Servo::of(id, told).json()).collect();
        self.tell(&json!({ "tell": "servos", "servos": servos }));
    }
}

fn fault(record: &FaultRecord) -> Value {
    json!({
        "number": record.fault.number(), "name": words::fault(record.fault),
        "whose": words::whose(record), "motor": record.channel.map(|channel| channel + 1),
        "ms": record.uptime_ms, "remedy": words::remedy(record.fault),
        "values": words::values(record),
    })
}

fn setting(setting: &Setting) -> Value {
    json!({
        "name": setting.name, "group": words::group(&setting.name), "value": setting.value,
        "default": setting.default, "low": setting.range.0, "high": setting.range.1,
        "unit": words::unit(setting.unit),
    })
}

/// A number with as many digits as are worth telling.
pub(super) fn rounded(value: f64, parts: f64) -> f64 {
    (value * parts).round() / parts
}
