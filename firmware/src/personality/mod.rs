//! Personalities: how a controller of old presents itself to its host.
//!
//! A personality is a session without I/O: bytes and the time go in, commands and bytes come out.
//! It knows the wire and the controller's vocabulary, never a port.

pub mod pms5005;
