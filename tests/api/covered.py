"""Says which operations of an API checker's report were answered with success, and fails below 90 %.

Usage: covered.py REPORT.ndjson OPENAPI.json
"""

import json
import re
import sys

METHODS = {"get", "post", "put", "delete", "patch"}
# Streams do not end, and operations other than polarization take input that is not seeded: they are tested apart. So are
# those that wait for the bench, want a job that waits or runs, or the version of a file.
APART = re.compile("events|link|^/api/v1/operations/(?!polarization$)|camera/(meter|preview$)|/samples/.*/sessions|/first$|/finish$|/settings")

with open(sys.argv[2]) as file:
    paths = json.load(file)["paths"]
operations = {(m.upper(), p) for p, item in paths.items() for m in item if m in METHODS and not APART.search(p)}
# The most literal path first, so that preview.png is no parameter.
ordered = sorted({p for _, p in operations}, key=lambda p: p.count("{"))
pattern = {p: re.compile(re.sub(r"\{[^}]*\}", "[^/?]+", p).replace(".", "[.]") + r"(\?.*)?$") for p in ordered}
succeeded = set()
with open(sys.argv[1]) as file:
    for line in file:
        recorder = json.loads(line).get("ScenarioFinished", {}).get("recorder", {})
        for interaction in recorder.get("interactions", {}).values():
            request, response = interaction["request"], interaction.get("response")
            path = re.sub("^https?://[^/]*", "", request["uri"])
            known = next((p for p in ordered if pattern[p].match(path)), None)
            if known and response and 200 <= response["status_code"] < 300:
                succeeded.add((request["method"], known))
missing = sorted(operations - succeeded)
print(f"{len(operations) - len(missing)} of {len(operations)} operations succeeded; not: {missing}")
sys.exit(len(missing) > 0.1 * len(operations))
