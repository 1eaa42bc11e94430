"""A plain NumPy loop that traces every ray of every particle: the yardstick for microsig's run times.

The model of Rossi 2020 (Meas. Sci. Technol. 31 017003) as a straightforward sequence of array operations over all N_s x N_r rays of a particle, in f64. No rays are skipped and nothing is shared between particles.

    yardstick.py SETTINGS DATA           times all particles of a MicroSIG data file (4 columns): one JSON object
    yardstick.py --check FOLDER          compares counts with those stored in tests/data/exact: one JSON object
"""

import json
import sys
import time
from pathlib import Path

import numpy as np

GOLDEN_ANGLE = 2 * np.pi * (1 - 2 / (1 + np.sqrt(5)))


def read_settings(path):
    """The `key = value` lines of a settings file."""
    lines = (line.split("#")[0].split("%")[0] for line in Path(path).read_text().splitlines())
    return {key.strip(): float(value) for key, value in (line.split("=") for line in lines if line.strip())}


def spiral(n):
    """n directions on a golden-angle spiral including the poles: arrays of components along e1, e2, e3."""
    k = np.arange(n)
    cosine = 1 - 2 * k / (n - 1)
    sine = np.sqrt(np.maximum(1 - cosine**2, 0))
    return sine * np.cos(k * GOLDEN_ANGLE), sine * np.sin(k * GOLDEN_ANGLE), cosine


def refract(d, n, index_ratio):
    """Snell's law for unit vectors; NaN for lost rays."""
    cosine = (d * n).sum(axis=0)
    squared = 1 - index_ratio**2 * (1 - cosine**2)
    squared[(cosine <= 0) | (squared < 0)] = np.nan
    return index_ratio * d + (np.sqrt(squared) - index_ratio * cosine) * n


def unit(v):
    return v / np.sqrt((v * v).sum(axis=0))


def trace(settings, x, y, z, d_p, random, angles=None):
    """Ray counts of one sphere on the whole sensor."""
    s = settings
    magnification, f, pixel = s["magnification"], s["focal_length"], s["pixel_size"]
    n_rays = int(s["n_rays"])
    n_points = int(np.rint(s["points_per_pixel"] * 2 * np.pi * (d_p * magnification / pixel) ** 2))

    e1, e2, e3 = (d_p / 2 * c for c in spiral(n_points))
    turn = np.where(e1 > 0, -1.0, 1.0)
    e1, e2 = turn * e1, turn * e2

    d1, d2, d3 = (c[1:-1] for c in spiral(n_rays + 2))
    phase = random.uniform(-np.pi, np.pi, n_points) if angles is None else angles
    cosine, sine = np.cos(phase)[:, None], np.sin(phase)[:, None]
    toward_lens = np.abs(d1 * cosine - d2 * sine)
    p_x = (d1 * sine + d2 * cosine) / toward_lens
    p_y = d3 / toward_lens

    distance = (z + f * (1 + 1 / magnification) + e1)[:, None]
    q_x, q_y = e2[:, None] + distance * p_x, e3[:, None] + distance * p_y
    aperture = np.tan(np.arcsin(s["numerical_aperture"])) * f * (1 + 1 / magnification)
    through = q_x**2 + q_y**2 <= aperture**2
    q_x, q_y, p_x, p_y = q_x[through], q_y[through], p_x[through], p_y[through]

    ratio = s["ri_medium"] / s["ri_lens"]
    radius = np.full_like(q_x, 2 * (1 / ratio - 1) * f)
    d = unit(np.stack([np.ones_like(p_x), p_x, p_y]))
    d = refract(d, unit(np.stack([radius, -q_x, -q_y])), ratio)
    d = refract(d, unit(np.stack([radius, q_x, q_y])), 1 / ratio)
    p_x, p_y = d[1] / d[0], d[2] / d[0]
    behind = d[0] > 0

    way, f_cyl = f * (magnification + 1), s["cyl_focal_length"]
    if f_cyl != 0:
        q_x, q_y = q_x + way / 3 * p_x, q_y + way / 3 * p_y
        p_x = p_x - q_x / f_cyl
        way = way * 2 / 3
    with np.errstate(invalid="ignore"):
        column = np.rint((q_x + way * p_x) / pixel + x)
        row = np.rint((q_y + way * p_y) / pixel + y)
        width, height = int(s["pixel_dim_x"]), int(s["pixel_dim_y"])
        hit = behind & (column >= 1) & (column <= width) & (row >= 1) & (row <= height)
    counts = np.zeros((height, width), dtype=np.int64)
    np.add.at(counts, (row[hit].astype(int) - 1, column[hit].astype(int) - 1), 1)
    return counts, n_points * n_rays


def check(folder):
    """Counts against the stored ones, for all spheres."""
    results = {}
    for phases in sorted(Path(folder).glob("*_phases.npy")):
        name = phases.name.removesuffix("_phases.npy")
        particle = np.loadtxt(phases.with_name(f"{name}.txt"), ndmin=2)[0]
        if len(particle) != 4:
            continue
        settings = read_settings(phases.with_name(f"{name}_settings.txt"))
        stored = np.load(phases.with_name(f"{name}_counts.npy"))
        counts, _ = trace(settings, *particle, None, np.load(phases))
        results[name] = int((counts != stored.reshape(counts.shape)).sum())
    return {"pixels_that_differ": results}


def measure(settings, data):
    """CPU and wall time per particle."""
    settings, particles = read_settings(settings), np.loadtxt(data, ndmin=2)
    random = np.random.default_rng(1)
    trace(settings, *particles[0], random)
    cpu, wall, rays, total = time.process_time(), time.perf_counter(), 0, 0
    for particle in particles:
        counts, n = trace(settings, *particle, random)
        rays, total = rays + n, total + int(counts.sum())
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    n = len(particles)
    return {
        "particles": n,
        "cpu_ms_per_particle": 1e3 * cpu / n,
        "wall_ms_per_particle": 1e3 * wall / n,
        "rays_per_particle": rays / n,
        "counts_per_particle": total / n,
        "numpy": np.__version__,
        "python": sys.version.split()[0],
    }


if __name__ == "__main__":
    first, second = sys.argv[1:3]
    print(json.dumps(check(second) if first == "--check" else measure(first, second)))
