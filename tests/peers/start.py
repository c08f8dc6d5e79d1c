"""What a peer loads before it begins."""

import cv2  # noqa: F401
import numpy  # noqa: F401
import tifffile  # noqa: F401
