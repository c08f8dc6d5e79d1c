"""Arrays as input of operations: photographs and height fields."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from . import _native


class Photographs:
    """Photographs in arrays, as input of an operation.

    Parameters
    ----------
    frames
        Array (count, height, width) of uint16 codes, or of floating-point light from 0 to 1 (saturated).
    analyser_deg
        Analyser angles in degrees, for polarization.
    exposure_s
        Exposure times in s, one for all or one for each.
    description
        Further keys of `frames.json`: `black`, `white`, `noise`, `wavelength_nm`, `geometry`, `illumination`. Without
        `kind`, it is `polarization` with angles, otherwise `exposures`.
    """

    def __init__(
        self,
        frames: Any,
        *,
        analyser_deg: Sequence[float] | None = None,
        exposure_s: float | Sequence[float] | None = None,
        **description: Any,
    ):
        frames = np.asarray(frames)
        if frames.ndim != 3 or not len(frames):
            raise ValueError(f"frames have the shape {frames.shape}; give (count, height, width)")
        if frames.dtype != np.uint16 and not np.issubdtype(frames.dtype, np.floating):
            raise ValueError(f"frames are {frames.dtype}; give uint16 codes, or floats from 0 to 1")
        self._folder = tempfile.TemporaryDirectory(prefix="nacre-")
        #: Folder with `frames.json`, which lives as long as this object.
        self.path = Path(self._folder.name)
        per_frame: list[dict[str, float]] = [{} for _ in frames]
        given = {"analyser_deg": analyser_deg, "exposure_s": exposure_s}
        for key, values in given.items():
            if values is None:
                continue
            numbers = np.asarray(values, dtype=float)
            if numbers.ndim and numbers.shape != (len(frames),):
                raise ValueError(f"{key} has the shape {numbers.shape} for {len(frames)} photographs")
            for frame, number in zip(per_frame, np.broadcast_to(numbers, len(frames))):
                frame[key] = float(number)
        listed = [{"file": self._write(k, codes), **frame} for k, (codes, frame) in enumerate(zip(frames, per_frame))]
        kind = "exposures" if analyser_deg is None else "polarization"
        whole = {"version": 1, "kind": kind, "transfer": "linear", **description, "frames": listed}
        (self.path / "frames.json").write_text(json.dumps(whole, default=float))

    def _write(self, number: int, codes: Any) -> str:
        if codes.dtype == np.uint16:
            name = f"{number:04}.png"
            _native.write_photograph(self.path / name, np.ascontiguousarray(codes))
        else:
            name = f"{number:04}.exr"
            _native.write_maps(self.path / name, [("Y", np.ascontiguousarray(codes, dtype=np.float32))], [])
        return name


class Heights:
    """A height field in an array, as input of `brdf`.

    Parameters
    ----------
    heights
        Array (height, width) of heights in µm, NaN for gaps.
    pixel_um
        Pixel pitch in µm.
    """

    def __init__(self, heights: Any, pixel_um: float):
        heights = np.asarray(heights)
        if heights.ndim != 2:
            raise ValueError(f"heights have the shape {heights.shape}; give (height, width)")
        self._folder = tempfile.TemporaryDirectory(prefix="nacre-")
        #: EXR map, which lives as long as this object.
        self.path = Path(self._folder.name) / "heights.exr"
        plane = np.ascontiguousarray(heights, dtype=np.float32)
        _native.write_maps(self.path, [("height", plane)], [("pixel_um", str(pixel_um)), ("units", "µm")])
