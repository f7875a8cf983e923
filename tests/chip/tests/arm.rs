//! The Pioneer Arm's shipped image: a session from SYNC0 to CLOSE, and joints on real pulses.

use chip::bench::world::F407;
use chip::bench::{Bench, Make};
use hal_mock::plant::Scene;
use protocol::arcos::{
    Arcos, Argument, ArmCommand, ArmStatus, JointNumber, Packet, SYNC, Standard, StatusRequest,
    command, encode_command,
};
use protocol::deframe::Deframer;

const IMAGE: &str = "pioneer-arm-f407";
/// Where joints 1 to 6 are sent, in ticks: each somewhere else, on both sides of home.
const PLACES: [u8; 6] = [60, 97, 111, 150, 183, 206];

struct Host {
    bench: Bench,
    deframer: Deframer<Arcos, 256>,
}

impl Host {
    fn boot() -> Self {
        let mut scene = Scene::default();
        scene.environment.gpio_in = 0xFE; // the arm's cable: input 0 is low
        let bench = Bench::boot_with(IMAGE, Make { scene, ..Make::default() });
        Self { bench, deframer: Deframer::new() }
    }

    fn send(&mut self, bytes: &[u8]) {
        self.bench.line.send(bytes);
    }

    fn send_bare(&mut self, id: u8) {
        let packet = Packet { id, data: &[] }.encode(&mut [0; 6]).unwrap().to_vec();
        self.send(&packet);
    }

    /// Packets heard in the next milliseconds: id and data.
    fn heard(&mut self, ms: u64) -> Vec<(u8, Vec<u8>)> {
        self.bench.run_for(ms);
        let mut packets = Vec::new();
        for (_, byte) in self.bench.line.heard() {
            if let Some(bytes) = self.deframer.receive(&mut &[byte][..]) {
                let packet = Packet::parse(bytes).unwrap();
                packets.push((packet.id, packet.data.to_vec()));
            }
        }
        packets
    }

    fn ids(&mut self, ms: u64) -> Vec<u8> {
        self.heard(ms).into_iter().map(|(id, _)| id).collect()
    }
}

#[test]
fn a_session_from_sync0_to_close_moves_every_joint_at_9600_baud() {
    let mut host = Host::boot();
    host.bench.run_for(100);
    for sync in SYNC {
        host.send_bare(sync.id);
        assert_eq!(host.ids(60), [sync.id]);
    }
    let open =
        encode_command(command::OPEN, Some(Argument::Positive(1)), &mut [0; 9]).unwrap().to_vec();
    host.send(&open);
    let standard = host.ids(1050);
    assert!((10..=11).contains(&standard.len()), "ten a second: {standard:?}");
    assert!(standard.iter().all(|&id| id == Standard::ID));

    let no_pulse = host.bench.with(|stand| {
        let chip = &mut stand.rig().chip;
        F407.servos.map(|output| chip.pulses(output).map_or(0.0, |pulses| pulses.width_ns))
    });
    assert_eq!(no_pulse, [0.0; 6], "without power no joint has a pulse");
    let power = ArmCommand::Power(true).encode(&mut [0; 9]).unwrap().to_vec();
    host.send(&power);
    host.heard(100);
    for (joint, ticks) in (1..).zip(PLACES) {
        let joint = JointNumber::new(joint).unwrap();
        let go = ArmCommand::Position { joint, ticks }.encode(&mut [0; 9]).unwrap().to_vec();
        host.send(&go);
        host.heard(60);
    }
    // At the default speed the way takes seconds; PULSE keeps the session.
    for _ in 0..12 {
        host.send_bare(command::PULSE);
        host.heard(500);
    }
    let ask = ArmCommand::Status(StatusRequest::Once).encode(&mut [0; 9]).unwrap().to_vec();
    host.send(&ask);
    let (_, data) =
        host.heard(100).into_iter().find(|(id, _)| *id == ArmStatus::ID).expect("ARMpac");
    assert_eq!(data[2..8], PLACES, "all joints are where they were sent");
    let pulses = host.bench.with(|stand| {
        let chip = &mut stand.rig().chip;
        F407.servos.map(|output| chip.pulses(output).expect("a pulse"))
    });
    for (joint, (pulses, ticks)) in pulses.into_iter().zip(PLACES).enumerate() {
        // 0.59 to 2.41 ms for 0 to 255 ticks, 7 us a tick.
        let (width, wanted) =
            (pulses.width_ns / 1000.0, 590.0 + f64::from(ticks) * (2410.0 - 590.0) / 255.0);
        assert!((width - wanted).abs() < 4.0, "joint {}: {width} us, not {wanted}", joint + 1);
        assert!((pulses.period_ns - 20e6).abs() < 1e4, "joint {}: {pulses:?}", joint + 1);
    }
    // An arm whose cable is lost goes home, and then has no power.
    host.bench.with(|stand| stand.rig().world.plant.overrides.gpio_in = Some(0xFF));
    for _ in 0..16 {
        host.send_bare(command::PULSE);
        host.heard(500);
    }
    let without = host.bench.with(|stand| {
        let chip = &mut stand.rig().chip;
        F407.servos.map(|output| chip.pulses(output).map_or(0.0, |pulses| pulses.width_ns))
    });
    assert_eq!(without, [0.0; 6]);
    host.send_bare(command::CLOSE);
    host.heard(100);
    assert!(host.ids(600).is_empty(), "nothing after CLOSE");
}
