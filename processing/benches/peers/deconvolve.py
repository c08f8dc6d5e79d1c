"""Time and result of Richardson-Lucy by scikit-image and by a loop over OpenCV's sepFilter2D, for comparison with
`cargo run --release --example deconvolve`.

pip install scikit-image opencv-python-headless
"""
import resource
import time

import cv2
import numpy as np
from skimage.restoration import richardson_lucy

SIDE, SIGMA, RADIUS, ITERATIONS = 1024, 5.0, 15, 30
PLACES = [(512, 512), (300, 700), (0, 0), (1023, 511), (2, 900)]


def photograph():
    """Lines and dots, as the example has them."""
    x, y = np.arange(SIDE)[None, :], np.arange(SIDE)[:, None]
    return (0.5 + 0.06 * np.sin(0.35 * x + 0.15 * y) + 0.1 * np.cos(1e-4 * x * y)).astype(np.float32)


def opencv(light, line):
    """The same iteration with OpenCV, into buffers that are kept."""
    blur = lambda image, out: cv2.sepFilter2D(image, -1, line, line, dst=out, borderType=cv2.BORDER_CONSTANT)
    estimate = np.full_like(light, 0.5)
    blurred, ratio = np.empty_like(light), np.empty_like(light)
    for _ in range(ITERATIONS):
        blur(estimate, blurred)
        cv2.divide(light, blurred, dst=ratio)
        blur(ratio, blurred)
        cv2.multiply(estimate, blurred, dst=estimate)
    return estimate


def main():
    light = photograph()
    line = np.exp(-0.5 * (np.arange(-RADIUS, RADIUS + 1) / SIGMA) ** 2)
    line /= line.sum()
    used = lambda: sum(resource.getrusage(resource.RUSAGE_SELF)[:2])
    ways = {
        "OpenCV, 1 thread": (lambda: opencv(light, line.astype(np.float32)), 1),
        "OpenCV, 2 threads": (lambda: opencv(light, line.astype(np.float32)), 2),
        "scikit-image": (lambda: richardson_lucy(light.astype(float), np.outer(line, line), ITERATIONS, clip=False), 1),
    }
    for name, (run, threads) in ways.items():
        cv2.setNumThreads(threads)
        for _ in range(1 if name == "scikit-image" else 3):
            begun, wall = used(), time.time()
            found = run()
            took, wall = used() - begun, time.time() - wall
            print(f"{name:17} {took:.2f} CPU-seconds, {wall:.3f} s  ", *(f"{found[y, x]:.5f}" for x, y in PLACES))


main()
