"""Tables of `nacre brdf tables` as other programs read them: Mitsuba's `measured` material, and the MERL set's format.

usage: python tests/elsewhere/measured.py NACRE_BINARY

Prints `name | measured | bound` for each agreement, and exits with 1 if one fails. The truth is `nacre brdf slice`.
"""

import csv
import json
import math
import os
import subprocess
import sys
import tempfile

import mitsuba as mi
import numpy as np

NACRE = os.path.abspath(sys.argv[1])
VIEWS = range(-75, 76, 5)
failed = []

# Interpolation between entries: five times what the report states of itself.
VALUES = 0.05
# Scalar theory of a shallow grating returns all light but for orders below the surface, and overestimates oblique ones.
ENERGY = 0.03
# Samples that follow the density have equal weights; a cosine lobe in its place has a deviation above 2.
SAMPLES = 0.3
# Entries of MERL are a degree wide, and so are lobes.
MEANS = 0.1


def agree(name, measured, bound):
    good = measured <= bound
    print(f"{name} | {measured:.3g} | {bound:g}" + ("" if good else " | FAILED"))
    if not good:
        failed.append(name)


def nacre(*arguments):
    subprocess.run([NACRE, *map(str, arguments)], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def slice_of(heights, light, azimuth, coherence_um, *more):
    """BRDF by wavelength and angle of view along a half circle."""
    nacre("brdf", "slice", heights, *more, "--light", f"{light},{azimuth}", "--wavelengths", "400:760:20", f"--views={VIEWS[0]}:{VIEWS[-1]}:5",
          "--coherence-um", coherence_um, "--out", "slice.csv", "--force")
    with open("slice.csv") as file:
        return [tuple(map(float, row)) for row in list(csv.reader(file))[1:]]


def direction(theta_deg, azimuth_deg):
    theta, phi = math.radians(theta_deg), math.radians(azimuth_deg)
    return mi.Vector3f(math.sin(theta) * math.cos(phi), math.sin(theta) * math.sin(phi), math.cos(theta))


def interaction(light, nm):
    si = mi.SurfaceInteraction3f()
    si.wavelengths, si.wi = [nm] * 4, light
    return si


def tensor():
    """Values, energy and samples of a shallow grating."""
    mi.set_variant("scalar_spectral")
    nacre("brdf", "surface", "sinusoid", "--period-um", 2, "--depth-um", 0.1, "--pixels", 80, "--pixel-um", 0.05, "--out", "grating.exr")
    nacre("brdf", "tables", "grating.exr", "--size", 48, "--angles", "12,24", "--out", "grating.bsdf")
    with open("grating.json") as file:
        report = json.load(file)
    agree("Mitsuba tensor: error that the report states", report["table_error"], VALUES)
    material = mi.load_dict({"type": "measured", "filename": "grating.bsdf"})
    context, random = mi.BSDFContext(), np.random.default_rng(1)
    for light, azimuth in ((0, 0), (20, 0), (45, 0), (30, 40)):
        rows = slice_of("grating.exr", light, azimuth, report["settings"]["coherence_um"])
        found, truth = [], []
        for nm, view, brdf in rows:
            value = material.eval(context, interaction(direction(light, azimuth), nm), direction(view, azimuth))
            found.append(value[0])
            truth.append(brdf * math.cos(math.radians(view)))
        found, truth = np.array(found), np.array(truth)
        error = math.sqrt(((found - truth) ** 2).mean() / (truth**2).mean())
        agree(f"Mitsuba tensor: BRDF for light at {light}°, {azimuth}° (root mean square)", error, VALUES)
        # The mean weight of samples is the reflected light: one, but for orders below the surface.
        si = interaction(direction(light, azimuth), 550)
        weights = np.array([material.sample(context, si, 0.5, random.random(2))[1][0] for _ in range(3000)])
        agree(f"Mitsuba tensor: reflected light at {light}°, {azimuth}°, from one", abs(weights.mean() - 1), ENERGY)
        agree(f"Mitsuba tensor: deviation of samples at {light}°, {azimuth}°", float(weights.std()), SAMPLES)


def merl_index(light, view):
    """Entry of a pair of directions (Matusik et al. 2003), computed from the vectors."""
    half = (light + view) / np.linalg.norm(light + view)
    theta_h, phi_h = math.acos(min(half[2], 1)), math.atan2(half[1], half[0])
    turn = lambda v, angle: np.array([v[0] * math.cos(angle) - v[1] * math.sin(angle), v[0] * math.sin(angle) + v[1] * math.cos(angle), v[2]])
    tilt = lambda v, angle: np.array([v[0] * math.cos(angle) + v[2] * math.sin(angle), v[1], v[2] * math.cos(angle) - v[0] * math.sin(angle)])
    difference = tilt(turn(light, -phi_h), -theta_h)
    theta_d, phi_d = math.acos(min(max(difference[2], -1), 1)), math.atan2(difference[1], difference[0]) % math.pi
    return (min(int(math.sqrt(theta_h / (math.pi / 2)) * 90), 89), min(int(theta_d / (math.pi / 2) * 90), 89), min(int(phi_d / math.pi * 180), 179))


def merl():
    """An isotropic surface, against means over azimuths of the light."""
    random, size = np.random.default_rng(3), 256
    frequency = np.hypot(*np.meshgrid(*[np.fft.fftfreq(size, 0.08)] * 2))
    heights = np.fft.ifft2(np.fft.fft2(random.normal(size=(size, size))) * np.exp(-((frequency / 0.5) ** 2))).real
    np.savetxt("bumps.txt", 0.05 * heights / heights.std(), fmt="%.6f")
    scale = ["--pixel-um", 0.08, "--range-um", round(0.05 * float(np.ptp(heights)) / float(heights.std()), 6)]
    nacre("brdf", "tables", "bumps.txt", *scale, "--out", "bumps.binary")
    with open("bumps.json") as file:
        report = json.load(file)
    with open("bumps.binary", "rb") as file:
        shape = np.fromfile(file, "<i4", 3)
        values = np.fromfile(file, "<f8").reshape(3, *shape)
    agree("MERL: entries that differ from 90 × 90 × 180", int(np.abs(shape - [90, 90, 180]).sum()), 0)
    table = values * np.array([1, 1.15, 1.66]).reshape(3, 1, 1, 1) / 1500
    agree("MERL: deviation from isotropy that the report states", report["table_error"], 0.5)
    found, truth = [], []
    for light in (10, 40):
        mean = np.mean([luminances("bumps.txt", light, azimuth, report["settings"]["coherence_um"], scale) for azimuth in range(0, 360, 30)], axis=0)
        for view, expected in zip(VIEWS, mean):
            pair = [np.array([math.sin(math.radians(a)), 0, math.cos(math.radians(a))]) for a in (light, view)]
            rgb = table[:, *merl_index(*pair)]
            found.append(rgb @ [0.2126, 0.7152, 0.0722])
            truth.append(expected)
    found, truth = np.array(found), np.array(truth)
    agree("MERL: means over azimuths (root mean square)", math.sqrt(((found - truth) ** 2).mean() / (truth**2).mean()), MEANS)


def luminances(heights, light, azimuth, coherence_um, scale):
    """Y of the BRDF by angle of view, with a Gaussian for the observer's curve and a line for D65."""
    sums, weights = np.zeros(len(VIEWS)), 0.0
    rows = np.array(slice_of(heights, light, azimuth, coherence_um, *scale))
    for nm in np.unique(rows[:, 0]):
        weight = math.exp(-0.5 * ((nm - 559) / 42.5) ** 2) * (1 - 0.0018 * (nm - 560))
        sums += weight * rows[rows[:, 0] == nm, 2]
        weights += weight
    return sums / weights


with tempfile.TemporaryDirectory() as place:
    os.chdir(place)
    tensor()
    merl()
    os.chdir("/")
sys.exit(f"failed: {', '.join(failed)}" if failed else 0)
