"""Runs every operation by the client that was generated from the OpenAPI document, and writes the same orders as a TypeScript program.

Usage: every.py URL PROGRAM.ts: inputs are simulated by the program NACRE_BIN in the current folder. Each report must fit its schema.
"""

import importlib
import json
import os
import subprocess
import sys
import time
import urllib.request
import uuid
from pathlib import Path

from jsonschema import Draft202012Validator
from nacre_client import Client, models
from nacre_client.api.reconstructions import reconstruction

sys.path.insert(0, str(Path(__file__).parent.parent / "golden.d"))
import inputs

URL, PROGRAM = sys.argv[1:]
NACRE = os.environ["NACRE_BIN"]
client = Client(URL, timeout=600)


def nacre(line):
    subprocess.run([NACRE, *line.split()], check=True, capture_output=True)


def answer(request):
    with urllib.request.urlopen(request) as found:
        return json.load(found)


def upload(kind, *paths, frames=None):
    """Sends files, and the frames.json that describes them; returns the id of the upload."""
    edge = uuid.uuid4().hex
    part = f'--{edge}\r\nContent-Disposition: form-data; name='
    body = f'{part}"kind"\r\n\r\n{kind}\r\n'.encode()
    if frames:
        body += f'{part}"frames"\r\n\r\n{Path(frames).read_text()}\r\n'.encode()
    for path in map(Path, paths):
        body += f'{part}"file"; filename="{path.name}"\r\n\r\n'.encode() + path.read_bytes() + b"\r\n"
    head = {"Content-Type": f"multipart/form-data; boundary={edge}"}
    return answer(urllib.request.Request(f"{URL}/api/v1/uploads", body + f"--{edge}--\r\n".encode(), head))["id"]


def session(plan):
    """Takes a session; returns its id."""
    body = json.dumps({"plan": plan}).encode()
    begun = answer(urllib.request.Request(f"{URL}/api/v1/sessions", body, {"Content-Type": "application/json"}))
    for _ in range(6000):
        if answer(f"{URL}/api/v1/sessions/{begun['id']}")["state"] in ("finished", "failed"):
            return begun["id"]
        time.sleep(0.1)
    raise SystemExit(f"the session of {plan} does not end")


DOCUMENT = answer(f"{URL}/api/v1/openapi.json")


def flats():
    """Photographs of even light and dark ones, which their frames.json names."""
    frames = []
    for number, exposure_s in enumerate((0.01, 0.01, 0.05, 0.05, 0.1, 0.1)):
        for kind, electrons in (("dark", 0), ("flat", round(1e5 * exposure_s))):
            Path(f"{kind}{number}.png").write_bytes(inputs.noisy(electrons, f"{kind}{number}"))
        frames.append({"file": f"flat{number}.png", "dark": f"dark{number}.png", "exposure_s": exposure_s})
    Path("flats.json").write_text(json.dumps({"kind": "exposures", "transfer": "linear", "frames": frames}))


def orders():
    """One order for each operation."""
    for name in ("FLASH_SCENE", "BOKEH_SCENE", "FOIL_SCENE", "TILES_SCENE", "RENDER_SCENE"):
        Path(f"{name}.toml").write_text(getattr(inputs, name))
    for number, pose in enumerate(inputs.BOARDS):
        Path(f"board{number}.png").write_bytes(inputs.board(*pose))
    for kind, scene in (("flash", "FLASH"), ("bokeh", "BOKEH"), ("foil", "FOIL"), ("tiles", "TILES")):
        nacre(f"sim photograph {kind} --scene {scene}_SCENE.toml --out {kind}")
    nacre("reconstruct lut flash --wavelength-nm 680 --scale 0.008 --size 64 --max-error 1 --out table")
    nacre("reconstruct foil foil --out found")
    nacre("synthesize found --size 32x24 --pixel-um 25 --square-px 3 --out drawn")
    nacre("brdf surface sinusoid --period-um 2 --depth-um 0.1 --pixels 48 --out heights.exr")
    photographs = lambda folder, frames=None: upload("photographs", *sorted(Path(folder).glob("*.png")), frames=frames)
    geometry = json.loads(Path("foil/geometry.json").read_text())
    exposures = session({"kind": "exposures", "exposures_ms": [1, 4]})
    angles = session({"kind": "polarization", "camera": {"exposure_ms": 5}, "analyser": {"angles_deg": [0, 45, 90, 135]}})
    fringes = {"count": 8, "phases": 4, "finest_mm": 28}
    sheet = json.loads(Path("tiles/geometry.json").read_text())
    tiles = {"tiles": [6, 5], "size_mm": [178.2, 131.25], "geometry": sheet}
    yield "polarization", {"session": angles, "options": {"model": "plain"}}
    yield "hdr", {"session": exposures, "options": {"align": "off"}}
    yield "stack", {"upload": photographs("tiles"), "options": {"clip_sigma": None}}
    table = {"wavelength_nm": 680, "scale": 0.008, "size": 64, "max_error": 1}
    yield "lut", {"upload": photographs("flash", "flash/frames.json"), "options": table}
    yield "bokeh", {"upload": photographs("bokeh"), "options": {"psf": {"sigma": 2}, "scale": {"pixel": 2.5}}}
    yield "foil", {"upload": photographs("foil", "foil/frames.json"), "options": {"geometry": geometry, "bins": [24, 16]}}
    yield "spots", {"session": session({"kind": "spots", "spots": {"fringes": fringes}}), "options": {}}
    yield "flash", {"upload": photographs("tiles", "tiles/frames.json"), "options": tiles}
    yield "brdf", {"upload": upload("surface", "heights.exr"), "options": {"size": 16, "settings": {"coherence_um": 8}}}
    yield "map", {"upload": upload("maps", *Path("drawn").glob("*.exr")), "options": {"tile": [2, 1], "layout": "mirror"}}
    boards = upload("photographs", *sorted(Path().glob("board*.png")))
    yield "calibrate", {"upload": boards, "options": {"board": [9, 6], "square_mm": 25}}
    yield "render", {"upload": upload("scene", "RENDER_SCENE.toml"), "options": {"samples": 4}}
    yield "factor", {"upload": upload("table", "table/lut.exr"), "options": {"rank": 2, "kind": "nonnegative"}}
    yield "synthesize", {"upload": upload("table", "found/histogram.exr"), "options": {"size": [32, 24], "pixel_um": 25, "dot": {"disc": 5}}}
    flats()
    yield "camera", {"upload": upload("photographs", *Path().glob("flat?.png"), *Path().glob("dark?.png"), frames="flats.json"), "options": {}}
    turn = ",".join(map(str, range(0, 360, 30)))
    def turned(sample):
        """Uploads a turn of the analyser about a simulated sample, without the folders of a session."""
        nacre(f"sim render --sample {sample} --size 32 --angles-deg {turn} --out {sample}")
        described = Path(sample, "frames.json")
        described.write_text(described.read_text().replace("frames/", ""))
        return upload("photographs", *sorted(Path(sample, "frames").glob("*.png")), frames=described)

    yield "analyser", {"upload": turned("polarizer"), "options": {"axis_deg": 0, "axis_sigma_deg": 0.1}}
    yield "retarder", {"upload": turned("mirror"), "options": {"panel_deg": 0, "panel_sigma_deg": 0.1}}
    yield "flat", {"upload": turned("paper"), "options": {}}
    of = {"upload": turned("kinematic"), "options": {"model": "circle"}}
    yield "orientation", {"results": [run("polarization", of).id], "options": {"known_deg": 30}}
    yield "inspect", {"upload": upload("maps", *Path("drawn").glob("*.exr")), "options": {"reference": "orientation.exr"}}


def run(name, order):
    """Runs an operation; returns the reconstruction."""
    module = importlib.import_module(f"nacre_client.api.operations.run_{name}")
    request = DOCUMENT["paths"][f"/api/v1/operations/{name}"]["post"]["requestBody"]["content"]["application/json"]
    body = getattr(models, request["schema"]["$ref"].rsplit("/", 1)[1]).from_dict(order)
    job = module.sync(client=client, body=body)
    for _ in range(6000):
        done = reconstruction.sync(getattr(job, "id", None) or sys.exit(f"{name}: {job}"), client=client)
        if done.state in ("done", "failed", "set_aside"):
            break
        time.sleep(0.1)
    assert done.state == "done", f"{name}: {done.error}"
    return done


offered = {operation["name"]: operation for operation in answer(f"{URL}/api/v1/operations")}
all_orders = dict(orders())
assert all_orders.keys() == offered.keys(), all_orders.keys() ^ offered.keys()
for name, order in all_orders.items():
    report = run(name, order).report.to_dict()
    problems = list(Draft202012Validator(offered[name]["report"]).iter_errors(report))
    assert not problems, f"{name}: {problems[0].json_path}: {problems[0].message}"
lines = [f'await run("/api/v1/operations/{name}", {json.dumps(order)});' for name, order in all_orders.items()]
Path(PROGRAM).write_text(Path(__file__).with_name("client.ts").read_text() + "\n".join(lines) + "\n")
print(f"the generated client ran {len(all_orders)} operations, and their reports fit their schemas")
