//! Who has a device open, on Linux; elsewhere nobody can tell.

use std::fs;
use std::path::Path;
use std::time::Duration;

/// For how long a program has to have a device that is called its holder: some only look at one.
const LONG: Duration = Duration::from_millis(100);

/// How the names of serial devices begin.
const SERIAL: [&str; 3] = ["/dev/tty", "/dev/pts/", "/dev/rfcomm"];

/// The programs that have this device open, other than this one: `minicom (process 1234)`. Of other
/// people's programs only root is told.
pub fn holders_for_long(device: &str) -> Vec<String> {
    let first = holders(device);
    if first.is_empty() {
        return Vec::new();
    }
    std::thread::sleep(LONG);
    // By their numbers: a program may have become another meanwhile.
    let both = holders(device).into_iter().filter(|process| first.contains(process));
    both.map(|process| {
        let name = fs::read_to_string(format!("/proc/{process}/comm")).unwrap_or_default();
        format!("{} (process {process})", name.trim())
    })
    .collect()
}

fn holders(device: &str) -> Vec<u32> {
    let Ok(device) = fs::canonicalize(device) else { return Vec::new() };
    // Everybody has /dev/null.
    let is_port = |name: &str| SERIAL.iter().any(|begin| name.starts_with(begin));
    if !device.to_str().is_some_and(is_port) {
        return Vec::new();
    }
    let processes = fs::read_dir("/proc").into_iter().flatten().flatten();
    let numbers = processes.filter_map(|entry| entry.file_name().to_str()?.parse::<u32>().ok());
    numbers.filter(|&number| number != std::process::id() && has_open(number, &device)).collect()
}

fn has_open(process: u32, device: &Path) -> bool {
    let files = fs::read_dir(format!("/proc/{process}/fd")).into_iter().flatten().flatten();
    files.filter_map(|file| fs::read_link(file.path()).ok()).any(|file| file == device)
}
