"""Rows of the 2018 paper on holographic surfaces: flash illumination, rendering and edits. Polarization imaging is in polarization2018."""

import numpy as np
from scipy import optimize

import polarization2018
import sheets
import truth
from rows import AGREES, EXACTER, PAPER_OFF, Outcome, Row, write_exr

TITLE = "Spatially varying holographic surfaces (ACM TOG 2018)"

TILES = "sim photograph tiles --scene sheet.toml --out tiles"
FLASH = "reconstruct flash tiles --tiles 10x8 --size-mm 297x210 --out maps"


def angles(run):
    table = run.csv("orders.csv")
    ours = np.radians(table["theta_r_deg"])
    right = truth.grating_angle(table["order"], table["wavelength_nm"], 1 / 0.6, np.radians(20))
    seen = np.isfinite(ours)
    off = np.degrees(abs(ours[seen] - right[seen]).max())
    return Outcome(f"{seen.sum()} orders, ≤ {off:.1e}° off", "grating equation", off < 1e-6 and seen.sum() > 12)


def bessel(run):
    table = run.csv("orders.csv")
    w = 2.0
    right = {m: e for m, e in zip(range(-8, 9), truth.bessel_orders(0.1, 560, w))}
    off = max(abs(e - right[int(m)]) for m, e in zip(table["order"], table["efficiency"]) if abs(m) <= 8)
    total = table["efficiency"].sum()
    return Outcome(f"≤ {off:.1e} off, sum {total:.6f}", "Jm² (SciPy), sum 1", off < 1e-6 and abs(total - 1) < 1e-5, PAPER_OFF)


def taylor(run):
    sums, right = [], []
    for name, depth in [("50", 0.05), ("100", 0.1), ("200", 0.2)]:
        sums.append(run.csv(f"t{name}.csv")["efficiency"].sum())
        zero, one, two = truth.taylor_orders(depth, 550)
        right.append(zero + 2 * one + 2 * two)
    good = np.allclose(sums, right, rtol=1e-4)
    text = lambda v: ", ".join(f"{x:.2f}" for x in v)
    return Outcome(f"{text(sums)} times the light", f"{text(right)} (squares of the printed terms); 1 by energy", good, PAPER_OFF)


FIGURE_5 = [("600", 0.6, 0), ("1000", 1.0, 0), ("turned", 1.0, 45)]
SCENE = """
[camera]
position = [0, 0, 500]
target = [0, 0, 0]
fov_deg = {fov}
width = 601
height = 9
[[shape]]
type = "plane"
size = [400, 400]
material = "foil"
[[light]]
type = "point"
position = [0, 0, 200]
sigma_mm = 0.6
spectrum = {spectrum}
[material.foil.diffraction]
type = "grating"
relief = {{ depth_um = 0.1 }}
orientation_deg = {turn}
period_um = {period}
[turn]
sample_deg = {back}
"""
PITCH = 1 / 3


def figure_5_scenes(folder):
    fov = 2 * np.degrees(np.arctan(4.5 * PITCH / 500))
    for name, lines, turn in FIGURE_5:
        # The sheet is turned back, so that the turned grating's orders lie in the same strip.
        (folder / f"{name}.toml").write_text(SCENE.format(fov=fov, spectrum=530.0, turn=turn, back=-turn, period=1 / lines))


def first_order_mm(period, nm, height=200.0):
    """Distance from the highlight of the first order under camera and light above the same place."""
    u = lambda x: x / np.hypot(x, 500) + x / np.hypot(x, height) - nm * 1e-3 / period
    return optimize.brentq(u, 0, 400)


def figure_5(run):
    off, found = [], []
    for name, lines, _ in FIGURE_5:
        line = run.exr(f"{name}.exr", "G").sum(0)
        x = (np.arange(601) - 300) * PITCH
        right = first_order_mm(1 / lines, 530)
        near = abs(x - right) < 8
        place = (x[near] * line[near]).sum() / line[near].sum()
        found.append(place)
        off.append(abs(place / right - 1))
    right = ", ".join(f"{first_order_mm(1 / lines, 530):.2f}" for _, lines, _ in FIGURE_5)
    return Outcome(", ".join(f"{p:.2f}" for p in found) + " mm", f"{right} mm (grating equation)", max(off) < 3e-3)


def flash_orientation(run):
    found, mask = run.exr("../once/maps/orientation.exr", "orientation", "mask")
    right, edge = run.exr("../once/tiles/truth.exr", "orientation", "edge")
    inside = (mask > 0) & (edge > 0.6)
    off = np.degrees(abs(np.angle(np.exp(2j * (found - right)))) / 2)[inside].mean()
    return Outcome(f"mean error {off:.3f}°, {mask.mean():.0%} of the tile measured", "drawn map: 0", off < 0.3 and mask.mean() > 0.6)


def few(run):
    """Gratings that polygons share are found together; errors beyond five of their own sigma are counted."""
    known, wrong, off = [], [], []
    for n in (1, 2, 3):
        found, mask, sigma = run.exr(f"maps{n}/orientation.exr", "orientation", "mask", "sigma")
        right, edge = run.exr(f"few{n}/truth.exr", "orientation", "edge")
        error = abs(np.angle(np.exp(2j * (found - right)))) / 2
        grooves = edge > 0
        known.append(mask[grooves].mean())
        wrong.append(((mask > 0) & (error > 5 * sigma))[grooves].mean())
        off.append(np.degrees(error[(mask > 0) & (edge > 0.6)].mean()))
    text = lambda values, form: ", ".join(format(v, form) for v in values)
    good = max(wrong) <= 0.001 and min(known) > 0.3 and max(off) < 0.6
    return Outcome(f"{text(known, '.0%')} of the tile measured, mean error {text(off, '.2f')}°, {text(wrong, '.2%')} beyond 5 σ", "drawn map: 0", good, AGREES)


def flash_period(folder):
    def read(run):
        period, mask = run.exr(f"{folder}/period.exr", "period", "mask")
        seen = period[mask > 0]
        mean, sd = seen.mean(), seen.std()
        good = abs(mean / 1.66 - 1) < 0.003 and mask.mean() > 0.3
        return Outcome(f"{mean:.4f} ± {sd:.4f} µm", "1.66 µm", good, EXACTER)
    return read


def mixed(run):
    found, mask = run.exr("maps/period.exr", "period", "mask")
    right, edge = run.exr("tiles/truth.exr", "period", "edge")
    inside = (mask > 0) & (edge > 0.6)
    bias = [np.median(found[inside & (abs(right - p) < 0.01)] / p - 1) for p in (1.4, 1.66)]
    choice = run.reports[-1]["period"]["choice"]
    text = ", ".join(f"{p} µm {100 * b:+.2f} %" for p, b in zip((1.4, 1.66), bias))
    return Outcome(f"{text}; choice `{choice}`", "drawn periods", max(map(abs, bias)) < 0.005 and choice != "sample")


def misaligned(run):
    """Tiles lie beside their grid, and the map shows the reference tile: it is compared where it fits the drawn one best, by whole pixels."""
    right, edge = run.exr("tiles/truth.exr", "orientation", "edge")
    numbers = []
    for folder in ("maps", "left"):
        found, mask = run.exr(f"{folder}/orientation.exr", "orientation", "mask")
        best = []
        for shift in np.ndindex(9, 9):
            way = (shift[0] - 4, shift[1] - 4)
            off = np.degrees(abs(np.angle(np.exp(2j * (found - np.roll(right, way, (0, 1)))))) / 2)
            inside = (mask > 0) & (np.roll(edge, way, (0, 1)) > 0.8)
            best.append(np.nanmean(off[inside]))
        numbers.append((min(best), mask.mean()))
    (ours, share), (left, kept) = numbers
    text = f"{ours:.2f}° on {share:.0%} of the tile; not registered {left:.2f}° on {kept:.0%}"
    return Outcome(text, "0", ours < 0.5 and share > 1.5 * kept)


def foil(run):
    share, coverage = run.exr("../once/histogram/histogram.exr", "share", "coverage")
    header = run.header("../once/histogram/histogram.exr")
    first, last = (float(np.ravel(header[k])[0]) for k in ("first_lines_per_um", "last_lines_per_um"))
    scene = run.json("../once/foil/scene.json")
    n, m = share.shape
    density = first + (np.arange(n) + 0.5) / n * (last - first)
    angle = (np.arange(m) + 0.5) / m * np.pi
    # The spiral's period grows linearly with the angle over half a turn.
    low, high = scene["pattern"]["spiral"]
    known = coverage.min(0) * 0 + (coverage[(density > 0.6) & (density < 1.1)].min(0) > 0)
    light = np.where((density > 0.55) & (density < 1.15), 1.0, 0.0)[:, None] * np.maximum(share, 0)
    mean = (light / density[:, None]).sum(0) / light.sum(0)
    right = low + (high - low) * angle / np.pi
    inner = (known > 0) & (angle > 0.3) & (angle < np.pi - 0.3)
    off = np.median(abs(mean[inner] / right[inner] - 1))
    return Outcome(f"mean period at each angle {100 * off:.2f} % off", f"spiral {low} to {high} µm", off < 0.02)


def synthesized(run):
    """Total variation of the marginals over orientation and period."""
    found, chance = run.reports[-1]["total_variation"], run.reports[-1]["expected"]
    good = all(f < c for f, c in zip(found, chance))
    return Outcome(f"differs by {found[0]:.4f}, {found[1]:.4f}", f"independent dots: {chance[0]:.4f}, {chance[1]:.4f}", good)


def ramp(folder):
    write_exr(folder / "orientation.exr", orientation=np.tile(np.radians(np.arange(180) + 0.5), (4, 1)), mask=np.ones((4, 180)))


def edited(run):
    degrees = np.arange(180) + 0.5
    share = degrees / 180
    right = [0.8 + 0.8 * share**2, 0.8 + 0.8 * np.sin(np.pi / 2 * share) ** 2]
    off = [abs(run.exr(f"{name}/period.exr", "period")[0] - r).max() for name, r in zip(("square", "sine"), right)]
    return Outcome(f"{off[0]:.1e}, {off[1]:.1e} µm off", "square and sine squared of the angle over 180°", max(off) < 0.01)


FURNACE = """
[camera]
position = [0, 0, 500]
target = [0, 0, 0]
fov_deg = 4
width = 24
height = 24
[[shape]]
type = "plane"
size = [100, 100]
material = "foil"
[[light]]
type = "environment"
color = [1, 1, 1]
[material.foil.diffraction]
type = "grating"
relief = { depth_um = 0.15 }
orientation_deg = 0
period_um = 1.66
"""


def furnace_scene(folder):
    (folder / "sky.toml").write_text(FURNACE)


def furnace(run):
    parts = run.exr("sky.exr")
    values = [parts[k].mean() for k in parts if k.split(".")[-1] in "RGB"]
    return Outcome(", ".join(f"{v:.4f}" for v in values), "1 (energy)", max(abs(v - 1) for v in values) < 0.005)


def repeated_scene(folder):
    write_exr(folder / "orientation.exr", orientation=np.zeros((8, 8)), mask=np.ones((8, 8)))
    text = SCENE.format(fov=2 * np.degrees(np.arctan(4.5 * PITCH / 500)), spectrum='"A-inverse"', turn=0, back=0, period=1.66)
    text = text.replace("orientation_deg = 0\n", 'maps = "orientation.exr"\nrepeat = [12, 8]\n')
    (folder / "sheet.toml").write_text(text)


def repeated(run):
    parts = run.exr("sheet.exr")
    bands = sorted((float(k.split(".")[1].replace(",", ".").removesuffix("nm")), k) for k in parts if k.startswith("S0."))
    nm = np.array([b[0] for b in bands])
    off = []
    for x in (40, 47, 55):
        place = round(x / PITCH) * PITCH
        spectrum = np.array([parts[k][:, 300 + round(x / PITCH)].mean() for _, k in bands])
        top = spectrum > 0.2 * spectrum.max()
        wanted = 1660 * (place / np.hypot(place, 500) + place / np.hypot(place, 200))
        off.append((nm[top] * spectrum[top]).sum() / spectrum[top].sum() - wanted)
    return Outcome(f"colours ≤ {max(map(abs, off)):.1f} nm off", "λ = a·|u|", max(map(abs, off)) < 2)


def advised(run):
    advice = [run.reports[-2]["advice"], run.reports[-1]["advice"]]
    return Outcome(", ".join(advice), "flash for repeated tiles, polarization for a small logo", advice == ["flash", "polarization"], AGREES)


ROWS = [
    Row("2018-orders", "Eq. 1, 2; Fig. 5", "where orders of a sinusoid lie", "at ±λ/a, ±2λ/a in (u, v)",
        ("brdf orders --period-um 1.6666666667 --depth-um 0.1 --light 20 --wavelengths 450:650:50 --out orders.csv",), read=angles),
    Row("2018-efficiencies", "Eq. 2", "light in the orders of a sinusoid 100 nm deep", "second-order Taylor terms",
        ("brdf orders --period-um 1.6666666667 --depth-um 0.1 --wavelengths 560 --out orders.csv",), read=bessel),
    Row("2018-taylor", "Eq. 2", "sum of the printed lobes, 50, 100, 200 nm at 550 nm", "not mentioned",
        tuple(f"brdf orders --period-um 1.66 --depth-um {d} --wavelengths 550 --method taylor2 --out t{n}.csv"
              for n, d in [("50", 0.05), ("100", 0.1), ("200", 0.2)]), read=taylor),
    Row("2018-fig5", "Fig. 5", "renderings: 600 lines/mm, 1000, and 1000 at 45°; distance of the first order from the highlight", "pictures",
        tuple(f"render {n}.toml --samples 256 --out {n}.exr" for n, _, _ in FIGURE_5), prepare=figure_5_scenes, read=figure_5),
    Row("2018-flash-orientation", "4.3; Fig. 4, 6, 8", "orientations of a sheet of polygon tiles, five flash photographs", "map only",
        once=(TILES, FLASH), share=sheets.whole, read=flash_orientation),
    Row("2018-flash-period", "7.1; Fig. 23", "period of that sheet: 1.66 µm at 560 nm under a Gaussian light", "1.939 ± 0.15 µm", once=(TILES, FLASH), share=sheets.whole,
        read=flash_period("../once/maps")),
    Row("2018-flash-numpy", "7.1; Fig. 23", "the same from photographs that NumPy made", "1.939 ± 0.15 µm",
        ("reconstruct flash sheet --tiles 10x8 --size-mm 297x210 --camera-mm 500 --light-height-mm 200 --out maps",), prepare=sheets.striped, read=flash_period("maps")),
    Row("2018-flash-periods", "4.4; Fig. 7", "tiles of two periods", "pictures",
        ("sim photograph tiles --scene two.toml --out tiles", "reconstruct flash tiles --tiles 6x5 --size-mm 178.2x131.25 --out maps"),
        prepare=sheets.scene("two.toml", 'periods = { mixed = [1.4, 1.66] }'), read=mixed),
    Row("2018-flash-misaligned", "7.2; Fig. 24", "tiles misaligned by up to 3 pixels, registered and not", "larger error at edges",
        ("sim photograph tiles --scene off.toml --out tiles", "reconstruct flash tiles --tiles 6x5 --size-mm 178.2x131.25 --out maps",
         "reconstruct flash tiles --tiles 6x5 --size-mm 178.2x131.25 --unregistered --out left"),
        prepare=sheets.scene("off.toml", "", misaligned=3), read=misaligned),
    Row("2018-flash-few", "4.1", "one, two and three photographs of a sheet of eight directions instead of five", "one to five suffice",
        tuple(c for n in (1, 2, 3) for c in (f"sim photograph tiles --scene few{n}.toml --out few{n}",
              f"reconstruct flash few{n} --tiles 10x8 --size-mm 297x210 --directions auto --out maps{n}")), prepare=sheets.few, read=few),
    Row("2018-flash-kinematic", "4.6; Fig. 10b", "a kinematic tile is discretised under a flash", "picture", missing="sheets of kinematic tiles in `sim photograph tiles`"),
    Row("2018-flash-logo", "4.6; Fig. 10a", "a logo of 15 mm under a flash", "cannot be done", why="the paper's own limit: no copies, nothing to fit"),
    Row("2018-foil", "4.5; Fig. 9", "joint distribution of orientation and period of a stochastic foil", "picture",
        once=("sim photograph foil --out foil", "reconstruct foil foil --geometry foil/geometry.json --depth-um 0.08 --out histogram"), read=foil),
    Row("2018-foil-new", "4.5; Fig. 9", "new maps of squares drawn from it", "picture", ("synthesize ../once/histogram --size 1024,1024 --pixel-um 25 --square-px 3 --out new",),
        ("sim photograph foil --out foil", "reconstruct foil foil --geometry foil/geometry.json --depth-um 0.08 --out histogram"), read=synthesized),
    *polarization2018.ROWS,
    Row("2018-sheet", "6.1; Fig. 17", "sheet of 12 × 8 copies under A-inverse, steps of 5 nm: colour at three places", "pictures",
        ("render sheet.toml --spectral 5 --samples 64 --out sheet.exr",), prepare=repeated_scene, read=repeated),
    Row("2018-environment", "6.3; Fig. 21", "a grating under an even environment gives back all light", "pictures", ("render sky.toml --out sky.exr",),
        prepare=furnace_scene, read=furnace),
    Row("2018-environment-20nm", "6.3", "environment in steps of 20 nm: error", "no artefact seen", missing="step of wavelengths for environments on the command line"),
    Row("2018-frames", "6.3", "frames per second at 1920 × 1080", "30 (GTX 1080)", why="that card; `nacre chart gpu-speed` measures the one at hand"),
    Row("2018-edit", "6.4; Fig. 22", "periods that follow orientations, from 0.8 to 1.6 µm", "pictures",
        ("map edit . --period quadratic=0.8,1.6 --out square", "map edit . --period sine-squared=0.8,1.6 --out sine"), prepare=ramp, read=edited),
    Row("2018-advice", "8", "which method suits a sample", "flash for repeated tiles, polarization for others",
        ("recommend ../once/tiles/room.png", "recommend ../once/logo/result --need orientation"), (TILES, polarization2018.LOGO), share=sheets.whole, read=advised),
    Row("2018-specimens", "Fig. 1, 2, 16-21", "renderings of gift bags, banknote, badge", "pictures", why="the specimens; simulated ones stand for them above"),
    Row("2018-drawings", "Fig. 3, 4a, 11, 13; Table 1", "setups and notation", "drawings", why="drawings; `nacre schema bench` describes the simulated bench"),
    Row("2018-fringes", "5.1; Fig. 12b", "radial fringes on the LCD follow bumps, not gratings", "pictures", why="needs the bumps of that paper"),
    Row("2018-bumps", "6.2; Fig. 18k", "bumps from step edges", "picture", why="another paper's method (Wang 2011); `render` takes normals as a picture"),
]
