"""Grids that can be read and look wrong."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sgraph_concepts.types import OccupancyGrid

__all__ = ["doubt"]

BLOCK_M = 0.6
"""No wall of a robot's map fills a square of this side, and every room holds one."""
MOST = 4
"""So many times as much is most."""

Mask = NDArray[np.bool_]


def doubt(grid: OccupancyGrid, remedy: str) -> str | None:
    """Say what is wrong with a grid in which no room can be, or None.

    Args:
        grid: the grid.
        remedy: what would exchange free and occupied.
    """
    free, occupied = OccupancyGrid.FREE, OccupancyGrid.OCCUPIED
    if not (grid.cells == free).any():
        return f"no cell is free, so there are no rooms ({remedy} if the map is inverted)"
    if not (grid.cells != free).any():
        return "all cells are free, so there are no rooms"
    if _looks_inverted(_full_blocks(grid, free), _full_blocks(grid, occupied)):
        return f"most of what is enclosed is occupied: the map looks inverted ({remedy})"
    return None


def _full_blocks(grid: OccupancyGrid, value: int) -> Mask:
    """Return which square blocks of the grid hold one value only."""
    height, width = grid.cells.shape
    side = max(1, min(round(BLOCK_M / grid.resolution), height, width))
    rows, columns = height // side, width // side
    full = np.ones((rows, columns), bool)
    for k in range(side):
        strip = grid.cells[k : rows * side : side, : columns * side] == value
        full &= strip.reshape(rows, columns, side).all(axis=2)
    return full


def _looks_inverted(free: Mask, occupied: Mask) -> bool:
    """Tell whether space is thick where it is occupied and thin where it is free.

    Either nowhere is enough space free for a robot, or the regions that do not reach the border
    are mostly occupied: rooms, where outside is free. Solid blocks in a hall or inside a ring of
    corridors are less.
    """
    if not free.any():
        return bool(occupied.any())
    inside = int(_enclosed(occupied).sum())
    return inside > MOST * int(_enclosed(free).sum()) and MOST * inside > int(free.sum())


def _enclosed(mask: Mask) -> Mask:
    """Return the regions of a mask that do not reach its border."""
    from scipy import ndimage

    regions, _ = ndimage.label(mask)
    border = np.concatenate([regions[0], regions[-1], regions[:, 0], regions[:, -1]])
    return mask & ~np.isin(regions, border)
