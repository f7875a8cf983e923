//! A host of the PMS5005 on the bench's line.

use std::collections::VecDeque;

use protocol::deframe::{Deframer, Reception};
use protocol::extension::{
    Action, Answer, Assignments, Fault, Health, Identity, Latched, Request, Verdict,
};
use protocol::pms5005::{
    Addressing, CHANNELS, Command, Data, Frame, MAX_FRAME, Move, Pms5005, Quantity, Repeat, Report,
};

use super::{Bench, Make};

/// A frame as it was heard.
#[derive(Clone, Debug, PartialEq)]
pub struct Heard {
    /// End of its last stop bit, in ns.
    pub at_ns: u64,
    /// DID.
    pub did: u8,
    /// RES: 255 is what nobody acknowledges.
    pub res: u8,
    /// DATA.
    pub data: Vec<u8>,
}

impl Heard {
    /// Whether it is an acknowledgement (section III of the manual).
    pub fn is_ack(&self) -> bool {
        (self.res, self.did, &self.data[..]) == (0, 255, &[1])
    }

    /// The telemetry that it is.
    pub fn report(&self) -> Option<Report> {
        (self.res == 255).then(|| Report::parse(self.did, &self.data)).flatten()
    }

    /// The answer of the extension that it is.
    pub fn answer(&self) -> Option<Answer<'_>> {
        (self.res == 255).then(|| Answer::parse(self.did, &self.data)).flatten()
    }
}

/// A board and its host.
pub struct Host {
    /// The bench.
    pub bench: Bench,
    deframer: Deframer<Pms5005, MAX_FRAME>,
    /// Heard, and not looked at yet.
    frames: VecDeque<Heard>,
}

/// How long a host that waits for something waits, in ms.
const PATIENCE_MS: u64 = 400;

impl Host {
    /// Switches on a PMS5005, and waits until it talks.
    pub fn boot(image: &str) -> Self {
        Self::boot_with(image, Make::default())
    }

    /// Switches on a PMS5005 on a bench like this, and waits until it talks.
    pub fn boot_with(image: &str, make: Make) -> Self {
        let bench = Bench::boot_with(image, make);
        let mut host = Self { bench, deframer: Deframer::new(), frames: VecDeque::new() };
        host.wait("telemetry", |frame| frame.report());
        host
    }

    /// What has been heard and was not looked at yet.
    pub fn heard(&mut self) -> Vec<Heard> {
        self.collect();
        self.frames.drain(..).collect()
    }

    fn collect(&mut self) {
        for (at_ns, byte) in self.bench.line.heard() {
            if let Some(frame) = self.deframer.receive(&mut &[byte][..]) {
                let Frame { res, did, data, .. } = Frame::parse(frame).expect("a whole frame");
                self.frames.push_back(Heard { at_ns, did, res, data: data.to_vec() });
            }
        }
    }

    /// What the receiver has counted.
    pub fn reception(&self) -> Reception {
        self.deframer.reception()
    }

    /// Lets time pass, in ms.
    pub fn run_for(&mut self, ms: u64) {
        self.bench.run_for(ms);
    }

    /// Lets time pass, in ms, with a sign of life every 200.
    pub fn live_for(&mut self, ms: u64) {
        for passed in (0..ms).step_by(200) {
            self.send(Command::Ping);
            self.run_for(200.min(ms - passed));
        }
    }

    /// Sends a command.
    pub fn send(&mut self, command: Command<'_>) {
        let frame = command.encode(0, &mut [0; MAX_FRAME]).expect("it can be encoded").to_vec();
        self.bench.line.send(&frame);
    }

    /// Sends what need not be a command.
    pub fn send_raw(&mut self, did: u8, data: &[u8]) {
        let frame = Frame { rid: 1, res: 0, did, data };
        let bytes = frame.encode(&mut [0; MAX_FRAME]).expect("it can be encoded").to_vec();
        self.bench.line.send(&bytes);
    }

    /// Waits for a frame of which `wanted` makes something; what comes before it is dropped.
    pub fn wait<T>(&mut self, what: &str, mut wanted: impl FnMut(&Heard) -> Option<T>) -> T {
        for _ in 0..PATIENCE_MS {
            self.collect();
            while let Some(frame) = self.frames.pop_front() {
                if let Some(found) = wanted(&frame) {
                    return found;
                }
            }
            self.run_for(1);
        }
        panic!("no {what} within {PATIENCE_MS} ms");
    }

    /// Sends a command and waits for its acknowledgement.
    pub fn order(&mut self, command: Command<'_>) {
        self.send(command);
        self.wait("acknowledgement", |frame| frame.is_ack().then_some(()));
    }

    /// Orders a motion of all channels, from 0; `None` leaves one alone.
    pub fn go(&mut self, quantity: Quantity, targets: [Option<i16>; CHANNELS]) {
        let motion = Move { quantity, addressing: Addressing::List, targets, periods: 0 };
        self.order(Command::Move(motion));
    }

    /// The next motor report.
    pub fn motors(&mut self) -> protocol::pms5005::MotorReport {
        self.heard();
        self.wait("motor report", |frame| match frame.report() {
            Some(Report::Motors(report)) => Some(report),
            _ => None,
        })
    }

    /// Sends a request of the extension and waits for the answer of which `wanted` makes something.
    pub fn ask<T>(&mut self, request: Request<'_>, wanted: impl Fn(Answer<'_>) -> Option<T>) -> T {
        self.send(Command::Extension(request));
        self.wait("answer", |frame| frame.answer().and_then(&wanted))
    }

    /// What came of a request.
    pub fn outcome(&mut self, request: Request<'_>) -> Verdict {
        self.ask(request, |answer| match answer {
            Answer::Outcome(outcome) => Some(outcome.verdict),
            _ => None,
        })
    }

    /// Has something done.
    pub fn act(&mut self, action: Action) -> Verdict {
        self.outcome(Request::Do(action))
    }

    /// Sets a setting by its number.
    pub fn set(&mut self, number: u16, value: i32) {
        self.set_all(&[(number, value)]);
    }

    /// Sets some settings by their numbers, all at once.
    pub fn set_all(&mut self, values: &[(u16, i32)]) {
        let mut data = Data::new();
        for &(number, value) in values {
            Assignments::emit(number, value, &mut data).expect("they fit");
        }
        let assignments = Assignments::parse(&data).expect("what was just emitted");
        assert_eq!(self.outcome(Request::Set(assignments)), Verdict::Done);
    }

    /// A setting's value.
    pub fn value(&mut self, number: u16) -> i32 {
        self.ask(Request::Setting(number), |answer| match answer {
            Answer::Setting(setting) => Some(setting.value),
            _ => None,
        })
    }

    /// Which firmware it is, and how it started.
    pub fn identity(&mut self) -> Identity {
        self.ask(Request::Identity, |answer| match answer {
            Answer::Identity(identity) => Some(identity),
            _ => None,
        })
    }

    /// How it is.
    pub fn health(&mut self) -> Health {
        let once = Repeat::Times(std::num::NonZeroU8::MIN);
        self.ask(Request::Health(once), |answer| match answer {
            Answer::Health(health) => Some(health),
            _ => None,
        })
    }

    /// The faults on record.
    pub fn faults(&mut self) -> Vec<Fault> {
        let mut faults = Vec::new();
        loop {
            let place = faults.len() as u8; // 16 at the most
            let record = self.ask(Request::Fault(place), |answer| match answer {
                Answer::Fault(Latched { place: told, record, .. }) if told == place => Some(record),
                _ => None,
            });
            match record {
                Some(record) => faults.push(record.fault),
                None => return faults,
            }
        }
    }
}
