"""Files of `nacre export`, read by tifffile, NumPy, the OpenEXR library, bagit, zarr, event-model and Pillow."""

import io
import json
import os
import struct
import subprocess
import sys
import tempfile
from contextlib import chdir
from pathlib import Path
from xml.etree import ElementTree

import bagit
import numpy as np
import OpenEXR
import tifffile
import zarr
from event_model import DocumentNames, schema_validators
from PIL import Image


def nacre(*arguments, code=0):
    done = subprocess.run([NACRE, *map(str, arguments)], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    assert done.returncode == code, done.stderr
    return done.stderr


def channels(path):
    return {name: channel.pixels for name, channel in OpenEXR.File(str(path), separate_channels=True).channels().items()}


def planes(folder):
    return {f"{path.stem}.{name}": plane for path in Path(folder).glob("*.exr") for name, plane in channels(path).items()}


def tables():
    """TIFF, NPY, CSV and compressed EXR; returns the pixel pitch in um."""
    for form in ("tiff", "npy", "csv", "exr"):
        nacre("export", "result", "--format", form, "--out", form)
    for key, plane in planes("result").items():
        with tifffile.TiffFile(f"tiff/{key}.tif") as file:
            page = file.pages[0]
            np.testing.assert_array_equal(page.asarray(), plane)
            assert key.split(".", 1)[1] in page.description, page.description
            assert page.tags["ResolutionUnit"].value == 3
            per_cm, one = page.tags["XResolution"].value
            pitch_um = 1e4 * one / per_cm
        np.testing.assert_array_equal(np.load(f"npy/{key}.npy"), plane)
        table = np.genfromtxt(f"csv/{key}.csv", delimiter=",", skip_header=1)
        np.testing.assert_array_equal(table[:, 2].reshape(plane.shape).astype(np.float32), np.where(np.isfinite(plane), plane, np.nan))
        stem, name = key.split(".", 1)
        np.testing.assert_array_equal(channels(f"exr/{stem}.exr")[name], plane)
    header = OpenEXR.File("exr/orientation.exr").header()
    assert header["compression"] == OpenEXR.ZIP_COMPRESSION and abs(header["pixel_um"] - pitch_um) < 1e-3, (header, pitch_um)
    size = lambda folder: sum(path.stat().st_size for path in Path(folder).glob("*.exr"))
    assert size("exr") < 0.9 * size("result"), (size("exr"), size("result"))
    return pitch_um


def bag():
    nacre("export", "session", "--out", "bag")
    bag = bagit.Bag("bag")
    bag.validate()
    inside = {Path(name).relative_to("data") for name in bag.payload_files()}
    assert inside == {path.relative_to("session") for path in Path("session").rglob("*") if path.is_file()}
    Path("bag/data/session.json").write_text("changed")
    assert not bagit.Bag("bag").is_valid()
    return len(inside)


def bluesky():
    nacre("export", "session", "--format", "bluesky", "--out", "run")
    documents = [json.loads(line) for line in Path("run/documents.jsonl").read_text().splitlines()]
    for document in documents:
        schema_validators[DocumentNames[document["name"]]].validate(document["doc"])
    resource = next(document["doc"] for document in documents if document["name"] == "stream_resource")
    assert resource["uri"] == (Path.cwd() / "run/primary").as_uri().replace("file://", "file://localhost") + "/", resource
    frames = json.loads(Path("session/frames.json").read_text())["frames"]
    for k, frame in enumerate(frames):
        copy = tifffile.imread("run/primary/" + resource["parameters"]["template"].format(k))
        np.testing.assert_array_equal(copy, np.array(Image.open(Path("session") / frame["file"])))
    nacre("export", "session", "--format", "bluesky", "--out", "again")
    first, second = (Path(run, "documents.jsonl").read_text() for run in ("run", "again"))
    assert first.replace("/run/", "/again/") == second, "two exports of a session differ"
    return len(documents)


def groups(pitch_um):
    """Zarr: all maps, the frames, and a map of several chunks."""
    nacre("export", "result", "--format", "zarr", "--out", "result.zarr")
    nacre("map", "edit", "result", "--resample", 6, "--out", "large")
    nacre("export", "large", "--format", "zarr", "--out", "large.zarr", "--channel", "orientation")
    for folder, kept in (("result", lambda name: True), ("large", lambda name: name == "orientation")):
        group = zarr.open_group(f"{folder}.zarr", mode="r")
        for key, plane in planes(folder).items():
            stem, name = key.split(".", 1)
            if kept(name):
                np.testing.assert_array_equal(group[stem][name][:], plane)
    assert group["orientation"]["orientation"].cdata_shape == (2, 2) and "sigma" not in group["orientation"]
    array = zarr.open_group("result.zarr", mode="r")["orientation"]["orientation"]
    assert array.metadata.dimension_names == ("y", "x") and array.attrs["units"] == "rad", array.metadata
    x, y = (zarr.open_group("result.zarr", mode="r")["orientation"][axis] for axis in "xy")
    assert x.attrs["units"] == "um" and np.allclose(np.diff(x[:]), pitch_um, rtol=1e-6) and np.allclose(np.diff(y[:]), -pitch_um, rtol=1e-6)
    nacre("export", "session", "--format", "zarr", "--out", "session.zarr")
    frames = zarr.open_group("session.zarr", mode="r")["frames"]
    described = json.loads(Path("session/frames.json").read_text())
    assert dict(frames.attrs) == described, frames.attrs
    for k, frame in enumerate(described["frames"]):
        np.testing.assert_array_equal(frames["values"][k], np.array(Image.open(Path("session") / frame["file"])))
        assert frames["analyser_deg"][k] == frame["analyser_deg"]


def materials():
    """Textures of the materials against the maps; returns the largest angle between them in degrees."""
    maps = {"result": channels("result/orientation.exr"), "session/truth.exr": channels("session/truth.exr")}
    largest = 0.0
    for name, found in maps.items():
        out = Path(name).stem
        for form in ("gltf", "materialx", "usd"):
            nacre("export", name, "--format", form, "--material", "gold", "--out", f"{out}.{form}")
        data = Path(f"{out}.gltf/surface.glb").read_bytes()
        length = struct.unpack_from("<I", data, 12)[0]
        document = json.loads(data[20 : 20 + length])
        image = document["bufferViews"][document["images"][0]["bufferView"]]
        texture = np.array(Image.open(io.BytesIO(data[28 + length + image["byteOffset"] :][: image["byteLength"]])))
        measured = np.isfinite(found["orientation"])
        red, green, blue = (texture[measured][:, k].astype(float) for k in range(3))
        apart = np.degrees(np.arctan2(green / 127.5 - 1, red / 127.5 - 1) - found["orientation"][measured])
        largest = max(largest, np.abs((apart + 90) % 180 - 90).max())
        assert (texture[~measured][:, 2] == 0).all() and (blue > 0).all()
        period = found.get("period", np.full_like(found["orientation"], 1.6))[measured]
        across = np.tan(np.arcsin(np.minimum(0.55 / period, 1)) / 2)
        weight = np.exp(-2 * found["sigma"][measured] ** 2) if "sigma" in found else 1
        assert np.abs(blue / 255 - weight * np.sqrt((across - 0.01) / 0.99)).max() < 0.002
        lost = Path(f"{out}.gltf/lost.txt").read_text()
        assert document["asset"]["extras"]["lost"] == lost.splitlines() and "aluminium" not in lost and "Colours" in lost
        for form, file in (("materialx", "surface.mtlx"), ("usd", "surface.usda")):
            assert np.array_equal(np.array(Image.open(f"{out}.{form}/anisotropy.png")), texture)
            assert all(line in Path(f"{out}.{form}", file).read_text() for line in lost.splitlines())
        ElementTree.parse(f"{out}.materialx/surface.mtlx")
    return largest


def refusals():
    """Options and inputs that do not fit a format are named, and nothing is written."""
    expected = [
        (["result", "--format", "gltf", "--channel", "sigma"], "--channel"),
        (["result", "--format", "tiff", "--material", "gold"], "--material"),
        (["result", "--format", "bluesky"], "is not a session"),
        (["result/stokes.exr", "--format", "usd"], "has no orientation"),
        (["result", "--format", "zarr", "--channel", "nothing"], "--channel"),
    ]
    for arguments, words in expected:
        message = nacre("export", *arguments, "--out", "refused", code=2)
        assert words in message and not Path("refused").exists(), message
    assert "--force" in nacre("export", "result", "--format", "zarr", "--out", "result.zarr", code=2)


if __name__ == "__main__":
    NACRE = os.path.abspath(sys.argv[1])
    with tempfile.TemporaryDirectory() as place, chdir(place):
        nacre("sim", "render", "--sample", "cd", "--size", 96, "--out", "session")
        nacre("reconstruct", "polarization", "session", "--out", "result")
        pitch_um = tables()
        files, documents = bag(), bluesky()
        groups(pitch_um)
        apart = materials()
        refusals()
        count = len(planes("result"))
    print(f"exports: {count} channels in five formats, a bag of {files} files, {documents} documents, directions of materials within {apart:.2f}°")
