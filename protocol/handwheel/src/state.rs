//! Machine states: how they are asked for, what is on by one, and how their time counts on.

use std::num::NonZeroU8;
use std::time::Duration;

use protocol::extension::{ChannelState, MachineState, Mode, Request};
use protocol::pms5005::{CHANNELS, Command, Repeat};

/// Asks for 255 of them, so that the stream ends by itself if the host does.
pub(crate) const ASK: Command<'static> =
    Command::Extension(Request::State(Repeat::Times(NonZeroU8::MAX)));
/// How often they are asked for anew.
pub(crate) const RENEW: Duration = Duration::from_secs(1);

/// Which channels are on, whoever has switched them on.
pub(crate) fn on(state: &MachineState) -> [bool; CHANNELS] {
    state.channels.map(|channel| channel.mode != Mode::Off)
}

/// Whether all motors and servos are off.
pub(crate) fn is_off(state: &MachineState) -> bool {
    state.channels.iter().all(|channel| channel.mode == Mode::Off) && state.servos == [0; 6]
}

/// Whether anything is driven. A neutral PWM is how another host ends its own drive.
pub(crate) fn is_driven(state: &MachineState) -> bool {
    let is_neutral = |c: &ChannelState| c.mode == Mode::Pwm && c.set_point == 0;
    let is_driven = |c: &ChannelState| c.mode != Mode::Off && !is_neutral(c);
    state.channels.iter().any(is_driven) || state.servos != [0; 6]
}

/// The machine state has the low 16 bits of the uptime: this counts on from the first.
#[derive(Default)]
pub(crate) struct Uptime(Option<(u16, u64)>);

impl Uptime {
    pub(crate) fn unwrap(&mut self, time_ms: u16) -> u64 {
        let (last, total) = self.0.unwrap_or((time_ms, 0));
        let total = total + u64::from(time_ms.wrapping_sub(last));
        self.0 = Some((time_ms, total));
        total
    }
}
