"""Scoring program for Codabench: scores a submission with `microsig evaluate`.

Codabench unpacks the reference data to INPUT/ref and the submission to INPUT/res, runs
`python3 scoring.py INPUT OUTPUT`, and reads OUTPUT/scores.json.
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

# Keys of the leaderboard, and their paths in score.json.
COLUMNS = json.loads((Path(__file__).resolve().parent / "columns.json").read_text())


def program():
    """The microsig command: $MICROSIG, an executable beside this file, an installed one, or the wheel beside this file."""
    here = Path(__file__).resolve().parent
    if os.environ.get("MICROSIG"):
        return [os.environ["MICROSIG"]]
    if (here / "microsig").is_file():
        # Archives do not always keep the permission to execute.
        own = Path("/tmp/microsig-scoring")
        shutil.copy(here / "microsig", own)
        own.chmod(0o755)
        return [str(own)]
    if shutil.which("microsig"):
        return ["microsig"]
    wheels = sorted(here.glob("*.whl"))
    if wheels:
        place = tempfile.mkdtemp()
        pip = [sys.executable, "-m", "pip", "install", "--quiet", "--target", place, str(wheels[-1])]
        subprocess.run(pip, check=True)
        # Scripts installed with --target do not find their modules.
        os.environ["PYTHONPATH"] = place
        return [sys.executable, "-m", "microsig"]
    sys.exit("microsig not found: build the bundle with --wheel, or use a container in which microsig is installed")


def folder_of(submission):
    """The folder with results.csv: the submission, or the only folder in it that has one."""
    if (submission / "results.csv").exists():
        return submission
    inner = [path for path in submission.iterdir() if (path / "results.csv").exists()]
    return inner[0] if len(inner) == 1 else submission


def main():
    given = sys.argv[1:] or ["/app/input", "/app/output"]
    source, out = Path(given[0]), Path(given[1])
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "scores"
        given = [str(source / "ref" / "test"), str(folder_of(source / "res"))]
        command = program() + ["evaluate", *given, "--out", str(folder), "--quiet"]
        run = subprocess.run(command, capture_output=True, text=True)
        if run.returncode != 0:
            # The platform shows this to the participant.
            sys.exit(run.stderr.strip())
        # Participants can download all output, so nothing in it may reveal single particles.
        shutil.copy(folder / "for_team" / "score.json", out / "score.json")
    # With all digits, two submissions that differ in one row would reveal its true position.
    score = json.loads((out / "score.json").read_text())

    def of(path):
        whole = score
        for key in path.split("."):
            whole = (whole or {}).get(key)
        return whole

    scores = {key: of(path) for key, path in COLUMNS.items() if of(path) is not None}
    (out / "scores.json").write_text(json.dumps(scores, indent=2) + "\n")
    print(json.dumps(scores))


if __name__ == "__main__":
    main()
