"""Double walls: two leaves with a cavity between them, as at party walls and shafts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.random import Generator
from shapely import Polygon

from sgraph_core.synth.config import PlanConfig
from sgraph_core.synth.polygons import all_edges, clean
from sgraph_core.synth.walls import wall_gaps

__all__ = ["DoubleWall", "draw_double_walls"]

SHORTEST_M = 1.0
"""Cavities are at least this long; a leaf closes them at either end."""
AISLE_M = 0.7
"""A wall is made thicker only where both rooms stay this wide along all of it."""
FREE = 0.98
"""Share of an aisle that must be free: the corners of a room need not be exactly square."""


@dataclass(frozen=True, eq=False)
class DoubleWall:
    """A wall of two leaves between two rooms.

    Attributes:
        body: leaves and cavity.
        cavity: the closed space between the leaves.
    """

    body: Polygon
    cavity: Polygon


def draw_double_walls(
    rooms: list[Polygon], rng: Generator, config: PlanConfig
) -> tuple[list[Polygon], list[DoubleWall]]:
    """Make some walls between two rooms double, which takes what they need from both rooms alike.

    Returns:
        The rooms, and the walls.
    """
    share = rng.choice(config.double_wall_share)
    leaf, cavity = rng.uniform(*config.leaf_m), rng.uniform(*config.cavity_m)
    rooms, walls = list(rooms), []
    segments, normals, owners = all_edges(rooms)
    gaps = wall_gaps(segments, normals)
    possible = (owners[gaps.one] != owners[gaps.two]) & (gaps.lengths >= SHORTEST_M + 2 * leaf)
    for gap in np.flatnonzero(possible & (rng.random(len(gaps)) < share)).tolist():
        middle = gaps.thicknesses[gap] / 2
        half = max(middle, leaf + cavity / 2)
        whole = gaps.stretch(gap, 1.0, 0.0)
        inner = gaps.stretch(gap, 1 - 2 * leaf / gaps.lengths[gap], 0.5)
        body = gaps.body(gap, whole, middle - half, middle + half)
        aisles = [
            gaps.body(gap, whole, middle - half - AISLE_M, middle - half),
            gaps.body(gap, whole, middle + half, middle + half + AISLE_M),
        ]
        pair = [int(owners[gaps.one[gap]]), int(owners[gaps.two[gap]])]
        free = shapely.area(shapely.intersection([rooms[k] for k in pair], aisles))
        less = shapely.difference([rooms[k] for k in pair], body)
        if (free < FREE * shapely.area(aisles)).any() or not shapely.is_valid(less).all():
            continue
        left = [clean(room) for room in less]
        if left[0] is None or left[1] is None:
            continue
        rooms[pair[0]], rooms[pair[1]] = left[0], left[1]
        hollow = gaps.body(gap, inner, middle - cavity / 2, middle + cavity / 2)
        walls.append(DoubleWall(body, hollow))
    return rooms, walls
