"""The table of kinds in docs/reference/image-formats.md: compared with the index of the files (matrix.py), or written with --update.

usage: table.py INDEX DOCUMENT [--update]
"""

import pathlib
import sys

BEGIN = "<!-- formats: written by tests/formats/run --update -->\n"
END = "<!-- /formats -->\n"


def result(expectation):
    word, _, rest = expectation.partition(" ")
    if word == "equal":
        return "equal"
    if word == "refused":
        return "refused"
    bound, _, inside = rest.partition(" ")
    return f"within {bound}" + (", but for the last row and column of cut blocks" if inside else "")


def table(index):
    rows = {}
    for line in index.read_text().splitlines():
        _, format, kind, expectation, _, _ = line.split("\t")
        files = rows.setdefault((format, kind), [])
        files.append(result(expectation))
    lines = ["| format | kind | files | values |", "|---|---|---|---|"]
    for (format, kind), results in rows.items():
        lines.append(f"| {format} | {kind} | {len(results)} | {'; '.join(sorted(set(results)))} |")
    return "\n".join(lines) + "\n"


index, document = map(pathlib.Path, sys.argv[1:3])
text = document.read_text()
before, rest = text.split(BEGIN)
old, after = rest.split(END)
new = table(index)
if sys.argv[3:] == ["--update"]:
    document.write_text(before + BEGIN + new + END + after)
elif old != new:
    known = set(old.splitlines())
    print("docs/reference/image-formats.md has another table of formats; accept it with tests/formats/run --update:")
    print("\n".join(line for line in new.splitlines() if line not in known))
    sys.exit(1)
