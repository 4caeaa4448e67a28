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
from sgraph_core.geometry import boxes_of, lines_of, nearest, unique_pairs
from sgraph_core.rays import Obstacles, Rays, blocked_by_one

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

PAIRS_AT_ONCE = 4096

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
    one, two, _, _ = facing_neighbours(surfaces, np.arange(len(surfaces)), count)
    return unique_pairs(one, two)


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
    tree = shapely.STRtree(lines)
    waits, radius = np.zeros(len(surfaces), bool), NEAREST_RADIUS_M
    waits[rows] = True
    none = np.empty(0, np.int64)
    who, whom, apart = [none], [none], [np.empty(0)]
    looked = np.full(len(surfaces), FARTHEST_RADIUS_M)
    while waits.any():
        waiting = np.flatnonzero(waits)
        one, two = tree.query(boxes_of(surfaces.segments[waiting], radius))
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
    # coordinates first, as in rays
    ends = surfaces.segments.transpose(2, 1, 0).take(two, axis=2)
    x, y = ends - surfaces.midpoints.T.take(one, axis=1)[:, None]
    normal_x, normal_y = surfaces.normals.T.take(one, axis=1)
    in_front = x * normal_x + y * normal_y
    return np.asarray(in_front.max(axis=0) > IN_FRONT_M)


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
    closures = Obstacles.of(*(closed or closures_among(surfaces)))
    shares = np.zeros((len(pairs), len(VISIBILITIES)))
    for start in range(0, len(pairs), PAIRS_AT_ONCE):  # bounds the memory
        some = pairs[start : start + PAIRS_AT_ONCE]
        # most pairs are behind one wall: it is found faster than all that their rays cross
        open_ = np.flatnonzero(~blocked_by_one(surfaces, some, walls))
        rays = Rays.between(surfaces, some[open_])
        facing = rays.valid.any(axis=0)
        rays, open_ = rays.take(np.flatnonzero(facing)), open_[facing]
        (narrowest,) = rays.narrowest_crossed(walls, own=some[open_])
        free = rays.valid & np.isinf(narrowest)
        seeing = np.flatnonzero(free.any(axis=0))
        rays, free = rays.take(seeing), free.take(seeing, axis=1)
        columns = [free]
        for narrowest, limits in zip(
            rays.narrowest_crossed(closures), (CLOSED_GAPS_M, CONTINUED_M), strict=True
        ):
            columns += [free & (narrowest > limit) for limit in limits]
        shares[start + open_[seeing]] = np.stack(
            [column.mean(axis=0) for column in columns], axis=1
        )
    return shares
