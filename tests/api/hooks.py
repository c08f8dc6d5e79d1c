"""Brings the service into the state that an operation needs, so that an API checker sees more than refusals."""

import json
import os
import threading
import time
import urllib.error
import urllib.request

import schemathesis

BASE = os.environ["NACRE_URL"]
PAGE = "checker"
LONG = {
    "kind": "polarization",
    "camera": {"exposure_ms": 50},
    "analyser": {"angles_deg": [k % 180 for k in range(600)]},
}


def call(method, path, body=None):
    data = None if body is None else json.dumps(body).encode()
    request = urllib.request.Request(BASE + path, data, {"Content-Type": "application/json"}, method=method)
    try:
        with urllib.request.urlopen(request, timeout=600) as answer:
            return json.load(answer)
    except urllib.error.HTTPError as error:
        return json.load(error)


def until(path, wanted):
    for _ in range(3000):
        found = call("GET", path)
        if wanted(found):
            break
        time.sleep(0.02)
    return found


def free():
    call("POST", "/api/v1/stop", {})
    until("/api/v1/devices", lambda d: d.get("activity") == "idle")


def running():
    free()
    session = call("POST", "/api/v1/sessions", {"plan": LONG}).get("id", "")
    until(f"/api/v1/sessions/{session}", lambda s: s.get("state") == "running")
    return session


def uploaded():
    """An upload that nothing uses."""
    edge = "--edge\r\nContent-Disposition: form-data; name="
    form = f'{edge}"kind"\r\n\r\nsurface\r\n{edge}"file"; filename="a.txt"\r\n\r\n0 1\n1 0\n\r\n--edge--\r\n'
    kind = {"Content-Type": "multipart/form-data; boundary=edge"}
    with urllib.request.urlopen(urllib.request.Request(BASE + "/api/v1/uploads", form.encode(), kind)) as answer:
        return json.load(answer)["id"]


def kept():
    """A stored calibration."""
    return call("POST", "/api/v1/calibrations", {"from": SEEDED["session"]}).get("id", "")


def deleted():
    """An upload in the trash."""
    upload = uploaded()
    urllib.request.urlopen(urllib.request.Request(f"{BASE}/api/v1/uploads/{upload}", method="DELETE")).close()
    return upload


def pattern_page():
    """A page that acknowledges whatever it is asked to show."""
    stream = urllib.request.urlopen(f"{BASE}/api/v1/display/link?page={PAGE}")
    for line in stream:
        if line.startswith(b"data:"):
            shown = json.loads(line[5:])
            look = {"viewport": [800, 600], "pixel_ratio": 1.0, "visible": True}
            call("POST", "/api/v1/display/acknowledge", {"page": PAGE, "hash": shown["hash"], **look})
        else:
            call("POST", "/api/v1/display/beat", {"page": PAGE, "visible": True})


threading.Thread(target=pattern_page, daemon=True).start()
SEEDED = json.loads(os.environ["NACRE_SEEDED"])


@schemathesis.hook
def before_call(context, case, kwargs):
    path, method = case.operation.path, case.method.upper()
    sound = case.meta is None or case.meta.generation.mode.value == "positive"
    if sound and path.startswith("/api/v1/uploads/{id}"):
        case.path_parameters["id"] = uploaded()
    elif sound and path.startswith("/api/v1/calibrations/{id}"):
        case.path_parameters["id"] = kept()
    elif sound and path.startswith("/api/v1/trash/{id}"):
        case.path_parameters["id"] = deleted()
    if not sound or method != "POST":
        return
    steered = [path.endswith(end) for end in ("/pause", "/stop", "/abort")]
    if path.startswith("/api/v1/sessions/{id}") and any(steered):
        case.path_parameters["id"] = running()
    elif path.endswith("/resume"):
        case.path_parameters["id"] = running()
        call("POST", f"/api/v1/sessions/{case.path_parameters['id']}/pause", {})
        until(f"/api/v1/sessions/{case.path_parameters['id']}", lambda s: s.get("state") == "paused")
    elif path in ("/api/v1/reconstructions", "/api/v1/reconstructions/estimate"):
        case.body = {"session": SEEDED["session"], "method": "polarization"}
    elif path == "/api/v1/calibrations":
        case.body = {"from": SEEDED["session"]}
    elif path == "/api/v1/operations/polarization":
        case.body = {"session": SEEDED["session"], "options": {"model": "plain"}}
    elif path.endswith("/cancel") or path.endswith("/retry"):
        # The last of three still waits when it is cancelled.
        jobs = [call("POST", "/api/v1/reconstructions", {"session": SEEDED["session"]}).get("id") for _ in range(3)]
        job = jobs[-1]
        if job is None:  # The session was deleted by then.
            return
        if path.endswith("/retry"):
            call("POST", f"/api/v1/reconstructions/{job}/cancel", {})
        case.path_parameters["id"] = job
    elif path.startswith("/api/v1/display/") and isinstance(case.body, dict) and "page" in case.body:
        case.body["page"] = PAGE
    elif path.startswith("/api/v1/devices") or path == "/api/v1/sessions":
        if path.endswith("/measure"):
            case.body = {"levels": 6}
        free()


@schemathesis.hook
def after_call(context, case, response):
    if case.operation.path.startswith("/api/v1/sessions/{id}/") and case.method.upper() == "POST":
        free()
