//! Versions of packages that decide bytes: `cargo install` without `--locked` takes the newest ones that
//! Cargo.toml allows.

use std::path::Path;

/// What decides the bytes of datasets (arithmetic, random numbers, numbers as text, images and previews) and
/// of the archives of challenges.
const DECIDING: &str =
    "chacha20 csv fdeflate flate2 glam image itoa libm miniz_oxide png ron serde_json tiff zip zmij";

fn read(name: &str) -> String {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    std::fs::read_to_string(root.join(name)).unwrap()
}

#[test]
fn what_decides_bytes_does_not_depend_on_the_lock_file() {
    let (manifest, lock) = (read("Cargo.toml"), read("Cargo.lock"));
    let of_command = ["microsig-core", "flows", "storage", "scenario", "generator", "arena", "bench"];
    let of_command: Vec<String> =
        of_command.iter().map(|of| read(&format!("crates/{of}/Cargo.toml"))).collect();
    for name in DECIDING.split(' ') {
        let begins = [format!("{name} = \""), format!("{name} = {{ version = \"")];
        let version = manifest
            .lines()
            .find_map(|line| begins.iter().find_map(|begin| line.strip_prefix(begin.as_str())))
            .and_then(|rest| rest.split('"').next())
            .unwrap_or_default();
        let locked = |exact| lock.contains(&format!("name = \"{name}\"\nversion = \"{exact}\""));
        assert!(
            version.strip_prefix('=').is_some_and(locked),
            "{name} = \"{version}\": expected = and the version in Cargo.lock"
        );
        // It binds only if a package of the command asks for it.
        let asks = of_command.iter().any(|manifest| manifest.contains(&format!("\n{name}.workspace = true")));
        assert!(asks, "{name}: no package of the command depends on it");
    }
}
