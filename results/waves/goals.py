#!/usr/bin/env python3
"""Measures CPU times of waves and expected in one run and prints them as a table: goals.py MICROSIG FOLDER

User and system time of one thread: the least and the greatest of three runs, of one if it takes above 5 s.
"""
import os
import subprocess
import sys
from pathlib import Path

program, folder = sys.argv[1], Path(sys.argv[2])
maker = Path(__file__).with_name("particles.py")
SETS = {
    "setting 1, 2 um, -80 to 20 um": "0 2 500 -80 20 2 2",
    "setting 1a, 2 um, -80 to 40 um": "4000 2 500 -80 40 2 2",
    "setting 1, 1.5 to 2.5 um, -80 to 40 um": "0 2 500 -80 40 1.5 2.5",
}


def cpu_s(data: Path, mode: str, tolerance: str, *more: str) -> float:
    command = [program, "render", data / "settings.txt", data / "particles", folder / "out", "--mode", mode]
    command += ["--tolerance", tolerance, "--threads", "1", "--force", *more]
    command += ["--wavelength", "0.52"] if mode == "waves" else []
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    assert status == 0, command
    return usage.ru_utime + usage.ru_stime


def spread(run) -> str:
    times = [run()]
    while len(times) < 3 and times[0] < 5:
        times.append(run())
    return f"{min(times):.3g} to {max(times):.3g}" if len(times) > 1 else f"{times[0]:.3g}"


print("| images | mode | CPU s at 0.003 | at 0.001 |\n|---|---|---|---|")
for number, (name, numbers) in enumerate(SETS.items()):
    data = folder / f"set{number}"
    subprocess.run([sys.executable, maker, data, *numbers.split()], check=True)
    for mode in ["waves", "expected"]:
        times = [spread(lambda: cpu_s(data, mode, tolerance, "--no-cache")) for tolerance in ["0.003", "0.001"]]
        print(f"| {name} | {mode} | {times[0]} | {times[1]} |", flush=True)

print("\n| setting 1, tables in the cache | mode | 2 images, CPU s | an image more, CPU ms |\n|---|---|---|---|")
few, many = folder / "few", folder / "many"
subprocess.run([sys.executable, maker, few, *"0 2 500 -80 20 2 2".split()], check=True)
subprocess.run([sys.executable, maker, many, *"0 102 500 -80 20 2 2".split()], check=True)
os.environ["MICROSIG_CACHE"] = str(folder / "cache")
for mode in ["waves", "expected"]:
    for tolerance in ["0.003", "0.001"]:
        cpu_s(few, mode, tolerance), cpu_s(many, mode, tolerance)
        pairs = [(cpu_s(few, mode, tolerance), cpu_s(many, mode, tolerance)) for _ in range(3)]
        small, large = [few for few, _ in pairs], [10 * (many - few) for few, many in pairs]
        print(f"| at {tolerance} | {mode} | {min(small):.3f} to {max(small):.3f} | {min(large):.3g} to {max(large):.3g} |", flush=True)
