"""Open-plan areas: neighbouring rooms whose common wall is missing in part or whole."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.random import Generator
from shapely import Polygon

from sgraph_concepts.types import FloatArray, IntArray
from sgraph_core.synth.config import PlanConfig
from sgraph_core.synth.polygons import all_edges
from sgraph_core.synth.walls import INTO_ROOM_M, WallGaps, wall_gaps

__all__ = ["open_neighbours"]

SHORTEST_WALL_M = 2.0
"""Shorter walls are not left out: the rooms would be joined by no more than a door."""
STRAIGHT_M = 1e-3
"""Corners that stand out less are no corners."""


def open_neighbours(
    rooms: list[Polygon], rng: Generator, config: PlanConfig
) -> tuple[list[Polygon], FloatArray]:
    """Leave out walls between some neighbours, which stay rooms of their own.

    Each of the two rooms gets half of the space that the wall would take.

    Returns:
        The rooms, and the borders at which two of them meet without a wall, [B, 2, 2].
    """
    share = rng.choice(config.open_plan_share)
    rooms, borders = list(rooms), []
    segments, normals, owners = all_edges(rooms)
    gaps = wall_gaps(segments, normals)
    for gap in _longest_common_walls(gaps, owners):
        if rng.random() >= share:
            continue
        part = 1.0 if rng.random() < config.whole_wall_share else rng.uniform(*config.open_part)
        stretch, middle = gaps.stretch(gap, part, rng.random()), gaps.thicknesses[gap] / 2
        halves = [
            gaps.body(gap, stretch, -INTO_ROOM_M, middle),
            gaps.body(gap, stretch, middle, 2 * middle + INTO_ROOM_M),
        ]
        pair = [int(owners[gaps.one[gap]]), int(owners[gaps.two[gap]])]
        one, two = shapely.simplify(shapely.union([rooms[k] for k in pair], halves), STRAIGHT_M)
        if not one.touches(two) or _meets_others(rooms, pair, halves):
            continue
        if isinstance(one, Polygon) and isinstance(two, Polygon):
            rooms[pair[0]], rooms[pair[1]] = one, two
            borders.append(stretch + middle * gaps.inwards[gap])
    return rooms, np.array(borders).reshape(-1, 2, 2)


def _longest_common_walls(gaps: WallGaps, owners: IntArray) -> list[int]:
    """Return for each two neighbours their longest common wall, if it is long enough."""
    pairs = np.sort(owners[np.stack([gaps.one, gaps.two], axis=1)], axis=1)
    long = np.flatnonzero((pairs[:, 0] != pairs[:, 1]) & (gaps.lengths >= SHORTEST_WALL_M))
    ascending = long[np.argsort(gaps.lengths[long], kind="stable")]
    longest = {tuple(pairs[gap].tolist()): int(gap) for gap in ascending}
    return list(longest.values())


def _meets_others(rooms: list[Polygon], pair: list[int], halves: list[Polygon]) -> bool:
    met = np.flatnonzero(shapely.intersects(shapely.union_all(halves), rooms))
    return not set(met.tolist()) <= set(pair)
