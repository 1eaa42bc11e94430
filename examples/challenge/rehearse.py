"""A challenge from `suite.ron` to the revealed truth, with an organizer and six teams as programs (docs/challenge.md):

    python examples/challenge/rehearse.py MICROSIG [PYTHON] [--keep FOLDER]

MICROSIG is the program; PYTHON, an interpreter with the packages of examples/trackers/trackpy, runs the team of trackpy, which is left
out without it. What must come out is asserted.
"""

import argparse
import csv
import datetime
import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
import zipfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
EXAMPLES = HERE.parent


class Organizer:
    """The commands of the organizer, which are counted."""

    def __init__(self, microsig, place):
        self.microsig, self.place, self.commands, self.began = microsig, place, 0, time.perf_counter()

    def run(self, *arguments, code=0):
        self.commands += 1
        words = [self.microsig, *map(str, arguments)]
        done = subprocess.run(words, cwd=self.place, capture_output=True, text=True)
        assert done.returncode == code, f"{words}: {done.returncode}\n{done.stdout}{done.stderr}"
        return done.stdout + done.stderr


def download(public, folder):
    """What a team downloads: `suite.json`, the example, the kit and the archives, unpacked."""
    folder.mkdir()
    shutil.copy(public / "suite.json", folder)
    for archive in [public / "kit.zip", *public.glob("*/*/*.zip")]:
        with zipfile.ZipFile(archive) as files:
            files.extractall(folder)
    suite = json.loads((folder / "suite.json").read_text())
    splits = {}
    for case in suite["images_sha256"]:
        splits[case] = folder / f"{suite['name']}-{case.lower().replace('/', '-')}-test"
    return splits


def about(public, results, team):
    """The example of the release, filled in."""
    with zipfile.ZipFile(public / "example.zip") as files:
        form = json.loads(files.read("submission.json"))
    form.update(team=team, method=team, version="1", hardware="a laptop")
    results.mkdir(parents=True, exist_ok=True)
    (results / "submission.json").write_text(json.dumps(form))


def tracked(command, splits, track, results):
    """Runs a tracker on the test splits of a track."""
    for case, split in splits.items():
        if case.startswith(f"{track}/"):
            out = results / case / "results.csv"
            out.parent.mkdir(parents=True)
            subprocess.run([*map(str, command(split, out))], check=True, capture_output=True)


def pack(folder, results, archive):
    """Checks and packs results with the kit alone."""
    kit = [sys.executable, folder / "kit/python/pack.py", folder, results, archive]
    return subprocess.run(kit, capture_output=True, text=True)


def rewritten(source, archive, change):
    """The archive with another `submission.json`."""
    with zipfile.ZipFile(source) as files, zipfile.ZipFile(archive, "w") as out:
        for name in files.namelist():
            data = files.read(name)
            if name == "submission.json":
                data = json.dumps(change(json.loads(data))).encode()
            out.writestr(name, data)


def true_values(withheld):
    """Texts of the true positions of a test split."""
    with open(withheld / "test/truth/tracks.csv", newline="") as file:
        return {row[key] for row in csv.DictReader(file) for key in ("x_px", "y_px") if len(row[key]) > 8}


def texts(public):
    """Name and contents of all published files; of archives, their files. Train and val have a truth of their own."""
    for path in (path for path in public.rglob("*") if path.is_file()):
        if path.suffix != ".zip":
            yield path, path.read_bytes()
        elif not path.stem.endswith(("-train", "-val")):
            with zipfile.ZipFile(path) as files:
                for name in files.namelist():
                    yield f"{path}/{name}", files.read(name)


def main(microsig, python, place):
    organizer = Organizer(microsig, place)
    release, inbox = place / "release", place / "inbox"
    deadline = datetime.date.today() + datetime.timedelta(days=2)
    # The challenge, in two commands.
    organizer.run("suite", "generate", HERE / "suite.ron", "--size", "smoke", "--split", "train", "--out", "datasets", "--quiet")
    organizer.run("suite", "release", HERE / "suite.ron", "datasets", "--out", release, "--creator", "Doe, Jane",
                  "--deadline", deadline, "--baselines", "spots,ncc", "--quiet")
    public = release / "public"
    page = (public / "index.html").read_text()
    assert str(deadline) in page and "within 1 px in the image plane" in page

    # Six teams. Two measure, the first with the program, the second without.
    inbox.mkdir()
    folder = place / "team"
    splits = download(public, folder)
    results = place / "results"
    about(public, results / "matching", "matching")
    tracked(lambda split, out: [microsig, "track", split, "--method", "ncc", "--out", out], splits, "D", results / "matching")
    told = pack(folder, results / "matching", inbox / "matching.zip")
    assert told.returncode == 0 and "3 of 6 cases; missing, behind all others: P/" in told.stdout, told.stdout + told.stderr
    checked = subprocess.run([microsig, "check", folder, inbox / "matching.zip"], capture_output=True, text=True)
    assert checked.returncode == 0 and "3 of 6 cases can be scored" in checked.stdout + checked.stderr, checked
    if python:
        about(public, results / "trackpy", "trackpy")
        program = EXAMPLES / "trackers/trackpy/track.py"
        tracked(lambda split, out: [python, program, split, "--out", out], splits, "P", results / "trackpy")
        told = pack(folder, results / "trackpy", inbox / "trackpy.zip")
        assert told.returncode == 0, told.stderr
    # One sends its results too late, one a part of a file, one the results of another suite.
    shutil.copy(inbox / "matching.zip", inbox / "late.zip")
    after = time.mktime((deadline + datetime.timedelta(days=3)).timetuple())
    os.utime(inbox / "late.zip", (after, after))
    (inbox / "broken.zip").write_bytes((inbox / "matching.zip").read_bytes()[:5000])
    rewritten(inbox / "matching.zip", inbox / "elsewhere.zip", lambda form: {**form, "suite": "odpc1 1.0.0, size smoke"})
    # One does not measure: it reports a regular grid of points, of which some are near every particle.
    about(public, results / "cheater", "cheater")
    for case in (case for case in splits if case.startswith("P/")):
        out = results / "cheater" / case / "results.csv"
        out.parent.mkdir(parents=True)
        rows = [f"{frame},-1,{x},{y}\n" for frame in range(3) for x in range(2, 200, 2) for y in range(2, 150, 2)]
        out.write_text("frame,track,x_px,y_px\n" + "".join(rows))
    assert pack(folder, results / "cheater", inbox / "cheater.zip").returncode == 0

    # The board, in one command.
    said = organizer.run("suite", "score", HERE / "suite.ron", release, "--results", inbox, "--results", release / "baselines",
                         "--out", "scores", "--site", public / "board", "--json", "--quiet")
    scores = json.loads(said)
    ranks = {(s["track"], s["tracker"]): s for s in scores["standings"]}
    reasons = {r["tracker"]: r["reason"] for c in scores["cases"] for r in c["results"] if r["status"] == "refused"}
    assert ranks["D", "matching"]["rank"] == ranks["D", "ncc"]["rank"] == 1, "the same program, once as a team and once as a baseline"
    honest = ["spots", *(["trackpy"] if python else [])]
    assert all(ranks["P", name]["scored"] == 3 for name in honest)
    # A program may find nothing where its parameters do not fit the noise; nobody who finds something is behind the grid.
    for case in (case for case in scores["cases"] if case["track"] == "P"):
        rank = {r["tracker"]: r["rank"] for r in case["results"] if r["status"] == "scored" and r["scores"][0]["value"] is not None}
        assert all(rank["cheater"] > rank[name] for name in honest if name in rank), case
    for name, expected in [("late", f"received after the deadline {deadline}"), ("broken", "not a complete ZIP archive"),
                           ("elsewhere", "the submission is for odpc1 1.0.0, size smoke")]:
        assert expected in reasons[name], (name, reasons)
    assert set(reasons) == {"late", "broken", "elsewhere", "spots"} and "scored in depth" in reasons["spots"], reasons
    assert (public / "board/index.html").is_file() and "matching" in (public / "board/index.html").read_text()

    # Nothing that is published tells the truth, until it is revealed.
    known = set().union(*(true_values(path) for path in release.glob("*/*/withheld")))
    assert len(known) > 1000
    for name, data in texts(public):
        assert b"secret_key" not in data or str(name).endswith((".md", ".html")), name
        text = data.decode("utf-8", "ignore")
        # Numbers of as many digits are rare, so that each is looked up.
        numbers = {word for word in text.replace(",", " ").replace('"', " ").split() if len(word) > 8}
        assert not numbers & known, name
    organizer.run("reveal", release, "--out", "truth", code=2)
    organizer.run("reveal", release, "--out", "truth", "--early")
    for case in splits:
        parts = [place / "truth" / case / "salt.bin", *(place / "truth" / case).glob("*-test-truth.zip")]
        found = hashlib.sha256(b"".join(part.read_bytes() for part in parts)).hexdigest()
        assert found in (public / case / "commitment.sha256").read_text(), case
    minutes = (time.perf_counter() - organizer.began) / 60
    print(f"{organizer.commands} commands of the organizer, {minutes:.1f} minutes with all teams; board: {public / 'board/index.html'}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("microsig", type=Path)
    parser.add_argument("python", type=Path, nargs="?")
    parser.add_argument("--keep", type=Path, help="folder for all files, which are otherwise removed")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        place = options.keep or Path(temporary)
        place.mkdir(parents=True, exist_ok=True)
        main(options.microsig.resolve(), options.python and options.python.absolute(), place.resolve())
