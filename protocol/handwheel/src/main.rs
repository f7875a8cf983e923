//! `handwheel`: the command line of [`handwheel::cli`] in a shell.

use std::io::IsTerminal;
use std::process::ExitCode;

use anstyle_query::windows::enable_ansi_colors;
use handwheel::cli::{Interrupt, Surroundings, run};

fn main() -> ExitCode {
    let interrupt = Interrupt::default();
    if let Err(error) = catch(&interrupt) {
        eprintln!("handwheel: Ctrl-C could not be caught ({error}); nothing was sent");
        return ExitCode::FAILURE;
    }
    let (mut out, mut err) = (std::io::stdout(), std::io::stderr());
    // Windows' own terminal can be drawn on once it is told to; others can anyway.
    let is_terminal = out.is_terminal() && enable_ansi_colors().unwrap_or(true);
    let mut keyboard = std::io::stdin().lock();
    let is_asked = is_terminal && keyboard.is_terminal();
    let keyboard = is_asked.then_some(&mut keyboard as &mut dyn std::io::BufRead);
    ExitCode::from(run(
        std::env::args_os(),
        &mut Surroundings { out: &mut out, err: &mut err, is_terminal, keyboard, interrupt },
    ))
}

/// Has a Ctrl-C stop what is driven, and so has a closed terminal. The second one ends the program, and
/// silence ends what it drove.
#[cfg(unix)]
fn catch(interrupt: &Interrupt) -> std::io::Result<()> {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
    use signal_hook::flag;
    for signal in [SIGINT, SIGTERM, SIGHUP] {
        // In this order.
        flag::register_conditional_default(signal, interrupt.ends_program.clone())?;
        flag::register(signal, interrupt.ends_program.clone())?;
        flag::register(signal, interrupt.wanted.clone())?;
    }
    Ok(())
}

/// The same of the console's events.
#[cfg(windows)]
fn catch(interrupt: &Interrupt) -> Result<(), ctrlc::Error> {
    use std::sync::atomic::Ordering;
    let (wanted, ends_program) = (interrupt.wanted.clone(), interrupt.ends_program.clone());
    ctrlc::set_handler(move || {
        if ends_program.swap(true, Ordering::Relaxed) {
            std::process::exit(130); // as a shell calls it
        }
        wanted.store(true, Ordering::Relaxed);
    })
}
