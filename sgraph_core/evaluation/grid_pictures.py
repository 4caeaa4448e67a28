"""Pictures of the rooms found in occupancy grids, small enough to keep many of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sgraph_concepts.types import OccupancyGrid
from sgraph_core.evaluation.grids import Found
from sgraph_core.files import write_whole

__all__ = ["save_picture"]

LONGEST_SIDE = 800
GREY = {OccupancyGrid.FREE: 255, OccupancyGrid.OCCUPIED: 0, OccupancyGrid.UNKNOWN: 200}
TRUE_BORDER = (200, 0, 0)
PALETTE_COLOURS = 64
STRIDE = 7
"""Neighbouring numbers, which often are neighbouring rooms, get colours this far apart."""


def save_picture(found: Found, path: str | Path) -> None:
    """Write a PNG of at most 800 pixels a side: found rooms as colours, borders of true ones red.

    Raises:
        OSError: the file cannot be written.
    """
    from PIL import Image

    picture = Image.fromarray(_cropped(_drawn(found), found)[::-1])
    picture.thumbnail((LONGEST_SIDE, LONGEST_SIDE))
    small = picture.quantize(PALETTE_COLOURS, dither=Image.Dither.NONE)
    write_whole(path, lambda file: small.save(file, optimize=True))


def _drawn(found: Found) -> NDArray[np.uint8]:
    from matplotlib import colormaps

    grey = np.array([GREY[value] for value in sorted(GREY)], np.uint8)
    drawn = np.repeat(grey[found.grid.cells][..., None], 3, axis=2)
    colours = 255 * np.array(colormaps["tab20"].colors)  # type: ignore[attr-defined]
    inside = found.painted >= 0
    drawn[inside] = (drawn[inside] + colours[STRIDE * found.painted[inside] % len(colours)]) / 2
    drawn[_borders(found.true)] = TRUE_BORDER
    return drawn


def _borders(labels: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return the labelled cells beside a cell of another label, two cells wide."""
    from scipy.ndimage import maximum_filter, minimum_filter

    differs = maximum_filter(labels, 3) != minimum_filter(labels, 3)
    return np.asarray(differs & (labels >= 0))


def _cropped(drawn: NDArray[np.uint8], found: Found) -> NDArray[np.uint8]:
    """Return the part of a picture where anything is known."""
    known = (found.grid.cells != OccupancyGrid.UNKNOWN) | (found.true >= 0)
    rows, columns = (np.flatnonzero(known.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return drawn
    return drawn[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
