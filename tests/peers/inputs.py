"""Files that both sides read. Each function writes into the folder that it is given."""

import json
import os
import subprocess

import cv2
import numpy as np
import tifffile

FRAMES, WIDTH, HEIGHT = 13, 4096, 3072


def polarization(folder):
    """13 photographs of 12.6 Mpixel behind an analyser."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH].astype(np.float32)
    random = np.random.default_rng(1)
    s0, angle = 8000 + 4000 * np.sin(x / 300) * np.cos(y / 200), 0.002 * x + 0.001 * y
    frames = []
    for k in range(FRAMES):
        psi = np.pi * k / FRAMES
        light = 0.5 * s0 * (1 + 0.4 * np.cos(2 * (psi - angle))) + random.normal(0, 30, s0.shape)
        name = f"{k:03}.tif"
        tifffile.imwrite(folder / name, np.clip(light, 0, 65535).astype(np.uint16))
        frames.append({"file": name, "analyser_deg": 180 * k / FRAMES})
    (folder / "frames.json").write_text(json.dumps({"kind": "polarization", "transfer": "linear", "frames": frames}))


# Orders on a square lattice in narrow-band light, in half vectors; 2048² pixels; background exactly 0.
TABLE_SIZE, TABLE_SCALE, BAND_NM = 2048, 1e-3, 680.0


def table(folder):
    at = (np.arange(TABLE_SIZE) - 0.5 * (TABLE_SIZE - 1)) * TABLE_SCALE
    pitch, sigma = 0.085, 0.003
    m, n = np.round(at / pitch)[None, :], np.round(at / pitch)[:, None]
    square = (at[None, :] - m * pitch) ** 2 + (at[:, None] - n * pitch) ** 2
    light = np.exp(-0.5 * square / sigma**2) / (1 + 0.1 * (m * m + n * n))
    light[light < 1e-4] = 0
    tifffile.imwrite(folder / "photograph.tif", light.astype(np.float32))


EXPOSURES_S = [1 / 256, 1 / 64, 1 / 16, 1 / 4, 1.0]


def hdr(folder):
    """Five exposures of 12.6 Mpixel in colour with 8 bits, through a gamma curve."""
    x, y = np.arange(WIDTH), np.arange(HEIGHT)
    light = 0.2 * (250 / 0.2) ** np.clip((x[None, :] + 40 * np.sin(0.01 * y)[:, None]) / WIDTH, 0, 1)
    frames = []
    for k, seconds in enumerate(EXPOSURES_S):
        values = np.round(255 * np.minimum(light * seconds, 1) ** (1 / 2.2)).astype(np.uint8)
        cv2.imwrite(str(folder / f"{k}.png"), np.repeat(values[:, :, None], 3, 2))
        frames.append({"file": f"{k}.png", "exposure_s": seconds})
    about = {"kind": "exposures", "transfer": {"gamma": 2.2}, "frames": frames}
    (folder / "frames.json").write_text(json.dumps(about))


ITERATIONS, BLUR_PX = 30, 5.0


def bokeh(folder):
    """1024² pixels of blurred lines."""
    y, x = np.mgrid[0:1024, 0:1024].astype(np.float64)
    light = 20000 + 8000 * np.sign(np.sin(2 * np.pi * x / 24 + 0.2 * np.sin(y / 50)))
    blurred = cv2.GaussianBlur(light, (0, 0), BLUR_PX) + np.random.default_rng(2).normal(0, 60, light.shape)
    tifffile.imwrite(folder / "photograph.tif", np.clip(blurred, 0, 65535).astype(np.uint16))


TERMS, PIXEL_UM, DEPTH_UM = 39, 0.05, 0.5


def terms(folder):
    """A height field of 2048² pixels, as 16-bit codes over its depth."""
    x, y = np.arange(2048)[None, :], np.arange(2048)[:, None]
    height = 0.5 + 0.5 * np.cos(0.26 * x + 0.1 * y) * np.cos(1e-4 * x * y)
    tifffile.imwrite(folder / "height.tif", np.round(65535 * height).astype(np.uint16))


BOARD, SQUARE_MM, VIEWS = (9, 6), 25.0, 10


def board(folder):
    """Ten views of a chessboard, 4000 x 3000 pixels."""
    columns, rows = BOARD
    step, random = 100, np.random.default_rng(3)
    flat = np.full(((rows + 3) * step, (columns + 3) * step), 255, np.uint8)
    for i in range(rows + 1):
        for j in range(columns + 1):
            if (i + j) % 2 == 0:
                flat[(i + 1) * step:(i + 2) * step, (j + 1) * step:(j + 2) * step] = 20
    camera = np.array([[4200, 0, 2010], [0, 4200, 1490], [0, 0, 1]], float)
    for k in range(VIEWS):
        turn, _ = cv2.Rodrigues(random.uniform(-0.4, 0.4, 3))
        # From pixels of the flat picture to mm on the board, about its middle.
        to_mm = np.array([[0.25, 0, -0.125 * flat.shape[1]], [0, 0.25, -0.125 * flat.shape[0]], [0, 0, 1]])
        pose = np.column_stack([turn[:, 0], turn[:, 1], [random.uniform(-40, 40), random.uniform(-30, 30), 420]])
        view = cv2.warpPerspective(flat, camera @ pose @ to_mm, (4000, 3000), flags=cv2.INTER_AREA, borderValue=120)
        noisy = cv2.GaussianBlur(view, (0, 0), 1.2).astype(float) + random.normal(0, 2, view.shape)
        cv2.imwrite(str(folder / f"{k:02}.png"), np.clip(noisy, 0, 255).astype(np.uint8))


SHIFT_PX = 1.5


def registration(folder):
    """Nine photographs of 3.1 Mpixel behind a wedged analyser, which shifts them on a circle."""
    random = np.random.default_rng(4)
    scene = cv2.GaussianBlur(random.normal(0, 1, (1600, 2112)).astype(np.float32), (0, 0), 4.0)
    scene = 20000 + 8000 * scene / scene.std()
    orientation = cv2.GaussianBlur(random.normal(0, 1, scene.shape).astype(np.float32), (0, 0), 40.0)
    orientation *= 0.5 / orientation.std()
    frames = []
    for k in range(9):
        angle = np.pi * k / 9
        move = np.float32([[1, 0, SHIFT_PX * np.cos(2 * angle) - 32], [0, 1, SHIFT_PX * np.sin(2 * angle) - 32]])
        seen = scene * (1 + 0.3 * np.cos(2 * (angle - orientation)))
        light = cv2.warpAffine(seen, move, (2048, 1536), flags=cv2.INTER_CUBIC) + random.normal(0, 100, (1536, 2048))
        tifffile.imwrite(folder / f"{k}.tif", np.clip(light, 0, 65535).astype(np.uint16))
        frames.append({"file": f"{k}.tif", "analyser_deg": 20.0 * k})
    (folder / "frames.json").write_text(json.dumps({"kind": "polarization", "transfer": "linear", "frames": frames}))


# What lights a sheet, what it is seen with, and how many lights brute force makes of each pixel of the environment.
SKY, VIEW, FINENESS, CAMERA_MM, FOV_DEG = (128, 64), (96, 64), 2, (0.0, -150.0, 300.0), 16.0


def environment(folder):
    """A sheet with a table of broad orders in a room with windows."""
    at = (np.arange(128) - 63.5) / 64
    order = np.round(at / 0.25)
    across = np.exp(-0.5 * ((at - 0.25 * order) / 0.05) ** 2) / (1 + order**2)
    tifffile.imwrite(folder / "photograph.tif", np.outer(across, across).astype(np.float32))
    make = ["reconstruct", "lut", str(folder / "photograph.tif"), "--wavelength", "550", "--scale", str(1 / 64), "--size", "128", "--extent", "1"]
    subprocess.run([os.environ["NACRE_BIN"], *make, "--out", str(folder / "table")], check=True, capture_output=True)
    y, x = np.mgrid[0:SKY[1], 0:SKY[0]]
    sky = np.stack([0.3 + 0.2 * np.cos(2 * np.pi * x / SKY[0] + c) * np.sin(np.pi * y / SKY[1]) for c in range(3)], 2)
    sky[10:20, 40:50] = (8, 9, 10)
    sky[6:12, 90:100] = (12, 8, 5)
    cv2.imwrite(str(folder / "sky.hdr"), cv2.GaussianBlur(sky, (0, 0), 1.0)[:, :, ::-1].astype(np.float32))
    (folder / "scene.toml").write_text(f"""
[camera]
position = {list(CAMERA_MM)}
target = [0, 0, 0]
fov_deg = {FOV_DEG}
width = {VIEW[0]}
height = {VIEW[1]}
[[shape]]
type = "plane"
size = [1000, 1000]
material = "sheet"
[[light]]
type = "environment"
file = "sky.hdr"
up = [0, 0, 1]
[material.sheet]
diffraction = {{ type = "table", file = "table/lut.exr" }}
""")
