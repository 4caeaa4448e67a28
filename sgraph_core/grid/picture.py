"""Pictures, strip by strip: what PNG and PGM files have in common."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sgraph_concepts.errors import MapFileError

__all__ = ["Picture", "check_size", "rows_of_strip"]

MOST_PIXELS = 200_000_000
"""700 m x 700 m at 5 cm. Memory and time are bounded by this; see docs/grids.md."""
LONGEST_SIDE = 2**16
"""3 km at 5 cm; a single row is never long to wait for."""
STRIP_PIXELS = 2**20
"""How many pixels are worked on at a time."""


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture that is being read.

    Attributes:
        width, height: in pixels.
        white: the value of white in each channel.
        strips: the rows from top to bottom, some at a time, [R, width, C]; C is 1 for grey, 3 for
            red, green and blue, 4 with alpha. Damage may be found, and raised, while they are read.
    """

    width: int
    height: int
    white: int
    strips: Iterator[NDArray[np.integer[Any]]]


def rows_of_strip(width: int) -> int:
    """Return how many rows of a picture to work on at a time."""
    return max(1, STRIP_PIXELS // width)


def check_size(path: Path, width: int, height: int, most_pixels: int) -> None:
    """Refuse a picture before memory is taken for it.

    Args:
        path: the file, for the error.
        width: what its header says.
        height: likewise.
        most_pixels: how many pixels a file of its length can hold.

    Raises:
        MapFileError: the picture is empty, too large, or larger than its file can hold.
    """
    shown = f"{width} x {height}"
    if width < 1 or height < 1:
        raise MapFileError(path, "size", shown, "must have pixels")
    if max(width, height) > LONGEST_SIDE:
        raise MapFileError(path, "size", shown, f"must be at most {LONGEST_SIDE} long and wide")
    if width * height > MOST_PIXELS:
        raise MapFileError(path, "size", shown, f"must have at most {MOST_PIXELS} pixels")
    if width * height > most_pixels:
        raise MapFileError(path, "size", shown, "is more than the file holds: it is cut off")
