//! Finds the starting kit that releases of suites contain, as `crates/scenario/build.rs` finds the scenarios.

use std::path::Path;

fn main() {
    let package = std::env::var("CARGO_MANIFEST_DIR").expect("cargo sets it");
    let package = Path::new(&package);
    let of_repository = package.join("../../examples/kit");
    let folder =
        if of_repository.join("python/pack.py").is_file() { of_repository } else { package.join("kit") };
    println!("cargo::rustc-env=MICROSIG_KIT={}", folder.display());
    println!("cargo::rerun-if-changed={}", folder.display());
    println!("cargo::rerun-if-changed=build.rs");
}
