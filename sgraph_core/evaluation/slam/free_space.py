"""Free Space: the rooms of S-Graphs+, as the paper describes that method.

It needs no learning: a graph of points far from every obstacle is cut into its connected clusters,
and around each cluster two or four wall surfaces that enclose it are looked for. Two make a
corridor, four a room; it knows no other shapes. The points here are those of a lattice; a wall
surface that is mapped in pieces joins with all of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import shapely
from PIL import Image, ImageDraw
from scipy import ndimage
from shapely import Polygon

from sgraph_concepts.types import ConceptNode, FloatArray, NodeShape, SurfaceArrays
from sgraph_core.frontend.planar import from_rows, placed
from sgraph_core.geometry import dot, lines_of
from sgraph_core.graph import SGraph
from sgraph_core.synth.polygons import polygons_in

__all__ = ["free_outlines", "free_space_rooms"]

SPACING_M = 0.1
"""Of the lattice."""
MARGIN_M = 0.15
"""Before the end of a ray nothing is taken to be free: ranges and poses are noisy, walls thin."""
CLEARANCE_M = 0.5
"""Space closer than this to what is not free is cut away. With the margin, openings up to 1.3 m are
cut through."""
LEAST_AREA_M2 = 0.25
"""Of a cluster: a smaller one is a wide place in a doorway."""
DETAIL_M = 0.02
"""Of outlines."""
FULL_TURN_GAP_RAD = 0.1
"""Between the last and the first bearing of a scan that is a full turn."""
AROUND_M = 0.3
"""How much farther than clearance and margin from a cluster its surfaces may be."""
PARALLEL = np.cos(np.radians(15.0))
PERPENDICULAR = np.sin(np.radians(15.0))
SAME_PLANE_M = 0.2
LEAST_OVERLAP_M = 0.5
"""Of two opposed surfaces and the cluster between them."""


@dataclass(frozen=True, eq=False)
class _Cluster:
    """Connected points: their mean [2], and those that have a neighbour outside [P, 2]."""

    centre: FloatArray
    rim: FloatArray


def free_outlines(scans: Sequence[FloatArray]) -> list[list[FloatArray]]:
    """Return the outlines of what each scan shows to be free, in the body frame, [C, 2] each.

    Args:
        scans: end points of rays in order of their bearing, in the body frame, [P, 2] each.
    """
    seen = [Polygon(_outline(scan)) for scan in scans]
    free = shapely.buffer(shapely.simplify(seen, DETAIL_M), -MARGIN_M)
    return [[shapely.get_coordinates(part.exterior) for part in polygons_in(area)] for area in free]


def free_space_rooms(graph: SGraph, outlines: Sequence[Sequence[FloatArray]]) -> list[ConceptNode]:
    """Return the rooms that Free Space finds in a map: two or four planes each.

    Args:
        graph: K keyframes and the wall surfaces; nothing else of it is read.
        outlines: what is free as seen from each keyframe, of K or more, by :func:`free_outlines`.
    """
    surfaces = graph.wall_surfaces.ordered()
    found: dict[tuple[int, ...], FloatArray] = {}
    for cluster in _clusters(from_rows(graph.keyframes.poses), outlines):
        rows = _enclosing(surfaces, cluster.rim)
        if rows:
            found.setdefault(tuple(sorted(surfaces.ids[rows].tolist())), cluster.centre)
    return [
        ConceptNode(number, members, shape=NodeShape((float(centre[0]), float(centre[1]))))
        for number, (members, centre) in enumerate(found.items())
    ]


def _outline(scan: FloatArray) -> FloatArray:
    """Return the outline of what a scan shows, with its eye unless it is a full turn.

    A ray reaches no farther than its neighbours: between them may be the edge of a wall.
    """
    if len(scan) < 2:
        return np.empty((0, 2))
    ranges = np.linalg.norm(scan, axis=1)
    least = ndimage.minimum_filter1d(ranges, 3, mode="wrap")
    outline = scan * (least / np.maximum(ranges, 1e-9))[:, None]
    bearings = np.arctan2(scan[:, 1], scan[:, 0])
    unseen = (bearings[0] - bearings[-1]) % (2 * np.pi)
    return outline if unseen < FULL_TURN_GAP_RAD else np.concatenate([outline, np.zeros((1, 2))])


def _clusters(poses: FloatArray, outlines: Sequence[Sequence[FloatArray]]) -> list[_Cluster]:
    """Return the connected clusters of the points that are far from every obstacle."""
    rings = [placed(pose, ring) for pose, own in zip(poses, outlines, strict=False) for ring in own]
    if not rings:
        return []
    corners = np.concatenate(rings)
    origin = corners.min(axis=0) - SPACING_M
    columns, rows = np.ceil((corners.max(axis=0) - origin) / SPACING_M).astype(int) + 2
    image = Image.new("1", (int(columns), int(rows)))
    draw = ImageDraw.Draw(image)
    for ring in rings:
        draw.polygon(((ring - origin) / SPACING_M).ravel().tolist(), fill=1)
    clearance = SPACING_M * ndimage.distance_transform_edt(np.asarray(image))
    labels, _ = ndimage.label(clearance >= CLEARANCE_M)
    found = []
    for label, place in enumerate(ndimage.find_objects(labels), start=1):
        cells = labels[place] == label
        if cells.sum() * SPACING_M**2 >= LEAST_AREA_M2:
            corner = origin + SPACING_M * np.array([part.start for part in reversed(place)])
            rim = cells & ~ndimage.binary_erosion(cells)
            inside, around = (np.argwhere(part)[:, ::-1] * SPACING_M for part in (cells, rim))
            found.append(_Cluster(corner + inside.mean(axis=0), corner + around))
    return found


def _enclosing(surfaces: SurfaceArrays, rim: FloatArray) -> list[int]:
    """Return the rows of the surfaces in four or two planes that enclose a cluster, else none.

    Of opposed surfaces those are taken that have most of the cluster between them, and are near.
    """
    around = _around(surfaces, rim)
    pairs = {
        (one, two): overlap - around[one] - around[two]
        for one, two in combinations(around, 2)
        if dot(surfaces.normals[one], surfaces.normals[two]) < -PARALLEL
        and (overlap := _overlap(surfaces, one, two, rim)) >= LEAST_OVERLAP_M
    }
    if not pairs:
        return []
    first = max(pairs, key=pairs.__getitem__)
    normal = surfaces.normals[first[0]]
    across = [p for p in pairs if abs(dot(surfaces.normals[p[0]], normal)) < PERPENDICULAR]
    second = max(across, key=pairs.__getitem__, default=())
    chosen = (*first, *second)
    beside = [row for row in around if _overlap(surfaces, row, row, rim) >= LEAST_OVERLAP_M]
    return [row for row in beside if any(_in_plane(surfaces, row, one) for one in chosen)]


def _in_plane(surfaces: SurfaceArrays, row: int, of: int) -> bool:
    """Return whether a surface lies in another one's plane: a wall may be mapped in pieces."""
    apart = dot(surfaces.midpoints[row] - surfaces.midpoints[of], surfaces.normals[of])
    same_way = dot(surfaces.normals[row], surfaces.normals[of]) > PARALLEL
    return bool(same_way and abs(apart) <= SAME_PLANE_M)


def _around(surfaces: SurfaceArrays, rim: FloatArray) -> dict[int, float]:
    """Return rows and distances of the surfaces beside a cluster that face it."""
    lines, cloud = lines_of(surfaces.segments), shapely.multipoints(rim)
    near = np.flatnonzero(shapely.dwithin(lines, cloud, CLEARANCE_M + MARGIN_M + AROUND_M))
    ways = shapely.get_coordinates(shapely.shortest_line(lines[near], cloud)).reshape(-1, 2, 2)
    way = ways[:, 1] - ways[:, 0]
    facing = dot(way, surfaces.normals[near]) > 0
    distances = np.linalg.norm(way, axis=1)
    return dict(zip(near[facing].tolist(), distances[facing].tolist(), strict=True))


def _overlap(surfaces: SurfaceArrays, one: int, two: int, rim: FloatArray) -> float:
    """Return along what length two opposed surfaces have the cluster between them."""
    parts = (surfaces.segments[one], surfaces.segments[two], rim)
    spans = [part @ surfaces.tangents[one] for part in parts]
    return float(min(span.max() for span in spans) - max(span.min() for span in spans))
