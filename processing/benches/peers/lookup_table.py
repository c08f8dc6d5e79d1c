"""Time and error of a lookup table with fixed steps of 5 nm by OpenCV, for comparison with
`cargo run --release --example lookup_table`: one remap of the photograph per wavelength, added up in three channels.

pip install opencv-python-headless; the observer is read from processing/src/color/data.
"""
import pathlib
import resource
import time

import cv2
import numpy as np

SIZE, SCALE, CENTER, PITCH, SIGMA, TABLE, BAND = 1000, 0.002, 499.5, 0.085, 0.004, 2048, 680.0
DATA = pathlib.Path(__file__).parents[2] / "src/color/data/cie_1931_2deg.csv"


def light(u, v):
    m, n = np.round(u / PITCH), np.round(v / PITCH)
    square = (u - m * PITCH) ** 2 + (v - n * PITCH) ** 2
    return np.exp(-0.5 * square / SIGMA**2) / (1 + 0.1 * (m * m + n * n))


def main():
    at = (np.arange(SIZE) - CENTER) * SCALE
    photograph = light(at[None, :], at[:, None]).astype(np.float32)
    observer = np.loadtxt(DATA, delimiter=",", skiprows=1)
    wavelengths = np.arange(380, 781, 5.0)
    seen = np.stack([np.interp(wavelengths, observer[:, 0], observer[:, k]) for k in (1, 2, 3)], 1)
    used = lambda: sum(resource.getrusage(resource.RUSAGE_SELF)[:2])
    begun, wall = used(), time.time()
    h = ((2 * np.arange(TABLE) + 1) / TABLE - 1).astype(np.float32)
    u, v = np.meshgrid(h, h)
    table = np.zeros((TABLE, TABLE, 3), np.float32)
    white = 0
    for nm, weights in zip(wavelengths, seen):
        factor = BAND / nm
        x, y = u * np.float32(factor / SCALE) + np.float32(CENTER), v * np.float32(factor / SCALE) + np.float32(CENTER)
        warped = cv2.remap(photograph, x, y, cv2.INTER_LINEAR)
        for c in range(3):
            table[:, :, c] += np.float32(factor**4 * weights[c]) * warped
        white += weights[1]
    table /= white
    print(f"{used() - begun:.2f} CPU-seconds, {time.time() - wall:.2f} s")
    # Against sums over wavelengths 0.1 nm apart, of light as it is where the photograph reaches.
    random = np.random.default_rng(1)
    fine = np.arange(360.05, 830, 0.1)
    y_bar = np.interp(fine, observer[:, 0], observer[:, 2])
    square = total = 0.0
    for i, j in random.integers(0, TABLE, (3000, 2)):
        if abs(h[j]) < 0.6:
            continue
        factor = BAND / fine
        a, b = h[j] * factor, h[i] * factor
        inside = (np.abs(a) < CENTER * SCALE) & (np.abs(b) < CENTER * SCALE)
        truth = np.sum(y_bar * factor**4 * light(a, b) * inside) / np.sum(y_bar)
        square, total = square + (table[i, j, 1] - truth) ** 2, total + truth**2
    print(f"RMS at the rim {100 * np.sqrt(square / total):.2f} %")


main()
