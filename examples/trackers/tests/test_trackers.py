"""Each tracker on a dataset of a few images: it finds particles, without a shift, a rotated axis or a wrong sign of z.

Run in the environment of a tracker: the tests of packages that are not installed are skipped, and all tests if there is no
program `microsig` (or the program given by the variable MICROSIG).
"""

import csv
import importlib.machinery
import json
import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parents[1]
SCENARIOS = HERE.parents[1] / "scenarios"
PROGRAM = os.environ.get("MICROSIG", "microsig")
sys.path.append(str(HERE))
from common import tuning  # noqa: E402

pytestmark = pytest.mark.skipif(shutil.which(PROGRAM) is None, reason=f"no program {PROGRAM}")

SETS = {
    "spots": ["isbi_like.ron", "timing.sequence.frames=4", "optics.gaussian.peak_counts=200"],
    "pairs": ["piv_gaussian.ron", "timing.pairs.count=1", "optics.pixel_dim_x=256", "optics.pixel_dim_y=192"],
    "spherical": ["quickstart.ron", "timing.pairs.count=1", "particles.number.count=12"],
    "astigmatic": ["quickstart_astigmatic.ron", "timing.pairs.count=1", "particles.number.count=12"],
}
# tracker, package, dataset, parameters, least F1 (fields: least share of valid vectors), largest bias in x
# and y (px), z (um)
CASES = [
    ("trackpy", "trackpy", "spots", "isbi_like", 0.9, 0.05, None),
    ("laptrack", "laptrack", "spots", "isbi_like", 0.9, 0.05, None),
    ("btrack", "btrack", "spots", "isbi_like", 0.9, 0.05, None),
    ("picasso", "picasso", "spots", "isbi_like", 0.9, 0.05, None),
    ("picasso", "picasso", "astigmatic", "quickstart_astigmatic_small", 0.3, 0.2, 2.5),
    ("picasso_spline", "picasso", "astigmatic", "quickstart_astigmatic_small", 0.6, 0.2, 1.5),
    ("magtrack", "magtrack", "spherical", "quickstart", 0.3, 0.2, 2.5),
    ("unet", "onnxruntime", "spherical", None, 0.6, 0.2, 2.5),
    ("openpiv", "openpiv", "pairs", None, 0.9, 0.05, None),
    ("fluidimage", "fluidimage", "pairs", None, 0.9, 0.1, None),
]


def installed(package):
    # The folders of the trackers are named like the packages; they must not be imported instead.
    paths = [p for p in sys.path if Path(p or ".").resolve() != HERE]
    found = importlib.machinery.PathFinder.find_spec(package, paths)
    return found is not None and found.origin is not None


@pytest.fixture(scope="session")
def datasets(tmp_path_factory):
    folder = tmp_path_factory.mktemp("datasets")
    made = {}

    def make(name):
        if name not in made:
            scenario, *values = SETS[name]
            sets = [word for value in values for word in ("--set", value)]
            subprocess.run([PROGRAM, "generate", SCENARIOS / scenario, *sets, "--out", folder / name, "--quiet"], check=True)
            made[name] = folder / name
        return made[name]

    return make


def run(tracker, dataset, out, *options):
    return subprocess.run([sys.executable, HERE / tracker / "track.py", dataset, "--out", out, *options],
                          capture_output=True, text=True)


def score(dataset, result):
    text = subprocess.run([PROGRAM, "evaluate", dataset, result, "--json", "--quiet"], check=True, capture_output=True, text=True)
    return json.loads(text.stdout)


@pytest.mark.parametrize(("tracker", "package", "name", "params", "least", "bias", "bias_z"), CASES,
                         ids=[f"{case[0]}-{case[2]}" for case in CASES])
def test_finds_particles_without_bias(tracker, package, name, params, least, bias, bias_z, datasets, tmp_path):
    if not installed(package):
        pytest.skip(f"{package} is not installed")
    options = ["--params", HERE / tracker / "params" / f"{params}.json"] if params else []
    # The truth is hidden: a tracker that reads it fails.
    blind = tmp_path / "blind"
    shutil.copytree(datasets(name), blind, ignore=shutil.ignore_patterns("truth", "particles", "scenario.ron"))
    out = tmp_path / "results.csv"
    done = run(tracker, blind, out, *options)
    assert done.returncode == 0, done.stderr
    scores = score(datasets(name), out)
    if name == "pairs":
        field = scores["field"]
        assert field["valid_vector_probability"] >= least
        assert abs(field["u_inliers"]["bias_px"]) < bias and abs(field["v_inliers"]["bias_px"]) < bias
        return
    detection = scores["detection"]
    assert detection["f1"] >= least
    assert abs(detection["bias_x_px"]) < bias and abs(detection["bias_y_px"]) < bias
    if bias_z is not None:
        assert abs(detection["bias_z_um"]) < bias_z


def particles(f1, rmse_xy_px=None, rmse_z_um=None, links=None):
    return {"detection": {"f1": f1, "rmse_xy_px": rmse_xy_px, "rmse_z_um": rmse_z_um}, "links": links and {"f1": links},
            "definitions": {"depth_range_h_um": 100.0}}


def field(valid, rms_px):
    return {"field": {"nodes": {"valid": valid, "rms_px": rms_px}}}


def test_to_find_nothing_is_never_better():
    nothing = particles(0.0)
    assert tuning.points_score(nothing) == tuning.tracks_score(nothing) == 0
    # The largest errors that the gates of 2 px and h / 10 allow, and larger ones.
    for poor in [particles(0.01, 2.0, 10.0), particles(0.001, 30.0, 200.0), particles(0.2, 1.9)]:
        assert tuning.points_score(poor) >= 0 and tuning.tracks_score(poor) >= 0
    assert tuning.points_score(particles(0.01, 2.0, 10.0)) > 0
    good = particles(0.9, 0.1, 1.0, links=0.8)
    assert tuning.points_score(good) == pytest.approx(0.9 * 0.98)
    assert tuning.tracks_score(good) == pytest.approx((0.9 * 0.98 + 0.8) / 2)
    assert tuning.points_score(particles(0.9, 0.5)) < tuning.points_score(particles(0.9, 0.1))


def test_few_vectors_are_worse_than_a_field():
    nothing, one, zeros, poor, good = (tuning.field_score(field(*of)) for of in [
        (None, None), (0.001, 0.9995), (0.33, 0.84), (0.5, 0.7), (0.99, 0.1)])
    assert nothing <= one < zeros < poor < good
    assert set(tuning.OBJECTIVES) == {tuning.points_score, tuning.tracks_score, tuning.field_score}


def test_a_search_goes_on_after_a_result_that_cannot_be_scored(datasets, tmp_path, monkeypatch):
    def track(dataset, params):
        return [(0, None, 10.0, 10.0, *([20.0] if params["depth"] else []))]

    place = datasets("spherical")
    monkeypatch.setattr(sys, "argv", ["tune.py", str(place), "--out", str(tmp_path / "p.json"), "--evaluate=--dims 3"])
    tuning.tune_main(track, {"depth": False}, {"depth": [True]})
    assert json.loads((tmp_path / "p.json").read_text()) == {"depth": True}
    with open(tmp_path / "tuning.csv", newline="") as file:
        scores = [float(row["score"]) for row in csv.DictReader(file)]
    assert scores[0] == float("-inf") and scores[1] >= 0.0


@pytest.mark.parametrize("tracker", sorted(path.parent.name for path in HERE.glob("*/tracker.toml")))
def test_folder_is_complete(tracker):
    folder = HERE / tracker
    about = tomllib.loads((folder / "tracker.toml").read_text())
    assert about["name"] == tracker
    assert about["tracks"] and set(about["tracks"]) <= {"P2", "D3", "A3", "T", "V", "S"}
    for key in ("title", "version", "made_for", "out_of_depth", "citation", "url", "license"):
        assert about[key].strip(), key
    lines = (folder / "requirements.txt").read_text().split()
    assert lines and all("==" in line for line in lines)
    for name in ("README.md", "track.py", "tune.py", "tuning.csv"):
        assert (folder / name).exists(), name
    with open(folder / "tuning.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    known = {*tuning.OBJECTIVES.values(), "points_difference", "tracks_difference", "field_vectors"}
    assert {row["objective"].split(" ")[0] for row in rows} <= known
    assert {row["split"] for row in rows} == {"train", "val"}
    params = {path.relative_to(folder / "params").with_suffix("").as_posix() for path in (folder / "params").rglob("*.json")}
    params = {name for name in params if not name.startswith("start/")}
    found = set()
    for dataset in {row["dataset"] for row in rows}:  # TRACK/CASE of a suite, or NAME_train and NAME_val
        of = {dataset, dataset.split("/")[0]} if "/" in dataset else {dataset.rsplit("_", 1)[0]}
        assert of & params, f"no parameters of {dataset}"
        found |= of
    assert params <= found, f"parameters without a search: {params - found}"


def test_errors_are_clear(datasets, tmp_path):
    tracker = next((case[0] for case in CASES if installed(case[1])), None)
    if tracker is None:
        pytest.skip("no package is installed")
    done = run(tracker, tmp_path, tmp_path / "results.csv")
    assert done.returncode == 2 and "no folder images" in done.stderr
    (tmp_path / "params.json").write_text('{"no_such": 1}')
    done = run(tracker, datasets("spots"), tmp_path / "results.csv", "--params", tmp_path / "params.json")
    assert done.returncode == 2 and "no_such" in done.stderr
