"""Decoders for the images that the program writes: scan-line OpenEXR, uncompressed or with ZIP compression, and PNG."""

import array
import math
import struct
import sys
import zlib


def exr(data):
    """Returns {channel: list of values} of a scan-line EXR, and its bytes with all NaN alike and without compression."""
    if data[:4] != b"\x76\x2f\x31\x01":
        raise ValueError("no OpenEXR file")
    at, header = 8, {}
    while data[at]:
        name, at = _text(data, at)
        _, at = _text(data, at)
        size = struct.unpack_from("<i", data, at)[0]
        header[name] = data[at + 4:at + 4 + size]
        at += 4 + size
    left, top, right, bottom = struct.unpack("<4i", header["dataWindow"])
    width, height = right - left + 1, bottom - top + 1
    kinds, place = [], 0
    while header["channels"][place]:
        name, place = _text(header["channels"], place)
        kinds.append((name, "Ief"[struct.unpack_from("<i", header["channels"], place)[0]]))
        place += 16
    length = width * sum(struct.calcsize(kind) for _, kind in kinds)
    lines = {b"\0": 1, b"\3": 16}[header["compression"]]
    planes = {name: [] for name, _ in kinds}
    blocks = -(-height // lines)
    # Offsets and lengths of compressed blocks are left out: other versions of deflate differ.
    out = bytearray(data[:at + 1 + 8 * blocks * (lines == 1)])
    for offset in struct.unpack_from(f"<{blocks}Q", data, at + 1):
        first, size = struct.unpack_from("<2i", data, offset)
        out += data[offset:offset + 8 * (lines == 1)]
        rows = data[offset + 8:offset + 8 + size]
        plain = length * min(lines, top + height - first)
        if size < plain:
            rows = _unzip(rows)
        place = 0
        while place < plain:
            for name, kind in kinds:
                row = struct.unpack_from(f"<{width}{kind}", rows, place)
                planes[name] += row
                # Sign and payload of a NaN depend on how the compiler orders operands.
                out += struct.pack(f"<{width}{kind}", *(v if v == v else math.nan for v in row))
                place += width * struct.calcsize(kind)
    return planes, bytes(out)


def _unzip(packed):
    """Rows of a block with ZIP compression: differences of bytes, of which the first half is for even places."""
    codes = zlib.decompress(packed)
    values, last = bytearray(len(codes)), 128
    for k, code in enumerate(codes):
        last = values[k] = (last + code - 128) & 255
    half = (len(values) + 1) // 2
    rows = bytearray(len(values))
    rows[::2], rows[1::2] = values[:half], values[half:]
    return bytes(rows)


def _text(data, at):
    end = data.index(0, at)
    return data[at:end].decode(), end + 1


def png(data):
    """Returns {channel index: list of samples} of a PNG that is not interlaced, with 8 or 16 bits per sample."""
    at, parts, header = 8, [], None
    while at < len(data):
        size, name = struct.unpack_from(">I4s", data, at)
        body = data[at + 8:at + 8 + size]
        if name == b"IHDR":
            header = struct.unpack(">2I5B", body)
        elif name == b"IDAT":
            parts.append(body)
        at += 12 + size
    width, height, bits, color, *_, interlace = header
    if bits not in (8, 16) or interlace:
        raise ValueError(f"PNG with {bits} bits per sample, interlace {interlace}")
    channels = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}[color]
    step = channels * bits // 8
    rows = _unfilter(zlib.decompress(b"".join(parts)), width * step, height, step)
    samples = array.array("B" if bits == 8 else "H", b"".join(rows))
    if bits == 16 and sys.byteorder == "little":
        samples.byteswap()
    return {f"channel {k}": samples[k::channels] for k in range(channels)}


def _unfilter(raw, length, height, step):
    rows, above = [], bytes(length)
    for y in range(height):
        start = y * (length + 1)
        kind, row = raw[start], bytearray(raw[start + 1:start + 1 + length])
        if kind == 2:  # by the row above, as the program writes
            row = bytearray((a + b) & 255 for a, b in zip(row, above))
        for x in range(length if kind not in (0, 2) else 0):
            a = row[x - step] if x >= step else 0
            b = above[x]
            c = above[x - step] if x >= step else 0
            row[x] = (row[x] + (a, b, (a + b) // 2, _paeth(a, b, c))[kind - 1]) & 255
        rows.append(bytes(row))
        above = row
    return rows


def _paeth(a, b, c):
    p = a + b - c
    pa, pb, pc = abs(p - a), abs(p - b), abs(p - c)
    return a if pa <= pb and pa <= pc else b if pb <= pc else c
