"""What a room tells the factor graph: which surfaces may be one of its own, mapped twice.

A wall surface that is seen again after the robot has drifted often becomes a second landmark.
The copy may be a member of this room, of a room of its own over this one, or of none. The back end
lets all proposed pairs vote.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sgraph_concepts.types import ConceptNode, FactorContext, FactorResult, IntArray, SurfaceArrays
from sgraph_core.backend.coincidence import coincidence

__all__ = ["factors"]

SAME_ANGLE_RAD = np.radians(20.0)
FARTHEST_M = 3.0
"""Beyond this distance a surface that faces the same way may well be another room's."""


def factors(node: ConceptNode, context: FactorContext) -> FactorResult:
    """Return the pairs of surfaces that may be one surface of this room seen twice."""
    surfaces = context.surfaces
    mine = np.flatnonzero(np.isin(surfaces.ids, node.members))
    if not len(mine):
        return FactorResult()
    near = np.flatnonzero(_near(surfaces, mine))
    one, two = (grid.ravel() for grid in np.meshgrid(mine, near, indexing="ij"))
    once = ~np.isin(two, mine) | (one < two)  # two members would come in both orders
    one, two = one[once], two[once]
    lie = coincidence(surfaces, one, two)
    twice = (lie.overlaps >= -FARTHEST_M) & (np.abs(lie.gaps) <= FARTHEST_M)
    twice &= np.abs(lie.angles) <= SAME_ANGLE_RAD
    pairs = surfaces.ids[np.stack([one[twice], two[twice]], axis=1)]
    return FactorResult(same=[(first, second) for first, second in pairs.tolist()])


def _near(surfaces: SurfaceArrays, mine: IntArray) -> NDArray[np.bool_]:
    """Return which surfaces reach into the box around the room's own."""
    low = surfaces.segments[mine].min(axis=(0, 1)) - FARTHEST_M
    high = surfaces.segments[mine].max(axis=(0, 1)) + FARTHEST_M
    ends = surfaces.segments
    return np.asarray(((ends.max(axis=1) >= low) & (ends.min(axis=1) <= high)).all(axis=1))
