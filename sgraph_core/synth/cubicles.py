"""Cubicles: rows of cells between partitions in large rooms, each open towards an aisle."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.random import Generator
from shapely import Polygon

from sgraph_concepts.types import FloatArray
from sgraph_core.geometry import turn_left
from sgraph_core.synth.config import PlanConfig
from sgraph_core.synth.polygons import clean, extent, grow, polygons_in

__all__ = ["Cubicles", "stand_cubicles"]

LARGE_ROOM_M2 = 40.0
FEWEST = 4
LEAST_LEFT = 0.2
"""Share of a room that its cubicles leave."""
CELLS_IN_ROW = (3, 9)
"""After so many cells of a row, from the first to below the second, an aisle runs across."""
TOUCH_M = 1e-6

Cubicles = dict[int, int]
"""For each room that is a cubicle, the room that it stands in."""


def stand_cubicles(
    rooms: list[Polygon], rng: Generator, config: PlanConfig
) -> tuple[list[Polygon], Cubicles]:
    """Stand rows of cubicles into some large rooms, clear of the walls or along them.

    Returns:
        The rooms, those with cubicles less what these and their partitions take, then the
        cubicles; and which these are.
    """
    share = rng.choice(config.cubicle_share)
    hosts, cubicles, inside = list(rooms), list[Polygon](), Cubicles()
    for number, room in enumerate(rooms):
        if room.area < LARGE_ROOM_M2 or rng.random() >= share:
            continue
        thickness = rng.uniform(*config.cubicle_partition_m)
        cells = _cells(room, thickness, rng, config)
        left = clean(room.difference(shapely.union_all([grow(c, thickness) for c in cells])))
        if len(cells) >= FEWEST and left is not None and left.area > LEAST_LEFT * room.area:
            hosts[number] = left
            inside |= {len(rooms) + len(cubicles) + k: number for k in range(len(cells))}
            cubicles += cells
    return hosts + cubicles, inside


def _cells(room: Polygon, thickness: float, rng: Generator, config: PlanConfig) -> list[Polygon]:
    """Return cells that lie side by side along a room, one or two rows between two aisles."""
    width, depth = rng.uniform(*config.cubicle_m, size=2) + thickness
    aisle, rows = rng.uniform(*config.aisle_m), int(rng.integers(1, 3))
    along_walls = rng.random() < 0.5
    free = grow(room, -thickness if along_walls else -aisle - thickness)
    if free.is_empty:
        return []
    axis = extent(room)[2]
    frame = np.stack([axis, turn_left(axis)])
    corners = shapely.get_coordinates(free) @ frame.T
    (left, bottom), (right, top) = corners.min(axis=0), corners.max(axis=0)
    if along_walls:  # along two of them: one row, and an aisle at the opposite walls
        bottom -= (rows - 1) * depth
        right, top = right - aisle, top - aisle
    cells = [
        Polygon(shapely.get_coordinates(shapely.box(x, y, x + width, y + depth)) @ frame)
        for x in _places(left, right, width, int(rng.integers(*CELLS_IN_ROW)), thickness + aisle)
        for y in _places(bottom, top, depth, rows, thickness + aisle)
        if x + width <= right + TOUCH_M and y + depth <= top + TOUCH_M
    ]
    free = grow(free, thickness / 2 + TOUCH_M)
    cells = [part for cell in cells for part in polygons_in(grow(cell, -thickness / 2))]
    return [cell for cell in cells if free.contains(cell)]


def _places(first: float, last: float, pitch: float, together: int, aisle: float) -> FloatArray:
    """Return where cells begin along an axis: some side by side, then an aisle, and so on."""
    blocks = np.arange(first, last, together * pitch + aisle)
    return np.asarray((blocks[:, None] + pitch * np.arange(together)).ravel())
