"""A sphere near a plane wall, solved numerically: the reference for the laws of `crates/flows/src/hindered.rs`.

    python -m venv env && env/bin/pip install numpy scipy
    env/bin/python exact.py > exact.csv

Parallel motion: the flow is that of point forces on rings inside the sphere, each with its images in the wall (Blake, Proc. Camb. Phil.
Soc. 70 (1971) 303), whose strengths give the velocity of the sphere at its surface (least squares). Their sum is the force and their
moment the torque, from which the mobility of a sphere without torque follows, and the velocity of a free sphere in a shear flow. The rings
lie on a sphere of bispherical coordinates, so that they are dense in the gap. Motion toward the wall: Brenner's series (1961). Lengths in
radii; `residual` is the largest error of the velocity on the surface.
"""

import sys

import numpy as np

# Distances of the center in radii: those of Goldman, Cox and Brenner (1967), and others.
DISTANCES = [10.0677, 3.7622, 2.3524, 1.5431, 1.1276, 1.0453, 1.005004, 1.003202]
DISTANCES += [50, 20, 7, 5, 3, 2, 1.8, 1.35, 1.2, 1.1, 1.07, 1.03, 1.02, 1.01, 1.007, 1.0015]


def blake(x, y):
    """Velocity at x per force of 8 pi mu at y, above a wall at z = 0: arrays (..., 3), result (..., 3, 3)."""
    delta = np.eye(3)
    r, big = x - y, x - y * [1, 1, -1]
    h = y[..., 2][..., None, None]
    n, m = np.linalg.norm(r, axis=-1)[..., None, None], np.linalg.norm(big, axis=-1)[..., None, None]
    rr, pp = r[..., :, None] * r[..., None, :], big[..., :, None] * big[..., None, :]
    free = delta / n + rr / n**3 - delta / m - pp / m**3
    e3 = delta[2]
    across, along = big[..., 2][..., None, None], big[..., None, :]
    source = delta / m**3 - 3 * pp / m**5
    stokes = (-e3[:, None] * along + delta * across + big[..., :, None] * e3) / m**3 - 3 * pp * across / m**5
    return free + 2 * h * (h * source - stokes) * [1, 1, -1]


def parallel(height, rings, around):
    """Resistances of a sphere of radius 1: force and torque of translation, rotation, and shear; residual."""
    alpha = np.arccosh(height)
    c = np.sinh(alpha)

    def ring(xi, count):
        # As dense in the gap (eta near pi) as the distance of the rings from the surface requires, and on the far side
        # (eta of the order of alpha).
        fine = np.pi * np.linspace(0, 1, 20001) ** 2
        number = fine / alpha + 3 * np.log1p(2 * fine / alpha)
        eta = np.interp((np.arange(count) + 0.5) / count * number[-1], number, fine)
        d = np.cosh(xi) - np.cos(eta)
        return c * np.sin(eta) / d, c * np.sinh(xi) / d

    inner = alpha * 1.8 if alpha < 0.8 else alpha + 0.64
    (rho, z), (rho_c, z_c) = ring(inner, rings), ring(alpha, 2 * rings)
    phi = (np.arange(around) + 0.5) * 2 * np.pi / around
    cos, sin = np.cos(phi), np.sin(phi)
    zero = np.zeros_like(rho_c)
    front, side = np.stack([rho_c, zero, z_c], -1), np.stack([zero, rho_c, z_c], -1)
    # Unit strengths along r (cos phi), phi (-sin phi) and z (cos phi), as vectors at each angle.
    units = np.stack([np.stack([cos * cos, cos * sin, 0 * phi], -1), np.stack([sin * sin, -sin * cos, 0 * phi], -1),
                      np.stack([0 * phi, 0 * phi, cos], -1)], -1) / around
    matrix = np.empty((3 * len(rho_c), 3 * rings))
    for k in range(rings):
        y = np.stack([rho[k] * cos, rho[k] * sin, 0 * phi + z[k]], -1)
        u = np.einsum("cfij,fjk->cik", blake(front[:, None], y[None]), units)
        v = np.einsum("cfj,fjk->ck", blake(side[:, None], y[None])[..., 0, :], units)
        matrix[:, 3 * k:3 * k + 3] = np.concatenate([u[:, 0], u[:, 2], v])
    one = zero + 1
    right = np.stack([np.concatenate([one, zero, one]), np.concatenate([z_c - height, -rho_c, z_c - height]),
                      -np.concatenate([z_c, zero, z_c])], -1)
    strengths = np.linalg.lstsq(matrix, right, rcond=1e-15)[0]
    residual = np.abs(matrix @ strengths - right).max()
    r, p, w = (strengths[i::3] for i in range(3))
    force = 8 * np.pi * (0.5 * r + 0.5 * p).sum(0)
    arm = (z - height)[:, None]
    torque = 8 * np.pi * (arm * 0.5 * (r + p) - rho[:, None] * 0.5 * w).sum(0)
    return force, torque, residual


def normal(height):
    """Resistance to motion toward the wall over that far away (Brenner 1961, Eq. 2.19)."""
    alpha = np.arccosh(height)
    n = np.arange(1, int(60 / alpha) + 10)
    # Divided by exp((2 n + 1) alpha), which would overflow.
    e = np.exp(-(2 * n + 1) * alpha)
    numerator = (1 - e * e) + (2 * n + 1) * np.sinh(2 * alpha) * e
    half = (1 - e) ** 2 - (2 * n + 1) ** 2 * np.sinh(alpha) ** 2 * e
    terms = n * (n + 1) / ((2 * n - 1) * (2 * n + 3)) * (numerator / half - 1)
    return 4 / 3 * np.sinh(alpha) * terms.sum()


def row(height):
    rings, around = (40, 120) if height > 1.3 else (80, 350) if height > 1.015 else (150, 500)
    force, torque, residual = parallel(height, rings, around)
    resistance = np.array([[force[0], force[1]], [torque[0], torque[1]]])
    mobility = 6 * np.pi * np.linalg.inv(resistance)[0, 0]
    slip = -np.linalg.solve(resistance, [force[2], torque[2]])[0] / height
    scaled = (force[0] / (6 * np.pi), force[1] / (6 * np.pi), torque[0] / (8 * np.pi), torque[1] / (8 * np.pi),
              -force[2] / (6 * np.pi * height), -torque[2] / (4 * np.pi))
    return (height, *scaled, mobility, slip, 1 / normal(height), residual)


if __name__ == "__main__":
    print("distance,f_t,f_r,t_t,t_r,f_s,t_s,mobility_along,slip,mobility_across,residual")
    for height in sorted(DISTANCES, reverse=True):
        print(",".join(f"{value:.7g}" for value in row(height)), flush=True)
        print(height, file=sys.stderr)
