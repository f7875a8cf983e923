//! A host in forty lines: runs motor 1 at 4000 counts a second for two seconds, prints where its encoder is,
//! and stops it. Start the virtual board first (`cargo run --release -p hal-mock`), then `cargo run -p
//! handwheel --example drive`; another link may be given as the argument (`serial:/dev/ttyUSB0`).

use std::time::Duration;

use handwheel::{Client, Error, Number, Target, words};

fn main() -> Result<(), Error> {
    let link = std::env::args().nth(1).unwrap_or("tcp:127.0.0.1:5005".into());
    let mut board = Client::connect(&link.parse()?)?;
    if let Some(identity) = board.identity() {
        println!("{} with firmware {:?}", board.personality(), identity.version);
    }
    for fault in board.faults()? {
        println!(
            "{} of {}: {}",
            words::fault(fault.fault),
            words::whose(&fault),
            words::remedy(fault.fault)
        );
    }

    // While the drive is held it keeps the board's motor running; dropped, it stops it.
    let mut drive = board.drive(Number::ONE, Target::Velocity(4000), Duration::from_millis(500))?;
    let mut said = Duration::ZERO;
    drive.hold_while(|elapsed, state| {
        if let Some(state) = state
            && elapsed >= said
        {
            let wheel = &state.channels[Number::ONE.index()];
            println!("count {:6}, {:5} counts/s", wheel.position, wheel.velocity);
            said += Duration::from_millis(200);
        }
        elapsed < Duration::from_secs(2)
    })?;
    let stopped = drive.stop()?;
    println!("stands: {:?}, after {:?}", stopped.stands, stopped.after);

    let period = board.setting("telemetry period")?;
    println!("{} is {} ms", period.name, period.value);
    Ok(())
}
