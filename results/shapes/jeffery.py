"""Jeffery orbits of rods from their images: the period of rods in a shear flow by `track --method mle --shape spheroid`.

    python jeffery.py --out OUT [--svg jeffery.svg]

An existing result in OUT is used again.

needs `microsig` on the PATH, numpy, pandas, scipy and matplotlib.
"""

import argparse
import subprocess
from pathlib import Path

import matplotlib
import numpy as np
import pandas as pd
from scipy.optimize import least_squares

matplotlib.use("Agg")
import matplotlib.pyplot as plt

RATE, E_P, DT, FRAMES = 20.0, 3.0, 0.025, 24  # 1/s; aspect ratio; s
PERIOD = 2 * np.pi / RATE * (E_P + 1 / E_P)

SCENARIO = f"""(
    name: "rods",
    seed: 5,
    optics: (magnification: 20, numerical_aperture: 0.45, pixel_size: 6.5, pixel_dim_x: 300, pixel_dim_y: 220, lens: aplanatic,
             background_mean: 100, background_noise: 40),
    render: (mode: waves, wavelength_um: 0.56),
    motion: flow(field: shear(rate_per_s: {RATE}, along: x, across: y, center_um: (0, 0, 12))),
    particles: (number: count(3), diameter_um: constant(2), spheroids: (e_p: {E_P}, orientation: random)),
    boundaries: (z_um: (8, 16)),
    timing: sequence(frames: {FRAMES}, dt_s: {DT}),
)
"""


def orbit(t, period, e_p, phase, c):
    """Axis of a rod in the shear u = RATE y along x (x right, y down, z away): Jeffery 1922, Proc. R. Soc. A 102, 161."""
    angle = np.arctan2(e_p * np.sin(2 * np.pi * t / period + phase), np.cos(2 * np.pi * t / period + phase))
    tan = c * e_p / np.sqrt(e_p**2 * np.cos(angle) ** 2 + np.sin(angle) ** 2)
    polar = np.arctan(tan)
    return np.stack([np.sin(polar) * np.sin(angle), np.sin(polar) * np.cos(angle), np.cos(polar)], axis=-1)


def misses(found, model, sd):
    """Angles between axes without sign, in standard deviations."""
    return np.arccos(np.clip(np.abs((found * model).sum(axis=1)), 0, 1)) / sd


def fit(tracks):
    """One period and aspect ratio for all tracks; for each a phase, an orbit constant and the sign of z."""
    starts = []
    for t, axes, sd in tracks:
        best = min(((misses(axes, orbit(t, PERIOD * f, E_P, phase, c), sd) ** 2).sum(), phase, c)
                   for f in (0.95, 1.05) for phase in np.linspace(-np.pi / 2, np.pi / 2, 25) for c in np.concatenate([-np.geomspace(0.05, 20, 13), np.geomspace(0.05, 20, 13)]))
        starts += best[1:]
    def residuals(p):
        return np.concatenate([misses(axes, orbit(t, p[0], p[1], *p[2 + 2 * k: 4 + 2 * k]), sd) for k, (t, axes, sd) in enumerate(tracks)])
    found = least_squares(residuals, [0.97 * PERIOD, E_P, *starts], loss="soft_l1")
    covariance = np.linalg.inv(found.jac.T @ found.jac)
    return found.x, np.sqrt(np.diag(covariance))


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--svg", type=Path)
    args = parser.parse_args()
    made, result = args.out / "rods", args.out / "rods.csv"
    args.out.mkdir(parents=True, exist_ok=True)
    (args.out / "rods.ron").write_text(SCENARIO)
    if not result.exists():
        subprocess.run(["microsig", "generate", args.out / "rods.ron", "--out", made, "--force"], check=True)
        subprocess.run(["microsig", "track", made, "--method", "mle", "--shape", "spheroid", "--aspect-ratio", str(E_P), "--max-displacement", "60", "--out", result], check=True)
    subprocess.run(["microsig", "evaluate", made, result, "--out", args.out / "score", "--force", "--crlb"], check=True)
    rows = pd.read_csv(result)
    tracks = [(g.frame.to_numpy() * DT, g[["axis_x", "axis_y", "axis_z"]].to_numpy(), np.radians(np.hypot(g.axis_sd_deg, g.axis_least_sd_deg)).clip(lower=np.radians(0.3)).to_numpy())
              for _, g in rows.groupby("track") if len(g) >= 8]
    p, sd = fit(tracks)
    print(f"{len(tracks)} tracks: period {p[0]:.4f} +- {sd[0]:.4f} s, of the theory {PERIOD:.4f} s ({100 * (p[0] / PERIOD - 1):+.2f} %); aspect ratio {p[1]:.3f} +- {sd[1]:.3f}")
    if args.svg:
        fig, axes = plt.subplots(1, 2, figsize=(10, 3.6), layout="constrained")
        for k, (t, found, _) in enumerate(tracks):
            fine = np.linspace(0, t.max(), 400)
            model = orbit(fine, p[0], p[1], *p[2 + 2 * k: 4 + 2 * k])
            for ax, of in zip(axes, (lambda n: np.degrees(np.arctan2(n[:, 0], n[:, 1])) % 180, lambda n: np.degrees(np.arccos(np.abs(n[:, 2]))))):
                (dots,) = ax.plot(t, of(found), ".", ms=4)
                line = of(model)
                line[1:][np.abs(np.diff(line)) > 90] = np.nan
                ax.plot(fine, line, color=dots.get_color(), lw=0.8)
        axes[0].set(xlabel="time, s", ylabel="angle to y in the image plane, degrees", title="measured axes (dots), Jeffery orbits (lines)")
        axes[1].set(xlabel="time, s", ylabel="angle to the optical axis, degrees")
        fig.savefig(args.svg)


if __name__ == "__main__":
    main()
