//! Finds the scenarios that the program embeds: from the repository, or, in a published package, the copy inside the
//! package. In the repository `crates/scenario/scenarios` is a link, which `cargo package` resolves; it is not followed
//! here, because checkouts on Windows may contain a text file in its place.

use std::path::Path;

fn main() {
    let package = std::env::var("CARGO_MANIFEST_DIR").expect("cargo sets it");
    let package = Path::new(&package);
    let in_repository = package.join("../../scenarios");
    // Next to a published package there may be any folder; the repository's contains this file.
    let folder = if in_repository.join("quickstart.ron").is_file() {
        in_repository
    } else {
        package.join("scenarios")
    };
    println!("cargo::rustc-env=MICROSIG_SCENARIOS={}", folder.display());
    println!("cargo::rerun-if-changed={}", folder.display());
    println!("cargo::rerun-if-changed=build.rs");
}
