"""Where a robot goes on a floor: through rooms by their doors, and around the building."""

from __future__ import annotations

import networkx as nx
import numpy as np
import shapely
from numpy.random import Generator
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from sgraph_concepts.types import FloatArray
from sgraph_core.synth.config import ViewConfig
from sgraph_core.synth.polygons import grow, polygons_in
from sgraph_core.synth.surfaces import Floor

__all__ = ["draw_poses"]

ROBOT_RADIUS_M = 0.25
OUTSIDE_M = 3.0
"""How far from the building the robot drives around it."""
OUTSIDE_SPACING_M = 4.0


def draw_poses(floor: Floor, rng: Generator, config: ViewConfig) -> FloatArray:
    """Return from where a robot maps a floor, [K, 2].

    It enters some of the rooms; its poses are in them, beside the furniture, and in the doors
    between them. Where facades are mapped, it also drives around the building.
    """
    visited = _visited(floor, rng, rng.uniform(*config.visited_share))
    spacing = rng.uniform(*config.pose_spacing_m)
    furniture = shapely.union_all(floor.furniture)
    poses = [_poses_in(floor.rooms[room], furniture, spacing, rng) for room in visited]
    passed = np.isin(floor.passages, visited).all(axis=1)
    poses.append(floor.doorways[passed])
    if floor.pieces.facades.any():
        poses.append(_around(floor.rooms))
    return np.concatenate(poses)


def _visited(floor: Floor, rng: Generator, share: float) -> list[int]:
    """Return the rooms that the robot enters: from one to the next as long as there are doors.

    Rooms without a door are entered too, by one that is closed in the map.
    """
    doors: nx.Graph[int] = nx.Graph(floor.passages.tolist())
    doors.add_nodes_from(range(len(floor.rooms)))
    order: dict[int, int] = {}
    for start in rng.permutation(len(floor.rooms)).tolist():
        if start not in order:
            order.update(nx.single_source_shortest_path_length(doors, start))
    return list(order)[: int(np.ceil(share * len(order)))]


def _poses_in(
    room: Polygon, furniture: BaseGeometry, spacing_m: float, rng: Generator
) -> FloatArray:
    """Return points all over a room, apart by the spacing and clear of walls and furniture."""
    beside = room.difference(furniture)
    free = grow(beside, -ROBOT_RADIUS_M)
    if free.is_empty:
        return shapely.get_coordinates(beside.representative_point())
    west, south, east, north = free.bounds
    count = 8 + int(4 * (east - west) * (north - south) / spacing_m**2)
    candidates = rng.uniform([west, south], [east, north], (count, 2))
    candidates = candidates[shapely.contains_xy(free, candidates)]
    poses = [np.array(free.representative_point().coords[0])]
    for point in candidates:
        if np.linalg.norm(np.array(poses) - point, axis=1).min() >= spacing_m:
            poses.append(point)
    return np.array(poses)


def _around(rooms: list[Polygon]) -> FloatArray:
    """Return points around the building at some distance from it."""
    grown = shapely.buffer(shapely.geometrycollections(rooms), OUTSIDE_M)
    ways = [part.exterior for part in polygons_in(grown)]
    points = [way.interpolate(np.arange(0, way.length, OUTSIDE_SPACING_M)) for way in ways]
    return shapely.get_coordinates(np.concatenate(points))
