"""Writes OpenEXR files with the OpenEXR library (PyPI), and beside each the samples that the library reads back from it.

usage: write.py FOLDER
"""

import itertools
import pathlib
import sys

import numpy
import OpenEXR

COMPRESSIONS = [name for name in dir(OpenEXR) if name.endswith("_COMPRESSION")]
TYPES = {"half": numpy.float16, "float": numpy.float32, "uint": numpy.uint32}
HEIGHT, WIDTH = 37, 53


def samples(kind, channel):
    """Smooth values with a few large and small ones, different in each channel."""
    y, x = numpy.mgrid[0:HEIGHT, 0:WIDTH]
    values = 40 * (channel + 1) + x * 0.75 + y * y * 0.125
    values[3, 5], values[20, 50] = 6000, 0.001
    return values.astype(TYPES[kind])


def main(folder):
    folder.mkdir(parents=True, exist_ok=True)
    windows = {"plain": (0, 0), "moved": (-7, 12)}
    for compression, kind, names, window, tiled in itertools.product(
        COMPRESSIONS, TYPES, ["Y", "RGB"], windows, [False, True]
    ):
        left, top = windows[window]
        box = (numpy.array([left, top], "int32"), numpy.array([left + WIDTH - 1, top + HEIGHT - 1], "int32"))
        header = {
            "compression": getattr(OpenEXR, compression),
            "type": OpenEXR.tiledimage if tiled else OpenEXR.scanlineimage,
            "dataWindow": box,
            "displayWindow": box,
        }
        if tiled:
            header["tiles"] = OpenEXR.TileDescription()
        channels = {name: samples(kind, k) for k, name in enumerate(names)}
        words = [compression.removesuffix("_COMPRESSION").lower(), kind, names, window, "tiles" if tiled else "lines"]
        path = folder / ("-".join(words) + ".exr")
        try:
            OpenEXR.File(header, channels).write(str(path))
            back = OpenEXR.File(str(path), separate_channels=True).channels()
        except Exception as error:  # The library has no such combination.
            print(f"{path.name}: not written: {error}")
            path.unlink(missing_ok=True)
            continue
        planes = [back[name].pixels.astype("<f4") for name in names]
        numpy.stack(planes, axis=-1).tofile(path.with_suffix(".f32"))


main(pathlib.Path(sys.argv[1]))
