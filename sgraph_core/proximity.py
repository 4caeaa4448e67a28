"""Which surfaces are worth relating: the paper's neighbours, chosen by visibility and distance.

The paper links each surface to the 15 nearest centroids. In real buildings most of these lie in
other rooms while the far end of a corridor is missed; here a surface is linked to the nearest
surfaces that it sees, and to everything that comes close to it (the other sides of its walls).
"""

from __future__ import annotations

import numpy as np
import shapely

from sgraph_concepts.types import FloatArray, IntArray, Scene, SurfaceArrays
from sgraph_core.geometry import closest_distances, lines_of
from sgraph_core.visibility import CLOSED_GAPS_M, facing_pairs, nearest, visibility

__all__ = ["build_scene"]

FACING = 32
"""How many of the nearest facing surfaces are tested for visibility."""
VISIBLE = 30
"""How many of the nearest visible surfaces each surface is linked to."""
CLOSE_M = 0.7
"""Surfaces this close are linked in any case: the thickest walls are thinner."""


def build_scene(surfaces: SurfaceArrays) -> Scene:
    """Return the pairs of surfaces worth relating, with their distances and visibilities.

    Args:
        surfaces: the N preprocessed surfaces in world coordinates.

    Returns:
        The scene, its coordinates relative to the middle of the map, so that the position of the
        map in the world (UTM coordinates, say) costs no precision.
    """
    if not len(surfaces):
        return _scene(surfaces, np.zeros(2), np.empty((0, 2), np.int64), np.empty(0))
    corners = surfaces.segments.reshape(-1, 2)
    origin = (corners.min(axis=0) + corners.max(axis=0)) / 2
    local = SurfaceArrays(surfaces.ids, surfaces.segments - origin, surfaces.normals)
    pairs = np.concatenate([facing_pairs(local, FACING), _close_pairs(local)])
    pairs = np.unique(pairs, axis=0)
    distances = closest_distances(local.segments, pairs[:, 0], pairs[:, 1])
    return _scene(local, origin, pairs, distances)


def _scene(
    surfaces: SurfaceArrays, origin: FloatArray, pairs: IntArray, distances: FloatArray
) -> Scene:
    if not len(pairs):
        shares = np.empty((0, 1 + len(CLOSED_GAPS_M)))
        return Scene(surfaces, origin, pairs, distances, shares)
    shares = visibility(surfaces, pairs)
    chosen = distances <= CLOSE_M
    visible = np.flatnonzero(shares[:, 0] > 0)
    asking = np.concatenate([pairs[visible, 0], pairs[visible, 1]])
    asked_for = nearest(asking, np.tile(distances[visible], 2), VISIBLE)
    chosen[visible] |= asked_for.reshape(2, -1).any(axis=0)
    return Scene(surfaces, origin, pairs[chosen], distances[chosen], shares[chosen])


def _close_pairs(surfaces: SurfaceArrays) -> IntArray:
    lines = lines_of(surfaces.segments)
    one, two = shapely.STRtree(lines).query(lines, predicate="dwithin", distance=CLOSE_M)
    pairs: IntArray = np.stack([one, two], axis=1)[one < two]
    return pairs
