"""Views of diffracting samples, as scenes of `nacre render` and as parts for other renderers, with their maps."""

from __future__ import annotations

import json
import os
import subprocess
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import nacre

PIXELS = 48

# Coherence widths in µm: small ones spread the light of lamps over the sample, so that a small picture shows it.
UNDER_SKY, UNDER_LAMPS = 65.0, 15.0

# Profiles of the gratings.
SINUSOID = {"profile": "sinusoid", "depth_um": 0.15}
BLAZED = {"profile": "blazed", "depth_um": 0.25}
RECTANGULAR = {"profile": {"rectangular": {"duty": 0.4}}, "depth_um": 0.12}


@dataclass
class View:
    """A sample in the plane z = 0, 40 mm wide, or a sphere of this diameter; lights and camera in mm."""

    name: str
    material: dict[str, Any]
    camera: tuple[float, float, float]
    fov_deg: float = 38.0
    point: tuple[float, float, float] | None = None
    suns: list[tuple[float, float, float]] = field(default_factory=list)
    sky: str | None = None
    sphere: bool = False
    size: float = 40.0

    def toml(self) -> str:
        """The scene for `nacre render`."""
        n = PIXELS
        lines = [
            f"camera = {{ position = {list(self.camera)}, target = [0.0, 0.0, 0.0], fov_deg = {self.fov_deg},"
            f" width = {n}, height = {n} }}",
            "[[shape]]",
        ]
        if self.sphere:
            lines += ['type = "sphere"', f"radius = {self.size / 2}"]
        else:
            lines += ['type = "plane"', f"size = [{self.size}, {self.size}]"]
        lines += ['material = "sample"', "[material.sample]"]
        own = dict(self.material)
        if own["type"] == "grating":
            own["relief"] = {"profile": own.pop("profile"), "depth_um": own.pop("depth_um")}
        lines.append("diffraction = { " + ", ".join(f"{k} = {_toml(v)}" for k, v in own.items()) + " }")
        if self.point:
            lines += ["[[light]]", 'type = "point"', f"position = {list(self.point)}"]
        for sun in self.suns:
            lines += ["[[light]]", 'type = "directional"', f"direction = {list(sun)}"]
        if self.sky:
            lines += ["[[light]]", 'type = "environment"', f'file = "{self.sky}"']
        return "\n".join(lines) + "\n"


def _toml(value: Any) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{k} = {_toml(v)}" for k, v in value.items()) + " }"
    return json.dumps(value)


def views() -> list[View]:
    grating = {"type": "grating", "coherence_um": UNDER_SKY}
    single = {**grating, **SINUSOID, "period_um": 1.5, "orientation_deg": 30.0}
    spread = {"coherence_um": UNDER_LAMPS}
    maps = {**grating, **SINUSOID, **spread, "maps": "maps"}
    return [
        View("lamp", {**single, **spread}, (0.0, -20.0, 55.0), point=(25.0, 30.0, 60.0)),
        View("maps", maps, (10.0, 0.0, 60.0), suns=[(0.4, 0.5, 0.8), (-0.6, 0.2, 0.7), (0.1, -0.7, 0.7)]),
        View("sphere", single, (0.0, 10.0, 80.0), 33.0, sky="sky.exr", sphere=True),
        View("blazed", {**grating, **BLAZED, "period_um": 2.0, "orientation_deg": 0.0}, (0.0, -45.0, 45.0), sky="sky.exr"),
        View("rectangular", {**grating, **RECTANGULAR, "period_um": 1.2, "orientation_deg": 60.0}, (-30.0, 0.0, 50.0), sky="sky.exr"),
        View("table", {"type": "table", "file": "lut.exr", "albedo": 0.9}, (15.0, -25.0, 55.0), suns=[(-0.2, 0.5, 0.8)], sky="sky.exr"),
    ]  # fmt: skip


def furnaces() -> list[View]:
    """Perfect gratings under a white sky: maps, a sphere, a blazed one."""
    return [View(f"white {v.name}", {**v.material}, v.camera, v.fov_deg, sky="white.exr", sphere=v.sphere) for v in views()[1:4]]


def write_inputs(folder: Path) -> None:
    """Maps, table and environments."""
    (folder / "maps").mkdir(parents=True, exist_ok=True)
    n = 64
    y, x = np.mgrid[0:n, 0:n] / n - 0.5
    radius, angle = np.hypot(x, y), np.arctan2(-y, x)
    # Rings of sectors, as a kinematic tile.
    ring = np.floor(radius * 8)
    sector = np.floor((angle + np.pi) / (2 * np.pi) * (6 + 4 * ring))
    orientation = np.mod(sector * np.pi / (3 + 2 * ring) + ring * np.pi / 8, np.pi)
    period = np.where(radius < 0.48, 1.2 + 0.15 * ring, 1.9)
    known = (np.abs(x) < 0.46) & (np.abs(y) < 0.46)
    for name, values in (("orientation", orientation), ("period", period)):
        masked = np.where(known, values, np.nan)
        nacre.write_maps(folder / "maps" / f"{name}.exr", **{name: masked, "mask": known.astype(np.float32)})
    _write_sky(folder / "sky.exr", 256)
    white = np.ones((32, 64), np.float32)
    nacre.write_maps(folder / "white.exr", R=white, G=white, B=white)
    _write_lut(folder / "lut.exr", 160)


def _write_sky(file: Path, width: int) -> None:
    """A room with two windows and a lamp, soft at the edges; y is up, the middle column is +z."""
    v, u = (np.mgrid[0 : width // 2, 0:width] + 0.5) / np.array([width // 2, width])[:, None, None]
    azimuth, height = 2 * np.pi * (0.5 - u), np.pi * (0.5 - v)

    def window(at: tuple[float, float], half: tuple[float, float], soft: float = 0.05) -> np.ndarray:
        across, up = np.abs(np.angle(np.exp(1j * (azimuth - at[0])))), np.abs(height - at[1])
        inside = 1 / (1 + np.exp((across - half[0]) / soft)) / (1 + np.exp((up - half[1]) / soft))
        found: np.ndarray = inside
        return found

    light = 0.2 + 0.1 * np.clip(height, 0, None)
    light = light + 1.2 * window((0.7, 0.5), (0.3, 0.25)) + 0.8 * window((-1.0, 0.2), (0.2, 0.4))
    light = light + 1.6 * window((0.1, 1.1), (0.25, 0.15))
    planes = {c: np.asarray(light, np.float32) for c in "RGB"}
    nacre.write_maps(file, **planes)


def _write_lut(file: Path, size: int) -> None:
    """Orders of a lattice of 2 and 3 µm under D65, blurred, over half vectors from -1 to 1."""
    h = (2 * (np.arange(size) + 0.5) / size - 1)[None, :]
    down = -h.T
    white = np.array([0.95047, 1.0, 1.08883])
    table = np.zeros((size, size, 3))
    # Gaussian approximations of the CIE 1931 curves suffice for a test pattern.
    nm = np.arange(390, 711, 5.0)
    curves = np.stack([
        1.06 * np.exp(-0.5 * ((nm - 600) / 38) ** 2) + 0.36 * np.exp(-0.5 * ((nm - 446) / 19) ** 2),
        np.exp(-0.5 * ((nm - 556) / 46) ** 2),
        1.78 * np.exp(-0.5 * ((nm - 449) / 23) ** 2),
    ])  # fmt: skip
    curves *= (white / curves.sum(1))[:, None]
    for i in range(-3, 4):
        for j in range(-4, 5):
            power = np.exp(-0.35 * (i * i + 0.6 * j * j))
            for k, um in enumerate(nm / 1e3):
                spot = np.exp(-0.5 * ((h - i * um / 2) ** 2 + (down - j * um / 3) ** 2) / 0.03**2)
                table += power * spot[..., None] * curves[:, k]
    attributes = {"extent": 1, "warp": 1, "illuminant": "D65", "white": " ".join(map(str, white))}
    planes = {c: table[..., k].astype(np.float32) for k, c in enumerate("XYZ")}
    nacre.write_maps(file, attributes, **planes)


def by_nacre(view: View, folder: Path, max_error: float = 0.005) -> np.ndarray:
    """Linear sRGB of `nacre render`: (height, width, 3). An earlier picture of the same scene is read again."""
    scene, out = folder / f"{view.name}.toml", folder / f"{view.name}-nacre.exr"
    if not out.exists() or scene.read_text() != view.toml():
        _render(view, scene, out, max_error)
    maps = nacre.read_maps(out)
    return np.stack([maps[c] for c in "RGB"], axis=-1)


def _render(view: View, scene: Path, out: Path, max_error: float) -> None:
    scene.write_text(view.toml())
    program = os.environ["NACRE_BIN"]
    # Lobes under lamps are cut off where the error allows it; their tails show beside overexposed peaks.
    error, samples = (1e-5, 64) if not view.sky else (max_error, 4096)
    command = [program, "render", scene, "--out", out, "--max-error", str(error), "--samples", str(samples), "--force"]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode not in (0, 1) or not out.exists():
        raise RuntimeError(f"{view.name}: {done.stderr}")
