//! For the target only: the image's linker script.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-changed=mps2-an386.x");
    let variable = |name| std::env::var(name).unwrap_or_default();
    if variable("CARGO_CFG_TARGET_OS") == "none" {
        let script = format!("{}/mps2-an386.x", variable("CARGO_MANIFEST_DIR"));
        for argument in ["--nmagic", "-T", &script] {
            println!("cargo::rustc-link-arg-bins={argument}");
        }
    }
}
