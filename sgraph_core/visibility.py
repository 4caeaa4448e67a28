"""Which surfaces see each other: lines of sight, and the doorways they pass.

Two surfaces of one room mostly see each other; surfaces of different rooms see each other through
doorways and through walls that the robot has not seen. Besides the share of free lines of sight,
the share that stays free when the gaps between collinear surfaces are closed is therefore counted:
a doorway is such a gap.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from sgraph_concepts.types import FloatArray, IntArray, SurfaceArrays
from sgraph_core.geometry import cross, dot, in_frames, lines_of, points_of

__all__ = ["CLOSED_GAPS_M", "facing_pairs", "nearest", "visibility"]

FRACTIONS = np.array([0.11, 0.37, 0.64, 0.89])
"""Where lines of sight start and end along a surface. Uneven, so that in a regular building they
do not all pass exactly through the ends of walls."""
CLEARANCE_M = 0.03
"""Lines of sight start this far in front of a surface, clear of what lies flat against it."""
IN_FRONT_M = 0.05
"""How far a surface must reach in front of another to be seen from it at all."""

PAIRS_AT_ONCE = 4096

CLOSED_GAPS_M = (1.4, 3.0, 6.0)
"""Widths up to which gaps are closed for columns 1, 2, ... of the visibility: doors, wide openings,
missing surfaces."""
GAP_ANGLE_RAD = np.radians(15.0)
GAP_OFFSET_M = 0.12
GAP_SLOPE = 0.05
"""Surfaces count as collinear over a gap when they are within 15 degrees, and offset by at most
12 cm and 5 % of the gap."""

NEAREST_RADIUS_M = 6.0
FARTHEST_RADIUS_M = 48.0
"""The search for facing surfaces starts with the first radius and doubles up to the second."""


def facing_pairs(surfaces: SurfaceArrays, count: int) -> IntArray:
    """Return the pairs of surfaces that face each other, for each the nearest ``count`` and ties.

    Two surfaces face each other when each reaches in front of the other. The neighbours are
    searched in circles that grow until ``count`` are found or 48 m are reached.

    Args:
        surfaces: N surfaces.
        count: how many neighbours each surface asks for; a pair is kept if either asks for it.

    Returns:
        Row indices, first below second, [P, 2].
    """
    total = len(surfaces)
    lines = lines_of(surfaces.segments)
    bounds, outwards = shapely.bounds(lines), np.array([-1.0, -1.0, 1.0, 1.0])
    tree = shapely.STRtree(lines)
    waiting = np.arange(total)
    radius = NEAREST_RADIUS_M
    keys = [np.empty(0, np.int64)]
    while len(waiting):
        asking, other = tree.query(shapely.box(*(bounds[waiting] + radius * outwards).T))
        asking = waiting[asking]
        facing = _reaches_in_front(surfaces, asking, other)
        asking, other = asking[facing], other[facing]
        facing = _reaches_in_front(surfaces, other, asking)
        asking, other = asking[facing], other[facing]
        distances = shapely.distance(lines[asking], lines[other])
        found = np.bincount(asking[distances <= radius], minlength=total)
        done = (found >= count) | (radius >= FARTHEST_RADIUS_M)
        answered = done[asking]
        asking, other, distances = asking[answered], other[answered], distances[answered]
        near = nearest(asking, distances, count)
        asking, other = asking[near], other[near]
        keys.append(np.minimum(asking, other) * total + np.maximum(asking, other))
        waiting = waiting[~done[waiting]]
        radius *= 2
    return np.stack(np.divmod(np.unique(np.concatenate(keys)), total), axis=1)


def nearest(groups: IntArray, distances: FloatArray, count: int) -> NDArray[np.bool_]:
    """Return which rows are among the ``count`` nearest of their group, ties included, [P]."""
    tie_m = 1e-6
    order = np.lexsort((distances, groups))
    sorted_groups, sorted_distances = groups[order], distances[order]
    starts = np.searchsorted(sorted_groups, sorted_groups)
    sizes = np.searchsorted(sorted_groups, sorted_groups, side="right") - starts
    limit = sorted_distances[starts + np.minimum(count, sizes) - 1] + tie_m
    near = np.empty(len(groups), bool)
    near[order] = sorted_distances <= limit
    return near


def _reaches_in_front(surfaces: SurfaceArrays, one: IntArray, two: IntArray) -> NDArray[np.bool_]:
    _, in_front = in_frames(surfaces, one, surfaces.segments[two])
    return np.asarray(np.maximum(in_front[:, 0], in_front[:, 1]) > IN_FRONT_M)


def visibility(surfaces: SurfaceArrays, pairs: IntArray) -> FloatArray:
    """Return the share of lines of sight between the surfaces of each pair that are free.

    Each pair is joined by 4 x 4 lines of sight. One is free when it leaves and arrives in front of
    the surfaces and crosses no other surface; in the further columns, neither a closed gap.

    Args:
        surfaces: N surfaces.
        pairs: row indices, [P, 2].

    Returns:
        Shares from 0 to 1, [P, 1 + len(CLOSED_GAPS_M)].
    """
    walls = _Obstacles.of(surfaces.segments)
    gaps, widths = _gaps(surfaces)
    closed_gaps = [_Obstacles.of(gaps[widths <= limit]) for limit in CLOSED_GAPS_M]
    shares = np.zeros((len(pairs), 1 + len(closed_gaps)))
    for start in range(0, len(pairs), PAIRS_AT_ONCE):  # bounds the memory
        some = pairs[start : start + PAIRS_AT_ONCE]
        rays = _Rays.between(surfaces, some)
        free = rays.valid & ~rays.blocked_by(walls, own=some)
        seeing = np.flatnonzero(free.any(axis=1))
        rays, free = rays.take(seeing), free[seeing]
        shares[start + seeing, 0] = free.mean(axis=1)
        for column, obstacles in enumerate(closed_gaps, start=1):
            shares[start + seeing, column] = (free & ~rays.blocked_by(obstacles)).mean(axis=1)
    return shares


@dataclass(frozen=True, eq=False)
class _Obstacles:
    """Segments [O, 2, 2] and their spatial index."""

    segments: FloatArray
    tree: shapely.STRtree

    @classmethod
    def of(cls, segments: FloatArray) -> _Obstacles:
        return cls(segments, shapely.STRtree(lines_of(segments)))


@dataclass(frozen=True, eq=False)
class _Rays:
    """The lines of sight of P pairs, R each: starts and directions [P, R, 2], valid ones [P, R]."""

    starts: FloatArray
    directions: FloatArray
    valid: NDArray[np.bool_]

    @classmethod
    def between(cls, surfaces: SurfaceArrays, pairs: IntArray) -> _Rays:
        one, two = pairs.T
        points = surfaces.segments[:, :1] + FRACTIONS[:, None] * (
            surfaces.segments[:, 1:] - surfaces.segments[:, :1]
        )
        points = points + CLEARANCE_M * surfaces.normals[:, None]
        count = len(FRACTIONS)
        starts = np.repeat(points[one], count, axis=1)
        directions = np.tile(points[two], (1, count, 1)) - starts
        leaves = dot(directions, surfaces.normals[one][:, None]) > 0
        arrives = dot(directions, surfaces.normals[two][:, None]) < 0
        return cls(starts, directions, leaves & arrives)

    def take(self, rows: IntArray) -> _Rays:
        return _Rays(self.starts[rows], self.directions[rows], self.valid[rows])

    def blocked_by(self, obstacles: _Obstacles, own: IntArray | None = None) -> NDArray[np.bool_]:
        """Return which rays cross an obstacle; a pair's own two are none, [P, R]."""
        blocked = np.zeros(self.valid.shape, bool)
        ends = self.starts + self.directions
        corners = np.stack([self.starts[:, 0], self.starts[:, -1], ends[:, 0], ends[:, -1]], axis=0)
        boxes = shapely.box(*np.hstack([corners.min(axis=0), corners.max(axis=0)]).T)
        pair, obstacle = obstacles.tree.query(boxes)
        if own is not None:
            foreign = (obstacle != own[pair, 0]) & (obstacle != own[pair, 1])
            pair, obstacle = pair[foreign], obstacle[foreign]
        between = _may_meet(corners[:, pair], obstacles.segments[obstacle].swapaxes(0, 1))
        pair, obstacle = pair[between], obstacle[between]
        # A ray start + u * direction crosses the segment first + v * along where 0 <= u, v <= 1.
        direction = self.directions[pair]
        first = obstacles.segments[obstacle, None, 0]
        along = obstacles.segments[obstacle, None, 1] - first
        to_first = first - self.starts[pair]
        scale = cross(direction, along)
        u, v = cross(to_first, along), cross(to_first, direction)
        crosses = (u * scale >= 0) & (np.abs(u) <= np.abs(scale))
        crosses &= (v * scale >= 0) & (np.abs(v) <= np.abs(scale)) & (scale != 0)
        np.logical_or.at(blocked, pair, crosses)
        return blocked


def _may_meet(corners: FloatArray, segments: FloatArray) -> NDArray[np.bool_]:
    """Return whether segments may meet the quadrilaterals between two lines.

    Says no only if the segment's line has all corners on one side, or a line between ends of the
    two lines has all corners on one side and the segment on the other.

    Args:
        corners: ends of the one line, then of the other, [4, P, 2].
        segments: [2, P, 2].
    """

    def sides(first: FloatArray, second: FloatArray, points: FloatArray) -> FloatArray:
        return cross(second - first, points - first)

    side = sides(segments[0], segments[1], corners)
    meets = (side.max(axis=0) >= 0) & (side.min(axis=0) <= 0)
    for one, two in ((0, 3), (1, 2)):
        own = sides(corners[one], corners[two], corners)
        other = sides(corners[one], corners[two], segments)
        apart = (own.min(axis=0) >= 0) & (other.max(axis=0) < 0)
        apart |= (own.max(axis=0) <= 0) & (other.min(axis=0) > 0)
        meets &= ~apart
    return np.asarray(meets)


def _gaps(surfaces: SurfaceArrays) -> tuple[FloatArray, FloatArray]:
    """Return the gaps between surfaces and the next collinear ones, [G, 2, 2], and their widths."""
    ends, starts = surfaces.segments[:, 1], surfaces.segments[:, 0]
    tree = shapely.STRtree(points_of(starts))
    one, two = tree.query(points_of(ends), predicate="dwithin", distance=max(CLOSED_GAPS_M))
    gap = starts[two] - ends[one]
    tangent = surfaces.tangents[one] + surfaces.tangents[two]
    tangent /= np.maximum(np.linalg.norm(tangent, axis=1), 1e-9)[:, None]
    width = (gap * tangent).sum(axis=1)
    collinear = (surfaces.normals[one] * surfaces.normals[two]).sum(axis=1) > np.cos(GAP_ANGLE_RAD)
    collinear &= (width > 0) & (np.abs(cross(gap, tangent)) < GAP_OFFSET_M + GAP_SLOPE * width)
    collinear &= one != two
    one, two, width = one[collinear], two[collinear], width[collinear]
    next_one = nearest(one, width, 1)
    one, two, width = one[next_one], two[next_one], width[next_one]
    return np.stack([ends[one], starts[two]], axis=1), width
