"""Normalisation of content that changes from run to run: times, checksums over times, the folder of the run."""

import re

# Keys of JSON documents, and the reason why their values are replaced by "~".
KEYS = {
    "seconds": "duration of the computation",
    "seconds_of_passes": "duration of the computation",
    "engine_s": "time that the engine added",
    "wall_s": "duration of the session",
    "results_after_s": "time that the reconstruction took after the last frame",
    "created": "when the session was begun",
    "begun": "when the session was begun",
    "time_ms": "when the journal's line was written",
    "crc": "covers time_ms",
}
# An object with one of these keys is a schema.
SCHEMA = r'(?![^{}]*"(?:type|\$ref|description)")'
NUMBER = r"-?\d+(?:\.\d+)?(?:e[-+]?\d+)?"
VALUE = rf'(?:{NUMBER}|null|"(?:[^"\\]|\\.)*"|\{{{SCHEMA}[^{{}}]*\}}|\[[^\[\]{{}}]*\])'
JSON_KEY = re.compile(rf'"({"|".join(KEYS)})"(\s*:\s*){VALUE}')

# Lines of reports on standard output.
TEXT = [
    # "time      2.19 s: reading and fitting 0.00, solving 2.16" and "total     2.5 s: ..."
    (re.compile(r"(?m)^((?:time|total) +)\d.*$"), r"\1~"),
    # "results   polarization/results, 2.86 s after the last frame"
    (re.compile(r"\d+\.\d+ s after the last frame"), "~ s after the last frame"),
    # `nacre plan estimate`: "then about 0.5 s for the results"
    (re.compile(r"then about \S+ \w+ for the results"), "then about ~ for the results"),
    # Renderings: "spectra   9 bands ... at most, 0.45 s", "tv   4 samples, noise 9.88e-2, 6.3 s"
    (re.compile(r"(?m)(noise \S+(?: at most)?, )\d+\.\d+ s$"), r"\1~ s"),
    # `nacre token`: the hash of a random token.
    (re.compile(r'(sha256 = )"[0-9a-f]{64}"'), r'\1"~"'),
    # Listings of the catalogue: when a session was begun, a hash of its folder, the size of a folder with times in its journal.
    (re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ"), "~"),
    (re.compile(r'("id": )"[0-9a-f]{16}"'), r'\1"~"'),
    (re.compile(r'("created": "~",\s*"bytes": )\d+'), r"\1~"),
    # The journal seals session.json, which holds the time at which the session was begun.
    (re.compile(r'("file":"session\.json","sha256":")[0-9a-f]{64}'), r"\1~"),
]


def normalised(text, folder):
    """Replaces volatile content of a text output by `~`, and the absolute path of the run's folder by `$PWD`."""
    text = text.replace(str(folder), "$PWD")
    text = JSON_KEY.sub(r'"\1"\2"~"', text)
    for pattern, replacement in TEXT:
        text = pattern.sub(replacement, text)
    return text
