"""Which surfaces face spaces that only narrow passages join."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sgraph_concepts.types import FloatArray, IntArray, OccupancyGrid, SurfaceArrays
from sgraph_core.grid.strips import count_labels, has_label, strips

__all__ = ["separated"]

Mask = NDArray[np.bool_]

LARGEST_FILLED_M2 = 0.3
"""Connected cells that are not free, up to this area, such as table legs, narrow no passage."""
AHEAD_M = 0.3
"""A surface faces the space that is nearest to points this far in front of it..."""
SLACK_M = 0.6
"""...unless even the nearest is farther away than half a passage and this: the place is narrow."""
FRACTIONS = np.array([0.1, 0.3, 0.5, 0.7, 0.9])
"""Where along a surface these points lie."""


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
    from scipy.ndimage import label

    spaces, _ = label(_clear(_without_blobs(grid), clearance_m / grid.resolution))
    return np.asarray(spaces)


def _clear(free: Mask, cells: float) -> Mask:
    """Return the free cells that are so many cells from all others."""
    from scipy.ndimage import distance_transform_edt

    clear = np.empty_like(free)
    for rows, around in strips(free.shape, int(cells) + 1):
        far = distance_transform_edt(free[around]) >= cells
        clear[rows] = far[rows.start - around.start :][: rows.stop - rows.start]
    return clear


def _without_blobs(grid: OccupancyGrid) -> Mask:
    """Return the cells that are free, or of connected ones that cover little, [H, W]."""
    from scipy.ndimage import label

    most_cells = int(LARGEST_FILLED_M2 / grid.resolution**2)
    free = np.empty(grid.cells.shape, bool)
    # what reaches from a strip through a margin of so many rows is larger
    for rows, around in strips(free.shape, most_cells):
        blobs, count = label(grid.cells[around] != OccupancyGrid.FREE, np.ones((3, 3)))
        wanted = count_labels(blobs, count) <= most_cells
        wanted[0] = True  # free cells
        free[rows] = has_label(blobs, wanted)[rows.start - around.start :][: rows.stop - rows.start]
    return free


def _faced(
    surfaces: SurfaceArrays, spaces: NDArray[np.int32], grid: OccupancyGrid, reach_m: float
) -> NDArray[np.int32]:
    """Return the number of the space before each of 5 points of a surface, 0 for none, [N, 5]."""
    from scipy.spatial import cKDTree

    first, second = surfaces.segments[:, :1], surfaces.segments[:, 1:]
    points = first + FRACTIONS[:, None] * (second - first) + AHEAD_M * surfaces.normals[:, None]
    row, column = _border(spaces)
    border = np.stack([column, row], axis=1) + 0.5
    within = grid.to_cells(points).reshape(-1, 2)
    faced = np.append(spaces[row, column], 0)  # what the tree says of points out of reach
    _, nearest = cKDTree(border).query(within, distance_upper_bound=reach_m / grid.resolution)
    cell = np.clip(within.astype(np.int64), 0, np.array(spaces.shape[::-1]) - 1)
    own = spaces[cell[:, 1], cell[:, 0]]
    return np.where(own > 0, own, faced[nearest]).reshape(points.shape[:2])


def _border(spaces: NDArray[np.int32]) -> tuple[IntArray, IntArray]:
    """Return rows and columns of the cells of spaces beside cells of none."""
    from scipy.ndimage import binary_erosion

    found = []
    for rows, around in strips(spaces.shape, 1):
        inside = spaces[around] > 0
        edge = inside & ~binary_erosion(inside)
        row, column = np.nonzero(edge[rows.start - around.start :][: rows.stop - rows.start])
        found.append((row + rows.start, column))
    return np.concatenate([row for row, _ in found]), np.concatenate([c for _, c in found])
