"""Files of `nacre export` as other programs read them: Tiled, xarray, the glTF validator, MaterialX and USD.

usage: python tests/elsewhere/files.py NACRE_BINARY

Packages: files-requirements.txt (PyPI), and gltf-validator 2.0.0-dev.3.10 (npm), in the folder of NODE_PATH; without it its
check is skipped. Prints `name | measured | bound` for each agreement, and exits with 1 if one fails.
"""

import contextlib
import io
import json
import os
import re
import struct
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path

import MaterialX as mx
import MaterialX.PyMaterialXGenGlsl as glsl
import MaterialX.PyMaterialXGenOsl as osl
import MaterialX.PyMaterialXGenShader as shaders
import numpy as np
import OpenEXR
import xarray
from PIL import Image
from pxr import Usd, UsdGeom, UsdShade, UsdValidation

failed = []


def agree(name, measured, bound, good=None):
    """One line per agreement: an error up to its bound, or a value that equals another one."""
    good = (measured <= bound if isinstance(bound, float) else measured == bound) if good is None else good
    print(f"{name} | {measured:.3g}" if isinstance(measured, float) else f"{name} | {measured}", "|", bound, "" if good else "| FAILED")
    if not good:
        failed.append(name)


def nacre(*arguments):
    subprocess.run([NACRE, *map(str, arguments)], check=True, stdout=subprocess.DEVNULL)


def channel(path, name):
    return OpenEXR.File(str(path), separate_channels=True).channels()[name].pixels


def tiled():
    """Loads the documents into a Tiled catalog, and reads frames and columns back."""
    from bluesky_tiled_plugins import TiledWriter
    from event_model import DocumentNames, schema_validators
    from tiled.client import from_uri
    from tiled.server.simple import SimpleTiledServer

    nacre("export", "session", "--format", "bluesky", "--out", "run")
    lines = [json.loads(line) for line in Path("run/documents.jsonl").read_text().splitlines()]
    for line in lines:
        schema_validators[DocumentNames[line["name"]]].validate(line["doc"])
    agree("event-model documents valid", len(lines), 4 + 13 + 3 + 1)
    frames = json.loads(Path("session/frames.json").read_text())["frames"]
    pixels = np.stack([np.array(Image.open(Path("session") / frame["file"])) for frame in frames])
    Path("catalog").mkdir()
    with SimpleTiledServer(directory="catalog", readable_storage=[str(Path("run").absolute())]) as server:
        client = from_uri(server.uri)
        writer = TiledWriter(client)
        for line in lines:
            writer(line["name"], line["doc"])
        run = client[lines[0]["doc"]["uid"]]
        camera = run["primary"]["camera"].read()
        agree("Tiled: frames that differ", int((camera != pixels).any(axis=(1, 2)).sum()), 0)
        table = run["primary"].read()
        difference = np.abs(np.asarray(table["analyser_planned_deg"]) - [frame["analyser_deg"] for frame in frames]).max()
        agree("Tiled: analyser angles, °", float(difference), 1e-9)
        agree("Tiled: streams", sorted(run), ["dark", "primary"])
        agree("Tiled: exit status", run.metadata["stop"]["exit_status"], "success")


def zarr():
    """Compares groups with the EXR maps and the photographs, and coordinates with the pitch."""
    nacre("export", "session", "--format", "zarr", "--out", "session.zarr")
    nacre("export", "result", "--format", "zarr", "--out", "result.zarr")
    maps = xarray.open_datatree("result.zarr", engine="zarr", consolidated=False)
    for name in ("orientation", "stokes"):
        for key, values in maps[name].data_vars.items():
            np.testing.assert_array_equal(values, channel(f"result/{name}.exr", key))
    orientation = maps["orientation"]["orientation"]
    agree("xarray: dimensions", orientation.dims, ("y", "x"))
    agree("xarray: units", (orientation.attrs["units"], maps["orientation"]["x"].attrs["units"]), ("rad", "um"))
    pitch = float(OpenEXR.File("result/orientation.exr").header()["pixel_um"][0])
    x, y = (maps["orientation"][axis].values for axis in "xy")
    agree("xarray: pixel pitch, um", float(max(abs(np.diff(x) - pitch).max(), abs(np.diff(y) + pitch).max())), 1e-6)
    frames = xarray.open_zarr("session.zarr", group="frames", consolidated=False)
    listed = json.loads(Path("session/frames.json").read_text())["frames"]
    agree("xarray: dimensions of frames", frames["values"].dims, ("frame", "y", "x"))
    photographs = np.stack([np.array(Image.open(Path("session") / frame["file"])) for frame in listed])
    different = int((frames["values"].values != photographs).any(axis=(1, 2)).sum())
    agree("xarray: frames that differ", different, 0)
    difference = np.abs(frames["values"].coords["analyser_deg"].values - [frame["analyser_deg"] for frame in listed]).max()
    agree("xarray: analyser angles, °", float(difference), 1e-9)


def angles(texture, orientation):
    """Largest angle between the texture's directions and the map's, in degrees."""
    red, green = (texture[..., k].astype(float) / 127.5 - 1 for k in (0, 1))
    apart = np.degrees(np.arctan2(green, red) - orientation)[texture[..., 2] > 0]
    return float(np.abs((apart + 90) % 180 - 90).max())


def glb(path):
    data = Path(path).read_bytes()
    length = struct.unpack_from("<I", data, 12)[0]
    document, binary = json.loads(data[20 : 20 + length]), data[28 + length :]
    view = lambda k: binary[document["bufferViews"][k]["byteOffset"] :][: document["bufferViews"][k]["byteLength"]]
    return document, view


def gltf():
    """Compares the texture with the maps; size and orientation of the quad; the validator of Khronos."""
    nacre("export", "result", "--format", "gltf", "--out", "gltf")
    document, view = glb("gltf/surface.glb")
    texture = np.array(Image.open(io.BytesIO(view(5))))
    orientation = channel("result/orientation.exr", "orientation")
    agree("glTF: directions, °", angles(texture, orientation), 0.32)
    masked = ~(channel("result/orientation.exr", "mask") > 0)
    agree("glTF: strength where masked", int(texture[masked][:, 2].max()), 0)
    # Strength by its definition: α across the grooves is the slope of a facet towards the first order.
    alpha = np.tan(np.arcsin(0.55 / 1.6) / 2)
    strength = np.sqrt((alpha - 0.01) / 0.99) * np.exp(-2 * channel("result/orientation.exr", "sigma") ** 2)
    agree("glTF: strength", float(np.abs(texture[..., 2] / 255 - strength)[~masked].max()), 0.002)
    corners = np.frombuffer(view(0), "<f4").reshape(4, 3)
    size = float(OpenEXR.File("result/orientation.exr").header()["pixel_um"][0]) * 1e-6 * np.array(orientation.shape[::-1])
    agree("glTF: size of the quad, m", float(np.abs(np.ptp(corners, axis=0)[:2] - size).max()), 1e-6)
    normal, tangent = np.frombuffer(view(1), "<f4")[:3], np.frombuffer(view(2), "<f4")[:4]
    uv = np.frombuffer(view(3), "<f4").reshape(4, 2)
    # The texture's v runs downwards, as the rows of the map; the bitangent points up, as the orientation's sine.
    up = np.cross(normal, tangent[:3]) * tangent[3]
    agree("glTF: bitangent", [float(v) for v in up], [0.0, 1.0, 0.0])
    agree("glTF: map's first row on top", float(uv[np.argmax(corners[:, 1]), 1]), 0.0)
    stated = document["asset"]["extras"]["lost"]
    agree("glTF: losses stated", len(stated), 9, stated == Path("gltf/lost.txt").read_text().splitlines())
    script = ("require('gltf-validator').validateBytes(new Uint8Array(require('fs').readFileSync('gltf/surface.glb')))"
              ".then(report => console.log(JSON.stringify(report)))")
    done = subprocess.run(["node", "-e", script], capture_output=True, text=True)
    if "Cannot find module" in done.stderr:
        print("glTF validator: skipped, no npm package gltf-validator")
        return
    issues = json.loads(done.stdout)["issues"]
    agree("glTF validator: errors, warnings", (issues["numErrors"], issues["numWarnings"]), (0, 0))


def materialx():
    """Validates the document, and generates GLSL and OSL from it."""
    nacre("export", "result", "--format", "materialx", "--out", "materialx")
    library = mx.createDocument()
    search = mx.getDefaultDataSearchPath()
    mx.loadLibraries(mx.getDefaultDataLibraryFolders(), search, library)
    document = mx.createDocument()
    mx.readFromXmlFile(document, "materialx/surface.mtlx")
    document.setDataLibrary(library)
    valid, message = document.validate()
    agree("MaterialX: valid", (valid, message), (True, ""))
    unknown = [node.getName() for graph in document.getNodeGraphs() for node in graph.getNodes() if node.getNodeDef() is None]
    agree("MaterialX: nodes without a definition", unknown, [])
    for name, generator in (("GLSL", glsl.GlslShaderGenerator.create()), ("OSL", osl.OslShaderGenerator.create())):
        context = shaders.GenContext(generator)
        context.registerSourceCodeSearchPath(search)
        shader = generator.generate("grating", document.getNode("grating_surface"), context)
        code = shader.getSourceCode(shaders.PIXEL_STAGE)
        agree(f"MaterialX: {name} with texture", "anisotropy.png" in code or "texture_file" in code, True)
    # Slopes of the graph and OpenPBR's formula against those of glTF, for all strengths.
    strength = np.linspace(0, 1, 256)
    across = 0.01 + 0.99 * strength**2
    r, a = graph(document, "specular_roughness", strength), graph(document, "specular_roughness_anisotropy", strength)
    tangent = r**2 * np.sqrt(2 / (1 + (1 - a) ** 2))
    agree("MaterialX: slope across against glTF", float(np.abs(tangent - across).max()), 1e-9)
    agree("MaterialX: slope along against glTF", float(np.abs((1 - a) * tangent - 0.01).max()), 1e-9)
    x, y = np.array(Image.open("materialx/anisotropy.png")).shape[1::-1]
    agree("MaterialX: size of the texture", (x, y), (96, 80))
    return library


def graph(document, output, blue):
    """Value of an output of the graph, for values of the texture's blue channel."""
    nodes = document.getNodeGraph("maps")
    operations = {
        "multiply": lambda v: v("in1") * v("in2"),
        "add": lambda v: v("in1") + v("in2"),
        "subtract": lambda v: v("in1") - v("in2"),
        "divide": lambda v: v("in1") / v("in2"),
        "power": lambda v: v("in1") ** v("in2"),
        "mix": lambda v: v("bg") * (1 - v("mix")) + v("fg") * v("mix"),
    }

    def value(node):
        if node.getCategory() == "separate3":
            return blue
        read = lambda name: value(node.getConnectedNode(name)) if node.getConnectedNode(name) else node.getInputValue(name)
        return operations[node.getCategory()](read)

    return value(nodes.getNode(nodes.getOutput(output).getNodeName()))


def usd(library):
    """Opens the stage; validators of USD; nodes against MaterialX's library; size of the quad."""
    nacre("export", "result", "--format", "usd", "--out", "usd")
    stage = Usd.Stage.Open("usd/surface.usda")
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    problems = [f"{e.GetIdentifier()}: {e.GetMessage()}" for e in UsdValidation.ValidationContext(validators).Validate(stage)]
    # usd-core from PyPI has no nodes of MaterialX; the library of PyPI's MaterialX is asked instead.
    problems = [p for p in problems if not ("MissingShaderIdInRegistry" in p and "'ND_" in p)]
    agree("USD: problems that its validators find", problems, [])
    nodes = [prim for prim in stage.Traverse() if is_materialx(prim)]
    agree("USD: parts of nodes unknown to MaterialX", [u for prim in nodes for u in unknown(prim, library)], [])
    quad = UsdGeom.Mesh(stage.GetPrimAtPath("/Sample/Quad"))
    side = np.ptp(np.array(quad.GetPointsAttr().Get()), axis=0)[:2] * UsdGeom.GetStageMetersPerUnit(stage)
    orientation = channel("result/orientation.exr", "orientation")
    size = float(OpenEXR.File("result/orientation.exr").header()["pixel_um"][0]) * 1e-6 * np.array(orientation.shape[::-1])
    agree("USD: size of the quad, m", float(np.abs(side - size).max()), 1e-6)
    material = UsdShade.Material(stage.GetPrimAtPath("/Sample/Grating"))
    sources = [material.ComputeSurfaceSource(context)[0].GetIdAttr().Get() for context in ("", "mtlx")]
    agree("USD: surfaces", sources, ["UsdPreviewSurface", "ND_open_pbr_surface_surfaceshader"])
    bound = UsdShade.MaterialBindingAPI(quad).ComputeBoundMaterial()[0].GetPath()
    agree("USD: material of the quad", str(bound), "/Sample/Grating")
    agree("USD: directions, °", angles(np.array(Image.open("usd/anisotropy.png")), orientation), 0.32)


def is_materialx(prim):
    return prim.GetTypeName() == "Shader" and (UsdShade.Shader(prim).GetIdAttr().Get() or "").startswith("ND_")


def unknown(prim, library):
    """Inputs, outputs and sources of a shader that its definition in MaterialX lacks."""
    shader = UsdShade.Shader(prim)
    definition = library.getNodeDef(shader.GetIdAttr().Get())
    if definition is None:
        return [shader.GetIdAttr().Get()]
    found = [i.GetBaseName() for i in shader.GetInputs() if definition.getActiveInput(i.GetBaseName()) is None]
    found += [o.GetBaseName() for o in shader.GetOutputs() if definition.getActiveOutput(o.GetBaseName()) is None]
    for given in shader.GetInputs():
        types = {"color3f": "color3", "float3": "vector3", "asset": "filename", "string": "string", "float": "float"}
        wanted = definition.getActiveInput(given.GetBaseName())
        if wanted is not None and types[str(given.GetTypeName())] != wanted.getType():
            found.append(f"{given.GetBaseName()} is {given.GetTypeName()}")
        if given.HasConnectedSource() and not given.GetValueProducingAttributes():
            found.append(f"{given.GetBaseName()} leads nowhere")
    return found


if __name__ == "__main__":
    NACRE = os.path.abspath(sys.argv[1])
    node_path = os.environ.get("NODE_PATH")
    if node_path:
        os.environ["NODE_PATH"] = os.path.abspath(node_path)
    warnings.filterwarnings("ignore")
    with tempfile.TemporaryDirectory() as place, contextlib.chdir(place):
        Path("plan.toml").write_text('kind = "polarization"\nextras = ["dark"]\nanalyser = { angles_deg = ['
                                     + ", ".join(map(str, range(0, 180, 15))) + "] }\n")
        Path("bench.toml").write_text('camera = { width = 96, height = 80 }\nsample = { kind = "cd" }\n')
        nacre("capture", "plan.toml", "--sim", "--bench", "bench.toml", "--out", "session")
        nacre("reconstruct", "polarization", "session", "--out", "result")
        tiled()
        zarr()
        gltf()
        usd(materialx())
    sys.exit(bool(failed))
