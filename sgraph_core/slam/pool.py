"""Arrays whose rows keep their numbers while others come and go, and boxes to find rows by."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from sgraph_concepts.types import FloatArray, IntArray

__all__ = ["OUTWARDS", "Pool", "boxes_around", "meeting", "rows_of", "rows_where"]

OUTWARDS = np.array([-1.0, -1.0, 1.0, 1.0])
"""What a box grows by for each metre of margin."""


class Pool:
    """Named columns over the same rows. A row keeps its number; those of what is gone are reused.

    Args:
        columns: by name, an empty array [0, ...] that gives a column's width and type.
    """

    def __init__(self, **columns: NDArray[Any]) -> None:
        self._columns = {**columns, "alive": np.empty(0, bool)}
        self._used = 0
        self._free: list[int] = []
        self._gone: list[int] = []

    def __getitem__(self, column: str) -> NDArray[Any]:
        return self._columns[column][: self._used]

    def __len__(self) -> int:
        """Numbers in use or used before."""
        return self._used

    @property
    def alive(self) -> IntArray:
        """The rows in use."""
        return np.flatnonzero(self["alive"])

    def add(self, count: int, **values: NDArray[Any]) -> IntArray:
        """Add rows; return their numbers. Columns that are not given are for the caller to fill."""
        again = [self._free.pop() for _ in range(min(count, len(self._free)))]
        rows = np.array([*again, *range(self._used, self._used + count - len(again))], np.int64)
        self._used += count - len(again)
        for name, column in self._columns.items():
            if self._used > len(column):
                size = max(self._used, 2 * len(column))
                grown = np.empty((size, *column.shape[1:]), column.dtype)
                grown[: len(column)] = column
                self._columns[name] = grown
        for name, value in values.items():
            self._columns[name][rows] = value
        self._columns["alive"][rows] = True
        return rows

    def remove(self, rows: IntArray) -> None:
        """Remove rows; their numbers are not used again before :meth:`settle`."""
        self._columns["alive"][rows] = False
        self._gone += rows.tolist()

    def meeting(self, column: str, targets: FloatArray, margin: float | str) -> IntArray:
        """Return which rows have a box that comes within a margin of any target, along both axes.

        Args:
            column: of the boxes.
            targets: boxes, [M, 4].
            margin: in metres, or the column of each row's own.
        """
        margins = self[margin] if isinstance(margin, str) else margin
        return meeting(self[column], targets, margins, self["alive"])

    def settle(self) -> None:
        """Let the numbers of removed rows be used again."""
        self._free += self._gone
        self._gone = []


def meeting(
    boxes: FloatArray,
    targets: FloatArray,
    margins: FloatArray | float,
    among: NDArray[np.bool_] | bool = True,
) -> IntArray:
    """Return which boxes come within a margin of any target, along both axes.

    Args:
        boxes: [N, 4].
        targets: boxes, [M, 4].
        margins: in metres, one for all boxes or one for each, [N].
        among: which boxes count, [N].
    """
    if not len(targets):
        return np.empty(0, np.int64)
    (left, bottom), (right, top) = targets[:, :2].min(axis=0), targets[:, 2:].max(axis=0)
    # all boxes are compared along one axis only: this is what grows with the map
    meets = among & (boxes[:, 0] <= right + margins) & (boxes[:, 2] >= left - margins)
    near = np.flatnonzero(meets)
    wide = boxes[near] + np.broadcast_to(margins, len(boxes))[near, None] * OUTWARDS
    level = (wide[:, 1] <= top) & (wide[:, 3] >= bottom)
    near, wide = near[level], wide[level]
    if len(targets) == 1:
        return near
    tree = shapely.STRtree(np.asarray(shapely.box(*targets.T)))
    asking, _ = tree.query(np.asarray(shapely.box(*wide.T)))
    return np.asarray(near[np.unique(asking)])


def rows_of(numbers: Iterable[int]) -> IntArray:
    """Return row numbers as an ascending array."""
    return np.array(sorted(numbers), np.int64)


def boxes_around(segments: FloatArray) -> FloatArray:
    """Return the bounding boxes x, y, x, y of segments [N, 2, 2], [N, 4]."""
    return np.concatenate([segments.min(axis=1), segments.max(axis=1)], axis=1)


def rows_where(size: int, *numbers: IntArray) -> IntArray:
    """Return the row numbers below ``size`` that are in any of the arrays, ascending, each once."""
    present = np.zeros(size, bool)
    if numbers:
        present[np.concatenate(numbers)] = True
    return np.flatnonzero(present)
