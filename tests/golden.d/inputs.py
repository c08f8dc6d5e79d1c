"""Inputs of the cases: texts, and pictures computed with integers only, which are the same on every machine."""

import struct
import zlib
from math import isqrt
from random import Random

# --- Capture plans and benches -------------------------------------------------------------------------------------------------

BENCH = """seed = 7
camera = { width = 48, height = 40 }
"""

FILM_BENCH = """seed = 8
camera = { width = 64, height = 56 }
film = { retardance_deg = 10 }
grating = { r = 1.2, zeta_deg = 150 }
"""

SHIFTED_BENCH = """seed = 9
camera = { width = 64, height = 64 }
sample = { kind = "polygons" }
analyser = { wedge_px = 1.5, jitter_px = 0.2 }
"""

REFERENCE = """seed = 31
camera = { width = 48, height = 40 }
sample = { kind = "%s", turn_deg = %d }
panel = { retardance_deg = %d, retarder_deg = 48 }
stage = { zero_deg = 12, eccentricity_deg = 0.2, extinction_ratio = 200 }
"""

DISC_BENCH = """seed = 10
camera = { width = 64, height = 48 }
sample = { kind = "cd" }
flash = { power = 300 }
"""

MOSAIC_BENCH = """seed = 11
sample = { kind = "mosaic" }
panel = { size_mm = [520, 320] }
filter = { wavelength_nm = 560 }
geometry = { distance_mm = 250, baseline_mm = 100 }
camera = { width = 48, height = 48 }
"""

PAPER_BENCH = """seed = 12
camera = { width = 32, height = 24 }
grating = { ellipticity = 0 }
panel = { gamma = 2.0, lag_ms = 30 }
"""

POLARIZATION_PLAN = """kind = "polarization"
sample = "golden tile"
analyser = { angles_deg = [0, 30, 60, 90, 120, 150] }
extras = ["dark", "display_black"]
reconstruct = { operation = "polarization" }
"""

UNTIL_PLAN = """kind = "polarization"
sample = "golden tile"
analyser = { start = 4, until_sigma_deg = 0.5, at_most = 8 }
extras = ["display_black"]
"""

BRACKET_PLAN = """kind = "flash"
bracket = { step_ev = 2, at_most = 4 }
extras = ["display_black"]
reconstruct = { operation = "hdr" }
"""

EXPOSURES_PLAN = """kind = "exposures"
exposures_ms = [2, 8]
extras = ["dark"]
"""

FREE_PLAN = """kind = "free"
steps = [
    { flash = true, exposure_ms = 4, display = { pattern = "black" } },
    { analyser_deg = 30, exposure_ms = 10, display = { diameter_mm = 120, center_mm = [10, 0] } },
]
"""

BOKEH_PLAN = """kind = "flash"
exposures_ms = [2, 8]
extras = ["display_black"]
reconstruct = { operation = "bokeh", options = { psf = { sigma = 1.5 }, iterations = { count = 3 } } }
"""

LUT_PLAN = """kind = "flash"
exposures_ms = [2, 8]
extras = ["display_black"]
reconstruct = { operation = "lut", options = { wavelength_nm = 550, scale = 0.01, size = 32, center = [30, 20], max_error = 1 } }
"""

SPOTS_PLAN = """kind = "spots"
name = "mosaic of periods"
spots = { fringes = { count = 8, phases = 4 } }
extras = ["display_black"]
reconstruct = { operation = "spots" }
"""

# --- Scenes of the simulated photographs ---------------------------------------------------------------------------------------

FLASH_SCENE = """seed = 3
width = 96
height = 96
pixel_um = 8000
coherence_um = 3
"""

BOKEH_SCENE = """seed = 4
profile = "sinusoid"
width = 160
height = 120
highlight_px = 90
period_um = 40
"""

FOIL_SCENE = """seed = 5
width = 160
height = 160
pixel_um = 1680
pattern = { spiral = [1.0, 1.45] }
"""

TILES_SCENE = """seed = 6
tiles = [6, 5]
width = 260
height = 200
coherence_um = 8
band_nm = 4
misaligned_px = 2
"""

NEAR = """camera_mm = 1000
flash_mm = 1000
baseline_mm = [60, 0]
pixel_um = 8000
"""

# --- Scenes and heights --------------------------------------------------------------------------------------------------------

RENDER_SCENE = """[camera]
position = [0, 0, 300]
target = [0, 0, 0]
fov_deg = 20
width = 32
height = 24
[[shape]]
type = "plane"
size = [80, 80]
material = "foil"
[[light]]
type = "point"
position = [0, 100, 280]
sigma_mm = 3
[material.foil.base]
albedo = [0.05, 0.05, 0.05]
[material.foil.diffraction]
type = "grating"
period_um = 1.6
orientation_deg = 90
relief = { depth_um = 0.1 }
coherence_um = 20
"""

def scene(shapes, materials, light):
    """A scene of shapes, each with one material, before a camera 300 mm away."""
    camera = "[camera]\nposition = [0, 0, 300]\ntarget = [0, 0, 0]\nfov_deg = 20\nwidth = 24\nheight = 18\n"
    tables = "".join(f"[[shape]]\n{shape}\n" for shape in shapes) + "".join(f"[[light]]\n{one}\n" for one in light)
    return camera + tables + "".join(f"[material.{name}]\n{text}\n" for name, text in materials.items())


SPOT = 'type = "spot"\nposition = [0, 100, 280]\ntarget = [0, 0, 0]\nbeam_deg = 30\nsigma_mm = 3'
SUN = 'type = "directional"\ndirection = [0, -0.3, -1]\nsigma_deg = 0.3\nspectrum = "A"'
WINDOW = 'type = "rectangle"\ncenter = [50, 80, 200]\nsize = [40, 40]\nnormal = [0, -0.3, -1]'
SKY = 'type = "environment"\nfile = "sky.hdr"\nturn_deg = 30'
SHEET = 'type = "plane"\nsize = [80, 60]\nmaterial = "sheet"'

SHAPES_SCENE = scene([
    'type = "disc"\ncenter = [-25, 15, 0]\nouter = 14\ninner = 4\nmaterial = "disc"',
    'type = "sphere"\ncenter = [10, 15, 0]\nradius = 12\nmaterial = "slits"',
    'type = "cylinder"\ncenter = [-15, -15, 0]\nradius = 10\nlength = 18\narc_deg = [0, 300]\nmaterial = "lattice"',
    'type = "mesh"\nfile = "quad.obj"\nposition = [15, -15, 0]\nrotation_deg = [0, 20, 0]\nmaterial = "heights"',
], {
    "disc": 'diffraction = { type = "cd", period_um = 1.6, relief = { depth_um = 0.12, profile = { rectangular = { duty = 0.4 } } } }',
    "slits": 'base = { albedo = [0.2, 0.1, 0.1] }\ncoverage = 0.7\ndiffraction = { type = "multislit", count = 5 }',
    "lattice": 'blend = "fresnel"\nbase = { roughness = 0.5 }\n'
               'diffraction = { type = "lattice", period_um = [4, 6], aperture_um = [2, 3], coherence_um = 20 }',
    "heights": 'diffraction = { type = "heightfield", file = "heights.txt", pixel_um = 0.09, range_um = 0.1, coherence_um = 6 }',
}, [SPOT, SUN])

MAPS_SCENE = scene([SHEET], {
    "sheet": 'diffraction = { type = "grating", maps = "squares", relief = { depth_um = 0.1, profile = "blazed" }, coherence_um = 20, '
             'reflectance = "aluminium" }',
}, [WINDOW])

TABLE_SCENE = scene([SHEET], {
    "sheet": 'base = { albedo = [0.1, 0.1, 0.1] }\ncoverage = 0.5\ndiffraction = { type = "table", file = "table/lut.exr", albedo = 0.8 }',
}, [SKY])

QUAD = "v -10 -10 0\nv 10 -10 0\nv 10 10 2\nv -10 10 2\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3\nf 1/1 3/3 4/4\n"

HEIGHTS = "\n".join(" ".join(f"{((x * x + 3 * y * x + 7 * y) % 23) / 100:.2f}" for x in range(24)) for y in range(24)) + "\n"
SECTION = "x_um,height_um\n0,0\n0.5,0.1\n1.25,0.2\n2,0.05\n2.5,0\n"
LAMP = "wavelength_nm,power\n500,0\n540,1\n560,1\n600,0\n"
FILTER = "wavelength_nm,transmission\n530,0\n545,0.9\n555,0.9\n570,0\n"
PERIODS = "orientation_deg,period_um\n0,0.9\n60,1.1\n120,1.4\n180,0.9\n"

# --- Pictures ------------------------------------------------------------------------------------------------------------------


def lazy(make, *arguments):
    """An input that is computed when its case runs."""
    return lambda: make(*arguments)


def png(width, height, rows, bits=8, color=False, exif=None):
    """Encodes rows of integers (grey, or red, green, blue one after another) as PNG, with an Exif block if given."""
    def chunk(name, data):
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    row = "B" if bits == 8 else "H"
    data = b"".join(b"\0" + struct.pack(f">{len(values)}{row}", *values) for values in rows)
    header = chunk(b"IHDR", struct.pack(">2I5B", width, height, bits, 2 if color else 0, 0, 0, 0))
    tags = chunk(b"eXIf", exif) if exif else b""
    return b"\x89PNG\r\n\x1a\n" + header + tags + chunk(b"IDAT", zlib.compress(data)) + chunk(b"IEND", b"")


def noisy(electrons, seed, exif=None, side=24):
    """A photograph of even light with 0.5 DN per electron, 5 electrons of read noise and a black of 100 DN."""
    random, deviation = Random(seed), isqrt(10_000 * (electrons + 25))
    # Twelve uniform numbers have nearly a normal sum, here of the standard deviation 1000; electrons are in 1/100,000.
    normal = lambda: sum(random.randrange(1001) for _ in range(12)) - 6000
    code = lambda: 100 + (100_000 * electrons + deviation * normal() + 100_000) // 200_000
    return png(side, side, [[code() for _ in range(side)] for _ in range(side)], 16, exif=exif)


def environment(width=32, height=16):
    """A lat-long environment as Radiance HDR, not compressed: a bright window in a gradient."""
    def pixel(x, y):
        exponent = 131 if 8 <= x < 12 and 3 <= y < 7 else 127
        return bytes([100 + 3 * x, 120 + 4 * y, 200 - 2 * x, exponent])
    header = f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n".encode()
    return header + b"".join(pixel(x, y) for y in range(height) for x in range(width))


def exif(numerator, denominator, iso):
    """An Exif block with exposure time and sensitivity (TIFF 6.0, little endian)."""
    def field(tag, kind, value):
        return struct.pack("<2H2I", tag, kind, 1, value)

    pointer = struct.pack("<H", 1) + field(0x8769, 4, 26) + struct.pack("<I", 0)
    tags = struct.pack("<H", 2) + field(0x829A, 5, 56) + field(0x8827, 3, iso) + struct.pack("<I", 0)
    return b"II*\0" + struct.pack("<I", 8) + pointer + tags + struct.pack("<2I", numerator, denominator)


def analysed(angle_index, color=False):
    """A photograph behind an analyser at 0, 45, 90 or 135 degrees: Malus' law with sines that are whole thousandths."""
    def code(x, y):
        cosine, sine = [(800, 600), (600, -800), (-280, 960), (-960, 280)][(x // 16 + y // 12) % 4]
        wave = [cosine, sine, -cosine, -sine][angle_index]
        return 90 + 4 * (x % 8) + wave * (20 + y) // 1000
    rows = [[code(x, y) for x in range(64)] for y in range(48)]
    if color:
        rows = [[part for grey in row for part in (grey // 2, grey, grey // 3)] for row in rows]
    return png(64, 48, rows, color=color)


def sensor():
    """A raw frame of a polarization sensor: 2 x 2 blocks of 90, 45, 135, 0 degrees."""
    def code(x, y):
        wave = {(0, 0): -800, (1, 0): 600, (0, 1): -600, (1, 1): 800}[x % 2, y % 2]
        return 30000 + 50 * (x // 2) + wave * (5 + y // 2)
    return png(64, 48, [[code(x, y) for x in range(64)] for y in range(48)], 16)


def bracket(exposure, tags=None):
    """A grey wedge at an exposure, saturated where it is bright."""
    return png(128, 32, exif=tags, rows=[[min(255, (x * x + 40 + (x * 31 + y * 17) % 5) * exposure // 256) for x in range(128)] for y in range(32)])


def exposures_json(exposures):
    frames = ", ".join(f'{{ "file": "{k}.png", "exposure_s": {time} }}' for k, time in enumerate(exposures))
    return f'{{ "kind": "exposures", "transfer": "linear", "frames": [{frames}] }}\n'


def orders(width=64):
    """Orders on a square lattice around a zero order, in three colours whose orders lie apart."""
    def code(x, y, pitch):
        u, v = x - width // 2, y - width // 2
        m, n = (2 * u + pitch) // (2 * pitch), (2 * v + pitch) // (2 * pitch)
        square = (u - m * pitch) ** 2 + (v - n * pitch) ** 2
        return 60000 // ((1 + 2 * (m * m + n * n)) * (1 + square) ** 2)
    return png(width, width, [[code(x, y, pitch) for x in range(width) for pitch in (12, 11, 9)] for y in range(width)], 16, True)


def highlight(cx, cy, width=320, height=240):
    """A round highlight, overexposed in its middle."""
    def code(x, y):
        square = (x - cx) ** 2 + (y - cy) ** 2
        return min(255, 72000 // (square + 80)) if square < 2500 else 0
    return png(width, height, [[code(x, y) for x in range(width)] for y in range(height)])


def board(turn, shift, width=320, height=240, focal=300):
    """A chessboard of 9 x 6 inner corners, 25 mm squares, seen by a pinhole camera.

    `turn` = (a, b) turns the board about y and x by angles whose sines are rational (tan(t/2) = a/40 and b/40), so that every
    ray is computed in integers. Each pixel is the mean of 3 x 3 rays.
    """
    def rational(part):
        return 1600 - part * part, 80 * part, 1600 + part * part  # cosine, sine, hypotenuse

    (ca, sa, na), (cb, sb, nb) = rational(turn[0]), rational(turn[1])
    # Columns of R = Ry(a) Rx(b) times na nb: the board's x axis, its y axis and its normal in the camera's frame.
    ex = (ca * nb, 0, -sa * nb)
    ey = (sa * sb, cb * na, ca * sb)
    n = (sa * cb, -sb * na, ca * cb)
    tx, ty, tz = shift
    offset = n[0] * tx + n[1] * ty + n[2] * tz
    scale = na * nb

    def white(u, v):
        # The ray (u, v, 6 focal) meets the plane at distance offset / slope of its own lengths.
        ray = (u, v, 6 * focal)
        slope = sum(a * b for a, b in zip(n, ray))
        if slope <= 0:
            return True
        point = [offset * r - slope * t for r, t in zip(ray, shift)]
        x = sum(a * b for a, b in zip(ex, point))
        y = sum(a * b for a, b in zip(ey, point))
        unit = 25 * slope * scale
        column, row = (2 * x + 10 * unit) // (2 * unit), (2 * y + 7 * unit) // (2 * unit)
        return not (0 <= column < 10 and 0 <= row < 7 and (column + row) % 2 == 0)

    # Rays through the corners of the pixels: only where they differ, more are needed.
    corners = [[white(6 * x - 3 * width, 6 * y - 3 * height) for x in range(width + 1)] for y in range(height + 1)]

    def code(x, y):
        around = {corners[y][x], corners[y][x + 1], corners[y + 1][x], corners[y + 1][x + 1]}
        if len(around) == 1:
            return 210 if around.pop() else 30
        rays = [(6 * x - 3 * width + 2 * i + 1, 6 * y - 3 * height + 2 * j + 1) for i in range(3) for j in range(3)]
        return 30 + 20 * sum(white(u, v) for u, v in rays)

    return png(width, height, [[code(x, y) for x in range(width)] for y in range(height)])


BOARDS = [((0, 0), (0, 0, 420)), ((10, 0), (10, 5, 430)), ((-10, 4), (-15, 0, 430)), ((2, 10), (5, -10, 440)), ((-3, -10), (0, 12, 440)), ((8, 8), (-8, 6, 460))]
