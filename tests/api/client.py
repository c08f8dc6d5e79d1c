"""Takes a session and fetches its map, with nothing but the client that was generated from the OpenAPI document."""

import sys
import time

from nacre_client import Client
from nacre_client.api.operations import run_polarization
from nacre_client.api.reconstructions import map_, reconstruction
from nacre_client.api.sessions import begin_session, session
from nacre_client.models import PlanBody, PolarizationOptions, PolarizationOrder

client = Client(sys.argv[1], timeout=600)
plan = {
    "kind": "polarization",
    "camera": {"exposure_ms": 5},
    "analyser": {"angles_deg": [0, 45, 90, 135]},
    "reconstruct": {"operation": "polarization"},
}
begun = begin_session.sync(client=client, body=PlanBody.from_dict({"plan": plan}))
for _ in range(6000):
    found = session.sync(begun.id, client=client)
    if found.has_results:
        break
    time.sleep(0.1)
assert found.state == "finished" and found.frames_committed == 4, found
answer = map_.sync_detailed(begun.id, "orientation.npy", client=client)
assert answer.status_code == 200 and answer.content[:6] == b"\x93NUMPY", answer.status_code
print(f"the generated client took the session {begun.id} and fetched its map of {len(answer.content)} bytes")
order = PolarizationOrder(session=begun.id, options=PolarizationOptions(model="plain", smooth="none"))
job = run_polarization.sync(client=client, body=order)
for _ in range(6000):
    done = reconstruction.sync(job.id, client=client)
    if done.state in ("done", "failed"):
        break
    time.sleep(0.1)
assert done.state == "done" and done.report["model"] == "plain", done
print(f"and ran the operation polarization, job {job.id}")
