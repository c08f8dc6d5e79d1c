"""Rows of the 2017 paper on practical diffraction: lookup tables and analytic patterns. Bokeh photographs are in bokeh2017."""

import numpy as np
from scipy import optimize, special

import bokeh2017
import skies
import tables2017 as tables
import truth
from rows import AGREES, EXACTER, PAPER_OFF, Outcome, Row, write_exr

TITLE = "Practical acquisition of diffraction effects (ACM TOG 2017)"
SIZE = 200
LUT = f"reconstruct lut photo.exr --wavelength 680 --scale {tables.SCALE} --center 499.5,499.5 --extent 1 --size {SIZE}"


def read_table(run, folder):
    parts = run.exr(f"{folder}/lut.exr")
    return np.array([parts[c] for c in "XYZ"])


def exact(run):
    x, y = tables.grid(SIZE)
    right = tables.entries(x, y)
    ours = tables.rim(read_table(run, "table"), right, x, y)
    # Both other steps by the same trapezoid in NumPy: what the paper's step costs.
    theirs = [tables.rim(tables.entries(x, y, step=s), right, x, y) for s in (5, 10, 20)]
    text = f"{100 * ours:.2f} %; trapezoid in steps of 5, 10, 20 nm {', '.join(f'{100 * t:.0f}' for t in theirs)} %"
    return Outcome(text, "sums in steps of 0.25 nm (NumPy): 0", ours < 0.01, EXACTER)


def fixed(run):
    x, y = tables.grid(SIZE)
    right = tables.entries(x, y, exponent=2, step=5)
    off = tables.rim(read_table(run, "table"), right, x, y)
    return Outcome(f"{100 * off:.2f} % off", "Eq. 15, trapezoid at 5 nm (NumPy)", off < 0.02, AGREES)


def warped(run):
    x, y = tables.grid(SIZE, warp=5)
    table, right = read_table(run, "table"), tables.entries(x, y)
    inner = np.hypot(x, y) < 0.5
    off = np.sqrt(((table - right)[:, inner] ** 2).sum() / (right[:, inner] ** 2).sum())
    return Outcome(f"{100 * off:.2f} % off", "entries at a⁵ (NumPy)", off < 0.02, AGREES)


def lines(folder):
    tables.photograph(folder)
    for nm in (450, 680):
        (folder / f"{nm}.csv").write_text(f"wavelength_nm,power\n{nm - 1},0\n{nm},1\n{nm + 1},0\n")


def exponent(run):
    """Energies under two lines of light; brightness is relative to the light's own."""
    x, y = tables.grid(400, 0.5)
    # The first order at h = 0.15: at 450 nm it lies at 0.0993.
    energy = lambda name, at: read_table(run, name)[1][np.hypot(x - at, y) < 0.03].sum()
    ours = [energy(f"n{n}450", 0.15 * 450 / 680) / energy(f"n{n}680", 0.15) for n in (4, 2)]
    right = np.divide(*[truth.bessel_orders(0.005, nm, 2.0)[9] for nm in (450, 680)])
    good = abs(ours[0] / right - 1) < 0.01 and abs(ours[1] - 1) < 0.01
    return Outcome(f"{ours[0]:.3f}; as printed {ours[1]:.3f}", f"{right:.3f} (J1², shallow)", good, PAPER_OFF)


def constant(folder):
    write_exr(folder / "white.exr", Y=np.ones((200, 200)))


def planck(nm):
    """Illuminant A."""
    return 100 * (560 / nm) ** 5 * np.expm1(1.435e7 / (2848 * 560)) / np.expm1(1.435e7 / (2848 * nm))


def inverse_a():
    nm = np.arange(380, 781.0)
    xyz = (truth.observer(nm) / planck(nm)).sum(1)
    return xyz[:2] / xyz.sum()


# Chromaticities that CIE 15 publishes, and that of 1/A.
WHITES = {"E": (1 / 3, 1 / 3), "A": (0.44758, 0.40745), "FL1": (0.3131, 0.3371), "D65": (0.31272, 0.32903), "A-inverse": None}


def whites(run):
    off = {}
    for name, right in WHITES.items():
        xyz = np.nanmean(read_table(run, name)[:, 20:44, 20:44], (1, 2))
        off[name] = abs(xyz[:2] / xyz.sum() - (inverse_a() if right is None else right)).max()
    worst = max(off, key=off.get)
    return Outcome(f"x, y ≤ {off[worst]:.0e} off ({worst})", "CIE 15; Planck's law for A-inverse", off[worst] < 5e-4)


def measured(run):
    hdr = run.exr("hdr/hdr.exr")
    light = next(hdr[k] for k in ("Y", "G", "light", "radiance") if k in hdr)
    row = np.nan_to_num(light[250:262]).sum(0)
    peak = lambda lo, hi: (np.arange(lo, hi) * row[lo:hi]).sum() / row[lo:hi].sum()
    half = (peak(270, 277) - peak(235, 242)) / 2
    # Light and camera above the same place, 1 m; pixels of 1 mm; pitch 20 µm.
    right = 1000 * np.tan(np.arcsin(0.680 / 20 / 2))
    return Outcome(f"first order {half:.2f} px from the zero order", f"{right:.2f} px (grating equation)", abs(half / right - 1) < 0.01)


def quick(run):
    met = run.codes[-1] == 0
    return Outcome(f"{run.seconds[-1]:.1f} s, error {100 * run.reports[-1]['error_estimate']:.2f} % (1 % asked for)", "error met", met, AGREES)


CROSSED, COLORS = 8.0, (610, 540, 460)


def crossed(nm, x, y, depth=0.1, sigma=0.01):
    """A sinusoid's orders 0 and ±1 in light of one wavelength, as energy over half vectors."""
    total = 0
    for m in (-1, 0, 1):
        share = special.jv(abs(m), 2 * np.pi * depth / (nm * 1e-3)) ** 2
        width = sigma * nm / 680
        total = total + share / width**2 * np.exp(-((x - m * nm * 1e-3 / CROSSED) ** 2 + y**2) / (2 * width**2))
    return total


def colors(folder):
    x, y = tables.grid(400, 0.4)
    turned = lambda nm: crossed(nm, x, y)[::-1, ::-1]
    write_exr(folder / "red.exr", Y=turned(680))
    write_exr(folder / "rgb.exr", **{c: turned(nm) for c, nm in zip("RGB", COLORS)})


def bands(run):
    x, y = tables.grid(128, 0.2)
    nm = np.arange(380, 781.0)
    seen = truth.observer(nm)
    right = sum(seen[:, k, None, None] * crossed(v, x, y) for k, v in enumerate(nm)) / seen[1].sum()
    off = []
    for name in ("red", "rgb"):
        table = read_table(run, name)
        order = (np.hypot(x, y) > 0.04) & np.isfinite(table[0])
        off.append(np.sqrt(((table - right)[:, order] ** 2).sum() / (right[:, order] ** 2).sum()))
    text = f"one band {100 * off[0]:.0f} %, three narrow bands {100 * off[1]:.0f} %"
    return Outcome(text, "Jm² at each wavelength (NumPy): 0", off[1] < 0.1, PAPER_OFF)


CYLINDER = """
[camera]
position = [0, 0, 2000]
target = [0, 0, 60]
fov_deg = 0.2
width = 601
height = 15
[[shape]]
type = "cylinder"
radius = 60
length = 200
material = "foil"
[[light]]
type = "directional"
direction = [0, 0, 1]
sigma_deg = 0.15
spectrum = 530.0
[material.foil.diffraction]
type = "grating"
relief = { depth_um = 0.1 }
orientation_deg = 0
period_um = 2.0
"""


def cylinder_scene(folder):
    (folder / "roll.toml").write_text(CYLINDER)


def cylinder(run):
    parts = run.exr("roll.exr")
    line = parts["G"].sum(0)
    pixel = 2 * np.tan(np.radians(0.1)) / 15
    x = (np.arange(601) - 300) * pixel

    def place(angle):
        point = 60 * np.array([np.sin(angle), 0, np.cos(angle)])
        return point, (np.array([0, 0, 2000]) - point) / np.linalg.norm(np.array([0, 0, 2000]) - point)

    def order(angle):
        _, eye = place(angle)
        tangent = np.array([np.cos(angle), 0, -np.sin(angle)])
        return -(eye + [0, 0, 1]) @ tangent - 0.53 / 2

    point, _ = place(optimize.brentq(order, 0, 0.5))
    right = point[0] / (2000 - point[2])
    near = abs(x - right) < 0.002
    found = (x[near] * line[near]).sum() / line[near].sum()
    return Outcome(f"first order at {1000 * found:.3f} mrad", f"{1000 * right:.3f} mrad (grating equation)", abs(found / right - 1) < 0.005)


def mirror_photo(folder):
    tables.photograph(folder)
    x, y = np.meshgrid(np.arange(121) - 60, np.arange(121) - 60)
    blob = lambda a, b: np.exp(-((x - a) ** 2 + (y - b) ** 2) / (2 * 1.5**2))
    write_exr(folder / "mirror.exr", Y=blob(24, 10) + 0.6 * blob(-24, -10))


def complex_light(run):
    point, ours = read_table(run, "point"), read_table(run, "lamps")
    picture = run.exr("mirror.exr", "Y")[::-1, ::-1]
    right = tables.spread(point, picture)
    x, y = tables.grid(500, 0.5)
    inner = (np.hypot(x, y) < 0.35) & np.isfinite(ours[0])
    off = np.sqrt(((ours - right)[:, inner] ** 2).sum() / (right[:, inner] ** 2).sum())
    return Outcome(f"{100 * off:.1f} % off", "convolution (SciPy)", off < 0.03, AGREES)


SLITS = """
[camera]
position = [0, 0, 500]
target = [0, 0, 0]
fov_deg = {fov}
width = 1201
height = 5
[[shape]]
type = "plane"
size = [900, 100]
material = "foil"
[[light]]
type = "directional"
direction = [0, 0, 1]
sigma_deg = {sigma}
spectrum = 550.0
[material.foil.diffraction]
type = "multislit"
spacing_um = {spacing}
width_um = {width}
count = 21
"""
# Spacing in µm and pixel in mm: the paper's, and one that leaves hardly any light to orders below the horizon.
COMBS = {"cd": (2.0, 0.5), "wide": (20.0, 0.05)}
DISC = """
[camera]
position = [40, 0, 500]
target = [40, 0, 0]
fov_deg = 0.2
width = 61
height = 5
[[shape]]
type = "disc"
inner = 20
outer = 58
material = "foil"
[[light]]
type = "directional"
direction = [0.29, 0, 0.957]
sigma_deg = 0.05
spectrum = "E"
[material.foil.diffraction]
type = "multislit"
disc = true
"""


def slits_scene(folder):
    for name, (spacing, pixel) in COMBS.items():
        fov = 2 * np.degrees(np.arctan(2.5 * pixel / 500))
        (folder / f"{name}.toml").write_text(SLITS.format(fov=fov, spacing=spacing, width=spacing / 4, sigma=pixel / 25))


def slits(run):
    """Energies of the lobes over u; radiance over u is the formula's, since dω = du dv/cos θo."""
    ratios = {}
    for name, (spacing, pixel) in COMBS.items():
        line = run.exr(f"{name}.exr", "G").mean(0)
        x = (np.arange(1201) - 600) * pixel
        u, order = x / np.hypot(x, 500), 0.55 / spacing
        energy = [np.trapezoid(line[near], u[near]) for near in (abs(u - m * order) < order / 5 for m in range(3))]
        ratios[name] = [e / energy[0] for e in energy[1:]]
    ours, right = ratios["wide"], [np.sinc(0.25 * m) ** 2 for m in (1, 2)]
    text = f"{ours[0]:.3f}, {ours[1]:.3f} at 20 µm; {ratios['cd'][0]:.3f} at 2 µm, where light of orders below the horizon goes to the others"
    return Outcome(text, f"{right[0]:.3f}, {right[1]:.3f} (sinc²)", max(abs(a / b - 1) for a, b in zip(ours, right)) < 0.02, AGREES)


def disc_scene(folder):
    (folder / "disc.toml").write_text(DISC)


def spectrum_peaks(run, file, column):
    """Centre in nm of the spectrum of a column of pixels, above half of its peak."""
    parts = run.exr(file)
    bands = sorted((float(k.split(".")[1].replace(",", ".").removesuffix("nm")), k) for k in parts if k.startswith("S0."))
    nm = np.array([b[0] for b in bands])
    value = np.array([parts[k][:, column].mean() for _, k in bands])
    top = value > 0.2 * value.max()
    return (nm[top] * value[top]).sum() / value[top].sum()


def disc_colors(run):
    pixel = 2 * 500 * np.tan(np.radians(0.1)) / 5
    off = []
    for column in (10, 30, 50):
        x = (column - 30) * pixel
        u = 0.29 / np.hypot(0.29, 0.957) - x / np.hypot(x, 500)
        off.append(spectrum_peaks(run, "disc.exr", column) - 2000 * u)
    return Outcome(f"colours ≤ {max(map(abs, off)):.1f} nm off", "λ = Δx·u", max(map(abs, off)) < 3)


ROWS = [
    Row("2017-measured", "4.3; Fig. 5, 6", "LCD of 20 µm from 1 m at 680 nm, three exposures merged", "pictures",
        ("sim photograph flash --out photo", "reconstruct hdr photo --out hdr"), read=measured),
    Row("2017-table", "4.3", "table of a photograph of 1000²: error at the rim", "steps of 5 nm", (f"{LUT} --out table",), prepare=tables.photograph, read=exact),
    Row("2017-table-printed", "Eq. 15", "the same as printed: power 2, trapezoid at 5 nm", "the formula", (f"{LUT} --exponent 2 --method fixed=5 --out table",),
        prepare=tables.photograph, read=fixed),
    Row("2017-table-power", "Eq. 15", "light of a first order, 450 over 680 nm", "1 (power 2)",
        tuple(f"{LUT.replace('--extent 1 --size 200', '--extent 0.5 --size 400')} --exponent {n} --illuminant {nm}.csv --out n{n}{nm}" for n in (4, 2) for nm in (450, 680)),
        prepare=lines, read=exponent),
    Row("2017-table-warp", "4.3", "entries at u⁵, v⁵", "n = 5", (f"{LUT} --warp 5 --out table",), prepare=tables.photograph, read=warped),
    Row("2017-table-time", "4.3", "table of 2048² from a photograph of 1000²", "a few seconds (Intel i7)",
        ("reconstruct lut photo.exr --wavelength 680 --scale 0.002 --center 499.5,499.5 --extent 1 --size 2048 --out table",), prepare=tables.photograph, read=quick),
    Row("2017-lights", "6; Fig. 14, 15", "white of tables under E, A, A-inverse, FL1, D65", "pictures",
        tuple(f"reconstruct lut white.exr --wavelength 680 --scale 0.005 --center 99.5,99.5 --exponent 0 --extent 0.2 --size 64 --illuminant {w} --out {w}" for w in WHITES),
        prepare=constant, read=whites),
    Row("2017-colour", "6; Fig. 16", "one narrow band or three, sinusoid 100 nm deep", "one band is most accurate",
        ("reconstruct lut red.exr --wavelength 680 --scale 0.002 --center 199.5,199.5 --extent 0.2 --size 128 --out red",
         f"reconstruct lut rgb.exr --wavelength {','.join(map(str, COLORS))} --scale 0.002 --center 199.5,199.5 --extent 0.2 --size 128 --out rgb"), prepare=colors, read=bands),
    Row("2017-cylinder", "6; Fig. 17", "foil of 2 µm rolled to a cylinder, 530 nm", "pictures", ("render roll.toml --samples 256 --out roll.exr",), prepare=cylinder_scene, read=cylinder),
    *bokeh2017.ROWS,
    Row("2017-slits", "6.1; Eq. 16", "21 slits of 0.5 µm, 2.0 µm apart: orders 1 and 2 over order 0", "the formula", ("render cd.toml --samples 256 --out cd.exr", "render wide.toml --samples 256 --out wide.exr"),
        prepare=slits_scene, read=slits),
    Row("2017-disc", "6.1; Fig. 21", "CD with these slits: colours along a radius", "pictures", ("render disc.toml --spectral 10 --samples 64 --out disc.exr",),
        prepare=disc_scene, read=disc_colors),
    Row("2017-stripes", "6.1; Fig. 20", "radial pattern in vertical stripes", "pictures", why="no number; `multislit` with `radial` in scenes, masks by `nacre map mask`"),
    Row("2017-lamps", "6.2; Fig. 22", "table under two lamps (their mirror image)", "pictures",
        (f"{LUT.replace('--extent 1 --size 200', '--extent 0.5 --size 500')} --out point", f"{LUT.replace('--extent 1 --size 200', '--extent 0.5 --size 500')} --light mirror.exr --light-center 60,60 --out lamps"),
        prepare=mirror_photo, read=complex_light),
    Row("2017-environment", "6.2; Fig. 2a, 23", "flat table under a sky with a lamp, over that under an even sky", "pictures",
        ("render white.toml --max-error 0.003 --samples 4096 --out white.exr", "render lamp.toml --max-error 0.003 --samples 4096 --out lamp.exr"), prepare=skies.scenes, read=skies.ratio),
    Row("2017-prefiltered", "6.2; Fig. 24", "filtered beforehand against the full integral, by angle of view", "RMSE 7.6 %", ("chart environment-method --quick --out charts",),
        read=skies.filtered),
    Row("2017-frames", "6", "frames per second", "65 (GTX 960M)", why="that card; `nacre chart gpu-speed` measures the one at hand"),
    Row("2017-specimens", "Fig. 1, 7, 8, 11, 14, 18", "phones, laptop, television, papers", "pictures", why="the specimens"),
    Row("2017-drawings", "Fig. 3, 4, 10, 26; A", "orders, geometry, optical path", "drawings", why="drawings"),
    Row("2017-limits", "7; Fig. 25", "textured and kinematic foils", "cannot be done", why="the paper's own limit; the 2018 paper's methods do it (above)"),
]
