"""Rows of the 2014 thesis on diffraction from natural gratings."""

import math
import re

import numpy as np

import truth
from rows import AGREES, EXACTER, PAPER_OFF, Outcome, Row

TITLE = "Diffraction from natural gratings (thesis 2014)"
BLAZED = "brdf surface blazed --period-um 2.5 --depth-um 0.3 --out blazed.exr"
SHALLOW = "brdf surface sinusoid --period-um 2.5 --depth-um 0.01 --out shallow.exr"
PERIOD = "brdf surface blazed --period-um 2.5 --depth-um 0.3 --pixel-um 0.0390625 --pixels {}"
PATCH = "DATA/heightfields/thesis/{} --pixel-um 0.08 --range-um 0.43"


def peaks(mean, variance, expected=2500.0, most=0.5):
    def read(run):
        report = run.reports[-1]
        ours, spread = report["mean_nm"], report["variance_nm2"]
        verdict = AGREES if abs(mean - expected) < most else EXACTER
        return Outcome(f"{ours:.2f} nm, variance {spread:.3f}", f"{expected:.0f} nm (grating equation)", abs(ours - expected) < most, verdict)
    return read


def snake(run):
    """Scale of the patches is not recorded: the peak must lie within the resolution of the heights' own spectrum."""
    report = run.reports[-1]
    strongest = report["quality"]["periods"][0]
    width = 1000 * strongest["resolution_um"]
    own = 1000 * strongest["period_um"]
    ridges = ", ".join(f"{r[0]:.0f} nm" for r in report["ridges"])
    good = any(abs(r[0] - own) < 2 * width for r in report["ridges"])
    return Outcome(f"{ridges}, variance {report['variance_nm2']:.3f}", f"{own:.0f} ± {width:.0f} nm (its spectrum)", good)


def refused(run):
    return Outcome("refused" if run.codes[-1] == 2 else f"{run.reports[-1]['mean_nm']:.0f} nm", "patch does not go on at its edges", run.codes[-1] == 2, PAPER_OFF)


def patches(run):
    """PQ interpolates between the frequencies of the patch, of which one period has few: 0.3 % off at most."""
    one, cut = (run.reports[k] for k in (1, 3))
    good = abs(one["mean_nm"] - 2500) < 7.5 and abs(cut["mean_nm"] - 2500) < 0.5 and abs(cut["cut_periods"] - 1.5625) < 1e-3
    return Outcome(f"{one['mean_nm']:.1f} and {cut['mean_nm']:.2f} nm", "2500 nm (grating equation)", good)


def equation(run):
    table = run.csv("orders.csv")
    ours = np.radians(table["theta_r_deg"])
    right = truth.grating_angle(table["order"], table["wavelength_nm"], 2.5, np.radians(75))
    seen = np.isfinite(ours)
    off = np.degrees(abs(ours[seen] - right[seen]).max())
    return Outcome(f"{seen.sum()} orders, ≤ {off:.0e}° off", "Eq. 5.2", off < 1e-6, AGREES)


def lobes(run):
    """Peaks over a mirror's: Jm²(k w h0/2)/cos θr at normal incidence, w = 1 + cos θr."""
    table, off = run.csv("slice.csv"), []
    theta, value = np.radians(table["theta_r_deg"]), table["reflectance"]
    for m in (-2, -1, 0, 1, 2):
        at = np.arcsin(m * 0.55 / 1.6)
        near = abs(theta - at) < np.radians(0.3)
        right = truth.bessel_orders(0.1, 550, 1 + np.cos(at))[8 + m] / np.cos(at)
        # The highest of samples 0.005° apart.
        off.append(abs(np.nanmax(value[near]) / right - 1))
    return Outcome(f"five peaks ≤ {100 * max(off):.2f} % off", "Jm² w, gain (closed form)", max(off) < 0.01)


def widths(run):
    found, right = [], []
    for coherence in (65, 16, 8):
        table = run.csv(f"c{coherence}.csv")
        u, value = np.sin(np.radians(table["theta_r_deg"])), np.nan_to_num(table["reflectance"])
        near = abs(u) < 0.5 * 0.55 / 2.5
        # Slope of the logarithm over u² down to a tenth of the peak.
        top = near & (value > 0.1 * value[near].max())
        found.append(np.sqrt(-0.5 / np.polyfit(u[top] ** 2, np.log(value[top]), 1)[0]))
        right.append(0.55 / (2 * np.pi * coherence / 4 * np.sqrt(2)))
    text = lambda v: ", ".join(f"{x:.5f}" for x in v)
    off = max(abs(a / b - 1) for a, b in zip(found, right))
    return Outcome(text(found), f"{text(right)} (λ/(2π√2 σs))", off < 0.01)


def powers(run):
    """First-order peak of a blazed grating by powers up to N over the exact one, by sums over one period of the file's heights."""
    height = run.exr("blazed.exr", "height")[0]
    pixel = float(run.header("blazed.exr")["pixel_um"][0])
    count = round(2.5 / pixel)
    h = height[:count] - height.mean()
    at = np.arcsin(0.55 / 2.5)
    x = 2 * np.pi / 0.55 * (1 + np.cos(at))
    wave = np.exp(-2j * np.pi * np.arange(count) / count)
    peak = lambda p: max(abs((p * wave).mean()) ** 2, abs((p * wave.conj()).mean()) ** 2)
    series = lambda n, heights: sum((1j * x * heights) ** k / math.factorial(k) for k in range(n + 1))
    all_ = run.csv("all.csv")
    orders = (2, 7, 39)
    top = lambda table: np.nanmax(table["reflectance"][abs(np.sin(np.radians(table["theta_r_deg"]))) > 0.15])
    ours = [top(run.csv(f"n{n}.csv")) / top(all_) for n in orders]
    exact = peak(np.exp(1j * x * h))
    choices = {name: [peak(series(n, h + shift)) / exact for n in orders]
               for name, shift in {"mean": 0.0, "ground": height.mean() - height.min(), "middle": height.mean() - (height.max() + height.min()) / 2}.items()}
    off = {name: max(abs(a / b - 1) for a, b in zip(ours, right)) for name, right in choices.items()}
    best = min(off, key=off.get)
    text = lambda v: ", ".join(f"{t:.3f}" for t in v)
    return Outcome(text(ours), f"{text(choices[best])} (NumPy, heights from their {best})", off[best] < 0.03, AGREES)


def bound(depth, nm=380, share=0.01):
    """Fewest Chebyshev terms whose rest stays below `share` of exp(ikwh) at w = 2."""
    from scipy import special

    x = 2 * np.pi / (nm * 1e-3) * depth
    tail = 2 * abs(special.jv(np.arange(0, 200), x))
    rest = np.cumsum(tail[::-1])[::-1]
    return int(np.argmax(rest < share))


def terms(run):
    found = [run.json(f"t{d}/terms.json") for d in ("0.15", "0.5", "2")]
    numbers = [len(t["terms"]) if isinstance(t.get("terms"), list) else t["terms"] for t in found]
    right = [bound(float(d)) for d in ("0.15", "0.5", "2")]
    good = all(b - 2 <= n <= b + 12 for n, b in zip(numbers, right))
    return Outcome(", ".join(map(str, numbers)), f"≥ {', '.join(map(str, right))} (Bessel tails)", good, EXACTER)


def deep(run):
    refused = run.codes[-2] == 2 or run.codes[-2] == 1
    error = run.reports[-1]["error_estimate"]
    return Outcome(f"Taylor {'refused' if refused else 'accepted'}; default {100 * error:.2f} %", "terms reach e^x before they cancel", refused and error < 0.01, PAPER_OFF)


def white_spot(run):
    """The mirror direction under E: J0² weighted by each function of the observer."""
    right = truth.observer(np.arange(380, 781.0))
    share = np.array([truth.bessel_orders(0.1, nm, 2.0)[8] for nm in np.arange(380, 781.0)])
    right = (right * share).sum(1) / right[1].sum()
    ours = [np.array([run.exr(f"{name}.exr", c)[128, 128] for c in "XYZ"]) for name in ("nmm", "full")]
    off = [abs(o / right - 1).max() for o in ours]
    return Outcome(f"nmm {100 * off[0]:.2f} %, all wavelengths {100 * off[1]:.2f} % off", "∫ J0² (closed form)", max(off) < 0.02, PAPER_OFF)


def same_light(run):
    """All light of both maps."""
    y = {name: np.nan_to_num(run.exr(f"{name}.exr", "Y")) for name in ("pq", "flss")}
    total = y["pq"].sum() / y["flss"].sum()
    return Outcome(f"{100 * (total - 1):+.2f} % of light", "energy: 0", abs(total - 1) < 0.03)


def step_chart(run):
    chart = run.csv("charts/surface-step/surface-step.csv")
    pick = {(str(s), c): e for s, c, e in zip(chart["setting"], chart["stress"], chart["error_median"])}
    at = {s: e for (s, c), e in pick.items() if c == 65}
    text = ", ".join(f"{s}: {100 * e:.1f} %" for s, e in at.items())
    five = next(e for s, e in at.items() if s.startswith("5"))
    return Outcome(text, "finer sums (Nacre's)", five < 0.01, AGREES)


def incidence(run):
    off = []
    for theta in (0, 10, 30):
        y = np.nan_to_num(run.exr(f"m{theta}.exr", "Y"))
        row, column = np.unravel_index(y.argmax(), y.shape)
        place = [(2 * column + 1) / 257 - 1, 1 - (2 * row + 1) / 257]
        off.append(max(abs(place[0] + np.sin(np.radians(theta))), abs(place[1])))
    return Outcome(f"mirror direction ≤ {max(off):.4f} off (pixel {2 / 257:.4f})", "-sin θi", max(off) <= 1.01 * 2 / 257)


def gems(run):
    chart = run.csv("charts/surface-gems/surface-gems.csv")
    pick = lambda word: max(e for m, e in zip(chart["method"], chart["error_median"]) if word in str(m))
    return Outcome(f"colours {pick('period'):.1f} off; Nacre's map {pick('auto'):.4f}", "map at 0.01 % (Nacre's)", pick("auto") < 0.01 < pick("period"))


def neighbours(run):
    chart = run.csv("charts/surface-window/surface-window.csv")
    three = [(c, e) for s, c, e in zip(chart["setting"], chart["stress"], chart["error_median"]) if str(s).startswith("3")]
    rest = [e for s, e in zip(chart["setting"], chart["error_median"]) if str(s).startswith("by error")]
    text = "3 × 3 miss " + ", ".join(f"{100 * e:.1f} %" for _, e in three) + f"; default ≤ {100 * max(rest):.3f} %"
    return Outcome(text, "all frequencies (Nacre's)", max(rest) < 0.01, PAPER_OFF)


COLOR = """
[camera]
position = [0, 0, 500]
target = [0, 0, 0]
fov_deg = 2
width = 8
height = 8
[[shape]]
type = "plane"
size = [200, 200]
material = "chalk"
[[light]]
type = "directional"
direction = [0, 0.3, 1]
spectrum = "{light}"
[material.chalk.base]
albedo = [0.8, 0.8, 0.8]
roughness = 1
specular = [0, 0, 0]
"""


def color_scenes(folder):
    for light in ("D65", "E"):
        (folder / f"{light}.toml").write_text(COLOR.format(light=light))


def colors(run):
    off, texts = [], []
    for light, xyz in (("D65", (0.95047, 1, 1.08883)), ("E", (1, 1, 1))):
        parts = run.exr(f"{light}.exr")
        rgb = np.array([parts[c].mean() for c in "RGB"])
        right = truth.srgb_linear(np.array(xyz))
        off.append(abs(rgb / rgb[1] / (right / right[1]) - 1).max())
        texts.append(" : ".join(f"{v:.3f}" for v in rgb / rgb[1]))
    return Outcome("D65 " + texts[0] + ", E " + texts[1], "IEC 61966-2-1: 1 : 1 : 1, 1.271 : 1 : 0.958", max(off) < 3e-3, PAPER_OFF)


SLITS = """
[camera]
position = [0, 0, 500]
target = [0, 0, 0]
fov_deg = {fov}
width = 801
height = 5
[[shape]]
type = "plane"
size = [100, 100]
material = "foil"
[[light]]
type = "directional"
direction = [0, 0, 1]
spectrum = 500.0
[material.foil.diffraction]
type = "multislit"
spacing_um = 150
width_um = 30
count = {count}
"""
COUNTS = (2, 5, 10)


def gems_map(run):
    """The shader's formula (GPU Gems, chapter 8), written anew in its own unit of wavelength."""
    found = run.exr("gems.exr")
    sines = np.abs((2 * np.arange(257) + 1) / 257 - 1)
    right = {c: np.zeros(257) for c in "RGB"}
    for order in range(1, 9):
        y = 2 * (1.6 / 0.72) * sines / order - 1
        for channel, middle in zip("RGB", (0.75, 0.5, 0.25)):
            right[channel] += np.maximum(0, 1 - (4 * (y - middle)) ** 2)
    off = max(abs(found[c][128] - right[c])[1:-1].max() for c in "RGB")
    return Outcome(f"colours along the middle row {off:.1e} off", "the shader's formula", off < 1e-5)


def steps_map(run):
    own, stepped = (run.exr(f"{name}.exr", "Y") for name in ("own", "s5"))
    seen = np.isfinite(own)
    off = np.sqrt(((stepped - own)[seen] ** 2).sum() / (own[seen] ** 2).sum())
    said = float(re.search(r"as asked for: ([0-9.]+) %", run.reports[2]["choice"]["why"])[1]) / 100
    return Outcome(f"{100 * off:.1f} % (Y; {100 * said:.1f} % of X, Y, Z in its report)", "its own sum at 1 %", abs(said / off - 1) < 0.5, AGREES if off < 0.01 else PAPER_OFF)


def slit_scenes(folder):
    for count in COUNTS:
        (folder / f"n{count}.toml").write_text(SLITS.format(fov=2 * np.degrees(np.arctan(2.5 * 0.02 / 500)), count=count))


def slit_curves(run):
    x = (np.arange(801) - 400) * 0.02
    u, off = x / np.hypot(x, 500), []
    for count in COUNTS:
        line = run.exr(f"n{count}.exr", "G").mean(0)
        phase = np.pi * 150 * u / 0.5
        with np.errstate(all="ignore"):
            right = np.sinc(30 * u / 0.5) ** 2 * np.where(abs(np.sin(phase)) < 1e-9, 1, np.sin(count * phase) / (count * np.sin(phase))) ** 2
        off.append(np.sqrt(((line / line.max() - right) ** 2).mean()))
    return Outcome(", ".join(f"{100 * e:.1f}" for e in off) + " % of the peak off (RMS)", "sinc² · Dirichlet (closed form)", max(off) < 0.03)


def check(method):
    return (BLAZED, f"brdf check blazed.exr --light 75 --azimuth 0 --method {method}")


ROWS = [
    Row("thesis-equation", "Eq. 5.2; Fig. 5.7", "angles of the orders, 2.5 µm, light at 75°", "the equation",
        ("brdf orders --period-um 2.5 --depth-um 0.3 --profile blazed --light 75 --wavelengths 380:780:50 --out orders.csv",), read=equation),
    Row("thesis-blazed", "Table 5.1; Fig. 5.8a", "period of a blazed grating from its peaks, FLSS", "2499.997, variance 0.377", check("taylor"), read=peaks(2499.997, 0.377)),
    Row("thesis-blazed-nmm", "Table 5.1; Fig. 5.9", "the same by NMM", "2499.997, variance 0.377", check("nmm"), read=peaks(2499.997, 0.377)),
    Row("thesis-blazed-pq", "Table 5.1; Fig. 5.10", "the same by PQ", "2491.861, variance 248", check("pq"), read=peaks(2491.861, 248.044)),
    Row("thesis-blazed-linear", "Fig. 6.7c", "the same by PQ, interpolated linearly", "worse than PQ", check("pq-linear"), read=peaks(2491.861, 248.044)),
    Row("thesis-pq-map", "Fig. 6.4c, 6.7", "map of the blazed grating by PQ: light over that of FLSS", "alike, first order spread",
        (BLAZED, *(f"brdf map blazed.exr --size 401 --method {m} --max-error 0.5 --out {n}.exr" for m, n in (("pq", "pq"), ("taylor", "flss")))), read=same_light),
    Row("thesis-patch", "4.5.3", "patches of one period, repeated by PQ, and of 1.56 periods", "the method",
        (f"{PERIOD.format(64)} --out one.exr", "brdf check one.exr --light 75 --method pq --max-error 0.1",
         f"{PERIOD.format(100)} --out cut.exr", "brdf check cut.exr --light 75"), read=patches),
    Row("thesis-elaphe", "Table 5.1; Fig. 5.8c", "Elaphe's first order (scale of the patch: assumed)", "1144.26, variance 0.401",
        (f"brdf check {PATCH.format('Elaph100x100.png')} --light 75 --coherence-um 16",), read=snake, data=True),
    Row("thesis-elaphe-pq", "Table 5.1; Fig. 5.10", "Elaphe by PQ", "1052.3, variance 49.7",
        (f"brdf check {PATCH.format('Elaph100x100.png')} --light 75 --method pq --coherence-um 16",), read=refused, data=True),
    Row("thesis-xenopeltis", "Table 5.1; Fig. 5.8b", "Xenopeltis: two ridges", "1552.27, variance 0.45; two ridges",
        (f"brdf check {PATCH.format('Xeno100x100.png')} --light 75 --coherence-um 16",), read=snake, data=True),
    Row("thesis-lobes", "Eq. 3.16-3.26", "reflectance of a sinusoid's orders relative to a mirror, 550 nm", "the formula",
        ("brdf surface sinusoid --period-um 1.6 --depth-um 0.1 --out s.exr",
         "brdf slice s.exr --wavelengths 550 --views=-45:45:0.005 --normalisation relative --out slice.csv"), read=lobes),
    Row("thesis-coherence", "3.2.2; Fig. 6.10", "width of lobes at coherence 65, 16, 8 µm, over sines", "pictures",
        (SHALLOW, *(f"brdf slice shallow.exr --wavelengths 550 --views=-6:6:0.01 --coherence-um {c} --out c{c}.csv" for c in (65, 16, 8))), read=widths),
    Row("thesis-window", "3.2.3; Alg. 3", "3 × 3 frequencies around each direction", "99.99 % of the light", ("chart surface-window --quick --out charts",), read=neighbours),
    Row("thesis-powers", "3.4; Fig. 6.11", "first order of the blazed grating by powers up to 2, 7, 39", "7 suffice (by eye)",
        (BLAZED, *(f"brdf slice blazed.exr --wavelengths 550 --views=-20:20:0.01 --method taylor --order {n} --max-error 0.5 --out n{n}.csv" for n in (2, 7, 39)),
         "brdf slice blazed.exr --wavelengths 550 --views=-20:20:0.01 --out all.csv"), read=powers),
    Row("thesis-terms", "C.1; Fig. 6.12", "terms for 1 % at depths of 0.15, 0.5, 2 µm", "39, found by trying",
        tuple(c for d in ("0.15", "0.5", "2") for c in (f"brdf surface sinusoid --period-um 3.2 --depth-um {d} --pixels 128 --out h{d}.exr", f"brdf terms h{d}.exr --extent 1 --out t{d}")), read=terms),
    Row("thesis-deep", "3.4", "grating 4 µm deep", "Taylor's series", ("brdf surface sinusoid --period-um 12 --depth-um 4 --out deep.exr",
        "brdf slice deep.exr --wavelengths 550 --method taylor --out t.csv", "brdf slice deep.exr --wavelengths 550 --out c.csv"), read=deep),
    Row("thesis-nmm", "4.5.2; Fig. 6.4b", "NMM in the mirror direction", "white spot, set by hand", ("brdf surface sinusoid --period-um 1.6 --depth-um 0.1 --out s.exr",
        "brdf map s.exr --size 257 --zoom 8 --method nmm --normalisation relative --out nmm.exr", "brdf map s.exr --size 257 --zoom 8 --method chebyshev --normalisation relative --out full.exr"), read=white_spot),
    Row("thesis-gems", "2.3; Fig. 2.15, 6.4d", "shader of GPU Gems, which knows the period only (sinusoid, 1.6 µm)", "pictures", ("chart surface-gems --quick --out charts",), read=gems),
    Row("thesis-gems-shader", "Fig. 2.15, 2.16, 6.4d", "that shader's own map", "pictures", ("brdf gems --period-um 1.6 --size 257 --out gems.exr",), read=gems_map),
    Row("thesis-steps", "Fig. 6.5, 6.6", "steps of wavelengths, coherence 65 µm", "5 nm as good as 1 nm", ("chart surface-step --quick --out charts",), read=step_chart),
    Row("thesis-steps-map", "Fig. 6.5, 6.6", "map in steps of 5 nm, coherence 65 µm: off by", "as good as 1 nm (by eye)",
        (BLAZED, *(f"brdf map blazed.exr --size 257 {step} --out {n}.exr" for n, step in (("own", ""), ("s5", "--wavelength-step-nm 5")))), read=steps_map),
    Row("thesis-incidence", "Fig. 6.1, 6.13", "maps under light at 0°, 10°, 30°: place of the mirror direction", "pictures",
        (SHALLOW, *(f"brdf map shallow.exr --light {t},0 --size 257 --max-error 0.05 --out m{t}.exr" for t in (0, 10, 30))), read=incidence),
    Row("thesis-slits", "Fig. 5.4, 5.5", "2, 5, 10 slits of 30 µm, 150 µm apart, 500 nm: light over angle", "plots",
        tuple(f"render n{n}.toml --samples 64 --out n{n}.exr" for n in COUNTS), prepare=slit_scenes, read=slit_curves),
    Row("thesis-colour", "Eq. 4.11", "matrix from X, Y, Z to the screen", "that of CIE RGB", ("render D65.toml --out D65.exr", "render E.toml --out E.exr"), prepare=color_scenes, read=colors),
    Row("thesis-blending", "Alg. 4", "diffraction blended with a texture", "weights by hand", why="no number; `blend = \"fresnel\"` in scenes keeps the energy"),
    Row("thesis-drawings", "Fig. 1.1-3.5, 4.2-4.10, 5.1-5.3", "illustrations", "drawings", why="drawings and pictures of others"),
    Row("thesis-snake", "Fig. 6.14-6.16", "snake with measured skins", "pictures", why="mesh of a laboratory; `render --gallery DIR --scenes snake` has another"),
    Row("thesis-photograph", "Fig. 6.17", "photograph of a real snake beside it", "pictures", why="the specimen"),
    Row("thesis-machine", "Table 6.1", "frames per second", "“barely interactive” (GTX 770)", why="that card"),
    Row("thesis-afm", "5.1", "heights by AFM", "100 × 100 pixels", why="the instrument; `brdf heights` reads its files (`tests/heights/run`)"),
]
