"""TIFF and BigTIFF of the types, layouts, byte orders, compressions and predictors that tifffile writes, and of Pillow's fax methods."""

import io
import itertools

import numpy
import PIL.Image
import tifffile
from matrix import picture

LAYOUTS = {"strips": {"rowsperstrip": 8}, "tiles": {"tile": (16, 32)}}
PLANES = {"contig": {}, "separate": {"planarconfig": "separate"}}
FILES = [{"byteorder": order, "bigtiff": big} for order in "<>" for big in [False, True]]
READ = ["u1", "u2", "f2", "f4", "f8"]
SIGNED = {"i1": "8-bit signed", "i2": "16-bit signed", "i4": "32-bit signed", "u4": "32-bit unsigned"}
CODECS = ["none", "lzw", "deflate", "packbits"]
UNREAD = {
    "zstd": "Zstandard",
    "lzma": "LZMA",
    "webp": "WebP",
    "jpegxl": "JPEG XL",
    "jpeg2000": "JPEG 2000",
    "lerc": "LERC",
    "png": "PNG",
    "jpegxr": "JPEG XR",
}
NAMES = {"u1": "8-bit", "u2": "16-bit", "f2": "half", "f4": "float", "f8": "double"}
INTEGERS = ("TIFF", "signed, 32 and 64-bit integers, complex numbers")
COLOURS = ("TIFF", "CMYK, CIE L\\*a\\*b\\*, palette, other numbers of channels")
METHODS = ("TIFF", f"{', '.join(UNREAD.values())} compression")
# Rounding of the inverse DCT (see jpeg_kinds).
JPEG = "within 3"


def tiff(values, **options):
    """The file's bytes and the values that tifffile reads from it."""
    channels = 1 if values.ndim == 2 else values.shape[2]
    options.setdefault("photometric", "rgb" if channels >= 3 else "minisblack")
    if channels in (2, 4):
        options["extrasamples"] = ["unassalpha"]
    stored = numpy.moveaxis(values, 2, 0) if options.get("planarconfig") and channels > 1 else values
    if channels == 1 or not options.get("planarconfig"):
        options.pop("planarconfig", None)
    elif "planarconfig" not in options:
        options["planarconfig"] = "contig"
    if channels == 2 and "planarconfig" not in options:
        options["planarconfig"] = "contig"
    file = io.BytesIO()
    tifffile.imwrite(file, stored, metadata=None, **options)
    content = file.getvalue()
    back = tifffile.imread(io.BytesIO(content), key=0)
    if options.get("planarconfig") == "separate":
        back = numpy.moveaxis(back, 0, 2)
    return content, back


def read_types(matrix):
    for kind, channels, layout, planes, file, codec in itertools.product(
        READ, [1, 2, 3, 4], LAYOUTS, PLANES, FILES, CODECS
    ):
        if channels == 1 and planes == "separate":
            continue
        values = picture(kind, channels)
        predictors = [1] if codec in ("none", "packbits") else [1, 3] if kind[0] == "f" else [1, 2]
        for predictor in predictors:
            options = dict(LAYOUTS[layout], **PLANES[planes], **file)
            if codec != "none":
                options.update(compression=codec, predictor=predictor)
            content, back = tiff(values, **options)
            assert numpy.array_equal(back, values)
            codecs = f"no compression, LZW, Deflate, PackBits; predictor {3 if kind[0] == 'f' else 2}"
            row = f"{NAMES[kind]}; 1 to 4 channels, strips, tiles, planes, both byte orders, BigTIFF; {codecs}"
            big = "big" if file["bigtiff"] else "classic"
            order = {"<": "le", ">": "be"}[file["byteorder"]]
            name = f"{kind}-{channels}-{layout}-{planes}-{big}-{order}-{codec}-{predictor}.tif"
            matrix.add(("TIFF", row), name, content, back)


def unread_types(matrix):
    for (kind, words), channels, layout, file in itertools.product(SIGNED.items(), [1, 3], LAYOUTS, FILES):
        content, _ = tiff(picture(kind, channels), **LAYOUTS[layout], **file)
        matrix.add(INTEGERS, f"{kind}.tif", content, expectation=f"refused {words} integers")
    for kind in ["u8", "i8"]:
        words = {"u": "64-bit unsigned", "i": "64-bit signed"}[kind[0]]
        content, _ = tiff(picture(kind, 1))
        matrix.add(INTEGERS, f"{kind}.tif", content, expectation=f"refused {words} integers")
    for kind in ["c8", "c16"]:
        content, _ = tiff(picture("f4", 1).astype(kind))
        matrix.add(INTEGERS, f"{kind}.tif", content, expectation="refused complex")
    for photometric, channels, words in [("separated", 4, "CMYK"), ("cielab", 3, "CIE L*a*b*"), ("palette", 1, "palette")]:
        options = {"colormap": numpy.zeros((3, 256), "u2")} if words == "palette" else {}
        values = picture("u1", channels)
        file = io.BytesIO()
        tifffile.imwrite(file, values, photometric=photometric, metadata=None, **options)
        matrix.add(COLOURS, f"{photometric}.tif", file.getvalue(), expectation=f"refused {words}")
    file = io.BytesIO()
    tifffile.imwrite(file, picture("u2", 7), photometric="minisblack", planarconfig="contig", metadata=None)
    matrix.add(COLOURS, "seven.tif", file.getvalue(), expectation="refused 7 channels")


def unread_codecs(matrix):
    for (codec, words), channels in itertools.product(UNREAD.items(), [1, 3]):
        if (codec, channels) == ("webp", 1):
            continue
        content, _ = tiff(picture("u1", channels), compression=codec)
        matrix.add(METHODS, f"{codec}.tif", content, expectation=f"refused {words}")


def jpeg_and_fax(matrix):
    for channels, layout, file in itertools.product([1, 3], LAYOUTS, FILES):
        content, back = tiff(picture("u1", channels), compression="jpeg", **LAYOUTS[layout], **file)
        matrix.add(("TIFF", "8-bit; JPEG"), f"jpeg-{channels}.tif", content, back, JPEG)
    black_and_white = picture("u1", 1) > 128
    for method, words in {"group3": "CCITT Group 3", "tiff_ccitt": "CCITT Group 3", "group4": "CCITT Group 4"}.items():
        file = io.BytesIO()
        PIL.Image.fromarray(black_and_white).save(file, "TIFF", compression=method)
        expectation = "equal" if method == "group4" else f"refused {words}"
        matrix.add(("TIFF", f"1-bit; {words}"), f"{method}.tif", file.getvalue(), black_and_white.astype("u1"), expectation)


def packed(matrix):
    for bits, channels, order, layout in itertools.product(range(2, 16), [1, 3], "<>", LAYOUTS):
        if bits == 8:
            continue
        kind = "u1" if bits < 8 else "u2"
        values = picture(kind, channels) >> (8 * int(kind[1]) - bits)
        # tifffile packs the bytes of big-endian values the wrong way round.
        stored = values.byteswap() if order == ">" else values
        content, back = tiff(stored, bitspersample=bits, byteorder=order, **LAYOUTS[layout])
        assert numpy.array_equal(back, values)
        row = f"{'2 to 7' if bits < 8 else '9 to 15'}-bit packed; grey, RGB; strips, tiles"
        matrix.add(("TIFF", row), f"bits{bits}.tif", content, back)


def others(matrix):
    first = picture("u2", 1)
    for order in "<>":
        file = io.BytesIO()
        with tifffile.TiffWriter(file, byteorder=order) as writer:
            writer.write(first[::2, ::2], subfiletype=1, metadata=None, photometric="minisblack")
            writer.write(first, metadata=None, photometric="minisblack")
            writer.write(first[::-1], metadata=None, photometric="minisblack")
        matrix.add(("TIFF", "several pages, a thumbnail first"), "pages.tif", file.getvalue(), first)
    for kind in ["u1", "u2"]:
        values = picture(kind, 1)
        content, back = tiff(values, photometric="miniswhite")
        matrix.add(("TIFF", "white is zero"), f"white{kind}.tif", content, numpy.iinfo(kind).max - back)
    for bits, codec in itertools.product([1], ["none", "packbits", "lzw", "deflate"]):
        values = picture("u1", 1) > 128
        file = io.BytesIO()
        tifffile.imwrite(file, values, photometric="minisblack", metadata=None, compression=None if codec == "none" else codec)
        matrix.add(("TIFF", "1-bit; no compression, LZW, Deflate, PackBits"), f"bit-{codec}.tif", file.getvalue(), values.astype("u1"))


def write(matrix):
    for part in [read_types, unread_types, unread_codecs, jpeg_and_fax, packed, others]:
        part(matrix)
