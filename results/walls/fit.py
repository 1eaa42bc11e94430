"""The polynomials of `crates/flows/src/hindered.rs`, fitted to exact.csv and to Brenner's series.

    env/bin/python fit.py

Each law, a resistance or an inverse slip, is the part that is singular at contact (lubrication theory with the constants of Chaoui and
Feuillebois 2003) plus a polynomial in A = radius / distance of the center. The far field gives its first three coefficients, least squares
of the relative error the others. Their sum is the constant of lubrication theory, which is 1.1139 along the wall and 0.6647 for the slip.
"""

import csv

import numpy as np
from exact import normal

ROWS = [{k: float(v) for k, v in row.items()} for row in csv.DictReader(open("exact.csv"))]


def fit(name, a, target, singular, first, degree, slow=False):
    """Prints the coefficients: `slow` is that of (1 - A) log, the next term of lubrication theory; `first` are the series of target minus
    `singular` at small A. Returns the relative errors."""
    log = -np.log1p(-a)
    powers = np.arange(len(first), degree + 1)
    columns = a[:, None] ** powers
    if slow:
        columns = np.column_stack([(1 - a) * log - a + a * a / 2, columns])
    rest = target - singular - np.polynomial.polynomial.polyval(a, first)
    found = np.linalg.lstsq(columns / target[:, None], rest / target, rcond=None)[0]
    c = found[0] if slow else 0
    all_ = np.concatenate([first - c * np.array([0, 1, -0.5])[: len(first)], found[int(slow) :]])
    c, all_ = np.round(c, 6), np.round(all_, 6)
    error = (singular + c * (1 - a) * log + np.polynomial.polynomial.polyval(a, all_)) / target - 1
    print(name, float(c), list(map(float, all_)), f"sum {all_.sum():.5f}, largest relative error {np.abs(error).max():.1e}")
    return error


def series(singular):
    """Coefficients of the first three powers of A of a function of A."""
    b = np.arange(6) * 2e-3
    return np.linalg.solve(np.vander(b, 6, increasing=True), singular(b))[:3]


def main():
    h = np.array([row["distance"] for row in ROWS])
    a = 1 / h
    along = lambda a: -np.log1p(-a) / 2 - 0.10883 / (0.3709 - 0.4 * np.log1p(-a))
    slip = lambda a: -np.log1p(-a) * 0.26913 - 0.0342 / (0.50929 - 0.74313 * np.log1p(-a))
    for name, law, far, degree in (("mobility_along", along, [1, 9 / 16, 81 / 256], 5), ("slip", slip, [1, 0, 0], 6)):
        target = np.array([1 / row[name] for row in ROWS])
        fit(name, a, target, law(a), np.array(far) - series(law), degree, slow=True)
    g = np.geomspace(1e-4, 300, 300)
    exact, a = np.array([normal(x) for x in 1 + g]), 1 / (1 + g)
    fit("mobility_across", a, exact, 1 / g + 0.2 * np.log((1 + g) / g), np.array([1, 9 / 8 - 1.2, 81 / 64 - 1.1]), 6)
    bevan = (6 * g * g + 9 * g + 2) / (6 * g * g + 2 * g) / exact - 1
    print(f"Bevan and Prieve: largest relative error {np.abs(bevan).max():.1e} at gap {g[np.abs(bevan).argmax()]:.2g}")


if __name__ == "__main__":
    main()
