"""An ISAM2 of our own: the low layers and the concepts' factors, added as they come."""

from __future__ import annotations

from dataclasses import fields
from typing import Any, TypeVar

import gtsam
import networkx as nx
import numpy as np

from sgraph_concepts.errors import OptimizationError
from sgraph_core.backend.failing import failing_as
from sgraph_core.backend.keys import Keys
from sgraph_core.backend.low_layers import add_odometry, add_poses, hold, vertical_planes
from sgraph_core.backend.sightings import add_observations, is_planar, plane_value
from sgraph_core.graph import SGraph
from sgraph_core.slam.update import Update

__all__ = ["Smoother"]

RELINEARIZE = 0.01
"""A variable is linearised anew when it has moved by more, in rad or m."""
FARTHEST_M = 1000.0
"""Where a drive may begin: how far turning moves a plane that is far from the origin ISAM2 notices
too late, and a few kilometres off its linear systems are singular."""

Rows = TypeVar("Rows")


class Smoother:
    """Optimises an S-Graph that grows.

    Args:
        keys: of the variables.
    """

    def __init__(self, keys: Keys) -> None:
        params = gtsam.ISAM2Params()
        params.setRelinearizeThreshold(RELINEARIZE)
        params.findUnusedFactorSlots = True
        self._isam = gtsam.ISAM2(params)
        self._keys = keys
        self._keyframes = self._odometry = self._observations = 0
        self._connected: set[int] = set()
        self._surfaces: set[int] = set()
        self._planar = True

    def check(self, graph: SGraph) -> None:
        """Check that odometry connects the new keyframes with the others.

        Raises:
            OptimizationError: it does not, there are no keyframes, or the first is over 1 km from
                the origin.
        """
        ids = graph.keyframes.ids[self._keyframes :].tolist()
        first = next(iter(self._connected), ids[0] if ids else None)
        if first is None:
            raise OptimizationError("there is nothing to optimise: the map has no keyframes")
        away = float(np.linalg.norm(graph.keyframes.poses[0, :3]))
        if not self._connected and away > FARTHEST_M:
            raise OptimizationError(
                f"keyframe {first} is {away:.0f} m from the origin: "
                f"a graph that a tracker optimises must begin within {FARTHEST_M:g} m of it"
            )
        links: nx.Graph[object] = nx.Graph()
        links.add_nodes_from([first, *ids])
        motions = _since(graph.odometry, self._odometry)
        for ends in zip(motions.from_ids.tolist(), motions.to_ids.tolist(), strict=True):
            links.add_edge(*(first if end in self._connected else end for end in ends))
        lost = sorted(set(ids) - nx.node_connected_component(links, first))
        if lost:
            raise OptimizationError(f"odometry does not connect keyframe {lost[0]} to the others")

    def add(self, graph: SGraph, update: Update, anew: bool = False) -> list[int]:
        """Add what is new in a graph that :meth:`check` accepts, and an update's factors.

        Args:
            graph: the low layers.
            update: what to add and to remove.
            anew: linearise anew all that has moved, which ISAM2 does by itself now and then.

        Returns:
            The indices of the update's factors.

        Raises:
            OptimizationError: the problem is under-determined.
        """
        factors, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        keyframes = _since(graph.keyframes, self._keyframes)
        add_poses(keyframes, self._keys, values)
        if not self._keyframes:
            factors.add(hold(int(keyframes.ids[0]), keyframes.poses[0], self._keys))
        motions = _since(graph.odometry, self._odometry)
        add_odometry(motions, self._keys, factors)
        seen = _since(graph.observations, self._observations)
        self._planar &= is_planar(keyframes, motions, seen)
        surfaces = sorted(set(seen.surface_ids.tolist()) - self._surfaces)
        rows = np.array([graph.surface_row(i) for i in surfaces], np.int64)
        planes = vertical_planes(
            graph.wall_surfaces.segments[rows], graph.wall_surfaces.normals[rows]
        )
        for surface, plane in zip(surfaces, planes, strict=True):
            values.insert(self._keys.surface(surface), plane=plane_value(plane))
        add_observations(seen, self._planar, self._keys, factors)
        own = factors.size()
        factors.push_back(update.factors)
        indices = self._solve(factors, values, update, anew)
        self._keyframes, self._odometry = len(graph.keyframes.ids), len(graph.odometry.poses)
        self._observations = len(graph.observations.planes)
        self._connected.update(keyframes.ids.tolist())
        self._surfaces.update(surfaces)
        return indices[own:]

    @property
    def values(self) -> gtsam.Values:
        """The solution so far."""
        return self._isam.calculateEstimate()

    def _solve(
        self,
        factors: gtsam.NonlinearFactorGraph,
        values: gtsam.Values,
        update: Update,
        anew: bool,
    ) -> list[int]:
        params = gtsam.ISAM2UpdateParams()
        params.force_relinearize = anew
        params.removeFactorIndices = update.remove
        with failing_as("the factor graph cannot be solved"):
            values.insert(update.values)
            result = self._isam.update(factors, values, params)
        return list(result.getNewFactorsIndices())


def _since(table: Rows, first: int) -> Rows:
    """Return the rows of a table from one on."""
    columns: dict[str, Any] = {
        column.name: getattr(table, column.name)[first:]
        for column in fields(table)  # type: ignore[arg-type]
    }
    return type(table)(**columns)
