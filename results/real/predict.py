"""Does the twin of a microscope predict what trackers achieve on its recordings?

From one scan of particles at rest: every other plane calibrates (`microsig fit --field`, `microsig import --field 3`), one frame
of each of the planes between is a recording at known depths. The twin renders the scan and the recording anew: the fitted optics
and camera, particles at the places of the real ones and as bright. The same commands import and track both, and the
same list of particles scores both.

    python predict.py SCAN Z_TABLE --magnification 10.01 --pixel-size 16 --diameter 2 --wavelength 0.56 --out OUT

needs `microsig` on the PATH and numpy, pandas, scipy, tifffile, matplotlib; and what the trackers of examples/trackers need.
"""

import argparse
import json
import re
import resource
import subprocess
from pathlib import Path

import matplotlib
import numpy as np
import pandas as pd
import tifffile
from scipy import ndimage

matplotlib.use("Agg")
import matplotlib.pyplot as plt

KINDS = ("match", "miss", "ghost")  # of the rows of matches.csv
NEAR_UM = 8.0  # within this distance of the focus, images hardly depend on depth


def run(*command):
    """Runs a command and returns the user's CPU seconds."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    subprocess.run([str(part) for part in command], check=True)
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before


def split(scan, table, out):
    """Every other plane for the calibration; one frame of each of the others."""
    rows, pages = pd.read_csv(table), tifffile.imread(scan)
    planes = np.unique(rows.z_um)
    for_calibration = rows[rows.z_um.isin(planes[::2])].reset_index(drop=True)
    recorded = rows[rows.z_um.isin(planes[1::2])].drop_duplicates("z_um").reset_index(drop=True)
    write(out / "real", pages[for_calibration.page], pages[recorded.page])
    for_calibration.assign(page=for_calibration.index)[["page", "z_um"]].to_csv(out / "z.csv", index=False)
    return for_calibration.z_um.to_numpy(float), recorded.z_um.to_numpy(float)


def write(folder, scan, frames):
    (folder / "frames").mkdir(parents=True, exist_ok=True)
    tifffile.imwrite(folder / "scan.tif", scan, photometric="minisblack")
    for k, frame in enumerate(frames):
        tifffile.imwrite(folder / "frames" / f"{k:03}.tif", frame, photometric="minisblack")


def locate(scan, stage_um, focus_um):
    """Places (px from 1) and light of all particles, from the planes near focus."""
    image = scan[np.abs(stage_um - focus_um) <= 4].mean(axis=0, dtype=float)
    image -= np.median(image)
    smooth = ndimage.gaussian_filter(image, 1.0) - ndimage.gaussian_filter(image, 6.0)
    noise = 1.4826 * np.median(np.abs(smooth))
    y, x = np.nonzero((smooth == ndimage.maximum_filter(smooth, 5)) & (smooth > 30 * noise))
    found = []
    for x, y in zip(x, y):
        rows, columns = slice(max(y - 3, 0), min(y + 4, len(image))), slice(max(x - 3, 0), min(x + 4, len(image[0])))
        part = image[rows, columns]
        weight = np.clip(part - 0.05 * part.max(), 0, None)
        v, u = np.mgrid[rows, columns]
        found.append(((u * weight).sum() / weight.sum() + 1, (v * weight).sum() / weight.sum() + 1, part.sum()))
    found.sort(key=lambda particle: -particle[2])
    kept = []
    for particle in found:  # one maximum for each particle or cluster
        if all(np.hypot(particle[0] - other[0], particle[1] - other[1]) > 2.5 for other in kept):
            kept.append(particle)
    return pd.DataFrame(kept, columns=["x_px", "y_px", "light"])


def spheres(located, diameter_px):
    """Spheres of the twin: bright spots are clusters that touch, of as many spheres as have their light.

    Returns the spheres, with the light of a single one as the unit."""
    random = np.random.default_rng(1)
    middle = located.light.median()
    single = located.light[(located.light > 0.5 * middle) & (located.light < 1.75 * middle)].mean()
    rows = []
    for x, y, light in located.itertuples(index=False):
        count = max(1, round(light / single))
        grid = np.array([(i + j / 2, j * np.sqrt(0.75)) for i in range(-4, 5) for j in range(-4, 5)])
        grid = grid[np.argsort((grid**2).sum(axis=1), kind="stable")][:count]
        angle = random.uniform(0, 2 * np.pi)
        turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        rows += [(x + dx, y + dy, light / single / count) for dx, dy in (grid - grid.mean(axis=0)) @ turn * diameter_px]
    return pd.DataFrame(rows, columns=["x_px", "y_px", "c_int"])


def twin(out, depths_um, focus_um, particles):
    """Renders the planes of scan and recording with the fitted optics; returns the images."""
    frames = [particles.assign(frame=k, track=particles.index, z_um=z - focus_um) for k, z in enumerate(depths_um)]
    folder = out / "scenario"
    folder.mkdir(exist_ok=True)
    pd.concat(frames).round(4).to_csv(folder / "tracks.csv", index=False)
    scenario = (out / "fitted" / "scenario.ron").read_text()
    for key, value in {
        "motion": 'tracks(file: "tracks.csv")',
        "particles": "(diameter_um: constant(2))",
        "boundaries": f"(z_um: ({min(depths_um) - focus_um - 1}, {max(depths_um) - focus_um + 1}))",
        "timing": f"sequence(frames: {len(depths_um)}, dt_s: 1)",
    }.items():
        scenario, count = re.subn(rf"^    {key}: .*$", f"    {key}: {value},", scenario, flags=re.MULTILINE)
        assert count == 1, key
    (folder / "planes.ron").write_text(scenario)
    run("microsig", "generate", folder / "planes.ron", "--out", out / "generated", "--force")
    return np.stack([tifffile.imread(file) for file in sorted((out / "generated" / "images").glob("*.tif"))])


def imported(folder, out):
    """Makes a recording of the frames of a folder."""
    run("microsig", "import", "--images", folder / "frames" / "*.tif", "--scan", folder / "scan.tif", "--z", out / "z.csv",
        "--optics", out / "fitted" / "scenario.ron", "--field", 3, "--truth", out / "known.csv", "--all-particles",
        "--out", folder / "recording", "--force")


def track(folder, methods):
    """Tracks a recording by each method; the matches with the known particles."""
    matches = []
    for method, command in methods.items():
        result = folder / f"{method}.csv"
        seconds = run(*command(folder / "recording", result))
        scores = folder / f"scores_{method}"
        run("microsig", "evaluate", folder / "recording", result, "--out", scores, "--force")
        table = pd.read_csv(scores / "matches.csv")
        matches.append(table.assign(method=method, images=folder.name, cpu_s=seconds))
    return pd.concat(matches)


def summary(matches, sensor_px, um_per_px):
    """Scores of each method on real images and on those of the twin."""
    rows = []
    for (method, images), all_rows in matches.groupby(["method", "images"], sort=False):
        defocused = all_rows[all_rows.z_um.abs() > NEAR_UM]
        outer = defocused[radius_um(defocused, sensor_px, um_per_px) > 300]
        counts = all_rows.kind.value_counts()
        tp, fn, fp = (counts.get(kind, 0) for kind in KINDS)
        error = lambda part: part.dz_um[part.kind == "match"]
        rows.append({
            "method": method,
            "images": images,
            "recall": tp / (tp + fn),
            "precision": tp / (tp + fp),
            "rms_z_um": rms(error(all_rows)),
            "median_abs_z_um": error(all_rows).abs().median(),
            "rms_z_defocused_um": rms(error(defocused)),
            "rms_z_beyond_300_um": rms(error(outer)),
            "bias_z_defocused_um": error(defocused).mean(),
            "rms_x_px": rms(all_rows.dx_px[all_rows.kind == "match"]),
            "rms_y_px": rms(all_rows.dy_px[all_rows.kind == "match"]),
            "cpu_s_per_frame": all_rows.cpu_s.iloc[0] / all_rows.frame.nunique(),
        })
    return pd.DataFrame(rows)




def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def radius_um(rows, sensor_px, um_per_px):
    """Distance from the middle of the image, um."""
    width, height = sensor_px
    return np.hypot(rows.x_px - (width + 1) / 2, rows.y_px - (height + 1) / 2) * um_per_px


def binned(rows, by, edges):
    """Recall, bias and RMS error of depth in bins of a quantity."""
    known = rows[rows.kind != "ghost"]
    bins = pd.cut(by[known.index], edges)
    groups = known.groupby(bins, observed=False)
    recall = groups.kind.apply(lambda kind: (kind == "match").mean())
    errors = known.dz_um.where(known.kind == "match")
    bias = errors.groupby(bins, observed=False).mean()
    spread = errors.groupby(bins, observed=False).apply(rms_of_found)
    middle = [(low + high) / 2 for low, high in zip(edges, edges[1:])]
    return middle, {"recall": recall, "bias of z, um": bias, "RMS error of z, um": spread}


def rms_of_found(errors):
    found = errors.dropna()
    return rms(found) if len(found) > 4 else np.nan


def bars(fitted, matches, um_per_px):
    """What the fit and `mle` must reach on this scan (20x/0.45, M = 10.01), with what they reach."""
    report = json.loads((fitted / "field.json").read_text())
    coefficient = {row["key"]: row["value"] for row in report["coefficients"]}
    single = pd.read_csv(fitted / "particles.csv").query("single == 'yes'")
    outer = single[np.hypot(single.x_mm, single.y_mm) > 0.35]
    real = matches[(matches.images == "real") & (matches.method == "mle") & (matches.kind == "match") & (matches.z_um.abs() > NEAR_UM)]
    near = np.array([np.hypot(single.x_px - x, single.y_px - y).min() < 1.5 for x, y in zip(real.x_px, real.y_px)])
    middle = (single.x_px - single.x_mm * 1e3 / um_per_px).mean(), (single.y_px - single.y_mm * 1e3 / um_per_px).mean()
    far = near & (np.hypot(real.x_px - middle[0], real.y_px - middle[1]) * um_per_px > 300)
    return pd.DataFrame([
        ("R2 of single particles with the fitted field dependence, mean", single.r2_of_field.mean(), 0.990, np.inf),
        ("the same beyond 350 um", outer.r2_of_field.mean(), 0.988, np.inf),
        ("chi2 per pixel of one frame", report["chi2_of_field"], 0, 2.9),
        ("blur, um", report["blur_um"], 0.80, 0.92),
        ("numerical aperture", report["numerical_aperture"], 0.435, 0.447),
        ("variance of the noise per count", report["noise"][1], 0.045, 0.18),
        ("curvature of the focus at 400 um, um", 0.16 * coefficient["focus.curvature_um_per_mm2"], 0.68, 0.98),
        ("tilt of the focus along y, um/mm", coefficient["focus.tilt_um_per_mm.1"], 3.6, 4.0),
        ("coma, waves/mm", coefficient["coma.per_mm"], -0.147, -0.107),
        ("focus, rms residual from the field dependence, um", rms(single.refitted_focus_um - single.focus_um_field), 0, 0.12),
        ("single particles by mle, RMS error of z, um", rms(real.dz_um[near]), 0, 0.40),
        ("the same beyond 300 um", rms(real.dz_um[far]), 0, 0.45),
        ("the same, bias, um", real.dz_um[near].mean(), -0.15, 0.15),
    ], columns=["quantity", "measured", "from", "to"])


def plot(matches, sensor_px, um_per_px, file):
    """Recall, bias and RMS error over depth and over the distance from the middle, for each method."""
    matches = matches.reset_index(drop=True)
    methods = list(dict.fromkeys(matches.method))
    quantities = ["recall", "bias of z, um", "RMS error of z, um"]
    depth = np.arange(-40, 41, 8)
    radius = [0, 150, 220, 290, 360, 430, 580]
    panels = [(q, "z") for q in quantities] + [(q, "r") for q in quantities[1:]]
    figure, axes = plt.subplots(len(panels), len(methods), figsize=(3.4 * len(methods), 2.1 * len(panels)),
                                squeeze=False, sharey="row", layout="constrained")
    for column, method in enumerate(methods):
        for images, style in {"real": "-o", "twin": "--s"}.items():
            rows = matches[(matches.method == method) & (matches.images == images)]
            over_z = binned(rows, rows.z_um, depth)
            far = rows[rows.z_um.abs() > NEAR_UM]
            over_r = binned(far, radius_um(far, sensor_px, um_per_px), radius)
            for row, (quantity, over) in enumerate(panels):
                middle, values = over_z if over == "z" else over_r
                axes[row, column].plot(middle, values[quantity].to_numpy(float), style, ms=4, label=images)
        axes[0, column].set_title(method)
    for row, (quantity, over) in enumerate(panels):
        axes[row, 0].set_ylabel(quantity)
        for axis in axes[row]:
            axis.set_xlabel("z, um" if over == "z" else f"distance from the middle, um (|z| > {NEAR_UM:.0f} um)")
            axis.grid(alpha=0.3)
    axes[0, 0].legend()
    figure.savefig(file, dpi=90)


def montage(real, twin_images, z_um, file):
    """Parts of frames of both, from the lowest to the highest plane, and the profile of the noise."""
    chosen = [0, len(z_um) // 4, len(z_um) // 2, 3 * len(z_um) // 4, len(z_um) - 1]
    figure, axes = plt.subplots(2, len(chosen), figsize=(2.6 * len(chosen), 5.5), layout="constrained")
    for column, k in enumerate(chosen):
        for row, frames in enumerate((real, twin_images)):
            part = frames[k][-256:, -256:].astype(float) - np.median(frames[k])
            # The same gray levels in both.
            top = np.quantile(real[k][-256:, -256:] - np.median(real[k]), 0.998)
            axes[row, column].imshow(np.sqrt(np.clip(part, 0, top)), cmap="gray", vmin=0, vmax=np.sqrt(top))
            axes[row, column].set(xticks=[], yticks=[])
        axes[0, column].set_title(f"z = {z_um[k]:+.0f} um")
    axes[0, 0].set_ylabel("recorded")
    axes[1, 0].set_ylabel("twin")
    figure.savefig(file, dpi=90)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scan", type=Path)
    parser.add_argument("z", type=Path)
    for option in ("--magnification", "--pixel-size", "--diameter", "--wavelength"):
        parser.add_argument(option, type=float, required=True)
    parser.add_argument("--emission", default="volume")
    parser.add_argument("--window", type=int, default=33)
    parser.add_argument("--trackers", type=Path, default=Path(__file__).resolve().parents[2] / "examples/trackers")
    parser.add_argument("--python", nargs="*", default=[], metavar="TRACKER=PYTHON", help="the Python of a tracker's environment")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--continue", action="store_true", dest="resume", help="keep the fit and the twin's images of an earlier run")
    args = parser.parse_args()
    out = args.out
    out.mkdir(parents=True, exist_ok=True)
    stage, planes = split(args.scan, args.z, out)
    um_per_px = args.pixel_size / args.magnification
    if not (args.resume and (out / "fitted" / "field.json").exists()):
        run("microsig", "fit", out / "real" / "scan.tif", "--z", out / "z.csv", "--magnification", args.magnification, "--pixel-size",
            args.pixel_size, "--diameter", args.diameter, "--model", "waves", "--wavelength", args.wavelength, "--emission",
            args.emission, "--field", "--window", args.window, "--out", out / "fitted", "--force")
    focus_um = json.loads((out / "fitted" / "field.json").read_text())["focus_um"]  # of the stage
    scan = tifffile.imread(out / "real" / "scan.tif")
    located = locate(scan, stage, focus_um)
    known = [located.assign(frame=k, z_um=z)[["frame", "x_px", "y_px", "z_um"]] for k, z in enumerate(planes)]
    pd.concat(known).round(3).to_csv(out / "known.csv", index=False)
    particles = spheres(located, args.diameter / um_per_px)
    print(f"{len(located)} particles and clusters; {len(particles)} spheres in the twin", flush=True)
    if not (args.resume and (out / "twin" / "scan.tif").exists()):
        images = twin(out, np.concatenate([stage, planes]), focus_um, particles)
        write(out / "twin", images[:len(stage)], images[len(stage):])
    python = {name: path for name, path in (pair.split("=") for pair in args.python)}
    other = lambda name, params: lambda dataset, result: [python.get(name, "python3"), args.trackers / name / "track.py", dataset,
                                                          "--out", result, "--params", params]
    methods = {
        "ncc": lambda dataset, result: ["microsig", "track", dataset, "--method", "ncc", "--out", result, "--force"],
        "mle": lambda dataset, result: ["microsig", "track", dataset, "--method", "mle", "--out", result, "--force"],
        "magtrack": other("magtrack", args.trackers / "magtrack/params/quickstart.json"),
        "picasso_spline": other("picasso_spline", Path(__file__).with_name("picasso.json")),
    }
    matches = []
    for name in ("real", "twin"):
        imported(out / name, out)
        matches.append(track(out / name, methods))
    matches = pd.concat(matches, ignore_index=True)
    sensor = scan.shape[:0:-1]
    table = summary(matches, sensor, um_per_px)
    table.round(4).to_csv(out / "scores.csv", index=False)
    print(table.round(3).to_string(index=False))
    reached = bars(out / "fitted", matches, um_per_px)
    reached.round(4).to_csv(out / "bars.csv", index=False)
    print(reached.round(3).to_string(index=False))
    plot(matches, sensor, um_per_px, out / "predicted.png")
    frames = {name: np.stack([tifffile.imread(f) for f in sorted((out / name / "frames").glob("*.tif"))]) for name in ("real", "twin")}
    montage(frames["real"], frames["twin"], planes, out / "images.png")


if __name__ == "__main__":
    main()
