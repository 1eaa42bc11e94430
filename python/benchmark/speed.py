"""Times the package and writes `results/python`.

    python python/benchmark/speed.py results/python [--synthpix PYTHON]

PYTHON is the interpreter of an environment with `results/peers/requirements.txt`. All figures are of one core; the runs of
programs that are compared take turns.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import platform
import resource
import statistics
import subprocess
import sys
import time
from pathlib import Path

CORE = max(os.sched_getaffinity(0))
os.sched_setaffinity(0, {CORE})

import microsig as ms  # noqa: E402  threads are made for the cores that are there
import numpy as np  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
#: Its compiled function that draws pairs for a given displacement, and its own stream of batches, with flow
#: fields from files.
SYNTHPIX = {
    "SynthPix, compiled function": ROOT / "results/peers/synthpix_pairs.py",
    "SynthPix, its stream": Path(__file__).with_name("synthpix_sampler.py"),
}
REPEATS = 3

IN_FOCUS = """(
    name: "in_focus",
    optics: (
        gaussian: (diameter_px: 2.75, reference_um: 1, peak_counts: 250),
        pixel_dim_x: 512, pixel_dim_y: 512, background_mean: 20, background_noise: 5,
    ),
    motion: flow(field: lamb_oseen(max_speed_um_s: 1290)),
    particles: (
        number: ppp(0.03), diameter_um: normal(mean: 1, sd: 0.05, min: 0.91, max: 1.09), c_int: uniform(min: 0.2, max: 1),
    ),
    boundaries: (z_um: (-5, 5)),
    timing: pairs(count: 1),
)"""

DEFOCUSED = """(
    name: "defocused",
    optics: (preset: setting1a),
    motion: flow(field: poiseuille(max_speed_um_s: 1290)),
    particles: (number: count(5), diameter_um: list([(1, 1), (2, 1), (3, 1)])),
    boundaries: (z_um: (-80, 20)),
    timing: pairs(count: 1),
)"""

#: Samples by name: scenario, arguments of the stream, samples of a timed run.
CASES = {
    "in-focus pairs, 512 x 512 px, 0.03 particles per pixel": (IN_FOCUS, dict(frames=2, batch=10), 600),
    "defocused, 128 x 128 px, 5 particles, rays, with clean": (DEFOCUSED, dict(labels=["clean"]), 1600),
    "defocused, 128 x 128 px, 5 particles, rays": (DEFOCUSED, dict(), 1600),
    "defocused, 128 x 128 px, 5 particles, expected, with clean": (
        DEFOCUSED, dict(labels=["clean"], set={"render.mode": "expected"}), 1600,
    ),
    "defocused, 128 x 128 px, all labels of particles": (
        DEFOCUSED, dict(labels=["boxes", "instances", "heatmap", "depth", "clean"]), 960,
    ),
}  # fmt: skip


def stream(name: str) -> ms.Stream:
    scenario, arguments, _ = CASES[name]
    arguments = dict(batch=32) | arguments
    if scenario is DEFOCUSED:
        arguments |= dict(crop=(128, 128), vary={"optics.background_noise": ms.uniform(0, 50)})
    return ms.Stream(scenario, **arguments)


def timed(name: str) -> dict[str, float]:
    """CPU time of a run, and the part of Python's own thread; the stream is warm."""
    drawn, samples = stream(name), CASES[name][2]
    for _ in range(3):
        batch = next(drawn)
    drawn.close()
    time.sleep(0.1)
    size = sum(array.nbytes for array in batch.values())
    own, cpu, wall = time.thread_time(), time.process_time(), time.perf_counter()
    for _ in range(samples // drawn.batch):
        batch = next(drawn)
    drawn.close()
    # What is drawn ahead is not used and counts.
    own, cpu, wall = time.thread_time() - own, time.process_time() - cpu, time.perf_counter() - wall
    count = samples // drawn.batch * drawn.batch
    return dict(samples=count, cpu_s=cpu, wall_s=wall, python_s=own, batch_bytes=size)


def synthpix(python: str, program: Path) -> dict[str, float]:
    ran = subprocess.run([python, str(program), "100", "0.03", "2.75"], capture_output=True, text=True, check=True)
    told = json.loads(ran.stdout.splitlines()[-1])
    return dict(samples=told["pairs"], cpu_s=told["cpu_s"], wall_s=told["wall_s"], versions=told.get("versions", {}))


def memory(batches: int) -> tuple[float, float, int]:
    """Resident memory after 500 batches and the most after that, MB; bytes of a batch."""
    page = os.sysconf("SC_PAGE_SIZE")

    def resident() -> float:
        return int(Path("/proc/self/statm").read_text().split()[1]) * page / 1e6

    drawn = ms.Stream(IN_FOCUS, batch=8, crop=(64, 64), vary={"optics.background_noise": ms.uniform(0, 50)})
    most = before = 0.0
    for number, batch in zip(range(batches), drawn):
        if number == 500:
            before = resident()
        elif number > 500 and number % 100 == 0:
            most = max(most, resident())
    return before, most, sum(array.nbytes for array in batch.values())


def machine() -> str:
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    model = next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), "unknown CPU")
    return f"{model}, one core, Linux {platform.release().split("-")[0]}, Python {platform.python_version()}, NumPy {np.__version__}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--synthpix")
    arguments = parser.parse_args()
    load = os.getloadavg()[0]
    runs, versions = [], ""
    for repeat in range(REPEATS):
        for name in CASES:
            runs.append(dict(program=name, repeat=repeat, **timed(name)))
        for name, program in SYNTHPIX.items() if arguments.synthpix else ():
            ran = synthpix(arguments.synthpix, program)
            found = ran.pop("versions")
            versions = versions or ", ".join(f"{package} {version}" for package, version in found.items())
            runs.append(dict(program=name, repeat=repeat, **ran))
        print(f"{repeat + 1} of {REPEATS}", file=sys.stderr)

    def median(name: str, of) -> float:
        return statistics.median(of(run) for run in runs if run["program"] == name)

    rows = []
    for name in CASES:
        rate = median(name, lambda run: run["samples"] / run["cpu_s"])
        share = median(name, lambda run: run["python_s"] / run["cpu_s"])
        size = next(run["batch_bytes"] for run in runs if run["program"] == name)
        rows.append(f"| {name} | {rate:,.0f} | {1e3 / rate:.3f} | {size / 1e6:.2f} | {100 * share:.1f} % |")
    pairs = next(iter(CASES))
    rate = median(pairs, lambda run: run["samples"] / run["cpu_s"])
    compared = "SynthPix was not installed."
    if arguments.synthpix:
        function, own = (median(name, lambda run: run["samples"] / run["cpu_s"]) for name in SYNTHPIX)
        compared = (
            f"`Stream` makes {rate:.1f} pairs a CPU second, {rate / own:.1f} times as many as SynthPix's own stream ({own:.1f}) and "
            f"{rate / function:.1f} times as many as its compiled function alone ({function:.1f}; {versions})."
        )
    batches = 10_000
    before, most, size = memory(batches)
    template = (Path(__file__).parent / "speed.md.in").read_text(encoding="utf-8")
    report = template.format(
        machine=machine(),
        load=load,
        version=ms.__version__,
        repeats=REPEATS,
        rows="\n".join(rows),
        compared=compared,
        batches=batches,
        date=time.strftime("%Y-%m-%d"),
        before=before,
        most=most,
        size=size / 1e3,
        peak=resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3,
    )
    arguments.out.mkdir(parents=True, exist_ok=True)
    (arguments.out / "README.md").write_text(report, encoding="utf-8")
    with open(arguments.out / "runs.csv", "w", newline="", encoding="utf-8") as file:
        names = ["program", "repeat", "samples", "cpu_s", "wall_s", "python_s", "batch_bytes"]
        writer = csv.DictWriter(file, names, lineterminator="\n")
        writer.writeheader()
        writer.writerows(runs)


if __name__ == "__main__":
    main()
