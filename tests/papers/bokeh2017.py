"""Rows of the 2017 TOG paper's section 5 and appendix C: bokeh photographs, and orders of Taylor's series."""

import math

import numpy as np
from scipy import ndimage

from rows import AGREES, PAPER_OFF, Outcome, Row

LENS = "--lens-focal-mm 250 --f-number 5.6 --distance-m 0.85"


def scene(**values):
    text = "".join(f"{k} = {v!r}\n".replace("'", '"') for k, v in values.items())
    return lambda folder: (folder / "lines.toml").write_text(text)


def scale(run):
    report = run.reports[-1]
    count, pixel = report["lines"]["count"], report["scale"]["pixel_um"]
    return Outcome(f"{count:.1f} lines, {pixel:.5f} µm per pixel", f"{2128 * 0.083 * 0.6:.1f}, 0.08300", abs(pixel / 0.083 - 1) < 1e-3, AGREES)


def refused(run):
    na = math.sin(math.atan(250 / (2 * 5.6 * 850)))
    right = 0.45 / (2 * na)
    said = f"{right:.2f} µm" in run.messages[-1]
    return Outcome("refused" + (f": cut-off {right:.2f} µm" if said else ""), f"λ/(2 NA) = {right:.2f} µm", run.codes[-1] == 2 and said, PAPER_OFF)


def lucy(photo, iterations=30):
    """The textbook loop with a Gaussian of 2 px."""
    estimate = np.full_like(photo, photo.mean())
    blur = lambda image: ndimage.gaussian_filter(image, 2.0, truncate=4.0, mode="nearest")
    for _ in range(iterations):
        estimate = estimate * blur(photo / np.maximum(blur(estimate), 1e-9))
    return estimate


def rmse(run):
    """Eq. 27 on the same photograph by SciPy: over all phases, the best affine map of a slice onto the sawtooth."""
    ours = run.json("known/calibration.json")["rmse_um"] / 0.4
    light = lucy(read_png16(run.folder / "../once/bokeh/photograph.png"))
    line = light[light.shape[0] // 2 - 7:light.shape[0] // 2 + 8].mean(0)
    design = np.stack([line, np.ones(line.size)], 1)
    right = 1.0
    for phase in np.arange(0, 16, 0.1):
        saw = (np.arange(line.size) + phase) / 16 % 1
        fit = design @ np.linalg.lstsq(design, saw, rcond=None)[0]
        right = min(right, np.sqrt(((fit - saw) ** 2).mean()))
    return Outcome(f"{100 * ours:.1f} %", f"{100 * right:.1f} % (SciPy); grows with blur over period", abs(ours - right) < 0.01)


def deconvolved(run):
    ours = run.exr("r/deconvolved.exr", "Y")
    estimate = lucy(read_png16(run.folder / "../once/bokeh/photograph.png"))
    inner = (slice(100, -100), slice(100, -100))
    off = np.sqrt(((ours - estimate)[inner] ** 2).mean()) / estimate[inner].std()
    return Outcome(f"{100 * off:.3f} % of the contrast off", "textbook loop (SciPy), 30 iterations", off < 0.01, AGREES)


def read_png16(file):
    """A grey PNG of 16 bits as 0 to 1."""
    import struct
    import zlib

    data, at, body, head = file.read_bytes(), 8, b"", None
    while at < len(data):
        size, kind = struct.unpack(">I4s", data[at:at + 8])
        chunk = data[at + 8:at + 8 + size]
        head = chunk if kind == b"IHDR" else head
        body += chunk if kind == b"IDAT" else b""
        at += 12 + size
    width, height, bits, color = struct.unpack(">IIBB", head[:10])
    if (bits, color) != (16, 0):
        raise ValueError(f"{file.name} is not grey with 16 bits")
    raw = np.frombuffer(zlib.decompress(body), "u1").reshape(height, 1 + 2 * width)
    rows = np.zeros((height, 2 * width + 2), int)
    above = np.zeros(2 * width + 2, int)
    for y in range(height):
        kind, line, row = raw[y, 0], raw[y, 1:].astype(int), rows[y]
        if kind in (0, 2):
            row[2:] = (line + (above[2:] if kind == 2 else 0)) % 256
        else:
            for k in range(2 * width):
                left, up, corner = row[k], above[k + 2], above[k]
                if kind == 1:
                    guess = left
                elif kind == 3:
                    guess = (left + up) // 2
                else:
                    p = left + up - corner
                    guess = min((abs(p - left), 0, left), (abs(p - up), 1, up), (abs(p - corner), 2, corner))[2]
                row[k + 2] = (line[k] + guess) % 256
        above = row
    values = rows[:, 2:].reshape(height, width, 2)
    return (values[..., 0] * 256 + values[..., 1]) / 65535


def count_slits(run):
    slits = run.reports[-1]["slits"]
    text = f"{slits['count']} slits, {slits['spacing_um'][0]:.3f} µm apart, {slits['width_um'][0]:.3f} µm wide"
    good = slits["count"] == 21 and abs(slits["spacing_um"][0] - 2) < 0.01 and abs(slits["width_um"][0] - 0.5) < 0.02
    return Outcome(text, "21, 2.0, 0.5", good, AGREES)


def taylor_orders(run):
    """First-order peaks of a rectangular grating by powers up to 1, 2 and 5 over the exact one."""
    peak = {}
    for n in ("1", "2", "5", "all"):
        table = run.csv(f"s{n}.csv")
        side = table["theta_r_deg"] > 1.5
        peak[n] = np.nanmax(table["reflectance"][side])
    ours = [peak[n] / peak["all"] for n in ("1", "2", "5")]
    # Two levels: both orders carry |p(h1) - p(h2)|²; Nacre's powers are those of heights about their mean, as the file's levels are.
    x = 2 * np.pi / 0.55 * (1 + np.cos(np.arcsin(0.055))) * 0.2
    series = lambda n, t: sum((1j * t) ** k / math.factorial(k) for k in range(n + 1))
    right = {}
    for origin in (0.0, 0.5):
        step = lambda p: abs(p(x * (1 - origin)) - p(-x * origin)) ** 2
        right[origin] = [step(lambda t: series(n, t)) / step(lambda t: np.exp(1j * t)) for n in (1, 2, 5)]
    off = {o: max(abs(a / b - 1) for a, b in zip(ours, r)) for o, r in right.items()}
    best = min(off, key=off.get)
    text = lambda v: ", ".join(f"{t:.2f}" for t in v)
    return Outcome(text(ours), f"{text(right[best])} (two levels, heights from {'their middle' if best else 'the ground'})", off[best] < 0.03, AGREES)


def rendered(run):
    table = run.csv("slice.csv")
    side = (table["theta_r_deg"] > 0.4) & (table["theta_r_deg"] < 1.2)
    theta = table["theta_r_deg"][side][np.nanargmax(table["reflectance"][side])]
    right = np.degrees(np.arcsin(0.55 / 40))
    return Outcome(f"first order at {theta:.3f}°", f"{right:.3f}° (grating equation)", abs(theta - right) < 0.011)


BOKEH = "sim photograph bokeh --out bokeh"
PHOTO = "../once/bokeh/photograph.png"
ROWS = [
    Row("2017-bokeh-scale", "C; Fig. 27", "600 lines/mm counted: size of a pixel", "about 106 lines, 0.083 µm",
        ("sim photograph bokeh --scene lines.toml --out photo", "reconstruct bokeh photo/photograph.png --psf-sigma 2 --lines-per-mm 600 --out r"),
        prepare=scene(profile="blazed", period_um=1 / 0.6, pixel_um=0.083, width=2128, height=64), read=scale),
    Row("2017-bokeh-lens", "5; C", f"the same through 250 mm, f/5.6, 0.85 m", "lines of 1.67 µm seen", ("sim photograph bokeh --scene lines.toml --out photo",
        f"reconstruct bokeh photo/photograph.png --psf-sigma 2 --lines-per-mm 600 {LENS} --out r"),
        prepare=scene(profile="blazed", period_um=1 / 0.6, pixel_um=0.083, width=2128, height=64), read=refused),
    Row("2017-bokeh-heights", "Eq. 27; Fig. 28, 29", "heights of a known blazed grating: RMSE over its depth, lines of 16 px, blur 2 px", "5.83 % (its lens and lines)",
        (f"reconstruct bokeh {PHOTO} --psf-sigma 2 --pixel-um 2.5 --iterations 30 --no-accelerate --known-shape blazed --known-depth-um 0.4 --out known",), (BOKEH,), read=rmse),
    Row("2017-bokeh-lucy", "5.2; Fig. 11", "Richardson-Lucy, Gaussian, 30 iterations", "Matlab's",
        (f"reconstruct bokeh {PHOTO} --psf-sigma 2 --pixel-um 2.5 --iterations 30 --no-accelerate --out r",), (BOKEH,), read=deconvolved),
    Row("2017-bokeh-slits", "6.1; Fig. 9b", "slits of a CD that are lit", "N = 21", ("sim photograph bokeh --scene lines.toml --out photo",
        "reconstruct bokeh photo/photograph.png --psf-sigma 2 --pixel-um 0.1 --out r"),
        prepare=scene(profile="rectangular", duty=0.25, period_um=2.0, pixel_um=0.1, width=560, height=200, highlight_px=208), read=count_slits),
    Row("2017-taylor", "5.2; Fig. 13", "orders 1, 2, 5 of Taylor's series, rectangles 10 µm apart, 0.2 µm deep: first order over the exact one", "first order looks best",
        ("brdf surface rectangular --period-um 10 --depth-um 0.2 --pixels 400 --pixel-um 0.1 --out h.exr",
         *(f"brdf slice h.exr --wavelengths 550 --views 0:5:0.01 --method taylor --order {n} --max-error 0.5 --out s{n}.csv" for n in (1, 2, 5)),
         "brdf slice h.exr --wavelengths 550 --views 0:5:0.01 --out sall.csv"), read=taylor_orders),
    Row("2017-bokeh-render", "5.2; Fig. 12, 19", "heights from a bokeh photograph (40 µm) through the first order", "pictures",
        (f"reconstruct bokeh {PHOTO} --psf-sigma 2 --pixel-um 2.5 --known-shape blazed --known-depth-um 0.1 --out known",
         "brdf slice known/height.exr --coherence-um 250 --wavelengths 550 --views 0:1.5:0.005 --method taylor --order 1 --max-error 0.5 --out slice.csv"), (BOKEH,), read=rendered),
]
