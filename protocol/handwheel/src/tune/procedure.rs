//! How a motor is tuned: what it is, gains for it, and a step that confirms them.
//!
//! | | a wheel, with an encoder | a joint, with a potentiometer |
//! |---|---|---|
//! | the wiring | a moment each way ([`check`](super::check())) | the same |
//! | the motor | a ramp each way, then steps between two duties each way | pushed to and fro about where it stands |
//! | confirmed by | a step from rest to half of the speed that the duty allows | a step of that way |

use std::time::Duration;

use protocol::extension::{ChannelState, Mode, Row};

use super::check::{Checked, ENOUGH_OF_POTENTIOMETER, REST, both_ways};
use super::fit::{Fit, LONGEST_DEAD_TIME, Record, fit};
use super::gains::{Design, Loop, Step, design, every_period, expect};
use super::hand::Hand;
use super::job::{Job, Refused, set_back};
use super::model::{Motor, PERIOD};
use crate::motion::target::{TURN, Target};
use crate::number::Number;
use crate::settings::LINK_TIMEOUT;
use crate::step::{Response, response};

/// What is to be tuned, and what it may take.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Which.
    pub motor: Number,
    /// Which loop; `None` is that of velocities for an encoder, of positions for a potentiometer.
    pub control_loop: Option<Loop>,
    /// The highest duty, 0 to 1.
    pub highest_duty: f64,
    /// Whether the gains stay in force when they are confirmed.
    pub apply: bool,
}

impl Options {
    /// The highest duty unless told otherwise.
    pub const HIGHEST_DUTY: f64 = 0.5;
}

/// What a motor that is tuned turned out to be.
#[derive(Clone, Debug, PartialEq)]
pub struct Tuned {
    /// Its wiring.
    pub checked: Checked,
    /// The motor, and how well it explains what was recorded.
    pub fit: Fit,
    /// Which loop was tuned.
    pub control_loop: Loop,
    /// Gains, and what they are expected to do.
    pub design: Design,
    /// The step that confirmed them: to this target, with no more duty than that.
    pub step: Step,
    /// What came of it, as the board saw it.
    pub response: Response,
    /// What it was, a sample every so many seconds: value and duty.
    pub interval: f64,
    /// The values: counts, or counts per second.
    pub values: Vec<f64>,
    /// The duties, -1 to 1.
    pub duties: Vec<f64>,
    /// The settings that make it so, by their numbers.
    pub settings: Vec<(u16, i32)>,
}

impl Tuned {
    /// What the values were to be.
    pub fn predicted(&self) -> Vec<f64> {
        expected(&self.design, self.interval, self.values.len())
    }

    /// What the loop is expected to make of another step, in this time.
    pub fn expects(&self, step: Step, time: Duration) -> Option<Response> {
        expect(&self.fit.motor, self.control_loop, self.design.gains, step, time)
    }
}

/// What it will do at the most, for whoever is asked whether it may.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Plan {
    /// It turns freely, for so long in all, at this duty at the most.
    Turns(Duration),
    /// It stays within so many counts of where it stands.
    Stays(i32),
}

// The settings of a channel: the number of channel 1, and how far it is to the next one's.
pub(super) const SENSOR: (u16, u16) = (214, 10);
const METHOD: (u16, u16) = (215, 10);
pub(super) const POLARITY: (u16, u16) = (216, 10);
const FULL_SPEED: (u16, u16) = (217, 10);
const POSITION: [(u16, u16); 3] = [(208, 10), (209, 10), (210, 10)];
const VELOCITY: [(u16, u16); 3] = [(211, 10), (212, 10), (213, 10)];
const RESET: (u16, u16) = (268, 1);
const LOOK_AHEAD: (u16, u16) = (274, 1);
const SLEW: (u16, u16) = (180, 4);
const ACCELERATION: (u16, u16) = (181, 4);
const HIGHEST: (u16, u16) = (182, 4);
const SHARE: (u16, u16) = (183, 4);
const LOW_LIMIT: (u16, u16) = (80, 2);
const HIGH_LIMIT: (u16, u16) = (81, 2);
/// All that are changed meanwhile, and set back.
const CHANGED: [(u16, u16); 9] =
    [SENSOR, METHOD, FULL_SPEED, RESET, LOOK_AHEAD, SLEW, ACCELERATION, HIGHEST, SHARE];

/// The number of a motor's setting.
pub(super) fn numbered((first, step): (u16, u16), motor: Number) -> u16 {
    first + step * motor.index() as u16 // 5 at the most
}

/// An encoder, and two potentiometers, as setting "sensor" has them.
const ENCODER: i32 = 3;
const TWO_POTENTIOMETERS: i32 = 2;
/// Full drive.
const FULL: f64 = 16_384.0;
/// A potentiometer's scale, and how far from its ends a joint is kept.
const SCALE: i32 = 4096;
const SCALE_OF_TWO: i32 = 4428;
const MARGIN: i32 = 80;
/// How far a joint is moved either way, and how far it may be carried on.
const TRAVEL: i32 = 160;
const CARRIED: i32 = 3;

/// What a motor was set to before anything was changed.
pub(super) struct Before {
    motor: Number,
    /// Their numbers and values.
    values: Vec<(u16, i32)>,
    pub(super) reversed: bool,
    pub(super) encoder: bool,
    limits: (i32, i32),
}

impl Before {
    pub(super) async fn read(hand: &Hand) -> Result<Self, Refused> {
        let motor = hand.motor;
        let rows = CHANGED.into_iter().chain(POSITION).chain(VELOCITY);
        let mut values = Vec::new();
        for row in rows {
            let number = numbered(row, motor);
            values.push((number, hand.get(number).await?));
        }
        let reversed = hand.get(numbered(POLARITY, motor)).await? != 0;
        hand.lives(hand.get(LINK_TIMEOUT).await?);
        let low = hand.get(numbered(LOW_LIMIT, motor)).await?;
        let high = hand.get(numbered(HIGH_LIMIT, motor)).await?;
        let mut before = Self { motor, values, reversed, encoder: false, limits: (low, high) };
        before.encoder = has_encoder(motor, before.value(SENSOR));
        Ok(before)
    }

    fn value(&self, row: (u16, u16)) -> i32 {
        let number = numbered(row, self.motor);
        self.values.iter().find(|(n, _)| *n == number).map_or(0, |(_, value)| *value)
    }

    /// Sets what a plain motor needs, and yields the highest duty: the channel's own may be lower.
    pub(super) async fn prepare(&self, hand: &Hand, most: f64) -> Result<f64, Refused> {
        let at = |row| numbered(row, self.motor);
        let highest = ((most * FULL).round() as i32).clamp(1, self.value(HIGHEST));
        let sensor = if self.encoder { ENCODER } else { self.value(SENSOR).max(1) };
        let plain = [
            (at(SENSOR), sensor),
            (at(METHOD), 0),
            (at(SLEW), 0),
            (at(ACCELERATION), 0),
            (at(HIGHEST), highest),
            (at(SHARE), FULL as i32),
        ];
        hand.set(&plain).await?;
        Ok(f64::from(highest) / FULL)
    }

    /// Sets everything back but what these say.
    pub(super) async fn restore(&self, hand: &Hand, but: &[(u16, i32)]) -> Result<(), Refused> {
        let of = |&(number, value): &(u16, i32)| {
            let new = but.iter().find(|(n, _)| *n == number);
            new.copied().unwrap_or((number, value))
        };
        let values: Vec<_> = self.values.iter().map(of).collect();
        hand.set(&values).await
    }

    /// Between what a joint may be.
    fn room(&self) -> (i32, i32) {
        let (low, high) = self.limits;
        let scale = if self.value(SENSOR) == TWO_POTENTIOMETERS { SCALE_OF_TWO } else { SCALE };
        let has_limits = low < high && high < scale;
        if has_limits { (low, high) } else { (MARGIN, scale - MARGIN) }
    }
}

/// What a motor with this value of its setting "sensor" will do at the most when it is tuned.
pub fn plan(motor: Number, sensor: i32) -> Plan {
    match has_encoder(motor, sensor) {
        true => Plan::Turns(TURNS),
        false => Plan::Stays(TRAVEL * CARRIED),
    }
}

/// The number of a motor's setting "sensor".
pub fn sensor_of(motor: Number) -> u16 {
    numbered(SENSOR, motor)
}

/// The number of a motor's setting "highest duty", which holds whatever is allowed.
pub fn highest_duty_of(motor: Number) -> u16 {
    numbered(HIGHEST, motor)
}

/// The full speed that is set for a motor, in counts per second, by the values of settings.
///
/// # Errors
/// That of a value that is not known.
pub fn full_speed_set<E>(
    motor: Number,
    mut value: impl FnMut(u16) -> Result<i32, E>,
) -> Result<i32, E> {
    const OF_ENCODERS: u16 = 3;
    const OF_POTENTIOMETERS: u16 = 4;
    match value(numbered(FULL_SPEED, motor))? {
        0 if has_encoder(motor, value(sensor_of(motor))?) => value(OF_ENCODERS),
        0 => value(OF_POTENTIOMETERS),
        own => Ok(own),
    }
}

/// As commands imply: motors 1 and 2 have encoders unless their setting says otherwise.
fn has_encoder(motor: Number, sensor: i32) -> bool {
    sensor == ENCODER || sensor == 0 && motor.index() < 2
}

/// Reads a recording, once it is done.
pub fn read(serial: u8) -> Job<Vec<Row>> {
    Job::new(move |shared| async move { Hand::new(shared, Number::ONE).rows(serial).await })
}

/// How long a wheel turns in all, at the most.
const TURNS: Duration = Duration::from_secs(30);

/// Tunes a motor.
pub fn tune(options: Options) -> Job<Tuned> {
    Job::new(move |shared| async move {
        let mut hand = Hand::new(shared, options.motor);
        hand.begin("reads its settings");
        let before = Before::read(&hand).await?;
        let tuned = procedure(&mut hand, &before, &options).await;
        hand.says("switches it off");
        let off = hand.end().await;
        let kept: &[_] = match &tuned {
            Ok(tuned) if options.apply && off.is_ok() => &tuned.settings,
            _ => &[],
        };
        let back = before.restore(&hand, kept).await;
        set_back(tuned, off.and(back))
    })
}

async fn procedure(hand: &mut Hand, before: &Before, options: &Options) -> Result<Tuned, Refused> {
    let most = before.prepare(hand, options.highest_duty).await?;
    let at = hand.state().await?;
    if !before.encoder {
        if options.control_loop == Some(Loop::Velocity) {
            return Err(Refused::NotAJoint);
        }
        let ((low, high), most) = (before.room(), TRAVEL * CARRIED);
        if at.position - most < low || at.position + most > high {
            return Err(Refused::NoRoom(at.position, low, high));
        }
        hand.stays(at.position - most, at.position + most);
    }
    let checked = both_ways(hand, before, most).await?;
    hand.says("finds out what it is");
    let records = match before.encoder {
        true => turn(hand, before, most).await?,
        false => {
            let duty = checked.ways[0].duty.max(checked.ways[1].duty);
            vec![push(hand, before, duty, at.position).await?]
        }
    };
    let fit = fit(&records).ok_or(Refused::NoMotion)?;
    if fit.percent < WORST_FIT || fit.motor.dead_time >= LONGEST_DEAD_TIME {
        return Err(Refused::PoorFit(fit.percent));
    }
    let default = if before.encoder { Loop::Velocity } else { Loop::Position };
    let control_loop = options.control_loop.unwrap_or(default);
    let step = step(&fit.motor, control_loop, before.encoder, most)?;
    hand.says("looks for gains");
    let design = design(&fit.motor, control_loop, step).ok_or(Refused::NoLoop)?;
    let settings = settings(options.motor, &fit.motor, control_loop, &design);
    hand.set(&settings).await?;
    hand.says("confirms them by a step");
    let Course { interval, values, duties } = confirm(hand, control_loop, step, &design).await?;
    let response = compare(&design, control_loop, step, interval, &values)?;
    Ok(Tuned {
        checked,
        fit,
        control_loop,
        design,
        step,
        response,
        interval,
        values,
        duties,
        settings,
    })
}

/// A fit that is poorer than this is no motor's. Whole counts of a coarse encoder cost up to 15 %.
const WORST_FIT: f64 = 70.0;
/// Rows that are read of one recording; they take some 4 s at 115200 baud.
const ROWS: u16 = 2000;
/// A ramp up to the highest duty, and down from there; both of them each way, and the rows for that.
const UP: Duration = Duration::from_millis(800);
const DOWN: Duration = Duration::from_millis(300);
const RAMPS: Duration = Duration::from_millis(2300);
const ROWS_OF_RAMPS: u16 = 460;

/// Turns a wheel: a ramp each way, then steps between two duties that are found by it.
async fn turn(hand: &mut Hand, before: &Before, most: f64) -> Result<Vec<Record>, Refused> {
    let recording = hand.record(RAMPS, ROWS_OF_RAMPS).await?;
    for sign in [1.0, -1.0] {
        for (duty, time) in [(sign * most, UP), (0.0, DOWN)] {
            hand.drive(duty_of(before, duty), time).await?;
            hand.watch(hand.now() + time, |_| false).await?;
        }
    }
    hand.rest(REST).await?;
    let ramps = record(before, &hand.rows(recording.serial).await?, recording.decimation);
    let found = fit(std::slice::from_ref(&ramps)).ok_or(Refused::NoMotion)?;
    let Motor { time_constant, dead_band, .. } = found.motor;
    if dead_band.iter().any(|band| *band > most * 0.75) {
        return Err(Refused::NoMotion);
    }
    let long = (2.5 * time_constant).clamp(0.12, 1.1);
    let total = (6.0 * long).max(SHORTEST);
    let cycles = (total / (6.0 * long)).floor().max(1.0) as u32;
    let time = Duration::from_secs_f64(f64::from(cycles) * 6.2 * long);
    let recording = hand.record(time, ROWS).await?;
    for _ in 0..cycles {
        for (sign, band) in [1.0, -1.0].into_iter().zip(dead_band) {
            let [low, high] = [0.35, 1.0].map(|part| sign * (band + part * (most - band)));
            for duty in [low, high, low] {
                hand.drive(duty_of(before, duty), Duration::ZERO).await?;
                hand.watch(hand.now() + Duration::from_secs_f64(long), |_| false).await?;
            }
        }
    }
    hand.rest(REST).await?;
    let steps = record(before, &hand.rows(recording.serial).await?, recording.decimation);
    Ok(vec![steps])
}

/// Steps are recorded for so long at the least, in seconds.
const SHORTEST: f64 = 3.0;

/// One push of a joint, seen as if its way were up.
struct Push {
    middle: i32,
    sign: i32,
    /// How far it goes on when it is turned round.
    coast: i32,
    /// Where it was last, and the least that it was from the middle on its way.
    last: i32,
    nearest: i32,
}

impl Push {
    fn here(&self) -> i32 {
        (self.last - self.middle) * self.sign
    }

    fn is_there(&self) -> bool {
        self.here() + self.coast >= TRAVEL
    }

    /// Whether it is to be turned round.
    fn sees(&mut self, at: &ChannelState) -> bool {
        /// What a state is late, and a command, in seconds.
        const LATE: f64 = 0.04;
        self.last = at.position;
        self.nearest = self.nearest.min(self.here());
        let ahead = (f64::from(at.velocity) * LATE) as i32 * self.sign;
        self.is_there() || self.here() + ahead >= TRAVEL
    }
}

/// Pushes a joint to and fro about where it stands, by a duty that has been seen to move it.
async fn push(hand: &mut Hand, before: &Before, duty: f64, middle: i32) -> Result<Record, Refused> {
    const PUSHES: u32 = 8;
    const LONGEST: Duration = Duration::from_millis(500);
    /// A push that moves nothing in this time has lost its sensor, or is held.
    const STANDS: Duration = Duration::from_millis(200);
    let recording = hand.record(LONGEST * PUSHES / 2, ROWS).await?;
    // How far it goes on when it is turned round: the push before has shown it.
    let (mut coast, mut turned) = (TRAVEL * 3 / 4, middle);
    for n in 0..PUSHES {
        let sign = if n % 2 == 0 { 1 } else { -1 };
        let mut push = Push { middle, sign, coast, last: turned, nearest: i32::MAX };
        hand.drive(duty_of(before, f64::from(sign) * duty), Duration::ZERO).await?;
        let began = hand.now();
        hand.watch(began + STANDS, |at| push.sees(at)).await?;
        if !push.is_there() {
            if push.here() - push.nearest < ENOUGH_OF_POTENTIOMETER {
                return Err(Refused::Stuck);
            }
            hand.watch(began + LONGEST, |at| push.sees(at)).await?;
        }
        if n > 0 {
            coast = (turned - middle) * sign - push.nearest;
        }
        turned = push.last;
    }
    hand.rest(REST).await?;
    Ok(record(before, &hand.rows(recording.serial).await?, recording.decimation))
}

/// The duty that makes counts rise, if it is positive.
pub(super) fn duty_of(before: &Before, duty: f64) -> Target {
    Target::Duty(if before.reversed { -duty } else { duty })
}

/// What was recorded, as a fit takes it.
fn record(before: &Before, rows: &[Row], every: u16) -> Record {
    let sign = if before.reversed { -1.0 } else { 1.0 };
    // A motor that is off is no motor on its bridge any more.
    let on = rows.iter().position(|row| row.mode == Mode::Off).unwrap_or(rows.len());
    let rows = rows.get(..on).unwrap_or_default();
    let first = rows.first().map_or(0, |row| row.position);
    Record {
        every: every.into(),
        duty: rows.iter().map(|row| sign * f64::from(row.duty) / FULL).collect(),
        position: rows.iter().map(|row| row.position.wrapping_sub(first).into()).collect(),
    }
}

/// The step that confirms: to half of what the duty allows.
fn step(motor: &Motor, control_loop: Loop, is_encoder: bool, most: f64) -> Result<Step, Refused> {
    let fastest = motor.steady(most).min(-motor.steady(-most));
    let target = match control_loop {
        Loop::Velocity => (fastest / 2.0).min(i16::MAX.into()),
        // What it goes in a third of a second, or a joint's travel.
        Loop::Position if is_encoder => (fastest / 3.0).clamp(20.0, 8000.0),
        Loop::Position => TRAVEL.into(),
    };
    let target = target.round();
    if target < 1.0 { Err(Refused::NoMotion) } else { Ok(Step { target, most }) }
}

/// The settings that a design is.
fn settings(motor: Number, found: &Motor, control_loop: Loop, design: &Design) -> Vec<(u16, i32)> {
    let at = |row| numbered(row, motor);
    let gains = &design.gains;
    let rows = if control_loop == Loop::Velocity { VELOCITY } else { POSITION };
    let [kp, kd, ki] = rows.map(at);
    let mut settings = vec![
        (kp, gains.kp.into()),
        (kd, gains.kd.into()),
        (ki, 0),
        (at(FULL_SPEED), found.gain.round() as i32),
    ];
    if control_loop == Loop::Velocity {
        settings.extend([(at(RESET), gains.reset_ms.into()), (at(LOOK_AHEAD), 0)]);
    }
    settings
}

/// How a step went.
struct Course {
    /// In seconds.
    interval: f64,
    values: Vec<f64>,
    duties: Vec<f64>,
}

/// Makes the step, and reads how it went.
async fn confirm(
    hand: &mut Hand,
    control_loop: Loop,
    step: Step,
    design: &Design,
) -> Result<Course, Refused> {
    let settling = design.response.settling.unwrap_or_default();
    let time = (settling.mul_f64(1.5) + Duration::from_millis(300)).min(Duration::from_secs(6));
    let recording = hand.record(time, ROWS / 4).await?;
    hand.afresh().await?;
    let from = hand.state().await?.position;
    let target = match control_loop {
        Loop::Velocity => Target::Velocity(step.target as i16),
        Loop::Position => {
            Target::Position(from.wrapping_add(step.target as i32).rem_euclid(TURN) as i16)
        }
    };
    hand.drive(target, Duration::ZERO).await?;
    hand.watch(hand.now() + time, |_| false).await?;
    hand.rest(REST).await?;
    let rows = hand.rows(recording.serial).await?;
    let value = |row: &Row| match control_loop {
        Loop::Velocity => f64::from(row.velocity),
        Loop::Position => f64::from(row.position.wrapping_sub(from)),
    };
    Ok(Course {
        interval: f64::from(recording.decimation) * PERIOD,
        values: rows.iter().map(value).collect(),
        duties: rows.iter().map(|row| f64::from(row.duty) / FULL).collect(),
    })
}

/// Compares a step with what was predicted of it: its response, if it was so.
fn compare(
    design: &Design,
    control_loop: Loop,
    step: Step,
    interval: f64,
    values: &[f64],
) -> Result<Response, Refused> {
    /// The board's estimate of a velocity is as coarse as its counts: the mean of so long, in seconds.
    const MEAN: f64 = 0.05;
    const OVERSHOOT: f64 = 10.0;
    const SETTLING: f64 = 1.2;
    const APART: f64 = 0.12;
    let every = (interval / PERIOD).round() as usize;
    let expected = expected(design, interval, values.len());
    // A converter is noisy too.
    let mean = if control_loop == Loop::Velocity { MEAN } else { MEAN / 2.0 };
    let width = (mean / interval) as usize;
    let (values, expected) = (means(values, width), means(&expected, width));
    let told = |values: &[f64]| {
        let mut samples = every_period(values);
        for sample in &mut samples {
            sample.time *= every as u32;
        }
        response(&samples, 0.0, step.target)
    };
    let unconfirmed = |why: String| Err(Refused::Unconfirmed(why));
    let (Some(was), Some(was_to_be)) = (told(&values), told(&expected)) else {
        return unconfirmed("it hardly moved".into());
    };
    if was.overshoot_percent > OVERSHOOT {
        return unconfirmed(format!("it overshot by {:.0} %", was.overshoot_percent));
    }
    let squares: f64 = values.iter().zip(&expected).map(|(a, b)| (a - b).powi(2)).sum();
    let apart = (squares / values.len() as f64).sqrt() / step.target;
    if apart > APART {
        return unconfirmed(format!("{:.0} % off, rms", apart * 100.0));
    }
    match (was.settling, was_to_be.settling) {
        (Some(was), Some(was_to_be))
            if was.as_secs_f64() <= SETTLING * was_to_be.as_secs_f64() + MEAN => {}
        // A joint stays where friction holds it, if that was expected.
        (_, None) if control_loop == Loop::Position => {}
        (Some(was), _) => {
            return unconfirmed(format!("it settled after {} ms", was.as_millis()));
        }
        (None, _) => return unconfirmed("it did not settle".into()),
    }
    Ok(was)
}

/// So many values of what the board was to see, a sample every so many seconds.
fn expected(design: &Design, interval: f64, count: usize) -> Vec<f64> {
    let every = (interval / PERIOD).round() as usize;
    design.seen.iter().copied().step_by(every).take(count).collect()
}

/// Each the mean of so many about it.
fn means(values: &[f64], width: usize) -> Vec<f64> {
    let half = width / 2;
    let mean = |n: usize| {
        let around = values.get(n.saturating_sub(half)..(n + half + 1).min(values.len()));
        let around = around.unwrap_or_default();
        around.iter().sum::<f64>() / around.len().max(1) as f64
    };
    (0..values.len()).map(mean).collect()
}
