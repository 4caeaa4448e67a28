"""Same wall without learning: antiparallel, back to back, close, overlapping, nothing between."""

from __future__ import annotations

import numpy as np
import shapely

from sgraph_concepts.types import FloatArray, IntArray, Scene
from sgraph_core.geometry import lines_of
from sgraph_plugins.wall.geometry import back_to_back

__all__ = ["score"]

THICKEST_M = 0.6
LEAST_OVERLAP_M = 0.3
SURE_LOGIT = 4.0
"""The rule says yes or no; it is right about 98 times in 100 (docs/results.md)."""


def score(scene: Scene) -> FloatArray:
    """Return the log-odds of the pairs, [E]."""
    one, two = scene.pairs.T
    lie = back_to_back(scene.surfaces, one, two)
    is_wall = lie.physical(THICKEST_M, LEAST_OVERLAP_M)
    rows = np.flatnonzero(is_wall)
    is_wall[rows] = ~_something_between(scene, scene.pairs[rows], lie.centres[rows])
    return np.where(is_wall, SURE_LOGIT, -SURE_LOGIT)


def _something_between(scene: Scene, pairs: IntArray, centres: FloatArray) -> np.ndarray:
    """Return whether the line across the wall body at its centre meets a third surface, [P]."""
    normals = scene.surfaces.normals
    axis = normals[pairs[:, 0]] - normals[pairs[:, 1]]
    axis /= np.linalg.norm(axis, axis=1)[:, None]
    across = np.stack([centres - axis * THICKEST_M, centres + axis * THICKEST_M], axis=1)
    lines = lines_of(scene.surfaces.segments)
    bodies = shapely.intersection(lines_of(across), _bodies(lines[pairs[:, 0]], lines[pairs[:, 1]]))
    pair, other = shapely.STRtree(lines).query(bodies, predicate="intersects")
    third = (other != pairs[pair, 0]) & (other != pairs[pair, 1])
    between = np.zeros(len(pairs), bool)
    between[pair[third]] = True
    return between


def _bodies(one: np.ndarray, two: np.ndarray) -> np.ndarray:
    return np.asarray(shapely.convex_hull(shapely.union(one, two)))
