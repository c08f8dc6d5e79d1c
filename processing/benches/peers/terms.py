"""CPU time of 39 transforms of powers of a patch of 2048 x 2048 pixels, as the 2014 thesis makes them, by SciPy's real transform in single
precision, for comparison with `cargo run --release --example terms`.

pip install scipy
"""
import resource
import time

import numpy as np
import scipy.fft

SIDE, TERMS = 2048, 39


def main():
    x, y = np.arange(SIDE)[None, :], np.arange(SIDE)[:, None]
    height = (0.25 + 0.25 * np.cos(0.26 * x + 0.1 * y) * np.cos(1e-4 * x * y)).astype(np.float32)
    used = lambda: sum(resource.getrusage(resource.RUSAGE_SELF)[:2])
    for workers in (1, 2):
        # The least of several, as others use this machine too.
        least = [np.inf, np.inf]
        for _ in range(5):
            begun, wall = used(), time.time()
            power = np.ones_like(height)
            for _ in range(TERMS):
                scipy.fft.rfft2(power, workers=workers)
                power *= height
            least = [min(least[0], used() - begun), min(least[1], time.time() - wall)]
        print(f"{workers} threads: {least[0]:.2f} CPU-seconds, {least[1]:.2f} s")


main()
