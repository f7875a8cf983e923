//! The loops of the shipped image, closed through real counters and the real scan; both ends bounded.

use chip::bench::pms5005::Host;
use chip::bench::world::F407;
use protocol::pms5005::{Channel, Command, Data, Method, Parameter, Parameters, Quantity, Sensor};

const IMAGE: &str = "pms5005-f407";

fn configure(host: &mut Host, parameters: &[Parameter]) {
    let mut data = Data::new();
    parameters.iter().for_each(|parameter| parameter.emit(&mut data).expect("it fits"));
    host.order(Command::Parameters(Parameters::parse(&data).expect("what was just emitted")));
}

fn position(host: &Host, motor: usize) -> i64 {
    host.bench.with(move |stand| stand.rig().world.plant.motors[motor].position())
}

fn only(channel: usize, target: i16) -> [Option<i16>; 6] {
    let mut targets = [None; 6];
    targets[channel] = Some(target);
    targets
}

#[test]
fn a_velocity_is_held_through_the_quadrature_counters_of_both_encoders() {
    let mut host = Host::boot(IMAGE);
    for (channel, speed) in [(0, 2000), (1, -2000)] {
        host.go(Quantity::Velocity, only(channel, speed));
        host.live_for(600);
        let start = position(&host, channel);
        host.live_for(1000);
        let mean = position(&host, channel) - start;
        assert!((mean - i64::from(speed)).abs() <= 20, "{channel}: {mean} for {speed}");
        let told = host.motors().encoders[channel];
        // Counts are told modulo 32768; the report is 50 ms old at most.
        let way = (position(&host, channel) - i64::from(told.count)).rem_euclid(32_768);
        assert!(way.min(32_768 - way) <= 200, "{channel}: {told:?}, and stands {way} from there");
        assert!(told.speed.abs_diff(2000) <= 60, "{told:?}");
        assert_eq!(told.positive, speed > 0);
    }
}

#[test]
fn a_position_is_reached_through_the_counters_and_through_a_potentiometer_in_the_scan() {
    let mut host = Host::boot(IMAGE);
    let wheel = Channel::ALL[0];
    configure(&mut host, &[Parameter::Sensor(wheel, Sensor::Encoder)]);
    configure(&mut host, &[Parameter::Method(wheel, Method::Position)]);
    let joint = Channel::ALL[3];
    configure(&mut host, &[Parameter::Method(joint, Method::Position)]);
    // A wheel by its encoder, a joint by its potentiometer: from 2048, which is the middle.
    host.go(Quantity::Position, [Some(6000), None, None, Some(2600), None, None]);
    let mut peaks = [0, 0];
    for _ in 0..20 {
        host.live_for(60);
        peaks[0] = peaks[0].max(position(&host, 0));
        peaks[1] = peaks[1].max(position(&host, 3));
    }
    let (wheel, joint) = (position(&host, 0), position(&host, 3));
    assert!((5960..=6040).contains(&wheel), "{wheel}");
    assert!((2575..=2625).contains(&joint), "{joint}");
    assert!(peaks[0] <= 6600 && peaks[1] <= 2700, "overshoot: {peaks:?}");
}

#[test]
fn six_channels_and_six_servos_make_their_pulses_at_once() {
    let mut host = Host::boot(IMAGE);
    // Parts of 32768: a quarter forward is a duty of 62.5 % of locked anti-phase.
    let duties = [4096, 8192, -8192, 12_288, -4096, 16_384].map(|raw: i16| Some(raw / 2 + 16_384));
    host.go(Quantity::Pwm, duties);
    let pulses = [2250, 2700, 3375, 4500, 5625, 6000];
    host.go(Quantity::Servo, pulses.map(Some));
    host.run_for(30);
    let (bridges, servos) = host.bench.with(|stand| {
        let chip = &mut stand.rig().chip;
        (
            F407.bridges.map(|output| chip.pulses(output)),
            F407.servos.map(|output| chip.pulses(output)),
        )
    });
    for (channel, (pulses, duty)) in bridges.iter().zip(duties).enumerate() {
        let pulses = pulses.unwrap_or_else(|| panic!("channel {channel} has no PWM"));
        assert!((pulses.period_ns - 50_000.0).abs() < 20.0, "20 kHz: {pulses:?}");
        let asked = f64::from(duty.unwrap()) / 32_768.0;
        assert!((pulses.duty() - asked).abs() < 0.001, "{channel}: {} for {asked}", pulses.duty());
    }
    for (servo, (made, asked)) in servos.iter().zip(pulses).enumerate() {
        let made = made.unwrap_or_else(|| panic!("servo {servo} has no pulse"));
        assert!((made.period_ns - 20e6).abs() < 1e4, "50 Hz: {made:?}");
        let asked_ns = f64::from(asked) * 1e6 / 2250.0;
        assert!((made.width_ns - asked_ns).abs() < 700.0, "{servo}: {made:?} for {asked_ns}");
    }
}
