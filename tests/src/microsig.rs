//! Running the `microsig` command.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

/// The command.
pub fn microsig() -> Command {
    Command::new(binary())
}

/// Path of the executable.
pub fn binary() -> &'static Path {
    static BINARY: OnceLock<PathBuf> = OnceLock::new();
    BINARY.get_or_init(|| {
        let test = std::env::current_exe().expect("a test has a path");
        let folder = test.ancestors().nth(2).expect("tests lie in target/PROFILE/deps");
        let binary = folder.join("microsig-tested").with_extension(std::env::consts::EXE_EXTENSION);
        assert!(binary.is_file(), "{}: run `cargo test`, which builds it", binary.display());
        binary
    })
}

/// Runs a command and asserts that it succeeds.
pub fn succeed(command: &mut Command) -> Output {
    let output = command.output().expect("microsig runs");
    assert!(output.status.success(), "{command:?}: {}", text(&output.stderr));
    output
}

/// Runs the command, asserts that it succeeds, and returns its standard output.
pub fn run(arguments: &[impl AsRef<OsStr>]) -> String {
    text(&succeed(microsig().args(arguments)).stdout)
}

/// Runs the command, asserts that it succeeds, and returns its standard error.
pub fn told(arguments: &[impl AsRef<OsStr>]) -> String {
    text(&succeed(microsig().args(arguments)).stderr)
}

/// Runs the command with `--json` and `--quiet`; returns what it prints.
pub fn json(arguments: &[impl AsRef<OsStr>]) -> serde_json::Value {
    let output = succeed(microsig().args(arguments).args(["--json", "--quiet"]));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Runs the command, asserts that it fails with this exit code, and returns its standard error.
pub fn fail(code: i32, arguments: &[impl AsRef<OsStr>]) -> String {
    let mut command = microsig();
    let Output { status, stderr, .. } = command.args(arguments).output().expect("microsig runs");
    assert_eq!(status.code(), Some(code), "{command:?}: {}", text(&stderr));
    text(&stderr)
}

/// Writes a file into a folder; returns its path.
pub fn write(folder: &Path, name: &str, content: impl AsRef<[u8]>) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, content).unwrap();
    path
}

/// Generates the dataset `name` of a scenario in a folder; returns its path. The scenario is kept beside it.
pub fn generate(folder: &Path, name: &str, scenario: &str) -> PathBuf {
    let (file, out) = (write(folder, &format!("{name}.ron"), scenario), folder.join(name));
    run(&["generate", path(&file), "--out", path(&out), "--quiet"]);
    out
}

/// What the command has printed.
pub fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// A path as an argument.
pub fn path(path: &Path) -> &str {
    path.to_str().expect("test paths are UTF-8")
}

/// What the manifest of a dataset tells.
pub fn manifest(dataset: &Path) -> serde_json::Value {
    let text = std::fs::read(dataset.join("datapackage.json")).unwrap();
    serde_json::from_slice::<serde_json::Value>(&text).unwrap()["microsig"].clone()
}

/// Names of the files and folders in a folder, sorted.
pub fn listing(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap();
    let mut names: Vec<String> = entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// The output of `grep ' images/' SHA256SUMS | sha256sum` in a dataset.
pub fn images_sha256(dataset: &Path) -> String {
    let sums = std::fs::read_to_string(dataset.join("SHA256SUMS")).unwrap();
    let lines: String = sums.lines().filter(|l| l.contains("  images/")).map(|l| format!("{l}\n")).collect();
    crate::sha256_of(lines.as_bytes())
}
