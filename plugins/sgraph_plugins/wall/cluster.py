"""Walls from the scored relation *same wall*: each related pair that is physically possible."""

from __future__ import annotations

import numpy as np

from sgraph_concepts.types import Cluster, Scene, ScoredEdges
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
    return [
        Cluster((min(pair), max(pair)), confidence)
        for pair, confidence in zip(
            edges.pairs[walls].tolist(), edges.probabilities[walls].tolist(), strict=True
        )
    ]
