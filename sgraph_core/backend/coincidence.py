"""How far two surfaces that face the same way are from being one surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sgraph_concepts.types import FloatArray, IntArray, SurfaceArrays
from sgraph_core.geometry import cross, dot, in_frames

__all__ = ["Coincidence", "coincidence"]


@dataclass(frozen=True, eq=False)
class Coincidence:
    """P pairs of surfaces, compared where they lie side by side.

    Attributes:
        overlaps: lengths along which the surfaces of a pair lie side by side; negative where they
            do not, [P].
        points: middles of these lengths, on the first surface, [P, 2].
        angles: headings of the first surface's normal less the second's, [P].
        gaps: offsets of the first surface along its normal less the second's, at the points, [P].
    """

    overlaps: FloatArray
    points: FloatArray
    angles: FloatArray
    gaps: FloatArray


def coincidence(surfaces: SurfaceArrays, one: IntArray, two: IntArray) -> Coincidence:
    """Return how pairs of surfaces, given by rows, differ from lying in one plane."""
    along, _ = in_frames(surfaces, one, surfaces.segments[two])
    half = surfaces.lengths[one] / 2
    low = np.maximum(along.min(axis=1), -half)
    high = np.minimum(along.max(axis=1), half)
    middle = np.clip((low + high) / 2, -half, half)
    points = surfaces.midpoints[one] + middle[:, None] * surfaces.tangents[one]
    first, second = surfaces.normals[one], surfaces.normals[two]
    angles = np.arctan2(cross(second, first), dot(second, first))
    # a plane's offset at a point is the distance of the point in front of it
    gaps = -dot(points - surfaces.midpoints[two], second)
    return Coincidence(high - low, points, angles, gaps)
