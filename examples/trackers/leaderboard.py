"""Runs microsig's trackers and those of this folder on a suite, scores them, and writes the page of the results:

    python3 examples/trackers/leaderboard.py [--size small] [--tracks P2,V] [--trackers spots,trackpy] [--tune]

    WORK/SIZE/datasets/    the suite
    WORK/SIZE/blind/       its test splits as trackers see them: images, calibration, optics, times
    WORK/SIZE/results/     TRACKER/TRACK/CASE/results.csv with run.json, which names the inputs by hash
    WORK/SIZE/scores/      those of `microsig suite score`
    WORK/venvs/TRACKER/    the environment of a third-party tracker

Runs whose inputs have not changed are skipped. The command is $MICROSIG, or the release build, which is built if necessary.
"""

import argparse
import csv
import hashlib
import json
import os
import shutil
import statistics
import subprocess
import sys
import time
import tomllib
import venv
import zipfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
sys.path.insert(0, str(ROOT / "results"))
from records import built, machine, table  # noqa: E402

MODEL = ["D3", "A3", "T/channel", "T/vortex", "T/brownian", "T/mixing", "T/turbulence"]
# name: arguments of `microsig track`, tracks and cases, whether it measures depth, purpose
OWN = {
    "spots": ("spots", ["P2", "T"], False, "particles in focus, in the image plane"),
    "ncc": ("ncc", MODEL, True, "defocused particle images similar to the calibration stack (GDPT)"),
    "ncc-spheroid": (
        "ncc --shape spheroid", ["S"], True,
        "rods and discs, by correlation with images rendered for all orientations; one aspect ratio is fitted for all particles",
    ),
    "mle-spheroid": (
        "mle --shape spheroid", ["S"], True,
        "rods and discs, by maximum likelihood with the optical model of the dataset; one aspect ratio is fitted for all particles",
    ),
    "mle": ("mle", MODEL, True, "images that follow the optical model with which they were generated: the performance of an exact model"),
    "aptv": ("aptv", ["A3", "T/turbulence"], True, "isolated astigmatic images elongated along x or y"),
    "piv": ("piv", ["V"], False, "displacement fields of single image pairs in focus"),
    "piv-ensemble": ("piv --ensemble", ["V"], False, "one displacement field of a steady flow from all image pairs"),
}
# What a result depends on in a test split, and what trackers do not see of it, except the times in truth/frames.csv.
SEEN = ("images/", "calibration/", "settings.txt", "truth/frames.csv")
HIDDEN = ("truth/", "particles/", "scenario.ron", "preview.png", "README.md", "SHA256SUMS")
DECLARATION = (
    "x_px to the right and y_px downward, center of the top-left pixel at (1, 1); z_um physical depth in um, growing away from the lens; frames from 0"
)
NOTES = """
Trackers see images, calibration images, optics and times of the test splits, but not the truth. The seeds of these test splits are public, so the \
leaderboard relies on the honesty of participants; `microsig suite release` makes challenges with secret keys.

microsig's own trackers run with their default parameters. Third-party trackers in `examples/trackers` run with parameters that their `tune.py` found \
on train and val splits with a limited number of evaluations (`--tune`; `tuning.csv` lists them), or with defaults where no parameters were searched.

Each case is ranked separately; scores of different cases are never averaged. Of two trackers, the one that is better in more cases of the track is \
ahead, and a case without a result is behind all others.
"""


class Tracker:
    """A tracker of microsig, or a folder with `tracker.toml` or `tracker.json`."""

    def __init__(self, name, tracks, depth, made_for, own=None, folder=None, about=None):
        self.name, self.tracks, self.depth, self.made_for = name, tracks, depth, made_for
        self.own, self.folder, self.about, self.python, self.versions = own, folder, about or {}, "python3", ""

    @staticmethod
    def read(folder):
        file = next((f for f in (folder / "tracker.toml", folder / "tracker.json") if f.is_file()), None)
        if file is None:
            return None
        about = (tomllib if file.suffix == ".toml" else json).loads(file.read_text())
        name = about["name"]
        if not name or not all(c.isascii() and (c.isalnum() or c in "._-") for c in name):
            sys.exit(f"{file}: name = {name!r}: expected letters, digits, `.`, `_`, `-`")
        limits = f" Limitations: {about['out_of_depth']}" if "out_of_depth" in about else ""
        return Tracker(name, about["tracks"], about.get("depth", True), about["made_for"].strip() + limits, folder=folder, about=about)

    def enters(self, case):
        return (case["track"] in self.tracks or case["folder"] in self.tracks) and (self.depth or not case["depth"])

    def params(self, case):
        """The file with its parameters for a case."""
        names = (f"params/{case['folder']}.json", f"params/{case['track']}.json", "params.json")
        return next((self.folder / name for name in names if (self.folder / name).is_file()), None)

    def install(self, venvs):
        """Creates its environment, unless one with the same requirements exists."""
        requirements = self.folder and self.folder / "requirements.txt"
        if not requirements or not requirements.is_file():
            return
        place = venvs / self.name
        self.python, done = place / "bin/python", place / "installed.sha256"
        wanted = hashlib.sha256(requirements.read_bytes()).hexdigest()
        if not done.is_file() or done.read_text() != wanted:
            print(f"{self.name}: installing", flush=True)
            venv.create(place, with_pip=True, clear=True)
            subprocess.run([self.python, *PIP, "install", "--quiet", "-r", requirements], check=True)
            done.write_text(wanted)
        self.versions = subprocess.run([self.python, *PIP, "freeze"], check=True, capture_output=True, text=True).stdout


PIP = ["-m", "pip", "--disable-pip-version-check"]


def trackers():
    own = [Tracker(name, tracks, depth, made_for + "; default parameters", own=["--method", *arguments.split()])
           for name, (arguments, tracks, depth, made_for) in OWN.items()]
    others = [tracker for folder in sorted(HERE.iterdir()) if folder.is_dir() and (tracker := Tracker.read(folder))]
    names = [tracker.name for tracker in own + others]
    if twice := {name for name in names if names.count(name) > 1}:
        sys.exit(f"several trackers have the name {', '.join(twice)}")
    return own + others


def suite_cases(microsig, suite, size):
    """All cases."""
    said = subprocess.run([microsig, "suite", "list", suite, "--size", size, "--json"], check=True, capture_output=True, text=True).stdout
    for track in json.loads(said)["tracks"]:
        for case in track["cases"]:
            yield {"track": track["track"], "case": case["case"], "folder": f"{track['track']}/{case['case']}", "depth": case.get("dims") == 3}


def blind(dataset, place):
    """The test split without its truth: links to the files that trackers may read."""
    shutil.rmtree(place, ignore_errors=True)
    for file in sorted(dataset.rglob("*")):
        name = file.relative_to(dataset).as_posix()
        if file.is_file() and (name.startswith(SEEN) or not name.startswith(HIDDEN)):
            (place / name).parent.mkdir(parents=True, exist_ok=True)
            try:
                os.link(file, place / name)
            except OSError:
                shutil.copy(file, place / name)
    return place


def is_input(name):
    """Whether a run depends on this file: not on searches and training, nor on parameters of other cases."""
    is_search = name.startswith("params") or name in ("tune.py", "tuning.py", "train.py")
    return name.endswith((".py", ".json", ".txt", ".onnx")) and not is_search


def inputs(microsig, dataset, tracker, case):
    """A hash of everything that determines the result: images, program, parameters."""
    parts = [line for line in (dataset / "SHA256SUMS").read_text().splitlines() if line.split("  ", 1)[1].startswith(SEEN)]
    if tracker.own:
        parts += [subprocess.run([microsig, "--version", "--json"], check=True, capture_output=True, text=True).stdout, *tracker.own]
    else:
        for folder in (tracker.folder, HERE / "common"):
            for file in sorted(f for f in folder.rglob("*") if f.is_file()):
                name = file.relative_to(folder).as_posix()
                parts += [f"{name} {hashlib.sha256(file.read_bytes()).hexdigest()}"] if is_input(name) else []
        parts += [tracker.about.get("command", ""), (params := tracker.params(case)) and params.read_text() or ""]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def run(microsig, work, tracker, case, limit_s):
    """Runs a tracker, unless the inputs of its last run were the same; returns what happened."""
    dataset, out = work / "datasets" / case["folder"] / "test", work / "results" / tracker.name / case["folder"]
    record, result, part = out / "run.json", out / "results.csv", out / "results.csv.part"
    own_inputs = inputs(microsig, dataset, tracker, case)
    if record.is_file() and json.loads(record.read_text())["inputs"] == own_inputs:
        return "already done"
    out.mkdir(parents=True, exist_ok=True)
    for old in (record, result, part):
        old.unlink(missing_ok=True)
    seen = blind(dataset, work / "blind" / case["folder"])
    if tracker.own:
        command = [microsig, "track", seen, *tracker.own, "--out", part, "--force", "--quiet", "--json"]
    else:
        program, *words = tracker.about.get("command", "python track.py").split()
        params = tracker.params(case)
        command = [tracker.python if program == "python" else program, *words, seen, "--out", part, *(["--params", params] if params else [])]
    start, failure, said = time.perf_counter(), None, ""
    try:
        ran = subprocess.run(command, cwd=tracker.folder, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=limit_s)
        said = ran.stdout + ran.stderr
        if ran.returncode:
            failure = next((line.strip() for line in reversed(said.splitlines()) if line.strip()), f"exit code {ran.returncode}")
        elif not part.is_file():
            failure = "wrote no result"
    except subprocess.TimeoutExpired:
        failure = f"not finished after {limit_s} s"
    seconds = time.perf_counter() - start
    part.unlink(missing_ok=True) if failure else part.rename(result)
    frames = len(list((dataset / "images").iterdir()))
    each = reported(said) or seconds / max(frames, 1)
    text = {"inputs": own_inputs, "frames": frames, "seconds": seconds, "seconds_per_frame": each, "failure": failure, "said": said[-2000:]}
    record.write_text(json.dumps(text, indent=2) + "\n")
    return f"failed: {failure}" if failure else f"{seconds:.1f} s"


def reported(said):
    """The time per frame that a tracker reports in a line of JSON, excluding startup and reading."""
    for line in reversed(said.splitlines()):
        if line.startswith("{"):
            try:
                return json.loads(line).get("seconds_per_frame")
            except ValueError:
                pass
    return None


def tune(microsig, datasets, tracker, case):
    """Searches parameters for a case on train and val, unless they exist; returns what happened."""
    once, each = tracker.about.get("tune_once", []), tracker.about.get("tune", [])
    if case["folder"] not in once and case["folder"] not in each and case["track"] not in each:
        return None
    params = f"params/{case['track'] if case['folder'] in once else case['folder']}.json"
    if (tracker.folder / params).is_file():
        return f"{params} already exists"
    dataset, start = datasets / case["folder"], f"params/start/{case['track']}.json"
    command = [tracker.python, "tune.py", dataset / "train", "--val", dataset / "val", "--out", params, "--log", "tuning.csv"]
    command += ["--start", start] if (tracker.folder / start).is_file() else []
    begun = time.perf_counter()
    ran = subprocess.run(command, cwd=tracker.folder, env=os.environ | {"MICROSIG": str(microsig)}, capture_output=True, text=True)
    return f"no parameters found: {ran.stderr}" if ran.returncode else f"{params} after {time.perf_counter() - begun:.0f} s"


def forget(results, all_trackers, cases):
    """Removes results for cases that no longer exist or that their tracker does not enter."""
    for tracker in all_trackers:
        known = {case["folder"] for case in cases if tracker.enters(case)}
        for folder in (results / tracker.name).glob("*/*/"):
            if folder.relative_to(results / tracker.name).as_posix() not in known:
                shutil.rmtree(folder)


def rows(file):
    """The rows of a table, if it exists."""
    with open(file if file.is_file() else os.devnull, newline="") as text:
        return list(csv.DictReader(text))


def readme(earlier, scores, all_trackers, runs, notes):
    """The standings, and the runs that failed. Tracks that were not scored keep their sections of the earlier text."""
    parts = [part.split("\n", 1) for part in earlier.split("\n## ")[1:]]
    sections = {title: text.strip("\n") for title, text in parts if title.startswith("Track ")}
    made_for = {tracker.name: " ".join(tracker.made_for.split()) for tracker in all_trackers}
    for track in dict.fromkeys(case["track"] for case in scores["cases"]):
        entries = []
        for s in (s for s in scores["standings"] if s["track"] == track):
            times = [float(t["seconds_per_frame"]) for t in runs if (t["tracker"], t["track"]) == (s["tracker"], track) and t["seconds_per_frame"]]
            median = f"{statistics.median_high(times):.3f}" if times else "–"
            entries.append([s["tracker"], s["rank"], f"{s['scored']} of {s['cases']}", s["first"], median, made_for.get(s["tracker"], "")])
        head = ["tracker", "rank", "cases", "first in", "s per frame, median", "made for"]
        sections[f"Track {track}"] = "\n\n".join([*notes, table(head, entries).rstrip("\n") if entries else "No tracker has entered this track."])
    failed = [f"- {t['tracker']} on {t['track']}/{t['case']}: {t['failure']}" for t in runs if t["failure"]]
    sections |= {"Runs that failed": "\n".join(failed)} if failed else {}
    return f"""# Leaderboard of {scores['suite']} {scores['version']}, size {scores['size']}

`index.html`, which the command writes beside this file and which is not kept in the repository, shows all cases with intervals and curves; \
`scores.csv` contains all scores with the ends of their 95 % intervals, `times.csv` the time per frame, `versions/` the packages of each environment, \
`results/` the results, where they are kept.
{NOTES}""" + "".join(f"\n## {title}\n\n{text}\n" for title, text in sections.items())


def write(out, work, all_trackers, notes):
    """README.md, scores.csv, times.csv, index.html and versions, in which tracks that were not scored keep what they have; returns the runs that failed."""
    scores, runs = json.loads((work / "scores/suite_scores.json").read_text()), []
    for case in scores["cases"]:
        for tracker in sorted(result["tracker"] for result in case["results"]):
            record = work / "results" / tracker / case["track"] / case["case"] / "run.json"
            if record.is_file():
                ran = json.loads(record.read_text())
                seconds = "" if ran["failure"] else f"{ran['seconds_per_frame']:.4f}"
                runs.append({"tracker": tracker, "track": case["track"], "case": case["case"], "seconds_per_frame": seconds, "failure": ran["failure"] or ""})
    (out / "versions").mkdir(parents=True, exist_ok=True)
    shutil.copy(work / "scores/index.html", out / "index.html")
    scored = {case["track"] for case in scores["cases"]}
    times = [row for row in rows(out / "times.csv") if row["track"] not in scored] + runs
    found = [row for row in rows(out / "scores.csv") if row["track"] not in scored] + rows(work / "scores/suite_scores.csv")
    for name, of in (("times.csv", times), ("scores.csv", found)):
        with open(out / name, "w", newline="") as file:
            writer = csv.DictWriter(file, list(of[-1]) if of else [], lineterminator="\n", extrasaction="ignore")
            writer.writeheader()
            writer.writerows(of)
    page = out / "README.md"
    page.write_text(readme(page.read_text() if page.is_file() else "", scores, all_trackers, times, notes))
    for tracker in all_trackers:
        if tracker.versions:
            (out / f"versions/{tracker.name}.txt").write_text(tracker.versions)
    print(out / "index.html")
    return [r for r in runs if r["failure"]]


def rounded(cell):
    """A number with four decimals, which is far less than any error."""
    try:
        return repr(round(float(cell), 4)) if "." in cell else cell
    except ValueError:
        return cell


def pack(microsig, work, out, tracker, cases):
    """The results in a small form, OUT/TRACKER.zip, in which they are scored and published: `suite score --against` reads them."""
    datasets, times, images, files = work / "datasets", {}, {}, {}
    suite = json.loads((datasets / "suite.json").read_text())
    for case in cases:
        folder = work / "results" / tracker.name / case["folder"]
        if not (folder / "results.csv").is_file():
            continue
        times[case["folder"]] = json.loads((folder / "run.json").read_text())["seconds_per_frame"]
        sums = (datasets / case["folder"] / "test/SHA256SUMS").read_text().splitlines(keepends=True)
        images[case["folder"]] = hashlib.sha256("".join(line for line in sums if "  images/" in line).encode()).hexdigest()
        with open(folder / "results.csv", newline="") as file:
            rows = [",".join(map(rounded, row)) + "\n" for row in csv.reader(file)]
        files[f"{case['folder']}/results.csv"] = "".join(rows)
    if not files:
        return
    host, said = machine(microsig), subprocess.run([microsig, "--version"], check=True, capture_output=True, text=True).stdout
    by, command = ("microsig", ["microsig track", *tracker.own]) if tracker.own else (
        "others, run by microsig", [tracker.about.get("command", "python track.py")])
    version = said.strip() if tracker.own else f"versions/{tracker.name}.txt"
    files["submission.json"] = json.dumps({
        "team": by, "method": tracker.name, "version": version, "params": {}, "runtime_s": None, "hardware": host,
        "coordinate_declaration": DECLARATION, "suite": f"{suite['name']} {suite['version']}, size {suite['size']}", "images_sha256": images,
    }, indent=2) + "\n"
    files["tracker.json"] = json.dumps({
        "made_for": " ".join(tracker.made_for.split()), "by": by, "version": version, "command": " ".join(command),
        "machine": host, "seconds_per_frame": times,
    }, indent=2) + "\n"
    out.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(out / f"{tracker.name}.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in files.items():
            archive.writestr(zipfile.ZipInfo(name), text, zipfile.ZIP_DEFLATED)


def revision(suite):
    """The commit of the files that are read here, and whether they have uncommitted changes; results do not count."""
    def git(*words):
        ran = subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True)
        return None if ran.returncode else ran.stdout.strip()

    commit = git("rev-parse", "--short=12", "HEAD")
    changes = git("status", "--porcelain", "--", suite, "examples/trackers")
    return "unknown commit" if commit is None else f"commit {commit}" + ("" if changes == "" else " with changes")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    names = lambda text: text.split(",")  # noqa: E731
    parser.add_argument("--suite", default=str(ROOT / "scenarios/odpc1"))
    parser.add_argument("--size", default="small", choices=["smoke", "small", "full"])
    parser.add_argument("--tracks", type=names, default=[], help="only these tracks, separated by commas")
    parser.add_argument("--trackers", type=names, default=[], help="only these trackers, separated by commas")
    parser.add_argument("--work", type=Path, default=ROOT / "target/leaderboard", help="folder of datasets, environments and results")
    parser.add_argument("--out", type=Path, default=ROOT / "results/leaderboard", help="output folder of SIZE/README.md and the other files")
    parser.add_argument("--tune", action="store_true", help="first search missing parameters of third-party trackers, on train and val")
    parser.add_argument("--page-only", action="store_true", help="run no tracker; score the results of earlier runs and write the page")
    parser.add_argument("--limit-s", type=float, default=900, help="time limit of a run on one case, s")
    options = parser.parse_args()
    if options.tune and options.page_only:
        parser.error("--tune: expected without --page-only")
    microsig = Path(os.environ.get("MICROSIG") or built("microsig")).resolve()
    work, notes = (options.work / options.size).resolve(), []
    cases = list(suite_cases(microsig, options.suite, options.size))
    everybody = trackers()
    for option, wanted, known in (("--tracks", options.tracks, {case["track"] for case in cases}),
                                  ("--trackers", options.trackers, {tracker.name for tracker in everybody})):
        if unknown := set(wanted) - known:
            parser.error(f"{option} {','.join(unknown)}: expected some of {', '.join(sorted(known))}")
    chosen = [case for case in cases if not options.tracks or case["track"] in options.tracks]
    for track in dict.fromkeys(case["track"] for case in chosen):
        print(f"datasets of {track}", flush=True)
        generate = ["suite", "generate", options.suite, "--size", options.size, "--resume", "--quiet", "--track", track]
        subprocess.run([microsig, *generate, "--out", work / "datasets"], check=True)
    usable = []
    for tracker in everybody:
        if options.trackers and tracker.name not in options.trackers:
            continue
        try:
            tracker.install(options.work.resolve() / "venvs")
            usable.append(tracker)
        except (OSError, subprocess.CalledProcessError) as error:
            notes.append(f"{tracker.name} cannot be installed: {error}")
            print(notes[-1])
    results = work / "results"
    for tracker in usable:
        entered = [case for case in chosen if tracker.enters(case)]
        for case in entered if options.tune and tracker.folder else []:
            if said := tune(microsig, work / "datasets", tracker, case):
                print(f"{tracker.name} on {case['folder']}: {said}", flush=True)
        for case in [] if options.page_only else entered:
            print(f"{tracker.name} on {case['folder']}: {run(microsig, work, tracker, case, options.limit_s)}", flush=True)
    forget(results, usable, cases)
    packed = options.out / options.size / "results"
    for tracker in usable:
        (packed / f"{tracker.name}.zip").unlink(missing_ok=True)
        pack(microsig, work, packed, tracker, cases)
    score = ["suite", "score", options.suite, work / "datasets", "--results", packed, "--out", work / "scores", "--force", "--quiet"]
    subprocess.run([microsig, *score, *(["--track", options.tracks[0]] if len(options.tracks) == 1 else [])], check=True)
    made = f"Made by `{' '.join(['examples/trackers/leaderboard.py', *sys.argv[1:]])}`; suite, scripts and parameters: {revision(options.suite)}."
    failed = write(options.out / options.size, work, usable, [made, machine(microsig) + ".", *notes])
    # Third-party trackers may fail outside their range of use; microsig's own may not.
    if own := [f"{r['tracker']} on {r['track']}/{r['case']}: {r['failure']}" for r in failed if r["tracker"] in OWN]:
        sys.exit(f"microsig's own trackers failed: {'; '.join(own)}")


if __name__ == "__main__":
    main()
