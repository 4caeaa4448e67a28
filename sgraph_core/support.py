"""What a building has in common with a surface: others in line with it, and its directions.

Walls tend to stand in line with other walls and along a building's directions; furniture, door
leaves and what else stands about does so by chance. Everything here changes smoothly with the
surfaces, so noise and rounding do not let it jump.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from sgraph_concepts.types import FloatArray, IntArray, SurfaceArrays
from sgraph_core.geometry import dot, in_frames, points_of, unique_pairs

__all__ = [
    "FARTHEST_M",
    "SUPPORT",
    "alignment",
    "collinear",
    "collinear_lengths",
    "lines_near",
    "support",
    "turns",
]

SUPPORT = (
    "log 1 + collinear length that faces the same way",
    "log 1 + collinear length that faces the other way",
    "alignment with the building",
)
"""What is said of a surface."""

REACH_M = 20.0
"""Surfaces farther along the line do not count; nearer ones count the more the nearer they are."""
OFFSET_M = 0.1
"""A surface so far beside the line does not count..."""
OFFSET_GROWTH = 0.01
"""...and so much farther per metre along the line: the direction of the line is uncertain."""
ASIDE_M = OFFSET_M + OFFSET_GROWTH * REACH_M
"""None counts that is so far beside the line, wherever along it."""
FARTHEST_M = REACH_M + ASIDE_M
"""Surfaces whose boxes are farther apart, along an axis, are not in line."""
BOXES = 16
"""In how many boxes along its line a surface looks for others."""
BOXES_AT_ONCE = 65536


def support(surfaces: SurfaceArrays) -> FloatArray:
    """Return what the N surfaces of a map have in common with it, [N, 3], as SUPPORT names it."""
    return np.column_stack([np.log1p(collinear_lengths(surfaces)), alignment(surfaces)])


def collinear_lengths(surfaces: SurfaceArrays) -> FloatArray:
    """Return the length of surfaces in line with each, in metres: facing its way and opposite.

    Of two surfaces, one whose ends lie at most y beside the line of the other, and whose middle x
    along it from the nearer end, is in line with it by (1 - x / 20 m) (1 - y / (10 cm + x / 100)).
    The larger of the two values holds for both, and each counts the other's length that much.

    Args:
        surfaces: N surfaces.

    Returns:
        [N, 2].
    """
    one, two = _near_lines(surfaces)
    lengths = np.zeros((len(surfaces), 2))
    for column, share in enumerate(collinear(surfaces, one, two).T):
        np.add.at(lengths[:, column], one, share * surfaces.lengths[two])
        np.add.at(lengths[:, column], two, share * surfaces.lengths[one])
    return lengths


def collinear(surfaces: SurfaceArrays, one: IntArray, two: IntArray) -> FloatArray:
    """Return how much of each other's length two surfaces count, 0 to 1, [P, 2].

    Args:
        surfaces: N surfaces.
        one: rows of the first surface of each pair, [P].
        two: of the second, [P].

    Returns:
        A column for surfaces that face the same way, and one for such that do not.
    """
    weight = np.maximum(_in_line(surfaces, one, two), _in_line(surfaces, two, one))
    same_way = dot(surfaces.normals[one], surfaces.normals[two]) > 0
    return np.stack([weight * same_way, weight * ~same_way], axis=1)


def alignment(surfaces: SurfaceArrays) -> FloatArray:
    """Return how well each surface runs along or across the others, from -1 to 1, [N].

    It is the mean of cos(4 (a - b)) over the directions b of all surfaces, weighted by their
    lengths, where a is the surface's own direction.
    """
    own = turns(surfaces)
    return np.asarray(own @ (surfaces.lengths @ own) / surfaces.lengths.sum())


def turns(surfaces: SurfaceArrays) -> FloatArray:
    """Return four times the surfaces' directions as unit vectors, [N, 2]: right angles are none."""
    tangents = surfaces.tangents
    fourfold = 4 * np.arctan2(tangents[:, 1], tangents[:, 0])
    return np.stack([np.cos(fourfold), np.sin(fourfold)], axis=1)


def lines_near(surfaces: SurfaceArrays, rows: IntArray) -> tuple[IntArray, IntArray]:
    """Return some surfaces and others near their lines, or near whose lines they are, [P] each.

    Args:
        surfaces: N surfaces.
        rows: R of them; R x N numbers are computed.
    """
    middles = surfaces.midpoints
    from_mine = middles - middles[rows, None]
    near = _beside(from_mine, surfaces.take(rows), np.s_[:, None])
    near |= _beside(-from_mine, surfaces, np.s_[None])
    near[np.arange(len(rows)), rows] = False
    one, two = np.nonzero(near)
    return rows[one], two


def _beside(offsets: FloatArray, of: SurfaceArrays, axis: Any) -> NDArray[np.bool_]:
    """Return which offsets from surfaces' middles, [R, N, 2], are near these surfaces' lines."""
    reach = (of.lengths / 2 + REACH_M)[axis]
    beside = np.abs(dot(offsets, of.normals[axis])) <= ASIDE_M
    return np.asarray(beside & (np.abs(dot(offsets, of.tangents[axis])) <= reach))


def _in_line(surfaces: SurfaceArrays, one: IntArray, two: IntArray) -> FloatArray:
    """Return how much the second surface of each pair is in line with the first, 0 to 1, [P]."""
    x, y = in_frames(surfaces, one, surfaces.segments[two])
    gap = np.maximum(np.abs(x.mean(axis=1)) - surfaces.lengths[one] / 2, 0)
    beside = np.abs(y).max(axis=1) / (OFFSET_M + OFFSET_GROWTH * gap)
    return np.asarray(np.clip(1 - gap / REACH_M, 0, 1) * np.clip(1 - beside, 0, 1))


def _near_lines(surfaces: SurfaceArrays) -> tuple[IntArray, IntArray]:
    """Return pairs of surfaces, each once, the middle of one near the line of the other."""
    half = (surfaces.lengths / 2 + REACH_M)[:, None] * surfaces.tangents
    borders = np.linspace(-1, 1, BOXES + 1)[:, None]
    points = surfaces.midpoints[:, None] + borders * half[:, None]
    low = np.minimum(points[:, :-1], points[:, 1:]).reshape(-1, 2) - ASIDE_M
    high = np.maximum(points[:, :-1], points[:, 1:]).reshape(-1, 2) + ASIDE_M
    tree = shapely.STRtree(points_of(surfaces.midpoints))
    found = []
    for first in range(0, len(low), BOXES_AT_ONCE):  # bounds the memory
        some = slice(first, first + BOXES_AT_ONCE)
        box, near = tree.query(shapely.box(*low[some].T, *high[some].T))
        found.append(np.stack([(first + box) // BOXES, near]))
    asking, near = np.concatenate([np.empty((2, 0), np.int64), *found], axis=1)
    one, two = unique_pairs(asking, near).T
    return one[one != two], two[one != two]
