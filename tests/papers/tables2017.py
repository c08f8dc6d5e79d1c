"""Photographs for lookup tables (2017 TOG, section 4.3) and the same tables by direct sums."""

import numpy as np
from scipy import signal

import truth
from rows import write_exr

MEASURED = 680.0
# A photograph of 1000 × 1000 pixels across half vectors of ±1: spots on a lattice, another brightness each.
SIDE, SCALE, SPOT = 1000, 0.002, 0.004
SPACING = 0.15


def spots():
    """Centres and brightness in table coordinates."""
    index = np.arange(-6, 7)
    i, j = (a.ravel() for a in np.meshgrid(index, index))
    return SPACING * np.stack([i, j], 1), 1 / (1 + 0.3 * (abs(i) + abs(j)) + 0.02 * (i + 2 * j))


def pattern(x, y):
    """Light over half vectors: separable Gaussians, so that large grids are quick."""
    places, bright = spots()
    light = np.zeros(np.broadcast(x, y).shape)
    for (px, py), b in zip(places, bright):
        near = (abs(x - px) < 6 * SPOT) & (abs(y - py) < 6 * SPOT)
        light[near] += b * np.exp(-((x[near] - px) ** 2 + (y[near] - py) ** 2) / (2 * SPOT**2))
    return light


def grid(size, extent=1.0, warp=1):
    """Half vectors of the entries of a table, y up."""
    a = (2 * np.arange(size) + 1) / size - 1
    h = extent * a**warp
    return np.meshgrid(h, -h)


def photograph(folder):
    """The camera sees to the right what has its half vector to the left, so that the photograph is the table turned by 180°."""
    x, y = grid(SIDE)
    write_exr(folder / "photo.exr", Y=pattern(x, y)[::-1, ::-1])


def entries(x, y, exponent=4, step=0.25, light=lambda nm: 1.0):
    """X, Y, Z of Eq. 15 with the power `exponent`, by a trapezoid in fine steps; Y of a constant photograph is 1 at exponent 0."""
    nm = np.arange(380, 780 + step / 2, step)
    seen = truth.observer(nm) * np.array([light(v) for v in nm])
    seen /= seen[1].sum()
    total = np.zeros((3, *x.shape))
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
