#!/usr/bin/env python3
"""The fit's peer: numpy's pseudo-inverse times the frames, on one thread. Needs numpy; times are CPU seconds.

13 frames of 4096 x 3072 float32 in memory give S0, S1 and S2. `speed` (processing/examples) is Nacre's turn.
"""

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"

import time

import numpy as np

PIXELS, FRAMES, ROUNDS = 4096 * 3072, 13, 20


def main():
    angles = np.pi * np.arange(FRAMES) / FRAMES
    design = np.stack([np.ones(FRAMES), np.cos(2 * angles), np.sin(2 * angles)], axis=1)
    inverse = (2 * np.linalg.pinv(design)).astype(np.float32)
    frames = np.empty((FRAMES, PIXELS), np.float32)
    for k in range(FRAMES):
        frames[k] = 1000 + (7 * np.arange(PIXELS) + 13 * k) % 251
    maps, copied = np.empty((3, PIXELS), np.float32), np.zeros_like(frames)
    jobs = {
        "copy of 13 frames": lambda: np.copyto(copied, frames),
        "pseudo-inverse, into maps": lambda: np.matmul(inverse, frames, out=maps),
        "the same, maps made anew": lambda: inverse @ frames,
    }
    seconds = {name: [] for name in jobs}
    for _ in range(ROUNDS):
        for name, job in jobs.items():
            begun = time.process_time()
            job()
            seconds[name].append(time.process_time() - begun)
    print(f"numpy {np.__version__}, one thread, CPU seconds: least, median")
    for name, times in seconds.items():
        print(f"{name:28} {min(times):.4f} {sorted(times)[len(times) // 2]:.4f}")


main()
