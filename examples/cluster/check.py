"""The workflows of this folder and the Slurm script on a sweep of 16 small cases: twice, the second time for nothing.

    python examples/cluster/check.py target/debug/microsig

Needs `snakemake` on the PATH. Without `nextflow`, which is no Python package, the commands of its workflow run without it.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

HERE = Path(__file__).resolve().parent
MICROSIG = str(Path(sys.argv[1]).resolve())
BASE = """(
    name: "base", optics: (pixel_dim_x: 60, pixel_dim_y: 50, points_per_pixel: 4), motion: flow(field: poiseuille()),
    particles: (number: count(3)), timing: pairs(count: 1), calibration: none,
)"""
SWEEP = """(
    name: "noise_and_density", base: "base.ron",
    axes: [
        (path: "optics.background_noise", values: list([0, 5, 10, 20])),
        (path: "particles.number", values: list([count(2), count(3), count(4), count(5)])),
    ],
)"""


def run(arguments, folder, **environment):
    done = subprocess.run(arguments, cwd=folder, env={**os.environ, **environment}, capture_output=True, text=True)
    assert done.returncode == 0, f"{arguments}: {done.stdout}{done.stderr}"
    return done.stdout + done.stderr


def sweep(folder, *arguments):
    return run([MICROSIG, "sweep", "sweep.ron", *arguments], folder)


def tree(folder):
    """All files with their bytes."""
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def times(folder):
    return {p: p.stat().st_mtime_ns for p in folder.rglob("*") if p.is_file()}


def twice(name, folder, expected, start):
    """Starts a workflow twice; returns what it said the second time."""
    start()
    out = folder / name
    assert tree(out) == expected, f"{name}: other files than those of one run"
    before = times(out)
    said = start()
    assert times(out) == before, f"{name}: the second run wrote files"
    print(f"{name}: 16 cases; nothing the second time")
    return said


def by_snakemake(folder, expected):
    arguments = ["snakemake", "--snakefile", HERE / "Snakefile", "--cores", "2", "--config", "sweep=sweep.ron"]
    start = lambda: run([*arguments, "out=snakemake", f"microsig={MICROSIG}"], folder)
    assert "Nothing to be done" in twice("snakemake", folder, expected, start)
    # An edit makes the cases again.
    (folder / "sweep.ron").write_text(SWEEP.replace("20]", "30]"))
    start()
    sweep(folder, "--out", "edited")
    assert tree(folder / "snakemake") == tree(folder / "edited"), "cases of the sweep before its edit"
    (folder / "sweep.ron").write_text(SWEEP)


def by_slurm(folder, expected):
    script = HERE.parents[1] / "scripts/microsig-array.sbatch"

    def task(number):
        slurm = {"ID": str(number), "MIN": "1", "STEP": "1", "COUNT": "4"}
        slurm = {f"SLURM_ARRAY_TASK_{name}": value for name, value in slurm.items()}
        return run(["bash", script, "sweep.ron", "slurm"], folder, **slurm, SLURM_CPUS_PER_TASK="1", MICROSIG=MICROSIG)

    def start():
        with ThreadPoolExecutor(2) as tasks:
            return list(tasks.map(task, range(1, 5)))

    said = twice("slurm", folder, expected, start)
    assert all(f"shard {k}/4: 16 of 16 cases done, 0 failed, 0 generated" in text for k, text in enumerate(said, 1)), said


def by_nextflow(folder, expected):
    start = lambda: run(["nextflow", "run", HERE / "main.nf", "--sweep", "sweep.ron", "--out", folder / "nextflow",
                         "--microsig", MICROSIG], folder, NXF_OFFLINE="true")
    if shutil.which("nextflow") and subprocess.run(["nextflow", "-version"], capture_output=True).returncode == 0:
        twice("nextflow", folder, expected, start)
        return
    print("warning: no nextflow; the commands of main.nf run without it")
    scripts = re.findall(r'script:\n    "(.*)"', (HERE / "main.nf").read_text())
    listing, case, table = (script.replace("${params.microsig}", MICROSIG) for script in scripts)

    def task(script, name=""):
        work = Path(tempfile.mkdtemp(dir=folder))
        if not name:
            # Staged inputs are links.
            for made in (folder / "nextflow").iterdir():
                (work / made.name).symlink_to(made)
        script = script.replace("${sweep}", str(folder / "sweep.ron")).replace("${name}", name).replace("${task.cpus}", "2")
        assert "$" not in script, script
        return work, run(["bash", "-ue", "-c", script], work)

    def store(work, name):
        if not (out / name).exists():
            (work() / name).rename(out / name)

    def start():
        for name in task(listing)[1].split():
            store(lambda: task(case, name)[0], name)
        store(lambda: task(table)[0], "cases.csv")

    out = folder / "nextflow"
    out.mkdir()
    twice("nextflow", folder, expected, start)


def main():
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        (folder / "base.ron").write_text(BASE)
        (folder / "sweep.ron").write_text(SWEEP)
        sweep(folder, "--out", "whole")
        expected = tree(folder / "whole")
        assert len([name for name in expected if name.endswith("SHA256SUMS")]) == 16
        by_slurm(folder, expected)
        by_nextflow(folder, expected)
        by_snakemake(folder, expected)


main()
