"""Parameter searches, `tune.py TRAIN --out params.json`, and their objectives. Runs of trackers do not depend on this file."""

import argparse
import csv
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from .cli import read_params
from .dataset import Dataset, fail, write_field, write_points


def evaluate(dataset, result, rules=()):
    """score.json of a result, by further options of `microsig evaluate`. `MICROSIG` names the program, by default `microsig`.
    Raises RuntimeError if the result cannot be scored, such as one without any depth under `--dims 3`."""
    program = os.environ.get("MICROSIG", "microsig")
    try:
        run = subprocess.run([program, "evaluate", str(dataset), str(result), *rules, "--json", "--quiet"],
                             capture_output=True, text=True)
    except FileNotFoundError:
        fail(f"{program} is not installed; set MICROSIG to its path")
    if run.returncode:
        raise RuntimeError(f"microsig evaluate: {run.stderr.strip()}")
    return json.loads(run.stdout)


def points_score(score):
    """F1 x (1 - errors of the particles found): 0.1 px, or 1 % of the depth range, cost a hundredth of F1. A result with particles
    is never worse than an empty one, which scores 0."""
    detection = score["detection"]
    errors = 0.1 * (detection["rmse_xy_px"] or 0.0)
    errors += (detection["rmse_z_um"] or 0.0) / score["definitions"]["depth_range_h_um"]
    return (detection["f1"] or 0.0) * max(0.0, 1.0 - errors)


def tracks_score(score):
    """The mean of F1 of particles (with their errors) and F1 of links."""
    return (points_score(score) + ((score.get("links") or {}).get("f1") or 0.0)) / 2


def field_score(score):
    """Fraction of the reference nodes at which the field is valid, minus the RMS error over all of them in px, in which a node
    without a vector and an error above 1 px count as 1 px: -1 for an empty result."""
    nodes = score["field"]["nodes"]
    return (nodes["valid"] or 0.0) - (1.0 if nodes["rms_px"] is None else nodes["rms_px"])


# Name of each objective in the column `objective` of tuning.csv. Another formula needs another name; options of `evaluate`
# follow it.
OBJECTIVES = {points_score: "points_product", tracks_score: "tracks_product", field_score: "field_nodes"}


def name_of(dataset):
    """The folder's name; TRACK/CASE for a split of a suite."""
    folder = dataset.folder.resolve()
    return "/".join(folder.parts[-3:-1]) if folder.name in ("train", "val") else folder.name


def tune_main(track, defaults, grid, score=points_score, write=write_points, budget=24):
    """A search along one parameter after the other, in the order of `grid`, until nothing improves or `budget`
    evaluations on the train split are used. The best three parameter sets are then evaluated on the validation split, and
    the best of these is kept. Every evaluation is a line of tuning.csv."""
    parser = argparse.ArgumentParser(description=sys.modules["__main__"].__doc__)
    parser.add_argument("train", help="dataset on which the search runs")
    parser.add_argument("--val", help="dataset on which the best three are compared")
    parser.add_argument("--out", required=True, help="output file of the parameters (JSON)")
    parser.add_argument("--log", help="record of the search (CSV), to which lines are appended [default: tuning.csv beside --out]")
    parser.add_argument("--start", help="parameters (JSON) from which the search starts, instead of the defaults")
    parser.add_argument("--evaluate", default="", metavar="OPTIONS",
                        help="options of `microsig evaluate` by which the case is scored, as --evaluate='--gate-xy 0.5 --dims 2'")
    parser.add_argument("--budget", type=int, default=budget, help=f"evaluations on train [default: {budget}]")
    options = parser.parse_args()
    log = Path(options.log) if options.log else Path(options.out).with_name("tuning.csv")
    rules = options.evaluate.split()
    objective = " ".join([OBJECTIVES.get(score, score.__name__), *rules])
    names = list(defaults)
    tried = {}

    def run(dataset, split, params):
        with tempfile.TemporaryDirectory() as folder:
            result = Path(folder) / "result.csv"
            began = time.perf_counter()
            try:
                write(result, track(dataset, params))
                value = score(evaluate(dataset.folder, result, rules))
            except Exception as error:  # Some programs fail for some parameters.
                print(f"{type(error).__name__}: {error}", file=sys.stderr)
                value = float("-inf")
            seconds = time.perf_counter() - began
        new = not log.exists()
        with open(log, "a", newline="") as file:
            out = csv.writer(file, lineterminator="\n")
            if new:
                out.writerow(["dataset", "split", "objective", "score", "seconds", *names])
            out.writerow([name_of(dataset), split, objective, f"{value:.4f}", f"{seconds:.2f}",
                          *(json.dumps(params[name]) for name in names)])
        print(f"{split} {value:.4f} {params}", file=sys.stderr)
        return value

    train = Dataset.open(options.train)

    def attempt(params):
        key = json.dumps(params, sort_keys=True)
        if key not in tried and len(tried) < options.budget:
            tried[key] = run(train, "train", params)
        return tried.get(key, float("-inf"))

    best = read_params(options.start, defaults)
    attempt(best)
    improved = True
    while improved and len(tried) < options.budget:
        improved = False
        for name, values in grid.items():
            for value in values:
                params = {**best, name: value}
                if attempt(params) > attempt(best):
                    best, improved = params, True
    if options.val:
        val = Dataset.open(options.val)
        finalists = sorted(tried, key=tried.get, reverse=True)[:3]
        best = max((json.loads(key) for key in finalists), key=lambda params: run(val, "val", params))
    Path(options.out).parent.mkdir(parents=True, exist_ok=True)
    Path(options.out).write_text(json.dumps(best, indent=2) + "\n")


__all__ = ["tune_main", "points_score", "tracks_score", "field_score", "write_field"]
