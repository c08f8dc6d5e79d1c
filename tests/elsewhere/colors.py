"""Comparison of pictures: ΔE2000 of sRGB colours, energy, and PNG files of both side by side."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np

# X, Y, Z of linear sRGB, and of its white.
XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
WHITE = XYZ.sum(1)


def exposure(picture: np.ndarray) -> float:
    """Factor that places the brightest twentieth of the lit pixels at 0.8."""
    lit = picture.max(-1)[picture.max(-1) > 0]
    return float(0.8 / np.quantile(lit, 0.95))


def lab(rgb: np.ndarray) -> np.ndarray:
    """CIELAB of displayed linear sRGB: clipped to 0 to 1."""
    t = np.clip(rgb, 0, 1) @ XYZ.T / WHITE
    f = np.where(t > (6 / 29) ** 3, np.cbrt(t), t / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.stack([116 * f[..., 1] - 16, 500 * (f[..., 0] - f[..., 1]), 200 * (f[..., 1] - f[..., 2])], axis=-1)


def delta_e2000(one: np.ndarray, two: np.ndarray) -> np.ndarray:
    """CIEDE2000 difference of CIELAB colours (Sharma, Wu and Dalal 2005)."""
    (l1, a1, b1), (l2, a2, b2) = (np.moveaxis(v, -1, 0) for v in (one, two))
    mean7 = (0.5 * (np.hypot(a1, b1) + np.hypot(a2, b2))) ** 7
    g = 0.5 * (1 - np.sqrt(mean7 / (mean7 + 25.0**7)))
    a1, a2 = a1 * (1 + g), a2 * (1 + g)
    c1, c2 = np.hypot(a1, b1), np.hypot(a2, b2)
    h1, h2 = np.arctan2(b1, a1), np.arctan2(b2, a2)
    turn = np.angle(np.exp(1j * (h2 - h1)))
    grey = c1 * c2 == 0
    dh = 2 * np.sqrt(c1 * c2) * np.sin(np.where(grey, 0, turn) / 2)
    h = np.where(grey, h1 + h2, h1 + turn / 2)
    dl, dc, l, c = l2 - l1, c2 - c1, 0.5 * (l1 + l2), 0.5 * (c1 + c2)
    rad = np.deg2rad
    t = 1 - 0.17 * np.cos(h - rad(30)) + 0.24 * np.cos(2 * h) + 0.32 * np.cos(3 * h + rad(6)) - 0.2 * np.cos(4 * h - rad(63))
    sl = 1 + 0.015 * (l - 50) ** 2 / np.sqrt(20 + (l - 50) ** 2)
    sc, sh = 1 + 0.045 * c, 1 + 0.015 * c * t
    degrees = np.rad2deg(h) % 360
    rotation = -np.sin(rad(60 * np.exp(-(((degrees - 275) / 25) ** 2)))) * 2 * np.sqrt(c**7 / (c**7 + 25.0**7))
    parts = (dl / sl) ** 2 + (dc / sc) ** 2 + (dh / sh) ** 2 + rotation * dc / sc * dh / sh
    found: np.ndarray = np.sqrt(np.maximum(parts, 0))
    return found


def binned(picture: np.ndarray) -> np.ndarray:
    """Means over 2 × 2 pixels, which halve the noise."""
    height, width, channels = picture.shape
    found: np.ndarray = picture.reshape(height // 2, 2, width // 2, 2, channels).mean((1, 3))
    return found


def difference(truth: np.ndarray, found: np.ndarray) -> np.ndarray:
    """ΔE2000 of means over 2 × 2 pixels, where any is lit, at the exposure of the first picture."""
    factor = exposure(truth)
    truth, found = binned(truth), binned(found)
    lit = (truth.max(-1) > 0) | (found.max(-1) > 0)
    return delta_e2000(lab(truth * factor)[lit], lab(found * factor)[lit])


def write_png(file: Path, pictures: list[np.ndarray]) -> None:
    """sRGB pictures side by side, at the exposure of the first, six times as large."""
    factor = exposure(pictures[0])
    linear = np.clip(np.concatenate(pictures, axis=1) * factor, 0, 1)
    srgb = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    rgb = np.kron(np.round(255 * srgb).astype(np.uint8), np.ones((6, 6, 1), np.uint8))
    rows = b"".join(b"\0" + row.tobytes() for row in rgb)

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", rgb.shape[1], rgb.shape[0], 8, 2, 0, 0, 0)
    file.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))
