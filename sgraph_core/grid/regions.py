"""Which free cells of a grid belong to which room, for all rooms at once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sgraph_concepts.types import FloatArray, IntArray, OccupancyGrid, SurfaceArrays
from sgraph_core.grid.strips import count_labels, has_label, strips
from sgraph_core.winding import winding

__all__ = ["NOBODY", "Labels", "Mask", "label_cells", "windows"]

NOBODY = 0
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

Labels = NDArray[np.unsignedinteger[Any]]
"""Of as many bytes a cell as it takes to count the rooms."""
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
        1 for the first room and so on, or ``NOBODY``, [H, W]. The cells of a room are connected
        by their sides.
    """
    free = grid.cells == OccupancyGrid.FREE
    labels = _claimed([grid.to_cells(room.segments) for room in rooms], free)
    for label, window in windows(labels, len(rooms)):
        _keep_largest_part(labels[window], label)
    _spread(labels, free, round(REACH_M / grid.resolution))
    most_filled = LARGEST_FILLED_M2 / grid.resolution**2
    for label, window in windows(labels, len(rooms)):
        _fill_holes(labels[window], label, most_filled)
    return labels


def _claimed(rooms: Sequence[FloatArray], free: Mask) -> Labels:
    """Return which room's segments [N, 2, 2], in cells, wind most around each free cell.

    Where two do so equally often, one room lies within the other: the smaller one has it.
    """
    labels = np.full(free.shape, NOBODY, np.min_scalar_type(len(rooms)))
    to_beat = np.full(free.shape, INSIDE, np.float16)
    limits = [_limits(segments, free.shape) for segments in rooms]
    for number in sorted(
        range(len(rooms)), key=lambda room: np.prod(limits[room][1] - limits[room][0])
    ):
        low, high = limits[number]
        for rows, _ in strips((high[1] - low[1], high[0] - low[0])):
            bottom, top = low[1] + rows.start, low[1] + rows.stop
            window = np.s_[bottom:top, low[0] : high[0]]
            if free[window].any():
                times = _winding_of_cells(rooms[number] - (low[0], bottom), free[window])
                wins = free[window] & (times > to_beat[window])
                labels[window][wins] = number + 1
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

    near, size = np.zeros(shape, bool), np.array(shape[::-1])
    for first, second in segments / TILE:
        steps = int(2 * np.linalg.norm(second - first)) + 2
        points = first + np.linspace(0, 1, steps)[:, None] * (second - first)
        points = points[((points > -1) & (points < size + 1)).all(axis=1)]
        column, row = np.clip(points, 0, size - 1).astype(np.int64).T
        near[row, column] = True
    return np.asarray(binary_dilation(near, np.ones((3, 3))))


def windows(labels: Labels, count: int) -> list[tuple[int, tuple[slice, slice]]]:
    """Return the labels from 1 to ``count`` that cells have, and the window that holds them."""
    from scipy.ndimage import find_objects

    windows = find_objects(labels, count)
    return [(label, window) for label, window in enumerate(windows, 1) if window is not None]


def _keep_largest_part(labels: Labels, label: int) -> None:
    from scipy import ndimage

    parts, count = ndimage.label(labels == label)
    if count > 1:
        smaller = np.ones(count + 1, bool)
        smaller[[0, np.argmax(count_labels(parts, count)[1:]) + 1]] = False
        labels[has_label(parts, smaller)] = NOBODY


def _spread(labels: Labels, free: Mask, steps: int) -> None:
    """Give patches of free cells of nobody to the nearest labels, if so many steps reach all.

    Labels grow a cell a step; of equals the lower one wins.
    """
    patches = free & (labels == NOBODY)
    flat, in_patch = labels.reshape(-1), patches.reshape(-1)
    edge = _beside(patches, labels)
    given = [edge[:0]]
    for _ in range(steps):
        source, cell = _neighbours(edge, labels.shape)
        takes = in_patch[cell] & (flat[cell] == NOBODY)
        cell, taker = cell[takes], flat[source[takes]]
        order = np.lexsort((taker, cell))
        edge, first = np.unique(cell[order], return_index=True)
        flat[edge] = taker[order][first]
        given.append(edge)
    source, cell = _neighbours(np.concatenate(given), labels.shape)
    edge = np.unique(source[in_patch[cell] & (flat[cell] == NOBODY)])
    while len(edge):  # take back what was given of patches that go on
        flat[edge] = NOBODY
        _, cell = _neighbours(edge, labels.shape)
        edge = np.unique(cell[in_patch[cell] & (flat[cell] != NOBODY)])


def _neighbours(cells: IntArray, shape: tuple[int, ...]) -> tuple[IntArray, IntArray]:
    """Return cells, repeated, and those that share a side with each, numbered row by row."""
    row, column = np.divmod(cells, shape[1])
    sources, found = [], []
    for down, right in FOUR_NEIGHBOURS:
        inside = (row + down >= 0) & (row + down < shape[0])
        inside &= (column + right >= 0) & (column + right < shape[1])
        sources.append(cells[inside])
        found.append(cells[inside] + down * shape[1] + right)
    return np.concatenate(sources), np.concatenate(found)


def _beside(patches: Mask, labels: Labels) -> IntArray:
    """Return the labelled cells that share a side with a patch, numbered row by row."""
    from scipy.ndimage import binary_dilation

    found = []
    for rows, around in strips(labels.shape, 1):
        near = binary_dilation(patches[around])[rows.start - around.start :]
        beside = (labels[rows] != NOBODY) & near[: rows.stop - rows.start]
        found.append(np.flatnonzero(beside) + rows.start * labels.shape[1])
    return np.concatenate(found)


def _fill_holes(labels: Labels, label: int, most_cells: float) -> None:
    from scipy import ndimage

    own = labels == label
    inside = ndimage.binary_fill_holes(own) & ~own
    for window in ndimage.find_objects(inside.view(np.uint8)):  # around all of them, if any
        holes, count = ndimage.label(inside[window], np.ones((3, 3)))
        filled = count_labels(holes, count) <= most_cells
        filled[holes[(holes > 0) & (labels[window] != NOBODY)]] = False
        filled[0] = False  # which is no hole
        labels[window][has_label(holes, filled)] = label
