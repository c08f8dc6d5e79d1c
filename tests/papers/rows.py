"""Rows of the table, and the commands that they run."""

import csv
import dataclasses
import json
import math
import os
import re
import shlex
import subprocess
import typing
from pathlib import Path

import numpy as np
import OpenEXR

NACRE = os.path.realpath(os.environ["NACRE_BIN"])
DATA = Path(os.environ["NACRE_TEST_DATA"]).resolve()

# Verdicts on a number of a paper. Whether Nacre's own number is right is decided by the independent truth.
AGREES, EXACTER, PAPER_OFF, NO_NUMBER = "agrees", "nearer to the truth", "paper is off", "right"


@dataclasses.dataclass
class Outcome:
    """Nacre's number, the independent truth, whether they agree, and a verdict on the paper's number."""

    ours: str
    truth: str
    right: bool
    verdict: str = NO_NUMBER


@dataclasses.dataclass
class Row:
    """One technique, experiment or figure. Without `read`, `why` says why there is no number."""

    name: str
    where: str
    what: str
    paper: str = ""
    # Command lines without the program's name; those of `once` run in a folder that rows share, ../once.
    commands: tuple[str, ...] = ()
    once: tuple[str, ...] = ()
    prepare: typing.Callable[[Path], None] | None = None
    # Writes inputs of `once` into ../once.
    share: typing.Callable[[Path], None] | None = None
    read: typing.Callable[["Run"], Outcome] | None = None
    # The feature that this build lacks. To switch a row on, remove it and write `read`.
    missing: str = ""
    why: str = ""
    data: bool = False


class Failed(Exception):
    """A command that ended otherwise than expected."""


class Run:
    """The results of a row's commands in the folder of the row."""

    def __init__(self, folder):
        self.folder = folder
        # The report (standard output as JSON), exit code and messages of each command, in order.
        self.reports, self.codes, self.messages, self.seconds = [], [], [], []

    def nacre(self, line, quiet=False):
        """Runs a command. Exit code 1 means that a wanted error is not met, 2 that the input is refused; rows judge both."""
        command = [NACRE, "--json", *(str(DATA / w[5:]) if w.startswith("DATA/") else w for w in shlex.split(line))]
        before = os.times()
        run = subprocess.run(command, cwd=self.folder, capture_output=True, text=True)
        after = os.times()
        if run.returncode not in (0, 1, 2) or (run.returncode == 2 and not quiet):
            raise Failed(f"nacre {line}: {run.stderr.strip()[-300:]}")
        try:
            # Where an error is not met, some builds print a second object, about that.
            report, _ = json.JSONDecoder().raw_decode(run.stdout)
        except ValueError:
            report = None
        self.reports.append(report)
        self.codes.append(run.returncode)
        self.messages.append(run.stderr.strip())
        self.seconds.append(after.elapsed - before.elapsed)

    def exr(self, file, *channels):
        """Channels of an EXR file as float64 arrays, or all by name."""
        parts = OpenEXR.File(str(self.folder / file), separate_channels=True).channels()
        read = {name: np.asarray(part.pixels, float) for name, part in parts.items()}
        if not channels:
            return read
        return read[channels[0]] if len(channels) == 1 else [read[name] for name in channels]

    def header(self, file):
        return OpenEXR.File(str(self.folder / file)).header()

    def csv(self, file):
        """Columns of a CSV file, numbers as floats."""
        with open(self.folder / file, newline="") as lines:
            rows = list(csv.DictReader(lines))
        return {name: np.array([number(row[name]) for row in rows]) for name in rows[0]}

    def json(self, file):
        return json.loads((self.folder / file).read_text())


def number(text):
    try:
        return float(text)
    except ValueError:
        return math.nan if text in ("", "NaN") else text


def write_exr(file, **channels):
    """Writes float32 channels."""
    attributes = {"compression": OpenEXR.NO_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(attributes, {name: np.ascontiguousarray(values, "f4") for name, values in channels.items()}).write(str(file))


def orientation_errors(found, truth, weights=1.0):
    """Differences of orientations in degrees after the best common offset; all in radians, modulo π."""
    difference = np.exp(2j * (found - truth))
    return np.degrees(np.angle(difference / np.mean(weights * difference))) / 2


def run_row(row, work):
    """Outcome of a row, or None where it has no number."""
    if row.read is None:
        return None
    folder, shared = work / row.name, work / "once"
    folder.mkdir()
    shared.mkdir(exist_ok=True)
    if row.share:
        row.share(shared)
    for line in row.once:
        mark = shared / re.sub(r"\W+", "-", line)[:150]
        if not mark.exists():
            Run(shared).nacre(line)
            mark.touch()
    run = Run(folder)
    if row.prepare:
        row.prepare(folder)
    for line in row.commands:
        run.nacre(line, quiet=True)
    return row.read(run)
