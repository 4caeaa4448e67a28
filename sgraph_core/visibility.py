"""Which surfaces see each other: lines of sight, and the doorways they pass.

Two surfaces of one room mostly see each other; surfaces of different rooms see each other through
doorways and through walls that the robot has not seen. Besides the share of free lines of sight,
the shares are therefore counted that stay free when the gaps between collinear surfaces are closed
(a doorway is such a gap), and when surfaces that end in the open are continued to the next one.
"""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from sgraph_concepts.types import FloatArray, IntArray, SurfaceArrays
from sgraph_core.closures import Closures, continuations, gaps
from sgraph_core.geometry import dot, lines_of, nearest
from sgraph_core.rays import Obstacles, Rays

__all__ = [
    "CLOSURE_REACH_M",
    "FARTHEST_RADIUS_M",
    "NEAREST_RADIUS_M",
    "VISIBILITIES",
    "closures_among",
    "face_each_other",
    "facing_neighbours",
    "facing_pairs",
    "visibility",
]

IN_FRONT_M = 0.05
"""How far a surface must reach in front of another to be seen from it at all."""

PAIRS_AT_ONCE = 2048

CLOSED_GAPS_M = (1.4, 3.0, 6.0)
"""Widths up to which gaps are closed: doors, wide openings, missing surfaces."""
CONTINUED_M = (1.5, 4.0, 8.0)
"""Lengths up to which surfaces that end in the open are continued."""
CLOSURE_REACH_M = max(*CLOSED_GAPS_M, *CONTINUED_M) + 0.5
"""Closures that depend on a surface have all their points this close to it."""
VISIBILITIES = (
    "visibility",
    *(f"visibility, gaps up to {width:g} m closed" for width in CLOSED_GAPS_M),
    *(f"visibility, walls continued up to {length:g} m" for length in CONTINUED_M),
)
"""What the columns of the visibility are."""

NEAREST_RADIUS_M = 12.0
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
    one, two, _, _ = facing_neighbours(surfaces, np.arange(total), count)
    keys = np.unique(np.minimum(one, two) * total + np.maximum(one, two))
    return np.stack(np.divmod(keys, total), axis=1)


def facing_neighbours(
    surfaces: SurfaceArrays, rows: IntArray, count: int
) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """Return whom some surfaces ask for: the nearest ``count`` that face them, and ties.

    Args:
        surfaces: N surfaces.
        rows: the R that ask.
        count: how many neighbours each asks for.

    Returns:
        Who asks, for whom, and their distances, [A] each; and how far each of ``rows`` had to look,
        [R]: what is farther away makes no difference to it.
    """
    lines = lines_of(surfaces.segments)
    bounds, outwards = shapely.bounds(lines), np.array([-1.0, -1.0, 1.0, 1.0])
    tree = shapely.STRtree(lines)
    waits, radius = np.zeros(len(surfaces), bool), NEAREST_RADIUS_M
    waits[rows] = True
    none = np.empty(0, np.int64)
    who, whom, apart = [none], [none], [np.empty(0)]
    looked = np.full(len(surfaces), FARTHEST_RADIUS_M)
    while waits.any():
        waiting = np.flatnonzero(waits)
        one, two = tree.query(shapely.box(*(bounds[waiting] + radius * outwards).T))
        one = waiting[one]
        once = (one < two) | ~waits[two]  # of a pair that both ask for, look at one direction only
        one, two = one[once], two[once]
        for _ in range(2):
            facing = _reaches_in_front(surfaces, one, two)
            one, two = two[facing], one[facing]
        distances = shapely.distance(lines[one], lines[two])
        mutual = waits[two]
        asking, other = np.append(one, two[mutual]), np.append(two, one[mutual])
        distances = np.append(distances, distances[mutual])
        found = np.bincount(asking[distances <= radius], minlength=len(surfaces))
        done = (found >= count) | (radius >= FARTHEST_RADIUS_M)
        answered = done[asking]
        asking, other, distances = asking[answered], other[answered], distances[answered]
        near = nearest(asking, distances, count)
        asking, other = asking[near], other[near]
        who.append(asking)
        whom.append(other)
        apart.append(distances[near])
        farthest = np.zeros(len(surfaces))
        np.maximum.at(farthest, asking, distances[near])
        enough = waits & (found >= count)
        looked[enough] = farthest[enough]
        waits &= ~done
        radius *= 2
    return np.concatenate(who), np.concatenate(whom), np.concatenate(apart), looked[rows]


def face_each_other(surfaces: SurfaceArrays, one: IntArray, two: IntArray) -> NDArray[np.bool_]:
    """Return whether each of the surfaces in these rows reaches in front of the other, [P]."""
    return _reaches_in_front(surfaces, one, two) & _reaches_in_front(surfaces, two, one)


def _reaches_in_front(surfaces: SurfaceArrays, one: IntArray, two: IntArray) -> NDArray[np.bool_]:
    offset = surfaces.segments[two] - surfaces.midpoints[one, None]
    in_front = dot(offset, surfaces.normals[one, None])
    return np.asarray(np.maximum(in_front[:, 0], in_front[:, 1]) > IN_FRONT_M)


def closures_among(
    surfaces: SurfaceArrays, rows: IntArray | None = None
) -> tuple[Closures, Closures]:
    """Return the gaps and the continuations that count as closed in some column.

    Args:
        surfaces: N surfaces.
        rows: of the surfaces whose closures are wanted; all if not given.
    """
    return (
        gaps(surfaces, max(CLOSED_GAPS_M), rows),
        continuations(surfaces, max(CONTINUED_M), rows),
    )


def visibility(
    surfaces: SurfaceArrays, pairs: IntArray, closed: tuple[Closures, Closures] | None = None
) -> FloatArray:
    """Return the share of lines of sight between the surfaces of each pair that are free.

    Each pair is joined by 4 x 4 lines of sight. One is free when it leaves and arrives in front of
    the surfaces and crosses no other surface; in the further columns, no closure either.

    Args:
        surfaces: N surfaces.
        pairs: row indices, [P, 2].
        closed: the gaps and the continuations among the surfaces, if known already.

    Returns:
        Shares from 0 to 1, [P, len(VISIBILITIES)].
    """
    walls = Obstacles.of(Closures(surfaces.segments, np.zeros(len(surfaces))))
    widths = CLOSED_GAPS_M, CONTINUED_M
    obstacles = [Obstacles.of(closures) for closures in closed or closures_among(surfaces)]
    shares = np.zeros((len(pairs), len(VISIBILITIES)))
    for start in range(0, len(pairs), PAIRS_AT_ONCE):  # bounds the memory
        some = pairs[start : start + PAIRS_AT_ONCE]
        rays = Rays.between(surfaces, some)
        # most pairs are behind one wall: it is found faster than all that their rays cross
        open_ = np.flatnonzero(rays.valid.any(axis=1) & ~rays.blocked_by_one(walls, own=some))
        rays = rays.take(open_)
        free = rays.valid & np.isinf(rays.narrowest_crossed(walls, own=some[open_]))
        seeing = np.flatnonzero(free.any(axis=1))
        rays, free, seeing = rays.take(seeing), free[seeing], open_[seeing]
        columns = [free]
        for closures, limits in zip(obstacles, widths, strict=True):
            narrowest = rays.narrowest_crossed(closures)
            columns += [free & (narrowest > limit) for limit in limits]
        shares[start + seeing] = np.stack([column.mean(axis=1) for column in columns], axis=1)
    return shares
