"""Tables, fields and datasets in other packages: Arrow, xarray, napari, notebooks."""

from __future__ import annotations

import importlib.metadata
import os
import subprocess
import sys
from pathlib import Path

import microsig as ms
import numpy as np
import pytest
from conftest import SMALL


@pytest.fixture(scope="module")
def ds() -> ms.Dataset:
    return ms.generate(SMALL, seed=2)


def same(table, frame) -> None:
    assert list(frame.columns) == table.columns and len(frame) == len(table)
    for name, column in table.items():
        np.testing.assert_array_equal(np.asarray(frame[name]), column)


def test_data_frames_have_names_and_rows_of_tables(ds):
    pandas, polars = pytest.importorskip("pandas"), pytest.importorskip("polars")
    for table in (ds.tracks, ds.frames, ds.displacements, ds.tracks[:0]):
        same(table, pandas.DataFrame(table))
        same(table, polars.DataFrame(table))


def test_arrow_needs_no_pyarrow(ds):
    polars = pytest.importorskip("polars")
    program = """
import sys
sys.modules["pyarrow"] = None
import microsig as ms, polars, polars.testing
ds = ms.generate(sys.argv[1], seed=2)
for table in (ds.tracks, ds.frames):
    # Without its dict, so that only the interface is left.
    class Stream:
        __arrow_c_stream__ = table.__arrow_c_stream__
    polars.testing.assert_frame_equal(polars.DataFrame(Stream()), polars.DataFrame(table.to_dict()))
capsule = ds.tracks.__arrow_c_stream__()
assert "arrow_array_stream" in repr(capsule)
del capsule
"""
    environment = dict(os.environ, PYTHONPATH=str(Path(ms.__file__).parents[1]))
    ran = subprocess.run([sys.executable, "-c", program, SMALL], env=environment, capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr
    assert polars


def test_pyarrow_reads_tables(ds):
    pyarrow = pytest.importorskip("pyarrow")
    for table in (ds.tracks, ds.frames, ds.tracks[:0]):
        arrow = pyarrow.table(table)
        assert arrow.column_names == table.columns and arrow.num_rows == len(table)
        for name, column in table.items():
            np.testing.assert_array_equal(arrow[name].to_numpy(zero_copy_only=False), column)


def test_fields_are_datasets_of_pivpy(ds):
    pytest.importorskip("xarray")
    field = ds.field
    made = field.to_xarray(plane_um=0)
    assert made["u"].dims == ("y", "x", "t") and set(made.data_vars) == {"u", "v", "w", "chc"}
    assert made["x"].attrs["units"] == "pix" and made.attrs["delta_t"] == 1
    plane = field[field["z_um"] == np.unique(field["z_um"])[np.argmin(np.abs(np.unique(field["z_um"])))]]
    for row in (0, len(plane) // 2, len(plane) - 1):
        at = {"x": plane["x_px"][row], "y": plane["y_px"][row]}
        assert float(made["u"].sel(at).isel(t=0)) == pytest.approx(plane["central_dx_px"][row], nan_ok=True)
        assert float(made["chc"].sel(at).isel(t=0)) == 1 - plane["mask"][row]
    assert made["chc"].values.max() == 1
    forward = field.to_xarray("forward", plane_um=0)
    assert forward.attrs["displacement"] == "forward"
    reported = ms.Table({"x_px": [8.0, 24, 8, 24], "y_px": [8.0, 8, 24, 24], "dx_px": [1.0, 2, 3, 4], "dy_px": [0.0] * 4, "flag": [0, 0, 1, 0]})
    made = reported.to_xarray()
    assert made["u"].values[:, :, 0].tolist() == [[1, 2], [3, 4]]
    assert made["chc"].values[:, :, 0].tolist() == [[1, 1], [0, 1]]
    with pytest.raises(ValueError, match="expected one of"):
        field.to_xarray("sideways", plane_um=0)
    with pytest.raises(ValueError, match="expected a displacement field"):
        ds.frames.to_xarray()
    try:
        from pivpy import schema
    except ImportError:
        return
    schema.validate(field.to_xarray(plane_um=0))


def test_layers_of_napari_have_scales(ds, tmp_path):
    images, calibration, tracks = ds.to_napari()
    assert [layer[2] for layer in (images, calibration, tracks)] == ["image", "image", "tracks"]
    assert images[1]["scale"] == (1, ds.um_per_px, ds.um_per_px)
    step = ds.calibration.z_um[1] - ds.calibration.z_um[0]
    assert calibration[1]["scale"] == (step, ds.um_per_px, ds.um_per_px)
    assert calibration[1]["translate"][0] == ds.calibration.z_um[0]
    seen = ds.tracks[ds.tracks["visible"] == 1]
    data = tracks[0]
    assert data.shape == (len(seen), 4) and data[:, 3].min() >= -0.5
    assert np.all(np.diff(data[:, 0]) >= 0) and len(tracks[1]["features"]["z_um"]) == len(seen)
    # As napari finds the plugin, without its windows.
    npe2 = pytest.importorskip("npe2")
    manifest = npe2.PluginManifest.from_file(Path(ms.__file__).parent / "napari.yaml")
    manifest.validate_imports()
    manager = npe2.PluginManager.instance()
    manager.register(manifest)
    folder = ds.save(tmp_path / "small")
    from npe2 import io_utils

    for path in (folder, folder / "datapackage.json"):
        layers, reader = io_utils._read([str(path)], stack=False, return_reader=True)
        assert reader.plugin_name == "microsig" and len(layers) == 3
        np.testing.assert_array_equal(layers[0][0], ds.images)
    (tmp_path / "empty").mkdir()
    from microsig._napari import get_reader

    assert get_reader(str(tmp_path / "empty")) is None and get_reader([str(folder), str(folder)]) is None


def test_notebooks_show_datasets(ds, tmp_path):
    html = ds._repr_html_()
    assert "data:image/png;base64," in html and "2 frames" not in html and "4 of 96 x 64 px, 16 bit" in html
    assert str(tmp_path) in ds.__class__._repr_html_(ms.open(ds.save(tmp_path / "small")))


def test_the_extra_all_has_all_extras():
    try:
        metadata = importlib.metadata.metadata("microsig")
    except importlib.metadata.PackageNotFoundError:
        tomllib = pytest.importorskip("tomllib")
        project = tomllib.loads((Path(ms.__file__).parents[1] / "pyproject.toml").read_text())["project"]
        extras = project["optional-dependencies"]
        inside = extras["all"][0].split("[")[1].rstrip("]").split(",")
        assert sorted(inside) == sorted(set(extras) - {"all", "notebooks"})
        return
    assert "all" in metadata.get_all("Provides-Extra")


def test_graphs_of_geff_are_tracks(ds, tmp_path):
    zarr = pytest.importorskip("zarr")
    seen = ds.tracks[ds.tracks["visible"] == 1]
    order = np.random.default_rng(1).permutation(len(seen))
    nodes = seen[order].origin(0)
    ids = np.arange(len(nodes)) + 100
    places = {(int(t), int(f)): k for k, (t, f) in enumerate(zip(nodes["track"], nodes["frame"]))}
    edges = [[ids[k], ids[places[t, f + 1]]] for (t, f), k in places.items() if (t, f + 1) in places and f % 2 == 0]

    def written(name, unit, scale, arrays={}, **about):
        group = zarr.open_group(str(tmp_path / name), mode="w")
        axes = [{"name": "t", "type": "time"}] + [{"name": a, "type": "space", "unit": u} for a, u in zip("zyx", ("micrometer", unit, unit))]
        group.attrs["geff"] = {"geff_version": "1.1", "directed": True, "axes": axes, **about}
        columns = {"t": nodes["frame"], "z": nodes["z_um"], "y": nodes["y_px"] * scale, "x": nodes["x_px"] * scale, "own": nodes["track"]}
        values = {f"nodes/props/{c}/values": v for c, v in columns.items()}
        for path, array in {"nodes/ids": ids, "edges/ids": np.array(edges), **values, **arrays}.items():
            made = group.create_array(path, shape=array.shape, dtype=array.dtype)
            made[...] = array
        return tmp_path / name

    um = ds.um_per_px
    for path, given in (
        (written("px", "pixel", 1.0), None),
        (written("um", "micrometer", um), um),
        (written("own", "pixel", 1.0, track_node_props={"tracklet": "own"}), None),
    ):
        table = ms.read_geff(path, um_per_px=given)
        scores = ms.evaluate(ds, table)
        assert scores.detection.f1 == 1 and scores.links.f1 == 1, path
    with pytest.raises(ValueError, match="um_per_px"):
        ms.read_geff(tmp_path / "um")
    first = np.arange(len(ids)) == 0
    missing = {"nodes/props/x/missing": first, "nodes/props/own/missing": first}
    table = ms.read_geff(written("missing", "pixel", 1.0, missing, track_node_props={"tracklet": "own"}))
    assert np.isnan(table.x_px).sum() == (table.track == -1).sum() == 1
    assert ms.evaluate(ds, table).counts.n_nan == 1
    times = nodes["frame"].astype(float)
    t = "nodes/props/t/values"
    two = [{"name": "t", "type": "time"}, {"name": "u", "type": "time"}]
    for arrays, about, says in (
        ({t: np.where(first, np.nan, times)}, {}, "t = nan"),
        ({t: np.where(first, 1e300, times)}, {}, "t = 1e\\+300"),
        ({t: np.where(first, np.inf, times)}, {}, "t = inf"),
        ({"nodes/props/t/missing": first}, {}, "t = nan"),
        ({"nodes/props/x/values": times + 1j}, {}, "type complex128"),
        ({"edges/ids": np.array([[100, 7]])}, {}, "an edge to node 7"),
        ({}, {"track_node_props": {"tracklet": "none"}}, "no none"),
        ({}, {"axes": two}, "one of time"),
    ):
        with pytest.raises(ValueError, match=says):
            ms.read_geff(written("wrong", "pixel", 1.0, arrays, **about))
    with pytest.raises(ValueError, match="expected a GEFF graph"):
        ms.read_geff(ds.save(tmp_path / "dataset"))
    with pytest.raises(FileNotFoundError):
        ms.read_geff(tmp_path / "none")
