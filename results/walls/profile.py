"""The bias of a velocity profile near glass, if the lag of the particles is ignored: `scenarios/near_wall.ron` over several seeds.

    env/bin/pip install matplotlib
    env/bin/python profile.py MICROSIG

Writes profile.csv and profile.svg, and prints the fits. Velocities are those of the truth of ten times as many particles (displacement
over frame interval at the mean height of the two frames, with Brownian motion; `drift`: without), and of the tracker `mle` on images.
"""

import csv
import subprocess
import sys
import tempfile
from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use("svg")
import matplotlib.pyplot as plt

HERE = Path(__file__).parent
SCENARIO = HERE.parent.parent / "scenarios/near_wall.ron"
DENSE, TRACKED = range(1000, 1006), range(2000, 2006)
DT_S, UM_PER_PX, DEPTH_UM, SPEED_UM_S, RADIUS_UM = 0.005, 6.5 / 60, 20.0, 200.0, 0.25
EDGES = np.array([0.25, 0.3, 0.35, 0.4, 0.5, 0.625, 0.75, 1.0, 1.25, 1.5, 2.0, 2.5, 3.0])


def fluid(z):
    return 4 * SPEED_UM_S * z / DEPTH_UM * (1 - z / DEPTH_UM)


def table(path):
    with open(path) as file:
        rows = list(csv.DictReader(file))
    return {name: np.array([float(row[name] or "nan") for row in rows]) for name in rows[0]}


def from_truth(folder):
    """Height, displacement over time along x with and without Brownian motion, displacements of each axis."""
    rows = table(folder / "truth/displacements.csv")
    z = rows["z_um"] + rows["dz_um"] / 2
    seen = (rows["visible_a"] * rows["visible_b"] > 0) & (z < EDGES[-1])
    random = np.stack([rows["dx_px"] - rows["drift_dx_px"], rows["dy_px"] - rows["drift_dy_px"], rows["dz_um"] / UM_PER_PX], 1)
    start = rows["z_um"][seen]
    return z[seen], rows["dx_px"][seen] * UM_PER_PX / DT_S, rows["drift_dx_px"][seen] * UM_PER_PX / DT_S, start, random[seen] * UM_PER_PX


def from_tracker(microsig, folder, place):
    """Height and velocity along x of the links that the tracker finds."""
    out = place / "result.csv"
    subprocess.run([microsig, "track", folder, "--method", "mle", "--max-displacement", "8", "--out", out, "--quiet"], check=True)
    rows = table(out)
    order = np.lexsort((rows["frame"], rows["track"]))
    track, frame, x, z = (rows[name][order] for name in ("track", "frame", "x_px", "z_um"))
    linked = (track[1:] == track[:-1]) & (frame[1:] == frame[:-1] + 1)
    return ((z[1:] + z[:-1]) / 2)[linked], ((x[1:] - x[:-1]) * UM_PER_PX / DT_S)[linked]


def line(z, u, highest):
    """Slope and height of the zero of a line through velocities up to a height, and their standard errors."""
    near = z < highest
    (slope, shift), cov = np.polyfit(z[near], u[near], 1, cov=True)
    zero = -shift / slope
    error = np.sqrt(np.array([zero, 1]) @ cov @ np.array([zero, 1])) / abs(slope)
    return slope, np.sqrt(cov[0, 0]), zero, error


def binned(z, values):
    k = np.digitize(z, EDGES) - 1
    parts = [values[k == i] for i in range(len(EDGES) - 1)]
    return np.array([p.mean() for p in parts]), np.array([p.std() / np.sqrt(len(p)) for p in parts])


def main(microsig):
    truth, tracked = [], []
    for seeds, settings in ((DENSE, ["particles.number.per_um3=0.05", "calibration=none"]), (TRACKED, [])):
        for seed in seeds:
            with tempfile.TemporaryDirectory() as place:
                folder = Path(place) / "near_wall"
                sets = [word for setting in [f"seed={seed}", *settings] for word in ("--set", setting)]
                subprocess.run([microsig, "generate", SCENARIO, "--out", folder, "--quiet", *sets], check=True)
                if settings:
                    truth.append(from_truth(folder))
                else:
                    tracked.append(from_tracker(microsig, folder, Path(place)))
    z, u, drift, start, random = (np.concatenate(part) for part in zip(*truth))
    count = np.histogram(z, EDGES)[0]
    height, _ = binned(z, z)
    flow, _ = binned(z, fluid(z))
    (mean, error), (lagged, _) = binned(z, u), binned(z, drift)
    along, along_error = binned(start, (random[:, 0] ** 2 + random[:, 1] ** 2) / (4 * DT_S))
    across, across_error = binned(start, random[:, 2] ** 2 / (2 * DT_S))
    rows = np.stack([EDGES[:-1], EDGES[1:], count, height, flow, mean, error, lagged, lagged / flow - 1, along, along_error, across, across_error], 1)
    names = "from_um,to_um,pairs,height_um,fluid_um_s,measured_um_s,standard_error_um_s,drift_um_s,bias,d_along,d_along_se,d_across,d_across_se"
    np.savetxt(HERE / "profile.csv", rows, fmt="%.5g", delimiter=",", header=names, comments="")
    print(f"{len(z)} pairs; shear rate at the wall {4 * SPEED_UM_S / DEPTH_UM:.1f} 1/s")
    for highest in (0.5, 1.0, 3.0):
        lattice = np.linspace(RADIUS_UM, highest, 2000)
        for name, heights, speeds in (("fluid", lattice, fluid(lattice)), ("truth, drift", z, drift), ("truth", z, u)):
            slope, slope_error, zero, zero_error = line(heights, speeds, highest)
            print(f"line to {highest} um, {name}: slope {slope:.2f} +- {slope_error:.2f} 1/s, zero at {1e3 * zero:.1f} +- {1e3 * zero_error:.1f} nm")
    zt, ut = (np.concatenate(part) for part in zip(*tracked))
    keep = (zt > EDGES[0]) & (zt < EDGES[-1])
    zt, ut = zt[keep], ut[keep]
    (tracked_height, _), (tracked_mean, tracked_error) = binned(zt, zt), binned(zt, ut)
    for z0, value, se in zip(tracked_height, tracked_mean, tracked_error):
        print(f"tracker at {z0:.2f} um: {value:.2f} +- {se:.2f}, fluid {fluid(z0):.2f} um/s")
    for highest in (1.0, 3.0):
        slope, slope_error, zero, zero_error = line(zt, ut, highest)
        print(f"line to {highest} um, tracker: slope {slope:.2f} +- {slope_error:.2f} 1/s, zero at {1e3 * zero:.1f} +- {1e3 * zero_error:.1f} nm")
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
    lattice = np.linspace(0, 3, 200)
    left.plot(lattice, fluid(lattice), "k", lw=1, label="fluid")
    left.errorbar(height, mean, error, fmt=".", label="particles")
    left.errorbar(tracked_height, tracked_mean, tracked_error, fmt="x", label="tracker")
    left.set(xlabel="height above the glass, um", ylabel="velocity, um/s", xlim=(0, 3))
    left.legend(frameon=False)
    inset = left.inset_axes([0.62, 0.12, 0.35, 0.4])
    inset.plot(height, 100 * (lagged / flow - 1), ".-")
    inset.axhline(0, color="k", lw=0.5)
    inset.set(title="bias, %", xlim=(0, 3))
    free = 1.380649e-23 * 298.15 / (6 * np.pi * 0.89e-3 * RADIUS_UM * 1e-6) * 1e12
    right.errorbar(height, along / free, along_error / free, fmt=".", label="along the wall")
    right.errorbar(height, across / free, across_error / free, fmt=".", label="across")
    right.set(xlabel="height above the glass, um", ylabel="diffusion / free diffusion", xlim=(0, 3), ylim=(0, 1.05))
    right.legend(frameon=False)
    figure.savefig(HERE / "profile.svg", metadata={"Date": None})


if __name__ == "__main__":
    main(sys.argv[1])
