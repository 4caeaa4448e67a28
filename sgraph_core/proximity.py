"""Which surfaces are worth relating: the paper's neighbours, chosen by visibility and distance.

The paper links each surface to the 15 nearest centroids. In real buildings most of these lie in
other rooms while the far end of a corridor is missed; here a surface is linked to the nearest
surfaces that it sees, and to everything that comes close to it (the other sides of its walls).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sgraph_concepts.types import FloatArray, IntArray, OccupancyGrid, Scene, SurfaceArrays
from sgraph_core.geometry import close_together, closest_distances, unique_pairs
from sgraph_core.visibility import facing_pairs, visibility

__all__ = ["CLOSE_M", "FACING", "Neighbours", "build_scene", "worth_relating"]

Neighbours = Literal["visible", "nearest"]
"""``visible``: ours. ``nearest``: the paper's, by the distance of midpoints."""

FACING = 24
"""Of how many of the nearest facing surfaces each surface is linked to those that it sees."""
CLOSE_M = 0.7
"""Surfaces this close are linked in any case: the thickest walls are thinner."""
NEAREST = 15
"""How many of the nearest surfaces the paper links each surface to."""


def build_scene(
    surfaces: SurfaceArrays,
    neighbours: Neighbours = "visible",
    grid: OccupancyGrid | None = None,
) -> Scene:
    """Return the pairs of surfaces worth relating, with their distances and visibilities.

    Args:
        surfaces: the N preprocessed surfaces in world coordinates.
        neighbours: which pairs are worth relating.
        grid: what the surfaces were extracted from, in world coordinates.

    Returns:
        The scene, its coordinates relative to the middle of the map, so that the position of the
        map in the world (UTM coordinates, say) costs no precision.
    """
    if not len(surfaces):
        return _scene(surfaces, np.zeros(2), np.empty((0, 2), np.int64), grid)
    corners = surfaces.segments.reshape(-1, 2)
    origin = (corners.min(axis=0) + corners.max(axis=0)) / 2
    local = SurfaceArrays(surfaces.ids, surfaces.segments - origin, surfaces.normals)
    if neighbours == "nearest":
        return _scene(local, origin, _nearest_pairs(local), grid)
    one, two = np.concatenate([facing_pairs(local, FACING), _close_pairs(local)]).T
    scene = _scene(local, origin, unique_pairs(one, two), grid)
    worth = worth_relating(scene.distances, scene.visibility)
    return replace(
        scene,
        pairs=scene.pairs[worth],
        distances=scene.distances[worth],
        visibility=scene.visibility[worth],
    )


def worth_relating(distances: FloatArray, visibility: FloatArray) -> NDArray[np.bool_]:
    """Return which pairs are close or see each other, [E]."""
    return np.asarray((distances <= CLOSE_M) | (visibility[:, 0] > 0))


def _scene(
    surfaces: SurfaceArrays, origin: FloatArray, pairs: IntArray, grid: OccupancyGrid | None
) -> Scene:
    distances = closest_distances(surfaces.segments, pairs[:, 0], pairs[:, 1])
    local_grid = None if grid is None else grid.shifted(-origin)
    visible = visibility(surfaces, pairs)
    return Scene(surfaces, origin, pairs, distances, visible, grid=local_grid)


def _nearest_pairs(surfaces: SurfaceArrays) -> IntArray:
    """Return the pairs of which one is among the nearest midpoints of the other, [P, 2]."""
    from scipy.spatial import cKDTree

    total = len(surfaces)
    count = min(NEAREST + 1, total)  # the nearest is the surface itself
    _, near = cKDTree(surfaces.midpoints).query(surfaces.midpoints, k=range(1, count + 1))
    pairs = np.stack([np.repeat(np.arange(total), count), near.ravel()], axis=1)
    return np.unique(np.sort(pairs[pairs[:, 0] != pairs[:, 1]], axis=1), axis=0)


def _close_pairs(surfaces: SurfaceArrays) -> IntArray:
    one, two = close_together(surfaces.segments, surfaces.segments, CLOSE_M)
    pairs: IntArray = np.stack([one, two], axis=1)[one < two]
    return pairs
