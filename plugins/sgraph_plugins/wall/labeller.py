"""What *same wall* means in a synthetic building."""

from __future__ import annotations

from sgraph_concepts.types import BuildingTruth, IntArray

__all__ = ["label"]


def label(truth: BuildingTruth) -> IntArray:
    """Return the pairs of rows that are the two sides of one wall, [W, 2]."""
    return truth.walls
