"""Sessions and other described photographs, frame by frame."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from . import _native
from ._running import Result


@dataclass(frozen=True)
class Frame:
    """A photograph of a session; its pixels are read by `array`."""

    path: Path
    description: dict[str, Any] = field(repr=False)

    @property
    def analyser_deg(self) -> float | None:
        """Analyser angle in degrees."""
        return self.description.get("analyser_deg")

    @property
    def exposure_s(self) -> float | None:
        """Exposure time in s."""
        return self.description.get("exposure_s")

    def array(self) -> Any:
        """Codes of the file, (height, width) or (height, width, 3)."""
        return _native.read_photograph(self.path)


class Session(Sequence[Frame]):
    """A session folder, or any folder with `frames.json`: a sequence of frames, read when they are asked for."""

    def __init__(self, path: str | os.PathLike[str]):
        path = Path(path)
        #: Folder of the session.
        self.path = path.parent if path.name == "frames.json" else path
        #: `frames.json`: black, white, noise, wavelength, geometry.
        self.description: dict[str, Any] = json.loads((self.path / "frames.json").read_text())
        self._frames = [Frame(self.path / f["file"], f) for f in self.description["frames"]]

    def __getitem__(self, index: Any) -> Any:
        return self._frames[index]

    def __len__(self) -> int:
        return len(self._frames)

    def __iter__(self) -> Iterator[Frame]:
        return iter(self._frames)

    def __repr__(self) -> str:
        return f"Session({str(self.path)!r}: {len(self)} photographs)"

    @property
    def results(self) -> Result[Any] | None:
        """Results that were computed with the session; None without them."""
        folder = self.path / "results"
        return Result(folder) if (folder / "report.json").exists() else None

    def to_xarray(self) -> Any:
        """All frames as an `xarray.DataArray` (frame, y, x; of colour cameras also channel).

        Analyser angle and exposure are coordinates.
        """
        import numpy as np
        import xarray

        keys = [k for k in ("analyser_deg", "exposure_s") if all(k in f.description for f in self)]
        coordinates = {key: ("frame", [f.description[key] for f in self]) for key in keys}
        values = np.stack([f.array() for f in self])
        dimensions = ("frame", "y", "x", "channel")[: values.ndim]
        return xarray.DataArray(values, coordinates, dimensions, self.path.name)


def open(path: str | os.PathLike[str]) -> Session | Result[Any]:
    """Opens a session, described photographs, or a folder with results."""
    path = Path(path)
    if path.name == "frames.json" or (path / "frames.json").exists():
        return Session(path)
    if (path / "report.json").exists():
        return Result(path)
    raise _native.InputError(f"{path}: has neither frames.json nor report.json; give a session or a result")
