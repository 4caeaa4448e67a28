"""How sure a cluster is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sgraph_concepts.types import Cluster, IntArray, ScoredEdges

__all__ = ["clusters_of"]


def clusters_of(edges: ScoredEdges, sets: Sequence[IntArray]) -> list[Cluster]:
    """Return disjoint sets of rows as clusters.

    A cluster's confidence is the mean probability of the decisions that make it: of being related
    for the pairs inside it, of not being related for the pairs that cross its border.
    """
    if not sets:
        return []
    rows = np.concatenate(sets)
    owner = np.full(max(int(rows.max()), int(edges.pairs.max(initial=0))) + 1, -1)
    for number, members in enumerate(sets):
        owner[members] = number
    one, two = owner[edges.pairs].T
    inside = one == two
    right = np.where(inside, edges.probabilities, 1 - edges.probabilities)
    total, count = np.zeros(len(sets)), np.zeros(len(sets))
    for side, counted in ((one, one >= 0), (two, (two >= 0) & ~inside)):
        np.add.at(total, side[counted], right[counted])
        np.add.at(count, side[counted], 1)
    confidence = total / np.maximum(count, 1)
    return [
        Cluster(tuple(sorted(members.tolist())), float(sure))
        for members, sure in zip(sets, confidence, strict=True)
    ]
