"""Plane geometry on arrays of segments."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from sgraph_concepts.types import FloatArray, IntArray, SurfaceArrays

__all__ = [
    "TIE_M",
    "Geometries",
    "boxes_of",
    "close_together",
    "closest_distances",
    "cross",
    "dot",
    "in_frames",
    "lines_of",
    "meeting_box",
    "nearest",
    "origin_near",
    "points_of",
    "rectangle_sides",
    "turn_left",
    "unique_pairs",
]


TIE_M = 1e-6
"""Distances that differ by less are the same."""


def cross(one: FloatArray, two: FloatArray) -> FloatArray:
    """Return the z component of the cross product of plane vectors, [..., 2] each."""
    return np.asarray(one[..., 0] * two[..., 1] - one[..., 1] * two[..., 0])


def turn_left(vectors: FloatArray) -> FloatArray:
    """Return vectors [..., 2] turned by +90 degrees."""
    return np.stack([-vectors[..., 1], vectors[..., 0]], axis=-1)


Geometries = NDArray[np.object_]
"""shapely geometries, [N]."""


def lines_of(segments: FloatArray) -> Geometries:
    """Return segments [N, 2, 2] as shapely lines [N]."""
    return np.asarray(shapely.linestrings(segments))


def points_of(coordinates: FloatArray) -> Geometries:
    """Return positions [N, 2] as shapely points [N]."""
    return np.asarray(shapely.points(coordinates))


def boxes_of(corners: FloatArray, margin: float = 0.0) -> Geometries:
    """Return what has the boxes around points, to ask a spatial index with, [N].

    Args:
        corners: of each box, [N, K, 2].
        margin: how far each box reaches beyond them.
    """
    lowest, highest = corners.min(axis=1) - margin, corners.max(axis=1) + margin
    # the index looks at nothing but the boxes of what it is asked with, and lines are made in
    # two thirds of the time of polygons
    return lines_of(np.stack([lowest, highest], axis=1))


def meeting_box(segments: FloatArray, others: FloatArray, margin: float = 0.0) -> NDArray[np.bool_]:
    """Return which segments [N, 2, 2] have boxes that meet the one around all others, [N].

    Args:
        segments: whose boxes.
        others: one or more, [M, 2, 2].
        margin: how far the box reaches beyond the others.
    """
    low, high = others.min(axis=(0, 1)) - margin, others.max(axis=(0, 1)) + margin
    one, two = segments[:, 0], segments[:, 1]
    meets = (np.minimum(one, two) <= high) & (np.maximum(one, two) >= low)
    return np.asarray(meets.all(axis=1))


def origin_near(points: FloatArray) -> FloatArray:
    """Return the middle of points [N, D] in whole hundreds of metres, [D]; 0 if there are none.

    Planes far from the origin are ill conditioned. What lies near the world's keeps that one.
    """
    if not len(points):
        return np.zeros(points.shape[1])
    return np.asarray(100.0 * np.round(points.mean(axis=0) / 100.0))


def rectangle_sides(shapes: Geometries) -> FloatArray:
    """Return the sides of the smallest rectangle around each shape, the shorter one first, [N, 2].

    Both are 0 where all of the shape lies in one line.
    """
    corners, of = shapely.get_coordinates(
        shapely.minimum_rotated_rectangle(shapes), return_index=True
    )
    wide = np.bincount(of, minlength=len(shapes)) == 5  # a closed ring
    along = np.diff(corners[wide[of]].reshape(-1, 5, 2)[:, :3], axis=1)
    sides = np.zeros((len(shapes), 2))
    sides[wide] = np.sort(np.linalg.norm(along, axis=2), axis=1)
    return sides


def dot(one: FloatArray, two: FloatArray) -> FloatArray:
    """Return the dot product of plane vectors, [..., 2] each."""
    return np.asarray(one[..., 0] * two[..., 0] + one[..., 1] * two[..., 1])


def closest_distances(segments: FloatArray, one: IntArray, two: IntArray) -> FloatArray:
    """Return the closest distances between pairs of segments, [P]."""
    lines = lines_of(segments)
    return np.asarray(shapely.distance(lines[one], lines[two]))


def close_together(
    segments: FloatArray, others: FloatArray, distance_m: float
) -> tuple[IntArray, IntArray]:
    """Return which segments come this close to which others.

    Args:
        segments: [N, 2, 2].
        others: [M, 2, 2].
        distance_m: the largest distance.

    Returns:
        Rows of the segments and of the others, [P] each.
    """
    lines, other_lines = lines_of(segments), lines_of(others)
    # testing what the boxes leave is faster than a query with the predicate "dwithin"
    one, two = shapely.STRtree(other_lines).query(boxes_of(segments, distance_m + TIE_M))
    close = shapely.dwithin(lines[one], other_lines[two], distance_m)
    return one[close], two[close]


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


def unique_pairs(one: IntArray, two: IntArray) -> IntArray:
    """Return pairs of rows in order, each once and its lower row first, [P, 2]."""
    if not len(one):
        return np.empty((0, 2), np.int64)
    total = max(one.max(), two.max()) + 1
    keys = np.sort(np.minimum(one, two) * total + np.maximum(one, two))
    first = np.diff(keys, prepend=-1) > 0  # much faster than np.unique, which hashes
    return np.stack(np.divmod(keys[first], total), axis=1)


def nearest(groups: IntArray, distances: FloatArray, count: int) -> NDArray[np.bool_]:
    """Return which rows are among the ``count`` nearest of their group, ties included, [P]."""
    if not len(groups):
        return np.zeros(0, bool)
    by_distance = np.argsort(distances)
    # numpy sorts 16-bit integers by radix, several times as fast as wider ones
    short = groups.astype(np.min_scalar_type(groups.max()))
    order = by_distance[np.argsort(short[by_distance], kind="stable")]
    sizes = np.bincount(groups)
    farthest = np.cumsum(sizes) - sizes + np.minimum(count, sizes) - 1
    limits = distances[order[farthest]] + TIE_M
    return np.asarray(distances <= limits[groups])
