"""PNG of every colour type and depth, written here, as Pillow writes few of them (PNG, third edition)."""

import io
import itertools
import struct
import zlib

import imagecodecs
import numpy
import PIL.Image
from matrix import HEIGHT, WIDTH

# Depths and channels of the colour types.
KINDS = {
    "grey": (0, 1, (1, 2, 4, 8, 16)),
    "RGB": (2, 3, (8, 16)),
    "palette": (3, 1, (1, 2, 4, 8)),
    "grey and alpha": (4, 2, (8, 16)),
    "RGBA": (6, 4, (8, 16)),
}
# First column and row, and steps, of the passes of Adam7.
ADAM7 = [(0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2)]


def chunk(kind, data):
    body = kind + data
    return struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))


def packed(row, bits):
    """A row of samples as bytes."""
    if bits == 16:
        return row.astype(">u2").tobytes()
    if bits == 8:
        return row.astype("u1").tobytes()
    digits = (row[:, None] >> numpy.arange(bits)[::-1] & 1).ravel()
    return numpy.packbits(digits.astype("u1")).tobytes()


def filtered(rows, distance, method):
    """Rows behind their filter byte; the method is that of all rows, or 5 for another in each row."""
    out, before = [], bytes(len(rows[0]))
    for k, row in enumerate(rows):
        now = method if method < 5 else k % 5
        shifted = bytes(distance) + row[:-distance] if distance < len(row) else bytes(len(row))
        diagonal = bytes(distance) + before[:-distance] if distance < len(row) else bytes(len(row))
        a, b, c = (numpy.frombuffer(x[: len(row)], "u1").astype(int) for x in (shifted, before, diagonal))
        guess = a + b - c
        nearest = numpy.argmin([abs(guess - a), abs(guess - b), abs(guess - c)], axis=0)
        predicted = [0 * a, a, b, (a + b) // 2, numpy.choose(nearest, [a, b, c])][now]
        difference = (numpy.frombuffer(row, "u1") - predicted) % 256
        out.append(bytes([now]) + difference.astype("u1").tobytes())
        before = row
    return b"".join(out)


def file(samples, colour, bits, interlaced, method, extra, parts=1):
    """The file of samples, height × width × channels, with chunks before the pixels, which are divided into parts."""
    height, width, channels = samples.shape
    distance = max(1, channels * bits // 8)
    data = b""
    for left, top, dx, dy in ADAM7 if interlaced else [(0, 0, 1, 1)]:
        rows = samples[top::dy, left::dx]
        if rows.size:
            data += filtered([packed(row.ravel(), bits) for row in rows], distance, method)
    header = struct.pack(">IIBBBBB", width, height, bits, colour, 0, 0, int(interlaced))
    data = zlib.compress(data)
    step = -(-len(data) // parts)
    body = b"".join(chunk(b"IDAT", data[k : k + step]) for k in range(0, len(data), step))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + extra + body + chunk(b"IEND", b"")


def read_back(content, samples, colour, bits, palette):
    """Values of the file as Nacre holds them, once Pillow (or imagecodecs for 16 bits) has read the same."""
    if colour == 3:
        values = palette[samples[:, :, 0]]
        other = numpy.array(PIL.Image.open(io.BytesIO(content)).convert("RGB"))
    elif bits == 16:
        values = samples.astype("u2")
        other = imagecodecs.png_decode(content).reshape(*samples.shape[:2], -1)[:, :, : samples.shape[2]]
    else:
        values = (samples * (255 // (2**bits - 1))).astype("u1")
        mode = {0: "L", 2: "RGB", 4: "LA", 6: "RGBA"}[colour]
        other = numpy.array(PIL.Image.open(io.BytesIO(content)).convert(mode)).reshape(values.shape)
    assert numpy.array_equal(values, other)
    return values


def write(matrix):
    dice = numpy.random.default_rng(3)
    palette = dice.integers(0, 256, (256, 3), dtype="u1")
    sizes = [(HEIGHT, WIDTH), (1, 1), (2, 5), (9, 3)]
    for name, (colour, channels, depths) in KINDS.items():
        for bits, interlaced, method, size in itertools.product(depths, [False, True], range(6), sizes):
            samples = dice.integers(0, 2**bits, (*size, channels))
            colours = chunk(b"PLTE", palette[: 2**bits].tobytes()) if colour == 3 else b""
            transparent = {
                0: struct.pack(">H", int(samples[0, 0, 0])),
                2: struct.pack(">3H", *map(int, samples[0, 0, :3])) if channels > 2 else b"",
                3: bytes(range(2**min(bits, 8) // 2)),
            }.get(colour)
            row = f"{', '.join(map(str, depths))}-bit {name}"
            for extra in [b""] + ([chunk(b"tRNS", transparent)] if transparent else []):
                content = file(samples, colour, bits, interlaced, method, colours + extra, 1 + method)
                values = read_back(content, samples, colour, bits, palette)
                ways = "all filters, plain and interlaced" + (", with and without `tRNS`" if transparent else "")
                matrix.add(("PNG", f"{row}; {ways}"), f"{name.replace(' ', '-')}{bits}.png", content, values)
