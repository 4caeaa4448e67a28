"""Multicut by greedy additive edge contraction (GAEC), and moves of single numbers.

Keuper et al., "Efficient Decomposition of Image and Mesh Graphs by Lifted Multicuts", ICCV 2015:
contract an edge of positive weight, add up the weights of edges that become parallel, stop when no
weight is positive. With log-odds as weights this climbs the likelihood of the partition.

Of the edges they take the one of the highest weight, which lets the largest sets grow first, for
they have the most edges. Here it is the highest weight over the square root of how many edges were
added up in it, between their rule and average linkage (Bailoni et al., "GASP, a generalized
framework for agglomerative clustering of signed graphs", CVPR 2022). Last, numbers move to the sets
that attract them most, as long as that adds weight inside the sets.
"""

from __future__ import annotations

import heapq
from collections import defaultdict
from math import sqrt

import numpy as np

from sgraph_concepts.types import FloatArray, IntArray

__all__ = ["multicut"]

MOST_PASSES = 10
"""How often all numbers beside one that has moved are asked again; two or three times suffice."""
LEAST_GAIN = 1e-9
"""Moves that gain less are rounding."""


def multicut(count: int, pairs: IntArray, weights: FloatArray) -> list[list[int]]:
    """Partition numbers so that positive weights fall inside sets and negative ones between them.

    Runs in O(E log E log N). Among equals the smaller numbers come first.

    Args:
        count: the numbers are 0 to count - 1.
        pairs: [E, 2], each pair once.
        weights: log-odds that the two belong together, [E].

    Returns:
        The sets, each ascending, by their smallest number.
    """
    parts = _parts(count, pairs[weights > 0])
    inside = parts[pairs[:, 0]] == parts[pairs[:, 1]]  # no contraction joins two parts
    in_dispute = np.isin(parts, parts[pairs[inside & (weights < 0), 0]])  # the others stay whole
    disputed = np.flatnonzero(in_dispute)
    inside &= in_dispute[pairs[:, 0]]
    neighbours: list[dict[int, float]] = [{} for _ in disputed]
    local = np.searchsorted(disputed, pairs[inside])
    for (one, two), weight in zip(local.tolist(), weights[inside].tolist(), strict=True):
        neighbours[one][two] = neighbours[two][one] = weight
    owner = _contracted(neighbours)
    _move(owner, neighbours)
    parts[disputed] = count + np.array(owner, np.int64)
    members: dict[int, list[int]] = defaultdict(list)
    for number, one in enumerate(parts.tolist()):
        members[one].append(number)
    return list(members.values())


def _contracted(neighbours: list[dict[int, float]]) -> list[int]:
    """Return one number of the set that contraction puts each number in."""
    edges = [{two: (weight, 1) for two, weight in near.items()} for near in neighbours]
    heap = [
        (-weight, one, two)
        for one, near in enumerate(neighbours)
        for two, weight in near.items()
        if one < two and weight > 0
    ]
    heapq.heapify(heap)
    members = [[number] for number in range(len(neighbours))]
    while heap:
        negative, one, two = heapq.heappop(heap)
        if two not in edges[one] or _urgency(*edges[one][two]) != -negative:
            continue  # contracted or summed up since it was pushed
        # the one with fewer neighbours moves, which keeps the total work near-linear
        if len(edges[one]) < len(edges[two]):
            one, two = two, one
        _contract(edges, heap, one, two)
        members[one] += members[two]
        members[two] = []
    owner = [0] * len(members)
    for one, group in enumerate(members):
        for number in group:
            owner[number] = one
    return owner


def _urgency(weight: float, added_up: int) -> float:
    return weight / sqrt(added_up)


def _parts(count: int, pairs: IntArray) -> IntArray:
    """Return for each number the smallest one that pairs link it to, directly or not."""
    one, two = pairs.T
    parts = np.arange(count)
    while True:
        smaller = parts.copy()
        np.minimum.at(smaller, parts[one], parts[two])
        np.minimum.at(smaller, parts[two], parts[one])
        smaller = smaller[smaller]  # a part that joined another follows it at once
        if (smaller == parts).all():
            return parts
        parts = smaller


def _contract(
    edges: list[dict[int, tuple[float, int]]],
    heap: list[tuple[float, int, int]],
    keep: int,
    drop: int,
) -> None:
    moving = edges[drop]
    edges[drop] = {}
    del edges[keep][drop]
    for other, (weight, added_up) in moving.items():
        if other == keep:
            continue
        del edges[other][drop]
        before, so_far = edges[keep].get(other, (0.0, 0))
        total, count = before + weight, so_far + added_up
        edges[keep][other] = edges[other][keep] = total, count
        if total > 0:
            heapq.heappush(heap, (-_urgency(total, count), min(keep, other), max(keep, other)))


def _move(owner: list[int], neighbours: list[dict[int, float]]) -> None:
    """Let each number move to the set that attracts it most, or into one of its own.

    Args:
        owner: the set of each number, changed in place.
        neighbours: the weights around each number.
    """
    empty = len(owner)
    waiting = list(range(len(owner)))
    for _ in range(MOST_PASSES):
        disturbed: set[int] = set()
        for number in waiting:
            attraction = {owner[number]: 0.0, empty: 0.0}
            for other, weight in neighbours[number].items():
                attraction[owner[other]] = attraction.get(owner[other], 0.0) + weight
            best = max(attraction, key=lambda one: (attraction[one], -one))
            if attraction[best] > attraction[owner[number]] + LEAST_GAIN:
                owner[number] = best
                empty += best == empty
                disturbed.update(neighbours[number])
        waiting = sorted(disturbed)
