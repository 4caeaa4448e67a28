"""The outlines of a grid's free space, found strip by strip."""

from __future__ import annotations

from collections.abc import Callable

import contourpy
import numpy as np
import shapely
from numpy.typing import NDArray

from sgraph_concepts.types import FloatArray, OccupancyGrid
from sgraph_core.grid.strips import strips

__all__ = ["Mask", "Told", "enclosed_area", "free_space", "outlines"]

Mask = NDArray[np.bool_]
"""Which cells are free, [H, W]."""
Told = Callable[[int], object]
"""Told after every strip up to which row the work is done."""


def free_space(grid: OccupancyGrid, narrowest_m: float, told: Told) -> Mask:
    """Return the cells that some free square of the given side covers: the opened free mask.

    What lies beyond the grid is taken to continue what lies at its border.

    Args:
        grid: the grid.
        narrowest_m: side of the square in metres; it has two cells at least.
        told: see :data:`Told`.
    """
    side = max(2, round(narrowest_m / grid.resolution))
    mask = np.zeros(grid.cells.shape, bool)
    for rows, around in strips(grid.cells.shape, side):
        free = grid.cells[around] == OccupancyGrid.FREE
        if free.any():
            opened = _opened(free, side)[rows.start - around.start :]
            mask[rows] = opened[: rows.stop - rows.start]
        told(rows.stop)
    return mask


def outlines(mask: Mask, told: Told = lambda _row: None) -> list[FloatArray]:
    """Return the lines along the cells' edges that part free cells from others.

    They run half-way between cell centres (marching squares), so corners are cut by half a cell.
    Cells that touch at a corner only are connected where they are not free, and apart where they
    are. Where free space reaches the border of the grid there is no outline.

    Args:
        mask: the free cells.
        told: see :data:`Told`.

    Returns:
        Points (column, row) as :meth:`OccupancyGrid.to_world` takes them, [P, 2] each. Free space
        is on the right of each line. A closed line repeats its first point.
    """
    height, width = mask.shape
    columns = np.array([0, *np.arange(width) + 0.5, width])
    closed: list[FloatArray] = []
    open_: list[FloatArray] = []
    for strip, _ in strips(mask.shape):
        low, high = strip.start, strip.stop
        # strips share a row, on which the lines of one end and those of the next begin
        cells = mask[low : high + 1]
        centres = np.arange(low, low + len(cells)) + 0.5
        above, below = int(low == 0), int(high == height)
        cells = np.pad(cells, ((above, below), (1, 1)), "edge")
        rows = np.array([*[0] * above, *centres, *[height] * below], np.float64)
        for line in _contours(columns, rows, cells):
            (closed if (line[0] == line[-1]).all() else open_).append(line)
        told(high)
    return closed + _joined(open_)


def enclosed_area(line: FloatArray) -> float:
    """Return the area that an outline encloses, in cells, 0 if it is open.

    It is positive around a blob and negative around free space.
    """
    if (line[0] != line[-1]).any():
        return 0.0
    x, y = (line - line[0]).T
    return float(x[:-1] @ y[1:] - x[1:] @ y[:-1]) / 2


def _opened(free: Mask, side: int) -> Mask:
    reach = side - 1
    padded = np.pad(free, reach, "edge")
    for axis in (0, 1):
        padded = _windows(np.logical_and, padded, side, axis)
    for axis in (0, 1):
        padded = _windows(np.logical_or, padded, side, axis)
    return padded


def _windows(combine: np.ufunc, mask: Mask, side: int, axis: int) -> Mask:
    """Combine each run of ``side`` cells along an axis, which gets shorter by ``side - 1``."""
    count = mask.shape[axis] - side + 1
    runs = [slice(None), slice(None)]
    runs[axis] = slice(0, count)
    result = mask[tuple(runs)].copy()
    for k in range(1, side):
        runs[axis] = slice(k, k + count)
        combine(result, mask[tuple(runs)], out=result)
    return result


def _contours(columns: FloatArray, rows: FloatArray, cells: Mask) -> list[FloatArray]:
    if cells.all() or not cells.any():
        return []
    generator = contourpy.contour_generator(columns, rows, cells, line_type="Separate")
    # contourpy keeps the higher side, which is the free one, on the left
    return [np.asarray(line)[::-1] for line in generator.lines(0.5)]


def _joined(lines: list[FloatArray]) -> list[FloatArray]:
    if not lines:
        return []
    merged = shapely.get_parts(shapely.line_merge(shapely.MultiLineString(lines), directed=True))
    return [shapely.get_coordinates(line) for line in merged]
