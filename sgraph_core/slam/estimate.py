"""Where an optimiser's values put the keyframes and wall surfaces of an S-Graph."""

from __future__ import annotations

from typing import Any

import gtsam
import numpy as np
from numpy.typing import ArrayLike

from sgraph_concepts.types import FloatArray, IntArray
from sgraph_core.backend.keys import Keys
from sgraph_core.graph import SGraph

__all__ = ["Moves", "moves"]

Moves = tuple[dict[int, ArrayLike], dict[int, tuple[ArrayLike, ArrayLike]]]
"""Poses of keyframes, segments and normals of surfaces, by id, as SGraph.move takes them."""


def moves(graph: SGraph, keys: Keys, values: gtsam.Values) -> Moves:
    """Return where values put the keyframes and the observed surfaces that they hold.

    A surface is carried along by the keyframes that observed it (the mean of where each takes its
    ends), then put onto its plane, so that it also moves lengthwise.

    Args:
        graph: where they were before.
        keys: of the values.
        values: Pose3 of keyframes, OrientedPlane3 of surfaces.
    """
    table = graph.keyframes
    poses = table.poses.copy()
    held = [k for k, i in enumerate(table.ids.tolist()) if values.exists(keys.keyframe(i))]
    for k in held:
        poses[k] = _pose_row(values.atPose3(keys.keyframe(int(table.ids[k]))))
    observed = np.unique(graph.observations.surface_ids)
    there = [values.exists(keys.surface(i)) for i in observed.tolist()]
    surfaces = observed[np.array(there, bool)]
    planes = np.array(
        [values.atOrientedPlane3(keys.surface(i)).planeCoefficients() for i in surfaces.tolist()]
    ).reshape(-1, 4)
    size = np.linalg.norm(planes[:, :2], axis=1)
    normals, offsets = planes[:, :2] / size[:, None], planes[:, 3] / size
    segments = _carried(graph, poses, surfaces)
    off = (segments @ normals[:, :, None])[..., 0] + offsets[:, None]
    segments = segments - off[..., None] * normals[:, None]
    moved = zip(surfaces.tolist(), segments, normals, strict=True)
    return (
        {int(table.ids[k]): poses[k] for k in held},
        {surface: (segment, normal) for surface, segment, normal in moved},
    )


def _carried(graph: SGraph, poses: FloatArray, surfaces: IntArray) -> FloatArray:
    """Return surfaces' segments as the keyframes that observed them carry them along, [N, 2, 2].

    Each keyframe takes a point rigidly from its old pose to its new one; the mean counts.
    """
    from scipy.spatial.transform import Rotation

    before = graph.keyframes.poses
    turn = (Rotation.from_quat(poses[:, 3:]) * Rotation.from_quat(before[:, 3:]).inv()).as_matrix()
    seen = graph.observations
    rows = np.isin(seen.surface_ids, surfaces)
    place = np.searchsorted(surfaces, seen.surface_ids[rows])
    order = np.argsort(graph.keyframes.ids)
    by = order[np.searchsorted(graph.keyframes.ids, seen.keyframe_ids[rows], sorter=order)]
    segments = graph.wall_surfaces.segments[[graph.surface_row(i) for i in surfaces.tolist()]]
    points = np.concatenate([segments, np.zeros((len(segments), 2, 1))], axis=2)[place]
    taken = np.einsum("oij,opj->opi", turn[by], points - before[by, None, :3])
    taken += poses[by, None, :3]
    total = np.zeros_like(segments)
    np.add.at(total, place, taken[..., :2])
    return np.asarray(total / np.bincount(place, minlength=len(segments))[:, None, None])


def _pose_row(pose: gtsam.Pose3) -> list[float]:
    quaternion: Any = pose.rotation().toQuaternion()  # gtsam's stubs know nothing of it
    return [
        *pose.translation().tolist(),
        quaternion.x(),
        quaternion.y(),
        quaternion.z(),
        quaternion.w(),
    ]
