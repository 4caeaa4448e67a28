"""What fragments have in common with the map, kept up to date while it grows."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from sgraph_concepts.types import FloatArray, IntArray
from sgraph_core.slam.fragments import Changed
from sgraph_core.slam.pairs import LivePairs
from sgraph_core.slam.pool import Pool
from sgraph_core.support import FARTHEST_M, collinear, lines_near, turns

__all__ = ["LiveSupport"]

SAME_SUPPORT = 0.001
"""A value that differs by less from the one that was scored by is the same: a building's
directions change a little with every surface, and with them the alignment of all others."""
ROWS_AT_ONCE = 64
"""Of how many fragments the lines are followed at once, to bound memory."""


class LiveSupport:
    """Keeps up the columns ``in_line``, ``turn`` and ``support`` of fragments.

    Args:
        fragments: their pool, changed by its owner before each update.
        pairs: gives the fragments near the origin, where computing costs no precision.
    """

    def __init__(self, fragments: Pool, pairs: LivePairs) -> None:
        self._fragments, self._pairs = fragments, pairs
        self._turns, self._length = np.zeros(2), 0.0

    def update(self, changed: Changed) -> IntArray:
        """Take in what became of the fragments; return the rows whose support is another now."""
        pool = self._fragments
        pool["in_line"][changed.added] = 0.0
        pool["turn"][changed.added] = turns(self._pairs.surfaces(changed.added))
        pool["support"][changed.added] = np.nan
        stay = pool["alive"].copy()
        stay[changed.added] = False
        self._count(changed.removed, -1, stay)
        self._count(changed.added, 1, stay)
        rows = pool.alive
        now = self._support(rows)
        other = ~(np.abs(now - pool["support"][rows]) <= SAME_SUPPORT).all(axis=1)
        pool["support"][rows[other]] = now[other]
        return np.asarray(rows[other])

    def _support(self, rows: IntArray) -> FloatArray:
        in_line = np.maximum(self._fragments["in_line"][rows], 0)  # what is gone leaves rounding
        aligned = self._fragments["turn"][rows] @ self._turns / self._length
        return np.column_stack([np.log1p(in_line), aligned])

    def _count(self, rows: IntArray, sign: int, stay: NDArray[np.bool_]) -> None:
        """Count fragments that came, or no longer those that went."""
        for some in self._neighbouring(rows):
            lengths = self._pairs.surfaces(some).lengths
            self._turns += sign * (lengths @ self._fragments["turn"][some])
            self._length += sign * lengths.sum()
            self._count_in_line(some, sign, stay)

    def _neighbouring(self, rows: IntArray) -> Iterator[IntArray]:
        """Yield the rows, a few at once that are near one another along x."""
        order = rows[np.argsort(self._fragments["box"][rows, 0])]
        for first in range(0, len(order), ROWS_AT_ONCE):
            yield np.sort(order[first : first + ROWS_AT_ONCE])

    def _count_in_line(self, some: IntArray, sign: int, stay: NDArray[np.bool_]) -> None:
        pool = self._fragments
        rows = np.union1d(some, pool.meeting("box", pool["box"][some], FARTHEST_M))
        surfaces = self._pairs.surfaces(rows)
        one, two = lines_near(surfaces, np.searchsorted(rows, some))
        shares, lengths = collinear(surfaces, one, two), surfaces.lengths[:, None]
        others = stay[rows[two]]
        changes = sign * shares[others] * lengths[one[others]]
        np.add.at(pool["in_line"], rows[two[others]], changes)
        if sign > 0:
            np.add.at(pool["in_line"], rows[one], shares * lengths[two])
