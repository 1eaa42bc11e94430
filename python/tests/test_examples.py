"""Examples in Python do what they say."""

import pathlib
import sys

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).parents[2] / "examples/events"))


def test_events_of_a_pulsed_camera_are_read_back(tmp_path):
    import faery
    import pulsed

    y, x = np.mgrid[:40, :50]
    spots = [600 * np.exp(-((x - cx) ** 2 + (y - 20) ** 2) / 18) for cx in (10, 35)]
    t, x, y, pulse = pulsed.events(spots, 0.02, np.full((40, 50), pulsed.THRESHOLD))
    assert (np.diff(t) > 0).all() and (t >= pulse * 0.02).all()
    # A pixel that gets more light answers earlier.
    first = {(a, b): s for s, a, b, p in zip(t, x, y, pulse) if p == 0}
    assert first[10, 20] < first[13, 20] < first[16, 20]

    path = tmp_path / "events.raw"
    pulsed.write_evt3(path, np.round(t * 1e6), x, y, (40, 50))
    read = faery.events_stream_from_file(path).to_array()
    assert (read["x"] == x).all() and (read["y"] == y).all() and read["on"].all()
    assert (read["t"].astype(np.int64) == np.round(t * 1e6).astype(np.int64)).all()

    light = pulsed.light_of_events(t, x, y, pulse, 0.02, 2, (40, 50))
    seen = light > 0
    # Readout adds up to 0.5 us, which is 10 % of the light where a pixel answers within 5 us.
    assert seen.sum() > 300 and np.abs(light[seen] / np.array(spots)[seen] - 1).max() < 0.15
