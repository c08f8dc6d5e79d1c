"""Results of operations, and maps as arrays."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, Optional, TypeVar, Union

import numpy as np
from numpy.typing import NDArray

from . import _native

if TYPE_CHECKING:
    from ._photographs import Heights, Photographs
    from ._session import Session

Input = Union[str, "os.PathLike[str]", "Photographs", "Heights", "Session", "Result[Any]", None]
Out = Union[str, "os.PathLike[str]", None]
Progress = Optional[Callable[[str, int, int], Any]]
Report = TypeVar("Report")


class Maps(Mapping[str, NDArray[np.float32]]):
    """Channels of an EXR map by name: float32 arrays (height, width), NaN where masked.

    `attributes` has the attributes of the file as text: `units`, `pixel_um`, `wavelength_nm`.
    """

    def __init__(self, channels: Mapping[str, NDArray[np.float32]], attributes: Mapping[str, str]):
        self._channels = dict(channels)
        self.attributes = dict(attributes)

    def __getitem__(self, name: str) -> NDArray[np.float32]:
        return self._channels[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._channels)

    def __len__(self) -> int:
        return len(self._channels)

    def to_xarray(self) -> Any:
        """The channels as an `xarray.Dataset` with dimensions y (downward) and x, in µm if the pixel pitch is known."""
        return _dataset(self._channels, self.attributes)


class Result(Mapping[str, NDArray[np.float32]], Generic[Report]):
    """Result of an operation: its report, and the channels of its maps by name.

    Channels are read when they are asked for. A name that several maps have is that of the map of the same name, or
    needs its file: `result["period/sigma"]`.
    """

    def __init__(self, path: str | os.PathLike[str], done: dict[str, Any] | None = None, keep: Any = None):
        #: Folder of the files.
        self.path = Path(path)
        self._keep = keep
        self._maps: dict[str, Maps] = {}
        done = done or {"report": json.loads((self.path / "report.json").read_text())}
        #: Report, as in `report.json`.
        self.report: Report = done["report"]
        #: Text summary of the report.
        self.summary: str = done.get("summary", "")
        #: Limitations of the result.
        self.warnings: list[str] = done.get("warnings", done["report"].get("warnings", []))
        #: Reason why the result exceeds the requested error; None if it meets the request.
        self.missed: str | None = done.get("missed")

    @property
    def files(self) -> list[str]:
        """Names of the files."""
        return sorted(p.relative_to(self.path).as_posix() for p in self.path.rglob("*") if p.is_file())

    def maps(self, name: str) -> Maps:
        """All channels of one map, such as `orientation` for orientation.exr."""
        if name not in self._maps:
            self._maps[name] = read_maps(self.path / f"{name}.exr")
        return self._maps[name]

    @property
    def sigma(self) -> NDArray[np.float32]:
        """Standard deviation of the orientation in radians."""
        return self["orientation/sigma"]

    @property
    def mask(self) -> NDArray[np.bool_]:
        """True where the orientation is known."""
        return np.isfinite(self["orientation"])

    def _named(self) -> dict[str, str]:
        """File and channel by name of the channel."""
        names: dict[str, list[str]] = {}
        for path in sorted(self.path.glob("*.exr")):
            for channel in self.maps(path.stem):
                names.setdefault(channel, []).append(f"{path.stem}/{channel}")
        return {name: places[0] for name, places in names.items() if len(places) == 1 or f"{name}/{name}" == places[0]}

    def __getitem__(self, name: str) -> NDArray[np.float32]:
        stem, _, channel = name.rpartition("/")
        if stem:
            return self.maps(stem)[channel]
        if (self.path / f"{name}.exr").exists() and name in self.maps(name):
            return self.maps(name)[name]
        return self[self._named()[name]]

    def __iter__(self) -> Iterator[str]:
        return iter(self._named())

    def __len__(self) -> int:
        return len(self._named())

    def to_xarray(self) -> Any:
        """All channels as an `xarray.Dataset`, as `Maps.to_xarray`."""
        attributes = next((self.maps(p.stem).attributes for p in sorted(self.path.glob("*.exr"))), {})
        return _dataset(dict(self), attributes)

    def _repr_html_(self) -> str:
        """Pictures of the maps, in notebooks."""
        from base64 import b64encode

        pictures = sorted(self.path.glob("*.png"))[:6]
        shown = (f'<img style="max-width:320px" title="{p.stem}" src="data:image/png;base64,{b64encode(p.read_bytes()).decode()}">' for p in pictures)
        return f"<pre>{self.summary}</pre>" + "".join(shown)

    def __repr__(self) -> str:
        return f"Result({str(self.path)!r}: {', '.join(self)})"


def _dataset(channels: Mapping[str, NDArray[np.float32]], attributes: Mapping[str, str]) -> Any:
    import xarray

    pitch = float(attributes["pixel_um"]) if "pixel_um" in attributes else None
    height, width = next(iter(channels.values())).shape
    coordinates = {name: np.arange(size) * (pitch or 1.0) for name, size in (("y", height), ("x", width))}
    data = xarray.Dataset({name: (("y", "x"), values) for name, values in channels.items()}, coordinates, dict(attributes))
    for name in coordinates:
        data[name].attrs["units"] = "µm" if pitch else "px"
    return data


def run(name: str, input: Input, out: Out, overwrite: bool, progress: Progress, options: dict[str, Any]) -> Result[Any]:
    """Runs an operation by name. `options` that are None take the default of the operation."""
    given = {key: value for key, value in options.items() if value is not None}
    keep = None
    if out is None:
        keep = tempfile.TemporaryDirectory(prefix="nacre-")
        out = os.path.join(keep.name, name)
    folder: Any = getattr(input, "path", input)
    if name == "render" and folder is not None and Path(folder).suffix == ".toml":
        # The operation takes the folder of the scene and of its files.
        given.setdefault("scene", Path(folder).read_text())
        folder = Path(folder).parent
    text = json.dumps(given, default=_plain)
    done = _native.run(name, "" if folder is None else folder, out, text, overwrite, progress)
    return Result(out, json.loads(done), keep)


def _plain(value: Any) -> Any:
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    raise TypeError(f"{value!r} is no option; give a number, a text, a list or a dictionary")


def read_maps(path: str | os.PathLike[str]) -> Maps:
    """Reads all channels of an EXR map."""
    return Maps(*_native.read_maps(path))


def write_maps(path: str | os.PathLike[str], attributes: Mapping[str, Any] | None = None, **channels: Any) -> None:
    """Writes arrays (height, width) as the channels of an EXR map: `write_maps("period.exr", period=array)`."""
    arrays = [(name, np.ascontiguousarray(values, dtype=np.float32)) for name, values in channels.items()]
    _native.write_maps(path, arrays, [(key, str(value)) for key, value in (attributes or {}).items()])


def read_photograph(path: str | os.PathLike[str]) -> NDArray[Any]:
    """Reads a photograph as an array (height, width) or (height, width, 3) of uint8, uint16 or float32."""
    return _native.read_photograph(path)
