"""Times how long calls go on after Ctrl-C, in seconds: the longest of several moments.

    python python/benchmark/ctrl_c.py
"""

from __future__ import annotations

import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

QUICKSTART = str(Path(__file__).resolve().parents[2] / "scenarios/quickstart.ron")
LONG = {"timing.pairs.count": 2000, "optics.n_rays": 2000}
MADE = f"ds = ms.generate({QUICKSTART!r}, set={{'timing.pairs.count': 40}}); folder = ds.save('dataset'); found = ds.tracks"
DENSE = {"optics.pixel_dim_x": 2048, "optics.pixel_dim_y": 2048, "particles.number.count": 20_000}

#: What is done before, and what is interrupted.
CALLS = {
    "generate": ("", f"ms.generate({QUICKSTART!r}, set={LONG})"),
    "save": (MADE, "ds.save('other')"),
    "next(Stream)": (f"stream = ms.Stream({QUICKSTART!r}, batch=5000)", "next(stream)"),
    "Stream[0], 20,000 particles": ("", f"ms.Stream({QUICKSTART!r}, 1, set={DENSE}, labels=['clean', 'boxes'])[0]"),
    "evaluate": (MADE, "ms.evaluate(folder, found)"),
    "track, mle": (MADE, "ms.track(folder, 'mle')"),
    "track, ncc": (MADE, "ms.track(folder, 'ncc')"),
    "track, aptv": (MADE, "ms.track(folder, 'aptv')"),
    "track, piv": (MADE, "ms.track(folder, 'piv')"),
    "track, spots": (MADE, "ms.track(folder, 'spots')"),
}
MOMENTS_S = (0.1, 0.3, 1.0, 3.0)

PROGRAM = """
import time
import microsig as ms
{before}
print("ready", flush=True)
try:
    {call}
except KeyboardInterrupt:
    print(time.monotonic(), flush=True)
"""


def after(before: str, call: str, moment_s: float) -> float | None:
    """Time from Ctrl-C until its exception, s; None if the call ended before."""
    with tempfile.TemporaryDirectory() as place:
        program = PROGRAM.format(before=before, call=call)
        process = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True, cwd=place)
        assert process.stdout is not None and process.stdout.readline() == "ready\n"
        time.sleep(moment_s)
        sent = time.monotonic()
        process.send_signal(signal.SIGINT)
        told, _ = process.communicate()
        return float(told) - sent if told else None


for name, (before, call) in CALLS.items():
    times = [took for moment in MOMENTS_S if (took := after(before, call, moment)) is not None]
    print(f"{name:30} {max(times):.2f} s, {len(times)} moments" if times else f"{name:30} ended before", flush=True)
