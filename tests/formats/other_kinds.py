"""WebP, BMP, NPY and Radiance HDR, and formats that Nacre does not read."""

import io
import itertools

import imagecodecs
import numpy
import PIL.Image
from matrix import picture


def saved(values, format, mode=None, **options):
    file = io.BytesIO()
    PIL.Image.fromarray(values, mode).save(file, format, **options)
    return file.getvalue()


def webp(matrix):
    for channels, quality, size in itertools.product([3, 4], [30, 80, 100], [(37, 53), (1, 1), (16, 16), (18, 7)]):
        values = picture("u1", channels, *size)
        content = saved(values, "WEBP", lossless=True, exact=True, quality=quality)
        matrix.add(("WebP", "lossless, RGB and RGBA"), "lossless.webp", content, values)
        content = saved(values, "WEBP", quality=quality)
        back = numpy.array(PIL.Image.open(io.BytesIO(content)))
        matrix.add(("WebP", "lossy, RGB and RGBA"), "lossy.webp", content, back)
    frames = [PIL.Image.fromarray(picture("u1", 3)[:: (-1) ** k]) for k in range(3)]
    file = io.BytesIO()
    frames[0].save(file, "WEBP", save_all=True, append_images=frames[1:])
    matrix.add(("WebP", "animations"), "animation.webp", file.getvalue(), expectation="refused animated WebP")


def bmp(matrix):
    for size in [(37, 53), (1, 1), (5, 3)]:
        grey, colour, alpha = (picture("u1", channels, *size) for channels in [1, 3, 4])
        indexed = PIL.Image.fromarray(colour).quantize(200)
        file = io.BytesIO()
        indexed.save(file, "BMP")
        row = ("BMP", "1-bit, palette, RGB, RGBA")
        matrix.add(row, "grey.bmp", saved(grey, "BMP"), numpy.stack([grey] * 3, axis=-1))
        matrix.add(row, "palette.bmp", file.getvalue(), numpy.array(indexed.convert("RGB")))
        matrix.add(row, "rgb.bmp", saved(colour, "BMP"), colour)
        matrix.add(row, "rgba.bmp", saved(alpha, "BMP"), alpha)
        bits = grey > 128
        matrix.add(row, "bits.bmp", saved(bits, "BMP"), numpy.stack([bits.astype("u1") * 255] * 3, axis=-1))


def npy(matrix):
    kinds = ["u1", "u2", "u4", "u8", "i1", "i2", "i4", "i8", "f2", "f4", "f8"]
    for kind, channels, order, fortran in itertools.product(kinds, [1, 3], "<>", [False, True]):
        values = picture(kind, channels).astype(order + kind)
        file = io.BytesIO()
        numpy.save(file, numpy.asfortranarray(values) if fortran else values)
        native = values.astype(kind)
        matrix.add(("NPY", "integers of 8 to 64 bits, floats of 16 to 64"), f"{kind}.npy", file.getvalue(), native)
    refused = {
        "complex numbers": picture("f4", 1).astype("c8"),
        "truth values": picture("u1", 1) > 9,
        "stacks": numpy.zeros((5, 6, 7, 8), "u1"),
        "other numbers of channels": picture("u1", 2),
    }
    for values in refused.values():
        file = io.BytesIO()
        numpy.save(file, values)
        matrix.add(("NPY", ", ".join(refused)), "refused.npy", file.getvalue(), expectation="refused is an array of")


def radiance(matrix):
    for size in [(37, 53), (3, 7), (9, 8)]:
        values = numpy.abs(picture("f4", 3, *size)) + 0.25
        content = imagecodecs.rgbe_encode(values, header=True)
        matrix.add(("Radiance HDR", "RGBE"), "x.hdr", content, imagecodecs.rgbe_decode(content))


def foreign(matrix):
    grey, colour = picture("u1", 1), picture("u1", 3)
    made = {
        "GIF": saved(grey, "GIF"),
        "AVIF": imagecodecs.avif_encode(colour),
        "JPEG 2000": imagecodecs.jpeg2k_encode(colour),
        "JPEG XL": imagecodecs.jpegxl_encode(colour),
        "JPEG XR": imagecodecs.jpegxr_encode(colour),
        "PDF": saved(grey, "PDF"),
        "PNM": saved(grey, "PPM"),
        "PFM": saved(picture("f4", 1), "PPM"),
    }
    for words, content in made.items():
        matrix.add(("others", ", ".join(made)), "other", content, expectation=f"refused {words}")
    for format in ["TGA", "PCX", "SGI", "ICO", "DDS", "IM", "EPS", "QOI"]:
        content = saved(colour, format)
        matrix.add(("others", "TGA, PCX, SGI, ICO, DDS, IM, EPS, QOI"), f"x.{format.lower()}", content, expectation="refused is not a PNG")


def write(matrix):
    for part in [webp, bmp, npy, radiance, foreign]:
        part(matrix)
