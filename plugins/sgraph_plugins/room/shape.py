"""The outline of a room, from the lines that its surfaces lie on."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely

from sgraph_concepts.types import FloatArray, IntArray, NodeShape, Scene, SurfaceArrays
from sgraph_core.geometry import cross, dot, in_frames
from sgraph_core.openings import openings

__all__ = ["outline", "shape"]

SAME_LINE_ANGLE_RAD = np.radians(8.0)
SAME_LINE_OFFSET_M = 0.15
"""Surfaces that face the same way this close to one line share it."""
INSIDE = 0.5
"""Winding number beyond which a face of the arrangement belongs to the room."""
MOST_LINES = 80
"""Beyond this many lines each is extended by REACH_M only: the faces grow with their square."""
REACH_M = 3.0
GRID_M = 1e-6
"""Coordinates are snapped to this grid, so that lines which meet do meet."""


def shape(members: IntArray, scene: Scene) -> NodeShape:
    """Return centre, polygon and holes of the room that the members enclose.

    The polygon follows the members and is straight over what is open between them, such as doors.
    It is absent when they enclose nothing. Attributes: ``area_m2``; ``open_sides``, the parts of
    the border that no member covers and that are wider than a door, in the world; ``open_m``, their
    length.
    """
    surfaces = scene.surfaces.take(members)
    polygon = outline(surfaces)
    if polygon is None:
        return NodeShape(centre=_point(surfaces.midpoints.mean(axis=0)))
    centre = polygon.centroid
    if not polygon.contains(centre):
        centre = polygon.representative_point()
    return NodeShape(
        centre=(centre.x, centre.y),
        polygon=_ring(polygon.exterior),
        holes=tuple(_ring(hole) for hole in polygon.interiors),
        attributes={
            "area_m2": round(polygon.area, 3),
            **_open_sides(polygon, surfaces, scene.origin),
        },
    )


def _open_sides(
    polygon: shapely.Polygon, surfaces: SurfaceArrays, origin: FloatArray
) -> dict[str, Any]:
    sides = [o for o in openings(polygon, surfaces) if o.kind == "open side"]
    return {
        "open_sides": [piece.tolist() for side in sides for piece in side.segments + origin],
        "open_m": round(sum((float(side.lengths_m.sum()) for side in sides), 0.0), 3),
    }


def outline(surfaces: SurfaceArrays) -> shapely.Polygon | None:
    """Return the polygon that surfaces enclose, or None.

    The lines of the surfaces, and the convex hull around them, cut the plane into faces. A face
    is inside when the surfaces wind around it: generalised winding number above one half
    (Jacobson et al., "Robust Inside-Outside Segmentation using Generalized Winding Numbers", 2013),
    which needs no closed outline, and which no point outside the hull reaches.
    """
    hull = shapely.convex_hull(shapely.multipoints(surfaces.segments.reshape(-1, 2)))
    if not isinstance(hull, shapely.Polygon):
        return None
    lines = shapely.set_precision(_lines(surfaces, hull), GRID_M)
    border = shapely.set_precision(hull.exterior, GRID_M)
    noded = shapely.union_all([*lines, border], grid_size=GRID_M)
    faces = shapely.get_parts(shapely.polygonize(shapely.get_parts(noded)))
    faces = faces[shapely.area(faces) > GRID_M]
    if not len(faces):
        return None
    points = shapely.get_coordinates(shapely.point_on_surface(faces))
    inside = faces[_winding(surfaces, points) > INSIDE]
    whole = shapely.get_parts(shapely.union_all(inside, grid_size=GRID_M))
    if not len(whole):
        return None
    return _without_needless_points(whole[np.argmax(shapely.area(whole))])


def _without_needless_points(polygon: shapely.Polygon) -> shapely.Polygon:
    """Drop the points on straight edges, where the lines of other surfaces cross them."""
    # normalize lets the rings begin at a corner: simplify keeps the point they begin with
    simple = polygon.normalize().simplify(1e-3, preserve_topology=False)
    if isinstance(simple, shapely.Polygon) and simple.is_valid and simple.area > 0:
        return simple
    return polygon


def _lines(surfaces: SurfaceArrays, hull: shapely.Polygon) -> list[shapely.LineString]:
    """Return one line per group of collinear surfaces that face the same way, the longest's."""
    waiting = np.argsort(-surfaces.lengths, kind="stable")
    groups: list[IntArray] = []
    while len(waiting):
        lead = np.repeat(waiting[:1], len(waiting))
        same_way = dot(surfaces.normals[lead], surfaces.normals[waiting]) > np.cos(
            SAME_LINE_ANGLE_RAD
        )
        _, across = in_frames(surfaces, lead, surfaces.segments[waiting])
        shares = same_way & (np.abs(across).max(axis=1) < SAME_LINE_OFFSET_M)
        shares[0] = True
        groups.append(waiting[shares])
        waiting = waiting[~shares]
    west, south, east, north = hull.bounds
    reach = REACH_M if len(groups) > MOST_LINES else float(np.hypot(east - west, north - south))
    lines = []
    for group in groups:
        lead = group[:1]
        along, _ = in_frames(surfaces, np.repeat(lead, len(group)), surfaces.segments[group])
        ends = np.array([along.min() - reach, along.max() + reach])
        points = surfaces.midpoints[lead] + ends[:, None] * surfaces.tangents[lead]
        lines.append(shapely.LineString(points))
    return lines


def _winding(surfaces: SurfaceArrays, points: FloatArray) -> FloatArray:
    """Return how often the surfaces wind around each point, 1 inside a closed outline, [P]."""
    first = surfaces.segments[None, :, 0] - points[:, None]
    second = surfaces.segments[None, :, 1] - points[:, None]
    # whoever stands in the room sees the first endpoint on the left: clockwise, hence the minus
    angles = np.arctan2(cross(first, second), dot(first, second))
    return np.asarray(-angles.sum(axis=1) / (2 * np.pi))


def _ring(ring: shapely.LinearRing) -> tuple[tuple[float, float], ...]:
    points = shapely.get_coordinates(ring)[:-1]
    if not ring.is_ccw:
        points = points[::-1]
    return tuple(_point(point) for point in points)


def _point(xy: FloatArray) -> tuple[float, float]:
    return float(xy[0]), float(xy[1])
