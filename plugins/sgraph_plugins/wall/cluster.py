"""Walls from the scored relation *same wall*: each related pair that is physically possible."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from sgraph_concepts.types import Cluster, IntArray, Scene, ScoredEdges, SurfaceArrays
from sgraph_core.geometry import dot, lines_of
from sgraph_plugins.wall.geometry import back_to_back

__all__ = ["cluster"]

THICKEST_M = 0.55
LEAST_OVERLAP_M = 0.28
MOST_CROSSING_M = 0.05
"""How far noise may let the sides of a wall cross at one end."""


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
    """Return which walls have on both of their sides another wall in that half of them, [W].

    Where the cavity of a double wall is mapped, each leaf is a wall, and both together are none.

    Args:
        surfaces: of the scene.
        walls: pairs of rows, first below second, [W, 2].
    """
    hollow = np.zeros(len(walls), bool)
    # each side is of a leaf, too: few walls have two such sides
    maybe = np.flatnonzero((np.bincount(walls.ravel())[walls] > 1).all(axis=1))
    if not len(maybe):
        return hollow
    sides = np.unique(walls)
    tree = shapely.STRtree(lines_of(surfaces.segments[sides]))
    number = np.array([len(surfaces), 1])
    centres = back_to_back(surfaces, *walls[maybe].T).centres
    with_leaf = np.zeros((len(maybe), 2), bool)
    for end, side in enumerate(walls[maybe].T):
        normals = surfaces.normals[side]
        depths = dot(surfaces.midpoints[side] - centres, normals)
        halves = np.stack([centres, centres + depths[:, None] * normals], axis=1)
        wall, inside = tree.query(lines_of(halves), predicate="intersects")
        leaf = np.sort(np.stack([side[wall], sides[inside]], axis=1), axis=1)
        with_leaf[wall[np.isin(leaf @ number, walls @ number)], end] = True
    hollow[maybe] = with_leaf.all(axis=1)
    return hollow
