"""When which surface was seen, and how far the robot went in between."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from sgraph_core.graph import SGraph

__all__ = ["Visits"]

AWAY = 15
"""A surface that so many keyframes did not see is visited anew."""


class Visits:
    """The keyframes, by row, that saw each surface of an S-Graph."""

    def __init__(self, graph: SGraph) -> None:
        self._seen: dict[int, list[int]] = {}
        table = graph.observations
        rows = [graph.keyframe_row(i) for i in table.keyframe_ids.tolist()]
        for row, surface in sorted(zip(rows, table.surface_ids.tolist(), strict=True)):
            self._seen.setdefault(surface, []).append(row)
        positions = graph.keyframes.poses[:, :2]
        steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
        self._ways = np.concatenate([[0.0], np.cumsum(steps)])

    def __contains__(self, surface: int) -> bool:
        """Return whether some keyframe saw a surface."""
        return surface in self._seen

    def first(self, surface: int) -> int:
        """Return the first keyframe that saw a surface."""
        return self._seen[surface][0]

    def last_before(self, surface: int, row: int) -> int:
        """Return the last keyframe before a row that saw a surface, or else the first."""
        before = [k for k in self._seen[surface] if k < row]
        return before[-1] if before else self._seen[surface][0]

    def together(self, one: int, two: int) -> bool:
        """Return whether some keyframe saw both surfaces."""
        return not set(self._seen[one]).isdisjoint(self._seen[two])

    def first_visit(self, surface: int) -> tuple[int, int]:
        """Return the first and the last keyframe of the first visit to a surface."""
        return self.visits(surface)[0]

    def returns(self) -> list[tuple[int, tuple[int, int]]]:
        """Return surfaces that were seen again after a while, and those later visits."""
        return [(surface, visit) for surface in self._seen for visit in self.visits(surface)[1:]]

    def visits(self, surface: int) -> list[tuple[int, int]]:
        """Return the first and the last keyframe of each visit to a surface."""
        rows = self._seen[surface]
        gaps = [(last, first) for last, first in pairwise(rows) if first - last > AWAY]
        starts, ends = [first for _, first in gaps], [last for last, _ in gaps]
        return list(zip([rows[0], *starts], [*ends, rows[-1]], strict=True))

    def way(self, first: int, last: int) -> float:
        """Return how far the robot went from one keyframe to another, in metres."""
        return float(abs(self._ways[last] - self._ways[first]))
