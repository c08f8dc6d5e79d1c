"""Writes photographs of many kinds, with the values that other programs read from them (see matrix.py).

usage: write.py FOLDER
"""

import pathlib
import sys

import jpeg_kinds
import other_kinds
import png_kinds
import tiff_kinds
from matrix import Matrix

matrix = Matrix(pathlib.Path(sys.argv[1]))
for kinds in [png_kinds, tiff_kinds, jpeg_kinds, other_kinds]:
    kinds.write(matrix)
matrix.close()
