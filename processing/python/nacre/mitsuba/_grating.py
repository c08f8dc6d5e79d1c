"""Gratings: Gaussian lobes of the coherence width around exact orders, with balanced powers.

`f = R Σ_m P_m ν² N(ν t - m g)` with ν = 1/λ, t the tangential part of ωi + ωo, g the grating vector, N a Gaussian of
the width of the coherence window's power spectrum, P_m the balanced power towards the view. In variants with RGB, f is
integrated over D65 and the CIE 1931 observer: in closed form, with the power at the mean wave number of each lobe.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from nacre._orders import NUMBERS, PowerTable, Section

from . import _spectrum
from ._spectrum import POINTS, RANGE, dr, mi, share_of, texel, texture

# Blurred colours: wave numbers of lobe centres, and standard deviations of lobes over wave numbers (even in the log).
CENTRES = (0.0, 4.0)
CENTRE_COUNT = 257
WIDTHS = (1e-4, 2.0)
WIDTH_COUNT = 129

# Points of the sum over the zero order, whose lobe may span the spectrum.
ZERO_POINTS = 32

# Strata of wave numbers in variants with RGB, and subdivisions of the order's random number that place a wave number
# within its stratum: the wave number and the order of many samples are stratified together.
STRATA, SUBSTRATA = 32.0, 128.0


class Grooves:
    """Orientation and period over texture coordinates: numbers, or maps of `nacre reconstruct`."""

    def __init__(self, props: Any):
        maps: dict[str, Any] = {"orientation": None, "period": None}
        folder = Path(str(mi.file_resolver().resolve(props["maps"]))) if props.has_property("maps") else None
        if folder is not None:
            from nacre import read_maps

            files = [folder / f"{name}.exr" for name in maps] if folder.is_dir() else [folder]
            for file in [f for f in files if f.exists()]:
                channels = read_maps(file)
                for name in maps:
                    if name in channels:
                        known = channels["mask"] > 0 if "mask" in channels else True
                        maps[name] = np.where(known, channels[name], np.nan)
            if all(v is None for v in maps.values()):
                raise ValueError(f"{folder} has neither orientation.exr nor period.exr")
        for name, key, scale in (("orientation", "orientation_deg", math.pi / 180), ("period", "period_um", 1.0)):
            if (maps[name] is None) == (not props.has_property(key)):
                raise ValueError(f"give {key}, or a map of it")
            if maps[name] is None:
                maps[name] = np.full((1, 1), scale * props[key])
        orientation, period = np.broadcast_arrays(maps["orientation"], maps["period"])
        # A period of 0 marks pixels that do not diffract.
        known = np.isfinite(orientation) & np.isfinite(period)
        if not known.any():
            raise ValueError("no pixel of the maps has a value")
        values = np.where(known[..., None], np.stack([orientation, period], axis=-1), 0.0)
        self.periods = float(period[known].min()), float(period[known].max())
        self.repeat = props.get("repeat_u", 1.0), props.get("repeat_v", 1.0)
        # Row 0 of a map is at v = 1.
        self.texture = texture(
            mi.Texture2f, values[::-1], filter_mode=dr.FilterMode.Nearest, wrap_mode=dr.WrapMode.Repeat
        )

    def at(self, uv: Any) -> tuple[Any, Any, Any]:
        """Unit grating vector, and period in µm (0 where nothing diffracts)."""
        orientation, period = self.texture.eval(mi.Point2f(uv.x * self.repeat[0], uv.y * self.repeat[1]))
        sin, cos = dr.sincos(orientation)
        return cos, sin, period


class Powers:
    """Balanced powers of orders, interpolated."""

    def __init__(self, table: PowerTable):
        self.orders, self.periods = table.orders, table.periods
        self.count, *self.nodes = table.values.shape[1:]
        shape = (self.count * self.nodes[0], *self.nodes[1:], 1)
        options = {"wrap_mode": dr.WrapMode.Clamp}
        self.textures = [texture(mi.Texture3f, v.reshape(shape), **options) for v in table.values]

    def at(self, order: int, view: tuple[Any, Any], number: Any, period: Any) -> Any:
        """Power of an order towards a view (sines across and along the grooves)."""
        across, along = view
        cos = dr.sqrt(dr.maximum(1 - along * along, 1e-8))
        waves, latitudes, longitudes = self.nodes
        x = texel(0.5 + dr.asin(dr.clip(across / cos, -1, 1)) / math.pi, longitudes)
        y = texel(dr.asin(dr.minimum(dr.abs(along), 1.0)) * (2 / math.pi), latitudes)
        z = share_of(number, NUMBERS) * (waves - 1) + 0.5
        depth = self.count * waves
        found = self.textures[order + self.orders]
        if self.count == 1:
            return found.eval(mi.Point3f(x, y, z / depth))[0]
        low, high = self.periods
        place = share_of(dr.log(dr.maximum(period, 1e-3)), (math.log(low), math.log(high))) * (self.count - 1)
        k = dr.minimum(dr.floor(place), self.count - 2.0)
        below, above = (found.eval(mi.Point3f(x, y, (z + (k + i) * waves) / depth))[0] for i in (0, 1))
        return dr.lerp(below, above, place - k)


class Colors:
    """Colours of lobes in variants with RGB."""

    def __init__(self) -> None:
        number, rgb = _spectrum.points(), _spectrum.colors()
        step = number[1] - number[0]
        choice = np.abs(rgb).sum(1)
        choice /= choice.sum() * step
        # Red, green, blue, and the density with which `sample` selects wave numbers.
        four = np.concatenate([rgb, choice[:, None]], axis=1)
        self.line = texture(mi.Texture1f, four)
        running = np.concatenate([[0], np.cumsum(0.5 * (choice[1:] + choice[:-1]) * step)])
        inverse = np.interp(np.linspace(0, 1, POINTS), running / running[-1], number)
        self.inverse = texture(mi.Texture1f, inverse[:, None])
        centres = np.linspace(*CENTRES, CENTRE_COUNT)
        blurred = []
        for width in np.geomspace(*WIDTHS, WIDTH_COUNT):
            # A lobe narrower than the step of the sum is as wide as one.
            wide = max(width, step)
            lobe = np.exp(-0.5 * ((number - centres[:, None]) / wide) ** 2) / (wide * math.sqrt(2 * math.pi))
            found = lobe @ (four * number[:, None] ** 2) * step
            mean = lobe @ (choice * number**3) * step / np.maximum(found[:, 3], 1e-30)
            mean = np.where(found[:, 3] > 1e-12, mean, np.clip(centres, *RANGE))
            blurred.append(np.concatenate([found, mean[:, None]], axis=1))
        self.lobes = texture(mi.Texture2f, np.stack(blurred))

    def sampled(self, u: Any) -> Any:
        return self.inverse.eval(mi.Float(texel(u, POINTS)))[0]

    def at(self, number: Any) -> list[Any]:
        return list(self.line.eval(mi.Float(texel(share_of(number, RANGE), POINTS))))

    def lobe(self, centre: Any, width: Any) -> list[Any]:
        """`∫ colour(ν) ν² N(ν - centre) dν` for a Gaussian of this width, the same of the density, and its mean ν."""
        x = texel(share_of(centre, CENTRES), CENTRE_COUNT)
        limits = (math.log(WIDTHS[0]), math.log(WIDTHS[1]))
        y = texel(share_of(dr.log(dr.maximum(width, WIDTHS[0])), limits), WIDTH_COUNT)
        return list(self.lobes.eval(mi.Point2f(x, y)))


def material() -> type:
    """The class of the material for Mitsuba's present variant."""

    class Grating(mi.BSDF):  # type: ignore[misc]
        def __init__(self, props: Any):
            mi.BSDF.__init__(self, props)
            section = Section(props.get("profile", "sinusoid"), props["depth_um"], props.get("duty", 0.5))
            coherence_um = props.get("coherence_um", 65.0)
            if not 1 <= coherence_um <= 1e4:
                raise ValueError(f"coherence_um is {coherence_um}: give 1 to 10000 µm")
            # The coherence window has four standard deviations; its power spectrum is narrower than its spectrum by √2.
            self.sigma = math.sqrt(2) / (math.pi * coherence_um)
            self.reflectance = props.get_texture("reflectance", 1.0)
            self.grooves = Grooves(props)
            self.powers = Powers(PowerTable.of(section, *self.grooves.periods))
            self.colors: Any = None if mi.is_spectral else Colors()
            flags = mi.BSDFFlags.GlossyReflection | mi.BSDFFlags.FrontSide | mi.BSDFFlags.Anisotropic
            self.m_components = [flags | mi.BSDFFlags.SpatiallyVarying]
            self.m_flags = self.m_components[0]

        def place(self, si: Any) -> tuple[Any, Any, Any, Any]:
            """Grating vector, period, and sines of the view across and along the grooves."""
            x, y, period = self.grooves.at(si.uv)
            view = x * si.wi.x + y * si.wi.y, x * si.wi.y - y * si.wi.x
            return mi.Vector2f(x, y), period, dr.maximum(period, 0.01), view

        def all_powers(self, view: Any, number: Any, period: Any) -> list[Any]:
            """Powers of all orders at a wave number; 0 for orders below the horizon."""
            powers = []
            for order in self.orders():
                x = order / (number * period) - view[0]
                lit = x * x + view[1] * view[1] < 1
                powers.append(dr.select(lit, self.powers.at(order, view, number, period), 0.0))
            total = dr.maximum(sum(powers), 1e-6)
            return [p / total for p in powers]

        def orders(self) -> range:
            return range(-self.powers.orders, self.powers.orders + 1)

        def spectral(self, si: Any, wo: Any) -> list[Any]:
            """BRDF of a perfect reflector at each wavelength."""
            across, _, period, view = self.place(si)
            t = mi.Vector2f(si.wi.x + wo.x, si.wi.y + wo.y)
            along, beside = across.x * t.x + across.y * t.y, across.x * t.y - across.y * t.x
            scale = 1 / (2 * math.pi * self.sigma**2)
            found = []
            for nm in si.wavelengths:
                number = 1e3 / nm
                f = dr.zeros(mi.Float)
                for order, power in zip(self.orders(), self.all_powers(view, number, period)):
                    off = number * along - order / period
                    square = off * off + dr.square(number * beside)
                    f += power * dr.exp(-0.5 * square / self.sigma**2)
                found.append(f * scale * number * number)
            return found

        def integrated(self, si: Any, wo: Any) -> list[Any]:
            """BRDF of a perfect reflector in red, green and blue, and the density of `sample` over its cosine."""
            across, _, period, view = self.place(si)
            t = mi.Vector2f(si.wi.x + wo.x, si.wi.y + wo.y)
            length = dr.maximum(dr.norm(t), 1e-6)
            along = (across.x * t.x + across.y * t.y) / length
            scale = 1 / (2 * math.pi * self.sigma**2)
            width = self.sigma / length
            sums = [dr.zeros(mi.Float) for _ in range(4)]
            for order in self.orders():
                if order == 0:
                    continue
                g = order / period
                centre = g * along / length
                off = g * g * dr.maximum(1 - along * along, 0)
                *colors, number = self.colors.lobe(centre, width)
                visible = (centre > RANGE[0] - 5 * width) & (centre < RANGE[1] + 5 * width)
                x = g / number - view[0]
                visible &= x * x + view[1] * view[1] < 1.1
                power = self.powers.at(order, view, number, period) * math.sqrt(2 * math.pi) * width
                lobe = dr.select(visible, scale * power * dr.exp(-0.5 * off / self.sigma**2), 0.0)
                for k, color in enumerate(colors):
                    sums[k] += lobe * color
            step = (RANGE[1] - RANGE[0]) / ZERO_POINTS
            for k in range(ZERO_POINTS):
                number = RANGE[0] + (k + 0.5) * step
                power = self.powers.at(0, view, mi.Float(number), period) * scale * number**2 * step
                lobe = power * dr.exp(-0.5 * dr.square(number * length / self.sigma))
                for i, color in enumerate(self.colors.at(mi.Float(number))):
                    sums[i] += lobe * color
            return sums

        def values(self, si: Any, wo: Any, active: Any) -> tuple[Any, Any]:
            """BRDF times cosine, and the density of `sample` per solid angle."""
            _, known, _, _ = self.place(si)
            active = active & (si.wi.z > 0) & (wo.z > 0) & (known > 0)
            reflectance = self.reflectance.eval(si, active)
            if self.colors is None:
                f = self.spectral(si, wo)
                value, density = mi.Spectrum(*f) if len(f) > 1 else mi.Spectrum(f[0]), sum(f) / len(f)
            else:
                *rgb, density = self.integrated(si, wo)
                value = mi.Spectrum(*rgb)
            return dr.select(active, value * reflectance * wo.z, 0.0), dr.select(active, density * wo.z, 0.0)

        def sample(self, ctx: Any, si: Any, sample1: Any, sample2: Any, active: Any = True) -> Any:
            across, known, period, view = self.place(si)
            active = active & (si.wi.z > 0) & (known > 0)
            if self.colors is None:
                count = len(si.wavelengths)
                slot = dr.minimum(dr.floor(sample1 * count), count - 1.0)
                number = 1e3 / si.wavelengths[0]
                for k in range(1, count):
                    number = dr.select(slot == k, 1e3 / si.wavelengths[k], number)
                left = sample1 * count - slot
            else:
                slot = dr.minimum(dr.floor(sample1 * STRATA), STRATA - 1)
                left = sample1 * STRATA - slot
                within = left * SUBSTRATA
                number = self.colors.sampled((slot + within - dr.floor(within)) / STRATA)
            chosen, before = dr.zeros(mi.Float), dr.zeros(mi.Float)
            for order, power in zip(self.orders(), self.all_powers(view, number, period)):
                chosen = dr.select((left >= before) & (power > 0), float(order), chosen)
                before += power
            offset = mi.warp.square_to_std_normal(sample2) * self.sigma
            x = (across.x * chosen / period + offset.x) / number - si.wi.x
            y = (across.y * chosen / period + offset.y) / number - si.wi.y
            square = x * x + y * y
            active &= square < 1
            bs = mi.BSDFSample3f()
            bs.wo = mi.Vector3f(x, y, dr.sqrt(dr.maximum(1 - square, 0)))
            bs.eta = 1.0
            bs.sampled_type = mi.UInt32(+self.m_flags)
            bs.sampled_component = mi.UInt32(0)
            value, bs.pdf = self.values(si, bs.wo, active)
            return bs, dr.select(bs.pdf > 0, value / dr.maximum(bs.pdf, 1e-30), 0.0)

        def eval(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return self.values(si, wo, active)[0]

        def pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return self.values(si, wo, active)[1]

        def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return self.values(si, wo, active)

        def traverse(self, callback: Any) -> None:
            callback.put("reflectance", self.reflectance, mi.ParamFlags.Differentiable)

        def to_string(self) -> str:
            return f"nacre_grating[orders ±{self.powers.orders}, periods {self.grooves.periods} µm]"

    return Grating
