"""Flat tables under environments, by the full integral."""

import numpy as np

from rows import AGREES, Outcome, write_exr

SCENE = """
[camera]
position = [0, 0, {distance}]
target = [0, 0, 0]
fov_deg = {fov}
width = {side}
height = {side}
[[shape]]
type = "plane"
size = [100, 100]
material = "table"
[[light]]
type = "environment"
file = "{sky}.exr"
up = [0, 0, 1]
[material.table.diffraction]
type = "table"
file = "table.exr"
"""
SIDE, EXTENT, WIDTH, HEIGHT = 256, 1.0, 256, 128


def pattern(x, y):
    """A table with three broad spots, unlike its own mirror images."""
    spot = lambda a, b, s: np.exp(-((x - a) ** 2 + (y - b) ** 2) / (2 * s**2))
    return spot(0, 0, 0.08) + 0.8 * spot(0.4, 0.15, 0.06) + 0.5 * spot(-0.25, 0.3, 0.05)


def sky(name):
    """Radiance of a lat-long picture: first row +z, middle column +x, azimuth growing to the left."""
    theta = np.pi * (np.arange(HEIGHT) + 0.5) / HEIGHT
    phi = np.pi - 2 * np.pi * (np.arange(WIDTH) + 0.5) / WIDTH
    theta, phi = np.meshgrid(theta, phi, indexing="ij")
    way = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)
    lamp = np.array([0.45, 0.2, 0])
    lamp[2] = np.sqrt(1 - (lamp**2).sum())
    light = np.ones((HEIGHT, WIDTH)) if name == "white" else np.exp((way @ lamp - 1) / np.sin(np.radians(5)) ** 2) + 0.05
    return way, light, np.sin(theta) * (np.pi / HEIGHT) * (2 * np.pi / WIDTH)


def write_table(file, values, extent):
    """A lookup table as `reconstruct lut` writes it: colourless under D65."""
    import OpenEXR

    white = (0.95047, 1.0, 1.08883)
    channels = {c: np.ascontiguousarray(w * values, "f4") for c, w in zip("XYZ", white)}
    channels["coverage"] = np.ones(values.shape, "f4")
    header = {"compression": OpenEXR.NO_COMPRESSION, "type": OpenEXR.scanlineimage, "extent": str(extent), "warp": "1", "illuminant": "D65", "observer": "1931",
              "white": "0.950468 1.000000 1.088817"}
    OpenEXR.File(header, channels).write(str(file))


def scenes(folder):
    h = EXTENT * ((2 * np.arange(SIDE) + 1) / SIDE - 1)
    x, y = np.meshgrid(h, -h)
    write_table(folder / "table.exr", pattern(x, y), EXTENT)
    for name in ("white", "lamp"):
        light = sky(name)[1]
        write_exr(folder / f"{name}-sky.exr", R=light, G=light, B=light)
        (folder / f"{name}.toml").write_text(SCENE.format(sky=f"{name}-sky", distance=4000, fov=0.5, side=8))


def ratio(run):
    values, right = [], []
    for name in ("lamp", "white"):
        parts = run.exr(f"{name}.exr")
        values.append(parts["G"].mean())
        way, light, area = sky(name)
        up = way[..., 2] > 0
        # G cos θi of the 2017 paper at normal view: (1 + cos θi)².
        right.append((pattern(way[..., 0], way[..., 1]) * (1 + way[..., 2]) ** 2 * light * area)[up].sum())
    ours, wanted = values[0] / values[1], right[0] / right[1]
    return Outcome(f"{ours:.4f}", f"{wanted:.4f} (direct sum, NumPy)", abs(ours / wanted - 1) < 0.02)


def filtered(run):
    table = run.csv("charts/environment-method/environment-method.csv")
    rows = [(table["stress"][k], table["error_median"][k]) for k in range(len(table["stress"])) if "filter" in str(table["method"][k])]
    if not rows:
        raise KeyError(f"no filtered method among {sorted(set(map(str, table['method'])))}")
    text = ", ".join(f"{100 * e:.1f} % at {a:.0f}°" for a, e in rows[:4])
    near = [e for a, e in rows if a <= 10]
    return Outcome(text, "full integral (Nacre's)", min(near) < 0.076, AGREES)
