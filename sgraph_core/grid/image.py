"""The image of a ROS map_server map: which cells its pixels stand for."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from sgraph_concepts.errors import MapFileError
from sgraph_concepts.types import OccupancyGrid
from sgraph_core.grid.description import GridDescription, Mode
from sgraph_core.grid.pgm import open_pgm
from sgraph_core.grid.picture import Picture
from sgraph_core.grid.png import open_png

__all__ = ["Progress", "read_cells"]

Progress = Callable[[str, int, int], object]
"""Told what is being done, how much of it is done, and how much there is."""

LARGEST_IMAGE_BYTES = 2**30
"""As many pixels as a map may have take 0.8 GB as plain PGM, less in any other format."""
FORMATS: dict[bytes, Callable[[BinaryIO, Path], Picture]] = {
    b"\x89P": open_png,
    b"P2": open_pgm,
    b"P5": open_pgm,
}
"""By the first two bytes of a file."""
COLOURED_SPREAD = 64
"""Channels (of 255) this far apart make a colour: tinted greys are closer."""


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
            return _cells(_open(file, path), description, progress)
    except OSError as error:
        raise MapFileError(path, "", None, f"cannot be read: {error.strerror}") from error


def _open(file: BinaryIO, path: Path) -> Picture:
    size = path.stat().st_size
    if size > LARGEST_IMAGE_BYTES:
        raise MapFileError(path, "bytes", size, f"must be at most {LARGEST_IMAGE_BYTES}")
    magic = file.read(2)
    file.seek(0)
    if magic not in FORMATS:
        raise MapFileError(path, "", None, "must be a PNG or PGM (P2, P5) image")
    return FORMATS[magic](file, path)


def _cells(
    picture: Picture, description: GridDescription, progress: Progress
) -> tuple[NDArray[np.uint8], float]:
    cells = np.empty((picture.height, picture.width), np.uint8)
    tables: dict[int, NDArray[np.uint8]] = {}
    coloured = done = 0
    for strip in picture.strips:
        # map_server counts alpha as a fourth colour in trinary mode
        channels = strip.shape[2] if description.mode is Mode.TRINARY else min(strip.shape[2], 3)
        if channels not in tables:
            tables[channels] = _classes(channels * picture.white, description)
        # channel by channel: numpy is slow along an axis of 3
        brightness = np.add.reduce([strip[..., k] for k in range(channels)], dtype=np.uint32)
        found = tables[channels][brightness]
        if description.mode is Mode.SCALE and strip.shape[2] == 4:
            found[strip[..., 3] < picture.white] = OccupancyGrid.UNKNOWN
        coloured += _count_coloured(strip)
        start = picture.height - done
        done += len(strip)
        cells[picture.height - done : start] = found[::-1]
        progress("reading the map", done, picture.height)
    return cells, coloured / cells.size


def _count_coloured(strip: NDArray[np.integer[Any]]) -> int:
    if strip.shape[2] == 1:
        return 0
    colours = [strip[..., k] for k in range(3)]
    spread = np.maximum.reduce(colours) - np.minimum.reduce(colours)
    return int((spread > COLOURED_SPREAD).sum())


def _classes(top: int, description: GridDescription) -> NDArray[np.uint8]:
    """Return the class of a cell by its pixel's brightness from 0 to ``top``.

    The rules are nav2_map_server's. What scale mode finds between the thresholds is unknown. The
    percentages of a raw map are thresholded as map_saver does.
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
