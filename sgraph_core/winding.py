"""How often surfaces wind around points.

Jacobson et al., "Robust Inside-Outside Segmentation using Generalized Winding Numbers", 2013: the
number is 1 inside a closed outline and 0 outside it, needs no closed outline, and is one half on
the straight line across a gap in one.
"""

from __future__ import annotations

import numpy as np

from sgraph_concepts.types import FloatArray
from sgraph_core.geometry import cross, dot

__all__ = ["winding"]


def winding(segments: FloatArray, points: FloatArray) -> FloatArray:
    """Return how often segments wind around each point.

    Args:
        segments: endpoints in the order of :class:`~sgraph_concepts.types.SurfaceArrays`, so that
            the inside is on the right, [N, 2, 2].
        points: [P, 2].

    Returns:
        Generalised winding numbers, positive where the segments face the points, [P].
    """
    angles = np.zeros(len(points))
    for first, second in segments:
        to_first, to_second = first - points, second - points
        # whoever stands inside sees the first endpoint on the left: clockwise, hence the minus
        angles -= np.arctan2(cross(to_first, to_second), dot(to_first, to_second))
    return angles / (2 * np.pi)
