"""Efficiencies of trackers from folders of `microsig evaluate --crlb --border 40`: efficiency.py FOLDER...

Cramer-Rao bound over root mean square error, both pooled over the particles found in the middle 80 % of the
depth range: bins of `crlb` weighed with the numbers of the curve over depth.
"""

import json
import sys
from math import nan, sqrt
from pathlib import Path


def pooled(score, axis, unit):
    """Root mean square error and efficiency of a coordinate, and the number of particles."""
    curve = next(c for c in score["curves"] if c["against"] == "z_um")["bins"]
    low, high = curve[0]["from"], curve[-1]["to"]
    margin = 0.1 * (high - low)
    n, bound, error = 0, 0.0, 0.0
    for cell, crlb in zip(curve, score["crlb"]["bins"], strict=True):
        b, e = crlb[f"crlb_{axis}_{unit}"], crlb[f"efficiency_{axis}"]
        if cell["tp"] and e and cell["from"] >= low + margin - 1e-9 and cell["to"] <= high - margin + 1e-9:
            n += cell["tp"]
            bound += cell["tp"] * b**2
            error += cell["tp"] * (b / e) ** 2
    return (sqrt(error / n), sqrt(bound / error), n) if n else (nan, nan, 0)


print("| result | N | recall | precision | x, px | y, px | z, um | efficiency x | y | z |")
print("|---|---|---|---|---|---|---|---|---|---|")
for folder in sys.argv[1:]:
    score = json.loads((Path(folder) / "score.json").read_text())
    (x, of_x, n), (y, of_y, _), (z, of_z, _) = (pooled(score, *axis) for axis in [("x", "px"), ("y", "px"), ("z", "um")])
    found = score["detection"]
    print(
        f"| {Path(folder).name} | {n} | {found['recall']:.3f} | {found['precision']:.3f} | {x:.3f} | {y:.3f} | {z:.3f} | "
        f"{of_x:.2f} | {of_y:.2f} | {of_z:.2f} |"
    )
