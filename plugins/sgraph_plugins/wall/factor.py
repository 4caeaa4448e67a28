"""What a wall tells the factor graph: its two sides are parallel, at the wall's thickness.

Thickness must come from somewhere else than the two planes themselves, or the tie would only repeat
the map's own error: it is the median of the walls that a building evidently builds alike. A wall
that is like no others gets its sides held parallel, and weakly as far apart as they were mapped if
that was done in one go: a side seen from afar would else turn about the observer's foot on its
plane, and leave the other. Of sides that were mapped at different times, drift may be part of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from sgraph_concepts.types import ConceptNode, FactorContext, FactorResult, FloatArray
from sgraph_core.backend.ties import TieNoise, tie_planes

__all__ = ["factors", "known_thicknesses", "typical_thickness"]

ANGLE_SIGMA_RAD = 0.02
LEAST_SIGMA_M = 0.015
OWN_SIGMA_M = 0.1
"""Of the thickness of a wall that is like no others and was mapped in one go."""
AT_ONCE = 15
"""Keyframes between the first sights of both sides of such a wall, at most."""
FREE_SIGMA_M = 10.0
"""Of the thickness of a wall whose mapped one tells nothing."""
ALIKE_M = 0.04
"""Walls whose mapped thicknesses differ by no more are counted as built alike."""
THINNEST_M = 0.03
"""Sides that are mapped closer together, or across one another, tell nothing of a thickness."""
FEWEST_ALIKE = 3
FARTHEST_M = 1.0
"""Sides that are mapped farther apart, or farther across one another, are not of one wall."""
ASKEW = np.array([0.8, 0.6])
"""A direction that hardly any wall's normal is perpendicular to."""
LEAST_CONFIDENCE = 0.1
"""A node's confidence divides the variance of its factors, down to this."""


def factors(node: ConceptNode, context: FactorContext) -> FactorResult:
    """Return the factors of one wall; none unless both sides were observed."""
    if len(context.plane_keys) < 2 or node.shape.centre is None or node.shape.thickness is None:
        return FactorResult()
    one, two = node.members
    normal = context.planes[one][:2] - context.planes[two][:2]
    size = float(np.linalg.norm(normal))
    if size < 1.0 or not _possible(node, context):  # the sides do not face opposite ways: no wall
        return FactorResult()
    known = context.memory.recall("thicknesses", partial(known_thicknesses, context.nodes))
    apart = abs(context.first_seen[one] - context.first_seen[two])
    own_sigma = OWN_SIGMA_M if apart <= AT_ONCE else FREE_SIGMA_M
    thickness, sigma = typical_thickness(node.shape.thickness, known, own_sigma)
    sure = 1.0 if node.confidence is None else max(node.confidence, LEAST_CONFIDENCE)
    doubt = 1 / np.sqrt(sure)
    # a wall that keeps one side only may turn about: its anchor must not keep the old direction
    anchor = context.new_key(int(normal @ ASKEW > 0))
    return tie_planes(
        (context.plane_keys[one], context.plane_keys[two]),
        anchor,
        np.array(node.shape.centre),
        normal / size,
        thickness,
        TieNoise(ANGLE_SIGMA_RAD * doubt, sigma * doubt),
    )


def _possible(node: ConceptNode, context: FactorContext) -> bool:
    """Return whether the sides lie back to back, as far as a drifted map can tell."""
    centre = np.array([*(node.shape.centre or (0.0, 0.0)), 0.0, 1.0])
    return abs(-sum(float(plane @ centre) for plane in context.planes.values())) <= FARTHEST_M


def known_thicknesses(walls: Sequence[ConceptNode]) -> FloatArray:
    """Return the mapped thicknesses of the walls that count, ascending, in metres."""
    known = np.sort([wall.shape.thickness or 0.0 for wall in walls])
    return np.asarray(known[known >= THINNEST_M])


def typical_thickness(own: float, known: FloatArray, own_sigma: float) -> tuple[float, float]:
    """Return the thickness that a wall should have, and its standard deviation, in metres.

    The walls within 4 cm of this one's mapped thickness are its group, this one included.

    Args:
        own: the wall's mapped thickness.
        known: those of all walls, ascending.
        own_sigma: what the mapped thickness is worth where no others are like it.
    """
    first = np.searchsorted(known, own - ALIKE_M)
    group = known[first : np.searchsorted(known, own + ALIKE_M, side="right")]
    if len(group) < FEWEST_ALIKE:
        return own, own_sigma if own >= THINNEST_M else FREE_SIGMA_M
    typical = _median(group)
    spread = 1.4826 * _median(np.sort(np.abs(group - typical)))
    return typical, max(spread, LEAST_SIGMA_M)


def _median(ascending: FloatArray) -> float:
    # np.median takes a hundred times as long, twice for each wall
    last = len(ascending) - 1
    return float(ascending[last // 2] + ascending[last - last // 2]) / 2
