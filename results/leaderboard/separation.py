"""Makes separation.md, the differences that each case of odpc1 finds in 80 % of repetitions:

    cargo test -p microsig-scoring --lib differences_that -- --ignored --nocapture | grep , > results/leaderboard/separation.csv
    python3 results/leaderboard/separation.py > results/leaderboard/separation.md

separation.csv: simulated differences of image pairs by the number of units; those of a case are interpolated (logarithms; beyond the table as
1 / sqrt(units)). In longer tracks, errors average out, so that smaller differences are found. units.csv: true tracks that are visible in the test split, counted in its
truth or (`counted` is no) from the number of true points, which recall reveals, and the tracks per point of the other cases of the track.
"""

import csv
import math
from pathlib import Path

HERE = Path(__file__).parent
INTRO = """# Differences that odpc1 finds

Made by `results/leaderboard/separation.py`, which says how, for size small: by case, the number of independent units, and the difference in F1 and
the relative difference in the RMS error of z (without depth: of x and y) that the paired test finds in 80 % of 40 repetitions. The last two columns
are the differences between the first two trackers of the leaderboard, **bold** where they are smaller. Simulated trackers miss particles and err
independently of each other; results on the same images err alike, so that smaller differences are found between them. Track V has no particles.
"""
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


def main():
    units_of = {row["case"]: row for row in rows(HERE / "units.csv")}
    measured, scores = rows(HERE / "separation.csv"), rows(HERE / "small" / "scores.csv")
    good, poor = (name for name in measured[0] if name.startswith("f1_at_"))
    print(INTRO)
    print("| case | units | F1 | RMS error | first two: F1 | RMS error |\n|---|---|---|---|---|---|")
    cases = dict.fromkeys((row["track"], row["case"]) for row in scores if row["track"] != "V")
    for track, case in cases:
        of = units_of[f"{track}/{case}"]
        units, about = int(of["units"]), "" if of["counted"] == "yes" else "about "
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
            f"| {track}/{case} | {about}{units} | {found_f1:.3f} | {100 * found_rms:.0f} % | "
            + ("–" if d_f1 is None else marked(f"{d_f1:.3f}", d_f1 < found_f1))
            + " | "
            + ("–" if d_rms is None else marked(f"{100 * d_rms:.0f} %", d_rms < found_rms))
            + " |"
        )


if __name__ == "__main__":
    main()
