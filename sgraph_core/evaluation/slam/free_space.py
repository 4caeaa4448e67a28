"""Free Space: the rooms of S-Graphs+, as the paper describes that method.

It needs no learning: a free-space graph of points far from every obstacle is grown from where the
robot was, cut into connected clusters, and around each cluster two or four wall surfaces that
enclose it are looked for. Two make a corridor, four a room; it knows no other shapes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import shapely
from numpy.typing import NDArray
from PIL import Image, ImageDraw
from scipy import ndimage

from sgraph_concepts.types import ConceptNode, FloatArray, NodeShape, SurfaceArrays
from sgraph_core.frontend.planar import from_rows, placed
from sgraph_core.geometry import dot, lines_of
from sgraph_core.graph import SGraph

__all__ = ["free_space_rooms"]

SPACING_M = 0.1
"""Of the points of the free-space graph."""
CLEARANCE_M = 0.6
"""Points closer to an obstacle are cut away: more than half a door, less than half a corridor."""
LEAST_AREA_M2 = 0.25
"""Of what a cluster must cover to be more than a wide place in a doorway."""
FULL_TURN_GAP_RAD = 0.1
"""Between the last and the first bearing of a scan that is a full turn."""
AROUND_M = 0.5
"""How much farther than the clearance from a cluster its surfaces may be."""
PARALLEL = np.cos(np.radians(15.0))
PERPENDICULAR = np.sin(np.radians(15.0))
LEAST_OVERLAP_M = 0.5
"""Of two opposed surfaces and the cluster between them."""


@dataclass(frozen=True, eq=False)
class _Points:
    """A lattice of points; the point of row i and column j is at origin + spacing * (j, i)."""

    free: NDArray[np.bool_]
    origin: FloatArray

    def at(self, cells: NDArray[np.bool_]) -> FloatArray:
        """Return the points of the cells that are true, [P, 2]."""
        rows, columns = np.nonzero(cells)
        return self.origin + SPACING_M * np.stack([columns, rows], axis=1)


def free_space_rooms(graph: SGraph, scans: Sequence[FloatArray]) -> list[ConceptNode]:
    """Return the rooms that Free Space finds in a map, with two or four members each.

    Args:
        graph: keyframes and wall surfaces; nothing else of it is read.
        scans: end points of a scan in order of their bearing, in the body frame of each keyframe,
            [P_k, 2]: the space between them and the keyframe is free.
    """
    surfaces = graph.wall_surfaces.ordered()
    found: dict[tuple[int, ...], FloatArray] = {}
    for cluster in _clusters(_free_points(from_rows(graph.keyframes.poses), scans)):
        rows = _enclosing(surfaces, cluster)
        if rows:
            found.setdefault(tuple(sorted(surfaces.ids[rows].tolist())), cluster.mean(axis=0))
    return [
        ConceptNode(number, members, shape=NodeShape(centre=(float(centre[0]), float(centre[1]))))
        for number, (members, centre) in enumerate(found.items())
    ]


def _free_points(poses: FloatArray, scans: Sequence[FloatArray]) -> _Points:
    """Return which points lie inside a scan."""
    outlines = [
        placed(pose, _outline(scan)) for pose, scan in zip(poses, scans, strict=True)
    ]
    corners = np.concatenate([np.zeros((0, 2)), *outlines])
    if not len(corners):
        return _Points(np.zeros((0, 0), bool), np.zeros(2))
    origin = corners.min(axis=0) - SPACING_M
    columns, rows = np.ceil((corners.max(axis=0) - origin) / SPACING_M).astype(int) + 2
    image = Image.new("1", (int(columns), int(rows)))
    draw = ImageDraw.Draw(image)
    for outline in outlines:
        if len(outline) > 2:
            draw.polygon(((outline - origin) / SPACING_M).ravel().tolist(), fill=1)
    return _Points(np.asarray(image), origin)


def _outline(scan: FloatArray) -> FloatArray:
    """Return the outline of what a scan shows to be free: unless it is a full turn, also its eye."""
    bearings = np.arctan2(scan[:, 1], scan[:, 0])
    unseen = (bearings[:1] - bearings[-1:]) % (2 * np.pi)
    return scan if (unseen < FULL_TURN_GAP_RAD).all() else np.concatenate([scan, np.zeros((1, 2))])


def _clusters(points: _Points) -> Iterator[FloatArray]:
    """Yield the connected clusters of points that are far from every obstacle, [P, 2] each."""
    clearance = SPACING_M * ndimage.distance_transform_edt(points.free)
    labels, count = ndimage.label(clearance >= CLEARANCE_M)
    for label in range(1, count + 1):
        cluster = points.at(labels == label)
        if len(cluster) * SPACING_M**2 >= LEAST_AREA_M2:
            yield cluster


def _enclosing(surfaces: SurfaceArrays, cluster: FloatArray) -> list[int]:
    """Return the rows of four or two surfaces that enclose a cluster; none if there are no two."""
    around = _around(surfaces, cluster)
    pairs = {
        (one, two): overlap
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


def _around(surfaces: SurfaceArrays, cluster: FloatArray) -> list[int]:
    """Return the rows of the surfaces beside a cluster that face it."""
    lines, cloud = lines_of(surfaces.segments), shapely.multipoints(cluster)
    near = np.flatnonzero(shapely.dwithin(lines, cloud, CLEARANCE_M + AROUND_M))
    ways = shapely.get_coordinates(shapely.shortest_line(lines[near], cloud)).reshape(-1, 2, 2)
    facing = dot(ways[:, 1] - ways[:, 0], surfaces.normals[near]) > 0
    return near[facing].tolist()


def _overlap(surfaces: SurfaceArrays, one: int, two: int, cluster: FloatArray) -> float:
    """Return along what length two opposed surfaces have the cluster between them."""
    tangent = surfaces.tangents[one]
    spans = [part @ tangent for part in (surfaces.segments[one], surfaces.segments[two], cluster)]
    return float(min(span.max() for span in spans) - max(span.min() for span in spans))
