//! The scenarios, one file a subject, in one program: it is linked once, and no core waits for the longest
//! scenario of a file. `.ci/chip latency::` runs one file's.

mod arm;
mod boot;
mod bus;
mod cm5;
mod flash;
mod latency;
mod line;
mod motion;
mod order;
mod pass_through;
mod power;
mod probe;
mod recorder;
mod safe;
mod scan;
mod script;
mod sensors;
