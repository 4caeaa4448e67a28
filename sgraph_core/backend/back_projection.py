"""What a solution moves: keyframes, surfaces, and the shapes of the nodes above them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import gtsam
import numpy as np

from sgraph_concepts.spec import WALL_SURFACE
from sgraph_concepts.types import ConceptNode, FloatArray, IntArray, NodeShape
from sgraph_core.backend.keys import Keys
from sgraph_core.backend.low_layers import LowLayers, pose3
from sgraph_core.geometry import dot
from sgraph_core.graph import SGraph

__all__ = ["moved"]

NEAR_M = 0.5
"""A corner of an outline follows the members that pass this close to it."""
STAY = 1e-3
"""Weight of the members' mean motion where no plane tells how a point moves."""


def moved(graph: SGraph, low: LowLayers, values: gtsam.Values, keys: Keys) -> SGraph:
    """Return an S-Graph with the poses and planes of a solution, and all that hangs on them.

    A surface is carried along by the keyframes that observed it (mean of where each would take its
    endpoints), then put onto its plane, so that it also moves lengthwise. Centres, outlines and
    thicknesses of nodes follow the planes of their members; see :func:`_followed`.
    """
    table = graph.keyframes
    solved = [values.atPose3(keys.keyframe(i)) for i in table.ids.tolist()]
    before = [pose3(pose) for pose in table.poses]
    moves = [new.compose(old.inverse()) for new, old in zip(solved, before, strict=True)]
    segments, normals = _surfaces(graph, low, values, keys, moves)
    poses = np.array([_pose_row(pose) for pose in solved])
    result = graph.moved(poses, segments, normals)
    for name, nodes in graph.concepts.items():
        if graph.groups.get(name, WALL_SURFACE) == WALL_SURFACE:
            result.concepts[name] = [_followed(node, graph, result) for node in nodes]
    return result


def _surfaces(
    graph: SGraph,
    low: LowLayers,
    values: gtsam.Values,
    keys: Keys,
    moves: Sequence[gtsam.Pose3],
) -> tuple[FloatArray, FloatArray]:
    matrices = np.array([move.matrix()[:2] for move in moves])
    segments = graph.wall_surfaces.segments.copy()
    normals = graph.wall_surfaces.normals.copy()
    for row, surface in enumerate(graph.wall_surfaces.ids.tolist()):
        if surface not in low.observers:
            continue
        rows = list(low.observers[surface])
        mean = matrices[rows].mean(axis=0)
        carried = segments[row] @ mean[:, :2].T + mean[:, 3]
        plane = values.atOrientedPlane3(keys.surface(surface)).planeCoefficients()
        size = np.linalg.norm(plane[:2])
        normals[row], offset = plane[:2] / size, plane[3] / size
        segments[row] = carried - np.outer(carried @ normals[row] + offset, normals[row])
    return segments, normals


def _followed(node: ConceptNode, before: SGraph, after: SGraph) -> ConceptNode:
    """Return a node whose shape has moved with its members.

    A point keeps its distances from the planes around it, by least squares: a corner of an outline
    from the members near it, a centre from all members. The thickness between two members is
    measured anew at the centre. Attributes stay: only a plugin knows what they mean.
    """
    rows = np.array([before.surface_row(member) for member in node.members], np.int64)
    follow = _Members(before, after, rows)
    shape = node.shape
    centre = None if shape.centre is None else follow.ring([shape.centre], np.inf)[0]
    thickness = shape.thickness
    if thickness is not None and centre is not None and len(node.members) == 2:
        thickness = follow.thickness(np.array(centre))
    return replace(
        node,
        shape=NodeShape(
            centre,
            None if shape.polygon is None else follow.ring(shape.polygon, NEAR_M),
            tuple(follow.ring(hole, NEAR_M) for hole in shape.holes),
            thickness,
            shape.attributes,
        ),
    )


class _Members:
    """The members of a node, before and after.

    Args:
        before, after: the S-Graph.
        rows: of the members' surfaces.
    """

    def __init__(self, before: SGraph, after: SGraph, rows: IntArray) -> None:
        self._segments = before.wall_surfaces.segments[rows]
        self._normals = before.wall_surfaces.normals[rows]
        self._new_segments = after.wall_surfaces.segments[rows]
        self._new_normals = after.wall_surfaces.normals[rows]
        self._mean = (self._new_segments - self._segments).mean(axis=(0, 1))

    def ring(
        self, points: Sequence[tuple[float, float]], near_m: float
    ) -> tuple[tuple[float, float], ...]:
        """Return points moved with the members that come this close to them."""
        old = np.array(points)
        near = _distances(self._segments, old) <= near_m
        left = np.where(near, self._approach(old), 0.0)
        outer = self._new_normals[:, :, None] * self._new_normals[:, None]
        weights = np.einsum("vm,mij->vij", near.astype(np.float64), outer) + STAY * np.eye(2)
        shift = np.linalg.solve(weights, (left @ self._new_normals)[:, :, None])[:, :, 0]
        return tuple((x, y) for x, y in (old + self._mean - shift).tolist())

    def thickness(self, point: FloatArray) -> float:
        """Return how far the members' planes lie behind a point between them, together."""
        in_front = dot(point - self._new_segments.mean(axis=1), self._new_normals)
        return max(float(-in_front.sum()), 0.0)

    def _approach(self, points: FloatArray) -> FloatArray:
        """Return how much points [V, 2], moved with the mean, come before each plane, [V, M]."""
        before = points[:, None] - self._segments.mean(axis=1)
        after = points[:, None] + self._mean - self._new_segments.mean(axis=1)
        return dot(after, self._new_normals) - dot(before, self._normals)


def _distances(segments: FloatArray, points: FloatArray) -> FloatArray:
    """Return the distances of points [V, 2] from segments, [V, M]."""
    along = segments[:, 1] - segments[:, 0]
    offset = points[:, None] - segments[:, 0]
    share = np.clip(dot(offset, along) / dot(along, along), 0, 1)
    return np.asarray(np.linalg.norm(offset - share[:, :, None] * along, axis=2))


def _pose_row(pose: gtsam.Pose3) -> list[float]:
    quaternion: Any = pose.rotation().toQuaternion()  # gtsam's stubs know nothing of it
    return [
        *pose.translation().tolist(),
        quaternion.x(),
        quaternion.y(),
        quaternion.z(),
        quaternion.w(),
    ]
