#!/usr/bin/env python3
"""Settings and data files for timing: particles.py FOLDER CYL_FOCAL_LENGTH IMAGES PARTICLES Z_MIN Z_MAX D_MIN D_MAX"""
import random
import sys
from pathlib import Path

folder = Path(sys.argv[1])
cylinder, images, particles = float(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4])
z_min, z_max, d_min, d_max = map(float, sys.argv[5:])
width, height = 752, 366
settings = dict(magnification=10, numerical_aperture=0.3, focal_length=350, ri_medium=1, ri_lens=1.5, pixel_size=6.45)
settings |= dict(pixel_dim_x=width, pixel_dim_y=height, background_mean=350, background_noise=10, points_per_pixel=18)
settings |= dict(n_rays=500, gain=3.2, cyl_focal_length=cylinder)
(folder / "particles").mkdir(parents=True)
(folder / "settings.txt").write_text("".join(f"{key} = {value}\n" for key, value in settings.items()))
random.seed(1)
for image in range(images):
    rows = ""
    for _ in range(particles):
        x, y = random.uniform(0.5, width + 0.5), random.uniform(0.5, height + 0.5)
        rows += f"{x:.4f} {y:.4f} {random.uniform(z_min, z_max):.4f} {random.uniform(d_min, d_max):.6f}\n"
    (folder / "particles" / f"{image:05}.txt").write_text(rows)
