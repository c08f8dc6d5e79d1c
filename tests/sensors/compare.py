"""Stokes parameters of raw sensor frames: Nacre's against those of polanalyser and of NumPy."""

import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import polanalyser as pa

nacre = sys.argv[1]
ANGLES = np.deg2rad([0, 45, 90, 135])
# Places (row, column) of the polarizers at 0, 45, 90 and 135° in a block of Sony's sensors.
PLACES = [(1, 1), (0, 1), (0, 0), (1, 0)]
# Single precision, relative to the largest value.
ROUNDING = 2e-6
failed = 0


def stokes(frame, layout, options=(), flags=()):
    """S0, S1 and S2 of a raw frame in units of its codes, and AoLP and DoLP."""
    place = Path(f"case{len(list(Path('.').iterdir()))}")
    (place / "raw").mkdir(parents=True)
    cv2.imwrite(str(place / "raw/frame.png"), frame)
    describe = ["import", place / "raw", "--kind", "division-of-focal-plane", "--layout", layout, *flags, "--transfer", "linear"]
    for arguments in ([*describe, "--out", place / "set"], ["reconstruct", "polarization", place / "set", "--out", place / "result", *options]):
        subprocess.run([nacre, *map(str, arguments)], check=True, stdout=subprocess.DEVNULL)
    def read(name, channels):
        with OpenEXR.File(str(place / "result" / name), separate_channels=True) as file:
            return [file.channels()[c].pixels.astype(float) for c in channels]
    scale = 255 if frame.dtype == np.uint8 else 65535
    return [scale * plane for plane in read("stokes.exr", ["S0", "S1", "S2"])], read("aolp.exr", ["aolp", "dolp"])


def of(images):
    """S0, S1 and S2 by polanalyser from images at 0, 45, 90 and 135°."""
    found = pa.calcStokes([image.astype(float) for image in images], ANGLES)
    return [found[..., k] for k in range(3)]


def check(name, differences, limit):
    """Largest difference against what explains it."""
    global failed
    largest = float(np.max(np.abs(differences)))
    right = largest <= limit
    failed += not right
    print(f"{'agrees' if right else 'DIFFERS'}  {name}: {largest:.2g} (limit {limit:.2g})")


def compare(name, frame, bilinear):
    """A monochrome frame: super-pixels and bilinear images. `bilinear` is what polanalyser's integers may be off by."""
    top = float(np.iinfo(frame.dtype).max)
    # Saturated pixels are masked, and whatever is interpolated from them.
    saturated = (frame == top).astype(np.uint8)
    found, _ = stokes(frame, "sony")
    bad = saturated.reshape(frame.shape[0] // 2, 2, -1, 2).max((1, 3)) > 0
    differences = np.subtract(found, of([frame[y::2, x::2] for y, x in PLACES]))
    check(f"{name}, super-pixels", differences[:, ~bad], ROUNDING * top)
    check(f"{name}, super-pixels masked otherwise than where one is saturated", np.isnan(found[0]) != bad, 0)
    found, angles = stokes(frame, "sony", ["--demosaic", "bilinear"])
    # Nacre mirrors the frame at its borders, OpenCV repeats the second row and column: compared inside.
    peer = of(pa.demosaicing(frame, pa.COLOR_PolarMono))
    bad = cv2.dilate(saturated, np.ones((3, 3), np.uint8)) > 0
    check(f"{name}, bilinear pixels masked otherwise", np.isnan(found[0]) != bad, 0)
    inside = ~bad
    inside[[0, -1]] = inside[:, [0, -1]] = False
    # OpenCV rounds each interpolated image to integers: S0 adds halves of three of them, S1 and S2 subtract two.
    check(f"{name}, bilinear", np.subtract(found, peer)[:, inside], 1.0 * bilinear + ROUNDING * top)
    # The borders: the definition, on a mirrored frame.
    near = [cv2.filter2D(frame * mask(frame.shape, p), cv2.CV_64F, np.outer([0.5, 1, 0.5], [0.5, 1, 0.5]), borderType=cv2.BORDER_REFLECT_101) for p in PLACES]
    check(f"{name}, bilinear with borders", np.subtract(found, of(near))[:, ~bad], ROUNDING * top)
    s = np.stack(found, -1)
    some = (pa.cvtStokesToDoLP(s) > 0.02) & (s[..., 0] > 0.05 * top) & np.isfinite(angles[0])
    turned = np.mod(angles[0] - pa.cvtStokesToAoLP(s) + np.pi / 2, np.pi) - np.pi / 2
    check(f"{name}, AoLP in rad", turned[some], 1e-5)
    check(f"{name}, DoLP", (angles[1] - pa.cvtStokesToDoLP(s))[some], 1e-5)
    found, _ = stokes(frame, "sony", ["--demosaic", "edge-aware"])
    # Decisions look at pixels up to ten away, which a masked one changes.
    clear = cv2.dilate(saturated, np.ones((21, 21), np.uint8)) == 0
    off = np.abs(np.subtract(found, of(newton(frame)))).max(0)[clear] > 1e-5 * top
    # A decision that hangs on rounding may go the other way.
    check(f"{name}, share of pixels that differ edge-aware", off.mean(), 1e-4)


def mask(shape, place):
    found = np.zeros(shape)
    found[place[0]::2, place[1]::2] = 1
    return found


def newton(frame):
    """Li, Zhao, Pan, Kong and Chan, Optics Express 27, 1376 (2019), on a mirrored frame: images at 0, 45, 90 and 135°."""
    margin = 12
    # Where gradients of integers vanish in both directions, the rounding of single precision decides: the same light as Nacre's.
    top = np.float32(np.iinfo(frame.dtype).max)
    mosaic = np.pad(frame.astype(np.float32) * (np.float32(1) / top), margin, mode="reflect")
    def at(image, dy, dx):
        return np.roll(image, (-dy, -dx), (0, 1))
    def along(step, odd):
        """Third-degree Newton polynomials of the difference odd - mosaic, from both sides."""
        def both(image, n):
            return at(image, *(n * np.array(step))) + at(image, *(-n * np.array(step)))
        return mosaic / 2 + 7 / 16 * both(odd, 1) - both(mosaic, 2) / 4 + both(odd, 3) / 16
    def fuse(estimates, steps):
        errors = [sum(at(np.abs(e - mosaic), dy, dx) for dy in (-2, 0, 2) for dx in (-2, 0, 2)) for e in estimates]
        gradients = []
        for dy, dx in steps:
            first = np.abs(at(mosaic, -dy, -dx) - at(mosaic, dy, dx))
            gradients.append(first + np.abs(2 * mosaic - at(mosaic, 2 * dy, 2 * dx) - at(mosaic, -2 * dy, -2 * dx)))
        weights = [1 / (g.astype(float) + 1e-12) for g in gradients]
        mean = (weights[0] * estimates[0] + weights[1] * estimates[1]) / (weights[0] + weights[1])
        mean = np.where(errors[0] > 5.8 * errors[1], estimates[1], mean)
        return np.where(errors[1] > 5.8 * errors[0], estimates[0], mean)
    down, up, row, column = (1, 1), (1, -1), (0, 1), (1, 0)
    diagonal = fuse([along(down, mosaic), along(up, mosaic)], [down, up])
    beside = fuse([along(row, mosaic), along(column, diagonal)], [row, column])
    below = fuse([along(row, diagonal), along(column, mosaic)], [row, column])
    rows, columns = np.indices(mosaic.shape)
    images = []
    for y, x in PLACES:
        dy, dx = (rows - margin - y) % 2, (columns - margin - x) % 2
        image = np.where(dy, np.where(dx, diagonal, below), np.where(dx, beside, mosaic))
        images.append(top * image[margin:-margin, margin:-margin])
    return images


def scene(height, width, rng, of_four):
    """Codes of a mosaic with waves, edges and noise; all multiples of four where OpenCV's means shall be exact."""
    y, x = np.mgrid[:height, :width]
    light = 0.5 + 0.2 * np.sin(x / 7 + y / 11) + 0.15 * np.sign(np.sin(x / 9 - y / 5))
    turn, degree = 0.02 * x + 0.5 * np.sin(y / 13), 0.3 + 0.2 * np.sin((x + y) / 17)
    mosaic = np.zeros((height, width))
    for angle, place in zip(ANGLES, PLACES):
        mosaic += mask(mosaic.shape, place) * light * (1 + degree * np.cos(2 * (angle - turn))) / 2
    codes = np.clip((mosaic + rng.normal(0, 0.003, mosaic.shape)) * 60000, 0, 60000)
    return (np.round(codes / 4) * 4 if of_four else np.round(codes)).astype(np.uint16)


def colours(rng):
    """A colour sensor, each of whose 16 pixels has a light of its own everywhere: which are averaged where?"""
    cell = rng.integers(1000, 15000, (4, 4)) * 4
    frame = np.tile(cell, (12, 16)).astype(np.uint16)
    peer = pa.demosaicing(frame, pa.COLOR_PolarRGB)
    # Pixels of a red filter, each behind its own polarizer: polanalyser takes their green from the four green blocks around, the mean of both kinds,
    # and their blue from the four blue ones.
    for name, index in (("b", 0), ("g", 1), ("r", 2)):
        found, _ = stokes(frame, "sony-colour", flags=["--channel", name])
        expected = of([image[20 + y, 20 + x, index] for image, (y, x) in zip(peer, PLACES)])
        check(f"colour sensor, channel {name}", [np.ptp(p) for p in found] + [p[3, 3] - e for p, e in zip(found, expected)], ROUNDING * 65535)
    found, _ = stokes(frame, "0,45,135,90", flags=["--colour", "bggr", "--channel", "luminance"])
    blocks = cell.reshape(2, 2, 2, 2).mean((0, 2))
    expected = of([blocks[0, 0], blocks[0, 1], blocks[1, 1], blocks[1, 0]])
    check("colour sensor, luminance in another order", [p[3, 3] - e for p, e in zip(found, expected)], ROUNDING * 65535)


rng = np.random.default_rng(46)
compare("multiples of four", scene(96, 128, rng, True), 0)
compare("all codes", scene(62, 90, rng, False), 1)
colours(rng)
for real in sys.argv[2:]:
    compare(Path(real).name, cv2.imread(real, cv2.IMREAD_UNCHANGED), 1)
sys.exit(failed > 0)
