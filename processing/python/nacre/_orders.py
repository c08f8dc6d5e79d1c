"""Balanced powers of grating orders, as `nacre render` computes them, tabulated for renderers.

Scalar theory gives an order the power `|c_m(q)|² (1 + ωi·ωo)² / (cos θi cos θo (cos θi + cos θo)²)` with
`q = 2π/λ (cos θi + cos θo)`. At one wavelength a grating couples finitely many directions; the square matrix of their
powers is scaled by row and column factors until all sums are 1 (Sinkhorn and Knopp 1967).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Wave numbers 1/λ in 1/µm of the tables: wavelengths of 830 to 360 nm, the range of the CIE observers.
NUMBERS = (1 / 0.83, 1 / 0.36)

# Spacing of tabulated powers over `q · depth`.
STEP = 0.01

# Largest number of iterations, and tolerance of the sums.
ROUNDS = 400
BALANCED = 1e-4

# Coupled directions above which powers are scaled by row only, as `nacre render` does.
MAX_DIRECTIONS = 48

# Share of the light in all neglected orders.
NEGLECTED = 1e-3

# Nodes over wave number, latitude (along the grooves) and longitude (across them), for one period and for several.
# The light of orders that rise above the horizon between nodes is interpolated across that edge.
ONE_PERIOD = (49, 61, 121)
MORE_PERIODS = (49, 21, 121)

# Largest ratio of neighbouring periods in a table.
PERIOD_RATIO = 1.06
MAX_PERIODS = 16

# Directions computed at a time.
CHUNK = 2048


class Section:
    """Powers `|c_m|²` of a profile: `sinusoid`, `blazed` or `rectangular` with a duty cycle."""

    def __init__(self, profile: str, depth_um: float, duty: float = 0.5):
        if profile not in ("sinusoid", "blazed", "rectangular"):
            raise ValueError(f"profile is {profile!r}: give sinusoid, blazed or rectangular")
        if not 0 <= depth_um <= 5:
            raise ValueError(f"depth_um is {depth_um}: give 0 to 5 µm")
        self.depth_um = depth_um
        self.even = profile != "blazed"
        phase = np.arange(0, 4 * np.pi * NUMBERS[1] * depth_um + 2 * STEP, STEP)
        most = int(0.5 * phase[-1] + 20 + 6 * np.cbrt(0.5 * phase[-1]))
        m = np.arange(-most, most + 1)
        if profile == "sinusoid":
            count = 8 * most
            turn = np.cos(2 * np.pi * np.arange(count) / count)
            amplitude = np.fft.fft(np.exp(-0.5j * phase[:, None] * turn), axis=1)[:, m % count] / count
        elif profile == "blazed":
            amplitude = np.sinc(phase[:, None] / (2 * np.pi) + m) + 0j
        else:
            raised = np.sinc(m * duty) * duty * np.exp(-1j * np.pi * m * duty)
            amplitude = (m == 0) + (np.exp(-1j * phase[:, None]) - 1) * raised
        power = np.abs(amplitude) ** 2
        beyond = [power[:, np.abs(m) > orders].sum(1).max() for orders in range(most + 1)]
        self.orders = max(1, next(k for k, v in enumerate(beyond) if v <= NEGLECTED))
        self._power = power[:, np.abs(m) <= self.orders]

    def power(self, order: NDArray[np.int64], q: Array) -> Array:
        """Power of an order in scalar theory, for `q` in 1/µm; 0 for neglected orders."""
        place = np.minimum(q * self.depth_um / STEP, len(self._power) - 1.001)
        k = place.astype(np.int64)
        share = place - k
        column = np.clip(order + self.orders, 0, 2 * self.orders)
        found = self._power[k, column] * (1 - share) + self._power[k + 1, column] * share
        return np.where(np.abs(order) <= self.orders, found, 0.0)


def balanced(section: Section, across: Array, along: Array, number: Array, period_um: float) -> Array:
    """Powers (directions, orders) towards directions of view with sines `across` and `along` the grooves."""
    g = 1 / (number * period_um)
    reach = np.sqrt(np.maximum(1 - along**2, 0))
    first = np.minimum(np.ceil((-across - reach) / g), 0).astype(np.int64)
    last = np.maximum(np.floor((-across + reach) / g), 0).astype(np.int64)
    count = int((last - first).max()) + 1
    n = first[:, None] + np.arange(count)
    valid = n <= last[:, None]
    x = across[:, None] + n * g[:, None]
    square = 1 - along[:, None] ** 2 - x**2
    # Limited away from exact grazing, where the gain of scalar theory diverges.
    cos = np.where(n == 0, np.maximum(np.sqrt(np.maximum(square, 0)), 1e-3), np.sqrt(np.maximum(square, 1e-6)))
    lanes = np.arange(len(across))
    view = slice(None) if count <= MAX_DIRECTIONS else -first[:, None]

    def coupling(rows: slice | NDArray[np.int64]) -> Array:
        pick = (lambda v: v) if isinstance(rows, slice) else (lambda v: np.take_along_axis(v, rows, 1))
        c, d = pick(cos)[:, :, None], cos[:, None, :]
        dot = c * d - along[:, None, None] ** 2 - pick(x)[:, :, None] * x[:, None, :]
        order = pick(n)[:, :, None] - n[:, None, :]
        power = section.power(order, 2 * np.pi * number[:, None, None] * (c + d))
        found: Array = power * (1 + dot) ** 2 / (c * d * (c + d) ** 2) * pick(valid)[:, :, None] * valid[:, None, :]
        return found

    matrix = coupling(view)
    if count <= MAX_DIRECTIONS:
        rows, columns = _factors_even(matrix) if section.even else _factors(matrix)
        row = matrix[lanes, -first] * rows[lanes, -first][:, None] * columns
    else:
        row = matrix[:, 0]
        row = row / np.maximum(row.sum(1, keepdims=True), 1e-300)
    powers = np.zeros((len(across), 2 * section.orders + 1))
    for m in range(-section.orders, section.orders + 1):
        k = -m - first
        inside = (k >= 0) & (k < count)
        powers[inside, m + section.orders] = row[lanes[inside], k[inside]]
    return powers


def _factors(matrix: Array) -> tuple[Array, Array]:
    """Row and column factors that make square matrices doubly stochastic."""
    rows = np.ones(matrix.shape[:2])
    for _ in range(ROUNDS // 2):
        columns = 1 / np.maximum(np.einsum("lkn,lk->ln", matrix, rows), 1e-12)
        sums = np.einsum("lkn,ln->lk", matrix, columns)
        worst = np.abs(rows * sums - 1)[sums > 0].max()
        rows = 1 / np.maximum(sums, 1e-12)
        if worst < BALANCED:
            break
    return rows, columns


def _factors_even(matrix: Array) -> tuple[Array, Array]:
    """The factors of symmetric matrices; every third step is a square root, which damps slow oscillations."""
    rows = np.ones(matrix.shape[:2])
    for k in range(ROUNDS):
        sums = rows * (matrix @ rows[:, :, None])[:, :, 0]
        lit = sums > 0
        if np.abs(sums[lit] - 1).max() < BALANCED:
            break
        rows = rows / np.where(lit, np.sqrt(sums) if k % 3 == 0 else sums, 1)
    return rows, rows


@dataclass
class PowerTable:
    """Powers over orders (`-orders` to `orders`), periods, wave numbers, latitudes and longitudes of the view.

    A view with the sines `along` = sin(latitude) and `across` = cos(latitude) sin(longitude) lies at latitudes from 0 to
    90° and longitudes from -90° to 90°. Wave numbers are even over `NUMBERS`, periods even in their logarithm.
    """

    orders: int
    periods: tuple[float, float]
    values: NDArray[np.float32]

    @classmethod
    def of(cls, section: Section, shortest_um: float, longest_um: float) -> PowerTable:
        if not 0.05 <= shortest_um <= longest_um <= 200:
            raise ValueError(f"periods are {shortest_um} to {longest_um} µm: give 0.05 to 200 µm")
        count = int(np.ceil(np.log(longest_um / shortest_um) / np.log(PERIOD_RATIO) - 1e-9)) + 1
        periods = np.geomspace(shortest_um, longest_um, min(count, MAX_PERIODS))
        nodes = ONE_PERIOD if len(periods) == 1 else MORE_PERIODS
        limits = (NUMBERS, (0, np.pi / 2), (-np.pi / 2, np.pi / 2))
        axes = [np.linspace(*limit, n) for limit, n in zip(limits, nodes)]
        number, latitude, longitude = (v.ravel() for v in np.meshgrid(*axes, indexing="ij"))
        across, along = np.cos(latitude) * np.sin(longitude), np.sin(latitude)
        rows = []
        for period in periods:
            for at in range(0, len(number), CHUNK):
                part = slice(at, at + CHUNK)
                rows.append(balanced(section, across[part], along[part], number[part], float(period)))
        shape = (len(periods), *nodes, 2 * section.orders + 1)
        values = np.moveaxis(np.concatenate(rows).reshape(shape), -1, 0)
        # Higher orders never lie above the horizon.
        orders = min(section.orders, int(np.ceil(2 * longest_um * NUMBERS[1])))
        values = values[section.orders - orders : section.orders + orders + 1]
        return cls(orders, (shortest_um, longest_um), values.astype(np.float32))
