"""The image of a ROS map_server map: which cells its pixels stand for."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray
from PIL.Image import Image
from PIL.ImageFile import ImageFile
from PIL.PngImagePlugin import PngImageFile
from PIL.PpmImagePlugin import PpmImageFile

from sgraph_concepts.errors import MapFileError
from sgraph_concepts.types import OccupancyGrid
from sgraph_core.grid.description import GridDescription, Mode

__all__ = ["Progress", "read_cells"]

Progress = Callable[[str, int, int], object]
"""Told what is being done, how much of it is done, and how much there is."""

MOST_PIXELS = 200_000_000
"""700 m x 700 m at 5 cm; memory is bounded by this, see docs/grids.md."""
LARGEST_IMAGE_BYTES = 2**30
"""As many pixels as plain PGM text take 0.8 GB, all other formats less."""
MOST_PIXELS_PER_BYTE = 8 * 1032
"""What the best deflate stream holds of the smallest pixels; a header that claims more lies."""
STRIP_PIXELS = 2**20
"""How many pixels are worked on at a time."""

READERS: dict[bytes, Callable[[BinaryIO], ImageFile]] = {
    b"\x89P": PngImageFile,
    b"P2": PpmImageFile,
    b"P5": PpmImageFile,
}
"""By the first two bytes. Not Image.open, whose own limit of pixels is lower and global."""
GREY_TOPS = {"1": 255, "L": 255, "I;16": 65535, "I": 65535}
"""The value of white by pillow's mode, for images of one channel."""
COLOUR_MODES = ("P", "LA", "PA", "RGB", "RGBA")
DAMAGED = (
    OSError,
    SyntaxError,
    ValueError,
    EOFError,
    IndexError,
    KeyError,
    struct.error,
    zlib.error,
)
"""What pillow raises for damaged files."""

COLOURED_SPREAD = 64
"""Channels (of 255) this far apart make a colour: tinted greys are closer, drawn colours wider."""


def read_cells(description: GridDescription, progress: Progress) -> tuple[NDArray[np.uint8], float]:
    """Read the image of a map_server map.

    Args:
        description: what the YAML file says.
        progress: told after every strip of rows.

    Returns:
        The cells of an :class:`OccupancyGrid`, and the share of pixels that have a colour.

    Raises:
        MapFileError: the image cannot be read, is damaged or larger than it may be.
    """
    path = description.image
    try:
        with path.open("rb") as file:
            image = _open(file, path)
            image.load()
    except DAMAGED as error:
        raise MapFileError(path, "", None, f"is damaged, or empty: {error}") from error
    return _cells(image, description, progress)


def _open(file: BinaryIO, path: Path) -> ImageFile:
    """Read an image's header and refuse what would take more memory than a map may."""
    size = path.stat().st_size
    magic = file.read(2)
    file.seek(0)
    if magic not in READERS:
        raise MapFileError(path, "", None, "must be a PNG or PGM (P2, P5) image")
    if size > LARGEST_IMAGE_BYTES:
        raise MapFileError(path, "", size, f"must have at most {LARGEST_IMAGE_BYTES} bytes")
    image = READERS[magic](file)
    width, height = image.size
    if width * height > MOST_PIXELS:
        rule = f"must have at most {MOST_PIXELS} pixels"
        raise MapFileError(path, "size", f"{width} x {height}", rule)
    if width * height > size * MOST_PIXELS_PER_BYTE:
        rule = f"cannot be in a file of {size} bytes: it is damaged"
        raise MapFileError(path, "size", f"{width} x {height}", rule)
    if image.mode not in (*GREY_TOPS, *COLOUR_MODES):
        raise MapFileError(path, "", image.mode, "must be a grey or colour image")
    return image


def _cells(
    image: ImageFile, description: GridDescription, progress: Progress
) -> tuple[NDArray[np.uint8], float]:
    width, height = image.size
    cells = np.empty((height, width), np.uint8)
    coloured = 0
    grey = image.mode in GREY_TOPS and "transparency" not in image.info
    channels = "RGBA" if image.has_transparency_data else "RGB"
    top = GREY_TOPS[image.mode] if grey else 255 * _averaged(channels, description.mode)
    classes = _classes(top, description)
    rows = max(1, STRIP_PIXELS // width)
    for low in range(0, height, rows):
        high = min(low + rows, height)
        strip = image.crop((0, low, width, high))
        if grey:
            found = classes[_levels(strip)]
        else:
            pixels = np.asarray(strip.convert(channels))
            found = classes[pixels[..., : top // 255].sum(axis=2, dtype=np.uint16)]
            if description.mode is Mode.SCALE:
                found[pixels[..., 3:].min(axis=2, initial=255) < 255] = OccupancyGrid.UNKNOWN
            coloured += int((np.ptp(pixels[..., :3], axis=2) > COLOURED_SPREAD).sum())
        cells[height - high : height - low] = found[::-1]
        progress("reading the map", high, height)
    return cells, coloured / cells.size


def _levels(strip: Image) -> NDArray[np.integer[Any]]:
    return np.asarray(strip.convert("L") if strip.mode == "1" else strip)


def _averaged(channels: str, mode: Mode) -> int:
    """Return how many channels are averaged: in trinary mode, map_server counts alpha as one."""
    return len(channels) if mode is Mode.TRINARY else 3


def _classes(top: int, description: GridDescription) -> NDArray[np.uint8]:
    """Return the class of a cell by its pixel's brightness from 0 to ``top``.

    The rules are nav2_map_server's, which scale mode's values between the thresholds follow too:
    they are unknown. A raw map's percentages are thresholded as map_saver does.
    """
    shade = np.arange(top + 1) / top
    if description.mode is Mode.RAW:
        percent = np.rint(255 * shade)
        free = percent <= np.rint(100 * description.free_thresh)
        occupied = (percent >= np.rint(100 * description.occupied_thresh)) & (percent <= 100)
    else:
        occupancy = shade if description.negate else 1.0 - shade
        free = occupancy < description.free_thresh
        occupied = occupancy > description.occupied_thresh
    return np.select(
        [free, occupied], [OccupancyGrid.FREE, OccupancyGrid.OCCUPIED], OccupancyGrid.UNKNOWN
    ).astype(np.uint8)
