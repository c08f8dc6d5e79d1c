"""Compares `nacre brdf heights` with SurfaceTopography: pixels, pitch, and every height up to one offset."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import OpenEXR
from SurfaceTopography import Topography, open_topography
from SurfaceTopography.Support.UnitConversion import get_unit_conversion_factor

import write

# Formats whose first row is the lowest, which SurfaceTopography leaves on top.
UPWARDS = {"sdf", "x3p", "xyz"}


def nacre_reads(nacre, path, flags):
    """Heights in µm (row 0 on top), pitch in µm and notes; or the message of a refusal."""
    out = Path("read.exr").absolute()
    command = [nacre, "--json", "brdf", "heights", path, "--out", out, "--force", *flags]
    run = subprocess.run(command, capture_output=True, text=True)
    if run.returncode == 2:
        return None, run.stderr.strip().removeprefix(f"nacre: {path}: ")
    if run.returncode:
        sys.exit(f"{path}: exit code {run.returncode}: {run.stderr}")
    quality = json.loads(run.stdout)["quality"]
    pixels = OpenEXR.File(str(out)).channels()["height"].pixels
    return (np.asarray(pixels, float), quality["pixel_um"], quality.get("notes", [])), None


def channels(path):
    """Name, heights in µm (row 0 as it stands in the file's picture) and pitch of every channel; None where it cannot tell."""
    reader = open_topography(str(path))
    for index, channel in enumerate(reader.channels):
        try:
            topography = reader.topography(channel_index=index)
            unit = topography.unit if isinstance(topography.unit, str) else None
            factor = get_unit_conversion_factor(unit, "µm") if unit else 1.0
            heights = np.ma.filled(topography.heights(), np.nan)
        except Exception:
            continue
        if factor and heights.ndim == 2 and not np.isnan(heights).any():
            image = heights.T * factor
            pitch = topography.physical_sizes[0] * factor / image.shape[1]
            upwards = reader.format() in UPWARDS if callable(getattr(reader, "format", None)) else False
            yield channel.name, image[::-1] if upwards else image, pitch


def difference(one, other):
    """Largest difference up to an offset, over the range, apart from the rounding of single precision."""
    (a, pitch_a), (b, pitch_b) = one, other
    if a.shape != b.shape:
        return f"{a.shape} against {b.shape} pixels"
    off = np.abs((a - a.mean()) - (b - b.mean())).max()
    if off > 2e-6 * np.abs(a).max() + 1e-6 * np.ptp(b):
        return f"heights differ by {off:.3g} µm of {np.ptp(b):.3g}"
    if abs(pitch_a / pitch_b - 1) > 1e-6:
        return f"pitch {pitch_a} against {pitch_b} µm"
    return None


def compare(nacre, path, flags=()):
    """One line of the table, and whether the file was read alike, refused, or differently."""
    read, refusal = nacre_reads(nacre, path, flags)
    if read is None:
        return f"refused   {path.name}: {refusal}", "refused"
    try:
        known = list(channels(path))
    except Exception:
        known = []
    if not known:
        return f"alone     {path.name}: SurfaceTopography reads no heights there", "alone"
    image, pitch, notes = read
    wrong = [difference((image, pitch), (heights, own)) for _, heights, own in known]
    if None in wrong:
        return f"equal     {path.name}: {known[wrong.index(None)][0]}; {'; '.join(notes)}", "equal"
    return f"DIFFERENT {path.name}: {'; '.join(wrong)}; {notes}", "different"


def written():
    """Files to compare, with flags for the scale that a format does not state."""
    for name, data, flags in write.files():
        path = Path(name)
        path.write_bytes(data)
        yield path, flags
    for seed, (width, rows, pitch) in enumerate([(40, 40, 0.2), (52, 33, 0.05)]):
        nm = write.patch(width, rows, seed + 7)
        topography = Topography(nm.T * 1e-9, (width * pitch * 1e-6, rows * pitch * 1e-6), unit="m")
        for name, save in [(f"saved-{seed}.gwy", topography.to_gwy), (f"saved-{seed}.x3p", topography.to_x3p)]:
            save(name)
            yield Path(name), []


def main(nacre, folder=None):
    counts = {"equal": 0, "refused": 0, "alone": 0, "different": 0}
    failed = []
    for path, flags in written():
        line, outcome = compare(nacre, path, flags)
        counts[outcome] += 1
        if outcome != "equal":
            failed.append(line)
    for path in sorted(Path(folder).iterdir()) if folder else []:
        line, outcome = compare(nacre, path)
        counts[outcome] += 1
        print(line)
        if outcome == "different":
            failed.append(line)
    print(", ".join(f"{count} {name}" for name, count in counts.items()))
    if failed:
        sys.exit("\n".join(failed))


main(*sys.argv[1:])
