"""How often the 95 % intervals of `microsig fit` contain the truth, over simulated scans: coverage.py MICROSIG [SCANS]

Each scan has four beads of 2 um in 21 planes 4 um apart, traced by `rays` (setting 1, and 1a with its cylindrical lens), with another seed.
"""

import json
import os
import subprocess
import sys
import tempfile
from collections import defaultdict
from math import sqrt
from pathlib import Path

microsig, scans = sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 10
BEADS = [(120.2, 100.7), (330.4, 90.1), (140.6, 260.3), (350.9, 270.5)]
TRUTH = {"numerical_aperture": 0.3, "focal_length": 350, "particle_diameter_um": 2, "cyl_focal_length": 4000}
PLANES, STEP_UM, FIRST_UM = 21, 4, -60

print("| setting | quantity | covered | mean error, sd | RMS error, sd | median sd |\n|---|---|---|---|---|---|")
for preset in ["setting1", "setting1a"]:
    found = defaultdict(list)
    with tempfile.TemporaryDirectory() as place:
        place = Path(place)
        rows = [f"{i},{k},{x},{y},{FIRST_UM + STEP_UM * i}" for i in range(PLANES) for k, (x, y) in enumerate(BEADS)]
        (place / "beads.csv").write_text("\n".join(["frame,track,x_px,y_px,z_um", *rows, ""]))
        (place / "scan.ron").write_text(
            f'(name: "scan", optics: (preset: {preset}, background_noise: 20, pixel_dim_x: 480, pixel_dim_y: 360), motion: tracks(file: "beads.csv"),'
            f" particles: (diameter_um: constant(2)), boundaries: (z_um: (-60, 20)), timing: sequence(frames: {PLANES}))"
        )
        for seed in range(scans):
            scan, out = place / f"scan{seed}", place / f"fit{seed}"
            subprocess.run([microsig, "generate", place / "scan.ron", "--out", scan, "--quiet", "--seed", str(seed)], check=True)
            given = ["--z-step", str(STEP_UM), "--magnification", "10", "--pixel-size", "6.45"]
            subprocess.run([microsig, "fit", scan / "images", *given, "--out", out, "--quiet"], check=True, stdout=subprocess.DEVNULL)
            fit = json.loads((out / "fit.json").read_text())
            for parameter in fit["parameters"]:
                if parameter["name"] in TRUTH:
                    found[parameter["name"]].append((parameter["value"] - TRUTH[parameter["name"]], parameter["sd"]))
    for name, errors in found.items():
        ratios = [error / sd for error, sd in errors]
        inside = sum(abs(ratio) < 1.96 for ratio in ratios)
        mean, rms = sum(ratios) / len(ratios), sqrt(sum(ratio**2 for ratio in ratios) / len(ratios))
        print(f"| {preset} | {name} | {inside} of {len(ratios)} | {mean:+.2f} | {rms:.2f} | {sorted(sd for _, sd in errors)[len(errors) // 2]:.4g} |", flush=True)
user = os.times().children_user
print(f"\n{user:.0f} CPU s in all")
