//! In which order outputs come on and go off: a bridge has its duty before it is enabled, and is disabled
//! before anything else ends. The same run comes out of the same orders, so the first run tells when the
//! line changes, and a second one is stopped there.

use chip::bench::pms5005::Host;
use chip::bench::world::F407;
use protocol::pms5005::{Addressing, CHANNELS, Command, Move, Quantity, Scope};
use rigless::device::Level;
use rigless::soc::stm32f427::generated::gpioa;

const IMAGE: &str = "pms5005-f407";

/// What is driven, as the registers have it.
#[derive(Debug, PartialEq)]
struct Driven {
    enabled: [bool; CHANNELS],
    /// In thousandths; 500 is neutral.
    duties: [u32; CHANNELS],
    /// In us.
    pulses: [u32; CHANNELS],
    /// The output port, bit 0 first.
    outputs: u64,
}

fn driven(host: &Host) -> Driven {
    host.bench.with(|stand| {
        let chip = &mut stand.rig().chip;
        let duty = |pulses: chip::part::Pulses| (pulses.duty() * 1000.0).round() as u32;
        let width = |pulses: chip::part::Pulses| (pulses.width_ns / 1000.0).round() as u32;
        Driven {
            enabled: F407.enables.map(|(port, pin)| chip.level(port, pin) == Level::High),
            duties: F407.bridges.map(|output| chip.pulses(output).map_or(0, duty)),
            pulses: F407.servos.map(|output| chip.pulses(output).map_or(0, width)),
            outputs: chip.register("GPIOD", gpioa::Register::Odr) >> 8,
        }
    })
}

fn pwm(targets: [Option<i16>; CHANNELS]) -> Command<'static> {
    let addressing = Addressing::List;
    Command::Move(Move { quantity: Quantity::Pwm, addressing, targets, periods: 0 })
}

/// A board on which everything moves.
fn going() -> Host {
    let mut host = Host::boot(IMAGE);
    host.order(pwm([Some(24_576); CHANNELS]));
    host.go(Quantity::Servo, [Some(3375); CHANNELS]);
    host.order(Command::GpioOutputs(0xFF));
    host.live_for(100);
    assert_eq!(driven(&host), ALL);
    host
}

const ALL: Driven = Driven {
    enabled: [true; CHANNELS],
    duties: [750; CHANNELS],
    pulses: [1500; CHANNELS],
    outputs: 0xFF,
};

/// What is driven just before `cause` changes the first enable line, with the change, and 3 ms later.
fn around_the_edge(prepare: fn() -> Host, cause: impl Fn(&mut Host)) -> [Driven; 3] {
    let mut host = prepare();
    let begun_ns = host.bench.now_ns();
    cause(&mut host);
    host.run_for(5);
    let edge_ns = host.bench.with(move |stand| {
        let mut changes = stand.rig().world.enabled.iter();
        changes.find(|change| change.0 > begun_ns && change.1 == 0).expect("it changes").0
    });
    let mut host = prepare();
    cause(&mut host);
    // An instruction takes 6 ns.
    [edge_ns - 20, edge_ns, edge_ns + 3_000_000].map(|ns| {
        host.bench.run_until_ns(ns);
        driven(&host)
    })
}

#[test]
fn a_bridge_has_its_duty_before_it_is_enabled_and_its_neighbours_are_left_alone() {
    let [before, at, after] = around_the_edge(
        || Host::boot(IMAGE),
        |host| host.send(pwm([Some(24_576), None, None, None, Some(8192), None])),
    );
    assert_eq!((before.enabled[0], before.duties[0]), (false, 750));
    assert_eq!((at.enabled[0], at.duties[0]), (true, 750));
    assert_eq!(after.enabled, [true, false, false, false, true, false]);
    assert_eq!(after.duties, [750, 500, 500, 500, 250, 500]);
    assert_eq!((after.pulses, after.outputs), ([0; CHANNELS], 0));
}

#[test]
fn a_suspension_disables_a_bridge_before_its_duty_ends() {
    let suspend = Command::Run { scope: Scope::All, run: false };
    let [before, at, after] = around_the_edge(going, |host| host.send(suspend));
    assert_eq!(before, ALL);
    assert_eq!((at.enabled[0], at.duties[0]), (false, 750));
    assert_eq!((after.enabled, after.duties), ([false; CHANNELS], [500; CHANNELS]));
    assert_eq!(after.pulses, [0; CHANNELS]);
}

/// Thumb code that goes to another place: `nop` up to a whole word, `ldr.w pc, [pc, #0]`, the place.
fn jump(from: u64, to: u64) -> Vec<u16> {
    let align = if from.is_multiple_of(4) { &[][..] } else { &[0xBF00] };
    let place = to | 1;
    [align, &[0xF8DF, 0xF000, place as u16, (place >> 16) as u16]].concat() // 32 bits
}

#[test]
fn a_fault_and_a_panic_disable_every_bridge_at_once_and_then_end_the_rest() {
    const IN_CONTROL: &str = "control_task_inner_function0E4poll";
    let causes: [fn(&mut Host); 3] = [
        |host| drop(host.bench.patch(IN_CONTROL, &[0xDE00])), // udf
        |host| drop(host.bench.patch(IN_CONTROL, &[0xB4FF, 0xE7FD])), // push {r0-r7} for ever
        |host| {
            let places = [IN_CONTROL, "18panic_bounds_check"];
            let [from, to] = places.map(|part| host.bench.symbol(part));
            host.bench.patch(IN_CONTROL, &jump(from, to));
        },
    ];
    let enabled = [false; CHANNELS];
    let safe = Driven { enabled, duties: [500; CHANNELS], pulses: [0; CHANNELS], outputs: 0 };
    for cause in causes {
        let [before, at, after] = around_the_edge(going, cause);
        assert_eq!(before, ALL);
        assert_eq!(at, Driven { enabled, ..ALL });
        assert_eq!(after, safe);
    }
}
