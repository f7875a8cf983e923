//! For the boards: names the linker scripts of the images, and where memory.x is (the top level).
//! On a computer there is nothing to do. hal-mock, which has an image too, uses this file as well.

fn main() {
    println!("cargo::rerun-if-changed=../firmware/build.rs");
    println!("cargo::rerun-if-changed=../memory.x");
    let variable = |name| std::env::var(name).unwrap_or_default();
    if variable("CARGO_CFG_TARGET_OS") == "none" {
        println!("cargo::rustc-link-search={}/..", variable("CARGO_MANIFEST_DIR"));
        println!("cargo::rustc-link-arg-bins=--nmagic");
        println!("cargo::rustc-link-arg-bins=-Tlink.x");
        if std::env::var_os("CARGO_FEATURE_DEFMT").is_some() {
            println!("cargo::rustc-link-arg-bins=-Tdefmt.x");
        }
    }
}
