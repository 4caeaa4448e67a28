"""Occupancy grids of hand-made floors, and the surfaces of their rooms."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from plans import Point

from sgraph_concepts.types import OccupancyGrid, SurfaceArrays

Box = tuple[int, int, int, int]
"""First and last column, first and last row of cells, the last ones not included."""
CELL_M = 0.05


def grid_of(
    width: int, height: int, *boxes: Box, origin: tuple[float, float, float] = (0, 0, 0)
) -> OccupancyGrid:
    """Return a grid that is free in boxes and unknown elsewhere."""
    cells = np.full((height, width), OccupancyGrid.UNKNOWN)
    for left, right, bottom, top in boxes:
        cells[bottom:top, left:right] = OccupancyGrid.FREE
    return OccupancyGrid(cells.astype(np.uint8), CELL_M, np.array(origin, float))


def occupy(grid: OccupancyGrid, box: Box) -> None:
    left, right, bottom, top = box
    grid.cells[bottom:top, left:right] = OccupancyGrid.OCCUPIED


def surfaces_of(grid: OccupancyGrid, *lines: Sequence[Point], first_id: int = 0) -> SurfaceArrays:
    """Return surfaces along lines given in cells, the room on their left."""
    segments = np.array(
        [(second, first) for line in lines for first, second in pairwise(line)],
        float,
    )
    segments = grid.to_world(segments)
    along = segments[:, 1] - segments[:, 0]
    along /= np.linalg.norm(along, axis=1)[:, None]
    normals = np.stack([along[:, 1], -along[:, 0]], axis=1)
    return SurfaceArrays(np.arange(first_id, first_id + len(segments)), segments, normals)


def closed(left: float, right: float, bottom: float, top: float) -> list[Point]:
    """Return the outline of a box, seen from inside."""
    return [(left, bottom), (right, bottom), (right, top), (left, top), (left, bottom)]
