//! Python environments of the tasks that compare with Python programs.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, ensure};
use serde_json::Value;

use crate::process::{Usage, run};

/// A Python with the packages of `xtask/python/<name>.txt`.
pub(crate) struct Python {
    interpreter: PathBuf,
}

impl Python {
    /// Makes the environment in `target/python/`, or finds it there from the last time.
    pub(crate) fn with(name: &str) -> anyhow::Result<Self> {
        let requirements = folder().join(format!("{name}.txt"));
        let place = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../target/python/{name}"));
        let interpreter = place.join("bin/python");
        let done = place.join("installed.txt");
        let wanted = std::fs::read_to_string(&requirements)?;
        if std::fs::read_to_string(&done).is_ok_and(|installed| installed == wanted) {
            return Ok(Python { interpreter });
        }
        std::fs::create_dir_all(&place)?;
        call(Command::new("python3").args(["-m", "venv"]).arg(&place))?;
        call(Command::new(&interpreter).args(["-m", "pip", "install", "--quiet", "-r"]).arg(requirements))?;
        std::fs::write(done, wanted)?;
        Ok(Python { interpreter })
    }

    /// A command that runs a script of `xtask/python`.
    pub(crate) fn command(&self, script: &str) -> Command {
        let mut command = Command::new(&self.interpreter);
        command.arg(folder().join(script));
        command
    }

    /// Runs a script of `xtask/python` on one thread; gives what it took and the JSON object it printed last.
    pub(crate) fn run(&self, script: &str, arguments: &[&str]) -> anyhow::Result<(Usage, Value)> {
        let mut command = self.command(script);
        command.args(arguments);
        for threads in ["OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"] {
            command.env(threads, "1");
        }
        let (usage, said) = run(&mut command)?;
        let line = said.lines().last().with_context(|| format!("{script} said nothing"))?;
        Ok((usage, serde_json::from_str(line).with_context(|| format!("{script}: {line}"))?))
    }
}

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("python")
}

fn call(command: &mut Command) -> anyhow::Result<()> {
    let output = command.output().with_context(|| format!("{command:?}"))?;
    ensure!(output.status.success(), "{command:?}: {}", String::from_utf8_lossy(&output.stderr).trim());
    Ok(())
}
