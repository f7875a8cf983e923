//! The world around the part: hal-mock's plant behind the F407 board's pins, as the board's README
//! wires them (firmware/src/board/README.md). Every line that the README wants a resistor on has it.
//!
//! Every millisecond the bridges', servos' and outputs' pins are read, the plant moves on, and what it
//! says is put on the pins: encoders as quadrature edges spread over the next millisecond, analogue
//! values as voltages on the multiplexers. Echoes and the remote's frames are edges at their time.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};
use std::sync::atomic::Ordering;

use firmware::ports::{MotorOutput, Sensors};
use firmware::units::{Duty, ServoPulse};
use hal_mock::plant::{Plant, Scene};
use rigless::device::Level;
use rigless::soc::stm32f427::generated::usart6;
use rigless::time::VirtualNanos;

use super::multiplexers::Voltages;
use super::servos::Servos;
use crate::part::{Output, Stm32f407, Timer};

/// A pin: port from 0 (A), number.
pub type Line = (usize, u8);

const A: usize = 0;
const B: usize = 1;
const C: usize = 2;
const D: usize = 3;
const E: usize = 4;

/// What a board has on which pins (the tables of firmware/src/board/README.md).
#[derive(Debug)]
pub struct Wiring {
    /// PWM of DC channels 1 to 6.
    pub bridges: [Output; 6],
    /// Their enable lines.
    pub enables: [Line; 6],
    /// Pulses of servos 1 to 6.
    pub servos: [Output; 6],
    /// S0 to S3 of the multiplexers.
    pub select: [Line; 4],
    /// Triggers and echoes of the rangers.
    pub rangers: &'static [(Line, Line)],
    /// The infrared receiver.
    pub remote: Line,
    /// The input port, from input 0.
    pub inputs: &'static [Line],
    /// The output port, from output 0.
    pub outputs: &'static [Line],
}

const fn output(line: Line, function: u8, timer: Timer, channel: u8) -> Output {
    Output { port: line.0, pin: line.1, function, timer, channel }
}

const SERVOS: [Output; 6] = [
    output((B, 4), 2, Timer::Tim3, 1),
    output((B, 5), 2, Timer::Tim3, 2),
    output((B, 0), 2, Timer::Tim3, 3),
    output((B, 1), 2, Timer::Tim3, 4),
    output((B, 14), 9, Timer::Tim12, 1),
    output((B, 15), 9, Timer::Tim12, 2),
];

/// STM32F407VG.
pub static F407: Wiring = Wiring {
    bridges: [
        output((E, 9), 1, Timer::Tim1, 1),
        output((E, 11), 1, Timer::Tim1, 2),
        output((E, 13), 1, Timer::Tim1, 3),
        output((E, 14), 1, Timer::Tim1, 4),
        output((C, 6), 3, Timer::Tim8, 1),
        output((C, 7), 3, Timer::Tim8, 2),
    ],
    enables: [(E, 2), (E, 4), (E, 5), (E, 6), (E, 7), (E, 8)],
    servos: SERVOS,
    select: [(B, 10), (B, 11), (B, 12), (B, 13)],
    rangers: &[
        ((A, 5), (A, 1)),
        ((A, 6), (A, 4)),
        ((A, 10), (C, 5)),
        ((B, 2), (A, 7)),
        ((C, 12), (A, 8)),
        ((C, 14), (C, 10)),
    ],
    remote: (C, 13),
    inputs: &[(D, 0), (D, 1), (D, 2), (D, 3), (D, 4), (D, 5), (D, 6), (D, 7)],
    outputs: &[(D, 8), (D, 9), (D, 10), (D, 11), (D, 12), (D, 13), (D, 14), (D, 15)],
};

/// NUCLEO-F446RE.
pub static F446: Wiring = Wiring {
    bridges: [
        output((A, 8), 1, Timer::Tim1, 1),
        output((A, 9), 1, Timer::Tim1, 2),
        output((A, 10), 1, Timer::Tim1, 3),
        output((C, 6), 3, Timer::Tim8, 1),
        output((C, 7), 3, Timer::Tim8, 2),
        output((C, 8), 3, Timer::Tim8, 3),
    ],
    enables: [(C, 0), (C, 3), (C, 5), (C, 9), (C, 10), (C, 11)],
    servos: SERVOS,
    select: [(B, 2), (B, 10), (B, 12), (B, 13)],
    rangers: &[((A, 0), (A, 1)), ((A, 6), (A, 7)), ((A, 11), (A, 12))],
    remote: (D, 2),
    inputs: &[(C, 13), (C, 12)],
    outputs: &[(A, 5), (A, 4)],
};

/// Channels A and B of encoders 1 and 2, the function that gives them to their timer, and the timer's
/// place among TIM2 to TIM5; the same on both boards.
const ENCODERS: [(Line, Line, u8, usize); 2] = [((A, 15), (B, 3), 1, 0), ((B, 6), (B, 7), 2, 2)];
/// ADC1's inputs behind multiplexers A, B and C on both boards: PC1, PC2, PC4.
pub const COMMON: &[u8] = &[11, 12, 14];
/// The display's clock and data.
const SCL: Line = (B, 8);
const SDA: Line = (B, 9);
/// The servo bus's direction line, in the CM-5's image.
pub const DIRECTION: Line = (C, 8);

/// The world's step.
const STEP_NS: u64 = 1_000_000;
/// From a trigger's end to an echo's beginning (HC-SR04).
const ECHO_AFTER_NS: u64 = 450_000;
/// There and back.
const NS_PER_CM: u64 = 58_000;

/// Full scale of the converter in counts, and the supply that it is measured against.
const FULL_SCALE: f64 = 4096.0;
const REFERENCE_MV: f64 = 3300.0;

/// Millivolts in the middle of what reads as this count.
fn millivolts(counts: u16) -> f64 {
    (f64::from(counts) + 0.5) * REFERENCE_MV / FULL_SCALE
}

/// Something that happens at a pin.
type Edge = Reverse<(u64, usize, u8, bool)>;

/// The world.
pub struct World {
    /// Motors, servos, sensors.
    pub plant: Plant,
    /// What is on which pins.
    pub wiring: &'static Wiring,
    /// Whether the plant's analogue values go to the multiplexers; else they are the test's own.
    pub is_analog: bool,
    /// The multiplexers' inputs.
    pub voltages: Voltages,
    /// What each enable line was at, when it changed: ns, channel, level.
    pub enabled: Vec<(u64, usize, bool)>,
    /// What the direction line of the servo bus was at, when it changed: ns, level.
    pub turned: Vec<(u64, bool)>,
    /// How many bits the display still waits for, holding its data line low until it has them.
    pub stuck_bits: u32,
    /// The servo bus.
    pub servos: Servos,
    edges: BinaryHeap<Edge>,
    driven: BTreeMap<Line, bool>,
    counts: [i64; 2],
    next_ns: u64,
    asked_ns: u64,
    echoes: [u8; 6],
    is_begun: bool,
}

impl std::fmt::Debug for World {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("World")
    }
}

impl World {
    /// A world of this scene.
    pub fn new(scene: Scene, wiring: &'static Wiring, voltages: Voltages, servos: Servos) -> Self {
        let mut plant = Plant::new(scene, 1);
        let echoes = plant.sensors().sonar_cm;
        let mut driven = BTreeMap::new();
        // 10 kOhm to ground.
        let pulled_down = wiring.enables.iter().chain(wiring.outputs).chain([&DIRECTION]);
        driven.extend(pulled_down.map(|&line| (line, false)));
        let pulses = wiring.bridges.iter().chain(&wiring.servos);
        driven.extend(pulses.map(|output| ((output.port, output.pin), false)));
        driven.extend(wiring.rangers.iter().map(|&(_, echo)| (echo, false)));
        driven.insert(wiring.remote, true); // no carrier
        Self {
            plant,
            wiring,
            is_analog: true,
            voltages,
            enabled: Vec::new(),
            turned: Vec::new(),
            stuck_bits: 0,
            servos,
            edges: BinaryHeap::new(),
            driven,
            counts: [0; 2],
            next_ns: 0,
            asked_ns: 0,
            echoes,
            is_begun: false,
        }
    }

    /// Drives a pin from now on.
    fn drive(&mut self, chip: &mut Stm32f407, now: VirtualNanos, line: Line, is_high: bool) {
        self.driven.insert(line, is_high);
        chip.drive(now, line.0, line.1, Some(Level::from(is_high)));
    }

    /// Drives a pin at a time to come.
    pub fn drive_at(&mut self, ns: u64, line: Line, is_high: bool) {
        self.edges.push(Reverse((ns, line.0, line.1, is_high)));
    }

    /// A key of the infrared remote: an NEC frame that begins at `ns` (9 ms mark, 4.5 ms space, 32
    /// bits of 560 us mark and 560 or 1690 us space, the last mark), with a 16 bit address, each part of it
    /// `percent` as long.
    pub fn press(&mut self, ns: u64, address: u16, command: u8, percent: u64) {
        let word = u32::from(address) | u32::from(command) << 16 | u32::from(!command) << 24;
        let remote = self.wiring.remote;
        let mut at = ns;
        let mut mark = |mark_us: u64, space_us: u64| {
            self.drive_at(at, remote, false);
            self.drive_at(at + 10 * percent * mark_us, remote, true);
            at += 10 * percent * (mark_us + space_us);
        };
        mark(9000, 4500);
        (0..32).for_each(|bit| mark(560, if word >> bit & 1 != 0 { 1690 } else { 560 }));
        mark(560, 0);
    }

    /// The part was reset: its models have forgotten what was on its pins.
    pub fn put_again(&mut self, chip: &mut Stm32f407, now: VirtualNanos) {
        let triggers = self.wiring.rangers.iter().map(|(trigger, _)| trigger);
        for &(port, pin) in self.wiring.enables.iter().chain([&DIRECTION, &SCL]).chain(triggers) {
            chip.exti.watch(port, pin);
        }
        for (&(port, pin), &is_high) in &self.driven {
            chip.drive(now, port, pin, Some(Level::from(is_high)));
        }
        self.asked_ns = 0; // events went with the reset
    }

    /// Lets the world catch up with the part. Called at every stop.
    pub fn step(&mut self, chip: &mut Stm32f407, now: VirtualNanos) {
        if !self.is_begun {
            self.is_begun = true;
            // Both have their pull-ups.
            self.driven.insert(SCL, true);
            self.driven.insert(SDA, self.stuck_bits == 0);
            self.put_again(chip, now);
        }
        for (port, pin, level, at) in chip.exti.heard() {
            let (line, is_high) = ((port, pin), level == Level::High);
            if let Some(channel) = self.wiring.enables.iter().position(|&enable| enable == line) {
                self.enabled.push((at, channel, is_high));
            }
            if line == DIRECTION {
                self.turned.push((at, is_high));
            }
            if line == SCL && !is_high && self.stuck_bits > 0 {
                self.stuck_bits -= 1;
                self.drive(chip, now, SDA, self.stuck_bits == 0); // it lets go: the pull-up's
            }
            let rangers = self.wiring.rangers;
            let ranger = rangers.iter().position(|&(trigger, _)| trigger == line);
            if let (Some(ranger), false) = (ranger, is_high) {
                let (_, echo) = rangers[ranger];
                let begins = at + ECHO_AFTER_NS;
                if self.echoes[ranger] < 255 {
                    self.drive_at(begins, echo, true);
                    self.drive_at(begins + NS_PER_CM * u64::from(self.echoes[ranger]), echo, false);
                }
            }
        }
        if now.0 >= self.next_ns {
            self.next_ns = now.0 - now.0 % STEP_NS + STEP_NS;
            self.millisecond(chip, now);
        }
        while let Some(&Reverse((at, port, pin, is_high))) = self.edges.peek()
            && at <= now.0
        {
            self.edges.pop();
            self.drive(chip, now, (port, pin), is_high);
            self.encoders(chip, now, (port, pin));
        }
        let next = self.edges.peek().map_or(self.next_ns, |edge| edge.0.0.min(self.next_ns));
        if next < self.asked_ns || self.asked_ns <= now.0 {
            self.asked_ns = next;
            chip.wake_at(now, VirtualNanos(next));
        }
    }

    /// An encoder's pin has changed: its timer hears it, if the pin is the timer's.
    fn encoders(&mut self, chip: &mut Stm32f407, now: VirtualNanos, line: Line) {
        for (a, b, function, timer) in ENCODERS {
            let is_its = line == a || line == b;
            if is_its && [a, b].iter().all(|l| chip.function(l.0, l.1) == Some(function)) {
                let level = |line| Level::from(self.driven.get(&line) == Some(&true));
                chip.encoder(now, timer, level(a), level(b));
            }
        }
    }

    fn millisecond(&mut self, chip: &mut Stm32f407, now: VirtualNanos) {
        let control = chip.register("USART6", usart6::Register::Cr3);
        let is_one_wire = usart6::cr3::HDSEL.is_set(control);
        self.servos.is_one_wire.store(is_one_wire, Ordering::Relaxed);

        self.plant.outputs = self.outputs(chip);
        self.plant.advance_to(now.0 / STEP_NS);
        let read = self.plant.motion_inputs();
        let sensors = self.plant.sensors();
        self.echoes = sensors.sonar_cm;
        for (encoder, &(a, b, ..)) in ENCODERS.iter().enumerate() {
            let raw = self.plant.motors[encoder].position();
            let counts = self.plant.overrides.encoders[encoder].map_or(raw, i64::from);
            let way = counts - self.counts[encoder];
            for step in 1..=way.abs() {
                let count = self.counts[encoder] + step * way.signum();
                let at = now.0 + STEP_NS * (step as u64 - 1) / way.unsigned_abs().max(1);
                let place = count.rem_euclid(4); // 00 10 11 01
                self.drive_at(at, a, place == 1 || place == 2);
                self.drive_at(at, b, place >= 2);
            }
            self.counts[encoder] = counts;
        }
        for (bit, &line) in self.wiring.inputs.iter().enumerate() {
            self.drive(chip, now, line, sensors.gpio_in >> bit & 1 != 0);
        }
        if self.is_analog {
            let put = |(multiplexer, address), counts| {
                self.voltages.put(multiplexer, address, Some(millivolts(counts)));
            };
            (0..6).for_each(|i| put((0, i), read.potentiometers[i]));
            (0..6).for_each(|i| put((1, i), read.currents[i]));
            slow(&sensors).for_each(|(place, counts)| put(place, counts));
        }
    }

    /// What the pins drive.
    fn outputs(&self, chip: &mut Stm32f407) -> firmware::ports::Outputs {
        let mut outputs = firmware::ports::Outputs::default();
        for (channel, motor) in outputs.motors.iter_mut().enumerate() {
            let (port, pin) = self.wiring.enables[channel];
            let is_enabled = chip.level(port, pin) == Level::High;
            // Locked anti-phase; a line that stays low drives in full reverse.
            let high =
                chip.pulses(self.wiring.bridges[channel]).map_or(0.0, |pulses| pulses.duty());
            let raw = ((2.0 * high - 1.0) * f64::from(Duty::FULL)).round() as i32;
            *motor = MotorOutput { duty: Duty::from_raw(raw), enabled: is_enabled };
        }
        for (servo, output) in outputs.servos.iter_mut().zip(self.wiring.servos) {
            *servo = chip.pulses(output).filter(|pulses| pulses.width_ns > 0.0).map(|pulses| {
                ServoPulse::from_raw((pulses.width_ns * 2.25 / 1000.0).round() as i32)
            });
        }
        outputs.gpio = self.wiring.outputs.iter().rev().fold(0, |bits, &(port, pin)| {
            bits << 1 | u8::from(chip.level(port, pin) == Level::High)
        });
        outputs
    }
}

/// Places (multiplexer, address) and counts of the inputs that are not control's.
fn slow(sensors: &Sensors) -> impl Iterator<Item = ((usize, usize), u16)> {
    let at = |multiplexer: usize, first: usize| {
        move |(i, &counts): (usize, &u16)| ((multiplexer, first + i), counts)
    };
    let a = sensors.custom_ad.iter().enumerate().map(at(0, 6));
    let reference = sensors.reference.iter().enumerate().map(at(0, 14));
    let human = sensors.human.iter().enumerate().map(at(1, 6));
    let tilt = sensors.tilt.iter().enumerate().map(at(1, 10));
    let heat = sensors.overheat.iter().enumerate().map(at(1, 12));
    let battery = sensors.battery.iter().enumerate().map(at(2, 0));
    let two = [((1, 14), sensors.temperature), ((1, 15), sensors.ir_range)];
    a.chain(reference).chain(human).chain(tilt).chain(heat).chain(battery).chain(two)
}
