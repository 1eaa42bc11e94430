"""Checks results for a suite and packs them, without any other package: python pack.py FOLDER RESULTS team.zip

FOLDER has suite.json of the release and the unpacked archives of its test splits; RESULTS has submission.json and
TRACK/CASE/results.csv. The hashes of the images are filled in from the test splits. Problems: exit code 2.
"""

import csv
import hashlib
import json
import sys
import zipfile
from pathlib import Path

PARTICLES = ["frame", "x_px", "y_px"]
FIELDS = ["x_px", "y_px", "dx_px", "dy_px"]


def images_sha256(split):
    """As `grep '  images/' SHA256SUMS | sha256sum`."""
    lines = (split / "SHA256SUMS").read_text().splitlines(keepends=True)
    return hashlib.sha256("".join(line for line in lines if "  images/" in line).encode()).hexdigest()


def problems_of(result, manifest):
    """What is wrong with a result, each with its line."""
    facts = manifest["microsig"]
    fields = "particles" not in facts.get("scored", ["particles"])
    timing = facts["timing"]
    frames = 2 * timing["pairs"] if timing["mode"] == "pairs" else timing["frames"]
    with open(result, newline="", encoding="utf-8-sig") as file:
        rows = csv.reader(file)
        header = next(rows, [])
        needed = FIELDS if fields else PARTICLES + (["z_um"] if facts.get("scoring", {}).get("dims") == 3 else [])
        missing = [name for name in needed if name not in header]
        if missing:
            return [f"{result}:1: no column {', '.join(missing)}"]
        count, last = ("pair", timing.get("pairs", frames)) if fields else ("frame", frames)
        found = []
        for line, row in enumerate(rows, 2):
            cells = dict(zip(header, row))
            for name in needed:
                try:
                    float(cells[name] or "nan")
                except (KeyError, ValueError):
                    found.append(f"{result}:{line}: {name} = {cells.get(name)!r}: expected a number")
            number = cells.get(count)
            if number and not (number.isdigit() and int(number) < last):
                found.append(f"{result}:{line}: {count} = {number}: expected 0 to {last - 1}")
        return found[:20]


def main(folder, results, out):
    suite = json.loads((folder / "suite.json").read_text())
    edition = f"{suite['name']} {suite['version']}, size {suite['size']}"
    about = json.loads((results / "submission.json").read_text(encoding="utf-8-sig"))
    problems, files, hashes = [], [], {}
    if about.get("suite") != edition:
        problems.append(f"submission.json: suite: expected {edition}; the submission is for {about.get('suite')}")
    for key in ("team", "method", "version", "hardware"):
        if not str(about.get(key) or "").strip():
            problems.append(f"submission.json: {key}: expected some text")
    for result in sorted(results.glob("*/*/results.csv")):
        case = result.parent.relative_to(results).as_posix()
        if case not in suite["images_sha256"]:
            problems.append(f"{result}: {edition} has no case {case}")
            continue
        split = folder / f"{suite['name']}-{case.lower().replace('/', '-')}-test"
        if not (split / "SHA256SUMS").is_file():
            problems.append(f"{split}: missing; unpack its archive")
            continue
        hashes[case] = images_sha256(split)
        if hashes[case] != suite["images_sha256"][case]:
            problems.append(f"{split}: not the images of {edition}")
        problems += problems_of(result, json.loads((split / "datapackage.json").read_text()))
        files.append((result, f"{case}/results.csv"))
    if not files:
        problems.append(f"{results}: no TRACK/CASE/results.csv")
    if problems:
        print("\n".join(f"error: {problem}" for problem in problems), file=sys.stderr)
        return 2
    about["images_sha256"] = hashes
    tracker = results / "tracker.json"
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("submission.json", json.dumps(about, indent=2) + "\n")
        for path, name in files + ([(tracker, "tracker.json")] if tracker.is_file() else []):
            archive.write(path, name)
    missing = sorted(set(suite["images_sha256"]) - set(hashes))
    late = f"; deadline {suite['deadline']}" if suite.get("deadline") else ""
    rest = f"; missing, behind all others: {', '.join(missing)}" if missing else ""
    print(f"{out}: {len(files)} of {len(suite['images_sha256'])} cases{rest}{late}")
    return 0


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit("usage: python pack.py FOLDER RESULTS team.zip")
    sys.exit(main(*map(Path, sys.argv[1:])))
