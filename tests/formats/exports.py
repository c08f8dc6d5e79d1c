"""Files of `nacre export`, read by tifffile, NumPy, the OpenEXR library and bagit."""

import subprocess
import sys
from pathlib import Path

import bagit
import numpy as np
import OpenEXR
import tifffile

NACRE = sys.argv[1]


def nacre(*arguments):
    subprocess.run([NACRE, *map(str, arguments)], check=True, stdout=subprocess.DEVNULL)


def channels(path):
    return {name: channel.pixels for name, channel in OpenEXR.File(str(path), separate_channels=True).channels().items()}


nacre("sim", "render", "--sample", "cd", "--size", 96, "--out", "session")
nacre("reconstruct", "polarization", "session", "--out", "result")
truth = {f"{path.stem}.{name}": plane for path in Path("result").glob("*.exr") for name, plane in channels(path).items()}
for form in ("tiff", "npy", "csv", "exr"):
    nacre("export", "result", "--format", form, "--out", form)
for key, plane in truth.items():
    with tifffile.TiffFile(f"tiff/{key}.tif") as file:
        page = file.pages[0]
        np.testing.assert_array_equal(page.asarray(), plane)
        assert key.split(".", 1)[1] in page.description, page.description
        assert page.tags["ResolutionUnit"].value == 3
        per_cm, one = page.tags["XResolution"].value
        pitch_um = 1e4 * one / per_cm
    np.testing.assert_array_equal(np.load(f"npy/{key}.npy"), plane)
    table = np.genfromtxt(next(Path("csv").glob(f"{key}.csv")), delimiter=",", skip_header=1)
    np.testing.assert_array_equal(table[:, 2].reshape(plane.shape).astype(np.float32), np.where(np.isfinite(plane), plane, np.nan))
    stem, name = key.split(".", 1)
    np.testing.assert_array_equal(channels(f"exr/{stem}.exr")[name], plane)
header = OpenEXR.File("exr/orientation.exr").header()
assert header["compression"] == OpenEXR.ZIP_COMPRESSION and abs(header["pixel_um"] - pitch_um) < 1e-3, (header, pitch_um)
assert (Path("exr/stokes.exr")).stat().st_size < 0.9 * Path("result/stokes.exr").stat().st_size

nacre("export", "session", "--out", "bag")
bag = bagit.Bag("bag")
bag.validate()
assert {p.relative_to("session") for p in Path("session").rglob("*") if p.is_file()} == {Path(name).relative_to("data") for name in bag.payload_files()}
Path("bag/data/session.json").write_text("changed")
assert not bagit.Bag("bag").is_valid()
print(f"exports: {len(truth)} channels in four formats, a bag of {len(list(bag.payload_files()))} files, pixel pitch {pitch_um:.3f} um")
