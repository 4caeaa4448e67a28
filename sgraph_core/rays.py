"""Lines of sight between pairs of surfaces, and what they cross.

Arrays hold the coordinates first and the pairs last, [2, ..., P]: numpy is fast along the last axis
when it is long. Rows are gathered by ``take``, several times as fast as ``array[..., rows]``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from sgraph_concepts.types import FloatArray, IntArray, SurfaceArrays
from sgraph_core.closures import Closures
from sgraph_core.geometry import boxes_of, lines_of

__all__ = ["Obstacles", "Rays", "blocked_by_one"]

FRACTIONS = np.array([0.11, 0.37, 0.64, 0.89])
"""Where lines of sight start and end along a surface. Uneven, so that in a regular building they
do not all pass exactly through the ends of walls."""
OUTERMOST = [0, -1]
CLEARANCE_M = 0.03
"""Lines of sight start this far in front of a surface, clear of what lies flat against it."""


@dataclass(frozen=True, eq=False)
class Obstacles:
    """O segments, each of one of K kinds.

    Attributes:
        ends: first and second ends, [2, 2, O].
        widths: [O].
        kinds: which kind each is of, [O].
        count: K.
        tree: spatial index.
    """

    ends: FloatArray
    widths: FloatArray
    kinds: IntArray
    count: int
    tree: shapely.STRtree

    @classmethod
    def of(cls, *kinds: Closures) -> Obstacles:
        """Return closures of one or several kinds as obstacles."""
        segments = np.concatenate([closures.segments for closures in kinds])
        sizes = [len(closures.widths) for closures in kinds]
        return cls(
            np.ascontiguousarray(segments.transpose(2, 1, 0)),
            np.concatenate([closures.widths for closures in kinds]),
            np.repeat(np.arange(len(kinds)), sizes),
            len(kinds),
            shapely.STRtree(lines_of(segments)),
        )


@dataclass(frozen=True, eq=False)
class Rays:
    """The lines of sight of P pairs: from each of 4 starts to each of 4 ends.

    Attributes:
        starts: in front of each pair's first surface, [2, 4, P].
        ends: in front of its second surface, [2, 4, P].
        valid: whether a ray leaves and arrives in front of the surfaces, [4 * 4, P].
    """

    starts: FloatArray
    ends: FloatArray
    valid: NDArray[np.bool_]

    @classmethod
    def between(cls, surfaces: SurfaceArrays, pairs: IntArray) -> Rays:
        """Return the rays that join 4 points of each pair's first surface to 4 of its second."""
        one, two = pairs.T
        points, normals = _points(surfaces), surfaces.normals.T
        starts, ends = points.take(one, axis=2), points.take(two, axis=2)
        directions = ends[:, None] - starts[:, :, None]  # [2, 4, 4, P]
        leaves = _dot(directions, normals.take(one, axis=1)[:, None, None]) > 0
        arrives = _dot(directions, normals.take(two, axis=1)[:, None, None]) < 0
        return cls(starts, ends, (leaves & arrives).reshape(len(FRACTIONS) ** 2, -1))

    @property
    def lines(self) -> FloatArray:
        """First and second ends of the rays, in the order of ``valid``, [16, P, 2, 2]."""
        count = self.starts.shape[1]
        starts, ends = np.repeat(self.starts, count, axis=1), np.tile(self.ends, (1, count, 1))
        return np.stack([starts, ends]).transpose(2, 3, 0, 1)

    def take(self, rows: IntArray) -> Rays:
        """Return the rays of some pairs."""
        return Rays(
            self.starts.take(rows, axis=2),
            self.ends.take(rows, axis=2),
            self.valid.take(rows, axis=1),
        )

    def narrowest_crossed(self, obstacles: Obstacles, own: IntArray | None = None) -> FloatArray:
        """Return the width of the narrowest obstacle that each ray crosses, infinity if none.

        Args:
            obstacles: O segments of K kinds.
            own: rows of the two obstacles that a pair's rays do not count as crossing, [P, 2].

        Returns:
            Widths, by kind of obstacle, [K, 16, P].
        """
        corners = np.concatenate([self.starts[:, OUTERMOST], self.ends[:, OUTERMOST]], axis=1)
        pair, obstacle = obstacles.tree.query(boxes_of(corners.transpose(2, 1, 0)))
        if own is not None:
            pair, obstacle = _foreign(pair, obstacle, own)
        for may_meet in (_corners_on_both_sides, _reaches_between):
            meets = may_meet(corners, obstacles.ends, pair, obstacle)
            pair, obstacle = _those(meets, pair, obstacle)
        crosses = self._crossings(pair, obstacles.ends.take(obstacle, axis=2))
        # with flat indices both np.nonzero and np.minimum.at are several times as fast
        ray, hit = np.divmod(np.flatnonzero(crosses), max(len(pair), 1))
        pair, obstacle = pair.take(hit), obstacle.take(hit)
        shape = obstacles.count, *self.valid.shape
        place = (obstacles.kinds.take(obstacle) * shape[1] + ray) * shape[2] + pair
        narrowest = np.full(np.prod(shape), np.inf)
        np.minimum.at(narrowest, place, obstacles.widths.take(obstacle))
        return narrowest.reshape(shape)

    def _crossings(self, pair: IntArray, segments: FloatArray) -> NDArray[np.bool_]:
        """Return which rays of each pair cross its segment, [C] and [2, 2, C] to [16, C]."""
        first, second = segments[:, :1], segments[:, 1:]
        along, ends = second - first, self.ends.take(pair, axis=2)
        end_side = _cross(along, ends - first)
        crosses = np.empty((len(FRACTIONS), len(FRACTIONS), len(pair)), bool)
        for number in range(len(FRACTIONS)):  # one start at a time, as below
            start = self.starts[:, number].take(pair, axis=1)[:, None]
            side, directions = _cross(along, start - first), ends - start
            # start and end are on two sides of the segment's line, or one of them, not both, is on
            parts = ((side >= 0) & (end_side <= 0)) ^ ((side <= 0) & (end_side >= 0))
            sides = _cross(directions, first - start)
            sides *= _cross(directions, second - start)
            np.logical_and(parts, sides <= 0, out=crosses[number])
        return crosses.reshape(len(FRACTIONS) ** 2, -1)


def blocked_by_one(surfaces: SurfaceArrays, pairs: IntArray, walls: Obstacles) -> NDArray[np.bool_]:
    """Return whether one surface alone crosses all rays between the two of a pair, [P].

    Args:
        surfaces: N surfaces.
        pairs: row indices, [P, 2].
        walls: the same surfaces.
    """
    one, two = pairs.T
    points = _points(surfaces)[:, OUTERMOST]
    corners = np.concatenate([points.take(one, axis=2), points.take(two, axis=2)], axis=1)
    # what crosses all rays crosses the line between their middles: the test that costs least
    middles = corners.reshape(2, 2, 2, -1).mean(axis=2)
    pair, wall = walls.tree.query(lines_of(middles.transpose(2, 1, 0)))
    meets = _on_both_sides(middles, walls.ends, pair, wall)
    pair, wall = _foreign(*_those(meets, pair, wall), pairs)
    for blocks in (_separates, _crosses_outermost):
        meets = blocks(corners, walls.ends, pair, wall)
        pair, wall = _those(meets, pair, wall)
    blocked = np.zeros(len(pairs), bool)
    blocked[pair] = True
    return blocked


def _points(surfaces: SurfaceArrays) -> FloatArray:
    """Return the points in front of each surface where lines of sight start and end, [2, 4, N]."""
    ends, normals = surfaces.segments.transpose(2, 1, 0), surfaces.normals.T
    along = ends[:, 1:] - ends[:, :1]
    return np.asarray(ends[:, :1] + along * FRACTIONS[:, None] + CLEARANCE_M * normals[:, None])


def _foreign(pair: IntArray, obstacle: IntArray, own: IntArray) -> tuple[IntArray, IntArray]:
    """Return those pairs and obstacles of which the obstacle is none of the pair's own two."""
    foreign = (obstacle != own[:, 0].take(pair)) & (obstacle != own[:, 1].take(pair))
    return _those(foreign, pair, obstacle)


def _those(are: NDArray[np.bool_], pair: IntArray, obstacle: IntArray) -> tuple[IntArray, IntArray]:
    rows = np.flatnonzero(are)  # taking rows twice is faster than a mask
    return pair.take(rows), obstacle.take(rows)


def _on_both_sides(
    lines: FloatArray, segments: FloatArray, line: IntArray, segment: IntArray
) -> NDArray[np.bool_]:
    """Return whether segments have ends on both sides of lines.

    Args:
        lines: two points on each, [2, 2, L].
        segments: first and second ends, [2, 2, S].
        line: rows of the lines that are compared, [C].
        segment: and of the segments, [C].
    """
    first, second = lines[:, 0], lines[:, 1]
    # a point is on the line where x * its x + y * its y + offset = 0
    x, y, offset = first[1] - second[1], second[0] - first[0], _cross(first, second)
    x, y, offset = x.take(line), y.take(line), offset.take(line)
    sides = []
    for end_x, end_y in segments.swapaxes(0, 1):
        side = x * end_x.take(segment)
        side += y * end_y.take(segment)
        side += offset
        sides.append(side)
    return np.asarray(sides[0] * sides[1] <= 0)


def _separates(
    corners: FloatArray, segments: FloatArray, pair: IntArray, segment: IntArray
) -> NDArray[np.bool_]:
    """Return whether a segment's line has all starts of rays on one side and all ends on the other.

    Arguments as of :func:`_corners_on_both_sides`.
    """
    first = segments[:, 0].take(segment, axis=1)
    along = segments[:, 1].take(segment, axis=1) - first
    one_way, other_way = np.ones((2, len(pair)), bool)
    for corner in range(4):
        side = _cross(along, corners[:, corner].take(pair, axis=1) - first)
        one_way &= side > 0 if corner < 2 else side < 0
        other_way &= side < 0 if corner < 2 else side > 0
    return np.asarray(one_way | other_way)


def _crosses_outermost(
    corners: FloatArray, segments: FloatArray, pair: IntArray, segment: IntArray
) -> NDArray[np.bool_]:
    """Return whether segments cross all four rays between outermost starts and ends.

    Said of segments that :func:`_separates`. Where such a segment's line meets a ray moves one way
    as the ray's start moves along its surface, and so for its end: no ray meets it beyond all four.
    Arguments as of :func:`_corners_on_both_sides`.
    """
    corners, segments = corners.take(pair, axis=2), segments.take(segment, axis=2)
    crosses = np.ones(len(pair), bool)
    for start in (0, 1):
        for end in (2, 3):
            first = corners[:, start, None]
            side = _cross(corners[:, end, None] - first, segments - first)
            crosses &= side[0] * side[1] <= 0
    return crosses


def _corners_on_both_sides(
    corners: FloatArray, segments: FloatArray, pair: IntArray, segment: IntArray
) -> NDArray[np.bool_]:
    """Return whether a segment's line has corners on both sides: only then may rays cross it.

    Args:
        corners: of the quadrilaterals that hold the pairs' rays, outermost starts and outermost
            ends, [2, 4, P].
        segments: first and second ends, [2, 2, S].
        pair: rows of the pairs that are compared, [C].
        segment: and of the segments, [C].
    """
    first = segments[:, 0].take(segment, axis=1)
    along = segments[:, 1].take(segment, axis=1) - first
    left, right = np.zeros((2, len(pair)), bool)
    for corner in range(4):  # one at a time: fresh memory for all four costs more than the work
        side = _cross(along, corners[:, corner].take(pair, axis=1) - first)
        left |= side >= 0
        right |= side <= 0
    return np.asarray(left & right)


def _reaches_between(
    corners: FloatArray, segments: FloatArray, pair: IntArray, segment: IntArray
) -> NDArray[np.bool_]:
    """Return whether segments reach between the two lines that join a pair's outer points.

    Arguments as above. Says no only if such a line has all corners on one side and the segment on
    the other.
    """
    reaches = np.ones(len(pair), bool)
    for one, two, *others in ((0, 3, 1, 2), (1, 2, 0, 3)):
        first = corners[:, one].take(pair, axis=1)
        along = corners[:, two].take(pair, axis=1) - first
        left, right = np.zeros((2, len(pair)), bool)
        for other in others:
            side = _cross(along, corners[:, other].take(pair, axis=1) - first)
            left |= side > 0
            right |= side < 0
        for end in range(2):
            side = _cross(along, segments[:, end].take(segment, axis=1) - first)
            left |= side <= 0
            right |= side >= 0
        reaches &= left & right
    return reaches


def _cross(one: FloatArray, two: FloatArray) -> FloatArray:
    product = np.asarray(one[0] * two[1])
    product -= one[1] * two[0]  # in place: fresh memory costs as much as the arithmetic
    return product


def _dot(one: FloatArray, two: FloatArray) -> FloatArray:
    return np.asarray(one[0] * two[0] + one[1] * two[1])
