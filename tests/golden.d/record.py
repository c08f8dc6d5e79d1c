"""Records of outputs, and their comparison: by bytes on machines that round alike, by numbers on others."""

import difflib
import hashlib
import math
import os
import platform
import re
from collections import Counter
from dataclasses import dataclass

import images
from volatile import normalised

# Texts up to this size are stored whole, so that a difference can be read.
LARGEST_TEXT = 16_000
TEXTS = {".json", ".toml", ".csv", ".txt", ".svg", ".html", ".jsonl", ""}
# Values of a channel that are stored besides its statistics.
SAMPLES = 12



@dataclass(frozen=True)
class Tolerance:
    """Numbers agree within relative * the larger one + absolute. Printed ones may also differ by one in their last digit."""

    relative: float
    absolute: float
    # Part of single samples, and of the numbers of a text, that may be outside.
    outside: float
    # Part of the lines of a text that may have other words: "under 0.0001 %" for "0.0001 %".
    reworded: float = 0


# Between machines that round differently. A decision between two equal candidates can flip there.
OTHER_MACHINE = Tolerance(relative=0.01, absolute=1e-9, outside=0.1, reworded=0.02)
# Pictures there: the simulated camera's noise is another one where its state differs in the last bit.
OTHER_PICTURE = Tolerance(relative=0.01, absolute=3, outside=0.1)
# On one machine, for sums over threads, whose order depends on which thread is idle first.
REORDERED_SUMS = Tolerance(relative=1e-9, absolute=1e-15, outside=0)

CHECKSUM = re.compile(r"\b[0-9a-f]{64}\b")
# Pictures in texts; their letters and digits would read as numbers.
EMBEDDED = re.compile(r"base64,[A-Za-z0-9+/=]+")
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
        channels = lambda: {"text": [float(number) for number in NUMBER.findall(EMBEDDED.sub("", text))]}
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


def near(a, b, tolerance, scale=0.0):
    return abs(a - b) <= tolerance.absolute + tolerance.relative * max(abs(a), abs(b), scale)


def apart(expected, found, tolerance):
    """Differences between two statistics, as texts; none where they agree within the tolerance."""
    lines = []
    if expected[0] != found[0]:
        return [f"{expected[0]} values before, {found[0]} now"]
    if abs(expected[1] - found[1]) > tolerance.relative * expected[0]:
        lines.append(f"{expected[1]} finite values before, {found[1]} now")
    scale = expected[5]
    for name, a, b in zip(("least", "mean", "greatest", "root mean square"), expected[2:6], found[2:6]):
        if not near(a, b, tolerance, scale):
            lines.append(f"{name} {a} before, {b} now")
    # Samples are of the finite values, which move where their number differs.
    if expected[1] == found[1]:
        off = [(a, b) for a, b in zip(expected[6], found[6]) if not near(a, b, tolerance, scale)]
        if len(off) > tolerance.outside * SAMPLES:
            lines.append(f"{len(off)} of {len(expected[6])} samples, such as {off[0][0]} before, {off[0][1]} now")
    return lines


def compare(name, expected, found, tolerance):
    """Lines of the difference between two records; none where they agree. Without a tolerance, bytes are compared."""
    (kind, before), (now_kind, now) = expected, found
    if kind != now_kind:
        return [f"is stored in another way now: texts above {LARGEST_TEXT} characters are stored as a hash"]
    if kind == "text":
        return [] if before == now or tolerance and _alike(before, now, tolerance) else _diff(name, before, now)
    if before["sha256"] == now["sha256"]:
        return []
    channels, now_channels = before["numbers"], now["numbers"]
    if channels.keys() != now_channels.keys():
        return [f"channels {', '.join(channels)} before, {', '.join(now_channels)} now"]
    used = OTHER_PICTURE if tolerance == OTHER_MACHINE and name.endswith(".png") else tolerance or OTHER_MACHINE
    lines = [f"{channel}: {line}" for channel in channels for line in apart(channels[channel], now_channels[channel], used)]
    return lines or ([] if tolerance else ["bytes differ; all statistics agree within 1 %"])


def _diff(name, expected, found):
    lines = [text.splitlines() for text in (expected, found)]
    return list(difflib.unified_diff(*lines, f"{name} (expected)", f"{name} (found)", "", "", 2, "")) or ["only line ends differ"]


def _alike(expected, found, tolerance):
    """Whether two texts have the same words, and numbers that agree."""
    # Checksums of frames, in journals, are other ones where a frame is.
    lines = [CHECKSUM.sub("#", text).splitlines() for text in (expected, found)]
    if len(lines[0]) != len(lines[1]):
        return False
    same = [(a, b) for a, b in zip(*lines) if NUMBER.sub("#", a) == NUMBER.sub("#", b)]
    pairs = [pair for a, b in same for pair in zip(NUMBER.findall(a), NUMBER.findall(b))]
    off = [(a, b) for a, b in pairs if not near(float(a), float(b), tolerance) and abs(float(a) - float(b)) > 1.01 * _last_digit(a)]
    return len(off) <= tolerance.outside * len(pairs) and len(lines[0]) - len(same) <= tolerance.reworded * len(lines[0])


def _last_digit(number):
    mantissa, _, exponent = number.lower().partition("e")
    return 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))
