"""A folder of files with the values that another program reads from them, and the index of both.

A line of index.tsv: file, format and kind (a row of the table), expectation, channels, type of the values. The expectation is "equal",
"within N" (difference of a value) or "refused WORDS" (words of Nacre's message). The values are in FILE.raw, row by row,
little-endian: u1, u2 or f4 as Nacre holds them, without alpha.
"""

import numpy

HEIGHT, WIDTH = 37, 53
# Nacre's types of values; all others become 32-bit floats.
TYPES = {"uint8": "u1", "uint16": "u2"}


class Matrix:
    def __init__(self, folder):
        self.folder, self.lines = folder, []

    def add(self, row, name, content, values=None, expectation="equal"):
        """A file of a (format, kind), its bytes and the values, height × width (× channels); channels 2 and 4 are alpha."""
        name = f"{len(self.lines):05}-{name}"
        (self.folder / name).write_bytes(content)
        channels, kind = 0, "-"
        if not expectation.startswith("refused"):
            values = values if values.ndim == 3 else values[:, :, None]
            channels = 3 if values.shape[2] >= 3 else 1
            kind = TYPES.get(values.dtype.name, "f4")
            values[:, :, :channels].astype("<" + kind).tofile(self.folder / (name + ".raw"))
        self.lines.append("\t".join([name, *row, expectation, str(channels), kind]))

    def close(self):
        (self.folder / "index.tsv").write_text("\n".join(self.lines) + "\n")


def picture(kind, channels, height=HEIGHT, width=WIDTH):
    """Reproducible values over the whole range of a type: smooth with some noise, different in each channel."""
    y, x, c = numpy.mgrid[0:height, 0:width, 0:channels]
    noise = numpy.random.default_rng(7 + channels).random((height, width, channels))
    part = (0.5 + 0.4 * numpy.sin(0.11 * x + 0.07 * y + c) + 0.1 * noise).clip(0, 1)
    part[0, 0], part[-1, -1] = 0, 1
    kind = numpy.dtype(kind)
    if kind.kind == "f":
        values = (part * 900 - 100).astype(kind)
    else:
        info = numpy.iinfo(kind)
        values = (info.min + part * (float(info.max) - info.min)).clip(info.min, info.max)
        values = numpy.minimum(values.astype("f8"), float(info.max) - (info.bits > 32)).astype(kind)
    return values[:, :, 0] if channels == 1 else values
