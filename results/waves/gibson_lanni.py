"""Images of points below a cover slip against an integral of our own, and that against MicroscPSF-Py.

    python -m venv env && env/bin/pip install numpy scipy tifffile MicroscPSF-Py==0.2
    env/bin/python gibson_lanni.py MICROSIG

The path differences are those of Gibson and Lanni (1991). MicroscPSF-Py has no amplitude over the pupil, microsig that of an aplanatic
lens, so that the integral is evaluated with both: 1 against MicroscPSF-Py, and A(s) = (2 pi n_s sqrt(n_s^2 - s^2))^(-1/2), averaged
over pixels, against images, in absolute units (the share of the light that a point emits). Differences are relative to the peak.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import tifffile
from microscPSF import microscPSF
from scipy.special import j0

WAVELENGTH_UM, MAGNIFICATION, PIXEL_UM, SIZE = 0.52, 100, 5.0, 81
PHOTONS = 1e9
# NA, layers, depths below the cover slip, um
WATER = dict(n_s=1.33, n_g=1.515, n_g_design=1.515, t_g_um=170, t_g_design_um=170)
CASES = [
    (0.30, dict(WATER, n_i=1.0, n_i_design=1.0, t_i_design_um=1000, focus_depth_um=100), (80, 100, 120)),
    (0.75, dict(WATER, n_i=1.0, n_i_design=1.0, t_i_design_um=500, focus_depth_um=20), (15, 20, 22)),
    (1.20, dict(WATER, n_i=1.33, n_i_design=1.33, t_i_design_um=280, focus_depth_um=20, t_g_um=171), (18, 20, 21)),
    (1.40, dict(WATER, n_s=1.45, n_i=1.515, n_i_design=1.515, t_i_design_um=150, focus_depth_um=5), (4, 5, 6)),
]


def immersion(n):
    """Thickness of the immersion that brings the focus to its depth, um."""
    reduced = n["t_i_design_um"] / n["n_i_design"] + n["t_g_design_um"] / n["n_g_design"] - n["t_g_um"] / n["n_g"]
    return n["n_i"] * (reduced - n["focus_depth_um"] / n["n_s"])


def path(s, depth, n):
    """Optical path relative to the design, um, of a ray with index times sine s."""
    def along(t, index):
        return t * np.sqrt(index**2 - s**2)

    return (along(depth, n["n_s"]) + along(n["t_g_um"], n["n_g"]) - along(n["t_g_design_um"], n["n_g_design"])
            + along(immersion(n), n["n_i"]) - along(n["t_i_design_um"], n["n_i_design"]))


def light(r, na, depth, n, amplitude):
    """Intensity at radii in object space, um: |k int A exp(i k W) J0(k s r) s ds|^2."""
    s, weight = np.polynomial.legendre.leggauss(1500)
    s, weight = 0.5 * na * (s + 1), 0.5 * na * weight
    k = 2 * np.pi / WAVELENGTH_UM
    pupil = k * weight * s * amplitude(s) * np.exp(1j * k * path(s, depth, n))
    return np.abs(j0(k * np.outer(r, s)) @ pupil) ** 2


def image(na, depth, n):
    """The share of the light of a point, emitted in all directions, on each pixel."""
    fine, edge = 5, PIXEL_UM / MAGNIFICATION
    nodes, weight = np.polynomial.legendre.leggauss(fine)
    at = (np.arange(SIZE) - SIZE // 2)[:, None] * edge + 0.5 * edge * nodes
    at = at.ravel()
    radius = np.hypot(at[:, None], at[None, :])
    known = np.linspace(0, radius.max() * 1.001, 6000)
    curve = light(known, na, depth, n, lambda s: (2 * np.pi * n["n_s"] * np.sqrt(n["n_s"] ** 2 - s**2)) ** -0.5)
    shares = np.interp(radius, known, curve)
    weight = np.tile(0.5 * weight * edge, SIZE)
    shares = shares * weight[:, None] * weight[None, :]
    # Half of the light goes into the half space of the objective.
    return 0.5 * shares.reshape(SIZE, fine, SIZE, fine).sum(axis=(1, 3))


def images_of_microsig(program, folder, na, depths, n):
    rows = [f"{i},{i},0,0,{depth - n['focus_depth_um']}" for i, depth in enumerate(depths)]
    (folder / "points.csv").write_text("\n".join(["frame,track,x_um,y_um,z_um", *rows]) + "\n")
    layers = ", ".join(f"{key}: {value}" for key, value in n.items())
    (folder / "points.ron").write_text(f"""(
        name: "points",
        optics: (magnification: {MAGNIFICATION}, numerical_aperture: {na}, pixel_size: {PIXEL_UM}, pixel_dim_x: {SIZE},
            pixel_dim_y: {SIZE}, background_mean: 0, background_noise: 0, points_per_pixel: 1e6, lens: aplanatic, layers: ({layers})),
        motion: tracks(file: "points.csv"),
        particles: (diameter_um: constant(0.002), photons: (emitted: constant({PHOTONS}))),
        timing: sequence(frames: {len(depths)}, dt_s: 0.01),
        boundaries: (z_um: ({min(depths) - n['focus_depth_um']}, {max(depths) - n['focus_depth_um']})),
        render: (mode: waves, wavelength_um: {WAVELENGTH_UM}, tolerance: 0.001, emission: volume), image_format: float32)""")
    subprocess.run([program, "generate", folder / "points.ron", "--out", folder / "points", "--quiet"], check=True)
    return [tifffile.imread(path) / PHOTONS for path in sorted((folder / "points/images").glob("*.tif"))]


def main():
    program = Path(sys.argv[1]).resolve()
    print("| NA | depth, um | integral against MicroscPSF-Py | image against integral | light within the image |")
    print("|---|---|---|---|---|")
    for na, n, depths in CASES:
        design = dict(M=MAGNIFICATION, NA=na, ng=n["n_g"], ng0=n["n_g_design"], ni=n["n_i"], ni0=n["n_i_design"], ns=n["n_s"],
                      tg=n["t_g_um"], tg0=n["t_g_design_um"], ti0=n["t_i_design_um"], zd0=2e5)
        with tempfile.TemporaryDirectory() as folder:
            drawn = images_of_microsig(program, Path(folder), na, depths, n)
        for depth, found in zip(depths, drawn):
            r = np.linspace(0, 2, 201)
            moved = np.array([immersion(n) - n["t_i_design_um"]])
            theirs = microscPSF.gLZRFocalScanSlow(design, r, moved, normalize=False, pz=depth, wvl=WAVELENGTH_UM)[0]
            ours = light(r, na, depth, n, np.ones_like)
            curve = np.abs(theirs / theirs.max() - ours / ours.max()).max()
            wanted = image(na, depth, n)
            error = np.abs(found - wanted).max() / wanted.max()
            print(f"| {na} | {depth} | {curve:.1e} | {error:.1e} | {found.sum() / wanted.sum() - 1:+.1e} |", flush=True)


main()
