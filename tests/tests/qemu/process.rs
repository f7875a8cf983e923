//! A QEMU process with an image on `netduinoplus2` (an STM32F405, the F407's die), and its sockets.

use std::io::Read;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc;
use std::time::Duration;

/// A running QEMU. It ends when it is dropped, and its folder goes with it.
pub struct Qemu {
    child: Child,
    folder: PathBuf,
}

/// An image, from the script that builds all of them.
pub fn image(name: &str) -> PathBuf {
    let images = Path::new(env!("CARGO_MANIFEST_DIR")).join("../target/images");
    let path = images.join(name).with_extension("elf");
    assert!(path.exists(), "{} is missing: run .ci/images", path.display());
    path
}

impl Qemu {
    /// Starts it in a folder of its own with options that take a socket, each with the socket's name.
    pub fn start(image: &Path, sockets: &[(&str, &str)]) -> Self {
        let folder = std::env::temp_dir().join(format!("pms5005-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let mut command = Command::new("qemu-system-arm");
        command.args(["-M", "netduinoplus2", "-display", "none", "-monitor", "none"]);
        for (option, name) in sockets {
            let socket = format!("socket,id={name},path={name},server=on,wait=off");
            command.args(["-chardev", &socket, option, &format!("chardev:{name}")]);
        }
        command.arg("-kernel").arg(image).stdin(Stdio::null()).current_dir(&folder);
        let child = command.spawn();
        let child = child.expect("qemu-system-arm is needed (Debian package qemu-system-arm)");
        Self { child, folder }
    }

    /// Connects to one of its sockets. QEMU makes them a moment after its start.
    pub fn connect(&self, name: &str) -> UnixStream {
        for _ in 0..250 {
            if let Ok(stream) = UnixStream::connect(self.folder.join(name)) {
                return stream;
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        panic!("QEMU offers no {name}");
    }
}

impl Drop for Qemu {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

/// What comes from a UART. QEMU's UART stops the whole machine while its socket is full, and some
/// 300 single bytes fill it, so a thread reads it at all times.
pub fn bytes_from(uart: &UnixStream) -> mpsc::Receiver<u8> {
    let mut uart = uart.try_clone().unwrap();
    let (sender, bytes) = mpsc::channel();
    std::thread::spawn(move || {
        let mut buffer = [0; 256];
        while let Ok(count @ 1..) = uart.read(&mut buffer) {
            for &byte in &buffer[..count] {
                let _ = sender.send(byte); // nobody listens at the end of a test
            }
        }
    });
    bytes
}
