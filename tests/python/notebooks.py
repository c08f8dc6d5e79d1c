"""Runs the notebooks of the documentation, each in an empty folder."""

import sys
import tempfile
from pathlib import Path

import nbformat
from nbclient import NotebookClient

for path in map(Path, sys.argv[1:]):
    with tempfile.TemporaryDirectory() as place:
        NotebookClient(nbformat.read(path, 4), timeout=None, resources={"metadata": {"path": place}}).execute()
    print(f"notebook {path.stem} ... ok")
