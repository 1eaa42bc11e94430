//! Python environments for comparisons with Python programs.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, ensure};
use serde_json::Value;

use crate::process::{Usage, run};

/// A Python environment with the packages of a requirements file.
pub struct Python {
    interpreter: PathBuf,
}

impl Python {
    /// Creates the environment `target/python/<name>`, or reuses it.
    pub fn with(name: &str, requirements: &Path) -> anyhow::Result<Self> {
        let place = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../target/python/{name}"));
        let interpreter = place.join("bin/python");
        let done = place.join("installed.txt");
        let wanted = std::fs::read_to_string(requirements)?;
        if std::fs::read_to_string(&done).is_ok_and(|installed| installed == wanted) {
            return Ok(Python { interpreter });
        }
        std::fs::create_dir_all(&place)?;
        call(Command::new("python3").args(["-m", "venv"]).arg(&place))?;
        call(Command::new(&interpreter).args(["-m", "pip", "install", "--quiet", "-r"]).arg(requirements))?;
        std::fs::write(done, wanted)?;
        Ok(Python { interpreter })
    }

    /// A command that runs a script.
    pub fn command(&self, script: &Path) -> Command {
        let mut command = Command::new(&self.interpreter);
        command.arg(script);
        command
    }

    /// Runs a script on one thread; returns usage and the JSON object printed last.
    pub fn run(&self, script: &Path, arguments: &[&str]) -> anyhow::Result<(Usage, Value)> {
        let mut command = self.command(script);
        command.args(arguments);
        for threads in ["OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"] {
            command.env(threads, "1");
        }
        let (usage, said) = run(&mut command)?;
        let line = said.lines().last().with_context(|| format!("{} said nothing", script.display()))?;
        Ok((usage, serde_json::from_str(line).with_context(|| format!("{}: {line}", script.display()))?))
    }
}

fn call(command: &mut Command) -> anyhow::Result<()> {
    let output = command.output().with_context(|| format!("{command:?}"))?;
    ensure!(output.status.success(), "{command:?}: {}", String::from_utf8_lossy(&output.stderr).trim());
    Ok(())
}
