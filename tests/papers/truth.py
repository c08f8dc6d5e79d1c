"""Closed forms and direct sums that share no code with Nacre. Lengths in µm, angles in radians unless named."""

import csv
import json
from pathlib import Path

import numpy as np
from scipy import special

COLOR = Path(__file__).resolve().parents[2] / "processing/optics/src/color/data"


def observer(nm):
    """CIE 1931 colour-matching functions from the standard's table at 1 nm, interpolated; 3 × n."""
    with open(COLOR / "cie_1931_2deg.csv") as lines:
        table = np.array([[float(c) for c in row] for row in csv.reader(lines) if row and row[0][:1].isdigit()])
    return np.stack([np.interp(nm, table[:, 0], table[:, k], 0, 0) for k in (1, 2, 3)])


def bessel_orders(depth, nm, w, most=8):
    """Efficiencies J_m²(k w h0/2) of a sinusoid, m = -most to most."""
    return special.jv(np.arange(-most, most + 1), np.pi * w * depth / (nm * 1e-3)) ** 2


def taylor_orders(depth, nm, w=2.0):
    """Squared coefficients of the orders 0, 1, 2 of exp(ikwh) to the second power of kwh (2018 paper, Eq. 2)."""
    x = np.pi * w * depth / (nm * 1e-3)
    return abs(np.array([1 + 1j * x - 0.75 * x**2, 0.5j * x - 0.5 * x**2, -0.125 * x**2 + 0j])) ** 2


def half_vector(point, camera, light):
    """Tangent part of ωi + ωo of places in the plane z = 0 (… × 2), mm."""
    place = np.concatenate([point, np.zeros(point.shape[:-1] + (1,))], -1)
    toward = lambda target: (target - place) / np.linalg.norm(target - place, axis=-1, keepdims=True)
    return (toward(np.asarray(camera, float)) + toward(np.asarray(light, float)))[..., :2]


# Photographs behind a film (2018 paper, Eq. 4-6).


def rotated(matrix, angle):
    """Jones matrices in frames that are turned by `angle` (an array)."""
    c, s = np.cos(angle), np.sin(angle)
    turn = np.moveaxis(np.array([[c, -s], [s, c]]), (0, 1), (-2, -1))
    return turn @ matrix @ np.swapaxes(turn, -1, -2)


def intensities(theta, psi, r, zeta_deg, film_deg=0.0, axis_deg=0.0):
    """Light behind an analyser at each of `psi`, of gratings at `theta`, under circular light: psi × theta."""
    film = rotated(np.diag([1, np.exp(1j * np.radians(film_deg))]), np.radians(axis_deg))
    grating = rotated(np.diag([-1, r * np.exp(1j * np.radians(zeta_deg))]), theta)
    field = (film @ grating @ film) @ np.array([1, -1j])
    return np.array([abs(field @ [np.cos(p), np.sin(p)]) ** 2 for p in psi])


def write_series(folder, series, angles_deg, seed, full_e=40_000, read_e=8):
    """Photographs of 16 bits with shot and read noise (none where `full_e` is None), and their frames.json."""
    folder.mkdir()
    series = series * (0.8 / series.max())
    if full_e:
        random = np.random.default_rng(seed)
        series = (random.poisson(series * full_e) + random.normal(0, read_e, series.shape)) / full_e
    frames = []
    for k, (angle, values) in enumerate(zip(angles_deg, series)):
        np.save(folder / f"{k:02}.npy", np.clip(np.rint(values * 60000 + 2000), 0, 65535).astype("u2"))
        frames.append({"file": f"{k:02}.npy", "analyser_deg": float(angle)})
    text = {"kind": "polarization", "transfer": "linear", "illumination": "circular_panel", "black": 2000, "white": 62000, "frames": frames}
    (folder / "frames.json").write_text(json.dumps(text))


def paper_orientations(series, psi, prenormalized):
    """The 2018 paper's way: each photograph less its mean, each pixel by mean and standard deviation, then the phase of a cosine."""
    if prenormalized:
        series = series - series.mean(tuple(range(1, series.ndim)), keepdims=True)
    series = series - series.mean(0)
    series = series / series.std(0)
    # A cosine alone: its mean is taken for 0, which steps that do not divide the turn make wrong.
    design = np.linalg.pinv(np.stack([np.cos(2 * psi), np.sin(2 * psi)], 1))
    c, s = np.tensordot(design, series, 1)
    return np.arctan2(s, c) / 2


# Height fields.


def grating_angle(order, nm, period, incidence):
    """θr of sin θi + sin θr = m λ/d, positive towards the light."""
    return np.arcsin(order * nm * 1e-3 / period - np.sin(incidence))


def srgb_linear(xyz):
    """Linear sRGB of X, Y, Z along the first axis (IEC 61966-2-1, its matrix to 7 digits)."""
    matrix = np.array([[3.2404542, -1.5371385, -0.4985314], [-0.9692660, 1.8760108, 0.0415560], [0.0556434, -0.2040259, 1.0572252]])
    return np.tensordot(matrix, xyz, 1)
