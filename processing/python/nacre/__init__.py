"""Orientation, period and diffraction of surfaces, with NumPy arrays.

Every operation of Nacre is a function of this module. Orientations are radians in [0, pi), anticlockwise from the right
of the image, and give the direction across the grooves. Arrays are (height, width), row 0 at the top, NaN where a map
has no value.

>>> import nacre, numpy as np
>>> turns = np.deg2rad([0, 45, 90, 135])
>>> light = np.array([0.5 + 0.2 * np.cos(2 * (turn - 0.3)) for turn in turns])
>>> frames = np.broadcast_to(light[:, None, None], (4, 32, 48)).astype(np.float32)
>>> result = nacre.polarization(nacre.Photographs(frames, analyser_deg=[0, 45, 90, 135]))
>>> bool(np.allclose(result["aolp"], 0.3, atol=1e-3))
True
"""

from . import reports
from ._client import Client, ServiceError
from ._native import InputError, OutputError, __version__
from ._operations import *  # noqa: F403
from ._operations import __all__ as _names
from ._photographs import Heights, Photographs
from ._running import Maps, Result, read_maps, read_photograph, write_maps
from ._session import Frame, Session, open

__all__ = [
    *_names,
    "Client",
    "Frame",
    "Heights",
    "InputError",
    "Maps",
    "OutputError",
    "Photographs",
    "Result",
    "ServiceError",
    "Session",
    "__version__",
    "open",
    "read_maps",
    "read_photograph",
    "reports",
    "write_maps",
]
