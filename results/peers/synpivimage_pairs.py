"""Times synpivimage on classical in-focus image pairs on one core: one JSON object.

    synpivimage_pairs.py PAIRS PPP DIAMETER_PX

512 x 512 px; a vortex; one e^-2 diameter; peaks of 250 counts under uniform light; Gaussian noise of 5 counts.
"""

import json
import os
import sys
import time

os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
for threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[threads] = "1"

import numpy as np
from importlib.metadata import version
from synpivimage import Camera, Laser, Particles, take_image

SIDE = 512
pairs, ppp, diameter_px = int(sys.argv[1]), float(sys.argv[2]), float(sys.argv[3])
camera = Camera(
    nx=SIDE,
    ny=SIDE,
    bit_depth=8,
    qe=1,
    sensitivity=1,
    baseline_noise=20,
    dark_noise=5,
    shot_noise=False,
    fill_ratio_x=1.0,
    fill_ratio_y=1.0,
    particle_image_diameter=diameter_px,
)
laser = Laser(shape_factor=10**3, width=10)
random = np.random.default_rng(1)
n = round(ppp * SIDE * SIDE)


def pair():
    x, y = random.uniform(0, SIDE - 1, (2, n))
    dx, dy = x - SIDE / 2, y - SIDE / 2
    r2 = dx**2 + dy**2 + 1e-9
    speed = (1 - np.exp(-r2 / 93**2)) / r2 * 500
    places = (x, y), (x - dy * speed, y + dx * speed)
    return [
        take_image(laser, camera, Particles(x=x, y=y, z=np.zeros(n), size=np.ones(n) * diameter_px), particle_peak_count=250)[0]
        for x, y in places
    ]


first = pair()[0]
cpu, wall = time.process_time(), time.perf_counter()
for _ in range(pairs):
    pair()
cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
print(
    json.dumps(
        {
            "pairs": pairs,
            "cpu_s": cpu,
            "wall_s": wall,
            "mean_counts": float(first.mean()),
            "max_counts": float(first.max()),
            "versions": {p: version(p) for p in ("synpivimage", "numpy")} | {"python": sys.version.split()[0]},
        }
    )
)
