"""The command line of the trackers: `track.py DATASET --out results.csv`."""

import argparse
import json
import sys
import time
from pathlib import Path

from .dataset import Dataset, fail, write_points


def read_params(path, defaults):
    """The defaults, replaced by those of the file."""
    given = json.loads(Path(path).read_text()) if path else {}
    unknown = sorted(set(given) - set(defaults))
    if unknown:
        fail(f"{path} has unknown parameters {', '.join(unknown)}; known are {', '.join(defaults)}")
    return {**defaults, **given}


def track_main(track, defaults, write=write_points):
    """Runs `track(dataset, params)`, which returns rows, and writes them."""
    parser = argparse.ArgumentParser(description=sys.modules["__main__"].__doc__)
    parser.add_argument("dataset", help="folder of a microsig dataset")
    parser.add_argument("--out", required=True, help="the result (CSV)")
    parser.add_argument("--params", help="parameters (JSON), instead of the defaults")
    options = parser.parse_args()
    dataset = Dataset.open(options.dataset)
    params = read_params(options.params, defaults)
    began = time.perf_counter()
    rows = track(dataset, params)
    seconds = time.perf_counter() - began
    write(options.out, rows)
    each = seconds / len(dataset.frames)
    print(json.dumps({"rows": len(rows), "frames": len(dataset.frames), "seconds": round(seconds, 3),
                      "seconds_per_frame": round(each, 4)}), file=sys.stderr)
