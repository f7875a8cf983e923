//! The rooms of the firmware and what each may know, read from its sources: imports run one way, and the
//! core knows no wire format.

use std::fs;
use std::path::{Path, PathBuf};

/// Each room imports only from those before it.
const ROOMS: [&str; 17] = [
    "fmt",
    "units",
    "channel",
    "ports",
    "settings",
    "control",
    "safety",
    "command",
    "controller",
    "recorder",
    "liveness",
    "reception",
    "personality",
    "app",
    "bridge",
    "board",
    "bin",
];

/// The rooms that know the bytes of a wire.
const KNOW_A_WIRE: [&str; 3] = ["reception", "personality", "bridge"];

fn sources(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let nested = |path: PathBuf| if path.is_dir() { sources(&path) } else { vec![path] };
    let files = entries.flat_map(nested);
    files.filter(|path| path.extension().is_some_and(|extension| extension == "rs")).collect()
}

/// Each source's room, its path, and its code: no comments, and no unit tests, which may look anywhere.
fn code() -> Vec<(String, PathBuf, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../firmware/src");
    let mut all = Vec::new();
    for path in sources(&root) {
        let inside = path.strip_prefix(&root).unwrap().to_owned();
        let first = inside.iter().next().unwrap().to_str().unwrap();
        let room = first.trim_end_matches(".rs").to_owned();
        if room == "lib" {
            continue;
        }
        let text = fs::read_to_string(&path).unwrap();
        let code = text.split("\n#[cfg(test)]\nmod tests").next().unwrap();
        let is_code = |line: &&str| !line.trim_start().starts_with("//");
        let lines: Vec<_> = code.lines().filter(is_code).collect();
        all.push((room, inside, lines.join("\n")));
    }
    assert!(all.len() > 40, "the sources are elsewhere");
    all
}

/// The names behind `prefix::` in this code.
fn named<'a>(code: &'a str, prefix: &str) -> Vec<&'a str> {
    let is_name = |c: char| c.is_alphanumeric() || c == '_';
    let begins_a_path = |at: usize| !code[..at].ends_with(|c: char| is_name(c) || c == ':');
    let pattern = format!("{prefix}::");
    let behind = code.match_indices(&pattern).filter(|&(at, _)| begins_a_path(at));
    behind
        .map(|(at, _)| code[at + pattern.len()..].split(|c| !is_name(c)).next().unwrap())
        .collect()
}

#[test]
fn the_core_and_the_boards_import_no_wire_format() {
    for (room, path, code) in code() {
        let may = KNOW_A_WIRE.contains(&&*room);
        assert!(may || named(&code, "protocol").is_empty(), "{} knows a wire", path.display());
    }
    assert_eq!(
        named("use protocol::pms5005; use infrared::protocol::Nec;", "protocol"),
        ["pms5005"]
    );
}

#[test]
fn imports_run_one_way() {
    let place = |room: &str| ROOMS.iter().position(|&known| known == room);
    for (room, path, code) in code() {
        let own = place(&room).unwrap_or_else(|| panic!("{room} has no place among the rooms"));
        for prefix in ["crate", "firmware"] {
            for other in named(&code, prefix).into_iter().filter(|&other| other != room) {
                let Some(other_place) = place(other) else { continue }; // a macro of ours
                assert!(other_place < own, "{} imports from {other}", path.display());
            }
        }
    }
}
