//! For the target only: the image begins at what it calls.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    if std::env::var("CARGO_CFG_TARGET_OS").is_ok_and(|os| os == "none") {
        println!("cargo::rustc-link-arg-bins=--entry=everything");
        println!("cargo::rustc-link-arg-bins=--gc-sections");
    }
}
