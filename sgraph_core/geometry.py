"""Plane geometry on arrays of segments."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from sgraph_concepts.types import FloatArray, IntArray, SurfaceArrays

__all__ = [
    "TIE_M",
    "Geometries",
    "closest_distances",
    "cross",
    "dot",
    "in_frames",
    "lines_of",
    "nearest",
    "points_of",
]


TIE_M = 1e-6
"""Distances that differ by less are the same."""


def cross(one: FloatArray, two: FloatArray) -> FloatArray:
    """Return the z component of the cross product of plane vectors, [..., 2] each."""
    return np.asarray(one[..., 0] * two[..., 1] - one[..., 1] * two[..., 0])


Geometries = NDArray[np.object_]
"""shapely geometries, [N]."""


def lines_of(segments: FloatArray) -> Geometries:
    """Return segments [N, 2, 2] as shapely lines [N]."""
    return np.asarray(shapely.linestrings(segments))


def points_of(coordinates: FloatArray) -> Geometries:
    """Return positions [N, 2] as shapely points [N]."""
    return np.asarray(shapely.points(coordinates))


def dot(one: FloatArray, two: FloatArray) -> FloatArray:
    """Return the dot product of plane vectors, [..., 2] each."""
    return np.asarray(one[..., 0] * two[..., 0] + one[..., 1] * two[..., 1])


def closest_distances(segments: FloatArray, one: IntArray, two: IntArray) -> FloatArray:
    """Return the closest distances between pairs of segments, [P]."""
    lines = lines_of(segments)
    return np.asarray(shapely.distance(lines[one], lines[two]))


def in_frames(
    surfaces: SurfaceArrays, frames: IntArray, points: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return points in the frames of surfaces: x along it from its midpoint, y in front of it.

    Args:
        surfaces: N surfaces.
        frames: row of the surface in whose frame each group of points is wanted, [P].
        points: [P, K, 2].

    Returns:
        x and y, [P, K] each.
    """
    offset = points - surfaces.midpoints[frames][:, None]
    return (
        dot(offset, surfaces.tangents[frames][:, None]),
        dot(offset, surfaces.normals[frames][:, None]),
    )


def nearest(groups: IntArray, distances: FloatArray, count: int) -> NDArray[np.bool_]:
    """Return which rows are among the ``count`` nearest of their group, ties included, [P]."""
    order = np.lexsort((distances, groups))
    sorted_groups, sorted_distances = groups[order], distances[order]
    starts = np.searchsorted(sorted_groups, sorted_groups)
    sizes = np.searchsorted(sorted_groups, sorted_groups, side="right") - starts
    limit = sorted_distances[starts + np.minimum(count, sizes) - 1] + TIE_M
    near = np.empty(len(groups), bool)
    near[order] = sorted_distances <= limit
    return near
