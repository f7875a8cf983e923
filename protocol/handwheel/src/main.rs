//! `handwheel`: the command line of [`handwheel::cli`] in a shell.

use std::io::IsTerminal;
use std::process::ExitCode;

use anstyle_query::windows::enable_ansi_colors;
use handwheel::cli::{Interrupt, Surroundings, run};
use signal_hook::flag;

fn main() -> ExitCode {
    let interrupt = Interrupt::default();
    // A closed terminal stops a motor too, where there is such a signal.
    #[cfg(unix)]
    const SIGNALS: &[i32] =
        &[signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM, signal_hook::consts::SIGHUP];
    #[cfg(not(unix))]
    const SIGNALS: &[i32] = &[signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM];
    for &signal in SIGNALS {
        // In this order: the second Ctrl-C ends the program, and silence ends what it drove.
        let caught = flag::register_conditional_default(signal, interrupt.ends_program.clone())
            .and_then(|_| flag::register(signal, interrupt.ends_program.clone()))
            .and_then(|_| flag::register(signal, interrupt.wanted.clone()));
        if let Err(error) = caught {
            eprintln!("handwheel: Ctrl-C could not be caught ({error}); nothing was sent");
            return ExitCode::FAILURE;
        }
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
