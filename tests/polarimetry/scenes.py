"""Photographs of gratings behind a film under circular light, by Eq. 4-6 of the 2018 paper, and how well `nacre reconstruct polarization` does on them.

Written from the paper alone, with matrices for every pixel: it shares no code with Nacre. Angles in degrees, intensities relative to white.
"""

import json
import pathlib
import subprocess
import sys

import numpy
import OpenEXR

WIDTH, HEIGHT = 240, 200
# Electrons at white and of read noise.
FULL, READ = 40_000, 8


def rotated(matrix, degrees):
    """A Jones matrix in a frame that is turned by so much; arrays of both broadcast."""
    c, s = numpy.cos(numpy.radians(degrees)), numpy.sin(numpy.radians(degrees))
    turn = numpy.moveaxis(numpy.array([[c, s], [-s, c]]), (0, 1), (-2, -1))
    return numpy.swapaxes(turn, -1, -2) @ matrix @ turn


def field(scene, orientation):
    """Jones vectors that leave the sample, for light of intensity 2."""
    light = numpy.array([1, -1j])
    film = rotated(numpy.diag([1, numpy.exp(1j * numpy.radians(scene.get("film", 0)))]), scene.get("axis", 0))
    ratio = scene["ratio"] * numpy.ones(orientation.shape)
    grating = numpy.zeros(orientation.shape + (2, 2), complex)
    grating[..., 0, 0], grating[..., 1, 1] = -1, ratio
    front = scene.get("front", 0) * numpy.eye(2)
    return (front + film @ rotated(grating, orientation) @ film) @ light


def orientations(scene, x, y):
    """True orientations at places in pixels: a slow turn, or so many stripes."""
    turn = 180 * (1.3 * x / WIDTH + 0.9 * y / HEIGHT)
    bands = scene.get("bands")
    return turn if bands is None else 180 / bands * numpy.floor(turn / 180 * bands)


def photographs(scene, random):
    """Values per analyser angle, 0 to 1, and the true orientations."""
    y, x = numpy.mgrid[:HEIGHT, :WIDTH].astype(float)
    angles = numpy.arange(scene.get("angles", 12)) * 180 / scene.get("angles", 12)
    series = []
    for k, psi in enumerate(angles):
        # A wedged analyser moves the image along a direction that turns with it.
        wedge = scene.get("wedge", 0)
        dx, dy = wedge * numpy.cos(numpy.radians(psi)), wedge * numpy.sin(numpy.radians(psi))
        e = field(scene, orientations(scene, x - dx, y - dy))
        reflectance = 1 + 0.2 * numpy.sin((x - dx) / 3) * numpy.cos((y - dy) / 2.3)
        through = abs(e @ [numpy.cos(numpy.radians(psi)), numpy.sin(numpy.radians(psi))]) ** 2
        drift = 1 + scene.get("drift", 0) * (k / len(angles) - 0.5)
        series.append(drift * reflectance * (through + scene.get("stray", 0)))
    series = numpy.array(series) * (0.8 / numpy.max(series))
    electrons = random.poisson(series * FULL) + random.normal(0, READ, series.shape)
    return angles, numpy.clip(numpy.rint(electrons / FULL * 60000 + 2000), 0, 65535).astype("u2"), orientations(scene, x, y)


def reconstructed(nacre, scene, folder, random):
    """Orientation, σ and truth in degrees of all pixels that are not masked, and the report."""
    angles, series, truth = photographs(scene, random)
    folder.mkdir()
    frames = []
    for k, (psi, values) in enumerate(zip(angles, series)):
        numpy.save(folder / f"{k:02}.npy", values)
        frames.append({"file": f"{k:02}.npy", "analyser_deg": psi})
    described = {"kind": "polarization", "transfer": "linear", "illumination": "circular_panel", "black": 2000, "white": 62000, "frames": frames}
    (folder / "frames.json").write_text(json.dumps(described))
    result = folder / "result"
    subprocess.run([nacre, "reconstruct", "polarization", folder, "--out", result], check=True, capture_output=True)
    parts = OpenEXR.File(str(result / "orientation.exr"), separate_channels=True).channels()
    theta, sigma, mask = (numpy.degrees(parts["orientation"].pixels), numpy.degrees(parts["sigma"].pixels), parts["mask"].pixels)
    seen = numpy.isfinite(theta)
    return theta[seen], sigma[seen], truth[seen], seen.mean(), json.loads((result / "report.json").read_text())


def errors(theta, truth):
    """Differences in degrees after the best common offset."""
    difference = numpy.radians(2 * (theta - truth))
    offset = numpy.angle(numpy.mean(numpy.exp(1j * difference)))
    return numpy.degrees(numpy.angle(numpy.exp(1j * (difference - offset)))) / 2


def grating(r, zeta):
    return r * numpy.exp(1j * numpy.radians(zeta))


def halves(one, two):
    """Ratios of a sample whose left half is one grating and whose right half is another."""
    return numpy.where(numpy.arange(WIDTH) < WIDTH // 2, grating(*one), grating(*two))[None, :]


# Each with the largest mean error in degrees.
SCENES = {
    "bare": ({"ratio": grating(1.1, 45)}, 0.2),
    "bare, 4 angles": ({"ratio": grating(1.1, 45), "angles": 4}, 0.3),
    "film": ({"ratio": grating(1.2, 150), "film": 10, "axis": 37}, 0.5),
    "film, 5 stripes": ({"ratio": grating(1.2, 150), "film": 10, "axis": 71, "bands": 5}, 0.5),
    "film, front reflection": ({"ratio": grating(1.2, 150), "film": 8, "axis": 20, "front": 0.15 * numpy.exp(0.7j)}, 0.6),
    "film, stray light": ({"ratio": grating(1.2, 150), "film": 10, "axis": 110, "stray": 0.04}, 0.5),
    "wedge": ({"ratio": grating(1.1, 45), "wedge": 0.4}, 0.3),
    "drift": ({"ratio": grating(1.1, 45), "drift": 0.01}, 1.5),
    "mixed": ({"ratio": halves((1.1, 45), (1.2, 30))}, 4),
    "mixed, alike": ({"ratio": halves((1.1, 45), (1.12, 50))}, 2),
    "ambiguous film": ({"ratio": grating(1.1, 45), "film": 0.5, "axis": 50, "front": 0.05 * numpy.exp(1j)}, 0.6),
    "ambiguous film, turned": ({"ratio": grating(1.1, 45), "film": 0.5, "axis": 140, "front": 0.05 * numpy.exp(4j)}, 0.6),
}


def main(nacre, *words):
    random = numpy.random.default_rng(20181)
    scored, failures = [], []
    print(f"{'scene':24} {'model':22} {'error':>6} {'σ':>6} {'1σ':>6} {'3σ':>7} {'>5σ':>7} {'seen':>6}")
    for k, (name, (scene, most)) in enumerate(SCENES.items()):
        if not all(word in name for word in words):
            continue
        theta, sigma, truth, seen, report = reconstructed(nacre, scene, pathlib.Path(f"scene{k}"), random)
        off = abs(errors(theta, truth))
        ratio = off / sigma
        shares = [(ratio < 1).mean(), (ratio < 3).mean(), (ratio > 5).mean()]
        print(f"{name:24} {report['model']:22} {off.mean():6.3f} {numpy.median(sigma):6.3f} {shares[0]:6.3f} {shares[1]:7.4f} {shares[2]:7.5f} {seen:6.3f}")
        scored.append(ratio)
        if off.mean() > most:
            failures.append(f"{name}: mean error {off.mean():.3f}°, at most {most}° expected")
        if shares[2] > 1e-3 or shares[1] < 0.99:
            failures.append(f"{name}: {shares[1]:.4f} within 3σ, {shares[2]:.5f} beyond 5σ")
        # Photographs that are moved back leave the rim open.
        if seen < 0.94:
            failures.append(f"{name}: {1 - seen:.3f} of the pixels are masked")
    pooled = (numpy.concatenate(scored) < 1).mean()
    print(f"all: {pooled:.3f} within 1σ")
    if not words and not 0.63 < pooled < 0.85:
        failures.append(f"{pooled:.3f} of all pixels are within 1σ")
    for failure in failures:
        print(f"failed: {failure}")
    sys.exit(bool(failures))


main(*sys.argv[1:])
