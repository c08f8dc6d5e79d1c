"""Compares the truncation errors of `nacre factor` with an independent decomposition by numpy.

usage: compare.py NACRE FOLDER
"""

import json
import pathlib
import subprocess
import sys

import numpy
import OpenEXR

RANKS = [1, 3, 10, 21]
SIZE, EXTENT = 120, 0.66
# Linear sRGB of X, Y, Z (IEC 61966-2-1).
SRGB = numpy.array([[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]])


def streaks(x, y, angles, width):
    """Lines through the zero order that fade outwards."""
    lines = sum(numpy.exp(-0.5 * ((y * numpy.cos(a) - x * numpy.sin(a)) / width) ** 2) for a in numpy.radians(angles))
    return lines * numpy.exp(-numpy.hypot(x, y) / 0.22)


def spots(x, y, angles, width):
    """A lattice of spots that fade outwards."""
    total = 0 * x
    for m in range(-4, 5):
        for n in range(-4, 5):
            a, b = numpy.radians(angles)
            at = 0.13 * numpy.array([m * numpy.cos(a) + n * numpy.cos(b), m * numpy.sin(a) + n * numpy.sin(b)])
            total = total + numpy.exp(-0.5 * (abs(m) + abs(n)) - 0.5 * ((x - at[0]) ** 2 + (y - at[1]) ** 2) / width**2)
    return total


def rings(x, y, angles, width):
    """Rings around the zero order."""
    radius = numpy.hypot(x, y)
    return numpy.exp(-0.5 * ((radius / 0.13 - numpy.round(radius / 0.13)) * 0.13 / width) ** 2 - radius / 0.22)


TABLES = {
    "two streaks": (streaks, [50, 140], 0.03),
    "oblique streaks": (streaks, [20, 95], 0.03),
    "three streaks": (streaks, [15, 75, 130], 0.03),
    "lattice": (spots, [35, 110], 0.025),
    "rings": (rings, [0, 90], 0.03),
}


def entries(kind, angles, width):
    """X, Y, Z of a table's entries; the first row is the uppermost."""
    middles = (numpy.arange(SIZE) + 0.5) * 2 * EXTENT / SIZE - EXTENT
    x, y = numpy.meshgrid(middles, -middles)
    return [kind(x / s, y / s, angles, width).astype(numpy.float32) for s in (1.12, 1.0, 0.87)]


def between(table, x, y):
    """Linear between entries; none outside."""
    place = lambda v: numpy.clip((v + EXTENT) / (2 * EXTENT / SIZE) - 0.5, 0, SIZE - 1)
    u, v = place(x), SIZE - 1 - place(y)
    left, top = numpy.minimum(u.astype(int), SIZE - 2), numpy.minimum(v.astype(int), SIZE - 2)
    u, v = u - left, v - top
    mixed = (1 - v) * ((1 - u) * table[top, left] + u * table[top, left + 1])
    mixed += v * ((1 - u) * table[top + 1, left] + u * table[top + 1, left + 1])
    return numpy.where((abs(x) <= EXTENT) & (abs(y) <= EXTENT), mixed, 0)


def kernel(rgb, folder):
    """What light of radiance 1 per solid angle adds at each place of the grid that the curves are on."""
    files = [OpenEXR.File(str(folder / f"part-1-{name}.exr")) for name in ("across", "along")]
    header = files[0].header()
    meridian, shear, reach_x, reach_beta = (
        float(header[name]) for name in ("meridian_deg", "shear_deg", "reach_x", "reach_beta")
    )
    columns, rows = (f.channels()["R" if "R" in f.channels() else "RGB"].pixels.shape[1] for f in files)
    x = ((2 * numpy.arange(columns) + 1) / columns - 1) * reach_x
    beta = ((2 * numpy.arange(rows) + 1) / rows - 1) * reach_beta
    sine = x / numpy.cos(numpy.radians(shear))
    lean = numpy.arctan(sine / numpy.sqrt(1 - numpy.clip(sine, -0.999, 0.999) ** 2) * numpy.sin(numpy.radians(shear)))
    height = (beta[:, None] + lean)[:, :]
    y, z = numpy.sqrt(1 - x**2) * numpy.sin(height), numpy.sqrt(1 - x**2) * numpy.cos(height)
    sin, cos = numpy.sin(numpy.radians(meridian)), numpy.cos(numpy.radians(meridian))
    value = between(rgb, x * sin + y * cos, y * sin - x * cos) * (1 + z) ** 2
    return numpy.where(abs(height) < numpy.pi / 2, value, 0)


def main(nacre, place):
    worst, count = 0, 0
    for name, (kind, angles, width) in TABLES.items():
        xyz = entries(kind, angles, width)
        lut = place / "lut.exr"
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, "extent": str(EXTENT), "warp": "1"}
        OpenEXR.File(header, dict(zip("XYZ", xyz))).write(str(lut))
        rgb = numpy.tensordot(SRGB, numpy.array(xyz, float), 1)
        for rank in RANKS:
            out = place / "out"
            command = [nacre, "factor", lut, "--rank", str(rank), "--out", out, "--force"]
            command += ["--directions-deg", f"{angles[0]},{angles[1]}"]
            subprocess.run(command, check=True, capture_output=True)
            report = json.loads((out / "report.json").read_text())
            for channel, found in enumerate(report["parts"][0]["error"]):
                values = numpy.linalg.svd(kernel(rgb[channel], out), compute_uv=False)
                truth = numpy.sqrt((values[rank:] ** 2).sum() / (values**2).sum())
                off = abs(found / truth - 1)
                worst, count = max(worst, off), count + 1
                print(f"{name:16} rank {rank:2} channel {channel}: {found:.5f}, numpy {truth:.5f}")
                if off > 0.01:
                    sys.exit(f"{name}, rank {rank}, channel {channel}: {found} is {100 * off:.2f} % off {truth}")
    print(f"{count} truncation errors are those of numpy to {100 * worst:.3f} %")


if __name__ == "__main__":
    main(sys.argv[1], pathlib.Path(sys.argv[2]))
