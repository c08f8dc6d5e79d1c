"""Runs Nacre's command and each peer's script in turn, five times each, and writes times and peak memory as a table."""

import datetime
import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import inputs

HERE = Path(__file__).resolve().parent
DOCUMENT = HERE.parents[1] / "docs/validation/peers.md"
NACRE = os.environ["NACRE_BIN"]
PAIRS = 5

# Task, how its files are made, Nacre's command, peers, and the goal: most CPU seconds (or wall time) over that of the first peer. Nacre's
# iterations of the deconvolution are accelerated: so many leave less error than the peer's.
TASKS = {
    "polarization": (inputs.polarization, "reconstruct polarization {in} --out {out}", ["numpy", "polanalyser"], ("wall", 1.2)),
    "table": (inputs.table, f"reconstruct lut {{in}}/photograph.tif --wavelength 680 --scale {inputs.TABLE_SCALE} --size 2048 "
              "--extent 1 --max-error 0.01 --out {out}", ["OpenCV remap"], ("CPU", 0.5)),
    "hdr": (inputs.hdr, "reconstruct hdr {in} --align off --out {out}", ["OpenCV Debevec", "OpenCV Robertson"], ("CPU", 0.5)),
    "bokeh": (inputs.bokeh, f"reconstruct bokeh {{in}}/photograph.tif --psf-sigma {inputs.BLUR_PX} --pixel-um 1 --iterations 8 "
              "--out {out}", ["OpenCV loop", "scikit-image"], ("CPU", 0.5)),
    "terms": (inputs.terms, f"brdf terms {{in}}/height.tif --pixel-um {inputs.PIXEL_UM} --range-um {inputs.DEPTH_UM} --max-error 0.01 "
              "--out {out}", ["SciPy"], ("CPU", 0.5)),
    "board": (inputs.board, "calibrate geometry {in} --board 9x6 --square-mm 25 --out {out}/camera.json", ["OpenCV chessboard"],
              ("CPU", 1.0)),
    "registration": (inputs.registration, "reconstruct polarization {in} --align auto --out {out}", ["OpenCV ECC", "scikit-image phases"],
                     ("CPU", 1.0)),
    "environment": (inputs.environment, "render {in}/scene.toml --max-error 0.01 --out {out}/picture.exr", ["numpy, brute force"],
                    ("CPU", 0.5)),
}
# Tasks whose commands want the folder of their result to exist.
INTO_FOLDER = ["board", "environment"]



def measured(command, folder):
    """CPU seconds, wall time and peak memory in MB of a process."""
    said = folder / "said"
    run = subprocess.run([sys.executable, str(HERE / "measure.py"), str(said), *command], check=True, capture_output=True, text=True)
    code, *numbers = (float(word) for word in run.stdout.split())
    # Nacre says 1 where an error that is asked for is not met.
    if code != 0 and not (code == 1 and command[0] == NACRE):
        sys.exit(f"{' '.join(command)}: {said.read_text()[-500:]}")
    return numbers


def differs(given, out):
    """How far Nacre's picture is from brute force, one factor per channel (the light's unit and white) aside."""
    import numpy as np
    import OpenEXR

    ours = OpenEXR.File(str(out / "picture.exr")).channels()["RGB"].pixels.astype(float)
    theirs = np.load(given / "numpy.npy").astype(float)
    theirs *= (ours * theirs).sum((0, 1)) / (theirs**2).sum((0, 1))
    return f"Nacre's picture differs from brute force by {100 * np.sqrt(np.mean((ours - theirs) ** 2)) / ours.mean():.3f} % (rms)"


def shifts(_, out):
    import numpy as np

    found = np.array(json.loads((out / "report.json").read_text())["registration"]["shifts_px"])
    angle = 2 * np.pi * np.arange(len(found)) / len(found)
    off = found - inputs.SHIFT_PX * np.stack([np.cos(angle), np.sin(angle)], 1)
    return f"Nacre's shifts are at most {np.hypot(*(off - off.mean(0)).T).max():.3f} px off"


CHECKS = {"registration": shifts, "environment": differs}


def task(name):
    make, line, peers, goal = TASKS[name]
    with tempfile.TemporaryDirectory() as place:
        place = Path(place)
        given, out = place / "in", place / "out"
        given.mkdir()
        make(given)
        commands = {"Nacre": [NACRE, *line.replace("{in}", str(given)).replace("{out}", str(out)).split()]}
        commands |= {peer: [sys.executable, str(HERE / "peers.py"), peer, str(given)] for peer in peers}
        results, said = {who: [] for who in commands}, {}
        for _ in range(PAIRS):
            for who, command in commands.items():
                if who == "Nacre":
                    shutil.rmtree(out, ignore_errors=True)
                    if name in INTO_FOLDER:
                        out.mkdir()
                results[who].append(measured(command, place))
                said[who] = (place / "said").read_text().strip().splitlines()[-1:]
        # A peer's process loads Python and its libraries, which is no part of the work.
        start = min(measured([sys.executable, str(HERE / "start.py")], place)[:2] for _ in range(PAIRS))
        checked = CHECKS[name](given, out) if name in CHECKS else ""
    rows = {}
    for who, all_runs in results.items():
        cpu, wall, memory = (statistics.median(v) for v in zip(*all_runs))
        less = (0, 0) if who == "Nacre" else start
        rows[who] = (cpu - less[0], wall - less[1], memory)
        print(f"{name}: {who} {rows[who][0]:.2f} CPU-seconds, {rows[who][1]:.2f} s, {memory:.0f} MB {said[who]}", file=sys.stderr)
    print(f"{name}: {checked}", file=sys.stderr)
    return rows, goal, checked


def table(found):
    cpu = next((line.split(":")[1].strip() for line in open("/proc/cpuinfo") if line.startswith("model name")), "")
    lines = [
        "# Time and memory against other programs", "",
        f"Made by `tests/peers/run --update` on {datetime.date.today()}: {cpu}, {os.cpu_count()} threads; medians of {PAIRS} runs in turn on",
        "the same files (`tests/peers/inputs.py`). Nacre's commands are whole: they read, compute, write maps and draw pictures. Peers",
        "(`tests/peers/peers.py`) read and compute, without the time that Python takes to start; they write nothing. Kernels without files:",
        "[speed](speed.md), [bokeh](bokeh.md), [surfaces](surfaces.md).", "",
        "| task | program | CPU-seconds | wall, s | peak, MB | Nacre's CPU over it | Nacre's wall over it | goal |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name, (rows, (kind, most), _) in found.items():
        own = rows["Nacre"]
        for k, (who, (cpu_s, wall, memory)) in enumerate(rows.items()):
            ratios = ["", "", ""]
            if who != "Nacre":
                ratios = [f"{own[0] / cpu_s:.2f}", f"{own[1] / wall:.2f}", f"{kind} at most {most}" if k == 1 else ""]
            lines.append(f"| {name if k == 0 else ''} | {who} | {cpu_s:.2f} | {wall:.2f} | {memory:.0f} | {' | '.join(ratios)} |")
    lines += ["", *(f"- {name}: {checked}." for name, (*_, checked) in found.items() if checked)]
    return "\n".join(lines) + "\n"


def main():
    names = [a for a in sys.argv[1:] if not a.startswith("-")] or list(TASKS)
    text = table({name: task(name) for name in names})
    if "--update" in sys.argv[1:]:
        DOCUMENT.write_text(text)
    else:
        print(text)


main()
