"""Walls from the scored relation *same wall*: each related pair that is physically possible."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from sgraph_concepts.types import Cluster, IntArray, Scene, ScoredEdges, SurfaceArrays
from sgraph_core.geometry import lines_of
from sgraph_plugins.wall.geometry import back_to_back

__all__ = ["cluster"]

THICKEST_M = 0.55
LEAST_OVERLAP_M = 0.28
MOST_CROSSING_M = 0.05
"""How far noise may let the sides of a wall cross at one end."""
CAVITY_AND_LEAF_M = 0.12
"""A side of a double wall's cavity is at least this far from the other leaf's outer side; pieces
of one side are closer, in spite of noise."""


def cluster(edges: ScoredEdges, scene: Scene) -> list[Cluster]:
    """Return a cluster per pair that is more likely a wall than not, and can be one."""
    likely = np.flatnonzero(edges.logits > 0)
    one, two = edges.pairs[likely].T
    lie = back_to_back(scene.surfaces, one, two)
    ends = lie.end_thicknesses
    possible = lie.physical(THICKEST_M, LEAST_OVERLAP_M)
    possible &= (ends.min(axis=1) > -MOST_CROSSING_M) & (ends.max(axis=1) <= THICKEST_M)
    walls = likely[possible]
    walls = walls[~_hollow(scene.surfaces, np.sort(edges.pairs[walls], axis=1))]
    return [
        Cluster((min(pair), max(pair)), confidence)
        for pair, confidence in zip(
            edges.pairs[walls].tolist(), edges.probabilities[walls].tolist(), strict=True
        )
    ]


def _hollow(surfaces: SurfaceArrays, walls: IntArray) -> NDArray[np.bool_]:
    """Return which walls have the other side of one of their sides' walls in them, [W].

    Where the cavity of a double wall is mapped, each leaf is a wall, and both together are none.

    Args:
        surfaces: of the scene.
        walls: pairs of rows, first below second, [W, 2].
    """
    sides = np.unique(walls)
    tree = shapely.STRtree(lines_of(surfaces.segments[sides]))
    number = np.array([len(surfaces), 1])
    hollow = np.zeros(len(walls), bool)
    for leaf, other in ((0, 1), (1, 0)):
        lie = back_to_back(surfaces, walls[:, leaf], walls[:, other])
        inwards = -surfaces.normals[walls[:, leaf]]
        depth = lie.thickness[:, None] / 2
        through = [
            lie.centres - depth * inwards,
            lie.centres + (depth - CAVITY_AND_LEAF_M) * inwards,
        ]
        wall, inside = tree.query(lines_of(np.stack(through, axis=1)), predicate="intersects")
        inner = np.sort(np.stack([walls[wall, leaf], sides[inside]], axis=1), axis=1)
        hollow[wall[np.isin(inner @ number, walls @ number)]] = True
    return hollow & (lie.thickness > CAVITY_AND_LEAF_M)
