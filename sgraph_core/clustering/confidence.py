"""How sure a cluster is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sgraph_concepts.types import Cluster
from sgraph_core.clustering.canonical import Relation

__all__ = ["clusters_of"]


def clusters_of(relation: Relation, sets: Sequence[Sequence[int]]) -> list[Cluster]:
    """Return disjoint sets of canonical numbers as clusters of rows.

    A cluster's confidence is the mean probability of the decisions that make it: of being related
    for the pairs inside it, of not being related for the pairs that cross its border.
    """
    owner = np.full(len(relation.rows), -1)
    for number, members in enumerate(sets):
        owner[list(members)] = number
    one, two = owner[relation.pairs].T
    inside = one == two
    related = 0.5 * (1 + np.tanh(0.5 * relation.logits))
    right = np.where(inside, related, 1 - related)
    total, count = np.zeros(len(sets)), np.zeros(len(sets))
    for side, counted in ((one, one >= 0), (two, (two >= 0) & ~inside)):
        np.add.at(total, side[counted], right[counted])
        np.add.at(count, side[counted], 1)
    confidence = total / np.maximum(count, 1)
    return [
        Cluster(tuple(sorted(relation.rows[list(members)].tolist())), float(sure))
        for members, sure in zip(sets, confidence, strict=True)
    ]
