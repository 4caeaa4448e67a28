"""Operations on room polygons."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.random import Generator
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from sgraph_concepts.types import FloatArray, IntArray
from sgraph_core.geometry import cross, turn_left

__all__ = [
    "all_edges",
    "chamfer",
    "clean",
    "crook",
    "cut",
    "edges",
    "extent",
    "grow",
    "polygons_in",
    "rectangle",
]

SMALLEST_ROOM_M2 = 0.5
SLIVER_M = 0.03
SHORTEST_EDGE_M = 0.02
FAR_M = 500.0


def grow(geometry: BaseGeometry, distance_m: float) -> BaseGeometry:
    """Return a geometry grown (or shrunk) with sharp corners."""
    return geometry.buffer(distance_m, join_style="mitre", mitre_limit=5)


def polygons_in(geometry: BaseGeometry) -> list[Polygon]:
    """Return the polygons that a geometry consists of."""
    return [part for part in shapely.get_parts(geometry) if isinstance(part, Polygon)]


def clean(geometry: BaseGeometry) -> Polygon | None:
    """Return a geometry's largest polygon without slivers, or None if it is no room."""
    opened = grow(grow(shapely.set_precision(geometry, 1e-4), -SLIVER_M), SLIVER_M)
    parts = polygons_in(opened)
    if not parts:
        return None
    largest = max(parts, key=lambda part: part.area).simplify(0.005)
    if isinstance(largest, Polygon) and largest.is_valid and largest.area > SMALLEST_ROOM_M2:
        return largest
    return None


def edges(polygon: Polygon) -> tuple[FloatArray, FloatArray]:
    """Return the edges of a polygon [E, 2, 2] and their normals [E, 2], which point inwards."""
    return all_edges([polygon])[:2]


def all_edges(rooms: list[Polygon]) -> tuple[FloatArray, FloatArray, IntArray]:
    """Return the edges of all rooms [E, 2, 2], their inward normals, and each edge's room [E]."""
    rings, room_of_ring = shapely.get_rings(shapely.orient_polygons(rooms), return_index=True)
    corners, ring = shapely.get_coordinates(rings, return_index=True)
    segments = np.stack([corners[:-1], corners[1:]], axis=1)
    along = segments[:, 1] - segments[:, 0]
    length = np.linalg.norm(along, axis=1)
    kept = (ring[:-1] == ring[1:]) & (length > SHORTEST_EDGE_M)
    normals = turn_left(along[kept] / length[kept, None])
    return segments[kept], normals, room_of_ring[ring[:-1][kept]]


def extent(polygon: BaseGeometry) -> tuple[float, float, FloatArray]:
    """Return length and width of the smallest rectangle around a polygon, and its long axis."""
    corners = shapely.get_coordinates(shapely.minimum_rotated_rectangle(polygon))
    if len(corners) < 4:
        return 0.0, 0.0, np.array([1.0, 0.0])
    one, two = corners[1] - corners[0], corners[2] - corners[1]
    if np.linalg.norm(one) < np.linalg.norm(two):
        one, two = two, one
    length, width = float(np.linalg.norm(one)), float(np.linalg.norm(two))
    return length, width, one / max(length, 1e-9)


def rectangle(middle: FloatArray, axis: FloatArray, length_m: float, width_m: float) -> Polygon:
    """Return the rectangle around a point, ``length_m`` along an axis and ``width_m`` across."""
    along, across = axis * length_m / 2, turn_left(axis) * width_m / 2
    corners = [-along - across, along - across, along + across, -along + across]
    return Polygon([middle + corner for corner in corners])


def cut(
    polygon: BaseGeometry, point: FloatArray, axis: FloatArray, width_m: float
) -> list[Polygon]:
    """Return what a straight wall through a point leaves of a polygon."""
    wall = rectangle(point, axis, 2 * FAR_M, width_m)
    return [p for p in polygons_in(polygon.difference(wall)) if p.area > SMALLEST_ROOM_M2]


def chamfer(polygon: Polygon, rng: Generator, share: float) -> Polygon:
    """Cut off some of a polygon's convex corners, by 0.4 to 3 m."""
    corners = shapely.get_coordinates(shapely.orient_polygons(polygon).exterior)[:-1]
    before, after = np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0)
    convex = cross(corners - before, after - corners) > 0
    points = []
    for corner, previous, following, cuttable in zip(corners, before, after, convex, strict=True):
        room = 0.4 * min(np.linalg.norm(previous - corner), np.linalg.norm(following - corner))
        if cuttable and rng.random() < share and room > 0.4:
            size = rng.uniform(0.4, min(3.0, float(room)))
            for other in (previous, following):
                points.append(corner + size * (other - corner) / np.linalg.norm(other - corner))
        else:
            points.append(corner)
    cut_off = Polygon(points, [ring.coords for ring in polygon.interiors])
    return cut_off if cut_off.is_valid else polygon


def crook(polygon: Polygon, rng: Generator, sigma_m: float) -> Polygon:
    """Move the corners of a polygon at random."""

    def moved(ring: shapely.LinearRing) -> FloatArray:
        corners = shapely.get_coordinates(ring)[:-1]
        return np.asarray(corners + rng.normal(0, sigma_m, corners.shape))

    crooked = Polygon(moved(polygon.exterior), [moved(ring) for ring in polygon.interiors])
    return crooked if crooked.is_valid else polygon
