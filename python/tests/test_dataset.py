"""Datasets in memory and in folders."""

from __future__ import annotations

import copy
import json
import os
import pickle
import shutil
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import microsig as ms
import numpy as np
import pytest
from conftest import ROOT, SMALL, command


def files(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def test_what_is_saved_has_the_bytes_of_the_command_on_all_golden_scenarios(golden, tmp_path):
    for scenario in golden:
        by_command, by_package = tmp_path / f"{scenario.stem}-c", tmp_path / f"{scenario.stem}-p"
        ran = command("generate", scenario, "--out", by_command, "--quiet")
        assert ran.returncode == 0, ran.stderr
        dataset = ms.generate(scenario)
        assert dataset.save(by_package) == by_package
        expected, found = files(by_command), files(by_package)
        assert list(found) == list(expected)
        assert [name for name in expected if found[name] != expected[name]] == [], scenario.name


def test_arrays_are_what_is_in_the_files(golden, tmp_path):
    for scenario in golden:
        if scenario.stem not in ("pairs", "rods", "tracks"):
            continue
        made = ms.generate(scenario)
        read = ms.open(made.save(tmp_path / scenario.stem))
        assert made.images.dtype == np.uint16 and len(made) == len(read) == len(made.images)
        np.testing.assert_array_equal(made.images, read.images)
        np.testing.assert_array_equal(read.image(1), made.images[1])
        for name in ("frames", "tracks", "displacements", "depth", "field"):
            a, b = getattr(made, name), getattr(read, name)
            if a is None:
                assert b is None
                continue
            assert a.columns == b.columns and a.units == b.units and a.meanings == b.meanings
            for column in a:
                np.testing.assert_array_equal(a[column], b[column])
                assert a[column].dtype == b[column].dtype
        assert (made.calibration is None) == (read.calibration is None)
        if made.calibration is not None:
            np.testing.assert_array_equal(made.calibration.images, read.calibration.images)
            np.testing.assert_array_equal(made.calibration.z_um, read.calibration.z_um)
            # The diameters of these particles are distributed: one scan for each of three quantiles.
            assert (made.calibration.d_um is None) == (scenario.stem == "pairs")
            if made.calibration.d_um is not None:
                sizes = np.unique(made.calibration.d_um)
                assert len(sizes) == 3
                one = read.calibration.of_size(sizes[2] + 1)
                assert (one.d_um == sizes[2]).all() and len(one.images) == len(one.z_um) == len(one.table)
                assert (np.diff(one.z_um) > 0).all()
                np.testing.assert_array_equal(one.images, made.calibration.images[made.calibration.d_um == sizes[2]])
        assert made.scenario_text == read.scenario_text and made.settings == read.settings
        for of in (made, read):
            again = ms.generate(of.scenario)
            assert again.scenario_text == made.scenario_text
            np.testing.assert_array_equal(again.images, made.images)
        assert made.um_per_px == read.um_per_px and made.depth_range_um == read.depth_range_um
        assert made.dt_s == read.dt_s and made.bits == read.bits


def test_a_scenario_is_a_path_a_text_or_a_dict(tmp_path, monkeypatch):
    path = tmp_path / "small.ron"
    path.write_text(SMALL)
    of_path = ms.generate(path, seed=3, set={"optics.background_noise": 20})
    of_text = ms.generate(SMALL, seed=3, set={"optics.background_noise": np.float64(20)})
    resolved = ms.resolve(SMALL, seed=3, set={"optics.background_noise": 20.0})
    of_dict = ms.generate(resolved)
    of_json = ms.generate(json.dumps(resolved))
    for other in (of_text, of_dict, of_json):
        np.testing.assert_array_equal(other.images, of_path.images)
        assert other.scenario == of_path.scenario
    assert of_path.scenario["optics"]["background_noise"] == 20
    assert of_path.settings["background_noise"] == 20
    assert not np.array_equal(ms.generate(SMALL, seed=4).images, of_path.images)
    assert ms.resolve(of_path.scenario_text) == of_path.scenario
    (tmp_path / "(old)").mkdir()
    old = tmp_path / "(old)" / "gain=2.ron"
    old.write_text(SMALL)
    monkeypatch.chdir(tmp_path)
    assert ms.resolve("(old)/gain=2.ron") == ms.resolve(SMALL)


def test_images_are_not_copied_and_outlive_their_dataset():
    dataset = ms.generate(SMALL)
    images = dataset.images
    assert images.shape == (4, 64, 96) and images.flags.c_contiguous and not images.flags.owndata
    assert not images.flags.writeable
    with pytest.raises(ValueError):
        images[0, 0, 0] = 1
    with pytest.raises(ValueError):
        images.flags.writeable = True
    copy = images.copy()
    del dataset
    np.testing.assert_array_equal(images, copy)


def test_tables_have_columns_rows_and_another_origin():
    tracks = ms.generate(SMALL).tracks
    assert tracks["frame"].dtype == np.int64 and tracks["x_px"].dtype == np.float64
    assert tracks.units["z_um"] == "um" and "depth" in tracks.meanings["z_um"]
    first = tracks[tracks["frame"] == 0]
    assert 0 < len(first) < len(tracks) and set(first["frame"]) == {0}
    np.testing.assert_array_equal(tracks.origin(0)["x_px"], tracks["x_px"] - 1)
    np.testing.assert_array_equal(tracks.origin(0).origin(1)["y_px"], tracks["y_px"])
    np.testing.assert_array_equal(tracks.x_px, tracks["x_px"])
    places = ms.Table({"x_px": [3.0], "place_x_px": [40.0], "z_um": [1.0]}).origin(0)
    assert (places["x_px"][0], places["place_x_px"][0], places["z_um"][0]) == (2, 39, 1)
    assert "rows" in repr(tracks) and "<table>" in tracks._repr_html_()
    with pytest.raises(KeyError, match="it has"):
        tracks["x"]
    assert len(tracks[-1]) == 1 and tracks[-1]["x_px"] == tracks["x_px"][-1]
    for row in (len(tracks), -len(tracks) - 1):
        with pytest.raises(IndexError, match=f"no row {row}; it has {len(tracks)} rows"):
            tracks[row]
    with pytest.raises(ValueError, match="different lengths"):
        ms.Table({"a": [1], "b": [1, 2]})
    pandas = pytest.importorskip("pandas")
    frame = tracks.to_pandas()
    assert isinstance(frame, pandas.DataFrame) and list(frame.columns) == tracks.columns
    pytest.importorskip("polars")
    assert tracks.to_polars().columns == tracks.columns


@pytest.mark.parametrize("library", ["pandas", "polars"])
def test_data_frames_are_made_of_tables_by_their_own_constructors(library):
    frames = pytest.importorskip(library)
    tracks = ms.generate(SMALL).tracks
    for table in (tracks, tracks[tracks["x_px"] > 50], tracks[:0]):
        frame = frames.DataFrame(table)
        assert list(frame.columns) == table.columns and frame.shape == (len(table), len(table.columns))
        for column in table.columns:
            np.testing.assert_array_equal(frame[column].to_numpy(), table[column])
        assert frame.equals(getattr(table, f"to_{library}")())


def test_tables_are_dicts_that_cannot_be_changed():
    tracks = ms.generate(SMALL).tracks
    assert list(tracks.items())[0][0] == tracks.columns[0] and dict(tracks).keys() == tracks.keys()
    changes = [
        lambda: tracks.update(a=1),
        lambda: tracks.__setitem__("a", 1),
        lambda: tracks.pop("x_px"),
        lambda: tracks.clear(),
        lambda: tracks.setdefault("a", 1),
    ]
    columns = tracks.columns
    for change in changes:
        with pytest.raises(TypeError, match="tables are read-only"):
            change()
    again = pickle.loads(pickle.dumps(tracks.origin(0)))
    assert tracks.columns == columns == again.columns and again.units == tracks.units and again.first_pixel == 0
    np.testing.assert_array_equal(again["x_px"], tracks["x_px"] - 1)


@pytest.mark.parametrize(
    ("scenario", "kind", "says"),
    [
        (SMALL.replace("poiseuille", "poisseuille"), ValueError, "did you mean `poiseuille`"),
        (SMALL.replace("count: 2", "count: -2"), ValueError, "timing.pairs.count = -2"),
        ("(", ValueError, ""),
        ("{", ValueError, ""),
        ({}, ValueError, "missing"),
        ({"name": object()}, ValueError, "a value of a scenario"),
        ("no/such/file.ron", FileNotFoundError, "no/such/file.ron"),
        (3, TypeError, "a scenario is a path"),
        (SMALL.replace("count(5)", "count(2000000)"), ValueError, "2000000"),
        (SMALL.replace("pixel_dim_x: 96", "pixel_dim_x: 1000000000"), ValueError, ""),
    ],
)
def test_bad_scenarios_raise_with_the_message_of_the_command(scenario, kind, says, tmp_path):
    with pytest.raises(kind) as raised:
        ms.generate(scenario)
    assert says in str(raised.value)
    if isinstance(scenario, str) and kind is ValueError:
        path = tmp_path / "s.ron"
        path.write_text(scenario)
        with pytest.raises(ValueError) as of_path:
            ms.generate(path)
        ran = command("generate", path, "--out", tmp_path / "out")
        assert ran.returncode == 2
        told = [line.removeprefix("error: ") for line in ran.stderr.strip().splitlines()]
        assert str(of_path.value).splitlines()[0] in told[0]


def test_bad_arguments_raise(tmp_path):
    with pytest.raises(ValueError, match="seed"):
        ms.generate(SMALL, seed=-1)
    with pytest.raises(ValueError, match="optics.noise"):
        ms.generate(SMALL, set={"optics.noise": 1})
    with pytest.raises(OSError):
        ms.open(tmp_path / "nothing")
    (tmp_path / "empty").mkdir()
    with pytest.raises((OSError, ValueError)):
        ms.open(tmp_path / "empty")
    dataset = ms.generate(SMALL)
    dataset.save(tmp_path / "d")
    with pytest.raises(FileExistsError, match="force=True"):
        dataset.save(tmp_path / "d")
    dataset.save(tmp_path / "d", force=True)
    with pytest.raises(OSError):
        dataset.save("/proc/no/such/place")
    with pytest.raises(ValueError, match="threads"):
        ms.set_threads(2000)


def test_a_copy_of_a_dataset_in_a_folder_is_the_dataset(tmp_path):
    first = ms.generate(SMALL).save(tmp_path / "a")
    second = ms.open(first).save(tmp_path / "b")
    assert files(first) == files(second)
    assert command("verify", second).returncode == 0


def test_threads_change_nothing():
    before = ms.generate(SMALL).images.copy()
    ms.set_threads(1)
    np.testing.assert_array_equal(ms.generate(SMALL).images, before)
    ms.set_threads(0)


LONG = SMALL.replace("count: 2", "count: 100000").replace("count(5)", "count(40)")

# Places for so many particles are found in some ten seconds, all in the first step of the work.
DENSE = """(
    name: "dense",
    optics: (preset: setting1, gaussian: (diameter_px: 2)),
    motion: flow(field: poiseuille()),
    particles: (number: count(15600), seeding: apart_in_image(0.25)),
    timing: pairs(count: 2),
)"""


@pytest.mark.parametrize("what", ["generate", "place", "save", "track"])
def test_ctrl_c_ends_long_work_within_a_second_and_leaves_nothing(what, tmp_path):
    program = textwrap.dedent(
        f"""
        import sys, time, microsig as ms
        scenario = {DENSE!r} if {what!r} == "place" else {LONG!r}
        if {what!r} == "save":
            dataset = ms.generate(scenario, set={{"timing.pairs.count": 300}})
            print("ready", flush=True)
            work = lambda: dataset.save("out")
        elif {what!r} == "track":
            dataset = ms.generate(scenario, set={{"timing.pairs.count": 100}})
            print("ready", flush=True)
            work = lambda: ms.track(dataset, "mle")
        else:
            print("ready", flush=True)
            work = lambda: ms.generate(scenario)
        try:
            work()
            print("done", flush=True)
        except KeyboardInterrupt:
            print("interrupted", time.monotonic(), flush=True)
        print(ms.generate({SMALL!r}).images.shape, flush=True)
        """
    )
    place = dict(cwd=tmp_path, env={**os.environ, "TMPDIR": str(tmp_path)})
    process = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True, **place)
    assert process.stdout is not None and process.stdout.readline() == "ready\n"
    time.sleep({"save": 0.1, "track": 1.5}.get(what, 0.4))
    sent = time.monotonic()
    process.send_signal(signal.SIGINT)
    told = process.stdout.readline().split()
    assert told[0] == "interrupted"
    assert float(told[1]) - sent < 1.0
    assert process.stdout.readline() == "(4, 64, 96)\n", "it goes on"
    assert process.wait(timeout=60) == 0
    assert os.listdir(tmp_path) == []


def test_a_defect_raises_and_does_not_abort():
    # Every number of a scenario beyond what its key allows.
    for path in ("optics.magnification", "optics.n_rays", "particles.number.count", "boundaries.margin_px"):
        for value in (float("nan"), float("inf"), -1, 1e300, 2**70, "x", [1], {"a": 1}, None, True):
            try:
                ms.resolve(SMALL, set={path: value})
            except ValueError:
                pass


def test_the_command_is_installed():
    assert command("--version").stdout.startswith(f"microsig {ms.__version__}")
    assert command("nonsense").returncode == 2
    assert pickle.loads(pickle.dumps(ms.uniform(0, 1))) == ms.uniform(0, 1)


def test_unrounded_images_are_floats_everywhere(tmp_path):
    made = ms.generate(SMALL, set={"image_format": "float32", "optics.background_noise": 0})
    assert made.images.dtype == np.float32 and made.bits == 32
    assert np.any(made.images != np.round(made.images))
    whole = ms.generate(SMALL, set={"optics.background_noise": 0})
    assert whole.images.dtype == np.uint16
    np.testing.assert_array_equal(np.clip(np.rint(made.images), 0, 65535), whole.images)
    read = ms.open(made.save(tmp_path / "float"))
    assert read.images.dtype == np.float32
    np.testing.assert_array_equal(read.images, made.images)
    assert made.calibration is not None and read.calibration is not None
    assert made.calibration.images.dtype == read.calibration.images.dtype == np.float32
    np.testing.assert_array_equal(read.calibration.images, made.calibration.images)
    one = ms.render(whole.settings, [[40.0, 30.0, -30.0, 2.0]], mode="expected", image_format="float32")
    assert one.dtype == np.float32 and np.any(one != np.round(one))
    with pytest.raises(ValueError, match="image_format = float32"):
        ms.Stream(SMALL, 1, set={"image_format": "float32"})


def test_the_truth_is_read_only(tmp_path):
    made = ms.generate(SMALL)
    read = ms.open(made.save(tmp_path / "d"))
    for dataset in (made, read):
        assert dataset.calibration is not None
        tables = (dataset.tracks, dataset.frames, dataset.depth, dataset.calibration.table)
        arrays = [array for table in tables for array in table.to_dict().values()]
        images = [dataset.image(0), dataset.images, dataset.calibration.images]
        assert not any(array.flags.writeable for array in arrays + images)
        with pytest.raises(ValueError, match="read-only"):
            dataset.tracks["x_px"][0] = 1e9
        assert dataset.tracks[dataset.tracks["frame"] == 0]["x_px"].flags.writeable, "a copy"


def test_a_scenario_with_files_can_be_used_from_any_folder(tmp_path, monkeypatch):
    scenario = ROOT / "tests/data/golden/tracks.ron"
    monkeypatch.chdir(scenario.parent)
    made = ms.generate("tracks.ron")
    drawn = ms.Stream("tracks.ron", 1)
    sample = drawn[0]["image"][0]
    scenarios = [made.scenario, ms.resolve("tracks.ron"), drawn.scenario(0)]
    made.save(tmp_path / "d")
    monkeypatch.chdir(tmp_path)
    scenarios.append(ms.open("d").scenario)
    monkeypatch.chdir("/")
    assert scenarios[0]["motion"]["tracks"]["file"] == str(scenario.parent / "tracks.csv")
    assert scenarios[3]["motion"]["tracks"]["file"] == str(tmp_path / "d/inputs/tracks.csv")
    for of, image in zip(scenarios, (made.images[0], made.images[0], sample, made.images[0])):
        np.testing.assert_array_equal(ms.generate(of).images[0], image)
    assert "inputs/tracks.csv" in made.scenario_text


def test_the_manifest_has_the_formulas_of_its_fields_only(tmp_path):
    field = {"sum": [{"hill": {"moving": False}}, {"scaled": {"field": {"uniform": {}}, "by": {}}}]}
    ms.generate(SMALL, set={"motion.flow.field": field}).save(tmp_path / "d")
    manifest = json.loads((tmp_path / "d/datapackage.json").read_text())
    assert sorted(manifest["microsig"]["motion"]["formulas"]) == ["hill", "scaled", "sum", "uniform"]


def test_files_that_the_manifest_lists_have_to_be_there(tmp_path):
    made = ms.generate(SMALL, set={"truth.boxes": True})
    names = ("frames", "tracks", "displacements", "depth", "boxes", "field", "calibration")
    for name in names:
        read = ms.open(made.save(tmp_path / "d", force=True))
        assert getattr(ms.open(tmp_path / "d"), name) is not None
        shutil.rmtree(tmp_path / "d")
        with pytest.raises(FileNotFoundError, match=f"{name}.csv"):
            getattr(read, name)
    bare = ms.open(ms.generate(SMALL, set={"calibration": "none"}).save(tmp_path / "bare"))
    assert bare.calibration is None and bare.boxes is None


def test_broken_files_are_told_with_their_path(tmp_path):
    folder = ms.generate(SMALL).save(tmp_path / "d")
    (folder / "truth/frames.csv").write_text("x\n1\n")
    with pytest.raises(ValueError, match="truth/frames.csv: columns frame, .* are missing"):
        ms.open(folder).images
    for manifest in ("{}", '{"microsig": {}}', "[]", "x"):
        (folder / "datapackage.json").write_text(manifest)
        with pytest.raises(ValueError, match="datapackage.json"):
            ms.open(folder)


def test_shipped_scenarios_are_known_by_name(tmp_path, monkeypatch):
    small = {"timing.pairs.count": 1, "particles.number.count": 2}
    by_name, by_path = (ms.generate(s, set=small) for s in ("quickstart", ROOT / "scenarios/quickstart.ron"))
    np.testing.assert_array_equal(by_name.images, by_path.images)
    # One that refers to another shipped file, and a sweep of a shipped scenario.
    assert ms.resolve("recorded_tracks")["name"] == "recorded_tracks"
    values, _ = next(ms.sweep("noise_density_sweep"))
    assert values["case"] == "case_00000"
    with pytest.raises(ValueError, match="did you mean `quickstart`"):
        ms.generate("quikstart")
    # A file of this name comes first, and `-` is a file, too.
    monkeypatch.chdir(tmp_path)
    for name in ("quickstart", "-"):
        Path(name).write_text(SMALL)
        assert ms.resolve(name)["name"] == ms.resolve(SMALL)["name"]
    ms.export(ms.generate(SMALL), "-", format="trackpy", force=True)
    assert Path("-").read_text().startswith("y,x,")


def test_datasets_in_memory_are_not_pickled():
    dataset = ms.generate(SMALL)
    for copied in (copy.deepcopy, pickle.dumps):
        with pytest.raises(TypeError, match="save"):
            copied(dataset)


def test_a_recording_is_imported_like_a_dataset(tmp_path):
    made = ms.generate(
        '(name: "r", optics: (preset: setting1), motion: flow(field: poiseuille()), timing: sequence(frames: 3, dt_s: 0.01),'
        ' particles: (number: count(10)), calibration: every_um(5))',
        seed=3,
    )
    folder = tmp_path / "made"
    made.save(folder)
    with pytest.raises(ValueError, match="expected .* px, as the scan"):
        ms.import_recording(folder / "images", scan=folder / "calibration/images", out=tmp_path / "out", z_step_um=5, magnification=10, pixel_size_um=6.5)
    with pytest.raises(ValueError, match="both or neither"):
        ms.import_recording(folder / "images", scan=folder / "images", out=tmp_path / "out", magnification=10)
    with pytest.warns(UserWarning, match="one particle"):
        recording = ms.import_recording(
            folder / "calibration/images", scan=folder / "calibration/images", out=tmp_path / "out", z_step_um=5, magnification=10, pixel_size_um=6.5
        )
    assert len(recording.images) == len(made.calibration.z_um)
    assert recording.calibration.images.dtype == np.float32
    assert recording.name == "out" and "Dataset out in" in repr(recording)
