"""Times SynthPix on classical in-focus image pairs on one core: one JSON object.

    synthpix_pairs.py PAIRS PPP DIAMETER_PX

512 x 512 px; a vortex; diameters within 9 % of DIAMETER_PX, the e^-2 diameter (SynthPix's own diameter is 2 sigma, half of it);
peaks of 50 to 250 counts; Gaussian noise of 5 counts. Compilation is not timed.
"""

import json
import os
import sys
import time

os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false"
os.environ["JAX_PLATFORMS"] = "cpu"

import jax
import jax.numpy as jnp
import numpy as np
from importlib.metadata import version
from synthpix.data_generate import generate_images_from_flow
from synthpix.types import ImageGenerationSpecification

SIDE, BATCH = 512, 10
pairs, ppp, diameter_px = int(sys.argv[1]), float(sys.argv[2]), float(sys.argv[3])
diameters = (0.91 * diameter_px / 2, 1.09 * diameter_px / 2)

specification = ImageGenerationSpecification(
    batch_size=BATCH,
    image_shape=(SIDE, SIDE),
    img_offset=(0, 0),
    seeding_density_range=(ppp, ppp),
    p_hide_img1=0.0,
    p_hide_img2=0.0,
    diameter_ranges=[diameters],
    diameter_var=0.0,
    intensity_ranges=[(50.0, 250.0)],
    intensity_var=0.0,
    rho_ranges=[(0.0, 0.0)],
    rho_var=0.0,
    dt=1.0,
    noise_uniform=0.0,
    noise_gaussian_mean=20.0,
    noise_gaussian_std=5.0,
)
y, x = np.mgrid[:SIDE, :SIDE] - (SIDE - 1) / 2
r2 = x**2 + y**2 + 1e-9
speed = (1 - np.exp(-r2 / 93**2)) / r2 * 500
flow = jnp.asarray(np.stack([-y * speed, x * speed], axis=-1)[None], dtype=jnp.float32)

generate = jax.jit(
    lambda key: generate_images_from_flow(key, flow, specification, position_bounds=(SIDE, SIDE))[:2]
)
first, _ = jax.block_until_ready(generate(jax.random.PRNGKey(0)))
cpu, wall = time.process_time(), time.perf_counter()
for batch in range(pairs // BATCH):
    images = jax.block_until_ready(generate(jax.random.PRNGKey(batch + 1)))
cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
radius = int(3 * diameters[1] / 2)
print(
    json.dumps(
        {
            "pairs": pairs // BATCH * BATCH,
            "cpu_s": cpu,
            "wall_s": wall,
            "support_px": 2 * radius + 1,
            "mean_counts": float(first[0].mean()),
            "max_counts": float(first[0].max()),
            "versions": {p: version(p) for p in ("synthpix", "jax", "numpy")} | {"python": sys.version.split()[0]},
        }
    )
)
