"""Work on large grids a strip of rows at a time, which bounds the memory that it takes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sgraph_concepts.types import IntArray

__all__ = ["count_labels", "has_label", "strips"]

STRIP_CELLS = 2**20
"""How many cells are worked on at a time."""
FEWEST_ROWS = 16
"""Strips of very wide grids are larger, lest most of a strip is what it shares with others."""
MARGINS = 8
"""Strips with a margin are at least this many times as high as one margin, for the same reason."""


def strips(shape: tuple[int, ...], margin: int = 0) -> Iterator[tuple[slice, slice]]:
    """Yield the rows of each strip, and the same rows with a margin around, within the grid."""
    height, width = shape
    if width == 0:
        return
    step = max(FEWEST_ROWS, MARGINS * margin, STRIP_CELLS // width)
    for low in range(0, height, step):
        high = min(low + step, height)
        yield slice(low, high), slice(max(low - margin, 0), min(high + margin, height))


def count_labels(labels: NDArray[np.integer[Any]], count: int) -> IntArray:
    """Return how many cells have each label from 0 to ``count``, [count + 1]."""
    total = np.zeros(count + 1, np.int64)
    for rows, _ in strips(labels.shape):  # numpy widens what it counts to 8 bytes a cell
        total += np.bincount(labels[rows].ravel(), minlength=count + 1)
    return total


def has_label(labels: NDArray[np.integer[Any]], wanted: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which cells have one of the labels that are wanted, [H, W]."""
    result = np.empty(labels.shape, bool)
    for rows, _ in strips(labels.shape):  # numpy widens what it looks up by to 8 bytes a cell
        result[rows] = wanted[labels[rows]]
    return result
