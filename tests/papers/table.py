"""Runs the rows and writes the table: one section per paper."""

import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import cvmp2017
import rows
import thesis2014
import tog2017
import tog2018

DOCUMENT = Path(__file__).resolve().parents[2] / "docs/validation/papers.md"
PAPERS = [tog2018, tog2017, cvmp2017, thesis2014]

HEAD = """# Four papers, row by row

Made by `tests/papers/run --update` with {version}: each row runs the commands that it names, on inputs that the script makes with the paper's
own parameters, and compares the result with a truth that does not come from Nacre: a closed form, the same equation in NumPy or SciPy, or the grating
equation. References marked “(Nacre's)” are Nacre's own full computation. `--out`, and scenes that the script writes, are left out of the commands; `tests/papers/*.py` has them in full.

| verdict | meaning |
|---|---|
| agrees | Nacre's number is right, and the paper's is the same |
| nearer to the truth | Nacre's number is right, and the paper's is farther from the truth |
| paper is off | Nacre's number is right; the paper's number or law is not |
| right | Nacre's number is right; the paper shows a picture only |
| **DIFFERS** | Nacre's number contradicts the truth |
| missing | this build lacks the feature |
| not done | nobody can do it from the paper: the reason stands in the column of Nacre's number |
| skipped | needs measured height fields (`NACRE_TEST_DATA`) |
"""


def shown(line):
    """A command for the table: without outputs, paths of the rows' folders and repeated flags."""
    line = re.sub(r" --(out|force)\b( \S+)?", "", line).replace("../once/", "").replace("|", "\\|").replace("DATA/", "$NACRE_TEST_DATA/")
    return line


def judged(row, work):
    """The cells of a row, and whether it failed."""
    commands = "<br>".join(f"`{shown(line)}`" for line in row.once + row.commands)
    cells = [row.where, row.what, commands]
    if row.missing:
        return [*cells, row.missing, "", row.paper, "missing"], False
    if row.why:
        return [*cells, row.why, "", row.paper, "not done"], False
    if row.data and not rows.DATA.is_dir():
        return [*cells, "", "", row.paper, "skipped"], False
    try:
        outcome = rows.run_row(row, work)
    except (rows.Failed, KeyError, TypeError, ValueError, OSError, IndexError) as error:
        return [*cells, f"{type(error).__name__}: {error}", "", row.paper, "**FAILED**"], True
    verdict = outcome.verdict if outcome.right else "**DIFFERS**"
    return [*cells, outcome.ours, outcome.truth, row.paper, verdict], not outcome.right


def main(arguments):
    words = [a for a in arguments if not a.startswith("--")]
    every = [(paper, row) for paper in PAPERS for row in paper.ROWS]
    names = [row.name for _, row in every]
    assert len(set(names)) == len(names), "two rows have one name"
    if "--list" in arguments:
        print("\n".join(names))
        return 0
    update = "--update" in arguments
    chosen = [(paper, row) for paper, row in every if not words or any(word in row.name for word in words)]
    keep = os.environ.get("PAPERS_KEEP")
    work = Path(tempfile.mkdtemp()) if keep is None else Path(keep).resolve()
    shutil.rmtree(work, ignore_errors=True)
    work.mkdir(parents=True)
    done, failed = {}, []
    for _, row in chosen:
        begun = time.monotonic()
        cells, bad = judged(row, work)
        if bad:
            failed.append(row.name)
        if not keep:
            shutil.rmtree(work / row.name, ignore_errors=True)
        done[row.name] = [cell.replace("\n", " ") for cell in cells]
        print(f"{time.monotonic() - begun:6.1f} s  {row.name:28} {cells[6]:20} {cells[3]} | {cells[4]} | {cells[5]}", flush=True)
    if not keep:
        shutil.rmtree(work)
    if update:
        DOCUMENT.write_text(document(done))
    for name in failed:
        print(f"failed: {name}")
    return 1 if failed else 0


def document(done):
    """The table; rows that were not run keep their line of the document, as long as it says the same of where and what."""
    old = [line.strip("| \n").split(" | ") for line in DOCUMENT.read_text().splitlines() if line.startswith("| ")] if DOCUMENT.exists() else []
    kept = {tuple(cells[:2]): cells for cells in old}
    version = subprocess.run([rows.NACRE, "--version"], capture_output=True, text=True).stdout.splitlines()
    version = " ".join(" ".join(version[:2]).split())
    lines = [HEAD.format(version=version)]
    for paper in PAPERS:
        table = [done.get(row.name) or kept.get((row.where, row.what)) or [row.where, row.what, "", "", "", row.paper, "not run"] for row in paper.ROWS]
        verdicts = [cells[-1].strip("*") for cells in table]
        tally = ", ".join(f"{verdicts.count(v)} {v}" for v in dict.fromkeys(verdicts))
        lines.append(f"## {paper.TITLE}\n\n{len(table)} rows: {tally}.\n")
        lines.append("| where | what | commands of `nacre` | Nacre | truth | paper | verdict |\n|---|---|---|---|---|---|---|")
        lines += ["| " + " | ".join(cells) + " |" for cells in table]
        lines.append("")
    return "\n".join(lines)


sys.exit(main(sys.argv[1:]))
