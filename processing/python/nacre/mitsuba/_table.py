"""Tables over half vectors (`lut.exr`): `f = S(ωi + ωo) (1 + ωi·ωo)²` over the reflected light of a white sky.

As in `nacre render`, the table is scaled to an albedo at normal incidence, and a view that would reflect more than all
light is divided by the excess.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _spectrum
from ._spectrum import POINTS, RANGE, dr, mi, share_of, texel, texture

Array = NDArray[np.float64]

# Cells along a side of the disc of direction cosines, for the albedo and for sampling.
CELLS = 192

# Samples along a side of a cell of the table.
SUBCELLS = 6

# Heights and azimuths of the sums over directions of light.
DIRECTIONS = (1536, 3072)

# Terms of `4 (1 + ωi·ωo)² = (h² + (zi + zo)²)²`: exponents of h², zi and zo, and the coefficient.
TERMS = [
    (2, 0, 0, 1), (1, 2, 0, 2), (1, 1, 1, 4), (1, 0, 2, 2),
    (0, 4, 0, 1), (0, 3, 1, 4), (0, 2, 2, 6), (0, 1, 3, 4), (0, 0, 4, 1),
]  # fmt: skip
POWERS = 5


class Lut:
    """A table in linear sRGB relative to its illuminant, rows upwards."""

    def __init__(self, path: str):
        from nacre import read_maps

        maps = read_maps(path)
        if not {"X", "Y", "Z"} <= set(maps) or "extent" not in maps.attributes:
            raise ValueError(f"{path} is no lut.exr of nacre reconstruct lut")
        if "white" not in maps.attributes:
            raise ValueError(f"{path} has no attribute white: make it again with this version of Nacre")
        self.extent = float(maps.attributes["extent"])
        self.warp = float(maps.attributes.get("warp", 1))
        white = _spectrum.SRGB @ np.array([float(v) for v in maps.attributes["white"].split()])
        xyz = np.nan_to_num(np.stack([maps[c] for c in "XYZ"], axis=-1).astype(np.float64))
        self.rgb: Array = (xyz @ _spectrum.SRGB.T / white)[::-1]

    def at(self, x: Array, y: Array) -> Array:
        """Linear interpolation between entries; 0 outside."""
        size = len(self.rgb)
        place = [np.clip((self.even(v) + 1) * 0.5 * size - 0.5, 0, size - 1.001) for v in (x, y)]
        (i, j), (u, v) = [p.astype(int) for p in place], [(p % 1)[..., None] for p in place]
        low = self.rgb[j, i] * (1 - u) + self.rgb[j, i + 1] * u
        high = self.rgb[j + 1, i] * (1 - u) + self.rgb[j + 1, i + 1] * u
        inside = (np.abs(x) <= self.extent) & (np.abs(y) <= self.extent)
        found: Array = np.where(inside[..., None], low * (1 - v) + high * v, 0.0)
        return found

    def even(self, v: Array) -> Array:
        """Position of a half vector among the entries, -1 to 1."""
        found: Array = np.sign(v) * (np.abs(v) / self.extent) ** (1 / self.warp)
        return found

    def means(self, first: float, cell: float, count: int) -> tuple[Array, Array, Array]:
        """Means of the table, of the table times h², and times h⁴ over square cells from `first` on."""
        within = (np.arange(SUBCELLS) + 0.5) / SUBCELLS
        centre = first + cell * np.arange(count)
        sums = [np.zeros((count, count, 3)) for _ in range(3)]
        for down in within:
            for across in within:
                x, y = np.meshgrid(centre + cell * across, centre + cell * down)
                rgb, square = self.at(x, y), (x**2 + y**2)[..., None]
                for k in range(3):
                    sums[k] += rgb * square**k / SUBCELLS**2
        return sums[0], sums[1], sums[2]


def white_sky(lut: Lut) -> Array:
    """Reflection of a white sky times the cosine of view, as a polynomial in that cosine: (rows, columns, powers, 3)."""
    cell = 2 / CELLS
    z, azimuth = ((np.arange(n) + 0.5) / n for n in DIRECTIONS)
    flat = np.sqrt(1 - z**2)
    columns, rows = (
        np.minimum((1 + flat[:, None] * f(2 * np.pi * azimuth)) / cell, CELLS - 1).astype(int) for f in (np.cos, np.sin)
    )
    solid_angle = 2 * np.pi / (DIRECTIONS[0] * DIRECTIONS[1])
    at = (rows * CELLS + columns).ravel()
    light = [
        np.bincount(at, np.repeat(z**k * solid_angle, DIRECTIONS[1]), CELLS**2).reshape(CELLS, CELLS)
        for k in range(POWERS)
    ]
    # Entry k of a row lies at the half vector -2 + (k + 1) cell, the sum of two centres of cells.
    size = 2 * CELLS - 1
    entries = lut.means(-2 + 0.5 * cell, cell, size)
    shape = (size + CELLS, size + CELLS)
    # The sum over light at l of S(l + v) m(l) is a correlation.
    moments = [np.fft.rfft2(m, shape) for m in light]
    found = np.zeros((CELLS, CELLS, POWERS, 3))
    for channel in range(3):
        tables = [np.fft.rfft2(e[..., channel], shape) for e in entries]
        for h, zi, zo, factor in TERMS:
            sums = np.fft.irfft2(tables[h] * np.conj(moments[zi]), shape)
            found[:, :, zo, channel] += 0.25 * factor * sums[:CELLS, :CELLS]
    return found


def material() -> type:
    """The class of the material for Mitsuba's present variant."""

    class Table(mi.BSDF):  # type: ignore[misc]
        def __init__(self, props: Any):
            mi.BSDF.__init__(self, props)
            lut = Lut(str(mi.file_resolver().resolve(props["filename"])))
            self.extent, self.warp, self.size = lut.extent, lut.warp, len(lut.rgb)
            self.lossless = props.get("lossless", False)
            white = white_sky(lut)
            middle = white[CELLS // 2 - 1 : CELLS // 2 + 1, CELLS // 2 - 1 : CELLS // 2 + 1].sum(2).mean((0, 1))
            self.scale = float(props.get("albedo", 1.0) / middle.max())
            options = {"wrap_mode": dr.WrapMode.Clamp}
            self.white = texture(mi.Texture2f, self.scale * white.reshape(CELLS, CELLS, -1), **options)
            self.table = texture(mi.Texture2f, self.scale * lut.rgb, **options)
            self.cells = min(CELLS, self.size)
            weight = np.maximum(lut.means(-lut.extent, 2 * lut.extent / self.cells, self.cells)[0].sum(2), 0)
            # Every cell has a positive probability.
            weight += 1e-4 * weight.max()
            weight /= weight.sum()
            self.choice = mi.DiscreteDistribution(weight.ravel().astype(np.float32).tolist())
            self.chances = texture(mi.Texture2f, weight[..., None], filter_mode=dr.FilterMode.Nearest)
            self.parts = texture(mi.Texture1f, _spectrum.parts()) if mi.is_spectral else None
            flags = mi.BSDFFlags.GlossyReflection | mi.BSDFFlags.FrontSide | mi.BSDFFlags.Anisotropic
            self.m_components = [flags]
            self.m_flags = flags

        def colors(self, si: Any, wo: Any) -> Any:
            """BRDF times cosine, linear sRGB."""
            h = [si.wi.x + wo.x, si.wi.y + wo.y]
            even = [dr.copysign(dr.power(dr.maximum(dr.abs(v) / self.extent, 1e-9), 1 / self.warp), v) for v in h]
            rgb = self.table.eval(mi.Point2f(*[0.5 * (v + 1) for v in even]))
            inside = (dr.abs(h[0]) <= self.extent) & (dr.abs(h[1]) <= self.extent)
            terms = self.white.eval(mi.Point2f(0.5 * (1 + si.wi.x), 0.5 * (1 + si.wi.y)))
            gain = dr.select(inside, dr.square(1 + dr.dot(si.wi, wo)), 0.0)
            least = 1e-9 if self.lossless else dr.maximum(si.wi.z, 1e-9)
            found = []
            for c in range(3):
                reflected = terms[3 * (POWERS - 1) + c]
                for k in reversed(range(POWERS - 1)):
                    reflected = reflected * si.wi.z + terms[3 * k + c]
                found.append(rgb[c] * gain / dr.maximum(reflected, least))
            return found

        def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            active = active & (si.wi.z > 0) & (wo.z > 0)
            rgb = self.colors(si, wo)
            if self.parts is None:
                value = mi.Spectrum(*rgb)
            else:
                found = []
                for nm in si.wavelengths:
                    part = self.parts.eval(mi.Float(texel(share_of(1e3 / nm, RANGE), POINTS)))
                    found.append(sum(part[c] * rgb[c] for c in range(3)))
                value = mi.Spectrum(*found)
            x, y = (0.5 + 0.5 * v / self.extent for v in (si.wi.x + wo.x, si.wi.y + wo.y))
            inside = (x >= 0) & (x < 1) & (y >= 0) & (y < 1)
            area = (2 * self.extent / self.cells) ** 2
            density = self.chances.eval(mi.Point2f(x, y))[0] * wo.z / area
            return dr.select(active, value, 0.0), dr.select(active & inside, density, 0.0)

        def sample(self, ctx: Any, si: Any, sample1: Any, sample2: Any, active: Any = True) -> Any:
            k = self.choice.sample(sample1, active)
            row = k // self.cells
            cell = 2 * self.extent / self.cells
            x = (mi.Float(k - row * self.cells) + sample2.x) * cell - self.extent - si.wi.x
            y = (mi.Float(row) + sample2.y) * cell - self.extent - si.wi.y
            square = x * x + y * y
            active = active & (si.wi.z > 0) & (square < 1)
            bs = mi.BSDFSample3f()
            bs.wo = mi.Vector3f(x, y, dr.sqrt(dr.maximum(1 - square, 0)))
            bs.eta = 1.0
            bs.sampled_type = mi.UInt32(+self.m_flags)
            bs.sampled_component = mi.UInt32(0)
            value, bs.pdf = self.eval_pdf(ctx, si, bs.wo, active)
            return bs, dr.select(bs.pdf > 0, value / dr.maximum(bs.pdf, 1e-30), 0.0)

        def eval(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return self.eval_pdf(ctx, si, wo, active)[0]

        def pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return self.eval_pdf(ctx, si, wo, active)[1]

        def traverse(self, callback: Any) -> None:
            pass

        def to_string(self) -> str:
            return f"nacre_table[{self.size} entries along a side, extent {self.extent}]"

    return Table
