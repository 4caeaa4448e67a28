"""The outlines of a grid's free space, found strip by strip."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import contourpy
import numpy as np
import shapely
from numpy.typing import NDArray

from sgraph_concepts.types import FloatArray, OccupancyGrid

__all__ = ["Mask", "Told", "enclosed_area", "free_space", "outlines"]

Mask = NDArray[np.bool_]
"""Which cells are free, [H, W]."""
Told = Callable[[int], object]
"""Told after every strip up to which row the work is done."""

STRIP_CELLS = 2**20
"""How many cells are worked on at a time; contouring needs some 30 bytes for each of them."""
FEWEST_ROWS = 16
"""Strips of very wide grids are larger, lest most of a strip is what it shares with others."""


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
    for low, high in _strips(grid.cells.shape):
        first = max(low - side, 0)
        free = grid.cells[first : high + side] == OccupancyGrid.FREE
        if free.any():
            mask[low:high] = _opened(free, side)[low - first : high - first]
        told(high)
    return mask


def outlines(mask: Mask, told: Told) -> list[FloatArray]:
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
    for low, high in _strips(mask.shape):
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


def _strips(shape: tuple[int, ...]) -> Iterator[tuple[int, int]]:
    height, width = shape
    if width == 0:
        return
    step = max(FEWEST_ROWS, STRIP_CELLS // width)
    for low in range(0, height, step):
        yield low, min(low + step, height)


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
