"""CPU time of `spots` and `piv` beside trackpy (with numba) and OpenPIV, with equal passes and windows, on the same images:

    python3 results/baselines/speed.py PROGRAM [PROGRAM ...] [--repeats 3]

makes the table of speed.md. PROGRAM: builds of microsig that are compared, the first of which generates the dataset. It needs trackpy, numba, OpenPIV
and tifffile. One thread each, interleaved; medians. Of microsig the whole process counts, of Python neither imports nor the compilation by numba.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
import warnings
from pathlib import Path

for threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[threads] = "1"
warnings.filterwarnings("ignore")

import numpy as np
import pandas as pd
import tifffile
import trackpy
from openpiv import filters, validation, windef
from openpiv.settings import PIVSettings

SCENARIO = Path(__file__).resolve().parents[2] / "scenarios/piv_gaussian.ron"
# trackpy refuses to link 0.03 particles per px at this reach; correlation needs as many.
SPARSE_PPP, DENSE_PPP, REACH_PX = 0.005, 0.03, 7
OPENPIV_IMAGES = 4  # of 20: it takes seconds for a pair
PASSES = (64, 32, 16, 16, 16)


def spots_of_trackpy(files, out):
    pairs = []
    for first in range(0, len(files), 2):
        found = [trackpy.locate(tifffile.imread(file), 5, separation=3, minmass=150, engine="numba") for file in files[first : first + 2]]
        pairs.append(trackpy.link(pd.concat([f.assign(frame=first + k) for k, f in enumerate(found)]), REACH_PX, link_strategy="auto"))
        pairs[-1]["particle"] += 100_000 * first
    pd.concat(pairs).to_csv(out, index=False)


def field_of_openpiv(files, out):
    settings = PIVSettings()
    settings.windowsizes, settings.overlap, settings.num_iterations = PASSES, tuple(w // 2 for w in PASSES), len(PASSES)
    settings.deformation_method, settings.interpolation_order, settings.correlation_method = "symmetric", 3, "circular"
    settings.sig2noise_validate, settings.show_all_plots, settings.smoothn, settings.median_normalized = False, False, False, True
    rows = []
    for pair in range(len(files) // 2):
        a, b = (tifffile.imread(file) for file in files[2 * pair : 2 * pair + 2])
        x, y, u, v, s2n = windef.first_pass(a, b, settings)
        u, v = filters.replace_outliers(u, v, validation.typical_validation(u, v, s2n, settings), method="localmean", max_iter=3, kernel_size=1)
        u, v = np.ma.masked_array(u, np.ma.nomask), np.ma.masked_array(v, np.ma.nomask)
        for k in range(1, len(PASSES)):
            x, y, u, v = windef.multipass_img_deform(a, b, k, x, y, u, v, settings)[:4]
        columns = [np.full(x.size, pair), *(np.ma.getdata(c).ravel() for c in (x + 1, y + 1, u, v))]
        rows.append(pd.DataFrame(dict(zip("pair x_px y_px dx_px dy_px".split(), columns))))
    pd.concat(rows).to_csv(out, index=False)


def score(program, dataset, result):
    scores = json.loads(subprocess.run([program, "--json", "evaluate", dataset, result], capture_output=True, text=True, check=True).stdout)
    if "field" in scores and scores["field"]:
        return f"AEE {scores['field']['truths']['central']['aee_px']:.4f} px"
    return f"F1 {scores['detection']['f1']:.3f}, RMS error {scores['detection']['rmse_xy_px']:.3f} px"


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("programs", nargs="+")
    parser.add_argument("--repeats", type=int, default=3)
    arguments = parser.parse_args()
    trackpy.quiet()
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        datasets = {"spots": folder / "sparse", "piv": folder / "dense"}
        for dataset, ppp in zip(datasets.values(), (SPARSE_PPP, DENSE_PPP)):
            options = ["--set", f"particles.number.ppp={ppp}", "--out", dataset]
            subprocess.run([arguments.programs[0], "--quiet", "generate", SCENARIO, *options], check=True)
        sparse, dense = (sorted(dataset.glob("images/*.tif")) for dataset in datasets.values())

        def tracker(program, method):
            options = ["--max-displacement", str(REACH_PX)] if method == "spots" else []
            return lambda out: subprocess.run(
                [program, "--quiet", "-j", "1", "track", "--method", method, *options, "--force", datasets[method], "--out", out], check=True
            )

        work = {f"`spots`, {Path(p).name}": tracker(p, "spots") for p in arguments.programs}
        work["trackpy"] = lambda out: spots_of_trackpy(sparse, out)
        work |= {f"`piv`, {Path(p).name}": tracker(p, "piv") for p in arguments.programs}
        work["OpenPIV"] = lambda out: field_of_openpiv(dense[:OPENPIV_IMAGES], out)
        seconds = {name: [] for name in work}
        spots_of_trackpy(sparse[:2], folder / "warm.csv")
        for _ in range(arguments.repeats):
            for k, (name, run) in enumerate(work.items()):
                before = sum(os.times()[:4])
                run(folder / f"{k}.csv")
                seconds[name].append(sum(os.times()[:4]) - before)
        print("| | CPU ms per image | result |\n|---|---|---|")
        for k, name in enumerate(work):
            ms = 1e3 * statistics.median(seconds[name]) / (OPENPIV_IMAGES if name == "OpenPIV" else len(sparse))
            dataset = datasets["piv" if "piv" in name.lower() else "spots"]
            print(f"| {name} | {ms:.1f} | {score(arguments.programs[-1], dataset, folder / f'{k}.csv')} |")


if __name__ == "__main__":
    sys.exit(main())
