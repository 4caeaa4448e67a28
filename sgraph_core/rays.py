"""Lines of sight between pairs of surfaces, and what they cross.

Arrays hold the coordinates first, [2, ...]: x of all, then y of all.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray

from sgraph_concepts.types import FloatArray, IntArray, SurfaceArrays
from sgraph_core.closures import Closures
from sgraph_core.geometry import lines_of

__all__ = ["Obstacles", "Rays"]

FRACTIONS = np.array([0.11, 0.37, 0.64, 0.89])
"""Where lines of sight start and end along a surface. Uneven, so that in a regular building they
do not all pass exactly through the ends of walls."""
CLEARANCE_M = 0.03
"""Lines of sight start this far in front of a surface, clear of what lies flat against it."""


@dataclass(frozen=True, eq=False)
class Obstacles:
    """First and second ends of O segments [2, 2, O], their widths [O] and their spatial index."""

    ends: FloatArray
    widths: FloatArray
    tree: shapely.STRtree

    @classmethod
    def of(cls, closures: Closures) -> Obstacles:
        """Return closures as obstacles."""
        ends = np.ascontiguousarray(closures.segments.transpose(2, 1, 0))
        return cls(ends, closures.widths, shapely.STRtree(lines_of(closures.segments)))


@dataclass(frozen=True, eq=False)
class Rays:
    """The lines of sight of P pairs, R each.

    Attributes:
        starts: [2, P, R].
        directions: from start to end, [2, P, R].
        valid: whether a ray leaves and arrives in front of the surfaces, [P, R].
    """

    starts: FloatArray
    directions: FloatArray
    valid: NDArray[np.bool_]

    @classmethod
    def between(cls, surfaces: SurfaceArrays, pairs: IntArray) -> Rays:
        """Return the rays that join 4 points of each pair's first surface to 4 of its second."""
        one, two = pairs.T
        ends, normals = surfaces.segments.transpose(2, 1, 0), surfaces.normals.T
        along = ends[:, 1] - ends[:, 0]
        points = ends[:, 0, :, None] + along[..., None] * FRACTIONS
        points = points + CLEARANCE_M * normals[..., None]
        count = len(FRACTIONS)
        starts = np.repeat(points[:, one], count, axis=2)
        directions = np.tile(points[:, two], (1, 1, count)) - starts
        leaves = _dot(directions, normals[:, one, None]) > 0
        arrives = _dot(directions, normals[:, two, None]) < 0
        return cls(starts, directions, leaves & arrives)

    def take(self, rows: IntArray) -> Rays:
        """Return the rays of some pairs."""
        return Rays(self.starts[:, rows], self.directions[:, rows], self.valid[rows])

    def blocked_by_one(self, obstacles: Obstacles, own: IntArray) -> NDArray[np.bool_]:
        """Return whether one obstacle alone crosses all rays of a pair, [P].

        Args:
            obstacles: O segments.
            own: rows of the two obstacles that do not count for a pair, [P, 2].
        """
        corners = self._corners
        # what crosses all rays crosses the line between their middles
        middles = corners.reshape(2, 2, 2, -1).mean(axis=2)
        pair, obstacle = obstacles.tree.query(
            shapely.box(*middles.min(axis=1), *middles.max(axis=1))
        )
        foreign = (obstacle != own[pair, 0]) & (obstacle != own[pair, 1])
        pair, obstacle = pair[foreign], obstacle[foreign]
        for blocks in (_separates, _crosses_outermost):
            meets = blocks(corners.take(pair, axis=2), obstacles.ends.take(obstacle, axis=2))
            pair, obstacle = pair[meets], obstacle[meets]
        blocked = np.zeros(len(self.valid), bool)
        blocked[pair] = True
        return blocked

    @cached_property
    def _corners(self) -> FloatArray:
        """Outermost starts and outermost ends of each pair's rays, [2, 4, P]."""
        ends = self.starts + self.directions
        return np.stack(
            [self.starts[..., 0], self.starts[..., -1], ends[..., 0], ends[..., -1]], axis=1
        )

    def narrowest_crossed(self, obstacles: Obstacles, own: IntArray | None = None) -> FloatArray:
        """Return the width of the narrowest obstacle that each ray crosses, infinity if none.

        Args:
            obstacles: O segments.
            own: rows of the two obstacles that a pair's rays do not count as crossing, [P, 2].

        Returns:
            Widths, [P, R].
        """
        corners = self._corners
        boxes = shapely.box(*corners.min(axis=1), *corners.max(axis=1))
        pair, obstacle = obstacles.tree.query(boxes)
        if own is not None:
            foreign = (obstacle != own[pair, 0]) & (obstacle != own[pair, 1])
            pair, obstacle = pair[foreign], obstacle[foreign]
        for may_meet in (_corners_on_both_sides, _reaches_between):
            meets = may_meet(corners.take(pair, axis=2), obstacles.ends.take(obstacle, axis=2))
            pair, obstacle = pair[meets], obstacle[meets]
        crosses = self._crossings(pair, obstacles.ends.take(obstacle, axis=2))
        hit, ray = np.nonzero(crosses)
        narrowest = np.full(self.valid.size, np.inf)
        rows = pair[hit] * self.valid.shape[1] + ray
        np.minimum.at(narrowest, rows, obstacles.widths[obstacle[hit]])
        return narrowest.reshape(self.valid.shape)

    def _crossings(self, pair: IntArray, segments: FloatArray) -> NDArray[np.bool_]:
        """Return which rays of each pair cross its segment, [P'] and [2, 2, P'] to [P', R]."""
        # A ray start + u * direction crosses the segment first + v * along where 0 <= u, v <= 1.
        direction = self.directions.take(pair, axis=1)
        first = segments[:, 0, :, None]
        along = segments[:, 1, :, None] - first
        to_first = first - self.starts.take(pair, axis=1)
        scale = _cross(direction, along)
        u, v = _cross(to_first, along), _cross(to_first, direction)
        crosses = (u * scale >= 0) & (np.abs(u) <= np.abs(scale))
        crosses &= (v * scale >= 0) & (np.abs(v) <= np.abs(scale)) & (scale != 0)
        return np.asarray(crosses)


def _separates(corners: FloatArray, segments: FloatArray) -> NDArray[np.bool_]:
    """Return whether a segment's line has all starts of rays on one side and all ends on the other.

    Arguments as of :func:`_corners_on_both_sides`.
    """
    first, second = segments[:, :1], segments[:, 1:]
    side = _cross(second - first, corners - first)
    starts, ends = side[:2], side[2:]
    one_way = (starts.min(axis=0) > 0) & (ends.max(axis=0) < 0)
    other_way = (starts.max(axis=0) < 0) & (ends.min(axis=0) > 0)
    return np.asarray(one_way | other_way)


def _crosses_outermost(corners: FloatArray, segments: FloatArray) -> NDArray[np.bool_]:
    """Return whether segments cross all four rays between outermost starts and ends.

    Said of segments that :func:`_separates`. Where such a segment's line meets a ray moves one way
    as the ray's start moves along its surface, and so for its end: no ray meets it beyond all four.
    """
    crosses = np.ones(corners.shape[2], bool)
    for start in (0, 1):
        for end in (2, 3):
            first = corners[:, start, None]
            side = _cross(corners[:, end, None] - first, segments - first)
            crosses &= side[0] * side[1] <= 0
    return crosses


def _corners_on_both_sides(corners: FloatArray, segments: FloatArray) -> NDArray[np.bool_]:
    """Return whether a segment's line has corners on both sides: only then may rays cross it.

    Args:
        corners: of the quadrilateral that holds a pair's rays, first two on the first surface,
            [2, 4, P].
        segments: first and second ends, [2, 2, P].
    """
    first, second = segments[:, :1], segments[:, 1:]
    side = _cross(second - first, corners - first)
    return np.asarray((side.max(axis=0) >= 0) & (side.min(axis=0) <= 0))


def _reaches_between(corners: FloatArray, segments: FloatArray) -> NDArray[np.bool_]:
    """Return whether segments reach between the two lines that join a pair's outer points.

    Arguments as above. Says no only if such a line has all corners on one side and the segment on
    the other.
    """
    meets = np.ones(corners.shape[2], bool)
    for one, two in ((0, 3), (1, 2)):
        first, along = corners[:, one, None], corners[:, two, None] - corners[:, one, None]
        own, other = _cross(along, corners - first), _cross(along, segments - first)
        meets &= (own.min(axis=0) < 0) | (other.max(axis=0) >= 0)
        meets &= (own.max(axis=0) > 0) | (other.min(axis=0) <= 0)
    return meets


def _cross(one: FloatArray, two: FloatArray) -> FloatArray:
    return np.asarray(one[0] * two[1] - one[1] * two[0])


def _dot(one: FloatArray, two: FloatArray) -> FloatArray:
    return np.asarray(one[0] * two[0] + one[1] * two[1])
