"""Images of particles, fields, trackers, scores, sweeps."""

from __future__ import annotations

import json
import pickle

import microsig as ms
import numpy as np
import pytest
from conftest import ROOT, SMALL, command


def test_particles_are_rendered_as_the_command_does(tmp_path):
    dataset = ms.generate(SMALL, set={"particles.diameter_um": {"uniform": {"min": 1, "max": 3}}})
    folder = dataset.save(tmp_path / "d")
    rows = np.loadtxt(folder / "particles/pair_00001_a.txt", ndmin=2)
    image = ms.render(folder / "settings.txt", rows, seed=0, frame=2, round_once=True)
    np.testing.assert_array_equal(image, dataset.images[2])
    np.testing.assert_array_equal(ms.render(dataset.settings, rows, frame=2, round_once=True), image)
    seen = dataset.tracks[(dataset.tracks["frame"] == 2) & (dataset.tracks["rendered"] == 1)]
    np.testing.assert_array_equal(ms.render(dataset.settings, seen, frame=2, round_once=True), image)
    np.testing.assert_array_equal(ms.render(dataset.settings, seen.origin(0), frame=2, round_once=True), image)
    settings, data = folder / "settings.txt", folder / "particles/pair_00001_a.txt"
    ran = command("render", settings, data, tmp_path / "r", "--seed", "3", "--first-frame", "2")
    assert ran.returncode == 0, ran.stderr
    image = ms.render(settings, rows, seed=3, frame=2)
    written = pytest.importorskip("matplotlib.image").pil_to_array(
        pytest.importorskip("PIL.Image").open(tmp_path / "r/pair_00001_a.tif")
    )
    np.testing.assert_array_equal(image, written)
    expected = ms.render(dataset.settings, rows, "expected")
    assert expected.shape == image.shape and not np.array_equal(expected, image)
    quiet = dict(dataset.settings, background_noise=0.0)
    np.testing.assert_array_equal(ms.render(quiet, rows, "expected", 1), ms.render(quiet, rows, "expected", 2))
    assert ms.render(quiet, np.zeros((0, 4))).max() == quiet["background_mean"]


def test_scores_follow_the_rules_of_the_dataset_as_the_command_does(tmp_path):
    rules = {"gate_xy_px": 0.5, "dims": 2, "rank_by": ["rmse_xy_px", "f1"]}
    dataset = ms.generate(SMALL, set={"scoring": rules})
    folder = dataset.save(tmp_path / "d")
    found = {name: np.array(dataset.tracks[name]) for name in ("frame", "track", "x_px", "y_px", "z_um")}
    found["x_px"] = found["x_px"] + 0.7 * (np.arange(len(found["frame"])) % 2)
    table = np.column_stack([found[name] for name in found])
    np.savetxt(tmp_path / "r.csv", table, delimiter=",", header=",".join(found), comments="", fmt="%.17g")
    ran = command("evaluate", folder, tmp_path / "r.csv", "--json", "--quiet")
    of_command = json.loads(ran.stdout)
    for place in (dataset, folder):
        score = ms.evaluate(place, found)
        assert score["detection"] == of_command["detection"]
        assert (score["definitions"]["gate"]["xy_px"], score["definitions"]["dims"]) == (0.5, 2)
        assert score["definitions"]["rank_by"] == rules["rank_by"]
    assert ms.evaluate(dataset, found, gate_xy_px=2)["detection"]["f1"] > of_command["detection"]["f1"]


@pytest.mark.parametrize(
    ("particles", "says"),
    [
        ([[1.0, 2.0, 3.0]], "expected (n, 4)"),
        ([1.0, 2.0], "expected (n, 4)"),
        ([[1, 2, 3, -1]], "d_p = -1"),
        ([[1, 2, np.nan, 1]], "expected a finite number"),
        ([[1, 2, -1e6, 1]], "particle 1"),
        ({"x_px": [1]}, "missing"),
    ],
)
def test_bad_particles_raise(particles, says):
    settings = ms.generate(SMALL).settings
    with pytest.raises(ValueError) as raised:
        ms.render(settings, particles)
    assert says in str(raised.value)


def test_bad_settings_raise(tmp_path):
    with pytest.raises(ValueError, match="magnification"):
        ms.render(dict(ms.generate(SMALL).settings, magnification=-1), np.zeros((0, 4)))
    with pytest.raises(OSError):
        ms.render(tmp_path / "none.txt", np.zeros((0, 4)))
    with pytest.raises(ValueError, match="mode"):
        ms.render({}, np.zeros((0, 4)), "wave")  # type: ignore[arg-type]


def test_fields_answer_for_many_points():
    field = ms.field("poiseuille", max_speed_um_s=1290)
    points = np.array([[0.0, 0.0, z] for z in (-80.0, -30.0, 20.0)])
    np.testing.assert_allclose(field.velocity(points), [[0, 0, 0], [1290, 0, 0], [0, 0, 0]], atol=1e-9)
    moved = field.displacement(points, 0.0, 0.1)
    np.testing.assert_allclose(moved, [[0, 0, 0], [129, 0, 0], [0, 0, 0]], atol=1e-9)
    gradient = field.gradient(points)
    assert gradient.shape == (3, 3, 3) and gradient[0, 0, 2] == pytest.approx(4 * 1290 / 100)
    assert field.is_steady and field.name == "poiseuille" and field.parameters["max_speed_um_s"] == 1290
    both = ms.field({"sum": [{"hill": {}}, {"poiseuille": {}}]})
    total = ms.field("hill").velocity(points) + ms.field("poiseuille").velocity(points)
    np.testing.assert_allclose(both.velocity(points), total)
    assert field.velocity(np.zeros((0, 3))).shape == (0, 3)
    with pytest.raises(ValueError, match="did you mean"):
        ms.field("poisseuille")
    with pytest.raises(ValueError, match="max_speed_um_s"):
        ms.field("poiseuille", max_sped_um_s=1)
    with pytest.raises(ValueError, match="expected \\(n, 3\\)"):
        field.velocity([1.0, 2.0, 3.0])
    offers = ms.fields()
    assert len(offers) > 20 and all(offer.formula and offer.source for offer in offers.values())


def test_every_field_on_offer_can_be_made():
    for name in ms.fields():
        try:
            field = ms.field(name)
        except ValueError:
            continue
        assert field.velocity([[1.0, 2.0, -30.0]]).shape == (1, 3)


def test_scores_are_those_of_the_command(tmp_path):
    dataset = ms.generate(SMALL, set={"timing.pairs.count": 10, "particles.number.count": 12})
    folder = dataset.save(tmp_path / "d")
    for method in ("truth-noise", "ncc", "piv"):
        out = tmp_path / f"{method}.csv"
        ran = command("track", folder, "--method", method, "--out", out)
        assert ran.returncode == 0, ran.stderr
        assert command("evaluate", folder, out, "--out", tmp_path / method).returncode == 0
        expected = json.loads((tmp_path / method / "score.json").read_text())
        by_file = ms.evaluate(folder, out)
        assert by_file.json == (tmp_path / method / "score.json").read_text()
        tracked = ms.track(dataset, method)
        for result in (tracked, tracked.origin(0), tracked.to_dict()):
            found = ms.evaluate(dataset, result).to_dict()
            for scores in (found, expected):
                scores.pop("result"), scores.pop("assumptions", None)
            assert found == expected
            expected["result"] = expected["assumptions"] = None


def test_a_tracker_warns_of_images_that_are_not_its_own():
    with pytest.warns(UserWarning, match="this method detects a defocused image as several spots"):
        ms.track(ms.generate(SMALL), "spots")


def test_the_truth_scores_perfectly_and_reads_well():
    dataset = ms.generate(SMALL)
    scores = ms.evaluate(dataset, dataset.tracks)
    assert scores.detection.f1 == 1.0 and scores["links"]["f1"] == 1.0
    assert "F1" in repr(scores) or "f1" in repr(scores).lower()
    assert "detection" in dir(scores) and "f1" in dir(scores.detection)
    curve = scores.curve("z_um")
    assert len(curve) == 20 and np.nanmin(curve["recall"]) == 1.0
    with pytest.raises(AttributeError, match="no score"):
        scores.detections
    with pytest.raises(ValueError, match="against"):
        scores.curve("time")
    pandas = pytest.importorskip("pandas")
    table = scores.to_pandas().set_index("score")["value"]
    assert table["detection.f1"] == 1.0
    assert ms.evaluate(dataset, dataset.tracks.to_pandas()).detection.f1 == 1.0
    trackpy = pandas.DataFrame(
        {"frame": dataset.tracks.frame, "x": dataset.tracks.x_px - 1, "y": dataset.tracks.y_px - 1}
    )
    trackpy["particle"] = dataset.tracks.track
    assert ms.evaluate(dataset, trackpy, dims=2).detection.recall == 1.0


@pytest.mark.parametrize(
    ("result", "options", "kind", "says"),
    [
        ({"frame": [0], "x_px": [1.0]}, {}, ValueError, "fits no format"),
        ({"frame": [0], "x_px": [1.0], "y_px": [1.0, 2.0]}, {}, ValueError, "different lengths"),
        ({"frame": [0], "x_px": ["a"], "y_px": [1.0]}, {}, ValueError, "result:2"),
        ({"frame": [-5], "x_px": [1.0], "y_px": [1.0]}, {}, ValueError, "frame"),
        ({"frame": [0], "x_px": [1.0], "y_px": [1.0]}, {"gate": "round"}, ValueError, "ellipsoid"),
        ({"frame": [0], "x_px": [1.0], "y_px": [1.0]}, {"border_px": -1}, ValueError, "border_px"),
        (3, {}, TypeError, "a result is"),
        ("no/such.csv", {}, OSError, "no/such.csv"),
    ],
)
def test_bad_results_raise(result, options, kind, says):
    with pytest.raises(kind) as raised:
        ms.evaluate(ms.generate(SMALL), result, **options)
    assert says in str(raised.value)


def test_columns_are_read_as_their_arrays_mean_them():
    dataset = ms.generate(SMALL)
    seen = dataset.tracks[dataset.tracks["visible"] == 1]
    good = {c: seen[c] for c in ("frame", "track", "x_px", "y_px", "z_um")}
    expected = ms.evaluate(dataset, good)
    assert expected.detection.f1 == 1 and expected.definitions.dims == 3
    swapped = {c: a.astype(a.dtype.newbyteorder(">")) for c, a in good.items()}
    assert ms.evaluate(dataset, swapped).json == expected.json
    # Masked rows are missing, whatever stands in them, and masked tracks are not linked.
    mask = np.arange(len(seen)) % 2 == 0
    masked = dict(good, x_px=np.ma.masked_array(np.where(mask, 1e5, seen["x_px"]), mask))
    for table in (masked, ms.Table(masked)):
        scores = ms.evaluate(dataset, table)
        assert (scores.detection.tp, scores.detection.fp, scores.counts.n_nan) == ((~mask).sum(), 0, mask.sum())
    unlinked = ms.evaluate(dataset, dict(good, track=np.ma.masked_array(seen["track"], mask)))
    assert (unlinked.detection.f1, unlinked.counts.n_unlinked) == (1, mask.sum())
    for values in (np.ma.masked_array(seen["x_px"], mask), seen["x_px"] + 1j):
        with pytest.raises((ValueError, TypeError), match="x_px.*(masked|complex)"):
            ms.render(dataset.settings, {**seen, "x_px": values})
    with pytest.raises(ValueError, match="x_px of type complex128"):
        ms.evaluate(dataset, dict(good, x_px=seen["x_px"] + 1j))
    flat = ms.evaluate(dataset, dict(good, z_um=0 * seen["z_um"]))
    assert (flat.detection.f1, flat.definitions.dims) == (1, 2) and "z is 0 in every row" in repr(flat)


def test_the_index_of_a_data_frame_is_a_column_if_it_has_a_name():
    pandas = pytest.importorskip("pandas")
    dataset = ms.generate(SMALL)
    seen = dataset.tracks[dataset.tracks["visible"] == 1]
    frame = pandas.DataFrame(
        {"y": seen.y_px - 1, "x": seen.x_px - 1, "z": seen.z_um, "frame": seen.frame, "particle": seen.track}
    )
    for table in (frame.set_index("frame", drop=False), frame.set_index("frame"), frame.convert_dtypes()):
        assert ms.evaluate(dataset, table).detection.f1 == 1
    missing = frame.assign(particle=pandas.array([None, *seen.track[1:]], dtype="Int64"))
    assert ms.evaluate(dataset, missing).counts.n_unlinked == 1
    later = frame.set_index(frame["frame"] + 1)
    for table in (later, pandas.concat([frame, frame[["x"]] + 1], axis=1)):
        with pytest.raises(ValueError, match="appears twice, with different values"):
            ms.evaluate(dataset, table)


def test_hints_name_the_argument_that_does_what_they_promise():
    dataset = ms.generate(SMALL)
    seen = dataset.tracks[dataset.tracks["visible"] == 1]
    table = {c: seen[c] for c in ("frame", "track", "z_um")}
    scale = dataset.um_per_px
    um = dict(table, x_px=(seen.x_px - 0.5) * scale, y_px=(seen.y_px - 0.5) * scale)
    scores = ms.evaluate(dataset, um)
    assert scores.hints[0]["what"].endswith('; unit="um", origin="corner0"')
    assert '"corner0"' in repr(scores) and "--origin" not in repr(scores)
    assert scores.hints[0]["option"] == "--unit um --origin corner0" and "; --unit um --origin corner0" in scores.json
    assert ms.evaluate(dataset, um, unit="um", origin="corner0").detection.f1 == scores.hints[0]["f1"] == 1


def test_scores_are_compared():
    dataset = ms.generate(SMALL)
    good = ms.evaluate(dataset, dataset.tracks)
    none = ms.evaluate(dataset, {"frame": [], "track": [], "x_px": [], "y_px": [], "z_um": []})
    board = ms.compare({"none": none, "good": good})
    assert [entry["name"] for entry in board.entries] == ["good", "none"]
    assert "good" in repr(board)
    pickled = {name: pickle.loads(pickle.dumps(scores)) for name, scores in (("none", none), ("good", good))}
    assert repr(ms.compare(pickled)) == repr(board) and pickled["good"].json == good.json
    with pytest.raises(ValueError, match="method"):
        ms.track(dataset, "nnc")
    assert "ncc" in ms.methods()


def test_a_sweep_gives_the_datasets_of_the_command(tmp_path):
    base = tmp_path / "base.ron"
    base.write_text(SMALL)
    plan = tmp_path / "sweep.ron"
    plan.write_text(
        '(name: "s", base: "base.ron", axes: [(path: "optics.background_noise", values: list([0, 2_0]))], repetitions: 2)'
    )
    ran = command("sweep", plan, "--out", tmp_path / "out")
    assert ran.returncode == 0, ran.stderr
    cases = 0
    for values, dataset in ms.sweep(plan):
        read = ms.open(tmp_path / "out" / values["case"])
        np.testing.assert_array_equal(dataset.images, read.images)
        assert dataset.scenario == read.scenario
        assert dataset.settings["background_noise"] == values["optics.background_noise"]
        cases += 1
    assert cases == 4
    for written, value in (("None", None), ("2_0", 20)):
        plan.write_text(f'(name: "s", base: "base.ron", axes: [(path: "optics.background_noise", values: list([{written}]))])')
        values, _ = next(ms.sweep(plan))
        assert values["optics.background_noise"] == value
    with pytest.raises(ValueError, match="is a scenario"):
        ms.sweep(base)


def test_the_shipped_scenarios_are_good():
    shipped = sorted((ROOT / "scenarios").glob("*.ron"))
    assert len(shipped) > 20
    for path in shipped:
        if path.stem.endswith("_sweep") or "axes" in path.read_text():
            continue
        assert ms.resolve(path)["name"]


def test_columns_are_told_without_the_file_that_they_are_written_to():
    dataset = ms.generate(SMALL)
    with pytest.raises(ValueError, match="no columns"):
        ms.evaluate(dataset, {})
    with pytest.raises(ValueError) as told:
        ms.evaluate(dataset, {"frame": ["x"], "track": [1], "x_px": [1.0], "y_px": [1.0]})
    assert "tmp" not in str(told.value) and "result" in str(told.value)
    with pytest.raises(TypeError, match="method = 3: expected one of"):
        ms.track(dataset, 3)
