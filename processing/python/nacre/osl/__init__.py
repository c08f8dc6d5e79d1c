"""The Open Shading Language shader of gratings, and a sample in Blender that it covers.

>>> import nacre.osl
>>> nacre.osl.shader().name
'grating.osl'
"""

from __future__ import annotations

from pathlib import Path

__all__ = ["shader"]


def shader() -> Path:
    """File of the shader `nacre_grating`."""
    return Path(__file__).with_name("grating.osl")
