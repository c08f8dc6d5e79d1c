"""Writes the first inputs and the dictionary of each target: python3 seeds.py FOLDER. Files are built from their formats' descriptions, texts
are those of the golden corpus."""

import base64
import io
import json
import pathlib
import struct
import sys
import zipfile
import zlib

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "golden.d"))
import inputs as golden  # noqa: E402

EXPECTED = HERE.parent / "golden-expected"
WIDTH, HEIGHT = 5, 4
STEPS = range(WIDTH * HEIGHT)

# --- Photographs ---------------------------------------------------------------------------------------------------------------


def tiff(order, tags, data, exif=()):
    """A TIFF of one directory and one strip; a tag is (number, type, values)."""
    codes = {1: "B", 2: "B", 3: "H", 4: "I", 5: "I", 12: "d"}
    out = bytearray((b"II*\0" if order == "<" else b"MM\0*") + bytes(4) + data)

    def directory(tags):
        entries = b""
        for number, kind, values in sorted(tags):
            packed = struct.pack(f"{order}{len(values)}{codes[kind]}", *values)
            count = len(values) // 2 if kind == 5 else len(values)
            if len(packed) > 4:
                out.extend(bytes(len(out) % 2))
                place = struct.pack(order + "I", len(out))
                out.extend(packed)
            else:
                place = packed.ljust(4, b"\0")
            entries += struct.pack(order + "HHI", number, kind, count) + place
        out.extend(bytes(len(out) % 2))
        at = len(out)
        out.extend(struct.pack(order + "H", len(tags)) + entries + bytes(4))
        return at

    more = [(34665, 4, [directory(exif)])] if exif else []
    tiled = any(tag[0] == 322 for tag in tags)
    strip = [] if tiled else [(273, 4, [8]), (279, 4, [len(data)])]
    first = directory([*tags, *strip, *more])
    struct.pack_into(order + "I", out, 4, first)
    return bytes(out)


def grey(bits, compression=1, *more, width=WIDTH, height=HEIGHT, photometric=1, samples=1):
    return [(256, 4, [width]), (257, 4, [height]), (258, 3, [bits] * samples), (259, 3, [compression]), (262, 3, [photometric]),
            (277, 3, [samples]), (278, 4, [height]), *more]


def lzw(data):
    """Literals between a clear and an end code, 9 bits each; short enough for that."""
    codes = "".join(f"{code:09b}" for code in (256, *data, 257))
    return int(codes.ljust(-(-len(codes) // 8) * 8, "0"), 2).to_bytes(-(-len(codes) // 8), "big")


EXPOSED = [(33434, 5, [1, 125]), (33437, 5, [56, 10]), (34855, 3, [200])]


def tiffs():
    words = struct.pack(f"<{len(STEPS)}H", *(v * 3000 for v in STEPS))
    floats = struct.pack(f"<{len(STEPS)}f", *(v / 7 for v in STEPS))
    small = bytes(STEPS)
    yield tiff("<", grey(16), words, EXPOSED)
    yield tiff(">", grey(16), words)
    yield tiff("<", grey(16, 8, (317, 3, [2])), zlib.compress(words))
    yield tiff("<", grey(32, 32946, (339, 3, [3]), (317, 3, [3])), zlib.compress(floats))
    yield tiff("<", grey(32, 1, (339, 3, [3])), floats)
    yield tiff("<", grey(16, 1, (339, 3, [2])), words)
    yield tiff("<", grey(8, 32773), bytes([len(small) - 1]) + small)
    yield tiff("<", grey(8, 5), lzw(small))
    yield tiff("<", grey(12), bytes(30))
    yield tiff("<", grey(8, photometric=2, samples=3), small * 3)
    tiles = [(322, 3, [16]), (323, 3, [16]), (324, 4, [8]), (325, 4, [256])]
    yield tiff("<", [t for t in grey(8) if t[0] != 278] + tiles, bytes(256))


def raws():
    data = struct.pack("<96H", *range(600, 600 + 96 * 37, 37))
    mosaic = [(254, 4, [0]), (271, 2, b"Nacre\0"), (272, 2, b"Test\0"), (33421, 3, [2, 2]), (33422, 1, [0, 1, 1, 2])]
    tags = grey(16, 1, *mosaic, width=12, height=8, photometric=32803)
    levels = [(50706, 1, [1, 4, 0, 0]), (50714, 3, [512]), (50717, 3, [4095])]
    yield 0, tiff("<", tags + levels, data, EXPOSED)[4:]
    yield 1, tiff(">", tags + levels, data)[4:]
    for make in (b"NIKON CORPORATION\0", b"SONY\0", b"PENTAX\0", b"SAMSUNG\0", b"EPSON\0"):
        yield 0, tiff("<", [t for t in tags if t[0] != 271] + [(271, 2, make)], data)[4:]
    for kind in range(2, 8):
        yield kind, bytes(range(64)) + data


def exr(kind, channels, width=WIDTH, height=HEIGHT, compression=0, more=()):
    """Scan lines; values rise. Compressed ones (2, 3) are predicted and deflated."""
    def attribute(name, type_name, value):
        return name.encode() + b"\0" + type_name.encode() + b"\0" + struct.pack("<i", len(value)) + value

    lists = b"".join(c.encode() + b"\0" + struct.pack("<iB3xii", kind, 0, 1, 1) for c in sorted(channels)) + b"\0"
    box = struct.pack("<4i", 0, 0, width - 1, height - 1)
    head = b"".join([
        b"\x76\x2f\x31\x01\x02\0\0\0", attribute("channels", "chlist", lists), attribute("compression", "compression", bytes([compression])),
        attribute("dataWindow", "box2i", box), attribute("displayWindow", "box2i", box), attribute("lineOrder", "lineOrder", b"\0"),
        attribute("pixelAspectRatio", "float", struct.pack("<f", 1)), attribute("screenWindowCenter", "v2f", bytes(8)),
        attribute("screenWindowWidth", "float", struct.pack("<f", 1)), *(attribute(n, "string", t.encode()) for n, t in more), b"\0"])
    code = "Ief"[kind]
    rows = [b"".join(struct.pack(f"<{width}{code}", *(x + y + 1 for x in range(width))) for _ in channels) for y in range(height)]
    step = 16 if compression == 3 else 1
    blocks = []
    for y in range(0, height, step):
        data = b"".join(rows[y:y + step])
        if compression:
            split = data[::2] + data[1::2]
            data = zlib.compress(bytes([split[0], *((b - a + 128) & 255 for a, b in zip(split, split[1:]))]))
        blocks.append(struct.pack("<ii", y, len(data)) + data)
    at, table = len(head) + 8 * len(blocks), b""
    for block in blocks:
        table += struct.pack("<Q", at)
        at += len(block)
    return head + table + b"".join(blocks)


def exrs():
    for kind in range(3):
        yield exr(kind, "RGB")
    yield exr(2, "Y", compression=2)
    yield exr(1, "RGB", compression=3)
    yield exr(1, "RGB", 8, 4)
    yield exr(2, ["height"], more=[("pixel_um", "0.1")])
    yield exr(2, ["orientation"], more=[("nacre", "orientation")])
    yield exr(2, ["period", "mask"])
    yield exr(2, ["share", "sigma", "coverage"], more=[("first_lines_per_um", "0.5"), ("last_lines_per_um", "1.5"), ("periods", "relative")])
    yield exr(1, ["X", "Y", "Z", "coverage"], 32, 32, more=[("extent", "1"), ("warp", "3"), ("illuminant", "D65"), ("white", "0.95 1 1.09")])
    yield exr(2, ["left.R", "left.G", "left.B", "right.R", "right.G", "right.B"])


def npy(kind, shape, data):
    text = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}".encode()
    text = text.ljust(-(-(len(text) + 11) // 64) * 64 - 11) + b"\n"
    return b"\x93NUMPY\x01\0" + struct.pack("<H", len(text)) + text + data


def fits(bits, data, *more):
    cards = ["SIMPLE  =                    T", f"BITPIX  = {bits:20}", "NAXIS   =                    2", f"NAXIS1  = {WIDTH:20}",
             f"NAXIS2  = {HEIGHT:20}", *more, "END"]
    return "".join(c.ljust(80) for c in cards).ljust(2880).encode() + data.ljust(2880, b"\0")


def bmp(bits, data, palette=b"", compression=0):
    begin = 54 + len(palette)
    return struct.pack("<2sI4xI", b"BM", begin + len(data), begin) + struct.pack("<IiiHHIIiiII", 40, 4, 3, 1, bits, compression, len(data), 0, 0, len(palette) // 4, 0) + palette + data


def plains():
    """Formats of parsers of our own, each with its place in the target's list and without its mark."""
    count = len(STEPS)
    yield 0, golden.environment(4, 2)[2:]
    run = b"\x02\x02\0\x08" + b"\x88\x40" * 4
    yield 0, b"#?RADIANCE\nEXPOSURE=2\nPRIMARIES=0.64 0.33 0.3 0.6 0.15 0.06 0.3127 0.329\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 8\n"[2:] + run * 4
    for bits, data, palette in ((24, bytes(36), b""), (32, bytes(48), b""), (8, bytes(12), bytes(1024)), (1, bytes(12), bytes(8))):
        yield 1, bmp(bits, data, palette)[2:]
    yield 1, bmp(8, b"\x04\x07\0\0\x04\x05\0\0\x04\x03\0\x01", bytes(1024), 1)[2:]
    yield 2, fits(16, struct.pack(f">{count}h", *STEPS), "BZERO   =              32768.0", "BSCALE  =                  1.0")[9:]
    yield 2, fits(-32, struct.pack(f">{count}f", *STEPS))[9:]
    yield 2, fits(8, bytes(STEPS), "BLANK   =                    7")[9:]
    for kind, code in (("<u2", "<H"), (">f4", ">f"), ("|u1", "<B"), ("<f8", "<d")):
        yield 3, npy(kind, (HEIGHT, WIDTH), b"".join(struct.pack(code, v) for v in STEPS))[6:]
    yield 3, npy("<u2", (2, 2, 3), bytes(24))[6:]


def jpegs():
    yield (HERE.parents[1] / "drivers/src/camera/v4l2/grey.jpg").read_bytes()


def payloads():
    """Frames of cameras: a JPEG file, and padded rows of Y10P after a header. Format, width, height, stride, used bytes and header come first."""
    yield struct.pack("<BBBHII", 51, 16, 8, 0, 0, 0) + next(jpegs())
    yield struct.pack("<BBBHII", 30, 8, 2, 16, 36, 4) + bytes(range(36))


def pngs():
    yield golden.png(WIDTH, HEIGHT, [[x * 50 for x in range(WIDTH)]] * HEIGHT, exif=golden.exif(1, 125, 200))
    yield golden.png(WIDTH, HEIGHT, [[x * 4000 for x in range(3 * WIDTH)]] * HEIGHT, 16, True)


WEBP = base64.b64decode("UklGRhoAAABXRUJQVlA4TA0AAAAvAAAAEAcQERGIiP4HAA==")

# --- Heights -------------------------------------------------------------------------------------------------------------------


def heights():
    nm = [v * v % 23 for v in STEPS]
    yield "\n".join(golden.HEIGHTS.splitlines()[:4]).encode()
    yield b"# Kanal: H\xc3\xb6he\n# Breite: 0.5 \xc2\xb5m\n# H\xc3\xb6he: 0.4 \xc2\xb5m\n# Value units: m\n" + b"\n".join(
        b"\t".join(b"%de-9" % v for v in nm[y * WIDTH:][:WIDTH]) for y in range(HEIGHT))
    yield "".join(f"{k % WIDTH * 0.1:.1f} {k // WIDTH * 0.1:.1f} {v / 1000}\n" for k, v in enumerate(nm)).encode()
    yield "x;z\n".encode() + b"".join(b"%d,5;0,%03d\n" % (k, v) for k, v in enumerate(nm))
    rows = "\n".join(" ".join(map(str, nm[y * WIDTH:][:WIDTH])) for y in range(HEIGHT))
    yield f"DSAA\n{WIDTH} {HEIGHT}\n0 4\n0 3\n0 18\n{rows}\n".encode()
    yield struct.pack("<4shh6d", b"DSBB", WIDTH, HEIGHT, 0, 4, 0, 3, 0, 18) + struct.pack(f"<{len(nm)}f", *nm)
    yield struct.pack("<4siiii8d", b"DSRB", 4, 1, 0x44495247, 72, *[1.0] * 8)
    yield (f"fileformat = bcrf\nheadersize = 256\nxpixels = {WIDTH}\nypixels = {HEIGHT}\nxlength = 500\nylength = 400\nxunit = nm\nyunit = nm\n"
           "zunit = nm\nbit2nm = 1\nintelmode = 1\n").encode().ljust(256, b"%") + struct.pack(f"<{len(nm)}f", *nm)
    yield struct.pack("<8s10s12s12sHHddddbbb", b"bISO-1.0", b"someone", b"010120250000", b"010120250000", WIDTH, HEIGHT, 1e-7, 1e-7, 1e-9,
                      1e-12, 0, 7, 0) + struct.pack(f"<{len(nm)}d", *nm)
    yield (f"aISO-1.0\nManufacID = someone\nNumPoints = {WIDTH}\nNumProfiles = {HEIGHT}\nXscale = 1e-7\nYscale = 1e-7\nZscale = 1e-9\n"
           f"Zresolution = 1e-12\nCompression = 0\nDataType = 7\nCheckType = 0\n*\n{rows}\n*\n").encode()
    data = struct.pack(f"<{len(nm)}h", *nm)
    yield ("\\*File list\r\n\\Version: 0x09300201\r\n\\*Ciao scan list\r\n\\@Sens. Zsens: V 50.00 nm/V\r\n\\*Ciao image list\r\n\\Data offset: 512\r\n"
           f"\\Data length: {len(data)}\r\n\\Bytes/pixel: 2\r\n\\Samps/line: {WIDTH}\r\n\\Number of lines: {HEIGHT}\r\n\\Scan Size: 0.5 0.4 ~m\r\n"
           "\\@2:Image Data: S [Height] \"Height\"\r\n\\@2:Z scale: V [Sens. Zsens] (0.000122070 V/LSB) 8.000 V\r\n\\*File list end\r\n"
           ).encode().ljust(512, b"\x1a") + data
    yield (f"[DataSet]\r\nVersion=2\r\nGroupCount=1\r\nGr0-Count=1\r\nGr0-Ch0=DataSet-0:0\r\n[DataSet-0:0]\r\nVersion=2\r\nPoints={WIDTH}\r\n"
           f"Lines={HEIGHT}\r\nFrame=Scan forward\r\nDim0Unit=m\r\nDim0Range=5e-7\r\nDim1Unit=m\r\nDim1Range=4e-7\r\nDim2Name=Z-Axis\r\nDim2Unit=m\r\n"
           "Dim2Range=4e-7\r\nDim2Min=-2e-7\r\nSaveMode=Binary\r\nSaveBits=16\r\nSaveSign=Signed\r\nSaveOrder=Intel\r\n#!").encode() + data
    yield gwyddion(nm)
    for order in "<>":
        yield igor(order, nm)
    for listed in (False, True):
        yield x3p(nm, listed)


def gwyddion(nm):
    def part(name, kind, data):
        return name.encode() + b"\0" + kind + data

    def thing(name, *parts):
        inside = b"".join(parts)
        return name.encode() + b"\0" + struct.pack("<I", len(inside)) + inside

    def unit(name):
        return part(name, b"o", thing("GwySIUnit", part("unitstr", b"s", b"m\0")))

    field = thing("GwyDataField", part("xres", b"i", struct.pack("<i", WIDTH)), part("yres", b"i", struct.pack("<i", HEIGHT)),
                  part("xreal", b"d", struct.pack("<d", 5e-7)), part("yreal", b"d", struct.pack("<d", 4e-7)), unit("si_unit_xy"), unit("si_unit_z"),
                  part("data", b"D", struct.pack(f"<I{len(nm)}d", len(nm), *(v * 1e-9 for v in nm))))
    return b"GWYP" + thing("GwyContainer", part("/0/data", b"o", field), part("/0/data/title", b"s", b"Height\0"))


def igor(order, nm):
    data = struct.pack(f"{order}{len(nm)}f", *(v * 1e-9 for v in nm))
    labels = b"".join(name.ljust(32, b"\0") for name in (b"", b"HeightRetrace"))
    head = struct.pack(order + "hh14i", 5, 0, 320 + len(data), 0, 0, 0, 0, 0, 0, 0, 0, 0, len(labels), 0, 0, 0) + bytes(4)
    wave = struct.pack(order + "3iihh6sh32sii4i8d", 0, 0, 0, len(nm), 2, 0, b"", 1, b"wave", 0, 0, WIDTH, HEIGHT, 1, 0, 1e-7, 1e-7, 1, 1, 0, 0, 0, 0)
    return head + (wave + struct.pack("4s4s4s4s4s", b"m", b"m", b"m", b"", b"")).ljust(320, b"\0") + data + labels


def x3p(nm, listed):
    def axis(name, kind, more):
        return f"<{name}><AxisType>{kind}</AxisType>{more}</{name}>"

    pitch = "<DataType>I</DataType><Increment>1e-7</Increment><Offset>0</Offset>"
    data = "<DataList>" + "".join(f"<Datum>{v}e-9</Datum>" for v in nm) + "</DataList>"
    if not listed:
        data = "<DataLink><PointDataLink>bindata/data.bin</PointDataLink></DataLink>"
    text = ('<?xml version="1.0" encoding="UTF-8"?><p:ISO5436_2 xmlns:p="http://www.opengps.eu/2008/ISO5436_2"><Record1><FeatureType>SUR</FeatureType><Axes>'
            + axis("CX", "I", pitch) + axis("CY", "I", pitch) + axis("CZ", "A", "<DataType>D</DataType>")
            + f"</Axes></Record1><Record3><MatrixDimension><SizeX>{WIDTH}</SizeX><SizeY>{HEIGHT}</SizeY><SizeZ>1</SizeZ></MatrixDimension>{data}</Record3></p:ISO5436_2>")
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        archive.writestr(zipfile.ZipInfo("main.xml"), text)
        archive.writestr(zipfile.ZipInfo("bindata/data.bin"), struct.pack(f"<{len(nm)}d", *(v * 1e-9 for v in nm)))
    return out.getvalue()

# --- Meshes --------------------------------------------------------------------------------------------------------------------


def meshes():
    yield 0, golden.QUAD.encode()
    yield 0, b"o a\nv 0 0 0 1 0 0\nv 1 0 0\nv 1 1 0\nv 0.5 0.2 0\nvn 0 0 1\ng b\ns 1\nusemtl c\nf -4//1 -3//1 -2//1 -1//1\nl 1 2\np 1\n"
    head = "ply\nformat {} 1.0\ncomment a\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nproperty float u\nproperty float v\n" \
           "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    yield 1, head.format("ascii").encode() + b"0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2\n"
    for name, order in (("binary_little_endian", "<"), ("binary_big_endian", ">")):
        yield 1, head.format(name).encode() + struct.pack(order + "15fB3i", *[0.0] * 5, 1, *[0.0] * 4, 0, 1, 0, 0, 0, 3, 0, 1, 2)
    data = struct.pack("<9f3H2x", 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 1, 2)
    uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()

    def document(buffer):
        return json.dumps({
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
            "nodes": [{"children": [1], "scale": [1, 2, 1]}, {"mesh": 0, "rotation": [0, 0, 0, 1], "translation": [1, 0, 0]}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "mode": 4}]}], "buffers": [buffer],
            "bufferViews": [{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 6}],
            "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]},
                          {"bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR"}]}).encode()

    yield 2, document({"byteLength": len(data), "uri": uri})
    text = document({"byteLength": len(data)})
    text += b" " * (-len(text) % 4)
    yield 3, struct.pack("<4sIIII", b"glTF", 2, 28 + len(text) + len(data), len(text), 0x4e4f534a) + text + struct.pack("<II", len(data), 0x004e4942) + data

# --- Texts ---------------------------------------------------------------------------------------------------------------------


def expected(*patterns):
    for pattern in patterns:
        for path in sorted(EXPECTED.glob(pattern)):
            yield path.read_bytes()


def scenes():
    yield from (text.encode() for text in (golden.RENDER_SCENE, golden.SHAPES_SCENE, golden.MAPS_SCENE, golden.TABLE_SCENE))
    yield from expected("gallery/gallery/*.toml")


def plans():
    texts = [text for name, text in sorted(vars(golden).items()) if name.endswith("_PLAN")]
    yield from (text.encode() for text in texts)
    yield from (json.dumps(json.loads(session)["plan"]).encode() for session in expected("capture/*/session.json"))


def sessions():
    for folder in ("free", "bracket", "until", "polarization", "bokeh"):
        yield b"\n=\n".join((EXPECTED / "capture" / folder / name).read_bytes() for name in ("session.json", "journal", "frames.json"))
    for text in expected("polarization/*/frames.json", "foil/photo/frames.json"):
        yield b"\n=\n\n=\n" + text


def configs():
    hardware = (HERE.parents[1] / "docs/guide/bench.md").read_text()
    blocks = [block.split("```")[0] for block in hardware.split("```toml\n")[1:]]
    yield from (b"0" + text for text in expected("bench/nacre.toml"))
    yield from (b"0" + block.encode() for block in blocks)
    yield from (b"1" + text.encode() for name, text in sorted(vars(golden).items()) if name.endswith("_BENCH") or name == "BENCH")
    yield from (b"1" + text for text in expected("demo/demo/session/bench.toml", "polarization/filmed/bench.toml"))
    yield from (b"2" + text for text in expected("calibrate/*.json", "flash/photos/geometry.json", "foil/photo/geometry.json"))


def tables():
    yield from (b"\0" + text.encode() for text in (golden.LAMP, golden.FILTER))
    yield b"\1" + golden.SECTION.encode()
    yield b"\2" + golden.PERIODS.encode()
    yield from (b"\3" + text[:600] for text in expected("hdr/recovered/response.json"))
    yield b'\3{"red": [0, 0.5, 1]}'
    yield from (b"\4" + text for text in expected("bokeh/*/calibration.json"))
    yield b"\5gain_um = 1.0\noffset = 0.5\n"
    yield from (b"\6" + text for text in expected("foil/pack/maps.json", "foil/linear/maps.json"))
    yield from (b"\7" + text for text in expected("brdf/terms/terms.json", "brdf/first/terms.json"))
    yield b'\x08{"analyser_errors_deg": [0, 1], "registration": {"corrected": true, "shifts_px": [[0, 1]]}, "sensor": {"demosaic": "bilinear"}}'

# --- Bench and service ---------------------------------------------------------------------------------------------------------


FRESH = '{"steady_since":{"secs":0,"nanos":0},"first_sequence":0,"duration":{"secs":0,"nanos":0}}'


def bench_requests():
    lines = ['"describe"', '"home"', '{"move_to":{"angle_deg":30}}', '"arrive"', '"halt"', '"position"', '"now"', '"is_on"', '"level"', '"light"',
             '{"configure":{"exposure":{"secs":0,"nanos":4000000},"gain":1.0}}', '{"cover":{"closed":true}}', '{"next_frame":{"fresh":' + FRESH + "}}",
             '{"show":{"pattern":"black"}}', '{"show":{"pattern":{"disc":{"diameter_mm":60,"center_mm":[10,0]}}}}', '{"switch":{"on":true}}']
    yield "\n".join(lines + [""]).encode()
    yield from ((line + "\n").encode() for line in lines)


def bench_answers():
    stamp = '{"sequence":9,"timestamp":{"secs":100,"nanos":0}}'
    yield b'\1{"Ok":{"frame":{"stamp":' + stamp.encode() + b',"width":2,"height":2,"damaged":false}}}\n' + bytes(8)
    yield b'\3{"Ok":{"at":{"secs":1,"nanos":5}}}\n{"Ok":{"at":{"secs":2,"nanos":5}}}\n'
    yield b'\2{"Ok":{"shown":{"since":{"secs":1,"nanos":0},"pattern":"black"}}}\n'
    yield b'\0{"Err":{"device":"a","command":"b","expected":"c","got":"d","remedy":"e","class":"lost"}}\n'


def example(document, schema, depth=0):
    """A value that a schema allows."""
    if not isinstance(schema, dict):
        return 1  # Left out of the golden corpus, as it depends on the time.
    if "$ref" in schema:
        schema = document["components"]["schemas"][schema["$ref"].rsplit("/", 1)[1]]
    for key in ("example", "default", "const"):
        if key in schema:
            return schema[key]
    for key in ("enum", "examples"):
        if schema.get(key):
            return schema[key][0]
    for key in ("oneOf", "anyOf", "allOf"):
        if schema.get(key):
            return example(document, next((s for s in schema[key] if s.get("type") != "null"), schema[key][0]), depth + 1)
    kinds = schema.get("type", "object")
    kind = kinds if isinstance(kinds, str) else kinds[0]
    if kind == "object":
        wanted = schema.get("properties", {}) if depth < 4 else {k: schema["properties"][k] for k in schema.get("required", [])}
        return {name: example(document, inner, depth + 1) for name, inner in wanted.items()}
    if kind == "array":
        return [example(document, schema.get("items", {}), depth + 1)] * max(1, schema.get("minItems", 1))
    return {"string": "a", "boolean": True, "null": None}.get(kind, max(1, schema.get("minimum", 1)))


def requests():
    document = json.loads((EXPECTED / "schema/openapi.json").read_text())
    for path, operations in document["paths"].items():
        for method, operation in operations.items():
            given = operation.get("parameters", []) if isinstance(operation, dict) else []
            place = path
            for name in ("id", "folder", "chart", "file", "name", "path"):
                place = place.replace("{" + name + "}", "01ARZ3NDEKTSV4RRFFQ69G5FAV" if name == "id" else "a.png")
            query = "&".join(f"{p['name']}={example(document, p.get('schema', {}))}" for p in given if p["in"] == "query")
            line = f"{method.upper()} {place}{'?' + query if query else ''}\n".replace(" ", "%20").replace("%20", " ", 1)
            content = operation.get("requestBody", {}).get("content", {})
            body = example(document, content["application/json"]["schema"]) if "application/json" in content else None
            yield line.encode() + (json.dumps(body).encode() if body is not None else b"")
    for plan in plans():
        key = "plan" if plan.startswith(b"{") else "toml"
        body = {key: json.loads(plan) if key == "plan" else plan.decode()}
        for verb in ("plans/check", "plans/estimate", "sessions"):
            yield f"POST /api/v1/{verb}\n".encode() + json.dumps(body).encode()
    part = '--b\r\nContent-Disposition: form-data; name="{}"; filename="{}"\r\n\r\n{}\r\n'
    upload = part.format("photographs", "000.png", "a") + part.format("frames", "frames.json", "{}") + "--b--\r\n"
    yield b"POST /api/v1/uploads\n" + upload.encode()

# --- All -----------------------------------------------------------------------------------------------------------------------


def marked(pairs):
    return (bytes([kind]) + data for kind, data in pairs)


def by_order(files):
    """For a target that puts the mark of a TIFF in front itself."""
    return (bytes([0 if data[:2] == b"II" else 1]) + data[4:] for data in files)


# --- Device servers ------------------------------------------------------------------------------------------------------------


def ccd_fits(width=2, height=2, more=("BZERO   = 32768",)):
    cards = ["SIMPLE  = T", "BITPIX  = 16", "NAXIS   = 2", f"NAXIS1  = {width}", f"NAXIS2  = {height}", "EXPTIME = 0.05", *more, "END"]
    header = "".join(f"{card:<80}" for card in cards).encode()
    return header.ljust(2880) + bytes(range(2 * width * height))


def indi_messages():
    vector = '<defNumberVector device="R" name="A" state="Idle"><defNumber name="X" min="0" max="360">1:30</defNumber></defNumberVector>'
    update = '<!-- it\'s --><setNumberVector device="R" name="A" state="Busy"><oneNumber name="X">\n5\n</oneNumber></setNumberVector>'
    blob = '<setBLOBVector device="R" name="CCD1"><oneBLOB name="CCD1" size="2888" format="{}">{}</oneBLOB></setBLOBVector>'
    plain, packed = (base64.b64encode(data).decode() for data in (ccd_fits(), zlib.compress(ccd_fits())))
    texts = [vector + update, '<delProperty device="R"/>', blob.format(".fits", plain), blob.format(".fits.z", packed)]
    return [b"\7\0" + text.encode() for text in texts] + [b"\0\0" + ccd_fits(), b"\0\0" + ccd_fits(more=["ROWORDER= 'BOTTOM-UP'"])]


def alpaca_answers():
    listed = b'{"Value":[{"DeviceName":"R","DeviceType":"Rotator","DeviceNumber":0,"UniqueID":"u"}],"ErrorNumber":0,"ErrorMessage":""}'
    head = b"HTTP/1.1 200 OK\r\nContent-Type: application/json\r\n"
    sized = head + b"Content-Length: %d\r\n\r\n" % len(listed) + listed
    chunked = head + b"Transfer-Encoding: chunked\r\n\r\n%x\r\n" % len(listed) + listed + b"\r\n0\r\n\r\n"
    picture = struct.pack("<11i", 1, 0, 1, 1, 44, 2, 8, 2, 2, 3, 0) + bytes(12)
    return [sized, chunked, listed, b'{"AlpacaPort":11111}', picture]


SEEDS = {
    "image": lambda: [*pngs(), *jpegs(), WEBP, *tiffs(), *exrs(), golden.environment(4, 2)],
    "image_plain": lambda: marked(plains()),
    "image_exr": lambda: (data[4:] for data in exrs()),
    "image_tiff": lambda: by_order(tiffs()),
    "image_raw": lambda: marked(raws()),
    "exif": lambda: [golden.exif(1, 125, 200), tiff("<", grey(8), b"", EXPOSED), tiff(">", [(274, 3, [6])], b"", EXPOSED)],
    "mesh": lambda: marked(meshes()),
    "scene": scenes,
    "plan": plans,
    "session": sessions,
    "config": configs,
    "heights": heights,
    "tables": tables,
    "bench_requests": bench_requests,
    "bench_answers": bench_answers,
    "rest": requests,
    "v4l2_payload": payloads,
    "alpaca": alpaca_answers,
    "indi": indi_messages,
}

# Schemas whose words a target's inputs are made of.
SCHEMAS = {"scene": ["scene"], "plan": ["plan"], "session": ["plan", "frames"], "config": ["config", "bench", "geometry"], "rest": ["plan"]}


def words(node):
    """Keys and names that a schema allows."""
    if isinstance(node, dict):
        yield from node.get("properties", {})
        yield from (word for word in [*node.get("enum", []), node.get("const")] if isinstance(word, str))
        for inner in node.values():
            yield from words(inner)
    elif isinstance(node, list):
        for inner in node:
            yield from words(inner)


def main(out):
    for target, make in SEEDS.items():
        folder = out / target
        folder.mkdir(parents=True, exist_ok=True)
        for k, data in enumerate(make()):
            (folder / f"{k:03}").write_bytes(data)
    for target, names in SCHEMAS.items():
        found = {word for name in names for word in words(json.loads((EXPECTED / f"schema/{name}.json").read_text()))}
        (out / f"{target}.dict").write_text("".join(f'"{word}"\n' for word in sorted(found) if word.isascii() and '"' not in word and "\\" not in word))


if __name__ == "__main__":
    main(pathlib.Path(sys.argv[1]))
