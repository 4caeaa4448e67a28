"""What is seen of surfaces from given positions, exact to the corner.

Around each position, the directions of all ends of surfaces bound sectors. Surfaces do not cross
within a sector, so the one that is nearest in its middle hides all others in the whole sector.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from sgraph_concepts.types import FloatArray, IntArray
from sgraph_core.geometry import cross, dot, lines_of, points_of
from sgraph_core.synth.pieces import SHORTEST_PIECE_M, Pieces

__all__ = ["seen_from"]

POSES_AT_ONCE = 32
"""Bounds the memory."""
IN_FRONT_M = 0.01
"""A surface is seen from positions at least this far in front of it."""
NARROWEST = 1e-9
"""Narrower sectors, in rad, lie between two calculations of the direction of one corner."""
TOUCH = 1e-6
"""Stretches of a piece are one when they are apart by no more than this share of its length."""
TURN = 8.0
"""More than a full turn: direction ``a`` around position ``k`` is kept as ``TURN * k + a``."""


def seen_from(poses: FloatArray, pieces: Pieces, range_m: float) -> Pieces:
    """Return the parts of pieces that are seen from any of the given positions.

    A point of a piece is seen from a position in front of it and at most ``range_m`` away when no
    other piece lies between them, whichever way that one faces.

    Args:
        poses: the positions, [K, 2].
        pieces: all pieces that may be seen or hide others.
        range_m: how far one sees.
    """
    crossings = _crossings(pieces)
    stretches = [
        _stretches(_Views.around(some, pieces, range_m), crossings[None] - some[:, None])
        for some in np.split(poses, np.arange(POSES_AT_ONCE, len(poses), POSES_AT_ONCE))
    ]
    rows, lows, highs = _united(*map(np.concatenate, zip(*stretches, strict=True)))
    start, along = pieces.segments[rows, 0], pieces.segments[rows, 1] - pieces.segments[rows, 0]
    long = (highs - lows) * np.linalg.norm(along, axis=1) > SHORTEST_PIECE_M
    ends = start[:, None] + np.stack([lows, highs], axis=1)[..., None] * along[:, None]
    return pieces.parts(rows[long], ends[long])


def _crossings(pieces: Pieces) -> FloatArray:
    """Return where pieces cross one another, [X, 2]."""
    lines = lines_of(pieces.segments)
    one, two = shapely.STRtree(lines).query(lines, predicate="crosses")
    return shapely.get_coordinates(shapely.intersection(lines[one], lines[two]))


@dataclass(frozen=True, eq=False)
class _Views:
    """V pieces as they lie around positions within range.

    Attributes:
        pose, row: from which position which piece, [V].
        facing: whether the piece faces the position, [V].
        start, along: the piece's first end, relative to the position, and its extent, [V, 2].
        low, high: the part of the piece within range, as shares of its length, [V].
    """

    pose: IntArray
    row: IntArray
    facing: NDArray[np.bool_]
    start: FloatArray
    along: FloatArray
    low: FloatArray
    high: FloatArray

    @classmethod
    def around(cls, poses: FloatArray, pieces: Pieces, range_m: float) -> _Views:
        """Return what lies around positions; what points straight at one is left out."""
        pose, row = shapely.STRtree(lines_of(pieces.segments)).query(
            points_of(poses), predicate="dwithin", distance=range_m
        )
        start = pieces.segments[row, 0] - poses[pose]
        along = pieces.segments[row, 1] - pieces.segments[row, 0]
        offset = dot(start, pieces.normals[row])
        middle = -dot(start, along) / dot(along, along)
        half = np.sqrt(np.maximum(range_m**2 - offset**2, 0) / dot(along, along))
        low, high = np.maximum(middle - half, 0), np.minimum(middle + half, 1)
        wide = np.abs(cross(start, along)) * (high - low) > NARROWEST
        return cls(*(a[wide] for a in (pose, row, offset < -IN_FRONT_M, start, along, low, high)))

    def directions(self) -> tuple[FloatArray, FloatArray]:
        """Return the directions of the right and the left end of each view, in rad, [V] each."""
        ends = [self.start + share[:, None] * self.along for share in (self.low, self.high)]
        low, high = (np.arctan2(end[:, 1], end[:, 0]) for end in ends)
        clockwise = cross(self.start, self.along) < 0
        return np.where(clockwise, high, low), np.where(clockwise, low, high)

    def crossed(self, views: IntArray, directions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return where rays meet the lines of views: how far away, and at which share of each."""
        rays = np.stack([np.cos(directions), np.sin(directions)], axis=1)
        slant = cross(rays, self.along[views])
        distances = cross(self.start, self.along)[views] / slant
        return distances, cross(self.start[views], rays) / slant


@dataclass(frozen=True, eq=False)
class _Sectors:
    """S sectors around positions, bounded by the directions of ends of views and of crossings.

    Attributes:
        rights, widths: direction of the right border and width, in rad, [S] each.
        view, sector: every view with every sector that it fills, [C] each.
    """

    rights: FloatArray
    widths: FloatArray
    view: IntArray
    sector: IntArray

    @classmethod
    def of(cls, views: _Views, crossings: FloatArray) -> _Sectors:
        """Return the sectors around K positions; crossings are relative to each, [K, X, 2]."""
        count = len(crossings)
        turns = TURN * np.arange(count)
        marks = turns[:, None] + np.arctan2(crossings[..., 1], crossings[..., 0])
        ends = np.concatenate(views.directions()) + np.tile(turns[views.pose], 2)
        borders, number = np.unique(np.append(ends, marks), return_inverse=True)
        first = np.searchsorted(borders, turns - TURN / 2)
        total = np.diff(np.append(first, len(borders)))
        pose = np.repeat(np.arange(count), total)
        left = np.roll(borders - turns[pose], -1)
        last = (first + total - 1)[total > 0]
        left[last] = (borders - turns[pose])[first[total > 0]] + 2 * np.pi

        right_end, left_end = number[: len(views.pose)], number[len(views.pose) : len(ends)]
        filled = (left_end - right_end) % total[views.pose]
        view = np.repeat(np.arange(len(filled)), filled)
        step = np.arange(len(view)) - np.repeat(np.cumsum(filled) - filled, filled)
        base = first[views.pose][view]
        sector = base + (right_end[view] - base + step) % total[views.pose][view]
        rights = borders - turns[pose]
        return cls(rights, left - rights, view, sector)


def _stretches(views: _Views, crossings: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return the stretches of pieces that are seen in single sectors.

    Args:
        views: the pieces around K positions.
        crossings: where pieces cross, relative to each position, [K, X, 2].

    Returns:
        Row of the piece and both ends as shares of its length, [T] each.
    """
    sectors = _Sectors.of(views, crossings)
    view, sector = sectors.view, sectors.sector
    middles = sectors.rights + sectors.widths / 2
    distances, _ = views.crossed(view, middles[sector])
    nearest = np.full(len(middles), np.inf)
    np.minimum.at(nearest, sector, distances)
    seen = (distances == nearest[sector]) & views.facing[view]
    seen &= sectors.widths[sector] > NARROWEST
    view, sector = view[seen], sector[seen]
    right, left = sectors.rights[sector], sectors.rights[sector] + sectors.widths[sector]
    shares = np.sort([views.crossed(view, right)[1], views.crossed(view, left)[1]], axis=0)
    low, high = np.clip(shares, views.low[view], views.high[view])
    return views.row[view], low, high


def _united(
    rows: IntArray, lows: FloatArray, highs: FloatArray
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return stretches of pieces with those that overlap or touch made one, ordered by row."""
    order = np.lexsort((lows, rows))
    rows, lows, highs = rows[order], lows[order], highs[order]
    apart = 2.0  # more than any share, so that rows stay apart on one axis
    reach = np.maximum.accumulate(apart * rows + highs)
    gap_before = (apart * rows + lows)[1:] > reach[:-1] + TOUCH
    first = np.append(True, gap_before)[: len(rows)]
    last = np.append(gap_before, True)[: len(rows)]
    return rows[first], lows[first], reach[last] - apart * rows[last]
