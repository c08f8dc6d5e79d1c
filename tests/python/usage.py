"""Typical use, with types that mypy checks: photographs in, orientations and their standard deviation out."""

import numpy as np

import nacre


def main() -> None:
    angles_deg = [0.0, 30.0, 60.0, 90.0, 120.0, 150.0]
    aolp = np.linspace(0.1, 3.0, 40)[None, :] * np.ones((20, 1))
    light = [0.4 + 0.25 * np.cos(2 * (np.deg2rad(a) - aolp)) for a in angles_deg]
    codes = (np.stack(light) * 65535).astype(np.uint16)
    result = nacre.polarization(nacre.Photographs(codes, analyser_deg=angles_deg), model="plain")
    error = np.abs(np.angle(np.exp(2j * (result["aolp"] - aolp)))) / 2
    assert error.max() < 1e-4, error.max()
    frames: int = len(result.report["frames"]) if "frames" in result.report else 0
    print(f"largest error {error.max():.1e} rad, {frames} photographs, channels {list(result)}")


if __name__ == "__main__":
    main()
