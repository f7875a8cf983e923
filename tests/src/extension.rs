//! The extension (DIDs 96 to 103) as a host uses it, over any wire that carries it.

use protocol::extension::{Action, Answer, Assignments, Identity, Latched, Verdict};
use protocol::pms5005::Data;

use crate::host::{Board, Host};

/// A board whose wire carries the extension.
pub trait Extended: Board + Sized {
    /// The number of the frame that sets settings and does actions.
    const DO: u8;

    /// Sends a request, lets 40 ms pass, and yields number and data of what came, but for what
    /// comes unasked.
    fn answers(host: &mut Host<Self>, number: u8, data: &[u8]) -> Vec<(u8, Vec<u8>)>;
}

/// The data that set settings.
pub fn assign(assignments: &[(u16, i32)]) -> Data {
    let mut data = Data::new();
    assignments.iter().for_each(|&(n, value)| Assignments::emit(n, value, &mut data).unwrap());
    data
}

impl<B: Extended> Host<B> {
    /// Sends a request and yields number and data of the one answer to it.
    pub fn ask_raw(&mut self, number: u8, data: &[u8]) -> (u8, Vec<u8>) {
        let mut answers = B::answers(self, number, data);
        assert_eq!(answers.len(), 1, "{number} {data:?}: {answers:?}");
        answers.remove(0)
    }

    /// What an [`Answer::Outcome`] to this request says, and the setting it is about.
    pub fn outcome(&mut self, number: u8, data: &[u8]) -> (Verdict, u16) {
        let (told, bytes) = self.ask_raw(number, data);
        let Some(Answer::Outcome(outcome)) = Answer::parse(told, &bytes) else {
            panic!("{told}: {bytes:?}")
        };
        let did = if number == B::DO { 7 } else { number };
        assert_eq!((outcome.did, outcome.first), (did, data.first().copied().unwrap_or(0)));
        (outcome.verdict, outcome.setting)
    }

    /// What came of an action.
    pub fn act(&mut self, action: Action) -> Verdict {
        self.outcome(B::DO, &[action.number()]).0
    }

    /// What came of setting these.
    pub fn set(&mut self, assignments: &[(u16, i32)]) -> (Verdict, u16) {
        self.outcome(B::DO, &assign(assignments))
    }

    /// What came of setting an encoder's count.
    pub fn set_count(&mut self, channel: u8, count: i32) -> Verdict {
        let [c0, c1, c2, c3] = count.to_le_bytes();
        self.outcome(B::DO, &[0x86, channel, c0, c1, c2, c3]).0
    }

    /// A setting's value.
    pub fn value(&mut self, number: u16) -> i32 {
        let (told, bytes) = self.ask_raw(96, &number.to_le_bytes());
        let Some(Answer::Setting(setting)) = Answer::parse(told, &bytes) else {
            panic!("{told}: {bytes:?}")
        };
        setting.value
    }

    /// Which firmware it is, and how it started.
    pub fn identity(&mut self) -> Identity {
        let (told, bytes) = self.ask_raw(97, &[]);
        let Some(Answer::Identity(identity)) = Answer::parse(told, &bytes) else {
            panic!("{told}: {bytes:?}")
        };
        identity
    }

    /// What is told of the fault at this place.
    pub fn fault(&mut self, place: u8) -> Latched {
        let (told, bytes) = self.ask_raw(100, &[place]);
        let Some(Answer::Fault(latched)) = Answer::parse(told, &bytes) else {
            panic!("{told}: {bytes:?}")
        };
        latched
    }
}
