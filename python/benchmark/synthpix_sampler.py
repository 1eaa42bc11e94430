"""Times SynthPix's own stream of batches (`synthpix.make`) on one core: one JSON object, on the last line.

    synthpix_sampler.py PAIRS PPP DIAMETER_PX

The images are those of `results/peers/synthpix_pairs.py`. The flow field is read from a file for every batch, as SynthPix does, with the
margin that its fastest particles need. Compilation is not timed.
"""

import json
import os
import sys
import tempfile
import time

os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false"
os.environ["JAX_PLATFORMS"] = "cpu"

import jax
import numpy as np
import synthpix

SIDE, BATCH, MARGIN = 512, 10, 16
pairs, ppp, diameter_px = int(sys.argv[1]), float(sys.argv[2]), float(sys.argv[3])
extent = SIDE + 2 * MARGIN
y, x = np.mgrid[:extent, :extent] - (extent - 1) / 2
r2 = x**2 + y**2 + 1e-9
speed = (1 - np.exp(-r2 / 93**2)) / r2 * 500
flow = np.stack([-y * speed, x * speed], axis=-1).astype(np.float32)
fastest = float(np.abs(flow).max())

with tempfile.TemporaryDirectory() as folder:
    file = f"{folder}/flow_1.npy"
    np.save(file, flow)
    sampler = synthpix.make(
        dict(
            scheduler_class=".npy",
            file_list=[file],
            loop=True,
            seed=0,
            batch_size=BATCH,
            flow_fields_per_batch=1,
            batches_per_flow_batch=1,
            image_shape=(SIDE, SIDE),
            img_offset=(float(MARGIN), float(MARGIN)),
            seeding_density_range=(ppp, ppp),
            p_hide_img1=0.0,
            p_hide_img2=0.0,
            diameter_ranges=[(0.91 * diameter_px / 2, 1.09 * diameter_px / 2)],
            diameter_var=0.0,
            intensity_ranges=[(50.0, 250.0)],
            intensity_var=0.0,
            rho_ranges=[(0.0, 0.0)],
            rho_var=0.0,
            dt=1.0,
            noise_uniform=0.0,
            noise_gaussian_mean=20.0,
            noise_gaussian_std=5.0,
            flow_field_size=(float(extent), float(extent)),
            resolution=1.0,
            velocities_per_pixel=1.0,
            max_speed_x=fastest,
            max_speed_y=fastest,
            min_speed_x=-fastest,
            min_speed_y=-fastest,
            output_units="pixels",
        )
    )

    def draw() -> None:
        batch = next(sampler)
        jax.block_until_ready((batch.images1, batch.images2, batch.flow_fields))

    draw()
    draw()
    cpu, wall = time.process_time(), time.perf_counter()
    for _ in range(pairs // BATCH):
        draw()
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall

print(json.dumps({"pairs": pairs // BATCH * BATCH, "cpu_s": cpu, "wall_s": wall}))
