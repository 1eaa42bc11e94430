//! Running the `microsig` command.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

/// The command.
pub fn microsig() -> Command {
    Command::new(binary())
}

/// The command's file, built in the profile of the tests.
pub fn binary() -> &'static Path {
    static BINARY: OnceLock<PathBuf> = OnceLock::new();
    BINARY.get_or_init(|| {
        // Cargo builds the binary of another package only when asked to.
        let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
        let mut build = Command::new(cargo);
        build.args(["build", "--quiet", "--package", "bench", "--bin", "microsig"]);
        if !cfg!(debug_assertions) {
            build.arg("--release");
        }
        let status = build.current_dir(env!("CARGO_MANIFEST_DIR")).status().expect("cargo runs");
        assert!(status.success(), "microsig does not build");
        let test = std::env::current_exe().expect("a test has a path");
        test.ancestors().nth(2).expect("tests lie in target/PROFILE/deps").join("microsig")
    })
}

/// Runs the command and asserts that it succeeds; gives what it wrote to standard output.
pub fn run(arguments: &[&str]) -> String {
    let output = microsig().args(arguments).output().expect("microsig runs");
    assert!(output.status.success(), "microsig {arguments:?}: {}", text(&output.stderr));
    text(&output.stdout)
}

/// Runs the command and asserts that it fails with this exit code; gives its messages.
pub fn fail(code: i32, arguments: &[&str]) -> String {
    let Output { status, stderr, .. } = microsig().args(arguments).output().expect("microsig runs");
    assert_eq!(status.code(), Some(code), "microsig {arguments:?}: {}", text(&stderr));
    text(&stderr)
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// A path as an argument.
pub fn path(path: &Path) -> &str {
    path.to_str().expect("test paths are UTF-8")
}
