//! For the boards: sees that exactly one is chosen, names the linker scripts of the images, and
//! where memory.x is (the top level). On a computer there is nothing to do. hal-mock, which has an
//! image too, uses this file as well.

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
        // Two of different chips do not come so far: embassy's own script refuses them
        // ("Multiple stm32xx Cargo features enabled").
        let boards =
            std::env::vars().filter(|(name, _)| name.starts_with("CARGO_FEATURE_BOARD_")).count();
        if boards != 1 && !variable("CARGO_FEATURE_STM32F4").is_empty() {
            println!(
                "cargo::error=choose exactly one board, not {boards}: --features board-f407 or \
                 board-f446 (firmware/src/board/README.md)"
            );
        }
    }
}
