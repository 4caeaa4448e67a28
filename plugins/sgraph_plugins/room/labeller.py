"""What *same room* means in a synthetic building."""

from __future__ import annotations

import numpy as np

from sgraph_concepts.types import BuildingTruth, IntArray

__all__ = ["label"]


def label(truth: BuildingTruth) -> IntArray:
    """Return all pairs of rows that lie in one room, [P, 2]."""
    one, two = np.nonzero(np.triu(truth.rooms[:, None] == truth.rooms[None, :], k=1))
    inside = truth.rooms[one] >= 0
    return np.stack([one, two], axis=1)[inside]
