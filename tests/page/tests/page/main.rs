//! What a person sees and does on the page, and what that does to the simulated board.

mod arming;
mod driving;
mod faults;
mod lcd;
mod one_file;
mod pictures;
mod settings;
mod tuning;
