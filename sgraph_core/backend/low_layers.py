"""The low layers as factors: a prior, odometry, observed planes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import gtsam
import networkx as nx
import numpy as np

from sgraph_concepts.errors import OptimizationError
from sgraph_concepts.types import FloatArray
from sgraph_core.backend.keys import Keys
from sgraph_core.backend.visits import Visits
from sgraph_core.graph import SGraph

__all__ = ["LowLayers", "low_layers", "pose3", "world_planes"]

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
    _add_keyframes(graph, keys, factors, values)
    seen = _seen(graph, doubted)
    planes = world_planes(graph)
    for surface, of in sorted({(i, of) for i, of, _ in seen}):
        plane = planes[graph.surface_row(of)]
        values.insert(keys.surface(surface), gtsam.OrientedPlane3(*plane))
    _add_observations(graph, keys, [surface for surface, _, _ in seen], factors)
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


def _add_keyframes(
    graph: SGraph, keys: Keys, factors: gtsam.NonlinearFactorGraph, values: gtsam.Values
) -> None:
    table, motion = graph.keyframes, graph.odometry
    for keyframe, pose in zip(table.ids.tolist(), table.poses, strict=True):
        values.insert(keys.keyframe(keyframe), pose3(pose))
    hold = gtsam.noiseModel.Isotropic.Sigma(6, PRIOR_SIGMA)
    factors.add(
        gtsam.PriorFactorPose3(keys.keyframe(int(table.ids[0])), pose3(table.poses[0]), hold)
    )
    for one, two, pose, sigmas in zip(
        motion.from_ids.tolist(), motion.to_ids.tolist(), motion.poses, motion.sigmas, strict=True
    ):
        noise = gtsam.noiseModel.Diagonal.Sigmas(sigmas)
        factors.add(
            gtsam.BetweenFactorPose3(keys.keyframe(one), keys.keyframe(two), pose3(pose), noise)
        )


def _add_observations(
    graph: SGraph, keys: Keys, surfaces: Sequence[int], factors: gtsam.NonlinearFactorGraph
) -> None:
    table = graph.observations
    for surface, keyframe, plane, (angle, offset) in zip(
        surfaces,
        table.keyframe_ids.tolist(),
        table.planes,
        table.sigmas.tolist(),
        strict=True,
    ):
        noise = gtsam.noiseModel.Diagonal.Sigmas(np.array([angle, angle, offset]))
        measured = plane / np.linalg.norm(plane[:3])
        factors.add(
            gtsam.OrientedPlane3Factor(
                measured, noise, keys.keyframe(keyframe), keys.surface(surface)
            )
        )


def pose3(pose: FloatArray) -> gtsam.Pose3:
    """Return x, y, z, qx, qy, qz, qw as a gtsam pose."""
    x, y, z, qx, qy, qz, qw = pose.tolist()
    size = float(np.linalg.norm(pose[3:]))
    rotation = gtsam.Rot3.Quaternion(qw / size, qx / size, qy / size, qz / size)
    return gtsam.Pose3(rotation, np.array([x, y, z]))


def world_planes(graph: SGraph) -> FloatArray:
    """Return the vertical planes of the wall surfaces, nx, ny, 0, d with n.x + d = 0, [N, 4]."""
    table = graph.wall_surfaces
    offsets = -(table.normals * table.segments.mean(axis=1)).sum(axis=1)
    return np.column_stack([table.normals, np.zeros(len(offsets)), offsets])
