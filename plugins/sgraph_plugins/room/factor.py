"""What a room tells the factor graph: which surfaces may be one of its own, mapped twice.

A wall surface that is seen again after the robot has drifted often becomes a second landmark.
The copy may be a member of this room, of a room of its own over this one, or of none. The back end
lets all proposed pairs vote.
"""

from __future__ import annotations

import numpy as np

from sgraph_concepts.types import ConceptNode, FactorContext, FactorResult
from sgraph_core.backend.coincidence import coincidence

__all__ = ["factors"]

SAME_ANGLE_RAD = np.radians(20.0)
FARTHEST_M = 5.0
"""How far off a copy may lie; so may the next room, which is for the votes to tell."""


def factors(node: ConceptNode, context: FactorContext) -> FactorResult:
    """Return the pairs of surfaces that may be one surface of this room seen twice."""
    if not context.segments:
        return FactorResult()
    corners = np.concatenate(list(context.segments.values()))
    box = np.append(corners.min(axis=0) - FARTHEST_M, corners.max(axis=0) + FARTHEST_M)
    surfaces = context.near(box)
    mine = np.flatnonzero(np.isin(surfaces.ids, list(context.segments)))
    alike = surfaces.normals[mine] @ surfaces.normals.T >= np.cos(SAME_ANGLE_RAD)
    alike[:, mine] &= mine[:, None] < mine  # two members would come in both orders
    which, two = np.nonzero(alike)
    lie = coincidence(surfaces, mine[which], two)
    twice = (lie.overlaps >= -FARTHEST_M) & (np.abs(lie.gaps) <= FARTHEST_M)
    pairs = surfaces.ids[np.stack([mine[which], two], axis=1)[twice]]
    return FactorResult(same=[(first, second) for first, second in pairs.tolist()])
