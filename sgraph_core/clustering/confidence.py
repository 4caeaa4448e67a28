"""How sure a cluster is, and how probably a node is right."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sgraph_concepts.spec import ConfidenceSpec
from sgraph_concepts.types import Cluster, FloatArray, IntArray
from sgraph_core.clustering.canonical import Relation

__all__ = ["clusters_of", "evidence", "probability_right"]

SUREST = 0.999
"""Confidences beyond this, or below its opposite, are all the same: rounding, not evidence."""


def clusters_of(relation: Relation, sets: Sequence[Sequence[int]]) -> list[Cluster]:
    """Return disjoint sets of canonical numbers as clusters of rows.

    A cluster's confidence is the mean probability of the decisions that make it: of being related
    for the pairs inside it, of not being related for the pairs that cross its border.
    """
    if not sets:
        return []
    sizes = [len(members) for members in sets]
    members = np.array([number for some in sets for number in some], np.int64)
    of = np.repeat(np.arange(len(sets)), sizes)
    owner = np.full(len(relation.rows), -1)
    owner[members] = of
    one, two = owner[relation.pairs].T
    inside = one == two
    related = 0.5 * (1 + np.tanh(0.5 * relation.logits))
    right = np.where(inside, related, 1 - related)
    counted = (one >= 0), (two >= 0) & ~inside
    ends = np.concatenate([one[counted[0]], two[counted[1]]])
    total = np.bincount(ends, np.concatenate([right[some] for some in counted]), len(sets))
    confidence = total / np.maximum(np.bincount(ends, minlength=len(sets)), 1)
    rows = relation.rows[members]
    rows = rows[np.lexsort((rows, of))]
    return [
        Cluster(tuple(some.tolist()), sure)
        for some, sure in zip(
            np.split(rows, np.cumsum(sizes)[:-1]), confidence.tolist(), strict=True
        )
    ]


def evidence(confidences: FloatArray, members: IntArray) -> FloatArray:
    """Return what speaks for K nodes: 1, log-odds of their confidence, log of their size, [K, 3].

    Args:
        confidences: what the clusterer says, from 0 to 1, [K].
        members: how many members each node has, [K].
    """
    sure = np.clip(confidences, 1 - SUREST, SUREST)
    return np.stack([np.ones(len(sure)), np.log(sure / (1 - sure)), np.log(members)], axis=1)


def probability_right(
    spec: ConfidenceSpec, confidences: FloatArray, members: IntArray
) -> FloatArray:
    """Return how probably K nodes are right, [K], from the same as :func:`evidence`."""
    constants = np.array([spec.intercept, spec.slope, spec.members])
    # a product of matrices would round otherwise with the number of nodes
    log_odds = (constants * evidence(confidences, members)).sum(axis=1)
    return np.asarray(0.5 * (1 + np.tanh(0.5 * log_odds)))
