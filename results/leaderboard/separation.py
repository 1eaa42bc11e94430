"""Makes separation.md, the differences that each case of odpc1 finds in 80 % of repetitions:

    microsig suite generate odpc1 --size small --split test --out suites/small
    cargo test -p microsig-scoring --lib differences_that -- --ignored --nocapture | grep , > results/leaderboard/separation.csv
    python3 results/leaderboard/separation.py suites/small

separation.csv: simulated differences of image pairs by the number of units; those of a case are interpolated (logarithms; beyond the table as
1 / sqrt(units)). In longer tracks, errors average out, so that smaller differences are found.
"""

import csv
import math
import sys
from pathlib import Path

HERE = Path(__file__).parent
BELOW = 0.85  # F1 below which the curve of the poorer trackers is used


def rows(path):
    with path.open() as file:
        return list(csv.DictReader(file))


def at(curve, units, column):
    """The difference of a column of the curve (rows by units) at a number of units."""
    points = [(math.log(float(row["units"])), math.log(float(row[column]))) for row in curve]
    x = math.log(units)
    if x <= points[0][0] or x >= points[-1][0]:
        (x0, y0) = points[0] if x <= points[0][0] else points[-1]
        return math.exp(y0 - 0.5 * (x - x0))
    for (x0, y0), (x1, y1) in zip(points, points[1:]):
        if x <= x1:
            return math.exp(y0 + (y1 - y0) * (x - x0) / (x1 - x0))


def marked(text, is_below):
    return f"**{text}**" if is_below else text


def main(suite):
    measured, scores = rows(HERE / "separation.csv"), rows(HERE / "small" / "scores.csv")
    good, poor = (name for name in measured[0] if name.startswith("f1_at_"))
    print("| case | units | F1 | RMS error | first two: F1 | RMS error |\n|---|---|---|---|---|---|")
    cases = dict.fromkeys((row["track"], row["case"]) for row in scores if row["track"] != "V")
    for track, case in cases:
        truth = rows(suite / track / case / "test" / "truth" / "tracks.csv")
        units = len({row["track"] for row in truth if row["visible"] == "1"})
        entries = [row for row in scores if (row["track"], row["case"]) == (track, case) and row["status"] == "scored"]
        first = sorted(entries, key=lambda row: float(row["rank"]))[:2]
        f1 = [float(row["f1"]) for row in first]
        names = ("sigma_z_over_h", "rmse_xy_px")
        error = next((e for e in ([float(r[name] or 0) for r in first] for name in names) if min(e, default=0) > 0), None)
        found_f1 = at(measured, units, good if max(f1) >= BELOW else poor)
        found_rms = at(measured, units, "rms_z")
        d_f1 = abs(f1[0] - f1[1]) if len(f1) == 2 else None
        d_rms = max(error) / min(error) - 1 if error and len(error) == 2 else None
        print(
            f"| {track}/{case} | {units} | {found_f1:.3f} | {100 * found_rms:.0f} % | "
            + ("–" if d_f1 is None else marked(f"{d_f1:.3f}", d_f1 < found_f1))
            + " | "
            + ("–" if d_rms is None else marked(f"{100 * d_rms:.0f} %", d_rms < found_rms))
            + " |"
        )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
