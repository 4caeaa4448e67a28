"""Walls from the scored relation *same wall*: each related pair that is physically possible."""

from __future__ import annotations

import numpy as np

from sgraph_concepts.types import Cluster, Scene, ScoredEdges
from sgraph_plugins.wall.geometry import back_to_back

__all__ = ["cluster"]

THICKEST_M = 0.6
LEAST_OVERLAP_M = 0.25


def cluster(edges: ScoredEdges, scene: Scene) -> list[Cluster]:
    """Return a cluster per pair that is more likely a wall than not, and can be one."""
    likely = np.flatnonzero(edges.logits > 0)
    one, two = edges.pairs[likely].T
    lie = back_to_back(scene.surfaces, one, two)
    walls = likely[lie.physical(THICKEST_M, LEAST_OVERLAP_M)]
    return [
        Cluster((min(pair), max(pair)), confidence)
        for pair, confidence in zip(
            edges.pairs[walls].tolist(), edges.probabilities[walls].tolist(), strict=True
        )
    ]
