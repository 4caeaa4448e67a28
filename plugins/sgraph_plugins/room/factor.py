"""What a room tells the factor graph: which surfaces may be one of its own, mapped twice.

A wall surface that is seen again after the robot has drifted often becomes a second landmark.
The copy may be a member of this room, of a room of its own over this one, or of none. The back end
lets all proposed pairs vote.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from sgraph_concepts.types import (
    ConceptNode,
    FactorContext,
    FactorResult,
    FloatArray,
    IntArray,
    SurfaceArrays,
)
from sgraph_core.backend.coincidence import coincidence

__all__ = ["factors"]

SAME_ANGLE_RAD = np.radians(20.0)
FARTHEST_M = 3.0
"""Beyond this distance a surface that faces the same way may well be another room's."""


@dataclass(frozen=True, eq=False)
class _Places:
    """Where the N observed surfaces are.

    Attributes:
        row: of each surface's id.
        low, high: corners of the boxes around the surfaces, [2, N].
    """

    row: Mapping[int, int]
    low: FloatArray
    high: FloatArray

    @classmethod
    def of(cls, surfaces: SurfaceArrays) -> _Places:
        row = {surface: row for row, surface in enumerate(surfaces.ids.tolist())}
        one, two = np.ascontiguousarray(surfaces.segments.transpose(1, 2, 0))
        return cls(row, np.minimum(one, two), np.maximum(one, two))

    def near(self, rows: IntArray) -> IntArray:
        """Return which surfaces reach into the box around some of them."""
        x, y = self.low[:, rows].min(axis=1) - FARTHEST_M
        right, top = self.high[:, rows].max(axis=1) + FARTHEST_M
        reach = (self.high[0] >= x) & (self.low[0] <= right)
        return np.flatnonzero(reach & (self.high[1] >= y) & (self.low[1] <= top))


def factors(node: ConceptNode, context: FactorContext) -> FactorResult:
    """Return the pairs of surfaces that may be one surface of this room seen twice."""
    places = context.memory.recall("places", partial(_Places.of, context.surfaces))
    members = sorted(places.row[member] for member in node.members if member in places.row)
    if not members:
        return FactorResult()
    near = places.near(np.array(members, np.int64))
    surfaces = context.surfaces.take(near)
    mine = np.searchsorted(near, members)
    alike = surfaces.normals[mine] @ surfaces.normals.T >= np.cos(SAME_ANGLE_RAD)
    alike[:, mine] &= mine[:, None] < mine  # two members would come in both orders
    which, two = np.nonzero(alike)
    lie = coincidence(surfaces, mine[which], two)
    twice = (lie.overlaps >= -FARTHEST_M) & (np.abs(lie.gaps) <= FARTHEST_M)
    pairs = surfaces.ids[np.stack([mine[which], two], axis=1)[twice]]
    return FactorResult(same=[(first, second) for first, second in pairs.tolist()])
