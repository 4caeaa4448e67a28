"""Free Space: the rooms of S-Graphs+, as the paper describes that method.

It needs no learning: the space far from every obstacle is cut into its connected clusters, and
around each cluster two or four wall surfaces that enclose it are looked for. Two make a corridor,
four a room; it knows no other shapes. S-Graphs+ represents that space by a graph of points, here it
is a polygon, which leaves out no point.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
import shapely
from shapely import Polygon

from sgraph_concepts.types import ConceptNode, FloatArray, NodeShape, SurfaceArrays
from sgraph_core.frontend.planar import from_rows, placed
from sgraph_core.geometry import dot, lines_of
from sgraph_core.graph import SGraph
from sgraph_core.synth.polygons import polygons_in

__all__ = ["free_space_rooms"]

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
AROUND_M = 0.5
"""How much farther than clearance and margin from a cluster its surfaces may be."""
PARALLEL = np.cos(np.radians(15.0))
PERPENDICULAR = np.sin(np.radians(15.0))
LEAST_OVERLAP_M = 0.5
"""Of two opposed surfaces and the cluster between them."""


def free_space_rooms(graph: SGraph, scans: Sequence[FloatArray]) -> list[ConceptNode]:
    """Return the rooms that Free Space finds in a map, with two or four members each.

    Args:
        graph: K keyframes and the wall surfaces; nothing else of it is read.
        scans: K or more; of each keyframe the end points of rays in order of their bearing, in the
            body frame, [P_k, 2].
    """
    surfaces = graph.wall_surfaces.ordered()
    found: dict[tuple[int, ...], Polygon] = {}
    for cluster in _clusters(from_rows(graph.keyframes.poses), scans):
        rows = _enclosing(surfaces, cluster)
        if rows:
            found.setdefault(tuple(sorted(surfaces.ids[rows].tolist())), cluster)
    return [
        ConceptNode(number, members, shape=NodeShape((cluster.centroid.x, cluster.centroid.y)))
        for number, (members, cluster) in enumerate(found.items())
    ]


def _clusters(poses: FloatArray, scans: Sequence[FloatArray]) -> list[Polygon]:
    """Return the connected parts of the space that is far from every obstacle."""
    seen = [
        Polygon(placed(pose, _outline(scan)))
        for pose, scan in zip(poses, scans, strict=False)
        if len(scan) >= 3
    ]
    free = shapely.union_all(shapely.buffer(shapely.simplify(seen, DETAIL_M), -MARGIN_M))
    parts = polygons_in(free.buffer(-CLEARANCE_M))
    return [part for part in parts if part.area >= LEAST_AREA_M2]


def _outline(scan: FloatArray) -> FloatArray:
    """Return the outline of what a scan shows to be free: unless it is a full turn, with its eye."""
    bearings = np.arctan2(scan[:, 1], scan[:, 0])
    unseen = (bearings[0] - bearings[-1]) % (2 * np.pi)
    return scan if unseen < FULL_TURN_GAP_RAD else np.concatenate([scan, np.zeros((1, 2))])


def _enclosing(surfaces: SurfaceArrays, cluster: Polygon) -> list[int]:
    """Return the rows of four or two surfaces that enclose a cluster; none if there are no two.

    Of opposed surfaces those are taken that have most of the cluster between them, and are near.
    """
    around = _around(surfaces, cluster)
    pairs = {
        (one, two): overlap - around[one] - around[two]
        for one, two in combinations(around, 2)
        if dot(surfaces.normals[one], surfaces.normals[two]) < -PARALLEL
        and (overlap := _overlap(surfaces, one, two, cluster)) >= LEAST_OVERLAP_M
    }
    if not pairs:
        return []
    first = max(pairs, key=pairs.__getitem__)
    normal = surfaces.normals[first[0]]
    across = [p for p in pairs if abs(dot(surfaces.normals[p[0]], normal)) < PERPENDICULAR]
    second = max(across, key=pairs.__getitem__, default=())
    return [*first, *second]


def _around(surfaces: SurfaceArrays, cluster: Polygon) -> dict[int, float]:
    """Return rows and distances of the surfaces beside a cluster that face it."""
    lines = lines_of(surfaces.segments)
    near = np.flatnonzero(shapely.dwithin(lines, cluster, CLEARANCE_M + MARGIN_M + AROUND_M))
    ways = shapely.get_coordinates(shapely.shortest_line(lines[near], cluster)).reshape(-1, 2, 2)
    way = ways[:, 1] - ways[:, 0]
    facing = dot(way, surfaces.normals[near]) > 0
    distances = np.linalg.norm(way, axis=1)
    return dict(zip(near[facing].tolist(), distances[facing].tolist(), strict=True))


def _overlap(surfaces: SurfaceArrays, one: int, two: int, cluster: Polygon) -> float:
    """Return along what length two opposed surfaces have the cluster between them."""
    parts = (surfaces.segments[one], surfaces.segments[two], shapely.get_coordinates(cluster))
    spans = [part @ surfaces.tangents[one] for part in parts]
    return float(min(span.max() for span in spans) - max(span.min() for span in spans))
