"""Fits, previews of optics, exports, challenges, checks and suites."""

from __future__ import annotations

import datetime
import json
import warnings
import zipfile
from pathlib import Path

import microsig as ms
import numpy as np
import pytest
from conftest import ROOT, SMALL, command


@pytest.fixture(scope="module")
def dataset(tmp_path_factory) -> Path:
    """A dataset with a calibration scan of 21 steps."""
    text = SMALL.replace("timing: pairs(count: 2),", "timing: sequence(frames: 3, dt_s: 0.002), calibration: every_um(5),")
    return ms.generate(text, seed=3).save(tmp_path_factory.mktemp("verbs") / "small")


def test_verify_tells_what_the_command_tells(dataset, tmp_path):
    told = ms.verify(dataset)
    assert told == json.loads(command("verify", dataset, "--json").stdout) and told["files"] > 20
    assert ms.verify(ms.open(dataset), regenerate=True)["regenerated"]
    copy = ms.open(dataset).save(tmp_path / "copy")
    (copy / "truth/tracks.csv").write_text("damaged")
    with pytest.raises(ValueError, match="tracks.csv"):
        ms.verify(copy)
    with pytest.raises(ValueError, match="data--regenerate: no such file or folder"):
        ms.verify(tmp_path / "data--regenerate")


def test_optics_are_those_of_the_command(tmp_path):
    file = tmp_path / "small.ron"
    file.write_text(SMALL)
    found = ms.optics(file)
    assert found.to_dict() == json.loads(command("optics", file, "--json", "--quiet").stdout)
    curves = found.curves(d_um=found.sizes_um[0])
    assert curves["z_um"].min() == -80 and curves["peak_counts"].max() > 0 and len(curves) > 10
    assert "<svg" in found.svg and found["depth_of_field_um"] > 0 and repr(found)
    with pytest.raises(ValueError, match="magnification"):
        ms.optics(SMALL, set={"optics.magnification": -1})


def fitted(scan, **more):
    with warnings.catch_warnings():
        # A channel of few rays is not described perfectly; and where the z step is from.
        warnings.simplefilter("ignore")
        return ms.fit(
            scan, magnification=10, pixel_size_um=6.5, diameter_um=2, z_direction="away", astigmatic="no", **more
        )


def test_fit_takes_files_calibrations_and_arrays(dataset, tmp_path):
    ds = ms.open(dataset)
    scan = ds.calibration
    ran = command(
        "fit", dataset / "calibration/images", "--z", dataset / "calibration/calibration.csv", "--magnification", 10,
        "--pixel-size", 6.5, "--diameter", 2, "--z-direction", "away", "--astigmatic", "no", "--out", tmp_path / "c", "--json",
    )  # fmt: skip
    expected = {p["name"]: p["value"] for p in json.loads(ran.stdout)["parameters"]}
    of_scan = fitted(scan)
    of_array = fitted(np.asarray(scan.images), z=scan.z_um, out=tmp_path / "p")
    assert of_array.path == tmp_path / "p" and (tmp_path / "p/report.html").exists()
    scan.save(tmp_path / "scan.tif", ds.um_per_px)
    of_file = fitted(tmp_path / "scan.tif")
    for made in (of_scan, of_array):
        assert {n: made[n] for n in expected} == expected
    # The images of a dataset's calibration state their step, those of its frames do not.
    of_folder = fitted(dataset / "calibration/images")
    for name, value in expected.items():
        assert (of_file[name], of_folder[name]) == pytest.approx((value, value), rel=1e-3), name
    assert of_scan.parameters["free"].sum() >= 2 and "low_95" in of_scan.parameters
    # The twin can be generated, and is the same in memory and in the folder.
    assert ms.resolve(of_scan.scenario)["optics"]["numerical_aperture"] == pytest.approx(of_scan["numerical_aperture"], rel=1e-4)
    assert of_array.scenario == (tmp_path / "p/scenario.ron").read_text()
    assert of_scan.path is None and of_scan.save(tmp_path / "s") == of_scan.path
    assert (tmp_path / "s/scenario.ron").read_bytes() == (tmp_path / "c/scenario.ron").read_bytes()
    with pytest.raises(KeyError, match="numerical_aperture"):
        of_scan["aperture"]
    with pytest.raises(ValueError, match="z_step_um"):
        fitted(dataset / "images")
    with pytest.raises(ValueError, match="stage positions are unknown; give z or z_step_um"):
        fitted(scan.images)
    with pytest.raises(ValueError, match="magnification = -1: expected 0.01 to 1000"):
        ms.fit(scan, magnification=-1, pixel_size_um=6.5)
    with pytest.raises(FileExistsError):
        fitted(scan, out=tmp_path / "p")
    pixels = np.asarray(scan.images)
    middle = [[0.5 * (n + 1) for n in pixels.shape[:0:-1]]]
    assert fitted(scan, particles=middle * 3)["numerical_aperture"] == of_scan["numerical_aperture"]
    for more, says in (
        ({"particles": [[np.nan, 9]]}, "particles: \\(NaN, 9\\): expected a position in px on the image"),
        ({"particles": [[1e6, 9]]}, "expected a position in px on the image"),
        ({"particles": np.zeros((0, 2))}, "particles: no rows"),
        ({"z": [[0.0]]}, "z of shape"),
        ({"z": [0.0, 1.0]}, "z: 2 positions; expected a finite one for each"),
        ({"z_step_um": np.nan, "z": None}, "z_step_um = NaN"),
    ):
        with pytest.raises(ValueError, match=says):
            fitted(pixels, **({"z": scan.z_um} | more))
    with pytest.raises(ValueError, match="expected planes"):
        fitted(np.zeros((9, 0, 0), np.uint16), z_step_um=1)
    with pytest.raises(TypeError, match="planes = \\(0, 5, 8\\): expected the first"):
        fitted(scan, planes=(0, 5, 8))


def test_arrays_cross_in_memory(dataset, tmp_path, monkeypatch):
    text = ms.open(dataset).scenario_text
    made = ms.generate(text)
    formats = ("trackpy", "imagej-stack", "coco", "flo")
    with_truth = ms.generate(text, set={"truth.boxes": True})
    saved = with_truth.save(tmp_path / "saved")
    # Nowhere to write a temporary file.
    monkeypatch.setenv("TMPDIR", str(tmp_path / "missing"))
    monkeypatch.chdir(tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for method in ("ncc", "mle", "aptv", "piv", "truth-noise"):
            of_memory, of_folder = (ms.track(ds, method).to_dict() for ds in (made, ms.open(dataset)))
            assert of_memory.keys() == of_folder.keys() and of_memory
            for name, values in of_memory.items():
                np.testing.assert_array_equal(values, of_folder[name], err_msg=f"{method}: {name}")
        ms.evaluate(made, ms.track(made, "ncc"))
    assert fitted(np.asarray(made.calibration.images), z=made.calibration.z_um).settings_text
    assert sorted(path.name for path in tmp_path.iterdir()) == ["saved"]
    for format in formats:
        ms.export(with_truth, tmp_path / "of-memory", format=format, force=True)
        ms.export(saved, tmp_path / "of-folder", format=format, force=True)
        assert (tmp_path / "of-memory").read_bytes() == (tmp_path / "of-folder").read_bytes(), format
    for verb in (ms.verify, lambda ds: ms.release(ds, tmp_path / "out")):
        with pytest.raises(ValueError, match="expected one in a folder; save"):
            verb(made)


def test_exports_are_those_of_the_command(dataset, tmp_path):
    for format in ("trackpy", "imagej-stack"):
        by_package = ms.export(dataset, tmp_path / f"p-{format}", format=format)
        command("export", dataset, "--format", format, "--out", tmp_path / f"c-{format}")
        assert by_package.read_bytes() == (tmp_path / f"c-{format}").read_bytes()
    with pytest.raises(FileExistsError):
        ms.export(dataset, tmp_path / "p-trackpy", format="trackpy")
    with pytest.raises(ValueError, match="trackpy, trackmate|isbi"):
        ms.export(dataset, tmp_path / "x", format="excel")
    with pytest.raises(ValueError, match="no stack"):
        ms.export(dataset, tmp_path / "x", format="ome-tiff", images="calibration", stack="d_9um")


def test_stacks_are_read_by_tifffile_with_their_scale(dataset, tmp_path):
    tifffile = pytest.importorskip("tifffile")
    ds = ms.open(dataset)
    scan = ds.calibration
    ms.export(ds, tmp_path / "frames.tif", format="imagej-stack")
    ms.export(ds, tmp_path / "scan.tif", format="imagej-stack", images="calibration")
    with tifffile.TiffFile(tmp_path / "frames.tif") as file:
        assert file.is_imagej and file.series[0].axes == "TYX"
        np.testing.assert_array_equal(file.asarray(), ds.images)
        assert file.imagej_metadata["finterval"] == 0.002
        pixels, per = file.pages[0].tags["XResolution"].value
        assert per / pixels == pytest.approx(ds.um_per_px, rel=1e-8)
    with tifffile.TiffFile(tmp_path / "scan.tif") as file:
        assert file.series[0].axes == "ZYX" and file.imagej_metadata["spacing"] == 5
        assert (0 - file.imagej_metadata["zorigin"]) * 5 == scan.z_um[0]
        np.testing.assert_array_equal(file.asarray(), scan.images)


def test_ome_xml_is_valid_and_holds_the_scale(dataset, tmp_path):
    tifffile = pytest.importorskip("tifffile")
    ome_types = pytest.importorskip("ome_types")
    ds = ms.open(dataset)
    for images, array in (("frames", ds.images), ("calibration", ds.calibration.images)):
        path = ms.export(ds, tmp_path / f"{images}.ome.tif", format="ome-tiff", images=images)
        with tifffile.TiffFile(path) as file:
            assert file.is_ome and file.series[0].axes == ("TYX" if images == "frames" else "ZYX")
            np.testing.assert_array_equal(file.asarray(), array)
            text = file.ome_metadata
        # Against the schema 2016-06 of the Open Microscopy Environment.
        ome_types.validate_xml(text)
        pixels = ome_types.from_xml(text).images[0].pixels
        assert (pixels.physical_size_x, pixels.physical_size_x_unit.value) == (ds.um_per_px, "µm")
        assert pixels.significant_bits == ds.bits
        if images == "frames":
            assert pixels.time_increment == 0.002 and pixels.time_increment_unit.value == "s"
            assert [plane.delta_t for plane in pixels.planes] == list(ds.frames["t_s"])
        else:
            assert (pixels.physical_size_z, pixels.physical_size_z_unit.value) == (5, "µm")
            assert [plane.position_z for plane in pixels.planes] == list(ds.calibration.z_um)
            assert {plane.position_z_unit.value for plane in pixels.planes} == {"µm"}


def test_release_makes_a_challenge(dataset, tmp_path):
    options = {"val": 2, "test": 2, "creators": ["Doe, Jane"]}
    told = ms.release(dataset, tmp_path / "out", **options)
    assert told["images"] == [3, 2, 2] and (tmp_path / "out/public/commitment.sha256").exists()
    assert "Doe" in (tmp_path / "out/public/CITATION.cff").read_text()
    with zipfile.ZipFile(next((tmp_path / "out/public").glob("*-test.zip"))) as archive:
        archive.extractall(tmp_path / "test")
    test = ms.open(next((tmp_path / "test").iterdir()))
    assert len(test) == len(test.images) == 2 and len(test.frames) == 2
    with pytest.raises(ValueError, match="(?s)were not provided:.*codabench") as told:
        ms.release(dataset, tmp_path / "new", wheel="x.whl")
    assert "--" not in str(told.value).split("provided:")[1]
    again = ms.release(dataset, tmp_path / "out", **options, resume=True)
    assert again["out"] == str(tmp_path / "out")
    with pytest.raises(FileExistsError):
        ms.release(dataset, tmp_path / "out")

    open_until = datetime.date(9999, 12, 31)
    until = ms.release(dataset, tmp_path / "next", val=2, test=2, deadline=open_until)
    assert until["deadline"] == "9999-12-31"
    with pytest.raises(ValueError, match="its deadline is 9999-12-31 .*; early=True publishes"):
        ms.reveal(tmp_path / "next", tmp_path / "truth")
    assert ms.reveal(tmp_path / "next", tmp_path / "truth", early=True)["commitment"] == until["commitment"]


def test_suites_are_listed_generated_checked_scored(tmp_path):
    listed = ms.suite.list("odpc1", size="smoke")
    assert listed == json.loads(command("suite", "list", "odpc1", "--size", "smoke", "--json").stdout)
    track = listed["tracks"][0]
    name, case = track["track"], track["cases"][0]["case"]
    told = []
    made = ms.suite.generate(
        "odpc1", tmp_path / "smoke", size="smoke", track=name, case=case, progress=lambda *now: told.append(now)
    )
    assert made["failed"] == 0 and made["made"] == 3 and told[-1][1:] == (3, 3)
    checked = ms.suite.check("odpc1", tmp_path / "smoke", size="smoke", track=name, case=case)
    assert checked["differences"] == []
    result = tmp_path / "results/truth" / name / case
    result.mkdir(parents=True)
    test = tmp_path / "smoke" / name / case / "test"
    (result / "results.csv").write_bytes((test / "truth/tracks.csv").read_bytes())
    results, scores, site = tmp_path / "results", tmp_path / "scores", tmp_path / "site"
    scored = ms.suite.score("odpc1", tmp_path / "smoke", results, scores, track=name, case=case, site=site)
    assert (site / "rules.html").is_file()
    assert (tmp_path / "scores").is_dir() and scored
    with pytest.raises(ValueError, match="size = 'huge'"):
        ms.suite.list("odpc1", size="huge")
    with pytest.raises(ValueError, match="nothing"):
        ms.suite.list("nothing")


def test_progress_is_told_to_callables_and_tqdm(dataset, tmp_path):
    told = []
    ms.generate(SMALL, progress=lambda what, done, total: told.append((what, done, total)))
    assert told and told[-1][1] == told[-1][2] > 0
    tqdm = pytest.importorskip("tqdm").tqdm
    bar = tqdm(disable=True)
    ms.open(dataset).save(tmp_path / "with_true", progress=True)
    ms.generate(SMALL, progress=bar)
    ms.generate(SMALL, progress=tqdm)

    def fails(*_):
        raise RuntimeError("stop here")

    with pytest.raises(RuntimeError, match="stop here"):
        ms.generate(SMALL, progress=fails)
    with pytest.raises(TypeError, match="progress = 3"):
        ms.generate(SMALL, progress=3)
    assert ROOT.exists()
