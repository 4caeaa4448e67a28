"""The numbers the network sees, in each edge's own frame.

The paper's initial features are the width and absolute normal of a node, and the centroid offset
and closest distance of an edge. Absolute normals and offsets turn with the map; here every edge
(i, j) is described in the frame of surface i, so that moving or turning the map changes nothing.
Endpoints are ordered by the normal (see SurfaceArrays), since their order in the input would
tell a network how a generator draws rooms.

Further sets of features exist to measure what ours bring: the paper's, the paper's in each edge's
own frame, and ours in part.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sgraph_concepts.types import FloatArray, IntArray, Scene
from sgraph_core.geometry import cross, dot, in_frames
from sgraph_core.support import SUPPORT, support
from sgraph_core.visibility import CLOSED_GAPS_M, VISIBILITIES

__all__ = [
    "EDGE_FEATURES",
    "NODE_FEATURES",
    "FeatureSet",
    "edge_features",
    "edge_index",
    "node_features",
]

Float32Array = NDArray[np.float32]

FeatureSet = Literal["support", "visibility", "frame", "paper"]
"""``support``: ours. ``visibility``: ours without what the building has in common with a surface.
``paper``: the paper's, which turn with the map. ``frame``: what the paper's say, in each edge's own
frame."""

CLOSED_COLUMNS = (1, len(CLOSED_GAPS_M))
"""Columns of the visibility with doors closed, and with the widest gaps closed."""
_VISIBILITY_NODES = (
    "log length",
    "log 1 + number of visible surfaces",
    "log 1 + summed visibility",
    *(f"log 1 + summed {VISIBILITIES[column]}" for column in CLOSED_COLUMNS),
)
_VISIBILITY_EDGES = (
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
    *VISIBILITIES,
    *(f"square root of the {name}" for name in VISIBILITIES),
)
NODE_FEATURES: Mapping[FeatureSet, tuple[str, ...]] = MappingProxyType(
    {
        "support": (*_VISIBILITY_NODES, *SUPPORT),
        "visibility": _VISIBILITY_NODES,
        "frame": ("length",),
        "paper": ("length", "x of the normal", "y of the normal"),
    }
)
EDGE_FEATURES: Mapping[FeatureSet, tuple[str, ...]] = MappingProxyType(
    {
        "support": _VISIBILITY_EDGES,
        "visibility": _VISIBILITY_EDGES,
        "frame": (
            "x of j's midpoint",
            "y of j's midpoint",
            "cosine of the angle between the surfaces",
            "sine of the angle between the surfaces",
            "closest distance",
        ),
        "paper": ("x of the offset", "y of the offset", "closest distance"),
    }
)


def edge_index(scene: Scene) -> NDArray[np.int64]:
    """Return the scene's pairs in both directions, [2, 2E]: row 0 is j, row 1 is i.

    As in torch-geometric, messages go from row 0 to row 1. Edge e + E is edge e reversed.
    """
    one, two = scene.pairs.T
    return np.stack([np.concatenate([two, one]), np.concatenate([one, two])])


def node_features(scene: Scene, features: FeatureSet = "support") -> Float32Array:
    """Return the features of the nodes, [N, len(NODE_FEATURES[features])]."""
    return _NODE_COLUMNS[features](scene).astype(np.float32)


def edge_features(scene: Scene, features: FeatureSet = "support") -> Float32Array:
    """Return the features of the edges in both directions, [2E, len(EDGE_FEATURES[features])]."""
    j, i = edge_index(scene)
    return _EDGE_COLUMNS[features](scene, i, j).astype(np.float32)


def _support_nodes(scene: Scene) -> FloatArray:
    own = support(scene.surfaces) if scene.support is None else scene.support
    return np.column_stack([_visibility_nodes(scene), own])


def _visibility_nodes(scene: Scene) -> FloatArray:
    total, ends, seen = len(scene.surfaces), scene.pairs.T.ravel(), scene.visibility

    def summed(weights: FloatArray) -> FloatArray:
        return np.asarray(np.bincount(ends, np.tile(weights, 2), minlength=total), np.float64)

    columns = [
        np.log(scene.surfaces.lengths),
        np.log1p(summed((seen[:, 0] > 0).astype(np.float64))),
        np.log1p(summed(seen[:, 0])),
        *(np.log1p(summed(seen[:, column])) for column in CLOSED_COLUMNS),
    ]
    return np.stack(columns, axis=1)


def _visibility_edges(scene: Scene, i: IntArray, j: IntArray) -> FloatArray:
    surfaces = scene.surfaces
    # numpy reduces an axis of two elements ten times as slowly as it compares two columns
    (x, other_x), (y, other_y) = (ends.T for ends in in_frames(surfaces, i, surfaces.segments[j]))
    half = surfaces.lengths[i] / 2
    overlap = np.minimum(np.maximum(x, other_x), half) - np.maximum(np.minimum(x, other_x), -half)
    tangent, log_length = surfaces.tangents[i], np.log(surfaces.lengths)
    first, second = surfaces.segments[:, 0], surfaces.segments[:, 1]
    seen = np.tile(scene.visibility, (2, 1))
    columns = [
        _compress((x + other_x) / 2, 1.0),
        _compress((y + other_y) / 2, 1.0),
        dot(tangent, surfaces.tangents[j]),
        cross(tangent, surfaces.tangents[j]),
        _compress(np.tile(scene.distances, 2), 0.2),
        _compress(overlap, 0.3),
        _compress(y, 0.3),
        _compress(other_y, 0.3),
        _compress(np.minimum(y, other_y), 0.2),
        _compress(np.maximum(y, other_y), 0.2),
        _compress(_norm(second[i] - first[j]), 0.2),
        _compress(_norm(first[i] - second[j]), 0.2),
        log_length[i],
        log_length[j],
    ]
    return np.column_stack([*columns, seen, np.sqrt(seen)])


def _norm(vectors: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(dot(vectors, vectors)))


def _compress(length_m: FloatArray, scale_m: float) -> FloatArray:
    """Keep small lengths as they are and take the logarithm of large ones, sign kept."""
    return np.asarray(np.sign(length_m) * np.log1p(np.abs(length_m) / scale_m))


def _frame_nodes(scene: Scene) -> FloatArray:
    return scene.surfaces.lengths[:, None]


def _frame_edges(scene: Scene, i: IntArray, j: IntArray) -> FloatArray:
    surfaces, tangents = scene.surfaces, scene.surfaces.tangents
    x, y = in_frames(surfaces, i, surfaces.midpoints[j][:, None])
    angle = dot(tangents[i], tangents[j]), cross(tangents[i], tangents[j])
    return np.column_stack([x, y, *angle, np.tile(scene.distances, 2)])


def _paper_nodes(scene: Scene) -> FloatArray:
    return np.column_stack([scene.surfaces.lengths, scene.surfaces.normals])


def _paper_edges(scene: Scene, i: IntArray, j: IntArray) -> FloatArray:
    midpoints = scene.surfaces.midpoints
    return np.column_stack([midpoints[j] - midpoints[i], np.tile(scene.distances, 2)])


_NODE_COLUMNS: Mapping[FeatureSet, Callable[[Scene], FloatArray]] = {
    "support": _support_nodes,
    "visibility": _visibility_nodes,
    "frame": _frame_nodes,
    "paper": _paper_nodes,
}
_EDGE_COLUMNS: Mapping[FeatureSet, Callable[[Scene, IntArray, IntArray], FloatArray]] = {
    "support": _visibility_edges,
    "visibility": _visibility_edges,
    "frame": _frame_edges,
    "paper": _paper_edges,
}
