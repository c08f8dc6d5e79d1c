"""Sheets of tiles for the 2018 paper's section 4: scenes of Nacre's simulator, and photographs made by NumPy alone."""

import json

import numpy as np
from scipy import special

import truth

def whole(folder):
    """The simulator's sheet of 10 × 8 tiles (A4, 500 mm away, 560 nm, 1.66 µm) on fewer pixels."""
    (folder / "sheet.toml").write_text("width = 600\nheight = 430\n")


SMALL = """tiles = [6, 5]
width = 360
height = 262
misaligned_px = {misaligned}
[pattern]
{pattern}
"""


def scene(name, pattern, misaligned=0):
    """Writes a scene of 6 × 5 tiles for `sim photograph tiles`."""
    return lambda folder: (folder / name).write_text(SMALL.format(pattern=pattern, misaligned=misaligned))


def few(folder):
    """Scenes of the sheet under one, two and three lights, seen with lobes as wide as those of a coherence of 8 µm."""
    for n in (1, 2, 3):
        lights = [list(light) for light in LIGHTS[:n]]
        (folder / f"few{n}.toml").write_text(f"width = 440\nheight = 320\ncoherence_um = 8\nband_nm = 4\nlights_mm = {lights}\n")


# The paper's own values: A4, camera 500 mm above, 560 nm, 600 lines/mm, a Gaussian light.
WIDTH, HEIGHT, PIXEL = 600, 430, 0.5
SHEET, TILES, PERIOD, NM = (297.0, 210.0), (10, 8), 1.66, 560.0
LIGHTS = [(0, 0, 200), (8.3, 14.7, 200), (16.6, -7.4, 200), (-16.6, 7.4, 200), (-8.3, -14.7, 200)]
LIGHT_SIGMA, COHERENCE, DEPTH = 6.0, 16.25, 0.1


def striped(folder):
    """Photographs `sheet`: each tile has 4 × 3 fields of eight directions."""
    target = folder / "sheet"
    target.mkdir()
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    point = np.stack([(x + 0.5 - WIDTH / 2) * PIXEL, (HEIGHT / 2 - y - 0.5) * PIXEL], -1)
    place = (point + np.array(SHEET) / 2) / (np.array(SHEET) / TILES)
    on = ((place >= 0) & (place < TILES)).all(-1)
    field = np.floor((place % 1) * (4, 3)).astype(int)
    number = (5 * field[..., 0] + 3 * field[..., 1]) % 8
    angle = np.radians(7 + 22.5 * number)
    vector = NM * 1e-3 / PERIOD * np.stack([np.cos(angle), np.sin(angle)], -1)
    random = np.random.default_rng(1660)
    frames = []

    def save(light, **said):
        electrons = random.poisson(np.clip(light, 0, 1.2) * 40_000) + random.normal(0, 8, light.shape)
        name = f"{len(frames):02}.npy"
        np.save(target / name, np.clip(np.rint(electrons / 40_000 * 60000 + 2000), 0, 65535).astype("u2"))
        frames.append({"file": name, "exposure_s": 1.0, **said})

    for light in LIGHTS:
        picture = np.where(on, photographed(point, vector, light), 0)
        for exposure in (1.0, 8.0):
            save(0.8 * exposure * picture / picture.max(), light_mm=list(light))
            frames[-1]["exposure_s"] = exposure
    save(np.where(on, 0.15 + 0.07 * number, 0.02), flash=False)
    text = {"kind": "flash", "transfer": "linear", "wavelength_nm": NM, "black": 2000, "white": 62000,
            "noise": {"full_scale_e": 40_000, "read_noise_e": 8}, "frames": frames}
    (target / "frames.json").write_text(json.dumps(text))


def photographed(point, vector, light):
    """Light of orders -3 to 3, each a Gaussian about m·λ/a, from a Gaussian light as 9 × 9 points."""
    width = NM * 1e-3 / (2 * np.pi * COHERENCE / 4 * np.sqrt(2))
    share = special.jv(np.arange(4), 2 * np.pi * DEPTH / (NM * 1e-3)) ** 2
    node, weight = special.roots_hermitenorm(9)
    total = 0
    for dx, wx in zip(node, weight):
        for dy, wy in zip(node, weight):
            at = np.array(light) + LIGHT_SIGMA * np.array([dx, dy, 0])
            h = truth.half_vector(point, (0, 0, 500), at)
            away = np.hypot(np.hypot(point[..., 0] - at[0], point[..., 1] - at[1]), at[2])
            for m in range(-3, 4):
                off = ((h - m * vector) ** 2).sum(-1)
                total = total + wx * wy * share[abs(m)] * np.exp(-off / (2 * width**2)) * at[2] / away**3
    return total + 0.002 * total.max()
