from collections.abc import Callable
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

__version__: str

class InputError(ValueError): ...
class OutputError(OSError): ...

def operations() -> list[str]: ...
def run(
    name: str,
    input: str | PathLike[str],
    out: str | PathLike[str],
    options: str,
    overwrite: bool,
    progress: Callable[[str, int, int], Any] | None = None,
) -> str: ...
def read_maps(path: str | PathLike[str]) -> tuple[dict[str, NDArray[np.float32]], dict[str, str]]: ...
def write_maps(
    path: str | PathLike[str], channels: list[tuple[str, NDArray[np.float32]]], attributes: list[tuple[str, str]]
) -> None: ...
def read_photograph(path: str | PathLike[str]) -> NDArray[Any]: ...
def write_photograph(path: str | PathLike[str], codes: NDArray[np.uint16]) -> None: ...
