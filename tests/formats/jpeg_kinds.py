"""JPEG as Pillow (libjpeg-turbo) writes and reads it."""

import io
import itertools

import imagecodecs
import numpy
import PIL.Image
from matrix import picture

UNREAD = ("JPEG", "CMYK, 12-bit, arithmetic, hierarchical and lossless coding, JPEG-LS")
# Decoders may differ by 1 in each component after the inverse DCT (ITU-T T.83 takes its accuracy from IEEE 1180). Blue is
# Y + 1.772 Cb, so that 1 in both is 2.8, and 3 after rounding; red and green are less.
RGB, GREY = "within 3", "within 1"
# Halfway values between two chroma samples may be rounded either way: 1 + 1.772 * 2 is 4.5, and 5 after rounding.
SUBSAMPLED = "within 5"
# What lies beyond the picture in its last blocks is not stated. Nacre's decoder mixes a quarter of it into the chroma of the last row and
# column, libjpeg-turbo does not.
SUBSAMPLED_CUT = "within 5 inside"
# Name, and columns and rows of a block of all components.
SUBSAMPLING = {0: ("4:4:4", 8, 8), 1: ("4:2:2", 16, 8), 2: ("4:2:0", 16, 16)}


def jpeg(values, mode, **options):
    file = io.BytesIO()
    PIL.Image.fromarray(values, mode).save(file, "JPEG", **options)
    content = file.getvalue()
    return content, numpy.array(PIL.Image.open(io.BytesIO(content)))


def write(matrix):
    ways = [{}, {"progressive": True}, {"optimize": True}, {"restart_marker_blocks": 2}, {"progressive": True, "restart_marker_rows": 1}]
    sizes = [(37, 53), (1, 1), (16, 16), (8, 24), (17, 9)]
    for quality, way, size in itertools.product([30, 75, 95, 100], ways, sizes):
        content, back = jpeg(picture("u1", 1, *size), "L", quality=quality, **way)
        matrix.add(("JPEG", "grey; baseline, progressive, restart markers"), "grey.jpg", content, back, GREY)
        for subsampling, (words, columns, rows) in SUBSAMPLING.items():
            content, back = jpeg(picture("u1", 3, *size), "RGB", quality=quality, subsampling=subsampling, **way)
            row = f"colour {words}; baseline, progressive, restart markers"
            whole = SUBSAMPLED if size[0] % rows == 0 and size[1] % columns == 0 else SUBSAMPLED_CUT
            bound = whole if subsampling else RGB
            matrix.add(("JPEG", row), f"{words.replace(':', '')}.jpg", content, back, bound)
    content, back = jpeg(picture("u1", 3), "RGB", keep_rgb=True)
    matrix.add(("JPEG", "colour stored as RGB"), "rgb.jpg", content, back, GREY)
    content, _ = jpeg(picture("u1", 4), "CMYK")
    matrix.add(UNREAD, "cmyk.jpg", content, expectation="refused CMYK")
    content, _ = jpeg(picture("u1", 1), "L")
    for marker, words in {0xC9: "arithmetic coding", 0xCA: "arithmetic coding", 0xC5: "hierarchical"}.items():
        at = content.index(b"\xff\xc0") + 1
        changed = content[:at] + bytes([marker]) + content[at + 1 :]
        matrix.add(UNREAD, f"{marker:x}.jpg", changed, expectation=f"refused {words}")
    lossless = imagecodecs.ljpeg_encode(picture("u2", 1) >> 4, bitspersample=12)
    matrix.add(UNREAD, "lossless.jpg", lossless, expectation="refused lossless")
    deep = imagecodecs.jpeg8_encode(picture("u2", 1) >> 4, bitspersample=12)
    matrix.add(UNREAD, "deep.jpg", deep, expectation="refused 12 bits")
    near = imagecodecs.jpegls_encode(picture("u2", 1))
    matrix.add(UNREAD, "near.jls", near, expectation="refused JPEG-LS")
