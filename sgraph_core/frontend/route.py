"""The way a robot takes through a building: shortest paths that keep clear of walls."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import networkx as nx
import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from sgraph_concepts.errors import InputError
from sgraph_concepts.types import FloatArray
from sgraph_core.frontend.building import Point
from sgraph_core.geometry import lines_of
from sgraph_core.synth.polygons import grow, polygons_in

__all__ = ["drive_along", "reachable", "route"]

CLEARANCE_M = 0.3


def reachable(free: BaseGeometry, stops: Sequence[Point]) -> bool:
    """Return whether a way that keeps clear of walls joins all stops."""
    parts = polygons_in(grow(free, -CLEARANCE_M))
    return any(shapely.covers(part, shapely.points(stops)).all() for part in parts)


def route(free: BaseGeometry, stops: Sequence[Point]) -> FloatArray:
    """Return the corners of the shortest way from stop to stop through free space, [C, 2].

    The shortest way bends only at the corners of the space that is left when the robot keeps
    clear of walls, so a graph of the corners that see one another holds it.

    Raises:
        InputError: a stop is not clear of walls, or there is no way to it.
    """
    clear = grow(free, -CLEARANCE_M)
    corners = shapely.get_coordinates(clear)
    places = np.unique(np.vstack([corners, np.array(stops)]).round(6), axis=0)
    one, two = np.triu_indices(len(places), 1)
    lines = lines_of(np.stack([places[one], places[two]], axis=1))
    reach = grow(clear, 1e-4)
    shapely.prepare(reach)
    seen = shapely.covers(reach, lines)
    graph: nx.Graph[int] = nx.Graph()
    graph.add_weighted_edges_from(
        zip(
            one[seen].tolist(),
            two[seen].tolist(),
            shapely.length(lines[seen]).tolist(),
            strict=True,
        )
    )
    numbers = {tuple(place): k for k, place in enumerate(places.tolist())}
    rounded = [tuple(np.round(stop, 6).tolist()) for stop in stops]
    way = [numbers[rounded[0]]]
    for start, end in pairwise(rounded):
        try:
            way += nx.dijkstra_path(graph, numbers[start], numbers[end])[1:]
        except (nx.NetworkXNoPath, nx.NodeNotFound):
            raise InputError(
                f"there is no way from {start} to {end}: check doors and stops"
            ) from None
    return places[way]


def drive_along(corners: FloatArray, spacing_m: float) -> FloatArray:
    """Return poses x, y, yaw along a way, every ``spacing_m``, heading where it leads, [K, 3]."""
    way = shapely.LineString(corners)
    reach = np.arange(0.0, way.length, spacing_m)
    here = shapely.get_coordinates(shapely.line_interpolate_point(way, reach))
    ahead = shapely.get_coordinates(shapely.line_interpolate_point(way, reach + 0.05))
    yaw = np.arctan2(*(ahead - here).T[::-1])
    return np.column_stack([here, yaw])
