"""Diffracting materials for Mitsuba 3: `nacre_grating` and `nacre_table`.

>>> import mitsuba as mi                                        # doctest: +SKIP
>>> mi.set_variant("llvm_ad_spectral")                          # doctest: +SKIP
>>> import nacre.mitsuba                                        # doctest: +SKIP
>>> nacre.mitsuba.register()                                    # doctest: +SKIP
>>> grating = mi.load_dict({"type": "nacre_grating", "period_um": 1.5, "depth_um": 0.15})   # doctest: +SKIP
"""

from __future__ import annotations

__all__ = ["register"]


def register() -> None:
    """Registers the materials for Mitsuba's present variant; call it again after `mi.set_variant`.

    Raises `RuntimeError` for variants that are neither RGB nor spectral, and for polarized ones.
    """
    import mitsuba as mi

    variant = mi.variant()
    if variant is None or not variant.endswith(("_rgb", "_spectral")):
        raise RuntimeError(f"Mitsuba's variant is {variant}: set one of RGB or spectra, such as llvm_ad_spectral")
    if variant in _registered:
        return
    from . import _grating, _table

    mi.register_bsdf("nacre_grating", _grating.material())
    mi.register_bsdf("nacre_table", _table.material())
    _registered.add(variant)


_registered: set[str] = set()
