"""Files of heights in the formats of AFMs and profilometers, each written from its published description."""

import struct

import numpy as np


def patch(width, rows, seed):
    """Heights in nm, row 0 on top, smooth and without symmetry."""
    x, y = np.meshgrid(np.arange(width), np.arange(rows))
    waves = 40 * np.sin(0.31 * x + 0.2 * seed) + 25 * np.cos(0.17 * x - 0.43 * y) + 0.8 * y
    return np.round(waves + np.random.default_rng(seed).normal(0, 0.5, (rows, width)), 3)


def matrix(nm, pitch_um):
    """Text as Gwyddion exports it in German."""
    rows, width = nm.shape
    head = f"# Kanal: Höhe\n# Breite: {width * pitch_um:.6f} µm\n# Höhe: {rows * pitch_um:.6f} µm\n# Value units: m\n"
    body = "\n".join("\t".join(f"{v * 1e-9:.9e}" for v in row) for row in nm)
    return (head + body + "\n").encode()


def points(nm, pitch_um):
    """Points x y z in µm, y upwards, x slowest."""
    rows, width = nm.shape
    lines = (f"{x * pitch_um:.6f} {y * pitch_um:.6f} {nm[rows - 1 - y, x] * 1e-3:.6f}" for x in range(width) for y in range(rows))
    return ("\n".join(lines) + "\n").encode()


def sdf(nm, pitch_um, binary):
    rows, width = nm.shape
    pitch, up = pitch_um * 1e-6, nm[::-1]
    if binary:
        head = struct.pack("<8s10s12s12sHHddddbbb", b"bISO-1.0", b"someone", b"010120250000", b"010120250000", width, rows,
                           pitch, pitch, 1e-9, 1e-12, 0, 7, 0)
        return head + up.astype("<f8").tobytes()
    head = (f"aISO-1.0\nManufacID = someone\nCreateDate = 010120250000\nModDate = 010120250000\nNumPoints = {width}\n"
            f"NumProfiles = {rows}\nXscale = {pitch:e}\nYscale = {pitch:e}\nZscale = 1e-9\nZresolution = 1e-12\nCompression = 0\n"
            "DataType = 7\nCheckType = 0\n*\n")
    return (head + "\n".join(" ".join(f"{v:.3f}" for v in row) for row in up) + "\n*\n").encode()


def igor(nm, pitch_um, big):
    """Version 5, heights behind phases."""
    order = ">" if big else "<"
    rows, width = nm.shape
    layers = np.stack([nm[::-1] * 7, nm[::-1] * 1e-9]).astype(order + "f4")
    labels = b"".join(name.ljust(32, b"\0") for name in (b"", b"PhaseRetrace", b"HeightRetrace"))
    data = layers.tobytes()
    head = struct.pack(order + "hh14i", 5, 0, 320 + len(data), 0, 0, 0, 0, 0, 0, 0, 0, 0, len(labels), 0, 0, 0)
    head += struct.pack(order + "i", 0)
    pitch = pitch_um * 1e-6
    wave = struct.pack(order + "3i", 0, 0, 0) + struct.pack(order + "ihh6sh32sii", width * rows * 2, 2, 0, b"", 1, b"wave", 0, 0)
    wave += struct.pack(order + "4i8d", width, rows, 2, 0, pitch, pitch, 1, 1, 0, 0, 0, 0)
    wave += struct.pack("4s4s4s4s4s", b"m", b"m", b"m", b"", b"")
    return head + wave.ljust(320, b"\0") + data + labels


def nanoscope(nm, pitch_um, size):
    rows, width = nm.shape
    begin, full = 8192, 2 ** (8 * size)
    raw = np.round(nm[::-1] / 50 / 8 * full).astype(f"<i{size}")
    data = raw.tobytes()
    head = (f"\\*File list\r\n\\Version: 0x09300201\r\n\\Date: 10:00:00 AM Wed Jan 01 2025\r\n\\*Ciao scan list\r\n"
            f"\\@Sens. Zsens: V 50.00 nm/V\r\n\\*Ciao image list\r\n\\Data offset: {begin}\r\n\\Data length: {len(data)}\r\n"
            f"\\Bytes/pixel: {size}\r\n\\Samps/line: {width}\r\n\\Number of lines: {rows}\r\n"
            f"\\Scan Size: {width * pitch_um:.6f} {rows * pitch_um:.6f} ~m\r\n\\@2:Image Data: S [Height] \"Height\"\r\n"
            "\\@2:Z scale: V [Sens. Zsens] (0.000122070 V/LSB) 8.000 V\r\n\\*File list end\r\n")
    return head.encode("latin-1").ljust(begin, b"\x1a") + data


def nanosurf(nm, pitch_um):
    rows, width = nm.shape
    raw = np.round(nm[::-1] / 400 * 65536).astype("<i2")
    head = (f"[DataSet]\r\nVersion=2\r\nGroupCount=1\r\nGr0-Count=1\r\nGr0-Ch0=DataSet-0:0\r\n[DataSet-Info]\r\nDate=01-01-2025\r\n"
            f"Time=10:00:00\r\n[DataSet-0:0]\r\nVersion=2\r\nPoints={width}\r\nLines={rows}\r\nFrame=Scan forward\r\nDim0Unit=m\r\n"
            f"Dim0Range={width * pitch_um * 1e-6:.9e}\r\nDim0Min=0\r\nDim1Unit=m\r\nDim1Range={rows * pitch_um * 1e-6:.9e}\r\nDim1Min=0\r\n"
            "Dim2Name=Z-Axis\r\nDim2Unit=m\r\nDim2Range=4e-7\r\nDim2Min=-2e-7\r\nSaveMode=Binary\r\nSaveBits=16\r\nSaveSign=Signed\r\n"
            "SaveOrder=Intel\r\n")
    return head.encode() + b"#!" + raw.tobytes()


def bcrf(nm, pitch_um):
    rows, width = nm.shape
    head = (f"fileformat = bcrf\nheadersize = 2048\nxpixels = {width}\nypixels = {rows}\nxlength = {width * pitch_um * 1e3:.6f}\n"
            f"ylength = {rows * pitch_um * 1e3:.6f}\nxunit = nm\nyunit = nm\nzunit = nm\nbit2nm = 1\nintelmode = 1\n"
            "voidpixels = 3.402823466e+38\n")
    return head.encode().ljust(2048, b"%") + nm.astype("<f4").tobytes()


def files():
    """Names, contents, and flags for the scale that a format does not state."""
    for seed, (width, rows, pitch) in enumerate([(48, 48, 0.1), (64, 40, 0.0375), (31, 57, 0.25)]):
        nm = patch(width, rows, seed)
        yield f"matrix-{seed}.txt", matrix(nm, pitch), []
        yield f"points-{seed}.xyz", points(nm, pitch), ["--pixel-um", str(pitch), "--range-um", str(np.ptp(nm) * 1e-3)]
        for binary in (False, True):
            yield f"{'binary' if binary else 'text'}-{seed}.sdf", sdf(nm, pitch, binary), []
        yield f"little-{seed}.ibw", igor(nm, pitch, False), []
        yield f"big-{seed}.ibw", igor(nm, pitch, True), []
        yield f"short-{seed}.spm", nanoscope(nm, pitch, 2), []
        yield f"long-{seed}.spm", nanoscope(nm, pitch, 4), []
        yield f"scan-{seed}.nid", nanosurf(nm, pitch), []
        yield f"float-{seed}.bcrf", bcrf(nm, pitch), []
