"""Streams."""

from __future__ import annotations

import importlib.util
import json
import multiprocessing
import os
import pickle
import re
import signal
import subprocess
import sys
import textwrap
import time
import warnings

import microsig as ms
import numpy as np
import pytest
from conftest import ROOT, SMALL

CROP = (48, 64)
VARY = {
    "optics.background_noise": ms.uniform(0, 50),
    "optics.gain": ms.log_uniform(0.5, 5),
    "particles.number.count": ms.integers(1, 9),
}
LABELS = ("boxes", "shapes", "instances", "heatmap", "depth", "flow", "clean")


def stream(**changes) -> ms.Stream:
    arguments = dict(batch=4, crop=CROP, vary=VARY, seed=5, labels=LABELS) | changes
    return ms.Stream(SMALL, **arguments)


def same(a, b) -> None:
    assert a.keys() == b.keys()
    for name in a:
        np.testing.assert_array_equal(a[name], b[name], err_msg=name)


def trimmed(sample, particles):
    """A sample without the rows that fill its batch up."""
    return {k: v[:particles] if k in ("particles", "mask", "boxes", "shapes") else v for k, v in sample.items()}


def test_a_choice_may_be_the_default_of_a_key():
    drawn = stream(vary={"optics.background_noise": ms.choice([None, 50]), "optics.gain": ms.choice([None, 2])})
    assert len({str(drawn.values(index)) for index in range(12)}) == 4, "all combinations"
    assert {drawn.values(index)["optics.gain"] for index in range(12)} == {None, 2}
    for index in range(12):
        dataset = ms.generate(drawn.scenario(index))
        np.testing.assert_array_equal(drawn[index]["image"], dataset.images[:2])


def test_keys_that_need_new_tables_are_named():
    varied = {"optics.numerical_aperture": ms.uniform(0.28, 0.32)}
    with pytest.warns(UserWarning, match=r"vary optics\.numerical_aperture: .*render\.images: single"):
        stream(vary=varied, set={"render.mode": "expected"})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        single = {"render.mode": "expected", "render.images": "single"}
        stream(vary=varied, set=single)


def test_samples_are_the_beginnings_of_datasets():
    other = {
        "particles.diameter_um": ms.choice([{"constant": 1.5}, {"list": [[2, 1], [3, 2]]}]),
        "optics.background_noise": ms.uniform(0, 50),
        "motion.flow.field.poiseuille.max_speed_um_s": ms.uniform(100, 2000),
    }
    for vary, more in ((VARY, {}), (other, {}), (VARY, {"render.mode": "expected"}), ({}, {"sensor.bits": 12})):
        drawn = stream(vary=vary, set=more)
        for index in (0, 1, 2, 7, 10_000_000_000):
            sample = drawn[index]
            dataset = ms.generate(drawn.scenario(index))
            assert dataset.scenario["seed"] == drawn.seed_of(index)
            np.testing.assert_array_equal(sample["image"], dataset.images[:2])
            tracks, moves = dataset.tracks, dataset.displacements
            seen = tracks[(tracks["frame"] == 0) & (tracks["visible"] == 1)]
            assert sample["mask"].all() and len(sample["mask"]) == len(seen)
            names = ms.PARTICLE_COLUMNS[:4]
            told = np.column_stack([seen[name] for name in names]).astype(np.float32)
            np.testing.assert_array_equal(sample["particles"][:, :4], told)
            by_track = {track: k for k, track in enumerate(moves["track"]) if moves["frame_a"][k] == 0}
            for row, track in zip(sample["particles"], seen["track"]):
                if track in by_track:
                    moved = [moves[name][by_track[track]] for name in ("dx_px", "dy_px", "dz_um")]
                    np.testing.assert_array_equal(row[5:], np.float32(moved))
                else:
                    assert np.isnan(row[5:]).all()


def test_batches_are_their_samples_whatever_their_size_and_the_threads():
    one = stream()
    whole = next(one)
    assert whole["image"].shape == (4, 2, *CROP) and whole["image"].dtype == np.uint16
    for k in range(4):
        sample = stream()[k]
        particles = len(sample["mask"])
        assert sample["mask"].all() and whole["mask"][k].sum() == particles
        same(trimmed({n: v[k] for n, v in whole.items()}, particles), sample)
    ms.set_threads(1)
    same(next(stream()), whole)
    ms.set_threads(0)
    second, large = next(one), next(stream(batch=8))
    np.testing.assert_array_equal(large["image"][4:], second["image"])
    np.testing.assert_array_equal(large["index"], np.arange(8))


def test_a_stream_goes_on_where_it_was():
    first = stream()
    for _ in range(3):
        next(first)
    state = first.state_dict()
    assert state["position"] == 12
    expected = [next(first) for _ in range(2)]
    again = stream()
    again.load_state_dict(pickle.loads(pickle.dumps(state)))
    for batch in expected:
        same(next(again), batch)
    again.seek(12)
    same(next(again), expected[0])
    with pytest.raises(ValueError, match="different samples"):
        stream(seed=6).load_state_dict(state)


def test_the_recipes_for_dask_and_ray_give_the_samples():
    recipes = re.findall(r"```python\n(import (dask|ray)\n.*?)```", (ROOT / "docs/cluster.md").read_text(), re.DOTALL)
    assert [name for _, name in recipes] == ["dask", "ray"]
    given = plain()
    for recipe, name in recipes:
        # dask is installed for the tests; ray is large.
        if name == "ray" and importlib.util.find_spec("ray") is None:
            continue
        place = {"stream": given}
        exec(recipe, place)
        assert len(place["batches"]) == 4
        for k, batch in enumerate(place["batches"]):
            same(batch, plain().samples(32 * k, 32))


#: In focus, without walls: a sample takes a tenth of a millisecond.
PLAIN = """(
    name: "plain",
    optics: (gaussian: (diameter_px: 2, reference_um: 2, peak_counts: 200), pixel_dim_x: 16, pixel_dim_y: 16),
    motion: flow(field: uniform()),
    particles: (number: count(2)),
    boundaries: (z_um: (-5, 5)),
    timing: pairs(count: 1),
)"""


def plain() -> ms.Stream:
    return ms.Stream(PLAIN, batch=50, seed=3, vary={"optics.background_noise": ms.uniform(0, 50)})


def test_a_killed_stream_that_is_resumed_at_sample_10000_gives_what_it_would_have_given(tmp_path):
    uninterrupted, sums = plain(), {}
    for batch in uninterrupted:
        sums[int(batch["index"][0])] = int(batch["image"].astype(np.int64).sum())
        if uninterrupted.position == 10_200:
            break
    assert len(set(sums.values())) > 200
    program = textwrap.dedent(
        f"""
        import json, sys, time
        sys.path.insert(0, {os.path.dirname(__file__)!r})
        from test_stream import plain
        stream = plain()
        for batch in stream:
            if stream.position == 10_000:
                print(json.dumps(stream.state_dict()), flush=True)
                time.sleep(60)
        """
    )
    process = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    state = json.loads(process.stdout.readline())
    process.kill()
    assert process.wait(timeout=60) == -signal.SIGKILL
    resumed = plain()
    resumed.load_state_dict(state)
    for first in (10_000, 10_050, 10_100, 10_150):
        assert int(next(resumed)["image"].astype(np.int64).sum()) == sums[first]


def test_any_sample_is_that_of_any_batch():
    """Streams of arguments drawn at random: samples equal those in batches that begin anywhere."""
    random = np.random.default_rng(11)
    for _ in range(6):
        labels = [label for label in LABELS if random.random() < 0.5]
        window = dict(crop=(24, 32), crop_at="random") if random.random() < 0.5 else dict(crop=(24, 32))
        arguments = dict(labels=labels, seed=int(random.integers(2**63)), split=str(random.choice(["train", "val"])))
        vary = {path: distribution for path, distribution in VARY.items() if random.random() < 0.7}
        drawn = stream(vary=vary, batch=int(random.integers(1, 6)), **window, **arguments)
        first = int(random.integers(2**40))
        drawn.seek(first)
        batch = next(drawn)
        again = stream(vary=vary, batch=1, **window, **arguments)
        for k in random.permutation(drawn.batch):
            sample = again[first + int(k)]
            particles = len(sample["mask"])
            assert batch["index"][k] == sample["index"] == first + k
            same(trimmed({n: v[k] for n, v in batch.items()}, particles), sample)
            assert not batch["mask"][k][particles:].any() and not batch["particles"][k][particles:].any()


def test_windows_are_parts_of_datasets():
    wide = stream(crop=(20, 30), crop_at="random", vary={}, set={"particles.number.count": 12})
    whole = stream(crop=None, vary={}, set={"particles.number.count": 12})
    assert wide.shape == (20, 30)
    places = {wide.window(k) for k in range(200)}
    assert len(places) > 150
    rows, columns = zip(*places)
    assert (min(rows), min(columns)) == (0, 0) and max(rows) > 40 and max(columns) > 60
    seen = 0
    for index in range(8):
        part, full = wide[index], whole[index]
        row, column = wide.window(index)
        cut = np.s_[..., row : row + 20, column : column + 30]
        for name in ("image", "clean", "heatmap", "flow"):
            np.testing.assert_array_equal(part[name], full[name][cut])
        dataset = ms.generate(wide.scenario(index))
        np.testing.assert_array_equal(part["image"], dataset.images[:2][cut])
        x, y = full["particles"][:, 0] - column, full["particles"][:, 1] - row
        inside = (x >= 0.5) & (x < 30.5) & (y >= 0.5) & (y < 20.5)
        assert len(part["mask"]) == inside.sum()
        np.testing.assert_array_equal(part["particles"][:, 2:], full["particles"][inside][:, 2:])
        np.testing.assert_allclose(part["particles"][:, 0], x[inside])
        for new, old in enumerate(np.flatnonzero(inside)):
            own = full["instances"][cut] == old + 1
            np.testing.assert_array_equal(part["instances"] == new + 1, own)
            assert (part["depth"][own] == full["boxes"][old, 4]).all()
            seen += own.sum()
        assert np.isnan(part["depth"][part["instances"] == 0]).all()
    assert seen > 100
    assert stream().window(0) is None
    with pytest.raises(ValueError, match="at most 64 rows and 96 columns"):
        stream(crop=(65, 10), crop_at="random")


def test_seeds_splits_and_values_differ():
    train, val = stream(), stream(split="val")
    seeds = [s.seed_of(k) for s in (train, val) for k in range(500)]
    assert len(set(seeds)) == 1000
    values = [train.values(k) for k in range(200)]
    noise = [v["optics.background_noise"] for v in values]
    assert 0 <= min(noise) < 5 and 45 < max(noise) <= 50
    assert {v["particles.number.count"] for v in values} == set(range(1, 10))
    assert train.scenario(3)["optics"]["background_noise"] == pytest.approx(values[3]["optics.background_noise"])
    # What else varies does not change what is drawn for a path.
    fewer = stream(vary={"optics.background_noise": ms.uniform(0, 50)})
    assert fewer.values(3)["optics.background_noise"] == values[3]["optics.background_noise"]


def test_shapes_are_those_of_the_truth():
    rods = {"particles.spheroids": {"e_p": 3, "orientation": "random"}}
    drawn = stream(set=rods, vary=None)
    sample = drawn[2]
    assert sample["shapes"].shape == (len(sample["mask"]), 4)
    tracks = ms.generate(drawn.scenario(2)).tracks
    first = (np.asarray(tracks["frame"]) == 0) & (np.asarray(tracks["visible"]) == 1)
    a, b = (np.asarray(tracks[name])[first] for name in ("alpha_rad", "beta_rad"))
    axes = np.stack([np.sin(a) * np.sin(b), np.cos(b), -np.cos(a) * np.sin(b)], axis=1)
    particles = sample["particles"][sample["mask"]]
    np.testing.assert_allclose(np.asarray(tracks["x_px"])[first], particles[:, 0], atol=1e-3)
    np.testing.assert_allclose(sample["shapes"][sample["mask"], :3], axes, atol=1e-6)
    np.testing.assert_allclose(sample["shapes"][sample["mask"], 3], 3)
    spheres = stream(vary=None)[2]
    assert (spheres["shapes"][spheres["mask"]] == [0, 0, 0, 1]).all()


def test_labels_are_what_they_say():
    drawn = stream(vary={"particles.number.count": ms.integers(1, 3)}, set={"optics.background_noise": 0})
    for index in range(20):
        sample = drawn[index]
        rows, cols = CROP
        assert sample["clean"].shape == (2, rows, cols) and sample["clean"].dtype == np.float32
        # Counts scatter around their expectation as rays do.
        light = sample["clean"][0] - sample["clean"][0].min()
        error = sample["image"][0].astype(float) - sample["clean"][0]
        assert abs(error.mean()) < 3 + 0.05 * light.mean()
        instances = sample["instances"]
        assert instances.min() >= 0 and instances.max() <= len(sample["mask"])
        for k, (x, y, w, h, z, cls) in enumerate(sample["boxes"]):
            px, py, pz, d = sample["particles"][k][:4]
            assert z == pz and cls == 0
            if w == 0:
                continue
            assert 0.5 <= x - w / 2 and x + w / 2 <= cols + 0.5 and 0.5 <= y - h / 2 and y + h / 2 <= rows + 0.5
            own = np.argwhere(instances == k + 1) + 1
            if len(own):
                assert own[:, 1].min() >= x - w / 2 and own[:, 1].max() <= x + w / 2
                assert (sample["depth"][instances == k + 1] == z).all()
        assert np.isnan(sample["depth"][instances == 0]).all()
        heat, particles = sample["heatmap"], sample["particles"]
        assert heat.max() <= 1
        for x, y in particles[:, :2]:
            row, col = int(round(y)) - 1, int(round(x)) - 1
            distance = (x - 1 - col) ** 2 + (y - 1 - row) ** 2
            assert heat[row, col] >= np.exp(-distance / (2 * 1.5**2)) - 1e-5


def test_flow_is_that_of_the_field():
    drawn = stream(vary={}, flow_depth_um=-30.0, flow_components=3, labels=["flow"])
    flow = drawn[0]["flow"]
    dataset = ms.generate(drawn.scenario(0))
    speed = 0.5
    field = ms.field("poiseuille")
    moved = field.displacement([[0.0, 0.0, -30.0]], 0.0, dataset.dt_s)[0]
    np.testing.assert_allclose(flow[0], moved[0] / dataset.um_per_px, rtol=1e-5)
    assert flow.shape == (3, *CROP) and not flow[1:].any() and speed
    mean = stream(vary={}, labels=["flow"])[0]["flow"]
    np.testing.assert_allclose(mean[0], 2 / 3 * moved[0] / dataset.um_per_px, rtol=2e-3)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"labels": ["bxes"]}, "labels"),
        ({"vary": {"optics.noise": ms.uniform(0, 1)}}, "optics.noise"),
        ({"vary": {"optics.background_noise": ms.uniform(-1, 1)}}, "background_noise"),
        ({"vary": {"optics.background_noise": ms.uniform(2, 1)}}, "lower one first"),
        ({"vary": {"optics.background_noise": ms.choice([])}}, "at least one"),
        ({"vary": {"seed": ms.integers(0, 1)}}, "seed"),
        ({"vary": {"optics.pixel_dim_x": ms.integers(10, 20)}}, "the same size"),
        ({"crop": (0, 10)}, "crop"),
        ({"frames": 3}, "frames"),
        ({"frames": 0}, "frames"),
        ({"frames": 1}, "flow"),
        ({"batch": 0}, "batch"),
        ({"crop_at": "left"}, "crop_at"),
        ({"crop": (0, 10), "crop_at": "random"}, "crop"),
        ({"split": "test"}, "split"),
        ({"share": 2.0}, "share"),
        ({"heatmap_sigma_px": 0.0}, "heatmap_sigma_px"),
        ({"flow_depth_um": float("nan")}, "flow_depth_um"),
        ({"seed": -1}, "seed"),
    ],
)
def test_bad_streams_raise(changes, says):
    with pytest.raises(ValueError) as raised:
        stream(**changes)
    assert says in str(raised.value)


def _sums(pickled: bytes, queue) -> None:
    drawn = pickle.loads(pickled)
    queue.put([int(next(drawn)["image"].sum()) for _ in range(3)])


@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_streams_work_after_fork_and_spawn(method):
    drawn = stream()
    expected = [int(next(drawn)["image"].sum()) for _ in range(3)]
    context = multiprocessing.get_context(method)
    queue = context.Queue()
    fresh = stream()
    process = context.Process(target=_sums, args=(pickle.dumps(fresh), queue))
    process.start()
    assert queue.get(timeout=60) == expected
    process.join(timeout=60)
    assert process.exitcode == 0


def test_a_stream_that_draws_ahead_can_be_forked():
    drawn = stream()
    next(drawn)
    expected = stream()
    expected.seek(4)
    second = int(next(expected)["image"].sum())
    child = os.fork()
    if child == 0:
        code = 1
        try:
            code = 0 if int(next(drawn)["image"].sum()) == second else 2
        finally:
            os._exit(code)
    for _ in range(600):
        pid, status = os.waitpid(child, os.WNOHANG)
        if pid:
            break
        time.sleep(0.1)
    else:
        os.kill(child, signal.SIGKILL)
        pytest.fail("the child hangs")
    assert os.waitstatus_to_exitcode(status) == 0
    assert int(next(drawn)["image"].sum()) == second, "the parent goes on"


def test_shards_take_turns():
    whole, a, b = stream(), stream().shard(0, 2), stream().shard(1, 2)
    for source in (a, b, a, b):
        same(next(source), next(whole))


def test_ctrl_c_ends_a_stream_within_a_second():
    program = textwrap.dedent(
        f"""
        import time, microsig as ms
        drawn = ms.Stream({SMALL!r}, batch=100000, crop=(64, 64))
        print("ready", flush=True)
        try:
            next(drawn)
        except KeyboardInterrupt:
            print(time.monotonic(), flush=True)
        drawn.close()
        print("closed", flush=True)
        """
    )
    process = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None and process.stdout.readline() == "ready\n"
    time.sleep(0.4)
    sent = time.monotonic()
    process.send_signal(signal.SIGINT)
    assert float(process.stdout.readline()) - sent < 1.0
    assert process.stdout.readline() == "closed\n"
    assert process.wait(timeout=60) == 0


def test_memory_stays_flat():
    side = {"optics.pixel_dim_x": 64, "optics.pixel_dim_y": 64}
    drawn = ms.Stream(PLAIN, batch=50, set=side, vary={"optics.background_noise": ms.uniform(0, 50)})
    page = os.sysconf("SC_PAGE_SIZE")

    def resident() -> int:
        with open("/proc/self/statm") as statm:
            return int(statm.read().split()[1]) * page

    for _ in range(50):
        next(drawn)
    before = resident()
    for _ in range(400):
        batch = next(drawn)
    # What is not freed would be thirty times as much.
    assert 400 * sum(array.nbytes for array in batch.values()) > 150e6
    assert resident() - before < 5e6


def test_torch_data_sets_share_the_stream():
    torch = pytest.importorskip("torch")
    from microsig.torch import dataset

    expected = stream(labels=["clean"])
    wanted = [next(expected) for _ in range(4)]
    for workers in (0, 2):
        loader = torch.utils.data.DataLoader(
            dataset(stream(labels=["clean"])), batch_size=None, num_workers=workers
        )
        for batch, values in zip(loader, wanted):
            np.testing.assert_array_equal(batch["image"].numpy(), values["image"].astype(np.float32))
            np.testing.assert_array_equal(batch["clean"].numpy(), values["clean"])


def test_torch_epochs_go_on_where_the_one_before_ended():
    torch = pytest.importorskip("torch")
    from microsig.torch import dataset

    for options in ({}, {"num_workers": 2}, {"num_workers": 2, "persistent_workers": True}):
        made = dataset(stream(batch=2), batches=3)
        loader = torch.utils.data.DataLoader(made, batch_size=None, **options)
        seen = [[int(batch["index"][0]) for batch in loader] for _ in range(3)]
        assert seen == [[0, 2, 4], [6, 8, 10], [12, 14, 16]], options
        assert len(made) == 3
        resumed = dataset(stream(batch=2), batches=3)
        resumed.load_state_dict(made.state_dict())
        loader = torch.utils.data.DataLoader(resumed, batch_size=None, **options)
        assert [int(batch["index"][0]) for batch in loader] == [18, 20, 22], options


def test_paths_of_which_one_holds_another_are_refused():
    vary = {"particles.number.count": ms.integers(1, 4), "particles.number": ms.choice([{"count": 20}])}
    with pytest.raises(ValueError, match="particles.number.count is a part of particles.number"):
        stream(vary=vary)


@pytest.mark.parametrize(
    "arguments",
    [
        {"batch": 1.5},
        {"seed": 1.7},
        {"seed": "x"},
        {"crop": (32.9, 32.9)},
        {"crop": 32},
        {"crop": (32,)},
        {"particles": 2.5},
        {"frames": 1.5},
        {"ahead": True},
        {"set": ["optics.gain=1"]},
        {"vary": ["optics.gain"]},
    ],
)
def test_arguments_of_other_kinds_are_refused_with_what_is_expected(arguments):
    (name,) = arguments
    with pytest.raises(TypeError, match=f"{name} = .*expected "):
        stream(**arguments)


def test_whole_numbers_are_not_rounded():
    drawn = stream()
    for call in (
        lambda: drawn[1.9],
        lambda: drawn["a"],
        lambda: drawn.seek(2.5),
        lambda: ms.integers(1.9, 3.9),
        lambda: ms.generate(drawn.scenario(0), seed=1.5),
        lambda: ms.generate(drawn.scenario(0), seed="a"),
    ):
        with pytest.raises(TypeError, match="expected a whole number"):
            call()
    assert drawn[np.uint8(1)]["index"] == 1
    with pytest.raises(ValueError, match="expected a result of state_dict"):
        drawn.load_state_dict({})


def test_a_crop_is_smaller_than_the_images():
    rows, columns = stream(crop=None).shape
    with pytest.raises(ValueError, match="at most the rows and columns"):
        stream(crop=(rows + 1, columns))
