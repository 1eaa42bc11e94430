//! A sweep as a job array on a real single-machine Slurm: controller, node daemon and munge are started in a
//! temporary folder and stopped afterwards. Needs Debian's `slurmctld slurmd slurm-client munge`, and root.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitCode, Stdio};
use std::time::Duration;

use anyhow::{Context, bail, ensure};

use suite::tree;

use super::record;
use suite::process;

const SCENARIO: &str = r#"(
    name: "base",
    optics: (preset: setting1a),
    motion: flow(field: poiseuille()),
    timing: pairs(count: 20),
)"#;

const SWEEP: &str = r#"(
    name: "array",
    base: "base.ron",
    axes: [
        (path: "optics.background_noise", values: list([0, 10, 50, 100])),
        (path: "particles.number.count", values: list([23, 46])),
    ],
    repetitions: 2,
)"#;

/// The job array script for users.
const SCRIPT: &str = "scripts/microsig-array.sbatch";

/// A single-machine Slurm, stopped on drop.
struct Slurm {
    folder: tempfile::TempDir,
    daemons: Vec<Child>,
}

impl Drop for Slurm {
    fn drop(&mut self) {
        // Jobs first, authentication last.
        let _ = self.command("scancel").args(["--user", "root"]).status();
        for daemon in self.daemons.iter_mut().rev() {
            let _ = Command::new("kill").arg(daemon.id().to_string()).status();
            let _ = daemon.wait();
        }
    }
}

impl Slurm {
    fn start() -> anyhow::Result<Slurm> {
        let folder = tempfile::Builder::new().prefix("slurm").tempdir()?;
        let at = |name: &str| folder.path().join(name).display().to_string();
        for name in ["state", "spool", "munge"] {
            std::fs::create_dir(folder.path().join(name))?;
        }
        // munge refuses keys and sockets in folders that are writable by others.
        private(folder.path(), 0o755)?;
        std::fs::write(at("munge/key"), suite::sha256(Path::new("/proc/self/exe"))?)?;
        private(Path::new(&at("munge/key")), 0o600)?;
        let host = std::fs::read_to_string("/proc/sys/kernel/hostname")?.trim().to_owned();
        let cpus = std::thread::available_parallelism()?;
        let configuration = format!(
            "ClusterName=microsig\nSlurmctldHost={host}(127.0.0.1)\nSlurmUser=root\nSlurmdUser=root\n\
             AuthType=auth/munge\nAuthInfo=socket={}\nCredType=cred/munge\n\
             SlurmctldPort=16817\nSlurmdPort=16818\n\
             StateSaveLocation={}\nSlurmdSpoolDir={}\nSlurmctldPidFile={}\nSlurmdPidFile={}\n\
             SlurmctldLogFile={}\nSlurmdLogFile={}\n\
             ProctrackType=proctrack/linuxproc\nTaskPlugin=task/none\nMpiDefault=none\nReturnToService=2\n\
             SelectType=select/cons_tres\nSelectTypeParameters=CR_CPU\nSchedulerParameters=batch_sched_delay=0\n\
             AccountingStorageType=accounting_storage/none\nJobAcctGatherType=jobacct_gather/none\nJobRequeue=1\nKillWait=2\nMailProg=/bin/true\n\
             NodeName={host} NodeAddr=127.0.0.1 CPUs={cpus} State=UNKNOWN\n\
             PartitionName=main Nodes={host} Default=YES MaxTime=INFINITE State=UP\n",
            at("munge/socket"),
            at("state"),
            at("spool"),
            at("slurmctld.pid"),
            at("slurmd.pid"),
            at("slurmctld.log"),
            at("slurmd.log"),
        );
        std::fs::write(at("slurm.conf"), configuration)?;
        let mut slurm = Slurm { folder, daemons: Vec::new() };
        let key = ["--key-file", &at_of(&slurm, "munge/key"), "--socket", &at_of(&slurm, "munge/socket")]
            .map(str::to_owned);
        let files = ["pid-file", "log-file", "seed-file"]
            .map(|f| format!("--{f}={}", at_of(&slurm, &format!("munge/{f}"))));
        slurm.daemon(Command::new("munged").arg("--foreground").arg("--force").args(key).args(files))?;
        let configuration = at_of(&slurm, "slurm.conf");
        slurm.wait_for("munge's socket", |s| s.folder.path().join("munge/socket").exists())?;
        slurm.daemon(Command::new("slurmctld").args(["-D", "-f", &configuration]))?;
        slurm.daemon(Command::new("slurmd").args(["-D", "-f", &configuration]))?;
        slurm.wait_for("an idle node", |s| {
            s.says("sinfo", &["-h", "-o", "%t"]).is_ok_and(|t| t.trim() == "idle")
        })?;
        Ok(slurm)
    }

    fn daemon(&mut self, command: &mut Command) -> anyhow::Result<()> {
        let child = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn();
        self.daemons.push(child.with_context(|| format!("{command:?}"))?);
        Ok(())
    }

    fn command(&self, program: &str) -> Command {
        let mut command = Command::new(program);
        command.env("SLURM_CONF", self.folder.path().join("slurm.conf"));
        command
    }

    fn says(&self, program: &str, arguments: &[&str]) -> anyhow::Result<String> {
        let output = self.command(program).args(arguments).output()?;
        ensure!(output.status.success(), "{program}: {}", String::from_utf8_lossy(&output.stderr));
        Ok(String::from_utf8(output.stdout)?)
    }

    fn wait_for(&self, what: &str, mut ready: impl FnMut(&Self) -> bool) -> anyhow::Result<()> {
        for _ in 0..6000 {
            if ready(self) {
                return Ok(());
            }
            std::thread::sleep(Duration::from_millis(100));
        }
        let log = std::fs::read_to_string(self.folder.path().join("slurmctld.log")).unwrap_or_default();
        bail!("waited ten minutes for {what}:\n{log}")
    }
}

fn at_of(slurm: &Slurm, name: &str) -> String {
    slurm.folder.path().join(name).display().to_string()
}

fn private(path: &Path, mode: u32) -> anyhow::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    Ok(std::fs::set_permissions(path, std::fs::Permissions::from_mode(mode))?)
}

/// Programs that are not installed.
fn missing() -> Vec<&'static str> {
    let found = |program: &&str| {
        let mut folders = std::env::var("PATH").unwrap_or_default();
        folders += ":/usr/sbin:/sbin";
        folders.split(':').any(|folder| Path::new(folder).join(program).is_file())
    };
    ["munged", "slurmctld", "slurmd", "sbatch", "sinfo", "squeue", "scontrol", "scancel"]
        .into_iter()
        .filter(|program| !found(program))
        .collect()
}

/// Runs job arrays, undisturbed and with a requeued task, and writes `README.md`.
pub(crate) fn run(out: &Path) -> anyhow::Result<ExitCode> {
    let missing = missing();
    if !missing.is_empty() {
        println!(
            "not run: {} missing; on Debian: apt-get install slurmctld slurmd slurm-client munge",
            missing.join(", ")
        );
        return Ok(ExitCode::FAILURE);
    }
    let microsig = process::microsig()?;
    let place = tempfile::tempdir()?;
    std::fs::write(place.path().join("base.ron"), SCENARIO)?;
    let sweep = place.path().join("sweep.ron");
    std::fs::write(&sweep, SWEEP)?;
    let whole = place.path().join("whole");
    let status =
        Command::new(&microsig).arg("--quiet").arg("sweep").arg(&sweep).arg("--out").arg(&whole).output()?;
    ensure!(status.status.success(), "{}", String::from_utf8_lossy(&status.stderr));
    let expected = tree(&whole)?;

    let slurm = Slurm::start()?;
    let version = slurm.says("sinfo", &["--version"])?;
    let mut text = format!(
        "# A sweep as a Slurm job array\n\nMade by `cargo xtask slurm` with a real {} of one machine: munged, slurmctld and slurmd \
         started for this, `{SCRIPT}` submitted with `sbatch`. The sweep has 16 cases of 20 image pairs. After each array \
         the tree of all files is compared, by SHA-256, with that of one process.\n\n",
        version.trim()
    );
    let mut well = true;
    for (array, disturbed) in [("1-3", false), ("10-22:4", false), ("1-2", true)] {
        let folder = place.path().join(
            format!("array{}", array.replace(':', "_"))
                .replace("1-2", if disturbed { "requeued" } else { "1-2" }),
        );
        std::fs::create_dir(&folder)?;
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(SCRIPT).canonicalize()?;
        let tasks = folder.join("out");
        let said = slurm
            .command("sbatch")
            .current_dir(&folder)
            .env("MICROSIG", &microsig)
            .args(["--parsable", "--cpus-per-task=1", "--time=10", &format!("--array={array}")])
            .args([&script, &sweep, &tasks])
            .output()?;
        ensure!(said.status.success(), "{}", String::from_utf8_lossy(&said.stderr));
        let job = String::from_utf8(said.stdout)?.trim().to_owned();
        if disturbed {
            // During a case: some are complete, one is in progress.
            slurm.wait_for("a case in progress", |_| partial_case(&tasks))?;
            slurm.says("scontrol", &["requeue", &format!("{job}_1")])?;
        }
        slurm.wait_for("the end of the array", |s| {
            s.says("squeue", &["-h", "-t", "PD,R,CG,S", "-j", &job]).is_ok_and(|q| q.trim().is_empty())
        })?;
        let same = tree(&tasks)? == expected;
        well &= same;
        let how = if disturbed { ", task 1 requeued (`scontrol requeue`) during a case" } else { "" };
        writeln!(
            text,
            "## `sbatch --array={array}`{how}\n\n{} files, {}.\n\n```text\n{}```\n",
            expected.len(),
            if same { "byte-identical to one process" } else { "DIFFERENT from one process" },
            logs(&folder, place.path())?
        )?;
    }
    drop(slurm);
    record(out, "README.md", &text)?;
    print!("{text}");
    Ok(if well { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

fn partial_case(folder: &Path) -> bool {
    std::fs::read_dir(folder)
        .is_ok_and(|entries| entries.flatten().any(|e| e.path().extension().is_some_and(|e| e == "partial")))
}

/// Output of the tasks.
fn logs(folder: &Path, place: &Path) -> anyhow::Result<String> {
    let mut files: Vec<PathBuf> =
        std::fs::read_dir(folder)?.map(|e| e.map(|e| e.path())).collect::<Result<_, _>>()?;
    files.retain(|path| path.extension().is_some_and(|e| e == "log"));
    files.sort();
    let mut text = String::new();
    for file in files {
        let name = file.file_name().context("a name")?.to_string_lossy().into_owned();
        let said = std::fs::read_to_string(&file)?.replace(&place.display().to_string(), "PLACE");
        for line in said.lines() {
            writeln!(text, "{name}: {line}")?;
        }
    }
    Ok(text)
}
