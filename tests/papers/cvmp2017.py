"""Rows of the 2017 CVMP paper: lookup tables of low rank under environments."""

import numpy as np

import skies
from rows import AGREES, NO_NUMBER, PAPER_OFF, Outcome, Row, write_exr

TITLE = "Low-rank factorisation (CVMP 2017)"
RANKS = (1, 3, 10, 21)
SIZE = 256
SPAN = ((2 * np.arange(SIZE) + 1) / SIZE - 1)


def spot(x, y, a, b, s):
    return np.exp(-((x - a) ** 2 + (y - b) ** 2) / (2 * s**2))


def rich(x, y):
    """Spots on a lattice whose brightness does not separate, and a ring: many terms."""
    light = 0.15 * np.exp(-((np.hypot(x, y) - 0.45) ** 2) / (2 * 0.05**2))
    for i in range(-5, 6):
        for j in range(-5, 6):
            light = light + (1.3 + np.cos(1.7 * i * j + 0.6 * i + 0.9 * j)) / (2 + abs(i) + abs(j)) * spot(x, y, 0.1 * i, 0.1 * j, 0.025)
    return light


def oblique(x, y):
    """A lattice along 17° and 86° whose brightness separates."""
    first, second = (np.array([np.cos(a), np.sin(a)]) for a in np.radians([17, 86]))
    light = 0
    for i in range(-5, 6):
        for j in range(-5, 6):
            a, b = 0.1 * i * first + 0.1 * j * second
            light = light + np.exp(-0.5 * abs(i) - 0.4 * abs(j)) * spot(x, y, a, b, 0.025)
    return light


def diagonals(x, y):
    """Two streaks at 45° and 135°, as of the television."""
    p, q = (x + y) / np.sqrt(2), (x - y) / np.sqrt(2)
    streak = lambda along, across: np.exp(-abs(along) / 0.2 - across**2 / (2 * 0.03**2))
    return streak(p, q) + 0.7 * streak(q, p)


def stripe(x, y):
    """One line of orders, as of a disc."""
    return sum(np.exp(-0.6 * abs(m)) * spot(x, y, 0.25 * m, 0, 0.03) for m in range(-3, 4))


def table(pattern):
    def make(folder):
        x, y = np.meshgrid(SPAN, -SPAN)
        skies.write_table(folder / "table.exr", pattern(x, y), 1.0)
    return make


def curves(run, folder, part=1):
    """Both curves of a part (terms × samples, green), and their coordinates."""
    pair = []
    header = run.header(f"{folder}/part-{part}-across.exr")
    for name in ("across", "along"):
        pair.append(run.exr(f"{folder}/part-{part}-{name}.exr")["G"])
    reach = [float(header[k]) for k in ("reach_x", "reach_beta")]
    at = [r * ((2 * np.arange(c.shape[1]) + 1) / c.shape[1] - 1) for r, c in zip(reach, pair)]
    return pair, at


def kernel(pattern, at):
    """The table over (x, β) with (1 + ωi·ωo)², whose cells are equal solid angles."""
    x, beta = np.meshgrid(*at)
    rest = np.sqrt(1 - x**2)
    return pattern(x, rest * np.sin(beta)) * (1 + rest * np.cos(beta)) ** 2


def singular(run):
    _, at = curves(run, "r1")
    values = np.linalg.svd(kernel(rich, at), compute_uv=False)
    right = [np.sqrt((values[r:] ** 2).sum() / (values**2).sum()) for r in RANKS]
    ours = [run.json(f"r{r}/report.json")["error"] for r in RANKS]
    good = all(abs(a - b) < 0.02 * b + 2e-3 for a, b in zip(ours, right))
    text = lambda v: ", ".join(f"{x:.4f}" for x in v)
    return Outcome(text(ours), f"{text(right)} (SVD, NumPy)", good)


def printed(run):
    """What both passes give when each adds up its terms, against as many pictures in between as terms."""
    right, wrong = [], []
    for r in RANKS[1:]:
        (across, along), at = curves(run, f"r{r}")
        full = kernel(rich, at)
        scale = np.linalg.norm(full)
        right.append(np.linalg.norm(along.T @ across - full) / scale)
        both = np.outer(along.sum(0), across.sum(0))
        wrong.append(np.linalg.norm(both - full) / scale)
    text = lambda v: ", ".join(f"{x:.3f}" for x in v)
    return Outcome(f"curves as written: {text(right)}", f"as printed: {text(wrong)} (NumPy)", all(w > 2 * r for r, w in zip(right, wrong)) and right[-1] < 0.02, PAPER_OFF)


def furnace(run):
    (across, along), at = curves(run, "f")
    step = [a[1] - a[0] for a in at]
    ours = (across.sum(1) * along.sum(1)).sum() * step[0] * step[1]
    right = 14 * np.pi / 3
    return Outcome(f"{ours:.3f}", f"14π/3 = {right:.3f}; without the Jacobian 17π/6 = {17 * np.pi / 6:.2f}", abs(ours / right - 1) < 0.01, PAPER_OFF)


def straightened(run):
    found = sorted(a % 180 for a in run.json("found/report.json")["directions_deg"][:2])
    errors = [run.json(f"{n}/report.json")["error"] for n in ("found", "straight")]
    good = abs(found[0] - 17) < 1.5 and abs(found[1] - 86) < 1.5 and errors[0] < errors[1] / 2
    return Outcome(f"{found[0]:.1f}°, {found[1]:.1f}°; rank 1: {errors[0]:.3f}, without {errors[1]:.3f}", "drawn: 17°, 86°; separable: 0", good)


def rank_pictures(run):
    ours = [run.json(f"r{r}/report.json")["picture_error"] for r in RANKS]
    ours = [np.max(e) for e in ours]
    return Outcome(", ".join(f"{100 * e:.1f}" for e in ours) + " %", "falls with the rank", all(a >= 0.9 * b for a, b in zip(ours, ours[1:])) and ours[2] < ours[0], NO_NUMBER)


def sky(folder):
    table(rich)(folder)
    light = skies.sky("lamp")[1]
    write_exr(folder / "sky.exr", R=light, G=light, B=light)


def room(folder):
    sky(folder)
    (folder / "room.toml").write_text(skies.SCENE.format(sky="sky", distance=500, fov=8, side=32))


def rendered(run):
    """Pictures by two passes against samples of the whole integral; their noise is left in."""
    truth = run.exr("samples.exr", "G")
    ours = [np.sqrt(((run.exr(f"r{r}.exr", "G") - truth) ** 2).mean()) / truth.mean() for r in RANKS]
    text = ", ".join(f"{100 * e:.1f}" for e in ours) + " % off"
    noise = run.reports[-1]["noise"]
    # Each report's own measured error holds, within three times the noise of the samples.
    said = [report["environments"][0]["measured_error"] for report in run.reports[:-1]]
    holds = all(error < limit + 3 * noise for error, limit in zip(ours, said))
    return Outcome(text, f"samples (noise {100 * noise:.1f} %)", holds and ours[3] < ours[0], NO_NUMBER)


def parts(run):
    one, two, split = (run.json(f"{n}/report.json")["error"] for n in ("one", "two", "split"))
    text = f"rank 1 {one:.3f}, rank 2 {two:.3f}; two parts of rank 1 {split:.3f}"
    return Outcome(text, "two streaks are of rank 2: 0", two < 0.1 and two < one)


def line(run):
    report = run.json("line/report.json")
    (across, along), at = curves(run, "line")
    step = [a[1] - a[0] for a in at]
    ours = (across.sum(1) * along.sum(1)).sum() * step[0] * step[1]
    full = kernel(stripe, at).sum() * step[0] * step[1]
    return Outcome(f"light {ours / full:.4f} of the table's, rank {report['parts'][0]['rank']}", "1 (sum, NumPy)", abs(ours / full - 1) < 0.02)


def negative(run):
    lowest = []
    for name in ("plain", "clean"):
        (across, along), _ = curves(run, name)
        product = along.T @ across
        lowest.append(product.min() / product.max())
    errors = [run.json(f"{n}/report.json")["error"] for n in ("plain", "clean")]
    good = lowest[1] >= -1e-6 and lowest[0] < -0.005 and errors[0] <= errors[1]
    return Outcome(f"lowest {lowest[0]:.3f} of the peak; `nonnegative` {lowest[1]:.3f}, error {errors[0]:.3f} and {errors[1]:.3f}", "≥ 0", good, PAPER_OFF)


def poles(run):
    chart = run.csv("charts/environment-poles/environment-poles.csv")
    pick = lambda word: {a: e for a, e, s in zip(chart["stress"], chart["error_median"], chart["setting"]) if word in str(s)}
    plain, turned = pick("two passes"), pick("rotations")
    text = f"at 60°: {100 * plain[60.0]:.0f} %, with rotations {100 * turned[60.0]:.1f} %"
    return Outcome(text, "full integral (Nacre's)", turned[60.0] < plain[60.0] / 2 and max(turned.values()) < 0.1, AGREES)


FACTOR = "factor table.exr --directions-deg 0,90"
ROWS = [
    Row("cvmp-rank", "Eq. 8; Fig. 3", "error of a table at ranks 1, 3, 10, 21", "pictures", tuple(f"{FACTOR} --rank {r} --out r{r}" for r in RANKS),
        prepare=table(rich), read=singular),
    Row("cvmp-printed", "Eq. 10, 11; Alg. 1", "ranks 3, 10, 21 with both passes summed over the terms, as printed", "higher ranks look alike",
        tuple(f"{FACTOR} --rank {r} --out r{r}" for r in RANKS), prepare=table(rich), read=printed),
    Row("cvmp-furnace", "Eq. 7", "constant table under a white sky", "8.90 by its formula", (f"{FACTOR} --rank 2 --out f",), prepare=table(lambda x, y: np.ones(x.shape)), read=furnace),
    Row("cvmp-straighten", "4.2; Fig. 4", "oblique lattice: directions, error with and without straightening", "pictures",
        ("factor table.exr --rank 1 --out found", f"{FACTOR} --rank 1 --out straight"), prepare=table(oblique), read=straightened),
    Row("cvmp-picture", "Fig. 5", "error of the picture at ranks 1, 3, 10, 21 under a lamp of 5°", "hardly any difference",
        tuple(f"{FACTOR} --rank {r} --environment sky.exr --out r{r}" for r in RANKS), prepare=sky, read=rank_pictures),
    Row("cvmp-ranks", "Fig. 5", "renderings at ranks 1, 3, 10, 21: a sheet under a lamp of 5°", "pictures",
        (*(f"render room.toml --method two-pass --rank {r} --max-error 1 --out r{r}.exr" for r in RANKS), "render room.toml --method samples --samples 16384 --max-error 0.005 --out samples.exr"),
        prepare=room, read=rendered),
    Row("cvmp-sum", "5.3; Table 1", "television: two streaks; error of one blur, of two, and of a blur per streak", "88 FPS (GTX 1080)",
        ("factor table.exr --rank 1 --out one", "factor table.exr --rank 2 --out two", "factor table.exr --rank 1 --parts 2 --out split"), prepare=table(diagonals), read=parts),
    Row("cvmp-line", "5.3; Table 1", "CD: one curve along its first direction", "100 FPS (GTX 1080)", (f"{FACTOR} --kind line --out line",), prepare=table(stripe), read=line),
    Row("cvmp-negative", "4.1", "negative light at rank 2 of two streaks at 45°", "not mentioned",
        (f"{FACTOR} --rank 2 --out plain", f"{FACTOR} --rank 2 --kind nonnegative --out clean"), prepare=table(diagonals), read=negative),
    Row("cvmp-poles", "5.2; Fig. 6", "lines bend towards the poles; four passes with rotations", "pictures", ("chart environment-poles --quick --out charts",), read=poles),
    Row("cvmp-light", "Alg. 2", "direction of light for an entry: the sign of step 5", "below the surface", why="`render --method two-pass` takes the other sign, and agrees with samples (row of ranks)"),
    Row("cvmp-cathedral", "Fig. 1, 7, 8", "renderings under an environment, turned about the view", "pictures", why="no number; `render --method two-pass --frames 36 --turn view`"),
    Row("cvmp-drawings", "Fig. 2", "orders of a grating", "drawing", why="drawing"),
    Row("cvmp-frames", "Table 1", "frames per second", "56, 59, 50, 88, 100", why="GTX 1080; `nacre chart gpu-speed` measures the card at hand"),
    Row("cvmp-rank-frames", "5.3", "frames per second at ranks 1, 3, 10, 21", "60, 30, 10, 5", why="GTX 1080"),
]
