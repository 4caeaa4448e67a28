"""Which free cells of a grid belong to which room, for all rooms at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sgraph_concepts.types import FloatArray, IntArray, OccupancyGrid, SurfaceArrays
from sgraph_core.winding import winding

__all__ = ["NOBODY", "Labels", "Mask", "label_cells", "windows"]

NOBODY = -1
"""Label of the cells of no room."""
INSIDE = 0.5
"""A room claims the free cells around which its surfaces wind more often than this."""
REACH_M = 1.0
"""What no room claims, such as door thresholds and niches, goes to the nearest room if all of it
lies within this distance, counted along the grid's axes through free space."""
LARGEST_FILLED_M2 = 6.0
"""A hole in a room is filled, as furniture, up to this area and if no other room lies in it."""
TILE = 4
"""Winding numbers are computed for tiles of this many cells a side where they vary little."""
EQUAL = 0.1
"""Winding numbers that differ by less than this are equal."""
CLEARLY_INSIDE, CLEARLY_OUTSIDE = 0.75, 0.25
FOUR_NEIGHBOURS = ((0, 1), (0, -1), (1, 0), (-1, 0))

Labels = NDArray[np.int32]
Mask = NDArray[np.bool_]


def label_cells(rooms: Sequence[SurfaceArrays], grid: OccupancyGrid) -> Labels:
    """Return for every cell the room that it belongs to.

    1. A free cell is claimed by the room whose surfaces wind around it most, if they do so more
       than half.
    2. Each room keeps the largest connected part of what it claims.
    3. Free cells that are left over go to the nearest room, each connected patch of them as a
       whole: only if all of it lies within ``REACH_M`` of rooms.
    4. Holes in rooms are filled: up to ``LARGEST_FILLED_M2``, and if no other room lies in them.

    Args:
        rooms: the surfaces of each room, in the grid's world.
        grid: what is known of the floor.

    Returns:
        Index into ``rooms``, or ``NOBODY``, [H, W]. The cells of a room are connected by their
        sides.
    """
    free = grid.cells == OccupancyGrid.FREE
    labels = _claimed([grid.to_cells(room.segments) for room in rooms], free)
    for number, window in windows(labels, len(rooms)):
        _keep_largest_part(labels[window], number)
    _spread(labels, free, round(REACH_M / grid.resolution))
    most_filled = LARGEST_FILLED_M2 / grid.resolution**2
    for number, window in windows(labels, len(rooms)):
        _fill_holes(labels[window], number, most_filled)
    return labels


def _claimed(rooms: Sequence[FloatArray], free: Mask) -> Labels:
    """Return which room's segments [N, 2, 2], in cells, wind most around each free cell.

    Where two do so equally often, one room lies within the other: the smaller one has it.
    """
    labels = np.full(free.shape, NOBODY, np.int32)
    to_beat = np.full(free.shape, INSIDE, np.float32)
    limits = [_limits(segments, free.shape) for segments in rooms]
    for number in sorted(
        range(len(rooms)), key=lambda room: np.prod(limits[room][1] - limits[room][0])
    ):
        low, high = limits[number]
        window = np.s_[low[1] : high[1], low[0] : high[0]]
        if free[window].any():
            times = _winding_of_cells(rooms[number] - low, free[window])
            wins = free[window] & (times > to_beat[window])
            labels[window][wins] = number
            to_beat[window][wins] = times[wins] + EQUAL
    return labels


def _limits(segments: FloatArray, shape: tuple[int, ...]) -> tuple[IntArray, IntArray]:
    """Return the first column and row of the cells around segments, and the ones after the last."""
    corners, size = segments.reshape(-1, 2), np.array(shape[::-1])
    low = np.clip(np.floor(corners.min(axis=0)), 0, size)
    high = np.clip(np.ceil(corners.max(axis=0)), 0, size)
    return low.astype(np.int64), high.astype(np.int64)


def _winding_of_cells(segments: FloatArray, wanted: Mask) -> FloatArray:
    """Return how often segments wind around the middles of cells, right where it is wanted.

    Between the segments the winding number is a harmonic function: a tile away from them that is
    clearly inside or outside at its corners is so throughout, and needs no more computing.
    """
    height, width = (-(-side // TILE) for side in wanted.shape)
    rows, columns = np.mgrid[: height + 1, : width + 1]
    corners = TILE * np.stack([columns.ravel(), rows.ravel()], axis=1).astype(float)
    at_corners = winding(segments, corners).reshape(height + 1, width + 1)
    corner_sets = [at_corners[i : height + i, j : width + j] for i in (0, 1) for j in (0, 1)]
    low, high = np.min(corner_sets, axis=0), np.max(corner_sets, axis=0)
    settled = (low > CLEARLY_INSIDE) | (high < CLEARLY_OUTSIDE)
    settled &= ~_tiles_near(segments, (height, width))
    row, column = np.nonzero(wanted)
    tile = row // TILE, column // TILE
    times = np.zeros(wanted.shape)
    times[row, column] = ((low + high) / 2)[tile]
    row, column = row[~settled[tile]], column[~settled[tile]]
    times[row, column] = winding(segments, np.stack([column, row], axis=1) + 0.5)
    return times


def _tiles_near(segments: FloatArray, shape: tuple[int, int]) -> Mask:
    """Return the tiles that a segment passes through or beside."""
    from scipy.ndimage import binary_dilation

    near = np.zeros(shape, bool)
    for first, second in segments / TILE:
        steps = int(2 * np.linalg.norm(second - first)) + 2
        points = first + np.linspace(0, 1, steps)[:, None] * (second - first)
        column, row = np.clip(points, 0, np.array(shape[::-1]) - 1).astype(np.int64).T
        near[row, column] = True
    return np.asarray(binary_dilation(near, np.ones((3, 3))))


def windows(labels: Labels, count: int) -> list[tuple[int, tuple[slice, slice]]]:
    """Return the rooms that have cells, and the window that holds them."""
    from scipy.ndimage import find_objects

    windows = find_objects(labels + 1, count)
    return [(number, window) for number, window in enumerate(windows) if window is not None]


def _keep_largest_part(labels: Labels, number: int) -> None:
    from scipy.ndimage import label

    parts, count = label(labels == number)
    if count > 1:
        largest = np.argmax(np.bincount(parts.ravel())[1:]) + 1
        labels[(parts > 0) & (parts != largest)] = NOBODY


def _spread(labels: Labels, free: Mask, steps: int) -> None:
    """Give patches of free cells of nobody to the nearest labels, if so many steps reach all.

    Labels grow a cell a step; of equals the lower one wins.
    """
    from scipy.ndimage import binary_dilation, label

    patches, count = label(free & (labels == NOBODY))
    edge = np.flatnonzero((labels != NOBODY) & binary_dilation(free & (labels == NOBODY)))
    flat, waiting = labels.reshape(-1), free.reshape(-1)
    height, width = labels.shape
    for _ in range(steps):
        row, column = np.divmod(edge, width)
        reached, takers = [], []
        for down, right in FOUR_NEIGHBOURS:
            inside = (row + down >= 0) & (row + down < height)
            inside &= (column + right >= 0) & (column + right < width)
            cell = edge[inside] + down * width + right
            takes = waiting[cell] & (flat[cell] == NOBODY)
            reached.append(cell[takes])
            takers.append(flat[edge[inside][takes]])
        cells, taker = np.concatenate(reached), np.concatenate(takers)
        order = np.lexsort((taker, cells))
        edge, first = np.unique(cells[order], return_index=True)
        flat[edge] = taker[order][first]
    beyond_reach = np.zeros(count + 1, bool)
    beyond_reach[patches[free & (labels == NOBODY)]] = True
    labels[beyond_reach[patches]] = NOBODY


def _fill_holes(labels: Labels, number: int, most_cells: float) -> None:
    from scipy.ndimage import binary_fill_holes, label

    own = labels == number
    holes, _ = label(binary_fill_holes(own) & ~own, np.ones((3, 3)))
    size = np.bincount(holes.ravel())
    filled = size <= most_cells
    filled[np.unique(holes[labels != NOBODY])] = False  # 0, which is no hole, among them
    labels[filled[holes]] = number
