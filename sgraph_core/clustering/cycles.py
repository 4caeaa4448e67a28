"""The paper's Algorithm 1: rooms are the cycles of the *same room* graph.

For cycle lengths in descending order: collect the cycles of that length, count how often each set
of nodes recurs, take the sets in descending count, accept a set when none of its nodes is in a room
yet.

All cycles are too many: twelve mutually linked surfaces hold 19,958,400 of length 12. Cycles never
leave a biconnected block of the graph, so blocks are searched one by one, for cycles of at most
``LONGEST_CYCLE`` nodes. A block with more than ``MOST_CYCLES`` of them is cut by multicut instead.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from itertools import islice

import networkx as nx
import numpy as np

from sgraph_concepts.types import Cluster, FloatArray, IntArray, Scene, ScoredEdges
from sgraph_core.clustering.canonical import canonical_relation
from sgraph_core.clustering.confidence import clusters_of
from sgraph_core.clustering.multicut import multicut

__all__ = ["LONGEST_CYCLE", "MOST_CYCLES", "cluster", "cycle_sets"]

LONGEST_CYCLE = 16
MOST_CYCLES = 5_000
SHORTEST_CYCLE = 3


def cluster(edges: ScoredEdges, scene: Scene) -> list[Cluster]:
    """Return the clusters that Algorithm 1 finds among the edges more likely related than not."""
    relation = canonical_relation(edges, scene)
    sets = cycle_sets(len(relation.rows), relation.pairs, relation.logits)
    return clusters_of(relation, sets)


def cycle_sets(count: int, pairs: IntArray, logits: FloatArray) -> list[list[int]]:
    """Return disjoint sets of numbers that form cycles, by their smallest number.

    Args:
        count: the numbers are 0 to count - 1.
        pairs: [E, 2], each pair once.
        logits: log-odds that the two are related, [E]; pairs at or below 0 are no edges.
    """
    graph: nx.Graph[int] = nx.Graph()
    graph.add_nodes_from(range(count))
    graph.add_edges_from(pairs[logits > 0].tolist())
    sets = []
    blocks: Iterable[set[int]] = nx.biconnected_components(graph)  # type: ignore[assignment]
    for block in blocks:
        if len(block) >= SHORTEST_CYCLE:
            sets += _block_sets(graph.subgraph(block), pairs, logits)
    # a node where two blocks meet may have been accepted in both: the larger set comes first
    return sorted(_disjoint(sorted(sets, key=lambda s: (-len(s), s))))


def _block_sets(block: nx.Graph[int], pairs: IntArray, logits: FloatArray) -> list[list[int]]:
    cycles = list(islice(nx.simple_cycles(block, LONGEST_CYCLE), MOST_CYCLES + 1))
    if len(cycles) > MOST_CYCLES:
        return _cut(sorted(block), pairs, logits)
    recurrence = Counter(tuple(sorted(cycle)) for cycle in cycles if len(cycle) >= SHORTEST_CYCLE)
    ranked = sorted(recurrence, key=lambda nodes: (-len(nodes), -recurrence[nodes], nodes))
    return list(_disjoint(map(list, ranked)))


def _disjoint(sets: Iterable[list[int]]) -> Iterator[list[int]]:
    taken: set[int] = set()
    for nodes in sets:
        if taken.isdisjoint(nodes):
            taken.update(nodes)
            yield nodes


def _cut(nodes: list[int], pairs: IntArray, logits: FloatArray) -> list[list[int]]:
    number = {node: k for k, node in enumerate(nodes)}
    inside = np.isin(pairs, nodes).all(axis=1)
    local = np.array([[number[a], number[b]] for a, b in pairs[inside].tolist()])
    groups = multicut(len(nodes), local, logits[inside])
    return [[nodes[k] for k in group] for group in groups if len(group) >= SHORTEST_CYCLE]
