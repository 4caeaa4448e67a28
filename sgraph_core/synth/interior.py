"""What stands free in large rooms: columns and partitions, as holes of the rooms' free space."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.random import Generator
from shapely import Polygon

from sgraph_core.geometry import turn_left
from sgraph_core.synth.config import PlanConfig
from sgraph_core.synth.polygons import extent, grow, rectangle

__all__ = ["stand_columns", "stand_partitions"]

LARGE_ROOM_M2 = 25.0
AISLE_M = 0.7
"""What stands free stays this far from walls: one can pass, and surfaces with an aisle between them
are too far apart for the two sides of a wall."""


def stand_columns(rooms: list[Polygon], rng: Generator, config: PlanConfig) -> list[Polygon]:
    """Stand columns into some large rooms, on the points of one grid over the whole floor."""
    share = rng.choice(config.column_share)
    sides = rng.uniform(*config.column_side_m, size=2)
    if rng.random() < 0.7:
        sides[1] = sides[0]
    spacings = rng.uniform(*config.column_spacing_m, size=2)
    offset = rng.uniform(0, spacings)
    result = []
    for room in rooms:
        if room.area >= LARGE_ROOM_M2 and rng.random() < share:
            west, south, east, north = room.bounds
            first = np.ceil(([west, south] - offset) / spacings)
            last = np.floor(([east, north] - offset) / spacings)
            columns = [
                rectangle(offset + spacings * (i, j), np.array([1.0, 0.0]), *sides)
                for i in np.arange(first[0], last[0] + 1)
                for j in np.arange(first[1], last[1] + 1)
            ]
            result.append(_without(room, columns))
        else:
            result.append(room)
    return result


def stand_partitions(rooms: list[Polygon], rng: Generator, config: PlanConfig) -> list[Polygon]:
    """Stand one to five partitions into some large rooms, along the room or across."""
    share = rng.choice(config.partition_share)
    result = []
    for plain in rooms:
        room = plain
        if room.area >= LARGE_ROOM_M2 and rng.random() < share:
            west, south, east, north = room.bounds
            _, _, axis = extent(room)
            for _ in range(rng.integers(1, 6)):
                middle = rng.uniform([west, south], [east, north])
                along = axis if rng.random() < 0.5 else turn_left(axis)
                length = rng.uniform(*config.partition_length_m)
                thickness = rng.uniform(*config.partition_thickness_m)
                room = _without(room, [rectangle(middle, along, length, thickness)])
        result.append(room)
    return result


def _without(room: Polygon, bodies: list[Polygon]) -> Polygon:
    """Take out of a room those bodies that leave an aisle around them."""
    free = grow(room, -AISLE_M)
    standing = [body for body in bodies if free.contains(body)]
    left = room.difference(shapely.union_all(standing))
    return left if isinstance(left, Polygon) else room
