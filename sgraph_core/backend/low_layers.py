"""The low layers as factors: a prior, odometry, observed planes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import gtsam
import networkx as nx
import numpy as np

from sgraph_concepts.errors import OptimizationError
from sgraph_concepts.types import FloatArray
from sgraph_core.backend.keys import Keys
from sgraph_core.backend.sightings import add_observations, is_planar, plane_value
from sgraph_core.backend.visits import Visits
from sgraph_core.graph import SGraph
from sgraph_core.tables import Keyframes, Odometry

__all__ = [
    "LowLayers",
    "add_odometry",
    "add_poses",
    "hold",
    "low_layers",
    "pose3",
    "pose_row",
    "vertical_planes",
    "world_planes",
]

PRIOR_SIGMA = 1e-5
"""Of the first keyframe, rad and m: it holds the map in place."""


@dataclass(frozen=True, eq=False)
class LowLayers:
    """Keyframes, odometry and observations in gtsam's terms.

    Attributes:
        graph: a prior on the first keyframe, odometry, observations.
        values: the S-Graph's poses and planes.
        observers: rows of the keyframes that observed each surface, by the id of every surface that
            has a plane variable.
    """

    graph: gtsam.NonlinearFactorGraph
    values: gtsam.Values
    observers: Mapping[int, Sequence[int]]

    @property
    def surfaces(self) -> list[int]:
        """Ids of the surfaces that have a plane variable: the observed ones."""
        return list(self.observers)


def low_layers(
    graph: SGraph,
    keys: Keys | None = None,
    doubted: Mapping[tuple[int, int], int] = MappingProxyType({}),
) -> LowLayers:
    """Return the low layers of an S-Graph as a factor graph.

    Args:
        graph: the S-Graph.
        keys: the keys of keyframes and surfaces.
        doubted: later visits, by surface id and row of the first keyframe, that may have seen
            another surface: their observations get a plane of their own, under the key of the new
            surface id that is given for each.

    Raises:
        OptimizationError: there are no keyframes or observations, or odometry does not connect
            all keyframes.
    """
    keys = keys or Keys()
    _require_connected(graph)
    factors, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    add_poses(graph.keyframes, keys, values)
    factors.add(hold(int(graph.keyframes.ids[0]), graph.keyframes.poses[0], keys))
    add_odometry(graph.odometry, keys, factors)
    seen = _seen(graph, doubted)
    planes = world_planes(graph)
    for surface, of in sorted({(i, of) for i, of, _ in seen}):
        plane = planes[graph.surface_row(of)]
        # by its name, gtsam finds the overload for planes in a third of the time
        values.insert(keys.surface(surface), plane=plane_value(plane))
    renamed = np.array([surface for surface, _, _ in seen], np.int64)
    seen_as = replace(graph.observations, surface_ids=renamed)
    planar = is_planar(graph.keyframes, graph.odometry, graph.observations)
    add_observations(seen_as, planar, keys, factors)
    observers: dict[int, list[int]] = {}
    for surface, _, row in sorted(seen):
        observers.setdefault(surface, []).append(row)
    return LowLayers(factors, values, observers)


def _seen(graph: SGraph, doubted: Mapping[tuple[int, int], int]) -> list[tuple[int, int, int]]:
    """Return of each observation the plane's surface id, the id it came with, and its keyframe."""
    table = graph.observations
    ids = table.surface_ids.tolist()
    rows = [graph.keyframe_row(i) for i in table.keyframe_ids.tolist()]
    if not doubted:
        return [(surface, surface, row) for surface, row in zip(ids, rows, strict=True)]
    visits, other = Visits(graph), {}
    for (surface, start), new in doubted.items():
        first, last = next(visit for visit in visits.visits(surface) if visit[0] == start)
        other.update({(surface, row): new for row in range(first, last + 1)})
    return [
        (other.get((surface, row), surface), surface, row)
        for surface, row in zip(ids, rows, strict=True)
    ]


def _require_connected(graph: SGraph) -> None:
    keyframes = graph.keyframes.ids.tolist()
    if not keyframes or not len(graph.observations.planes):
        raise OptimizationError(
            "there is nothing to optimise: the map has "
            f"{len(keyframes)} keyframes and {len(graph.observations.planes)} observations"
        )
    links: nx.Graph[object] = nx.Graph()
    links.add_nodes_from(keyframes)
    table = graph.odometry
    links.add_edges_from(zip(table.from_ids.tolist(), table.to_ids.tolist(), strict=True))
    lost = sorted(set(keyframes) - nx.node_connected_component(links, keyframes[0]))
    if lost:
        raise OptimizationError(
            f"odometry does not connect keyframe {lost[0]} to keyframe {keyframes[0]}"
            + (f" (nor {len(lost) - 1} others)" if len(lost) > 1 else "")
        )


def add_poses(table: Keyframes, keys: Keys, values: gtsam.Values) -> None:
    """Add the variables of keyframes."""
    for keyframe, pose in zip(table.ids.tolist(), table.poses, strict=True):
        values.insert(keys.keyframe(keyframe), pose3=pose3(pose))


def hold(keyframe: int, pose: FloatArray, keys: Keys) -> gtsam.PriorFactorPose3:
    """Return the prior that holds the map in place by its first keyframe."""
    noise = gtsam.noiseModel.Isotropic.Sigma(6, PRIOR_SIGMA)
    return gtsam.PriorFactorPose3(keys.keyframe(keyframe), pose3(pose), noise)


def add_odometry(table: Odometry, keys: Keys, factors: gtsam.NonlinearFactorGraph) -> None:
    """Add the factors of motions."""
    for one, two, pose, sigmas in zip(
        table.from_ids.tolist(), table.to_ids.tolist(), table.poses, table.sigmas, strict=True
    ):
        noise = gtsam.noiseModel.Diagonal.Sigmas(sigmas)
        factors.add(
            gtsam.BetweenFactorPose3(keys.keyframe(one), keys.keyframe(two), pose3(pose), noise)
        )


def pose3(pose: FloatArray) -> gtsam.Pose3:
    """Return x, y, z, qx, qy, qz, qw as a gtsam pose."""
    x, y, z, qx, qy, qz, qw = pose.tolist()
    size = float(np.linalg.norm(pose[3:]))
    rotation = gtsam.Rot3.Quaternion(qw / size, qx / size, qy / size, qz / size)
    return gtsam.Pose3(rotation, np.array([x, y, z]))


def pose_row(pose: gtsam.Pose3) -> list[float]:
    """Return a gtsam pose as x, y, z, qx, qy, qz, qw."""
    quaternion: Any = pose.rotation().toQuaternion()  # gtsam's stubs know nothing of it
    return [
        *pose.translation().tolist(),
        quaternion.x(),
        quaternion.y(),
        quaternion.z(),
        quaternion.w(),
    ]


def world_planes(graph: SGraph) -> FloatArray:
    """Return the vertical planes of the wall surfaces, nx, ny, 0, d with n.x + d = 0, [N, 4]."""
    return vertical_planes(graph.wall_surfaces.segments, graph.wall_surfaces.normals)


def vertical_planes(segments: FloatArray, normals: FloatArray) -> FloatArray:
    """Return the vertical planes through segments [N, 2, 2] with normals [N, 2], [N, 4]."""
    offsets = -(normals * segments.mean(axis=1)).sum(axis=1)
    return np.column_stack([normals, np.zeros(len(offsets)), offsets])
