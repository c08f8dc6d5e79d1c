"""What others do with the same files: `peers.py PEER FOLDER`. Results stay in memory; each prints numbers to be compared."""

import json
import sys
from pathlib import Path

import cv2
import numpy as np
import tifffile

import inputs


def read_series(folder):
    frames = json.loads((folder / "frames.json").read_text())["frames"]
    return [f["analyser_deg"] for f in frames], [tifffile.imread(folder / f["file"]) for f in frames]


def polarization_numpy(folder):
    """Least squares, angle and degree of linear polarization."""
    angles, frames = read_series(folder)
    psi = np.radians(angles)
    design = np.stack([np.ones(len(psi)), np.cos(2 * psi), np.sin(2 * psi)], 1)
    inverse = (2 * np.linalg.pinv(design)).astype(np.float32)
    s0, s1, s2 = inverse @ np.stack(frames).reshape(len(frames), -1).astype(np.float32)
    angle, degree = 0.5 * np.arctan2(s2, s1), np.hypot(s1, s2) / s0
    return float(degree.mean()), float(angle.mean())


def polarization_polanalyser(folder):
    import polanalyser

    angles, frames = read_series(folder)
    stokes = polanalyser.calcStokes(np.stack(frames).astype(np.float32), [polanalyser.polarizer(a) for a in np.radians(angles)])
    return float(polanalyser.cvtStokesToDoLP(stokes).mean()), float(polanalyser.cvtStokesToAoLP(stokes).mean())


def table_opencv(folder):
    """One remap per wavelength in steps of 5 nm, added up in three channels (cubic, with the weights of one observer)."""
    photograph = tifffile.imread(folder / "photograph.tif")
    wavelengths = np.arange(380, 781, 5.0)
    # Any three weights take the same time; these are Gaussians near to the observer's.
    seen = np.stack([np.exp(-0.5 * ((wavelengths - m) / s) ** 2) for m, s in ((600, 40), (555, 45), (450, 25))], 1)
    center, size = 0.5 * (inputs.TABLE_SIZE - 1), inputs.TABLE_SIZE
    h = ((2 * np.arange(size) + 1) / size - 1).astype(np.float32)
    u, v = np.meshgrid(h, h)
    result = np.zeros((size, size, 3), np.float32)
    for nm, weights in zip(wavelengths, seen):
        factor = inputs.BAND_NM / nm
        x, y = (w * np.float32(factor / inputs.TABLE_SCALE) + np.float32(center) for w in (u, v))
        warped = cv2.remap(photograph, x, y, cv2.INTER_LINEAR)
        for c in range(3):
            result[:, :, c] += np.float32(factor**4 * weights[c]) * warped
    return float(result.mean())


def hdr_opencv(folder, merge):
    frames = [cv2.imread(str(folder / f"{k}.png")) for k in range(len(inputs.EXPOSURES_S))]
    response = ((np.arange(256) / 255) ** 2.2).astype(np.float32)
    response[0] = response[1] / 4
    response = np.repeat(response[:, None, None], 3, 2)
    return float(merge.process(frames, np.array(inputs.EXPOSURES_S, np.float32), response).mean())


def bokeh_opencv(folder):
    light = tifffile.imread(folder / "photograph.tif").astype(np.float32)
    reach = 15
    line = np.exp(-0.5 * (np.arange(-reach, reach + 1) / inputs.BLUR_PX) ** 2).astype(np.float32)
    line /= line.sum()
    blur = lambda image, out: cv2.sepFilter2D(image, -1, line, line, dst=out, borderType=cv2.BORDER_REPLICATE)
    estimate = np.full_like(light, light.mean())
    blurred, ratio = np.empty_like(light), np.empty_like(light)
    for _ in range(inputs.ITERATIONS):
        blur(estimate, blurred)
        cv2.divide(light, blurred, dst=ratio)
        blur(ratio, blurred)
        cv2.multiply(estimate, blurred, dst=estimate)
    return float(estimate.std())


def bokeh_scikit_image(folder):
    from skimage.restoration import richardson_lucy

    light = tifffile.imread(folder / "photograph.tif").astype(np.float32) / 65535
    line = np.exp(-0.5 * (np.arange(-15, 16) / inputs.BLUR_PX) ** 2)
    return float(richardson_lucy(light, np.outer(line, line) / line.sum() ** 2, inputs.ITERATIONS, clip=False).std())


def terms_scipy(folder):
    """The transforms of the first 39 powers, in single precision."""
    import scipy.fft

    height = (inputs.DEPTH_UM / 65535) * tifffile.imread(folder / "height.tif").astype(np.float32)
    power, total = np.ones_like(height), 0.0
    for _ in range(inputs.TERMS):
        total += float(abs(scipy.fft.rfft2(power, workers=2)[0, 0]))
        power *= height
    return total


def board_opencv(folder):
    columns, rows = inputs.BOARD
    points = np.zeros((rows * columns, 3), np.float32)
    points[:, :2] = inputs.SQUARE_MM * np.mgrid[0:columns, 0:rows].T.reshape(-1, 2)
    found = []
    for file in sorted(folder.glob("*.png")):
        grey = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
        seen, corners = cv2.findChessboardCorners(grey, inputs.BOARD)
        if seen:
            until = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 1e-3)
            found.append(cv2.cornerSubPix(grey, corners, (11, 11), (-1, -1), until))
    rms, camera, *_ = cv2.calibrateCamera([points] * len(found), found, grey.shape[::-1], None, None)
    return float(rms), float(camera[0, 0])


def moved_back(folder, shift_of):
    """Photographs moved onto the first: the largest error of a shift in pixels, and the mean of their mean."""
    _, frames = read_series(folder)
    first, total, worst = frames[0].astype(np.float32), 0.0, 0.0
    for k, frame in enumerate(frames):
        frame, angle = frame.astype(np.float32), 2 * np.pi * k / len(frames)
        x, y = shift_of(first, frame) if k else (0.0, 0.0)
        true = inputs.SHIFT_PX * (np.cos(angle) - 1), inputs.SHIFT_PX * np.sin(angle)
        worst = max(worst, np.hypot(x - true[0], y - true[1]))
        back = np.float32([[1, 0, x], [0, 1, y]])
        total = total + cv2.warpAffine(frame, back, frame.shape[::-1], flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP)
    return float(worst), float((total / len(frames)).mean())


def shift_ecc(first, frame):
    until = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 50, 1e-6)
    _, found = cv2.findTransformECC(first, frame, np.eye(2, 3, dtype=np.float32), cv2.MOTION_TRANSLATION, until, None, 5)
    return found[:, 2]


def shift_scikit_image(first, frame):
    from skimage.registration import phase_cross_correlation

    y, x = phase_cross_correlation(first - first.mean(), frame - frame.mean(), upsample_factor=100, normalization=None)[0]
    return -x, -y


# IEC 61966-2-1.
XYZ_TO_SRGB = np.float32([[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]])


def environment_numpy(folder):
    """Brute force: the sum over all lights of the environment, at each pixel (2017 TOG paper, Eq. 9). The picture's colours in its middle."""
    import OpenEXR

    channels = OpenEXR.File(str(folder / "table/lut.exr")).channels()
    pixels = np.stack([channels[c].pixels for c in "XYZ"], 2) @ XYZ_TO_SRGB.T
    size, sky = pixels.shape[0], cv2.imread(str(folder / "sky.hdr"), cv2.IMREAD_UNCHANGED)[:, :, ::-1].astype(np.float32)
    # Lights: between pixels the environment is linear. The middle column lies towards +x, azimuth grows to the left.
    (wide, high), fine = inputs.SKY, inputs.FINENESS
    v, u = np.mgrid[0:high * fine // 2, 0:wide * fine].astype(np.float32)
    polar, azimuth = np.pi * (v + 0.5) / (high * fine), 2 * np.pi * (0.5 - (u + 0.5) / (wide * fine))
    power = cv2.remap(np.pad(sky, ((0, 0), (1, 1), (0, 0)), mode="wrap"), (u + 0.5) / fine + 0.5, (v + 0.5) / fine - 0.5, cv2.INTER_LINEAR)
    power *= (np.sin(polar) * (np.pi / (high * fine)) * (2 * np.pi / (wide * fine)))[:, :, None]
    light = np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], 2).reshape(-1, 3)
    power = power.reshape(-1, 3)
    eye = np.float32(inputs.CAMERA_MM)
    ahead = -eye / np.linalg.norm(eye)
    right = np.cross(ahead, (0, 1, 0))
    right /= np.linalg.norm(right)
    up, (columns, rows), tall = np.cross(right, ahead), inputs.VIEW, np.tan(np.radians(inputs.FOV_DEG / 2))
    picture = np.empty((rows, columns, 3), np.float32)
    for row in range(rows):
        for column in range(columns):
            x, y = (2 * column + 1 - columns) / rows, 1 - (2 * row + 1) / rows
            view = -(ahead + tall * (x * right + y * up))
            view = (view / np.linalg.norm(view)).astype(np.float32)
            h = light[:, :2] + view[:2]
            at = [((h[:, 0] + 1) * size - 1) / 2, ((1 - h[:, 1]) * size - 1) / 2]
            known = cv2.remap(pixels, *at, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT).reshape(-1, 3)
            picture[row, column] = ((1 + light @ view) ** 2 / view[2]) @ (known * power)
    np.save(folder / "numpy.npy", picture)
    return picture[rows // 2, columns // 2].tolist()


PEERS = {
    "numpy": polarization_numpy,
    "polanalyser": polarization_polanalyser,
    "OpenCV remap": table_opencv,
    "OpenCV Debevec": lambda folder: hdr_opencv(folder, cv2.createMergeDebevec()),
    "OpenCV Robertson": lambda folder: hdr_opencv(folder, cv2.createMergeRobertson()),
    "OpenCV loop": bokeh_opencv,
    "scikit-image": bokeh_scikit_image,
    "SciPy": terms_scipy,
    "OpenCV chessboard": board_opencv,
    "OpenCV ECC": lambda folder: moved_back(folder, shift_ecc),
    "scikit-image phases": lambda folder: moved_back(folder, shift_scikit_image),
    "numpy, brute force": environment_numpy,
}

if __name__ == "__main__":
    print(PEERS[sys.argv[1]](Path(sys.argv[2])))
