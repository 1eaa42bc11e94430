"""btrack on a microsig sequence: links of spots that a Laplacian of Gaussian finds."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import logging

import btrack
import numpy as np
from btrack.btypes import PyTrackObject
from btrack.models import MotionModel
from common.cli import track_main
from common.spots import find_spots

DEFAULTS = {
    "sigma": 1.5,  # of the Laplacian of Gaussian, px
    "min_snr": 6.0,  # minimum response, in standard deviations of the filtered noise
    "search_radius": 8.0,  # px
    "acceleration": 1.0,  # standard deviation of the change of velocity from frame to frame, px
    "position_error": 0.3,  # standard deviation of a measured position, px
    "start_speed": 5.0,  # standard deviation of the first velocity, px per frame
    "max_lost": 1,  # frames in which a particle may be missing
    "optimise": False,  # join tracklets by btrack's global optimization
}


def motion(params):
    """Constant velocity in x, y, z with random accelerations; z is unused (always 0)."""
    forward = np.eye(6) + np.diag([1, 1, 1], 3)
    observe = np.eye(3, 6)
    start = np.diag([params["position_error"] ** 2] * 3 + [params["start_speed"] ** 2] * 3)
    kick = np.vstack([0.5 * np.eye(3), np.eye(3)]) * params["acceleration"]
    return MotionModel(name="particle", measurements=3, states=6, A=forward, H=observe, P=start, Q=kick @ kick.T,
                       R=np.eye(3) * params["position_error"] ** 2, dt=1.0, accuracy=7.5,
                       max_lost=params["max_lost"], prob_not_assign=0.01)


def hypotheses():
    return btrack.models.HypothesisModel(
        name="particle", hypotheses=["P_FP", "P_init", "P_term", "P_link"], lambda_time=5.0, lambda_dist=3.0,
        lambda_link=10.0, lambda_branch=50.0, eta=1e-10, theta_dist=20.0, theta_time=5.0, dist_thresh=20.0,
        time_thresh=2.0, apop_thresh=5, segmentation_miss_rate=0.1, apoptosis_rate=0.001, relax=True)


def track(dataset, params):
    logging.getLogger("btrack").setLevel(logging.ERROR)
    rows, first = [], 0
    for group in dataset.groups():
        objects, height, width = [], 1, 1
        for frame in group:
            image = frame.image()
            height, width = image.shape
            for x, y in zip(*find_spots(image, params["sigma"], params["min_snr"])):
                objects.append(PyTrackObject.from_dict(
                    {"ID": len(objects), "x": x, "y": y, "z": 0.0, "t": frame.number - group[0].number}))
        if not objects:
            continue
        with btrack.BayesianTracker() as tracker:
            tracker.configure(btrack.config.TrackerConfig(
                motion_model=motion(params), hypothesis_model=hypotheses(),
                max_search_radius=params["search_radius"], volume=((0, width), (0, height), (-1e5, 1e5))))
            tracker.append(objects)
            tracker.track(step_size=len(group))
            if params["optimise"]:
                tracker.optimize()
            for number, one in enumerate(tracker.tracks):
                rows += [(group[0].number + t, first + number, x, y)
                         for t, x, y, dummy in zip(one.t, one.x, one.y, one.dummy) if not dummy]
            first += tracker.n_tracks
    return rows


if __name__ == "__main__":
    track_main(track, DEFAULTS)
