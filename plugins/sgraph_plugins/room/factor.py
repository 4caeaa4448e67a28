"""What a room tells the factor graph: surfaces of it that lie in one plane are one surface.

A wall surface that is seen again after the robot has drifted often becomes a second landmark.
Inside one room no two surfaces lie side by side and face the same way, so they are tied together.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

from sgraph_concepts.types import ConceptNode, FactorContext, FactorResult, FloatArray
from sgraph_core.backend.ties import TieNoise, tie_planes

__all__ = ["factors"]

SAME_ANGLE_RAD = np.radians(8.0)
SAME_OFFSET_M = 0.2
LEAST_OVERLAP_M = 0.3
NOISE = TieNoise(angle_rad=0.02, distance_m=0.03)


def factors(node: ConceptNode, context: FactorContext) -> FactorResult:
    """Return ties between the members that are evidently one surface seen twice."""
    ties = [
        tie_planes(
            (context.plane_keys[one], context.plane_keys[two]),
            context.new_key(number),
            middle,
            context.planes[one][:2],
            None,
            NOISE,
        )
        for number, (one, two, middle) in enumerate(_seen_twice(node, context))
    ]
    return FactorResult(
        [factor for tie in ties for factor in tie.factors],
        [value for tie in ties for value in tie.values],
    )


def _seen_twice(node: ConceptNode, context: FactorContext) -> list[tuple[int, int, FloatArray]]:
    """Return the pairs of members that overlap in nearly one plane, and where."""
    pairs = []
    members = [member for member in node.members if member in context.planes]
    for one, two in combinations(members, 2):
        normal, other = context.planes[one][:2], context.planes[two][:2]
        if normal @ other < np.cos(SAME_ANGLE_RAD):
            continue
        tangent = np.array([-normal[1], normal[0]])
        low, high = _common(context.segments[one] @ tangent, context.segments[two] @ tangent)
        foot = -context.planes[one][3] * normal + (low + high) / 2 * tangent
        gap = other @ foot + context.planes[two][3]
        if high - low >= LEAST_OVERLAP_M and abs(gap) <= SAME_OFFSET_M:
            pairs.append((one, two, foot - gap / 2 * other))
    return pairs


def _common(one: FloatArray, two: FloatArray) -> tuple[float, float]:
    return max(one.min(), two.min()), min(one.max(), two.max())
