"""Algorithm 1, its bound, and multicut."""

from __future__ import annotations

import heapq
from collections.abc import Iterable
from itertools import combinations
from typing import Any

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plans import plan, rectangle

from sgraph_concepts.types import ScoredEdges
from sgraph_core.clustering import cycles
from sgraph_core.clustering.canonical import Relation
from sgraph_core.clustering.confidence import clusters_of
from sgraph_core.clustering.cycles import cycle_sets
from sgraph_core.clustering.multicut import multicut
from sgraph_core.proximity import build_scene

Edges = list[tuple[int, int]]


def ring(*nodes: int) -> Edges:
    return [(min(a, b), max(a, b)) for a, b in zip(nodes, (*nodes[1:], nodes[0]), strict=True)]


def sets_of(count: int, edges: Edges) -> list[list[int]]:
    pairs = np.array(sorted(set(edges)), np.int64).reshape(-1, 2)
    return cycle_sets(count, pairs, np.ones(len(pairs)))


def test_a_ring_is_one_room() -> None:
    assert sets_of(4, ring(0, 1, 2, 3)) == [[0, 1, 2, 3]]


def test_the_longest_cycle_comes_first() -> None:
    # two triangles that share the edge 0-2 make a cycle of four
    assert sets_of(4, ring(0, 1, 2) + ring(0, 2, 3)) == [[0, 1, 2, 3]]


def test_among_cycles_of_one_length_the_most_frequent_set_wins() -> None:
    # {0, 1, 2, 3} is fully linked: three cycles of four; {2, 3, 4, 5} is a ring: one
    edges = [*combinations(range(4), 2), (3, 4), (4, 5), (2, 5)]
    pairs = np.array(edges, np.int64)
    found = cycle_sets(6, pairs, np.ones(len(pairs)))
    assert found == [[0, 1, 2, 3, 4, 5]]  # a cycle through all six is longer still
    thinned = [e for e in edges if e != (2, 5)] + [(3, 5)]  # now 3-4-5 only touches node 3
    pairs = np.array(sorted(thinned), np.int64)
    assert cycle_sets(6, pairs, np.ones(len(pairs))) == [[0, 1, 2, 3]]


def test_rooms_joined_by_one_wrong_edge_stay_apart() -> None:
    assert sets_of(8, [*ring(0, 1, 2, 3), *ring(4, 5, 6, 7), (3, 4)]) == [
        [0, 1, 2, 3],
        [4, 5, 6, 7],
    ]


def test_trees_and_unlikely_edges_give_nothing() -> None:
    assert sets_of(4, [(0, 1), (1, 2), (2, 3)]) == []
    pairs = np.array(ring(0, 1, 2), np.int64)
    assert cycle_sets(3, pairs, np.array([1.0, 1.0, -1.0])) == []
    assert cycle_sets(0, np.empty((0, 2), np.int64), np.empty(0)) == []


def test_a_clique_beyond_the_bound_falls_back_to_multicut(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Twelve mutually linked surfaces hold 19,958,400 cycles of length 12 alone."""
    counted = 0
    every_cycle = cycles.nx.simple_cycles

    def count(*args: object) -> object:
        nonlocal counted
        for cycle in every_cycle(*args):
            counted += 1
            yield cycle

    monkeypatch.setattr(cycles.nx, "simple_cycles", count)
    assert sets_of(12, list(combinations(range(12), 2))) == [list(range(12))]
    assert counted == cycles.MOST_CYCLES + 1


def test_beyond_the_bound_negative_edges_still_separate() -> None:
    rooms = [range(12), range(12, 24)]
    inside = [pair for room in rooms for pair in combinations(room, 2)]
    wrong = [(0, 12), (1, 13)]  # two wrong edges make one block of both rooms
    against = [(a, b) for a in range(2, 12) for b in range(14, 24)]
    pairs = np.array(sorted(inside + wrong + against), np.int64)
    weight = {
        **dict.fromkeys(inside, 1.0),
        **dict.fromkeys(wrong, 0.5),
        **dict.fromkeys(against, -2.0),
    }
    logits = np.array([weight[pair] for pair in map(tuple, pairs.tolist())])
    assert cycle_sets(24, pairs, logits) == [list(room) for room in rooms]


@given(st.integers(0, 10_000))
@settings(max_examples=30, deadline=None)
def test_cycles_do_not_depend_on_the_order_of_rows(seed: int) -> None:
    rng = np.random.default_rng(seed)
    scene = build_scene(
        plan(rectangle(0, 0, 5, 4), rectangle(5.2, 0, 5, 4)).wall_surfaces.ordered()
    )
    edges = ScoredEdges(scene.pairs, rng.normal(0.5, 1, len(scene.pairs)))
    order = rng.permutation(len(scene.pairs))
    shuffled = ScoredEdges(edges.pairs[order], edges.logits[order])
    assert cycles.cluster(edges, scene) == cycles.cluster(shuffled, scene)


def objective(labels: tuple[int, ...], pairs: np.ndarray, weights: np.ndarray) -> float:
    same = np.array([labels[a] == labels[b] for a, b in pairs], bool)
    return float(weights[same].sum())


def random_graph(count: int, density: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    pairs = np.array(list(combinations(range(count), 2)))
    pairs = pairs[rng.random(len(pairs)) < density]
    return pairs, rng.normal(0, 1, len(pairs))


def partitions(count: int) -> list[tuple[int, ...]]:
    found = [(0,)]
    for _ in range(count - 1):
        found = [(*p, label) for p in found for label in range(max(p) + 2)]
    return found


@given(st.integers(0, 10_000))
@settings(max_examples=60, deadline=None)
def test_multicut_comes_close_to_the_best_partition(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pairs = np.array(list(combinations(range(6), 2)))
    weights = rng.normal(0, 1, len(pairs))
    labels = np.empty(6, int)
    for number, group in enumerate(multicut(6, pairs, weights)):
        labels[group] = number
    best = max(objective(p, pairs, weights) for p in partitions(6))
    found = objective(tuple(labels), pairs, weights)
    assert 0.55 * best <= found <= best + 1e-9


@given(st.integers(2, 40), st.floats(0.05, 1), st.integers(0, 10_000))
@settings(max_examples=100, deadline=None)
def test_multicut_is_never_worse_than_connected_components(
    count: int, density: float, seed: int
) -> None:
    """Contraction ends when no two groups attract each other, so parting a component gains."""
    pairs, weights = random_graph(count, density, seed)
    graph = nx.Graph()
    graph.add_nodes_from(range(count))
    graph.add_edges_from(pairs[weights > 0].tolist())

    def value(groups: Iterable[Iterable[int]]) -> float:
        labels = np.empty(count, int)
        for number, group in enumerate(groups):
            labels[list(group)] = number
        return objective(tuple(labels), pairs, weights)

    found = value(multicut(count, pairs, weights))
    assert found >= value(nx.connected_components(graph)) - 1e-9
    assert found >= 0  # nor than leaving everything alone


@given(st.integers(2, 20), st.floats(0.1, 1), st.integers(0, 10_000))
@settings(max_examples=60, deadline=None)
def test_after_multicut_no_number_gains_by_moving(count: int, density: float, seed: int) -> None:
    pairs, weights = random_graph(count, density, seed)
    labels = np.empty(count, int)
    for number, group in enumerate(multicut(count, pairs, weights)):
        labels[group] = number
    found = objective(tuple(labels), pairs, weights)
    for number in range(count):
        for other in range(labels.max() + 2):
            moved = labels.copy()
            moved[number] = other
            assert objective(tuple(moved), pairs, weights) <= found + 1e-6


@given(st.integers(2, 20), st.integers(2, 20), st.integers(0, 10_000))
@settings(max_examples=40, deadline=None)
def test_what_is_not_connected_by_attraction_is_cut_as_if_it_were_alone(
    one: int, two: int, seed: int
) -> None:
    (pairs, weights), (others, more) = (
        random_graph(one, 0.5, seed),
        random_graph(two, 0.5, seed + 1),
    )
    rng = np.random.default_rng(seed)
    between = np.array([(a, one + b) for a in range(one) for b in range(two)])
    repelling = -np.abs(rng.normal(0, 1, len(between)))
    every_pair = np.concatenate([pairs, one + others, between])
    order = np.lexsort((every_pair[:, 1], every_pair[:, 0]))
    every_weight = np.concatenate([weights, more, repelling])
    apart = multicut(one, pairs, weights)
    apart += [[one + number for number in group] for group in multicut(two, others, more)]
    assert multicut(one + two, every_pair[order], every_weight[order]) == sorted(apart)


def test_the_work_of_multicut_grows_with_the_map_and_no_faster(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pushed = 0
    push = heapq.heappush

    def count(*args: Any) -> None:
        nonlocal pushed
        pushed += 1
        push(*args)

    monkeypatch.setattr("sgraph_core.clustering.multicut.heapq.heappush", count)

    def work(rooms: int) -> int:
        """Return the pushes for a corridor's row of rooms of ten, each opposed to the next."""
        nonlocal pushed
        pushed = 0
        inside = [
            pair for k in range(rooms) for pair in combinations(range(10 * k, 10 * k + 10), 2)
        ]
        across = [(10 * k + a, 10 * k + 10 + a) for k in range(rooms - 1) for a in range(10)]
        weights = np.random.default_rng(0).normal(1, 0.2, len(inside)), np.full(len(across), -1.0)
        groups = multicut(10 * rooms, np.array(inside + across), np.concatenate(weights))
        assert len(groups) == rooms
        return pushed

    assert work(400) <= 4.2 * work(100)


def test_multicut_finds_clear_partitions_exactly() -> None:
    pairs = np.array(list(combinations(range(7), 2)))
    together = [{0, 1, 2}, {3, 4, 5, 6}]
    weights = np.array([1.0 if any({a, b} <= t for t in together) else -1.0 for a, b in pairs])
    assert multicut(7, pairs, weights) == [[0, 1, 2], [3, 4, 5, 6]]


def test_multicut_leaves_numbers_without_edges_alone() -> None:
    assert multicut(3, np.empty((0, 2), np.int64), np.empty(0)) == [[0], [1], [2]]
    assert multicut(0, np.empty((0, 2), np.int64), np.empty(0)) == []


def test_confidence_is_the_mean_probability_of_the_decisions() -> None:
    pairs = np.array([[0, 1], [1, 2], [2, 3]])
    edges = ScoredEdges(pairs, np.log(np.array([0.9 / 0.1, 0.8 / 0.2, 0.3 / 0.7])))
    (cluster,) = clusters_of(Relation(np.arange(4), edges.pairs, edges.logits), [[2, 0, 1]])
    assert cluster.members == (0, 1, 2)
    assert cluster.confidence == pytest.approx((0.9 + 0.8 + 0.7) / 3)
