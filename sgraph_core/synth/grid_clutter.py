"""What stands in rooms that robots map: furniture against the walls, and legs."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.random import Generator
from shapely import Point, Polygon
from shapely.geometry.base import BaseGeometry

from sgraph_core.geometry import turn_left
from sgraph_core.synth.config import GridConfig
from sgraph_core.synth.polygons import edges, grow, rectangle
from sgraph_core.synth.surfaces import Floor

__all__ = ["stand_cupboards", "stand_tables"]

BEFORE_DOORS_M = 0.6
"""Cupboards leave this much room around doors, and stand no closer to other furniture."""
WALL_PER_CUPBOARD_M = 4.0
FLOOR_PER_TABLE_M2 = 4.0


def stand_cupboards(floor: Floor, rng: Generator, config: GridConfig) -> list[Polygon]:
    """Return boxes that stand against the walls of some rooms."""
    share = rng.choice(config.cupboard_share)
    ways = [*map(Polygon, floor.doors), *map(Point, floor.doorways)]
    before_doors = shapely.buffer(shapely.union_all(ways), BEFORE_DOORS_M)
    kept_clear = shapely.union_all([before_doors, *floor.furniture])
    smallest, largest = np.transpose([config.cupboard_length_m, config.cupboard_depth_m])
    cupboards: list[Polygon] = []
    for room in floor.rooms:
        if rng.random() >= share:
            continue
        free, grown = room.difference(kept_clear), grow(room, 0.01)
        segments, inwards = edges(room)
        for _ in range(rng.integers(1, 2 + int(room.length / WALL_PER_CUPBOARD_M))):
            length, depth = rng.uniform(smallest, largest)
            side, where = int(rng.integers(len(segments))), rng.random()
            (start, end), normal = segments[side], inwards[side]
            along = -turn_left(normal)
            reach = float(np.linalg.norm(end - start)) - length
            if reach < 0:
                continue
            middle = start + (length / 2 + where * reach) * along + depth / 2 * normal
            body = rectangle(middle, along, length, depth)
            if grown.contains(body) and free.contains(grow(body, -0.02)):
                cupboards.append(body)
                free = free.difference(body)
    return cupboards


def stand_tables(
    rooms: list[Polygon], standing: list[Polygon], rng: Generator, config: GridConfig
) -> list[Polygon]:
    """Return the legs of tables and chairs, four each, in some rooms beside what stands there."""
    share = rng.choice(config.table_share)
    others = shapely.union_all(standing)
    legs: list[Polygon] = []
    for room in rooms:
        if rng.random() >= share:
            continue
        free = grow(room.difference(others), -0.1)
        for _ in range(rng.integers(1, 2 + int(room.area / FLOOR_PER_TABLE_M2))):
            legs += _four_legs(room, free, rng, config)
    return legs


def _four_legs(
    room: Polygon, free: BaseGeometry, rng: Generator, config: GridConfig
) -> list[Polygon]:
    """Return the legs of one table or chair, or none where there is no place for it."""
    west, south, east, north = room.bounds
    middle, angle = rng.uniform([west, south], [east, north]), rng.uniform(0, np.pi / 2)
    axis = np.array([np.cos(angle), np.sin(angle)]) if rng.random() < 0.5 else np.array([1.0, 0.0])
    chair = rng.random() < 0.6
    length, width = rng.uniform(0.35, 0.5, 2) if chair else rng.uniform([0.8, 0.6], [1.8, 0.9])
    top = rectangle(middle, axis, length, width)
    if not free.contains(top):
        return []
    side = rng.uniform(*config.leg_side_m)
    return [rectangle(corner, axis, side, side) for corner in shapely.get_coordinates(top)[:-1]]
