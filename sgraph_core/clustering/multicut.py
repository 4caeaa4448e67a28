"""Multicut by greedy additive edge contraction (GAEC).

Keuper et al., "Efficient Decomposition of Image and Mesh Graphs by Lifted Multicuts", ICCV 2015:
contract the edge of the highest weight, add up the weights of edges that become parallel, stop when
no weight is positive. With log-odds as weights this climbs the likelihood of the partition.
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence

import numpy as np

from sgraph_concepts.types import FloatArray, IntArray

__all__ = ["multicut"]


def multicut(count: int, pairs: IntArray, weights: FloatArray) -> list[list[int]]:
    """Partition numbers so that positive weights fall inside sets and negative ones between them.

    Runs in O(E log E log N). Equal weights are contracted in the order of their numbers.

    Args:
        count: the numbers are 0 to count - 1.
        pairs: [E, 2], each pair once.
        weights: log-odds that the two belong together, [E].

    Returns:
        The sets, each ascending, by their smallest number.
    """
    parts = _parts(count, pairs[weights > 0])
    inside = parts[pairs[:, 0]] == parts[pairs[:, 1]]  # no contraction joins two parts
    pairs, weights = pairs[inside], weights[inside]
    neighbours: list[dict[int, float]] = [{} for _ in range(count)]
    for (one, two), weight in zip(pairs.tolist(), weights.tolist(), strict=True):
        neighbours[one][two] = neighbours[two][one] = weight
    heap = [
        (-weight, one, two)
        for one, edges in enumerate(neighbours)
        for two, weight in edges.items()
        if one < two and weight > 0
    ]
    heapq.heapify(heap)
    members: list[list[int]] = [[number] for number in range(count)]
    while heap:
        negative, one, two = heapq.heappop(heap)
        if neighbours[one].get(two) != -negative:
            continue  # contracted or summed up since it was pushed
        # the one with fewer neighbours moves, which keeps the total work near-linear
        if len(neighbours[one]) < len(neighbours[two]):
            one, two = two, one
        _contract(neighbours, heap, one, two)
        members[one] += members[two]
        members[two] = []
    return _sorted_sets(members)


def _parts(count: int, pairs: IntArray) -> IntArray:
    """Return a number for each of the numbers, equal for those that pairs link, directly or not."""
    above = list(range(count))

    def top(number: int) -> int:
        while above[number] != number:
            above[number] = number = above[above[number]]
        return number

    for one, two in pairs.tolist():
        above[top(one)] = top(two)
    return np.array([top(number) for number in range(count)], np.int64)


def _contract(
    neighbours: list[dict[int, float]],
    heap: list[tuple[float, int, int]],
    keep: int,
    drop: int,
) -> None:
    moving = neighbours[drop]
    neighbours[drop] = {}
    del neighbours[keep][drop]
    for other, weight in moving.items():
        if other == keep:
            continue
        del neighbours[other][drop]
        total = neighbours[keep].get(other, 0.0) + weight
        neighbours[keep][other] = neighbours[other][keep] = total
        if total > 0:
            heapq.heappush(heap, (-total, min(keep, other), max(keep, other)))


def _sorted_sets(members: Sequence[list[int]]) -> list[list[int]]:
    return sorted(sorted(group) for group in members if group)
