"""Errors of `track --method mle --shape spheroid` over the bounds that the tracker reports, and those of `--method ncc`.

    python efficiency.py --out OUT [--count 36] [--group 3] [--csv efficiency.csv]
    python efficiency.py --out OUT --fit-aspect --count 1 --recordings 12 --snr 100 --csv alone.csv

needs `microsig` on the PATH, numpy and pandas. Spheroids lie on a jittered grid, alone or in groups whose images overlap, with random axes, over
the middle 80 % of the depth range.
"""

import argparse
import json
import resource
import subprocess
from pathlib import Path

import numpy as np
import pandas as pd

PX_UM = 0.645  # of setting 1

OPTICS = {
    "rays": ("preset: setting1", "mode: expected, spheroids: uniform", (-60.0, 10.0)),
    "rays, cylinder": ("preset: setting1, cyl_focal_length: 4000", "mode: expected, spheroids: uniform", (-60.0, 10.0)),
    "waves": ("preset: setting1, lens: aplanatic", "mode: waves, wavelength_um: 0.52", (-30.0, 30.0)),
    "waves, cylinder": ("preset: setting1, lens: aplanatic, cylinder: planes(apart_um: 20, growth: 1.1)", "mode: waves, wavelength_um: 0.52", (-30.0, 30.0)),
}


def cpu(*command):
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    subprocess.run([str(part) for part in command], check=True, stdout=subprocess.DEVNULL)
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before


def scenario(folder, optics, render, depth, rows, noise):
    folder.mkdir(parents=True, exist_ok=True)
    rows.to_csv(folder / "tracks.csv", index=False)
    side = int(rows.attrs["side"])
    (folder / "scenario.ron").write_text(f"""(
    name: "spheroids", seed: 1,
    optics: ({optics}, background_mean: {round(300 + 5 * noise)}, background_noise: {noise}, pixel_dim_x: {side}, pixel_dim_y: {side}),
    motion: tracks(file: "tracks.csv"),
    particles: (diameter_um: constant(4)),
    boundaries: (z_um: {depth}),
    render: ({render}),
    timing: sequence(frames: 1, dt_s: 0.001),
)
""")


def angles(truth, found):
    """Angle to the true axis (degrees), its square in standard deviations, and errors of x, y, z in standard deviations."""
    angle, n, m = angle_deg(truth, found)
    u = found[["axis_sd_x", "axis_sd_y", "axis_sd_z"]].to_numpy()
    v = np.cross(m, u)
    off = n - m
    chi2 = ((off * u).sum(axis=1) / np.radians(found.axis_sd_deg)) ** 2 + ((off * v).sum(axis=1) / np.radians(found.axis_least_sd_deg)) ** 2
    position = {k: (found[f"{k}_{unit}"].to_numpy() - truth[f"{k}_{unit}"].to_numpy()) / found[f"s{k}_{unit}"].to_numpy()
                for k, unit in (("x", "px"), ("y", "px"), ("z", "um"))}
    return pd.DataFrame({"angle": angle, "chi2": chi2.to_numpy(), **position})


def places(count, group, rng):
    """Positions in px, `group` of them around each point of a grid, at least 12 px apart and at most 20 px from it; and the side of the image."""
    side = int(np.ceil(np.sqrt(count / group)))
    pitch = 110
    at_px = []
    for k in range(count):
        middle = (np.array([k // group % side, k // group // side]) + 0.5) * pitch
        others = at_px[k - k % group :]
        while True:
            at = middle + (rng.uniform(-8, 8, 2) if group == 1 else rng.uniform(-20, 20, 2))
            if all(np.hypot(*(at - other)) > 12 for other in others):
                break
        at_px.append(at)
    return np.array(at_px), side * pitch


def track(method, made, result, truth, ratio):
    """The result at the true particles that were found, which of them were, and the CPU time of each."""
    seconds = cpu("microsig", "track", made, "--method", method, "--shape", "spheroid", *ratio, "--out", result, "--force", "--quiet")
    found = pd.read_csv(result)
    nearest = [np.hypot(found.x_px - p.x_px, found.y_px - p.y_px).argmin() for p in truth.itertuples()]
    found = found.iloc[nearest].reset_index(drop=True)
    near = np.hypot(found.x_px - truth.x_px, found.y_px - truth.y_px) < 3
    return found[near].reset_index(drop=True), near, seconds / len(truth)


def angle_deg(truth, found):
    """Angle between true and found axes, degrees, and both as unit vectors of the same sign."""
    a, b = truth.alpha_rad.to_numpy(), truth.beta_rad.to_numpy()
    n = np.stack([np.sin(a) * np.sin(b), np.cos(b), -np.cos(a) * np.sin(b)], axis=1)
    m = found[["axis_x", "axis_y", "axis_z"]].to_numpy()
    m = m * np.sign((n * m).sum(axis=1))[:, None]
    return np.degrees(np.arccos(np.clip((n * m).sum(axis=1), -1, 1))), n, m


def recorded(folder, optics, render, depth, e_p, args, rng):
    """A scenario of random spheroids, without noise, and the median of their peaks."""
    at_px, side = places(args.count, args.group, rng)
    axis = rng.normal(size=(args.count, 3))
    axis /= np.linalg.norm(axis, axis=1)[:, None]
    low, high = depth
    margin = 0.1 * (high - low)
    rows = pd.DataFrame({"frame": 0, "track": np.arange(args.count), "x_px": at_px[:, 0], "y_px": at_px[:, 1],
                         "z_um": rng.uniform(low + margin, high - margin, args.count), "e_p": e_p,
                         "axis_x": axis[:, 0], "axis_y": axis[:, 1], "axis_z": axis[:, 2]})
    rows.attrs["side"] = side
    scenario(folder, optics, render, depth, rows, 1.0)
    cpu("microsig", "generate", folder / "scenario.ron", "--out", folder / "clean", "--force", "--quiet")
    return rows, pd.read_csv(folder / "clean/truth/tracks.csv").peak_counts.median()


def joined(parts):
    return pd.concat(parts, ignore_index=True)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--count", type=int, default=36)
    parser.add_argument("--csv", type=Path)
    parser.add_argument("--optics", nargs="*", default=list(OPTICS))
    parser.add_argument("--group", type=int, default=1)
    parser.add_argument("--snr", type=int, nargs="*", default=[20, 100])
    parser.add_argument("--recordings", type=int, default=1, help="of --count particles each")
    parser.add_argument("--fit-aspect", action="store_true", help="without ncc")
    args = parser.parse_args()
    rng = np.random.default_rng(3)
    results = []
    for name in args.optics:
        optics, render, depth = OPTICS[name]
        for e_p in (2.0, 0.4):
            folders = [args.out / f"{name.replace(', ', '_')}_{e_p}" / str(k) for k in range(args.recordings)]
            made_of = [(folder, *recorded(folder, optics, render, depth, e_p, args, rng)) for folder in folders]
            for snr in args.snr:
                ratio = [] if args.fit_aspect else ["--aspect-ratio", e_p]
                truths, by = [], {"mle": []} if args.fit_aspect else {"mle": [], "ncc": []}
                for folder, rows, peak in made_of:
                    made = folder / f"snr_{snr}"
                    scenario(folder, optics, render, depth, rows, round(peak / snr, 2))
                    cpu("microsig", "generate", folder / "scenario.ron", "--out", made, "--force", "--quiet")
                    truths.append(pd.read_csv(made / "truth/tracks.csv"))
                    for method, of in by.items():
                        of.append(track(method, made, folder / f"{method}_{snr}.csv", truths[-1], ratio))
                truth = joined(truths)
                found, near, seconds = (part(of) for part, of in zip((joined, np.concatenate, np.mean), zip(*by["mle"])))
                # Of axes that images do not tell, the tracker gives two.
                one = found.other_likelihood.isna()
                errors = angles(truth[near].reset_index(drop=True)[one].reset_index(drop=True), found[one].reset_index(drop=True))
                # Of a normal distribution, the median and the 90th percentile are 0.674 and 1.645 standard deviations, of a
                # chi-square with two degrees of freedom 1.386 and 4.605.
                axis_of = lambda q, of: float(np.sqrt(of / errors.chi2.quantile(q)))
                place = np.abs(errors[["x", "y", "z"]])
                row = {"optics": name, "e_p": e_p, "snr": snr, "particles": len(truth), "found": int(near.sum()), "determined": int(one.sum()),
                       "angle_median_deg": errors.angle.median(), "angle_p90_deg": errors.angle.quantile(0.9),
                       "efficiency_angle_median": axis_of(0.5, 1.386), "efficiency_angle_p90": axis_of(0.9, 4.605),
                       **{f"efficiency_{k}_median": 0.6745 / place[k].median() for k in "xyz"},
                       **{f"efficiency_{k}_p90": 1.645 / place[k].quantile(0.9) for k in "xyz"},
                       "coverage_95": float((errors.chi2 < 5.99).mean()), "cpu_s_per_particle": seconds}
                if args.fit_aspect:
                    off = (found.aspect_ratio - e_p) / found.aspect_ratio_sd
                    row |= {"aspect_error_median": float((found.aspect_ratio / e_p - 1).abs().median()),
                            "aspect_sd_median": float((found.aspect_ratio_sd / e_p).median()), "aspect_within_2_sd": float((off.abs() < 2).mean())}
                else:
                    found, near, seconds = (part(of) for part, of in zip((joined, np.concatenate, np.mean), zip(*by["ncc"])))
                    there = truth[near].reset_index(drop=True)
                    angle = pd.Series(angle_deg(there, found)[0])
                    off = {k: (found[k] - there[k]).abs().median() for k in ("x_px", "z_um")}
                    row |= {"ncc_found": int(near.sum()), "ncc_angle_median_deg": angle.median(), "ncc_angle_p90_deg": angle.quantile(0.9),
                            **{f"ncc_{k}_median": v for k, v in off.items()}, "ncc_cpu_s_per_particle": seconds}
                results.append(row)
                print(json.dumps({k: round(v, 3) if isinstance(v, float) else v for k, v in row.items()}), flush=True)
    if args.csv:
        pd.DataFrame(results).round(3).to_csv(args.csv, index=False)


if __name__ == "__main__":
    main()
