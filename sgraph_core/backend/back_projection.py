"""What a solution moves: keyframes, surfaces, and the shapes of the nodes above them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import islice

import gtsam
import numpy as np

from sgraph_concepts.spec import WALL_SURFACE
from sgraph_concepts.types import ConceptNode, FloatArray, IntArray, NodeShape
from sgraph_core.backend.keys import Keys
from sgraph_core.backend.low_layers import LowLayers, pose_row
from sgraph_core.geometry import dot
from sgraph_core.graph import SGraph

__all__ = ["carried", "moved", "planes_of", "shifted"]

NEAR_M = 0.5
"""A corner of an outline follows the members that pass this close to it."""
STAY = 1e-3
"""Weight of the members' mean motion where no plane tells how a point moves."""


def moved(graph: SGraph, low: LowLayers, values: gtsam.Values, keys: Keys) -> SGraph:
    """Return an S-Graph with the poses and planes of a solution, and all that hangs on them.

    A surface is carried along by the keyframes that observed it (mean of where each would take its
    endpoints), then put onto its plane, so that it also moves lengthwise. Centres, outlines and
    thicknesses of nodes follow the planes of their members; see :class:`_Members`.
    """
    poses = np.array(
        [pose_row(values.atPose3(keys.keyframe(i))) for i in graph.keyframes.ids.tolist()]
    )
    segments, normals = _surfaces(graph, low, values, keys, poses)
    result = graph.moved(poses, segments, normals)
    for name, nodes in graph.concepts.items():
        if graph.groups.get(name, WALL_SURFACE) == WALL_SURFACE:
            result.concepts[name] = _followed(nodes, graph, result)
    return result


def shifted(graph: SGraph, by: FloatArray) -> SGraph:
    """Return an S-Graph whose keyframes, surfaces and nodes are moved by a vector, [3].

    Its grid, its truth and the heights of its surfaces stay where they are.
    """
    if not by.any():
        return graph
    poses = graph.keyframes.poses + np.array([*by, 0, 0, 0, 0])
    table = graph.wall_surfaces
    result = graph.moved(poses, table.segments + by[:2], table.normals)
    for name, nodes in graph.concepts.items():
        result.concepts[name] = [replace(node, shape=node.shape.shifted(by[:2])) for node in nodes]
    return result


def _surfaces(
    graph: SGraph, low: LowLayers, values: gtsam.Values, keys: Keys, poses: FloatArray
) -> tuple[FloatArray, FloatArray]:
    table = graph.wall_surfaces
    segments, normals = table.segments.copy(), table.normals.copy()
    observed = [row for row, i in enumerate(table.ids.tolist()) if i in low.observers]
    if observed:
        surfaces = table.ids[observed].tolist()
        counts = [len(low.observers[i]) for i in surfaces]
        seen = np.repeat(np.arange(len(surfaces)), counts)
        by = np.array([row for i in surfaces for row in low.observers[i]], np.int64)
        planes = planes_of(values, keys, surfaces)
        segments[observed], normals[observed] = carried(
            segments[observed], seen, by, graph.keyframes.poses, poses, planes
        )
    return segments, normals


def planes_of(values: gtsam.Values, keys: Keys, surfaces: Sequence[int]) -> FloatArray:
    """Return the planes that values hold of surfaces, nx, ny, nz, d, [N, 4]."""
    planes = [values.atOrientedPlane3(keys.surface(i)).planeCoefficients() for i in surfaces]
    return np.array(planes).reshape(-1, 4)


def carried(
    segments: FloatArray,
    seen: IntArray,
    by: IntArray,
    before: FloatArray,
    after: FloatArray,
    planes: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return segments as the keyframes that observed them carry them along, put onto their planes.

    Each keyframe takes a point rigidly from its old pose to its new one; the mean counts.

    Args:
        segments: of N surfaces, [N, 2, 2].
        seen: row of the surface of each of O observations, [O].
        by: row of the keyframe of each, [O].
        before: poses of K keyframes where the segments are right, [K, 7].
        after: the same keyframes' poses now, [K, 7].
        planes: where the surfaces belong, [N, 4].

    Returns:
        Segments [N, 2, 2] and normals [N, 2].
    """
    from scipy.spatial.transform import Rotation

    if not len(segments):
        return segments, planes[:, :2]
    turn = (Rotation.from_quat(after[:, 3:]) * Rotation.from_quat(before[:, 3:]).inv()).as_matrix()
    points = np.concatenate([segments, np.zeros((len(segments), 2, 1))], axis=2)[seen]
    taken = np.einsum("oij,opj->opi", turn[by], points - before[by, None, :3])
    taken += after[by, None, :3]
    total = np.zeros_like(segments)
    np.add.at(total, seen, taken[..., :2])
    mean = total / np.bincount(seen, minlength=len(segments))[:, None, None]
    size = np.linalg.norm(planes[:, :2], axis=1)
    normals, offsets = planes[:, :2] / size[:, None], planes[:, 3] / size
    off = (mean @ normals[:, :, None])[..., 0] + offsets[:, None]
    return np.asarray(mean - off[..., None] * normals[:, None]), np.asarray(normals)


def _followed(nodes: Sequence[ConceptNode], before: SGraph, after: SGraph) -> list[ConceptNode]:
    """Return nodes whose shapes have moved with their members.

    Attributes stay: only a plugin knows what they mean.
    """
    members = _Members(nodes, before, after)
    points, of, reach = _points_of(nodes)
    there = iter(zip(*members.take_along(points, of, reach).T.tolist(), strict=True))
    result = []
    for number, node in enumerate(nodes):
        shape = node.shape
        centre = None if shape.centre is None else next(there)
        thickness = shape.thickness
        if thickness is not None and centre is not None and len(node.members) == 2:
            thickness = members.thickness(number, centre)
        outer = None if shape.polygon is None else tuple(islice(there, len(shape.polygon)))
        holes = tuple(tuple(islice(there, len(hole))) for hole in shape.holes)
        moved = NodeShape(centre, outer, holes, thickness, shape.attributes)
        result.append(replace(node, shape=moved))
    return result


def _points_of(nodes: Sequence[ConceptNode]) -> tuple[FloatArray, IntArray, FloatArray]:
    """Return the centre and the corners of each node in turn, and how they hang on the members.

    Returns:
        Points [P, 2], the numbers of their nodes [P], and how close a member must come to matter
        [P]: any does for a centre.
    """
    points, of, reach = [], [], []
    for number, node in enumerate(nodes):
        centre = [] if node.shape.centre is None else [node.shape.centre]
        corners = [
            point for ring in (node.shape.polygon or (), *node.shape.holes) for point in ring
        ]
        points += [*centre, *corners]
        of += [number] * (len(centre) + len(corners))
        reach += [np.inf] * len(centre) + [NEAR_M] * len(corners)
    return np.array(points).reshape(-1, 2), np.array(of, np.int64), np.array(reach)


class _Members:
    """The members of nodes, before and after.

    A point of a node's shape keeps its distances from the planes around it, by least squares: a
    corner of an outline from the members near it, a centre from all members. The thickness between
    two members is measured anew at the centre.

    Args:
        nodes: whose members; surfaces.
        before, after: the S-Graph.
    """

    def __init__(self, nodes: Sequence[ConceptNode], before: SGraph, after: SGraph) -> None:
        self._counts = np.array([len(node.members) for node in nodes], np.int64)
        self._starts = np.cumsum(self._counts) - self._counts
        rows = [before.surface_row(member) for node in nodes for member in node.members]
        self._segments = before.wall_surfaces.segments[rows]
        self._normals = before.wall_surfaces.normals[rows]
        self._new_normals = after.wall_surfaces.normals[rows]
        self._middles = self._segments.mean(axis=1)
        self._new_middles = after.wall_surfaces.segments[rows].mean(axis=1)

    def take_along(self, points: FloatArray, of: IntArray, reach: FloatArray) -> FloatArray:
        """Return where points [P, 2] of nodes [P] go with the members that come this close [P]."""
        counts = self._counts[of]
        point = np.repeat(np.arange(len(points)), counts)
        first = np.cumsum(counts) - counts
        member = np.arange(len(point)) - (first - self._starts[of])[point]
        mean = _summed(point, self._new_middles[member] - self._middles[member], len(points))
        taken = points + mean / counts[:, None]
        normals = self._new_normals[member]
        before = dot(points[point] - self._middles[member], self._normals[member])
        after = dot(taken[point] - self._new_middles[member], normals)
        near = _distances(self._segments[member], points[point]) <= reach[point]
        left = np.where(near, after - before, 0.0)
        outer = normals[:, :, None] * normals[:, None] * near[:, None, None]
        weights = _summed(point, outer.reshape(-1, 4), len(points)).reshape(-1, 2, 2)
        right = _summed(point, left[:, None] * normals, len(points))
        shift = np.linalg.solve(weights + STAY * np.eye(2), right[:, :, None])[:, :, 0]
        return np.asarray(taken - shift)

    def thickness(self, node: int, point: tuple[float, float]) -> float:
        """Return how far the planes of a node's members lie behind a point, together."""
        rows = slice(self._starts[node], self._starts[node] + self._counts[node])
        in_front = dot(np.array(point) - self._new_middles[rows], self._new_normals[rows])
        return max(float(-in_front.sum()), 0.0)


def _summed(groups: IntArray, values: FloatArray, count: int) -> FloatArray:
    """Return the sums of values [Q, C] over groups [Q], [count, C]."""
    columns = [np.bincount(groups, column, minlength=count) for column in values.T]
    return np.stack(columns, axis=1)


def _distances(segments: FloatArray, points: FloatArray) -> FloatArray:
    """Return the distances of points from segments, pair by pair, [Q]."""
    along = segments[:, 1] - segments[:, 0]
    offset = points - segments[:, 0]
    share = np.clip(dot(offset, along) / dot(along, along), 0, 1)
    return np.asarray(np.linalg.norm(offset - share[:, None] * along, axis=1))
