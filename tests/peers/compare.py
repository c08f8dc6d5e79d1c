"""Runs Nacre's command and each peer's script in turn, five times each, and writes times and peak memory as a table."""

import datetime
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
DOCUMENT = HERE.parents[1] / "docs/peers.md"
NACRE = os.environ["NACRE_BIN"]
PAIRS = 5

# Task, how its files are made, Nacre's command, peers, and the goal: most CPU seconds (or wall time) over that of the first peer.
TASKS = {
    "polarization": (inputs.polarization, "reconstruct polarization {in} --out {out}", ["numpy", "polanalyser"], ("wall", 1.2)),
    "table": (inputs.table, f"reconstruct lut {{in}}/photograph.tif --wavelength 680 --scale {inputs.TABLE_SCALE} --size 2048 "
              "--extent 1 --max-error 0.01 --out {out}", ["OpenCV remap"], ("CPU", 0.5)),
    "hdr": (inputs.hdr, "reconstruct hdr {in} --align off --out {out}", ["OpenCV Debevec", "OpenCV Robertson"], ("CPU", 0.5)),
    "bokeh": (inputs.bokeh, f"reconstruct bokeh {{in}}/photograph.tif --psf-sigma {inputs.BLUR_PX} --pixel-um 1 --iterations "
              f"{inputs.ITERATIONS} --out {{out}}", ["OpenCV loop", "scikit-image"], ("CPU", 0.5)),
    "terms": (inputs.terms, f"brdf terms {{in}}/height.tif --pixel-um {inputs.PIXEL_UM} --range-um {inputs.DEPTH_UM} --max-error 0.01 "
              "--out {out}", ["SciPy"], ("CPU", 0.5)),
    "board": (inputs.board, "calibrate geometry {in} --board 9x6 --square-mm 25 --out {out}/camera.json", ["OpenCV chessboard"],
              ("CPU", 1.0)),
}


def measured(command, folder):
    """CPU seconds, wall time and peak memory in MB of a process."""
    begun = time.monotonic()
    with open(folder / "said", "wb") as said:
        child = subprocess.Popen(command, stdout=said, stderr=said)
        _, status, usage = os.wait4(child.pid, 0)
    if status not in (0, 256):
        sys.exit(f"{' '.join(command)}: {(folder / 'said').read_text()[-500:]}")
    return usage.ru_utime + usage.ru_stime, time.monotonic() - begun, usage.ru_maxrss / 1024


def task(name):
    make, line, peers, goal = TASKS[name]
    with tempfile.TemporaryDirectory() as place:
        place = Path(place)
        given, out = place / "in", place / "out"
        given.mkdir()
        make(given)
        commands = {"Nacre": [NACRE, *line.replace("{in}", str(given)).replace("{out}", str(out)).split()]}
        commands |= {peer: [sys.executable, str(HERE / "peers.py"), peer, str(given)] for peer in peers}
        results = {who: [] for who in commands}
        for _ in range(PAIRS):
            for who, command in commands.items():
                shutil.rmtree(out, ignore_errors=True)
                if who == "Nacre" and name == "board":
                    out.mkdir()
                results[who].append(measured(command, place))
        # A peer's process loads Python and its libraries, which is no part of the work.
        start = min(measured([sys.executable, str(HERE / "start.py")], place)[:2] for _ in range(PAIRS))
    rows = {}
    for who, all_runs in results.items():
        cpu, wall, memory = (statistics.median(v) for v in zip(*all_runs))
        less = (0, 0) if who == "Nacre" else start
        rows[who] = (cpu - less[0], wall - less[1], memory)
        print(f"{name}: {who} {rows[who][0]:.2f} CPU-seconds, {rows[who][1]:.2f} s, {memory:.0f} MB", file=sys.stderr)
    return rows, goal


def table(found):
    cpu = next((line.split(":")[1].strip() for line in open("/proc/cpuinfo") if line.startswith("model name")), "")
    lines = [
        "# Nacre and others", "",
        f"Made by `tests/peers/run --update` on {datetime.date.today()}: {cpu}, {os.cpu_count()} threads; medians of {PAIRS} runs in turn on",
        "the same files (`tests/peers/inputs.py`). Nacre's commands are whole: they read, compute, write maps and draw pictures. Peers",
        "(`tests/peers/peers.py`) read and compute, without the time that Python takes to start.", "",
        "| task | program | CPU-seconds | wall, s | peak, MB | Nacre's CPU over it | Nacre's wall over it | goal |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name, (rows, (kind, most)) in found.items():
        own = rows["Nacre"]
        for k, (who, (cpu_s, wall, memory)) in enumerate(rows.items()):
            ratios = ["", "", ""]
            if who != "Nacre":
                ratios = [f"{own[0] / cpu_s:.2f}", f"{own[1] / wall:.2f}", f"{kind} at most {most}" if k == 1 else ""]
            lines.append(f"| {name if k == 0 else ''} | {who} | {cpu_s:.2f} | {wall:.2f} | {memory:.0f} | {' | '.join(ratios)} |")
    return "\n".join(lines) + "\n"


def main():
    names = [a for a in sys.argv[1:] if not a.startswith("-")] or list(TASKS)
    text = table({name: task(name) for name in names})
    if "--update" in sys.argv[1:]:
        DOCUMENT.write_text(text)
    else:
        print(text)


main()
