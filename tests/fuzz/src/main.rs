//! One fuzzer for all trials: the environment's `TRIAL` names which. libFuzzer brings `main`, makes
//! bytes, and sees what they reach; a trial takes them as its choices. `.ci/fuzz` builds and runs it.
#![no_main]

use std::sync::OnceLock;

use libfuzzer_sys::fuzz_target;
use tests::trials::{ALL, Choices, Trial};

static TRIAL: OnceLock<Trial> = OnceLock::new();

fn named() -> Trial {
    let name = std::env::var("TRIAL").unwrap_or_default();
    let names: Vec<_> = ALL.iter().map(|(name, _)| *name).collect();
    let found = ALL.iter().find(|(known, _)| *known == name);
    found.unwrap_or_else(|| panic!("TRIAL={name}: must be one of {}", names.join(", "))).1
}

fuzz_target!(|bytes: &[u8]| TRIAL.get_or_init(named)(&mut Choices::of(bytes)));
