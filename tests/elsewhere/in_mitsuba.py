"""Materials of `nacre.mitsuba` against `nacre render`: six views, a white sky, and sampling against density.

  in_mitsuba.py FOLDER [VARIANT ...]

Prints `name | measured | bound` per agreement; exits with 1 if a bound is missed. Needs NACRE_BIN.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

import colors

mi.set_variant("scalar_rgb")
mi.set_log_level(mi.LogLevel.Error)
# Needs a variant.
import nacre.mitsuba  # noqa: E402
import views  # noqa: E402
from views import View  # noqa: E402

DELTA_E, FURNACE, MISPLACED = 1.0, 0.01, 0.01

# Samples per pixel under lamps, in the room and under a white sky; spectral variants need more in the room.
SAMPLES = {None: 2048, "sky.exr": 8192, "white.exr": 256}
SPECTRAL = 2


def material(view: View, folder: Path) -> dict[str, Any]:
    """The view's material for Mitsuba."""
    own = dict(view.material)
    if own.pop("type") == "table":
        return {"type": "nacre_table", "filename": str(folder / own["file"]), "albedo": own["albedo"]}
    if "maps" in own:
        own["maps"] = str(folder / own["maps"])
    if isinstance(own["profile"], dict):
        own["duty"] = own["profile"]["rectangular"]["duty"]
        own["profile"] = "rectangular"
    return {"type": "nacre_grating", **own}


def scene(view: View, folder: Path) -> dict[str, Any]:
    """The view for Mitsuba."""
    to = mi.ScalarTransform4f()
    half = view.size / 2
    if view.sphere:
        # u runs around the y axis.
        shape: dict[str, Any] = {"type": "sphere", "to_world": to.rotate([1, 0, 0], -90), "radius": half}
    else:
        shape = {"type": "rectangle", "to_world": to.scale([half, half, 1])}
    shape["bsdf"] = material(view, folder)
    white = {"type": "rgb", "value": 1.0}
    parts: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 2, "hide_emitters": True},
        "sensor": {
            "type": "perspective",
            "fov": view.fov_deg,
            "fov_axis": "y",
            "near_clip": 1.0,
            "far_clip": 1e4,
            "to_world": to.look_at(origin=list(view.camera), target=[0, 0, 0], up=[0, 1, 0]),
            "film": {
                "type": "hdrfilm",
                "width": views.PIXELS,
                "height": views.PIXELS,
                "rfilter": {"type": "box"},
                "pixel_format": "rgb",
                "component_format": "float32",
            },
            "sampler": {"type": "multijitter", "sample_count": SAMPLES[view.sky] * (SPECTRAL if mi.is_spectral else 1)},
        },
        "shape": shape,
    }
    if view.point:
        # Illuminance 1 at the origin.
        power = {"type": "rgb", "value": float(np.dot(view.point, view.point))}
        parts["point"] = {"type": "point", "position": list(view.point), "intensity": power}
    for k, sun in enumerate(view.suns):
        parts[f"sun{k}"] = {"type": "directional", "direction": [-v for v in sun], "irradiance": white}
    if view.sky:
        parts["sky"] = {"type": "envmap", "filename": str(folder / view.sky)}
    return parts


def picture(view: View, folder: Path) -> np.ndarray:
    """Linear sRGB of Mitsuba."""
    return np.array(mi.render(mi.load_dict(scene(view, folder))), dtype=np.float64)[..., :3]


def misplaced(own: dict[str, Any], angle_deg: float, azimuth_deg: float = 33.0) -> float:
    """Share of samples whose directions disagree with the density: total variation beyond the histogram's noise."""
    bsdf, context, count, cells, fine = mi.load_dict(own), mi.BSDFContext(), 1 << 20, 50, 30
    sin, cos = np.sin(np.deg2rad(angle_deg)), np.cos(np.deg2rad(angle_deg))
    turn = np.deg2rad(azimuth_deg)
    wi = [float(v) for v in (sin * np.cos(turn), sin * np.sin(turn), cos)]

    def interaction(n: int) -> Any:
        si = dr.zeros(mi.SurfaceInteraction3f, n)
        si.wi, si.uv = wi, [0.4, 0.3]
        if mi.is_spectral:
            si.wavelengths = [420.0, 500.0, 570.0, 640.0]
        return si

    random = mi.PCG32(count)
    u = [random.next_float32() for _ in range(3)]
    bs, _ = bsdf.sample(context, interaction(count), u[0], mi.Point2f(u[1], u[2]))
    wo, valid = np.array(bs.wo), np.array(bs.pdf) > 0
    limits = [[-1, 1], [-1, 1]]
    found = np.histogram2d(wo[0][valid], wo[1][valid], cells, limits)[0] / count
    grid = (np.arange(cells * fine) + 0.5) / (cells * fine) * 2 - 1
    x, y = (v.ravel() for v in np.meshgrid(grid, grid))
    inside = x * x + y * y < 1
    x, y = x[inside], y[inside]
    z = np.sqrt(1 - x * x - y * y)
    wo = mi.Vector3f(*(mi.Float(v.astype(np.float32)) for v in (x, y, z)))
    density = np.array(bsdf.pdf(context, interaction(len(x)), wo), dtype=np.float64) / z * (grid[1] - grid[0]) ** 2
    expected = np.histogram2d(x, y, cells, limits, weights=density)[0]
    # Mean absolute values of normal variables.
    noise = np.sqrt(expected / count * 2 / np.pi).sum()
    return float(0.5 * max(np.abs(found - expected).sum() - noise, 0))


def main() -> None:
    folder = Path(sys.argv[1])
    if not (folder / "lut.exr").exists():
        views.write_inputs(folder)
    missed = False

    def report(name: str, measured: float, bound: float, unit: str = "") -> None:
        nonlocal missed
        missed |= not measured <= bound
        print(f"{name} | {measured:.3g}{unit} | {bound:g}{unit}", flush=True)

    for variant in sys.argv[2:] or ["llvm_ad_spectral", "llvm_ad_rgb"]:
        mi.set_variant(variant)
        nacre.mitsuba.register()
        for view in views.views():
            truth, found = views.by_nacre(view, folder), picture(view, folder)
            colors.write_png(folder / f"{view.name}-{variant}.png", [truth, found])
            report(f"Mitsuba, {variant}, {view.name}: mean ΔE2000", float(colors.difference(truth, found).mean()), DELTA_E)
        for view in views.furnaces():
            found = picture(view, folder)
            # Pixels wholly on the sample.
            lit = views.by_nacre(view, folder).min(-1) > 0.995
            report(f"Mitsuba, {variant}, {view.name}: reflectance", 100 * float(abs(found[lit].mean() - 1)), 100 * FURNACE, " %")
        for view in [views.views()[k] for k in (2, 3, 4, 5)]:
            worst = max(misplaced(material(view, folder), angle) for angle in (15.0, 50.0))
            report(f"Mitsuba, {variant}, {view.name}: samples against density", 100 * worst, 100 * MISPLACED, " %")
    sys.exit(missed)


if __name__ == "__main__":
    main()
