"""Rows of the 2018 paper's section 5: orientation by polarization imaging."""

import numpy as np

import truth
from rows import AGREES, EXACTER, NO_NUMBER, PAPER_OFF, Outcome, Row, orientation_errors

LOGO = "demo --sample logo --size 256 --angles-deg 0,13,26,39,52,65,78,91,104,117,130,143 --out logo"
SIDE = 160


def turning(bands=None):
    """Orientations that turn by half a turn, evenly, or in so many stripes 15° apart."""
    y, x = np.mgrid[:SIDE, :SIDE]
    turn = np.pi * ((1.3 * x + 0.9 * y) / SIDE % 1)
    return turn if bands is None else np.floor(turn / np.pi * bands) * np.pi / 12


def prepare(*films, steps=None, full_e=40_000):
    """A series `0`, `1`, … per film: r, ζ, film, axis, stripes."""
    psi = np.arange(12) * 15.0 if steps is None else np.asarray(steps, float)

    def make(folder):
        for k, (r, zeta, film, axis, bands) in enumerate(films):
            series = truth.intensities(turning(bands), np.radians(psi), r, zeta, film, axis)
            truth.write_series(folder / str(k), series, psi, 2018 + k, full_e)
    return make


def taken(run, k):
    """A series of photographs as light."""
    frames = run.json(f"{k}/frames.json")["frames"]
    light = np.array([(np.load(run.folder / str(k) / f["file"]).astype(float) - 2000) / 60000 for f in frames])
    return light, np.radians([f["analyser_deg"] for f in frames])


def mean_error(found, right):
    return np.nanmean(abs(orientation_errors(found[np.isfinite(found)], right[np.isfinite(found)])))


def against_paper(*films, prenormalized, most):
    """Mean errors of Nacre's default and of the paper's way on the same photographs."""
    def read(run):
        ours, theirs, shares = [], [], []
        for k, (*_, bands) in enumerate(films):
            found = run.exr(f"r{k}/orientation.exr", "orientation")
            light, psi = taken(run, k)
            ours.append(mean_error(found, turning(bands)))
            theirs.append(mean_error(truth.paper_orientations(light, psi, prenormalized), turning(bands)))
            shares.append(np.isfinite(found).mean())
        text = lambda v: ", ".join(f"{x:.2f}" for x in v)
        good = max(ours) < most and min(shares) > 0.9
        verdict = AGREES if max(theirs) < 0.1 else EXACTER if max(ours) < max(theirs) else PAPER_OFF
        return Outcome(f"{text(ours)}°; the paper's way {text(theirs)}°", "drawn orientations: 0 (NumPy)", good, verdict)
    return read


def film_row(name, where, what, paper, *films, prenormalized=True, most=0.5, full_e=40_000):
    commands = tuple(f"reconstruct polarization {k} --model auto --out r{k}" for k in range(len(films)))
    return Row(name, where, what, paper, commands, prepare=prepare(*films, full_e=full_e), read=against_paper(*films, prenormalized=prenormalized, most=most))


RATIOS = (0.5001, 0.8, 1.2, 1.5)


def sine(run):
    worst = max(1 - run.exr(f"r{k}/aolp.exr", "correlation").min() for k in range(len(RATIOS)))
    # The rest is the rounding to 16 bits.
    return Outcome(f"1 − correlation ≤ {worst:.0e}", "0: Malus' law is a sinusoid", worst < 1e-6, PAPER_OFF)


STEPS = (13.0 * np.arange(12), 13.0 * np.arange(17))


def steps(folder):
    for n, angles in enumerate(STEPS):
        series = truth.intensities(turning(), np.radians(angles), 1.1, 45)
        truth.write_series(folder / str(n), series, angles, 0, None)


def step_bias(run):
    ours, theirs = [], []
    for n in range(2):
        found = run.exr(f"r{n}/orientation.exr", "orientation")
        light, psi = taken(run, n)
        ours.append(abs(orientation_errors(found, turning())).max())
        theirs.append(abs(orientation_errors(truth.paper_orientations(light, psi, False), turning())).max())
    text = lambda v: ", ".join(f"{x:.2f}" for x in v)
    return Outcome(f"≤ {text(ours)}°; the paper's way {text(theirs)}°", "0 (closed form)", max(ours) < 0.02, EXACTER)


def demo(name, where, sample, what, angles, paper, correlation=None, spread=None, most=0.5):
    """A sample of the simulated bench, judged by its map."""
    line = f"demo --sample {sample} --size 256 --angles-deg {angles} --out {sample}"

    def read(run):
        found, fit, sigma = run.exr(f"../once/{sample}/result/orientation.exr", "orientation", "correlation", "sigma")
        right, purity = run.exr(f"../once/{sample}/session/truth.exr", "orientation", "purity")
        seen = np.isfinite(found) & np.isfinite(right) & (purity > 0.99)
        off, said = abs(orientation_errors(found[seen], right[seen], sigma[seen] ** -2.0)), np.degrees(sigma[seen])
        text = f"error {off.mean():.2f} ± {off.std():.2f}°, σ {np.median(said):.2f}°" + (f", correlation {fit[seen].mean():.4f}" if correlation else "")
        verdict = EXACTER if correlation and fit[seen].mean() > correlation or spread and off.mean() < spread else NO_NUMBER
        return Outcome(text, "drawn map: 0", off.mean() < most and (off > 5 * said).mean() < 0.01 and seen.mean() > 0.1, verdict)

    return Row(name, where, what, paper, once=(line,), read=read)


def steps_of(degrees, count):
    return ",".join(str(k * degrees) for k in range(count))


def smoothed(run):
    found = {}
    right, purity = run.exr("../once/logo/session/truth.exr", "orientation", "purity")
    for name in ("none", "light", "strong"):
        map_ = run.exr("../once/logo/result/orientation.exr" if name == "none" else f"{name}/orientation.exr", "orientation")
        seen = np.isfinite(map_) & np.isfinite(right) & (purity > 0.99)
        found[name] = abs(orientation_errors(map_[seen], right[seen])).mean()
    text = ", ".join(f"{k} {v:.3f}°" for k, v in found.items())
    return Outcome(text, "drawn map: 0", found["light"] < found["none"] and found["strong"] < found["none"])


def independent_of_period(run):
    ours = []
    for period in ("2.0", "1.0", "0.7"):
        table = run.csv(f"o{period}.csv")
        ours.append(float(table["efficiency"][table["order"] == 0][0]))
    right = truth.bessel_orders(0.1, 560, 2.0)[8]
    good = max(abs(e - right) for e in ours) < 1e-5
    return Outcome(", ".join(f"{e:.4f}" for e in ours), f"{right:.4f} at any period (J0², SciPy)", good, PAPER_OFF)


def relative(run):
    found = run.exr("relative/period.exr", "period")
    right, purity = run.exr("../once/emblem/session/truth.exr", "period", "purity")
    seen = np.isfinite(found) & np.isfinite(right) & (purity > 0.99)
    r = np.corrcoef(found[seen], right[seen])[0, 1]
    marked = any("heuristic" in w.lower() for w in [*run.reports[-1]["warnings"], str(run.reports[-1].get("period"))])
    return Outcome(f"correlation with drawn periods {r:.2f}; report calls it heuristic: {'yes' if marked else 'no'}",
                   "no law (J0², RCWA)", marked, PAPER_OFF)


def equal_light(folder):
    """Two halves, one of half the reflectance of the other: the law must show periods as 1 to the root of a half."""
    psi = np.arange(6) * 30.0
    series = truth.intensities(turning(), np.radians(psi), 1.1, 45)
    truth.write_series(folder / "halves", series * np.where(np.arange(SIDE) < SIDE // 2, 1.0, 0.5), psi, 5)


def law(run):
    found = run.exr("halves-r/period.exr", "period")
    sides = np.nanmedian(found[:, : SIDE // 2]), np.nanmedian(found[:, SIDE // 2:])
    return Outcome(f"{sides[0]:.3f} and {sides[1]:.3f} µm of 1 to 2", "2 and 1 + √½ = 1.707", abs(sides[0] - 2) < 0.02 and abs(sides[1] - 1 - 0.5**0.5) < 0.02, AGREES)


METALS = "aluminium, silver, brass, iron, gold, copper, platinum"
ROWS = [
    Row("2018-malus", "Eq. 9; Fig. 14a", "a sinusoid fits for r 0.5 to 1.5: residual", "RMS 0.002, “approximated”",
        tuple(f"reconstruct polarization {k} --model plain --out r{k}" for k in range(len(RATIOS))),
        prepare=prepare(*[(r, 30, 0, 0, None) for r in RATIOS], full_e=None), read=sine),
    film_row("2018-linear", "Fig. 14b", "phase and orientation, r 1.1, ζ 45°, no film", "a straight line", (1.1, 45, 0, 0, None), prenormalized=False, most=0.3),
    Row("2018-maps", "Fig. 14, 15", "charts of intensity over analyser and grating angle", "pictures", why="no number; `nacre chart metals maps`"),
    Row("2018-metals", "Fig. 15a", f"R of flat metals ({METALS}) under cellophane", "near linear to Δn 10°",
        why="flat metal at 0 to 10° has no signal beyond the film's; gratings' own R follow from Maxwell's equations (`chart surface-rcwa`)"),
    film_row("2018-zeta", "Fig. 15b-d", "r 1.001, Δn 3°, ζ 164°, 172°, 176°; mean error (10⁶ electrons)", "“near linear” once pre-normalised",
             *[(1.001, z, 3, 0, None) for z in (164, 172, 176)], full_e=1_000_000),
    film_row("2018-stripes", "5.3", "five orientations from 0 to 60° in view: r 1.05, ζ 175°, Δn 10°, and 1.2, 150°, 10°", "not tried",
             (1.05, 175, 10, 0, 5), (1.2, 150, 10, 0, 5), most=1.0),
    film_row("2018-axis", "Eq. 6", "film's axis at 20° and 71°: r 1.2, ζ 150°, Δn 10°", "axis along x assumed", (1.2, 150, 10, 20, None), (1.2, 150, 10, 71, None)),
    Row("2018-steps", "Eq. 10", "12 and 17 steps of 13°, normalised by mean and deviation or fitted; largest error without noise", "not mentioned",
        ("reconstruct polarization 0 --model sinusoid --out r0", "reconstruct polarization 1 --model sinusoid --out r1"), prepare=steps, read=step_bias),
    demo("2018-kinematic", "Fig. 16; 7.3", "kinematic", "kinematic tile, 13 photographs by 15°", steps_of(15, 13), "correlation 0.942", correlation=0.942),
    demo("2018-logo", "Fig. 18; 7.3", "logo", "logo, 12 photographs by 13°", steps_of(13, 12), "correlation 0.984", correlation=0.984),
    Row("2018-smoothing", "6.2; Fig. 18b-d", "bilateral smoothing, 10 and 50 rounds; error", "pictures",
        ("reconstruct polarization ../once/logo/session --smooth light --smooth-maps --out light",
         "reconstruct polarization ../once/logo/session --smooth strong --smooth-maps --out strong"), (LOGO,), read=smoothed),
    demo("2018-emblem", "Fig. 19c", "emblem", "banknote's emblem, 17 photographs by 13°; several periods, each with an offset of its own", steps_of(13, 17), "map only", most=5.0),
    demo("2018-stars", "Fig. 20a", "stars", "stars with gradients", steps_of(30, 6), "map only"),
    demo("2018-fireworks", "Fig. 20b", "fireworks", "fireworks", steps_of(30, 6), "map only", most=1.0),
    demo("2018-disc", "7.3; Fig. 25", "cd", "unwritten CD, six photographs", steps_of(30, 6), "3.616 ± 3.016°", spread=3.616),
    Row("2018-period-law", "5.4; Eq. 11", "order 0 at periods of 2.0, 1.0, 0.7 µm", "1 : 0.25 : 0.12",
        tuple(f"brdf orders --period-um {p} --depth-um 0.1 --wavelengths 560 --out o{p}.csv" for p in ("2.0", "1.0", "0.7")), read=independent_of_period),
    Row("2018-period-map", "5.4", "relative periods as the paper has them, of two halves with 1 and ½ of the light", "√I, stretched to a range",
        ("reconstruct polarization halves --model sinusoid --relative-period 1,2 --out halves-r",), prepare=equal_light, read=law),
    Row("2018-emblem-period", "5.4; Fig. 19d", "relative periods of the emblem against the drawn ones", "picture",
        ("reconstruct polarization ../once/emblem/session --relative-period 0.7,2 --out relative",),
        (f"demo --sample emblem --size 256 --angles-deg {steps_of(13, 17)} --out emblem",), read=relative),
]
