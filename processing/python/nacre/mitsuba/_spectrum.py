"""Colours of wave numbers 1/λ, for variants with RGB and for tables in spectral ones."""

from __future__ import annotations

from typing import Any

import drjit
import mitsuba
import numpy as np
from numpy.typing import NDArray

# Types depend on the variant, which is set at run time.
dr: Any = drjit
mi: Any = mitsuba

Array = NDArray[np.float64]

# Visible wave numbers in 1/µm, 780 to 380 nm, as in `nacre render`.
RANGE = (1 / 0.78, 1 / 0.38)
POINTS = 2001

# Linear sRGB of X, Y, Z (IEC 61966-2-1).
SRGB = np.array([[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]])

# Parts of D65 that stand for red, green and blue: boundaries and width of their transitions in nm.
MEET_NM = (495.0, 585.0)
SOFT_NM = 12.0


def _spectral(function: Any, nm: Array) -> Array:
    """Values of a function of Mitsuba at wavelengths: (values, wavelengths)."""
    if "scalar" in mi.variant():
        found = [np.atleast_1d(np.array(function(float(v)), dtype=np.float64).ravel()) for v in nm]
        return np.stack(found, axis=-1)
    found = function(mi.Float(nm.astype(np.float32)))
    return np.atleast_2d(np.array(found, dtype=np.float64))


def points() -> Array:
    """Wave numbers of the tables."""
    return np.linspace(*RANGE, POINTS)


def colors() -> Array:
    """Linear sRGB of D65 per wave number, at `points`: (points, 3). Its sum is the colour of white."""
    number = points()
    nm = 1e3 / number
    light = _spectral(mi.cie_d65, nm).reshape(-1)
    xyz = _spectral(mi.cie1931_xyz, nm).reshape(3, -1) * light / number**2
    step = number[1] - number[0]
    weight = np.full(POINTS, step)
    weight[[0, -1]] *= 0.5
    rgb: Array = (SRGB @ (xyz / (xyz[1] * weight).sum())).T
    # White is (1, 1, 1), although the spectrum is truncated.
    white: Array = (rgb * weight[:, None]).sum(0)
    return rgb / white


def parts() -> Array:
    """Spectra of unit red, green and blue at `points`: mixtures of three parts, exact under D65. (points, 3)"""
    nm = 1e3 / points()
    low, high = [0.5 + 0.5 * np.tanh((nm - at) / SOFT_NM) for at in MEET_NM]
    raw = np.stack([high, low - low * high, 1 - low], axis=-1)
    step = (RANGE[1] - RANGE[0]) / (POINTS - 1)
    mixed = np.einsum("pj,pc->cj", raw, colors()) * step
    found: Array = raw @ np.linalg.inv(mixed)
    return found


def texture(kind: Any, values: Array, **options: Any) -> Any:
    """A texture of Mitsuba's present variant from an array (…, channels)."""
    return kind(mi.TensorXf(np.ascontiguousarray(values, dtype=np.float32)), **options)


def texel(share: Any, count: int) -> Any:
    """Texture coordinate of a position from 0 to 1 between the centres of the first and last of `count` texels."""
    return (share * (count - 1) + 0.5) / count


def share_of(value: Any, limits: tuple[float, float]) -> Any:
    """Position within limits, 0 to 1, clamped."""
    return dr.clip((value - limits[0]) / (limits[1] - limits[0]), 0.0, 1.0)
