"""Straight pieces of outlines and the lines fitted to them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from sgraph_concepts.types import FloatArray, IntArray
from sgraph_core.geometry import Geometries, cross, dot

__all__ = ["Pieces", "chords", "directions", "straight_pieces"]

CORNER_EDGES = 2
"""This many edges of an outline next to a corner are cut by it and do not count in the fit, if
that leaves a third of the piece."""
BEVEL_CELLS = 3.0
"""Cutting rays off cuts off corners that are on a slant to the cells; this is how far."""
CORNER_SINE = np.sin(np.radians(30.0))
"""Pieces that meet at a smaller angle have no corner worth computing."""


@dataclass(frozen=True, eq=False)
class Pieces:
    """N straight lines and the moments of the points they were fitted to; those of parts add up.

    Attributes:
        ends: first and last point of each line, free space on its right, [N, 2, 2].
        weights: sum of the points' weights, [N].
        means: weighted mean of the points, [N, 2].
        scatters: weighted sum of the outer products of their deviations from the mean, [N, 2, 2].
    """

    ends: FloatArray
    weights: FloatArray
    means: FloatArray
    scatters: FloatArray


def straight_pieces(lines: list[FloatArray], tolerance: float) -> Pieces:
    """Cut outlines into straight pieces and fit a line to each by total least squares.

    Douglas-Peucker cuts; corners are where the fitted lines of neighbours intersect.

    Args:
        lines: outlines as points (column, row), [P, 2] each, no point in two of them.
        tolerance: how far a piece may stray from a straight line, in cells.
    """
    points, first, last = _cut(lines, tolerance)
    ends = np.stack([points[first], points[last]], axis=1)
    pieces = Pieces(ends, *_moments(points, first, last))
    onward = _followers(_keys(points[first]), _keys(points[last]))
    return _with_corners(pieces, onward, tolerance)


def directions(ends: FloatArray, scatters: FloatArray) -> FloatArray:
    """Return the total least-squares lines' unit directions, from first to last end, [N, 2]."""
    double = np.arctan2(2 * scatters[:, 0, 1], scatters[:, 0, 0] - scatters[:, 1, 1])
    along = np.stack([np.cos(double / 2), np.sin(double / 2)], axis=1)
    forward = dot(along, ends[:, 1] - ends[:, 0]) >= 0
    return np.where(forward[:, None], along, -along)


def chords(lines: list[FloatArray], tolerance: float) -> FloatArray:
    """Return outlines straightened within a tolerance (Douglas-Peucker), [N, 2, 2].

    Args:
        lines: as for :func:`straight_pieces`.
        tolerance: in cells.
    """
    points, first, last = _cut(lines, tolerance)
    return np.stack([points[first], points[last]], axis=1)


def _cut(lines: list[FloatArray], tolerance: float) -> tuple[FloatArray, IntArray, IntArray]:
    """Return the points of all outlines, [P, 2], and the first and last one of each piece, [N]."""
    lines = [_begun_at_corner(line) for line in lines]
    points = np.concatenate(lines)
    simple = shapely.simplify(_geometries(lines), tolerance, preserve_topology=False)
    corners = np.flatnonzero(np.isin(_keys(points), _keys(shapely.get_coordinates(simple))))
    outline = np.repeat(np.arange(len(lines)), [len(line) for line in lines])[corners]
    same = outline[:-1] == outline[1:]
    first, last = corners[:-1][same], corners[1:][same]
    return points, first, last


def _begun_at_corner(line: FloatArray) -> FloatArray:
    """Return a closed outline begun at its point farthest from the centre: a corner, if any."""
    if (line[0] != line[-1]).any():
        return line
    open_ = line[:-1]
    start = int(np.argmax(((open_ - open_.mean(axis=0)) ** 2).sum(axis=1)))
    return np.concatenate([open_[start:], open_[: start + 1]])


def _geometries(lines: list[FloatArray]) -> Geometries:
    owner = np.repeat(np.arange(len(lines)), [len(line) for line in lines])
    return np.asarray(shapely.linestrings(np.concatenate(lines), indices=owner))


def _keys(points: FloatArray) -> IntArray:
    """Return what tells points of outlines apart: they lie on halves of cells, [N]."""
    doubled = np.rint(2 * points).astype(np.int64)
    return np.asarray(doubled[:, 0] << 32 | doubled[:, 1])


def _moments(
    points: FloatArray, first: IntArray, last: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    counts = last - first
    piece = np.repeat(np.arange(len(first)), counts)
    place = np.arange(len(piece)) - np.repeat(np.cumsum(counts) - counts, counts)
    edge = first[piece] + place
    steps = points[edge + 1] - points[edge]
    middles = (points[edge + 1] + points[edge]) / 2
    weights = np.hypot(steps[:, 0], steps[:, 1])
    from_end = np.minimum(place, counts[piece] - 1 - place)
    margin = np.minimum(CORNER_EDGES, (counts - 1) // 3)
    weights[from_end < margin[piece]] = 0

    def total(values: FloatArray) -> FloatArray:
        return np.stack(
            [np.bincount(piece, column, len(first)) for column in values.reshape(len(piece), -1).T],
            axis=1,
        )

    sums = total(weights[:, None])[:, 0]
    means = total(weights[:, None] * middles) / sums[:, None]
    apart = middles - means[piece]
    # an edge is a line, not a point: it has a scatter of its own
    outer = apart[:, :, None] * apart[:, None, :] + steps[:, :, None] * steps[:, None, :] / 12
    return sums, means, total(weights[:, None, None] * outer).reshape(-1, 2, 2)


def _followers(begins: IntArray, ends: IntArray) -> IntArray:
    """Return which piece begins where each one ends, -1 where none does, [N]."""
    order = np.argsort(begins)
    place = np.minimum(np.searchsorted(begins, ends, sorter=order), len(begins) - 1)
    onward = order[place]
    return np.where(begins[onward] == ends, onward, -1)


def _with_corners(pieces: Pieces, onward: IntArray, tolerance: float) -> Pieces:
    """Move the ends onto the fitted lines: to corners, else to the foot of the outline's point.

    Two pieces with nothing but a bevel between them meet at a corner too; bevels are left out.
    """
    along = directions(pieces.ends, pieces.scatters)
    from_mean = pieces.ends - pieces.means[:, None]
    ends = pieces.means[:, None] + dot(from_mean, along[:, None])[..., None] * along[:, None]
    reach = max(2 * tolerance, BEVEL_CELLS)
    beyond, bevelled = _beyond_bevels(pieces, onward, reach)
    goes_on = np.flatnonzero(onward >= 0)
    one = np.concatenate([goes_on, bevelled])
    two = np.concatenate([onward[goes_on], beyond[bevelled]])
    over_bevel = np.arange(len(one)) >= len(goes_on)

    sine = cross(along[one], along[two])
    sharp = np.abs(sine) > CORNER_SINE
    one, two, sine, over_bevel = one[sharp], two[sharp], sine[sharp], over_bevel[sharp]
    distance = cross(pieces.means[two] - pieces.means[one], along[two]) / sine
    corner = pieces.means[one] + distance[:, None] * along[one]
    astray = corner[:, None] - np.stack([pieces.ends[one, 1], pieces.ends[two, 0]], axis=1)
    near = (np.linalg.norm(astray, axis=2) <= reach).all(axis=1)
    ends[one[near], 1] = corner[near]
    ends[two[near], 0] = corner[near]
    kept = np.isin(np.arange(len(ends)), onward[one[near & over_bevel]], invert=True)
    return Pieces(ends[kept], pieces.weights[kept], pieces.means[kept], pieces.scatters[kept])


def _beyond_bevels(pieces: Pieces, onward: IntArray, longest: float) -> tuple[IntArray, IntArray]:
    """Return the piece after the next one, -1 for none, [N], and where the next may be a bevel."""
    steps = pieces.ends[:, 1] - pieces.ends[:, 0]
    short = np.hypot(steps[:, 0], steps[:, 1]) <= longest
    beyond = np.where(onward >= 0, onward[onward], -1)
    bevelled = (beyond >= 0) & short[onward] & ~short & ~short[beyond]
    return beyond, np.flatnonzero(bevelled)
