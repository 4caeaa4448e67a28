"""Which surfaces face spaces that only narrow passages join."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from sgraph_concepts.types import FloatArray, IntArray, OccupancyGrid, SurfaceArrays

__all__ = ["separated"]

LARGEST_FILLED_M2 = 0.3
"""Connected cells that are not free, up to this area, such as table legs, narrow no passage."""
AHEAD_M = 0.3
"""A surface faces the space that is nearest to points this far in front of it..."""
SLACK_M = 0.6
"""...unless even the nearest is farther away than half a passage and this: the place is narrow."""
FRACTIONS = np.array([0.1, 0.3, 0.5, 0.7, 0.9])
"""Where along a surface these points lie."""
CELLS_AT_ONCE = 4_000_000


def separated(
    surfaces: SurfaceArrays, pairs: IntArray, grid: OccupancyGrid, width_m: float
) -> FloatArray:
    """Return how far narrow passages separate what surfaces face.

    The cells farther than half of ``width_m`` from every obstacle fall into spaces, each connected
    in itself; who goes from one to another passes where the way is narrower than ``width_m``.

    Args:
        surfaces: N surfaces, in the grid's world.
        pairs: rows of them, [P, 2].
        grid: what is known of the floor.
        width_m: what counts as narrow.

    Returns:
        From 0 to 1 the share of pairs of points in front of the two surfaces that face different
        spaces; 0 where that is not known, [P].
    """
    faced = _faced(surfaces, _spaces(grid, width_m / 2), grid, width_m / 2 + SLACK_M)
    one, two = faced[pairs[:, 0], :, None], faced[pairs[:, 1], None, :]
    known = (one > 0) & (two > 0)
    different = ((one != two) & known).sum(axis=(1, 2))
    return np.asarray(different / np.maximum(known.sum(axis=(1, 2)), 1))


def _spaces(grid: OccupancyGrid, clearance_m: float) -> NDArray[np.int32]:
    """Return the number of the space of each cell, 0 for none, [H, W]."""
    from scipy.ndimage import distance_transform_edt, label

    free = grid.cells == OccupancyGrid.FREE
    blobs, _ = label(~free, np.ones((3, 3)))
    filled = _sizes(blobs) * grid.resolution**2 <= LARGEST_FILLED_M2
    free |= filled[blobs]
    cells = clearance_m / grid.resolution
    clear = np.empty_like(free)
    for rows, around in _strips(free.shape, int(cells) + 1):
        distance = distance_transform_edt(free[around])
        clear[rows] = (distance >= cells)[rows.start - around.start :][: rows.stop - rows.start]
    spaces, _ = label(clear)
    return np.asarray(spaces)


def _sizes(labels: NDArray[np.int32]) -> IntArray:
    """Return how many cells have each label from 0 on; numpy's bincount alone would copy them."""
    total = np.zeros(labels.max(initial=0) + 1, np.int64)
    for rows, _ in _strips(labels.shape, 0):
        total += np.bincount(labels[rows].ravel(), minlength=len(total))
    return total


def _strips(shape: tuple[int, ...], margin: int) -> Iterator[tuple[slice, slice]]:
    """Yield strips of rows, and the same with a margin around: bounds the memory."""
    height = max(CELLS_AT_ONCE // shape[1], 1)
    for start in range(0, shape[0], height):
        stop = min(start + height, shape[0])
        yield slice(start, stop), slice(max(start - margin, 0), stop + margin)


def _faced(
    surfaces: SurfaceArrays, spaces: NDArray[np.int32], grid: OccupancyGrid, reach_m: float
) -> NDArray[np.int32]:
    """Return the number of the space before each of 5 points of a surface, 0 for none, [N, 5]."""
    from scipy.ndimage import binary_erosion
    from scipy.spatial import cKDTree

    first, second = surfaces.segments[:, :1], surfaces.segments[:, 1:]
    points = first + FRACTIONS[:, None] * (second - first) + AHEAD_M * surfaces.normals[:, None]
    inside = spaces > 0
    row, column = np.nonzero(inside & ~binary_erosion(inside))
    border = np.stack([column, row], axis=1) + 0.5
    within = grid.to_cells(points).reshape(-1, 2)
    faced = np.append(spaces[row, column], 0)  # what the tree says of points out of reach
    _, nearest = cKDTree(border).query(within, distance_upper_bound=reach_m / grid.resolution)
    cell = np.clip(within.astype(np.int64), 0, np.array(spaces.shape[::-1]) - 1)
    own = spaces[cell[:, 1], cell[:, 0]]
    return np.where(own > 0, own, faced[nearest]).reshape(points.shape[:2])
