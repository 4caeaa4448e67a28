"""The outlines of rooms, from the lines that their surfaces lie on."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np
import shapely

from sgraph_concepts.types import FloatArray, IntArray, Memory, SurfaceArrays
from sgraph_core.geometry import Geometries, dot, in_frames
from sgraph_core.winding import winding

__all__ = ["outline", "outlines"]

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
SAME_AREA_M2 = 1e-3
"""Of rooms whose areas differ by less, rounding decides which one is smaller."""
STRAIGHT_M, TOUCH_M = 1e-3, 1e-5
"""A border that bends by less is straight: where the room's own lines cross it, and where another
room touches it, since rounding decides whether the two overlap."""


def outlines(rooms: Mapping[int, SurfaceArrays], memory: Memory) -> dict[int, shapely.Polygon]:
    """Return the polygons that rooms' surfaces enclose; where two overlap, the smaller one stays.

    Of two that are equal but for rounding, the one of the lower id stays. A room whose surfaces
    enclose nothing has none.
    """
    whole = {
        room: memory.recall(("outline", surfaces.content), partial(outline, surfaces))
        for room, surfaces in rooms.items()
    }
    found = {room: polygon for room, polygon in whole.items() if polygon is not None}
    numbers = np.array(list(found), np.int64)
    tree = shapely.STRtree(np.array(list(found.values()), object))
    within = tree.query(tree.geometries, predicate="within")
    overlapping = tree.query(tree.geometries, predicate="overlaps")
    one, two = np.hstack([overlapping, within, within[::-1]])
    apart: dict[int, shapely.Polygon] = {}
    for k in np.lexsort((numbers, _sizes(shapely.area(tree.geometries), one, two))):
        room = int(numbers[k])
        rivals = set(numbers[two[one == k]].tolist())
        smaller = [apart[rival] for rival in sorted(rivals & apart.keys())]
        left = _largest(shapely.difference(found[room], shapely.union_all(smaller)))
        if left is not None:
            apart[room] = _without_needless_points(left, TOUCH_M) if smaller else left
    return apart


def _sizes(areas: FloatArray, one: IntArray, two: IntArray) -> FloatArray:
    """Return areas, [N]; of two that overlap and are equal but for rounding, both get the smaller.

    Overlaps are given either way round: ``one`` and ``two`` are their rooms, [P] each.
    """
    equal = np.abs(areas[one] - areas[two]) < SAME_AREA_M2
    sizes = areas.copy()
    np.minimum.at(sizes, one[equal], areas[two[equal]])
    return sizes


def outline(surfaces: SurfaceArrays) -> shapely.Polygon | None:
    """Return the polygon that surfaces enclose, or None.

    The lines of the surfaces, and the convex hull around them, cut the plane into faces. A face
    is inside when the surfaces wind around it: generalised winding number above one half
    (:func:`sgraph_core.winding.winding`), which no point outside the hull reaches.
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
    inside = faces[winding(surfaces.segments, _middles(faces)) > INSIDE]
    whole = _largest(shapely.union_all(inside, grid_size=GRID_M))
    return None if whole is None else _without_needless_points(whole, STRAIGHT_M)


def _middles(faces: Geometries) -> FloatArray:
    """Return a point inside each face, [F, 2].

    Lines that cut right through the hull leave convex faces, whose centroids move and turn with
    the map. Only shorter ones leave others.
    """
    centroids = shapely.centroid(faces)
    within = shapely.contains(faces, centroids)
    return shapely.get_coordinates(np.where(within, centroids, shapely.point_on_surface(faces)))


def _largest(area: shapely.Geometry) -> shapely.Polygon | None:
    """Return the largest polygon of an area, None if it has none."""
    parts = [part for part in shapely.get_parts(area) if isinstance(part, shapely.Polygon)]
    largest = max(parts, key=lambda part: part.area, default=None)
    return None if largest is None or largest.is_empty else largest


def _without_needless_points(polygon: shapely.Polygon, within_m: float) -> shapely.Polygon:
    """Drop the points this close to straight edges, where other lines or rooms meet them."""
    # normalize lets the rings begin at a corner: simplify keeps the point they begin with
    simple = polygon.normalize().simplify(within_m, preserve_topology=False)
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
