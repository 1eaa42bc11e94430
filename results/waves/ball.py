"""The central pixel of a bead that is dyed throughout, by a direct integral over the ball.

The light of every ring of emitters is the sum over all orders m of |U_m|^2 (Graf's addition theorem), with the pupil of MicroSIG's lens
(docs/model.md) at 240 radii, and integrated over the pixel with 20 x 20 points. Prints the fraction of the light sent into the half space
that falls on the pixel on the axis, for setting 1 at 0.52 um, with more and more depths and circles, and without coma (each emitter has the
image of one on the axis, displaced by the magnification).

    python ball.py        # numpy, scipy; a few minutes
"""
import numpy as np
from numpy.polynomial import legendre
from scipy.interpolate import CubicSpline
from scipy.special import jv, roots_legendre

M, NA, F, N_MEDIUM, N_LENS, PIXEL = 10, 0.3, 350.0, 1.0, 1.5, 6.45
K = 2 * np.pi / 0.52
A0, B = F * (1 + 1 / M), F * (M + 1)
APERTURE = np.tan(np.arcsin(NA)) * A0
FACE, INDEX = 2 * (N_LENS / N_MEDIUM - 1) * F, N_MEDIUM / N_LENS

NODES = 240
node, node_weight = roots_legendre(NODES)
q = 0.5 * APERTURE * (node + 1)
sigma, stretch = q / np.sqrt(1 + (q / A0) ** 2), (1 + (q / A0) ** 2) ** -1.5
weight = 0.5 * APERTURE * node_weight * sigma * stretch
to_series = (legendre.legvander(node, NODES - 1) * node_weight[:, None]).T * ((2 * np.arange(NODES) + 1) / 2)[:, None]


def running(values):
    """Integral over q from 0."""
    return 0.5 * APERTURE * legendre.legval(node, legendre.legint(to_series @ values, lbnd=-1))


def refract(direction, normal, index):
    cosine = (direction * normal).sum(0)
    return index * direction + (np.sqrt(1 - index**2 * (1 - cosine**2)) - index * cosine) * normal


def unit(v):
    return v / np.sqrt((v * v).sum(0))


def slope(distance, offset):
    """Slope behind the lens of the ray through q from an emitter off the axis."""
    face = np.full(NODES, FACE)
    inside = refract(unit(np.array([np.ones(NODES), (q - offset) / distance])), unit(np.array([face, -q])), INDEX)
    behind = refract(inside, unit(np.array([face, q])), 1 / INDEX)
    return behind[1] / behind[0]


def pupil(z):
    """Complex amplitude, and the derivative of the phase with respect to the emitter's offset."""
    a = A0 + z
    path = running(slope(a, 0.0) * stretch) + A0**2 * (1 - np.sqrt(1 - (sigma / A0) ** 2)) / B
    off_axis = running((slope(a, 0.02) - slope(a, -0.02)) / 0.04 * stretch)
    density = a / (2 * np.pi * (a * a + q * q) ** 1.5)
    amplitude = np.sqrt(density * np.sqrt(1 + (q / A0) ** 2) / stretch)
    return K / B * amplitude * np.exp(1j * K * path) * weight, off_axis


radii = np.linspace(0, 0.72 * PIXEL, 60)


def central_pixel(z, radius, depths, circles, coma=True):
    orders = int(1.4 * K * NA * radius) + 20
    kernels = [jv(m, K * np.outer(sigma, radii) / B) for m in range(orders)]
    x, of_depth = roots_legendre(depths)
    area, of_circle = roots_legendre(circles)
    light = np.zeros_like(radii)
    for u, wu in zip(x, of_depth):
        amplitude, off_axis = pupil(z + radius * u)
        if not coma:
            off_axis = -sigma / A0
        for c, wc in zip(0.5 * (area + 1), 0.5 * of_circle):
            rho, share = radius * np.sqrt((1 - u * u) * c), 0.75 * (1 - u * u) * wu * wc
            for m, kernel in enumerate(kernels):
                field = (amplitude * jv(m, K * rho * np.abs(off_axis))) @ kernel
                light += share * (1 if m == 0 else 2) * np.abs(field) ** 2
    g, w = roots_legendre(20)
    x, w = 0.25 * PIXEL * (g + 1), 0.25 * PIXEL * w
    at = CubicSpline(radii, light, bc_type=((1, 0.0), "not-a-knot"))
    return 4 * (np.outer(w, w) * at(np.hypot(*np.meshgrid(x, x)))).sum()


for d, z in [(5, -60), (2, -40), (10, -80), (10, -40)]:
    etendue = K * NA * d / 2
    for more in (0, 8, 12):
        depths, circles = int(np.ceil(3 + etendue)) + more, int(np.ceil(2 + 0.5 * etendue)) + more
        print(f"d {d}, z {z}, {depths} x {circles}: {central_pixel(z, d / 2, depths, circles):.8e}", flush=True)
for d, z, depths, circles in [(5, -60, 13, 3), (5, -60, 13, 4), (10, -80, 22, 10)]:
    print(f"d {d}, z {z}, {depths} x {circles}: {central_pixel(z, d / 2, depths, circles):.8e}", flush=True)
for d, z in [(5, -60), (2, -40)]:
    print(f"d {d}, z {z}, without coma: {central_pixel(z, d / 2, 24, 14, coma=False):.8e}", flush=True)
