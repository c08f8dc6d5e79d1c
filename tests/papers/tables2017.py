"""Photographs for lookup tables (2017 TOG, section 4.3) and the same tables by direct sums."""

import numpy as np
from scipy import signal

import truth
from rows import write_exr

MEASURED = 680.0
# A photograph of 1000 × 1000 pixels across half vectors of ±1: spots on a lattice, another brightness each.
SIDE, SCALE, SPOT = 1000, 0.002, 0.004
SPACING = 0.15


INDEX = np.arange(-6, 7)


def brightness():
    """Of the spot in row j and column i of the lattice; unlike its own mirror images."""
    i, j = np.meshgrid(INDEX, INDEX)
    return 1 / (1 + 0.3 * (abs(i) + abs(j)) + 0.02 * (i + 2 * j))


def pattern(x, y):
    """Light over half vectors of a grid of columns x and rows y."""
    along = lambda h: np.exp(-((h[:, None] - SPACING * INDEX) ** 2) / (2 * SPOT**2))
    return along(y) @ brightness() @ along(x).T


def grid(size, extent=1.0, warp=1):
    """Half vectors of the entries of a table, y up."""
    a = (2 * np.arange(size) + 1) / size - 1
    h = extent * a**warp
    return np.meshgrid(h, -h)


def lines(size, extent=1.0, warp=1):
    """Half vectors of the columns and rows of a table, rows from the top."""
    x, y = grid(size, extent, warp)
    return x[0], y[:, 0]


def photograph(folder):
    """The camera sees to the right what has its half vector to the left, so that the photograph is the table turned by 180°."""
    x, y = lines(SIDE)
    write_exr(folder / "photo.exr", Y=pattern(x, y)[::-1, ::-1])


def entries(x, y, exponent=4, step=0.25, light=lambda nm: 1.0):
    """X, Y, Z of Eq. 15 with the power `exponent`, by a trapezoid in fine steps; Y of a constant photograph is 1 at exponent 0."""
    nm = np.arange(380, 780 + step / 2, step)
    seen = truth.observer(nm) * np.array([light(v) for v in nm])
    seen /= seen[1].sum()
    x, y = x[0], y[:, 0]
    total = np.zeros((3, y.size, x.size))
    for k, v in enumerate(nm):
        total += seen[:, k, None, None] * ((MEASURED / v) ** exponent * pattern(x * MEASURED / v, y * MEASURED / v))
    return total


def rim(table, right, x, y):
    """RMS difference of all three channels at radii of 0.8 to 0.9 over the table's own there."""
    at = (np.hypot(x, y) > 0.8) & (np.hypot(x, y) < 0.9)
    return np.sqrt(((table - right)[:, at] ** 2).sum() / (right[:, at] ** 2).sum())


def spread(table, picture):
    """A table spread with a light's picture: every point of the light adds it once more."""
    picture = picture / picture.sum()
    return np.array([signal.fftconvolve(np.nan_to_num(channel), picture, "same") for channel in table])
