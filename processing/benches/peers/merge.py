"""Time and error of OpenCV's Debevec merge, for comparison with `cargo run --release --example merge`.

pip install opencv-python-headless
"""
import resource
import time

import cv2
import numpy as np

WIDTH, HEIGHT, TIMES = 4096, 3072, np.array([1 / 256, 1 / 64, 1 / 16, 1 / 4, 1], np.float32)


def scene():
    """Light from 0.2 to 250, evenly in its logarithm, as the example has it."""
    x, y = np.arange(WIDTH), np.arange(HEIGHT)
    place = np.clip((x[None, :] + 0.37 * np.sin(1.7 * y)[:, None]) / WIDTH, 0, 1)
    return 0.2 * (250 / 0.2) ** place


def main():
    light = scene()
    frames = [np.round(255 * np.minimum(light * t, 1) ** (1 / 2.2)).astype(np.uint8) for t in TIMES]
    frames = [np.repeat(f[:, :, None], 3, 2) for f in frames]
    response = ((np.arange(256) / 255) ** 2.2).astype(np.float32)
    response[0] = response[1] / 4
    response = np.repeat(response[:, None, None], 3, 2)
    used = lambda: sum(resource.getrusage(resource.RUSAGE_SELF)[:2])
    begun, wall = used(), time.time()
    merged = cv2.createMergeDebevec().process(frames, TIMES, response)
    print(f"{used() - begun:.2f} CPU-seconds, {time.time() - wall:.2f} s")
    ratio = merged[:, :, 0] / light
    covered = light > 0.25
    ratio = ratio[covered] / np.median(ratio[covered])
    print(f"RMS {100 * np.sqrt(np.mean((ratio - 1) ** 2)):.2f} %")


main()
