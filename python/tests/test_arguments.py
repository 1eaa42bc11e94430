"""Arguments that cannot be used raise, with name, value and what is expected."""

from __future__ import annotations

import os
import re
from itertools import islice

import microsig as ms
import numpy as np
import pytest
from conftest import SMALL


@pytest.fixture(scope="module")
def dataset() -> ms.Dataset:
    return ms.generate(SMALL)


@pytest.mark.parametrize(
    ("options", "kind", "expected"),
    [
        ({"seed": -1}, ValueError, "a whole number, 0 to 2^64 - 1"),
        ({"seed": 1.5}, TypeError, "a whole number, 0 to 2^64 - 1"),
        ({"dims": -1}, ValueError, "one of 2, 3"),
        ({"dims": 2.5}, TypeError, "one of 2, 3"),
        ({"gate": "round"}, ValueError, "one of radial, ellipsoid, box"),
        ({"gate": 3}, TypeError, "one of radial, ellipsoid, box"),
        ({"gate_xy_px": "a"}, TypeError, "a number"),
        ({"gate_xy_px": -1}, ValueError, "1e-6 to 1e9 px"),
        ({"gate_z_um": float("nan")}, ValueError, "1e-6 to 1e9 um"),
        ({"isbi_gate_px": 0}, ValueError, "1e-6 to 1e9 px"),
        ({"border_px": -1}, ValueError, "0 to 1e7 px"),
        ({"origin": "edge"}, ValueError, "one of center1, center0, corner0, middle"),
        ({"unit": "ell"}, ValueError, "one of px, nm, um"),
        ({"y": "left"}, ValueError, "one of down, up"),
        ({"format": 3}, ValueError, "one of "),
        ({"frame_base": 2**40}, ValueError, "a whole number, "),
        ({"um_per_px": True}, TypeError, "a number"),
        ({"dt_s": 0}, ValueError, "1e-12 to 1e9 s"),
        ({"depth_um": (1, 0)}, ValueError, "two depths in um, the lower one first"),
        ({"depth_um": 3}, TypeError, "two numbers, the lower one first"),
        ({"plane_um": 10**400}, ValueError, "-1e9 to 1e9 um"),
        ({"plane_um": float("inf")}, ValueError, "-1e9 to 1e9 um"),
        ({"crlb": "yes"}, TypeError, "True or False"),
    ],
)
def test_options_of_scores(dataset, options, kind, expected):
    ((name, value),) = options.items()
    with pytest.raises(kind, match=f"^{name} = .*: expected {re.escape(expected)}"):
        ms.evaluate(dataset, dataset.tracks, **options)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"dims": 2, "gate_z_um": 1.0}, "gate_z_um: has no meaning with dims = 2"),
        ({"plane_um": 0.0}, "plane_um"),
    ],
)
def test_messages_name_arguments_rather_than_options_of_the_command(dataset, options, says, tmp_path):
    with pytest.raises(ValueError) as told:
        ms.evaluate(dataset, dataset.tracks, **options)
    assert says in str(told.value) and "--" not in str(told.value)
    (tmp_path / "foreign").mkdir()
    (tmp_path / "foreign/file").touch()
    with pytest.raises(FileExistsError, match="not replaced, with or without force=True"):
        dataset.save(tmp_path / "foreign", force=True)


@pytest.mark.parametrize(
    ("call", "kind", "says"),
    [
        (lambda ds: ms.track(ds, "truth-noise", seed=-1), ValueError, "seed = -1: expected a whole number, 0 to"),
        (lambda ds: ms.track(ds, "nnc"), ValueError, "method = 'nnc': expected one of spots, ncc"),
        (lambda ds: ms.track(ds, diameter_px="a"), TypeError, "diameter_px = 'a': expected a number"),
        (lambda ds: ms.track(ds, noise_z_um=-1), ValueError, "noise_z_um = -1: expected 0 to 1000 um"),
        (lambda ds: ms.track(ds, "ncc", ensemble=True), ValueError, 'ensemble=True: expected with method="piv", not ncc'),
        (lambda ds: ms.track(ds, "spots", positions="p.csv"), ValueError, 'positions: expected with method="ncc" or mle'),
        (lambda ds: ms.track(ds, "mle", aspect_ratio=2), ValueError, "aspect_ratio: expected with shape = 'spheroid'"),
        (lambda ds: ms.track(ds, ensemble=1), TypeError, "ensemble = 1: expected True or False"),
        (lambda ds: ms.render(ds.settings, [[1, 1, 1, 1]], seed="a"), TypeError, "seed = 'a': expected a whole"),
        (lambda ds: ms.render(ds.settings, [[1, 1, 1, 1]], seed=1.5), TypeError, "seed = 1.5: expected a whole"),
        (lambda ds: ms.render(ds.settings, [[1, 1, 1, 1]], frame=-1), ValueError, "frame = -1: expected a whole"),
        (lambda ds: ms.render(ds.settings, [[1j, 1, 1, 1]]), TypeError, "particles of type complex128: expected"),
        (lambda ds: ms.render(ds.settings, [[1, 1, 1, None, {}]]), ValueError, "particles: expected an array"),
        (lambda ds: ms.field("hill").velocity(["a"]), TypeError, "points_um of type <U1: expected numbers"),
        (lambda ds: ms.uniform("a", 1), TypeError, "low = 'a': expected a number"),
        (lambda ds: ms.log_uniform(1, None), TypeError, "high = None: expected a number"),
        (lambda ds: ms.integers(0, 2**60), ValueError, f"high = {2**60}: expected a whole number, "),
        (lambda ds: ms.choice(3), TypeError, "values = 3: expected a list"),
        (lambda ds: ms.set_threads("a"), TypeError, "threads = 'a': expected a whole number, 0 to 1024"),
        (lambda ds: ms.set_threads(-1), ValueError, "threads = -1: expected a whole number, 0 to 1024"),
        (lambda ds: ms.set_threads(1025), ValueError, "threads = 1025: expected a whole number, 0 to 1024"),
        (lambda ds: ms.set_threads(2**70), ValueError, "expected a whole number, 0 to 1024"),
        (lambda ds: ms.generate(SMALL, progress="yes"), TypeError, "progress = 'yes': expected True, False, a callable"),
        (lambda ds: ms.compare({}), ValueError, "scores = {}: expected a dict of what evaluate"),
        (lambda ds: ms.compare({"a": 1}), TypeError, "scores: 'a' is of type int: expected"),
        (lambda ds: ms.compare([1]), TypeError, "scores of type list: expected a dict"),
    ],
)
def test_calls(dataset, call, kind, says):
    with pytest.raises(kind) as told:
        call(dataset)
    assert says in str(told.value)


@pytest.mark.parametrize(
    ("arguments", "kind", "expected"),
    [
        ({"flow_depth_um": "top"}, TypeError, "um or 'mean'"),
        ({"heatmap_sigma_px": "a"}, TypeError, "a number"),
        ({"share": None}, TypeError, "a number"),
        ({"flow_components": 4}, ValueError, "one of 2, 3"),
        ({"batch": 10**12}, ValueError, "less, because about .* GB of memory are needed and only "),
        ({"ahead": 10**12}, ValueError, "less, because about .* GB of memory are needed and only "),
        ({"particles": 10**12}, ValueError, "less, because about .* GB of memory are needed and only "),
        ({"particles": 2**63 - 1}, ValueError, "less, because about .* GB of memory are needed and only "),
        ({"particles": 2**63}, ValueError, "a whole number from 0"),
    ],
)
def test_arguments_of_streams(arguments, kind, expected):
    ((name, value),) = arguments.items()
    with pytest.raises(kind, match=f"{name} = {value!r}.*: expected {expected}"):
        ms.Stream(SMALL, **{"batch": 2, **arguments})


def test_samples_are_numbered_from_0_and_have_to_fit_into_memory():
    stream = ms.Stream(SMALL, batch=2)
    for call in (stream.scenario, stream.window, stream.values, stream.seed_of):
        with pytest.raises(ValueError, match="sample = -1: expected a whole number from 0"):
            call(-1)
    with pytest.raises(ValueError, match=f"n = {10**13}: expected less, because about .* GB of memory"):
        stream.samples(0, 10**13)
    with pytest.raises(ValueError, match="worker = 2: expected a whole number, 0 to 1"):
        next(stream.shard(2, 2))
    assert stream.samples(np.int64(3), 2)["index"].tolist() == [3, 4]
    assert [batch["index"].tolist() for batch in islice(stream, 2)] == [[0, 1], [2, 3]]


#: Calls that take the path of a text.
READERS = {
    "resolve": ms.resolve,
    "generate": ms.generate,
    "Stream": ms.Stream,
    "sweep": ms.sweep,
    "render": lambda path: ms.render(path, [[1, 1, 0, 2]]),
}


@pytest.mark.parametrize("call", READERS.values(), ids=READERS.keys())
def test_pipes_devices_folders_and_huge_files_are_refused_at_once(call, tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with open(tmp_path / "huge", "wb") as file:
        # A hole: it takes no space on disk.
        file.truncate(2**42)
    says = {"/dev/zero": "device", tmp_path / "pipe": "a pipe", tmp_path: "a folder", tmp_path / "huge": "huge: "}
    for path, expected in says.items():
        with pytest.raises(ValueError, match=expected) as raised:
            call(path)
        assert str(path) in str(raised.value)
