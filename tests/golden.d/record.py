"""Records of outputs, and their comparison: by content on machines that round alike, by numbers on others."""

import difflib
import hashlib
import math
import os
import platform
import re
from collections import Counter

import images
from volatile import normalised

# Texts up to this size are stored whole, so that a difference can be read.
LARGEST_TEXT = 16_000
TEXTS = {".json", ".toml", ".csv", ".txt", ".svg", ".html", ".jsonl", ""}
# Values of a channel that are stored besides its statistics.
SAMPLES = 12

# Tolerances between machines that round differently. Printed numbers may also differ by one in their last digit.
RELATIVE = 0.01
ABSOLUTE = 1e-9
# Part of single samples, and of the numbers of a text, that may be outside: a decision between two equal candidates can flip.
FLIPPED = 0.1

NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")


def machine():
    """Everything that decides how floating-point results are rounded: the processor's instructions, and libm's version."""
    flags = set()
    if os.path.exists("/proc/cpuinfo"):
        with open("/proc/cpuinfo") as info:
            flags = set(next((line for line in info if line.startswith("flags")), "").split())
    return {
        "architecture": platform.machine(),
        "avx2 and fma": {"avx2", "fma"} <= flags,
        "libc": " ".join(platform.libc_ver()),
    }


def record(path, data, folder, expected=None):
    """Returns ("text", normalised text) or ("numbers", {"sha256", "numbers"}) of an output.

    Numbers are computed only where the output is not the expected one.
    """
    suffix = os.path.splitext(path)[1]
    if suffix in TEXTS:
        text = normalised(data.decode(), folder)
        if len(text) <= LARGEST_TEXT or os.path.basename(path) == "stdout.txt":
            return "text", text
        data = text.encode()
        channels = lambda: {"text": [float(number) for number in NUMBER.findall(text)]}
    elif suffix == ".exr":
        planes, data = images.exr(data)
        channels = lambda: planes
    elif suffix == ".png":
        channels = lambda: images.png(data)
    else:
        channels = lambda: {"size": [len(data)]}
    sha256 = hashlib.sha256(data).hexdigest()
    if expected and expected[0] == "numbers" and expected[1]["sha256"] == sha256:
        return expected
    return "numbers", {"sha256": sha256, "numbers": {name: statistics(values) for name, values in channels().items()}}


def statistics(values):
    """Number of values, of finite ones, their least, mean, greatest and root mean square, and evenly spaced samples."""
    finite = [v for v in values if math.isfinite(v)]
    n = len(finite)
    counts = Counter(finite)  # pictures have few values
    moments = [math.fsum(count * v**power for v, count in counts.items()) / max(1, n) for power in (1, 2)]
    samples = finite[max(1, n // SAMPLES) // 2::max(1, n // SAMPLES)][:SAMPLES]
    summary = (min(counts, default=0), moments[0], max(counts, default=0), math.sqrt(moments[1]))
    return [len(values), n, *map(_short, summary), [_short(v) for v in samples]]


def _short(value):
    return float(f"{value:.6g}")


def near(a, b, scale=0.0):
    return abs(a - b) <= ABSOLUTE + RELATIVE * max(abs(a), abs(b), scale)


def apart(expected, found):
    """Differences between two statistics, as texts; none where they agree within the tolerances."""
    lines = []
    if expected[0] != found[0]:
        return [f"{expected[0]} values before, {found[0]} now"]
    if abs(expected[1] - found[1]) > RELATIVE * expected[0]:
        lines.append(f"{expected[1]} finite values before, {found[1]} now")
    scale = expected[5]
    for name, a, b in zip(("least", "mean", "greatest", "root mean square"), expected[2:6], found[2:6]):
        if not near(a, b, scale):
            lines.append(f"{name} {a} before, {b} now")
    # Samples are of the finite values, which move where their number differs.
    if expected[1] == found[1]:
        off = [(a, b) for a, b in zip(expected[6], found[6]) if not near(a, b, scale)]
        if len(off) > FLIPPED * SAMPLES:
            lines.append(f"{len(off)} of {len(expected[6])} samples, such as {off[0][0]} before, {off[0][1]} now")
    return lines


def compare_text(name, expected, found, by_numbers):
    """Lines of the difference between two texts; none where they agree."""
    if expected == found or by_numbers and _alike(expected, found):
        return []
    diff = difflib.unified_diff(expected.splitlines(), found.splitlines(), f"{name} (expected)", f"{name} (found)", "", "", 2, "")
    return list(diff) or ["only line ends differ"]


def _alike(expected, found):
    if NUMBER.sub("#", expected) != NUMBER.sub("#", found):
        return False
    pairs = list(zip(NUMBER.findall(expected), NUMBER.findall(found)))
    off = [pair for pair in pairs if not near(*map(float, pair)) and abs(float(pair[0]) - float(pair[1])) > 1.01 * _last_digit(pair[0])]
    return len(off) <= FLIPPED * len(pairs)


def _last_digit(number):
    mantissa, _, exponent = number.lower().partition("e")
    return 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))


def compare_numbers(expected, found, by_numbers):
    """Lines of the difference between two records of numbers; none where they agree."""
    if expected["sha256"] == found["sha256"]:
        return []
    if expected["numbers"].keys() != found["numbers"].keys():
        return [f"channels {', '.join(expected['numbers'])} before, {', '.join(found['numbers'])} now"]
    lines = [f"{channel}: {line}" for channel, numbers in expected["numbers"].items() for line in apart(numbers, found["numbers"][channel])]
    if not lines and not by_numbers:
        lines = [f"bytes differ; {'all statistics agree within 1 %' if expected['numbers'] else 'no numbers recorded'}"]
    return lines
