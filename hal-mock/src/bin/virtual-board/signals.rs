//! What ends the board: a Ctrl-C, and whatever else asks a program to end.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Has each of the signals set `stop`, but for those that whoever has started the program wants it to
/// ignore (as `nohup` does).
#[cfg(unix)]
pub fn end(stop: &Arc<AtomicBool>) -> std::io::Result<()> {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGQUIT, SIGTERM};
    for signal in
        [SIGHUP, SIGINT, SIGQUIT, SIGTERM].into_iter().filter(|&signal| !is_ignored(signal))
    {
        signal_hook::flag::register(signal, stop.clone())?;
    }
    Ok(())
}

#[cfg(unix)]
fn is_ignored(signal: i32) -> bool {
    let mut action = std::mem::MaybeUninit::<libc::sigaction>::uninit();
    // SAFETY: without a new action it only fills in the present one, which is read if it has.
    unsafe {
        libc::sigaction(signal, std::ptr::null(), action.as_mut_ptr()) == 0
            && action.assume_init().sa_sigaction == libc::SIG_IGN
    }
}

/// Has the console's events set `stop`.
#[cfg(windows)]
pub fn end(stop: &Arc<AtomicBool>) -> Result<(), ctrlc::Error> {
    let stop = stop.clone();
    ctrlc::set_handler(move || stop.store(true, std::sync::atomic::Ordering::Relaxed))
}
