//! What tuning is worth, on 200 drives that the tuner's author has not seen ([`tests::workshop`]).
//!
//! `cargo bench -p tests --bench tuning` has each drive tuned over the serial line, steps its velocity loop
//! from standstill and judges it by the shaft's true speed; beside it, the default gains on the same drives.
//! Then machines with something wrong, which are to be refused. It prints a line for each drive that fails,
//! and a table; and it fails unless:
//!
//! - at least 190 of 200 are tuned and the rest refused; no tuning is wrong: K and tau within 5 % where they
//!   are defined, overshoot at most 10 %, settling at most 1.2 times what was predicted, no limit crossed,
//!   no fault, at most 30 s of the machine's time;
//! - swapped wires, a dead sensor and a blocked shaft are refused, with the motor off, within 0.5 s of the
//!   machine's time after driving begins.
//!
//! `-- plant 17` shows one drive alone, with what is true of it. `-- possible` asks whether the bench asks for
//! the impossible: it knows the truth, tries a grid of gains on each drive and tells which drives have none that
//! would pass, with the quickest settling.

use std::collections::BTreeMap;
use std::process::ExitCode;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use tests::workshop::judge::{self, MOST_OVERSHOOT, Response, STEP, failures, off_percent};
use tests::workshop::plant::{PLANTS, Plant, Truth, Wrong};
use tests::workshop::rig::{Greatest, Rig};
use tests::workshop::tuner::{Refused, Tuned, tune};

/// Of [`PLANTS`].
const LEAST_TUNED: usize = 190;
/// Of the machine's time, for a channel.
const LONGEST: Duration = Duration::from_secs(30);
/// Of the machine's time, from the first duty until a wrong machine is refused and off.
const REFUSED_WITHIN: Duration = Duration::from_millis(500);
/// A: the over-current of the settings.
const MOST_CURRENT: f64 = 5.0;
/// How many plants each wrong machine is made of.
const WRONG: u64 = 12;

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().skip(1).collect();
    if let Some(at) = words.iter().position(|word| word == "plant") {
        let number = words.get(at + 1).and_then(|word| word.parse().ok());
        show(number.expect("the number of a plant"));
        return ExitCode::SUCCESS;
    }
    if words.iter().any(|word| word == "possible") {
        possible();
        return ExitCode::SUCCESS;
    }
    let began = Instant::now();
    let trials = in_parallel(PLANTS, |number| Trial::new(Plant::number(number)));
    let mut all_is_well = report(&trials);
    let wrongs = wrong_machines();
    let bouts = in_parallel(wrongs.len() as u64, |k| {
        let (number, wrong) = wrongs[k as usize];
        Bout::new(number, wrong)
    });
    all_is_well &= report_wrong(&bouts);
    let simulated: f64 =
        trials.iter().map(|t| t.simulated).chain(bouts.iter().map(|b| b.simulated)).sum();
    let took = began.elapsed().as_secs_f64();
    println!(
        "\n{simulated:.0} s of machines in {took:.1} s, {:.0} times real time",
        simulated / took
    );
    println!("{}", if all_is_well { "all is as it should be" } else { "NOT as it should be" });
    if all_is_well { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// What was made of numbers 0 to `count`, in order, by as many threads as there are cores.
fn in_parallel<T: Send>(count: u64, make: impl Fn(u64) -> T + Sync) -> Vec<T> {
    let next = AtomicU64::new(0);
    let work = || {
        let numbers = std::iter::repeat_with(|| next.fetch_add(1, Ordering::Relaxed));
        numbers.take_while(|n| *n < count).map(|n| (n, make(n))).collect::<Vec<_>>()
    };
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let mut made: Vec<(u64, T)> = std::thread::scope(|scope| {
        let threads: Vec<_> = (0..cores).map(|_| scope.spawn(work)).collect();
        threads.into_iter().flat_map(|thread| thread.join().expect("no panic")).collect()
    });
    made.sort_by_key(|(n, _)| *n);
    made.into_iter().map(|(_, made)| made).collect()
}

/// A drive, tuned and judged.
struct Trial {
    plant: Plant,
    truth: Truth,
    result: Result<(Tuned, Response), Refused>,
    /// What is wrong with it; a refusal has nothing wrong but what it did to the machine.
    wrong: Vec<String>,
    took: Duration,
    by_default: Response,
    default_faults: usize,
    /// Seconds of the machine.
    simulated: f64,
}

impl Trial {
    fn new(plant: Plant) -> Self {
        let truth = plant.truth();
        let mut rig = Rig::new(&plant, None);
        let tuned = tune(&mut rig);
        let took = rig.now();
        let mut wrong = limits_crossed(&rig);
        if took > LONGEST {
            wrong.push(format!("took {:.1} s", took.as_secs_f64()));
        }
        if !rig.is_off() {
            wrong.push("left the motor on".into());
        }
        let result = tuned.map(|tuned| {
            let response = judge::step(&mut rig, &plant);
            wrong.extend(failures(&truth, &tuned, &response));
            wrong.extend(limits_crossed(&rig));
            wrong.dedup();
            (tuned, response)
        });
        let mut simulated = rig.now().as_secs_f64();
        drop(rig);
        let mut rig = Rig::new(&plant, None);
        let by_default = judge::step(&mut rig, &plant);
        simulated += rig.now().as_secs_f64();
        let default_faults = rig.faults().len();
        Self { plant, truth, result, wrong, took, by_default, default_faults, simulated }
    }
}

/// What must not happen while a channel is tuned, or afterwards.
fn limits_crossed(rig: &Rig) -> Vec<String> {
    let mut wrong: Vec<_> =
        rig.faults().iter().map(|(fault, _)| format!("fault {fault:?}")).collect();
    let Greatest { current, duty, .. } = rig.greatest();
    if current > MOST_CURRENT || duty > 1.0 {
        wrong.push(format!("{current:.1} A at most, {:.0} % duty", 100.0 * duty));
    }
    wrong
}

/// Prints what became of the drives, and returns whether it is what was asked.
fn report(trials: &[Trial]) -> bool {
    for trial in trials.iter().filter(|t| !t.wrong.is_empty() || t.result.is_err()) {
        let what = match &trial.result {
            Err(Refused(reason)) if trial.wrong.is_empty() => format!("refused: {reason}"),
            Err(Refused(reason)) => format!("WRONG: {}; refused: {reason}", trial.wrong.join(", ")),
            Ok(_) => format!("WRONG: {}", trial.wrong.join(", ")),
        };
        println!("{}: {what}", name(trial));
    }
    let tuned: Vec<_> = trials.iter().filter_map(|t| Some((t, t.result.as_ref().ok()?))).collect();
    let right = tuned.iter().filter(|(t, _)| t.wrong.is_empty()).count();
    let wrong = trials.iter().filter(|t| !t.wrong.is_empty()).count();
    let mut reasons: BTreeMap<&str, usize> = BTreeMap::new();
    for Refused(reason) in trials.iter().filter_map(|t| t.result.as_ref().err()) {
        *reasons.entry(reason).or_default() += 1;
    }
    println!("\n{right} of {} tuned, {wrong} wrong", trials.len());
    for (reason, count) in reasons {
        println!("{count} refused: {reason}");
    }
    let longest = trials.iter().map(|t| t.took).max().unwrap_or_default();
    println!("longest time of a channel {:.1} s\n", longest.as_secs_f64());

    let defined = |t: &Trial| t.truth.is_tau_defined();
    println!("{:34}{:>9}{:>9}{:>9}{:>9}{:>9}", "", "least", "10 %", "median", "90 %", "most");
    row("K error, %", tuned.iter().map(|(t, (x, _))| off_percent(x.gain, t.truth.gain)));
    let taus = tuned.iter().filter(|(t, _)| defined(t));
    row("tau error, %", taus.filter_map(|(t, (x, _))| Some(off_percent(x.tau?, t.truth.tau))));
    row(
        "dead time error, ms",
        tuned.iter().map(|(t, (x, _))| 1e3 * (x.dead_time - t.truth.dead_time)),
    );
    row("overshoot, %", tuned.iter().map(|(_, (_, r))| r.overshoot));
    row("overshoot less predicted, %", tuned.iter().map(|(_, (x, r))| r.overshoot - x.overshoot));
    row("settling, s", tuned.iter().filter_map(|(_, (_, r))| r.settling));
    row(
        "settling over predicted",
        tuned.iter().filter_map(|(_, (x, r))| Some(r.settling? / x.settling)),
    );
    row("steady error, %", tuned.iter().map(|(_, (_, r))| r.steady_error));
    println!("by default gains:");
    row("overshoot, %", trials.iter().map(|t| t.by_default.overshoot));
    row("settling, s", trials.iter().filter_map(|t| t.by_default.settling));
    row("steady error, %", trials.iter().map(|t| t.by_default.steady_error));
    let settled = trials.iter().filter(|t| t.by_default.settling.is_some());
    let (mut settles, mut good) = (0, 0);
    for trial in settled {
        settles += 1;
        good += usize::from(trial.by_default.overshoot <= MOST_OVERSHOOT);
    }
    let faults = trials.iter().filter(|t| t.default_faults > 0).count();
    println!(
        "settle {settles}, of them with at most {MOST_OVERSHOOT} % overshoot {good}; with faults {faults}"
    );
    println!("the drives:");
    row("K, counts/s", trials.iter().map(|t| t.truth.gain));
    row("tau, ms", trials.iter().map(|t| 1e3 * t.truth.tau));
    row("dead time, ms", trials.iter().map(|t| 1e3 * t.truth.dead_time));
    row("dead band, % of full duty", trials.iter().map(|t| 1e2 * t.truth.dead_band));
    row("breakaway, % of full duty", trials.iter().map(|t| 1e2 * t.truth.breakaway));
    row("counts a turn", trials.iter().map(|t| t.plant.encoder.counts_per_turn.into()));
    row("ripple at the step's speed, %", trials.iter().map(|t| t.by_default.ripple));
    let without = trials.iter().filter(|t| !defined(t)).count();
    println!("tau is not defined for {without}");
    right >= LEAST_TUNED && wrong == 0
}

/// What a drive is, in a line.
fn name(Trial { plant, truth, .. }: &Trial) -> String {
    format!(
        "plant {} (K {:.0}, tau {:.0} ms, breakaway {:.0} %, {} counts a turn)",
        plant.number,
        truth.gain,
        1e3 * truth.tau,
        1e2 * truth.breakaway,
        plant.encoder.counts_per_turn
    )
}

/// A row of the table: how values are spread.
fn row(what: &str, values: impl Iterator<Item = f64>) {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    let Some(last) = values.len().checked_sub(1) else {
        println!("  {what:32}{:>9}", "-");
        return;
    };
    print!("  {what:32}");
    for part in [0.0, 0.1, 0.5, 0.9, 1.0] {
        let value = values[(part * last as f64).round() as usize];
        let places = if value.abs() < 10.0 { 2 } else { usize::from(value.abs() < 1000.0) };
        print!("{value:9.places$}");
    }
    println!();
}

/// The machines that are to be refused: each kind on every so many plants.
fn wrong_machines() -> Vec<(u64, Wrong)> {
    let kinds = |n: u64| {
        let play_degrees = [0.0, 0.2, 1.0][(n % 3) as usize];
        [Wrong::SwappedWires, Wrong::DeadSensor, Wrong::BlockedShaft { play_degrees }]
    };
    let plants = (0..WRONG).map(|n| (n, n * PLANTS / WRONG));
    plants.flat_map(|(n, number)| kinds(n).map(|wrong| (number, wrong))).collect()
}

/// A machine with something wrong, and what the tuner made of it.
struct Bout {
    number: u64,
    wrong: Wrong,
    result: Result<Tuned, Refused>,
    /// From the first duty until the last, and until the refusal was told.
    driven: Duration,
    told: Duration,
    is_off: bool,
    simulated: f64,
}

impl Bout {
    fn new(number: u64, wrong: Wrong) -> Self {
        let mut rig = Rig::new(&Plant::number(number), Some(wrong));
        let result = tune(&mut rig);
        let told = rig.now();
        let is_off = rig.is_off();
        // What it has left behind may drive it again.
        rig.run_ms(200);
        let (driven, told) = rig.driven().map_or_else(Default::default, |(first, last)| {
            (last - first, told.saturating_sub(first))
        });
        let simulated = rig.now().as_secs_f64();
        Self { number, wrong, result, driven, told, is_off, simulated }
    }

    fn is_right(&self) -> bool {
        let in_time = self.driven <= REFUSED_WITHIN && self.told <= REFUSED_WITHIN;
        self.result.is_err() && in_time && self.is_off && self.driven > Duration::ZERO
    }
}

/// Prints what became of the wrong machines, and returns whether it is what was asked.
fn report_wrong(bouts: &[Bout]) -> bool {
    println!("\nwrong machines:");
    for bout in bouts.iter().filter(|bout| !bout.is_right()) {
        let (driven, told) = (bout.driven.as_millis(), bout.told.as_millis());
        let what = match &bout.result {
            Ok(_) => "tuned".into(),
            Err(Refused(reason)) => format!("refused: {reason}"),
        };
        let off = if bout.is_off { "" } else { ", left on" };
        println!(
            "plant {} {:?}: {what}, driven for {driven} ms, told after {told} ms{off}",
            bout.number, bout.wrong
        );
    }
    let mut reasons: BTreeMap<(String, &str), (usize, Duration, Duration)> = BTreeMap::new();
    for bout in bouts {
        let Err(Refused(reason)) = &bout.result else { continue };
        let kind = format!("{:?}", bout.wrong);
        let kind = kind.split(' ').next().unwrap_or_default().to_string();
        let (count, driven, told) = reasons.entry((kind, reason)).or_default();
        (*count, *driven, *told) = (*count + 1, bout.driven.max(*driven), bout.told.max(*told));
    }
    for ((kind, reason), (count, driven, told)) in reasons {
        let (driven, told) = (driven.as_millis(), told.as_millis());
        println!(
            "  {count} {kind} refused: {reason}; driven for at most {driven} ms, told after {told} ms"
        );
    }
    let right = bouts.iter().filter(|bout| bout.is_right()).count();
    println!("{right} of {} refused in time and off", bouts.len());
    right == bouts.len()
}

/// One drive, and what is true of it.
fn show(number: u64) {
    let trial = Trial::new(Plant::number(number));
    println!("{}\n{:#?}", name(&trial), trial.truth);
    println!("{:#?}\nwrong: {:?}\nby default: {:#?}", trial.result, trial.wrong, trial.by_default);
}

/// Tries gains on every drive: proportional gains that make the loop so many times as fast as the drive; the
/// integral's time that of the drive, where the built-in one of 128 ms is longer; without and with what the
/// truth says fed forward; without and with a ramp.
fn possible() {
    let best = in_parallel(PLANTS, |number| {
        let plant = Plant::number(number);
        let truth = plant.truth();
        let mut best: Option<(f64, String)> = None;
        for faster in [0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0] {
            let kp = f64::from(1 << 19) * faster / truth.gain;
            let ki = (faster / truth.gain * (1.0 / truth.tau - 1.0 / 0.128)).max(0.0);
            for fed in [false, true] {
                for ramp in [0.0, 1.0, 2.0] {
                    let full_speed = if fed { truth.gain / 2.0 } else { 8e6 };
                    let acceleration = match ramp {
                        0.0 => 0.0,
                        _ => STEP * truth.full_speed / (ramp * truth.tau),
                    };
                    let mut rig = Rig::new(&plant, None);
                    rig.set(&[
                        (3, full_speed as i32),
                        (181, acceleration as i32),
                        (211, kp.round().clamp(1.0, 32_767.0) as i32),
                        (212, 0),
                        (213, (ki * 4096.0 * 100.0).round().min(65_535.0) as i32),
                    ]);
                    let Response { overshoot, settling, .. } = judge::step(&mut rig, &plant);
                    if let Some(settling) = settling
                        && overshoot <= MOST_OVERSHOOT
                        && rig.faults().is_empty()
                        && best.as_ref().is_none_or(|(than, _)| settling < *than)
                    {
                        let with = format!("{faster} times as fast, fed {fed}, ramp {ramp}");
                        best = Some((settling, with));
                    }
                }
            }
        }
        (plant, best)
    });
    for (plant, best) in &best {
        if best.is_none() {
            println!("plant {}: none of these; {:?}", plant.number, plant.truth());
        }
    }
    println!("{:34}{:>9}{:>9}{:>9}{:>9}{:>9}", "", "least", "10 %", "median", "90 %", "most");
    row("settling over tau", best.iter().filter_map(|(p, b)| Some(b.as_ref()?.0 / p.truth().tau)));
    println!(
        "{} of {PLANTS} can be tuned so",
        best.iter().filter(|(_, best)| best.is_some()).count()
    );
}
