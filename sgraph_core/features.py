"""The numbers the network sees, in each edge's own frame.

The paper's initial features are the width and absolute normal of a node, and the centroid offset
and closest distance of an edge. Absolute normals and offsets turn with the map; here every edge
(i, j) is described in the frame of surface i, so that moving or turning the map changes nothing.
Endpoints are ordered by the normal (see SurfaceArrays), since their order in the input would
tell a network how a generator draws rooms.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sgraph_concepts.types import FloatArray, Scene
from sgraph_core.geometry import cross, dot, in_frames

__all__ = ["EDGE_FEATURES", "NODE_FEATURES", "edge_features", "edge_index", "node_features"]

Float32Array = NDArray[np.float32]

NODE_FEATURES = (
    "log length",
    "log 1 + number of visible surfaces",
    "log 1 + summed visibility",
    "log 1 + summed visibility with doors closed",
    "log 1 + summed visibility with gaps up to 6 m closed",
)
EDGE_FEATURES = (
    "x of j's midpoint",
    "y of j's midpoint",
    "cosine of the angle between the surfaces",
    "sine of the angle between the surfaces",
    "closest distance",
    "overlap along i",
    "y of j's first end",
    "y of j's second end",
    "lower y of j's ends",
    "higher y of j's ends",
    "distance from i's second end to j's first",
    "distance from i's first end to j's second",
    "log length of i",
    "log length of j",
    "visibility",
    "visibility, gaps up to 1.4 m closed",
    "visibility, gaps up to 3 m closed",
    "visibility, gaps up to 6 m closed",
    "square root of the visibility",
    "square root of the visibility, gaps up to 1.4 m closed",
    "square root of the visibility, gaps up to 3 m closed",
    "square root of the visibility, gaps up to 6 m closed",
)


def edge_index(scene: Scene) -> NDArray[np.int64]:
    """Return the scene's pairs in both directions, [2, 2E]: row 0 is j, row 1 is i.

    As in torch-geometric, messages go from row 0 to row 1. Edge e + E is edge e reversed.
    """
    one, two = scene.pairs.T
    return np.stack([np.concatenate([two, one]), np.concatenate([one, two])])


def node_features(scene: Scene) -> Float32Array:
    """Return the features of the nodes, [N, len(NODE_FEATURES)]."""
    total, ends = len(scene.surfaces), scene.pairs.T.ravel()

    def summed(weights: FloatArray) -> FloatArray:
        return np.asarray(np.bincount(ends, np.tile(weights, 2), minlength=total), np.float64)

    seen = scene.visibility
    columns = [
        np.log(scene.surfaces.lengths),
        np.log1p(summed((seen[:, 0] > 0).astype(np.float64))),
        np.log1p(summed(seen[:, 0])),
        np.log1p(summed(seen[:, 1])),
        np.log1p(summed(seen[:, -1])),
    ]
    return np.stack(columns, axis=1).astype(np.float32)


def edge_features(scene: Scene) -> Float32Array:
    """Return the features of the edges in both directions, [2E, len(EDGE_FEATURES)]."""
    surfaces = scene.surfaces
    j, i = edge_index(scene)
    x, y = in_frames(surfaces, i, surfaces.segments[j])
    half = surfaces.lengths[i] / 2
    overlap = np.minimum(x.max(axis=1), half) - np.maximum(x.min(axis=1), -half)
    tangent, log_length = surfaces.tangents[i], np.log(surfaces.lengths)
    first, second = surfaces.segments[:, 0], surfaces.segments[:, 1]
    seen = np.tile(scene.visibility, (2, 1))
    columns = [
        _compress(x.mean(axis=1), 1.0),
        _compress(y.mean(axis=1), 1.0),
        dot(tangent, surfaces.tangents[j]),
        cross(tangent, surfaces.tangents[j]),
        _compress(np.tile(scene.distances, 2), 0.2),
        _compress(overlap, 0.3),
        _compress(y[:, 0], 0.3),
        _compress(y[:, 1], 0.3),
        _compress(y.min(axis=1), 0.2),
        _compress(y.max(axis=1), 0.2),
        _compress(np.linalg.norm(second[i] - first[j], axis=1), 0.2),
        _compress(np.linalg.norm(first[i] - second[j], axis=1), 0.2),
        log_length[i],
        log_length[j],
    ]
    return np.column_stack([*columns, seen, np.sqrt(seen)]).astype(np.float32)


def _compress(length_m: FloatArray, scale_m: float) -> FloatArray:
    """Keep small lengths as they are and take the logarithm of large ones, sign kept."""
    return np.asarray(np.sign(length_m) * np.log1p(np.abs(length_m) / scale_m))
