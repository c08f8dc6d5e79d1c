"""Client of the service (`nacre serve`)."""

from __future__ import annotations

import json
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from typing import Any

from ._requests import Requests


#: States of sessions and reconstructions that end by themselves.
_BUSY = ("queued", "running", "pausing", "resuming", "stopping", "aborting")


class ServiceError(RuntimeError):
    """The service refused a request. `problem` is its problem document (RFC 9457)."""

    def __init__(self, problem: dict[str, Any]):
        texts = [problem.get(key) for key in ("title", "detail", "remedy")]
        super().__init__("; ".join(str(text) for text in texts if text))
        self.problem = problem


class Client(Requests):
    """A running service: `Client("http://127.0.0.1:8465")`.

    Parameters
    ----------
    url
        Address of the service.
    token
        Access token (`nacre token`), for a service on another machine.
    timeout_s
        Longest wait for an answer, in s.
    """

    def __init__(self, url: str = "http://127.0.0.1:8465", token: str | None = None, timeout_s: float = 60.0):
        self._url, self._timeout_s = url.rstrip("/"), timeout_s
        self._headers = {"Authorization": f"Bearer {token}"} if token else {}

    def _open(self, method: str, path: str, body: Any, headers: dict[str, str], timeout_s: float | None) -> Any:
        data = body if isinstance(body, bytes) or body is None else json.dumps(body).encode()
        kind = {} if data is None or isinstance(body, bytes) else {"Content-Type": "application/json"}
        request = urllib.request.Request(self._url + path, data, {**self._headers, **kind, **headers}, method=method)
        try:
            return urllib.request.urlopen(request, timeout=timeout_s or self._timeout_s)
        except urllib.error.HTTPError as error:
            text = error.read()
            try:
                raise ServiceError(json.loads(text)) from None
            except json.JSONDecodeError:
                raise ServiceError({"title": f"{error.code} {error.reason}"}) from None

    def _send(self, method: str, path: str, body: Any = None, headers: dict[str, str] | None = None) -> Any:
        with self._open(method, path, body, headers or {}, None) as answer:
            data = answer.read()
            return json.loads(data) if "json" in answer.headers.get("Content-Type", "") else data

    def events(self, session: str) -> Iterator[tuple[str, Any]]:
        """Events of a session as (name, data), until the service ends them."""
        path = f"/api/v1/sessions/{session}/events"
        with self._open("GET", path, None, {"Accept": "text/event-stream"}, 3600.0) as answer:
            name, data = "message", ""
            for line in answer:
                key, _, value = line.decode().rstrip("\r\n").partition(": ")
                if key == "event":
                    name = value
                elif key == "data":
                    data += value
                elif not key and data:
                    yield name, json.loads(data)
                    name, data = "message", ""

    def capture(self, plan: dict[str, Any]) -> Any:
        """Takes a session by this plan and waits for its end; returns the session."""
        begun = self._send("POST", "/api/v1/sessions", {"plan": plan})
        return self.wait(f"/api/v1/sessions/{begun['id']}")

    def compute(self, operation: str, session: str, **options: Any) -> Any:
        """Runs an operation on a session and waits for the result; returns the reconstruction with its report."""
        body = {"session": session, "options": options}
        job = self._send("POST", f"/api/v1/operations/{operation}", body)
        return self.wait(f"/api/v1/reconstructions/{job['id']}")

    def wait(self, path: str, pause_s: float = 0.2) -> Any:
        """Waits until a session or reconstruction has ended, and returns it."""
        while True:
            state = self._send("GET", path)
            busy = state["state"] in _BUSY or ("frames_planned" in state and state["stage"] is not None)
            if not busy:
                if state.get("error"):
                    raise ServiceError({"title": f"{path} failed", "detail": state["error"]})
                return state
            time.sleep(pause_s)
