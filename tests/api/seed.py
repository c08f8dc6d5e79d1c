"""Seeds a running service, so that an API checker has something to look at.

Usage: seed.py URL CONFIGURATION SEEDED: writes a configuration of the checker, and what was made as JSON.
"""

import json
import sys
import time
import urllib.request
from pathlib import Path

BASE = sys.argv[1]


def call(method, path, body=None):
    data = None if body is None else json.dumps(body).encode()
    request = urllib.request.Request(BASE + path, data, {"Content-Type": "application/json"}, method=method)
    with urllib.request.urlopen(request) as answer:
        return json.load(answer)


def finished(path, done):
    for _ in range(6000):
        found = call("GET", path)
        if done(found):
            return found
        time.sleep(0.1)
    raise SystemExit(f"{path} does not end: {found}")


plan = {
    "kind": "polarization",
    "camera": {"exposure_ms": 5},
    "analyser": {"angles_deg": [0, 60, 120]},
    "reconstruct": { "operation": "polarization" },
}
session = call("POST", "/api/v1/sessions", {"plan": plan})["id"]
finished(f"/api/v1/sessions/{session}", lambda s: s["state"] == "finished" and s["has_results"])
job = call("POST", "/api/v1/reconstructions", {"session": session})["id"]
finished(f"/api/v1/reconstructions/{job}", lambda r: r["state"] == "done")

edge = "--edge\r\nContent-Disposition: form-data; name="
form = f'{edge}"kind"\r\n\r\nscene\r\n{edge}"gallery"\r\n\r\ncd\r\n--edge--\r\n'
kind = {"Content-Type": "multipart/form-data; boundary=edge"}


def uploaded():
    with urllib.request.urlopen(urllib.request.Request(BASE + "/api/v1/uploads", form.encode(), kind)) as answer:
        return json.load(answer)["id"]


upload, unused = uploaded(), uploaded()
# Results of the session serve as those of a calibration; the data folder is in the current one.
analyser = {"zero_deg": 1.5, "zero_sigma_deg": 0.01, "sense": 1}
Path(f"data/sessions/{session}/results/calibration.json").write_text(json.dumps({"analyser": analyser}))
rendering = {"upload": upload, "method": "render", "options": {"samples": 4}}
rendered = call("POST", "/api/v1/reconstructions", rendering)["id"]
finished(f"/api/v1/reconstructions/{rendered}", lambda r: r["state"] == "done")

with open(sys.argv[2], "w") as file:
    # Streams do not end, and are tested apart.
    file.write(f"""
[[operations]]
include-path-regex = "/sessions/"
parameters = {{ "path.id" = "{session}", "path.name" = "0000.png", "path.path" = "frames.json" }}

[[operations]]
include-path-regex = "/picture.png"
parameters = {{ "path.id" = "{rendered}" }}

[[operations]]
include-path-regex = "/reconstructions/"
parameters = {{ "path.id" = "{job}", "path.file" = "orientation.png", "path.map" = "orientation", "path.level" = 0, "path.column" = 0, "path.row" = 0 }}

[[operations]]
include-path-regex = "/uploads/.*id|/trash/"
parameters = {{ "path.id" = "{unused}" }}

[[operations]]
include-path-regex = "/calibrations/"
parameters = {{ "path.file" = "calibration.json" }}

[[operations]]
include-path-regex = "/charts/"
parameters = {{ "path.folder" = "seeded", "path.chart" = "maps", "path.file" = "maps.png" }}

[[operations]]
include-path-regex = "events|link"
enabled = false
""")
with open(sys.argv[3], "w") as file:
    json.dump({"session": session, "job": job}, file)
