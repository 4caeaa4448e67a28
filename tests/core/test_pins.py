"""Pins hold in the rooms, whatever the scores say and whoever clusters."""

from __future__ import annotations

import random
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plans import block, members, plan, rectangle, two_rooms_on_one_surface

from sgraph_concepts.errors import InputError
from sgraph_concepts.types import Cluster, Scene, ScoredEdges, SurfaceArrays
from sgraph_core import map_file
from sgraph_core.clustering.multicut import multicut
from sgraph_core.clustering.pinned import PinnedRelation, pin
from sgraph_core.detector import Detector
from sgraph_core.graph import Pins, SGraph

CLUSTERERS = [None, "cycles", "zone:one_node", "zone:no_nodes", "zone:pairs_of_rows"]
Pairs = tuple[tuple[int, int], ...]


def with_pins(graph: SGraph, same: Pairs = (), apart: Pairs = ()) -> SGraph:
    graph.pins = Pins(same, apart)
    return graph


def rooms(graph: SGraph) -> list[tuple[int, str | None, tuple[int, ...]]]:
    return [(node.id, node.name, node.members) for node in graph.concepts["room"]]


def assert_pins_hold(result: SGraph) -> None:
    assert result.pins is not None
    found = members(result, "room")
    for pair in result.pins.same_room:
        assert any(room.issuperset(pair) for room in found), (pair, found)
    for pair in result.pins.not_same_room:
        assert not any(room.issuperset(pair) for room in found), (pair, found)


def two_rooms_with_a_common_wall() -> SGraph:
    """Surface 0 runs along the south of both rooms; 8 repeats 1, 9 repeats 0."""
    graph = two_rooms_on_one_surface()
    graph.add_wall_surface(7, [[3, -6], [8, -6]], [0, -1])  # sees none of them
    graph.add_wall_surface(8, [[5.02, 0.1], [5.02, 4]], [-1, 0])
    graph.add_wall_surface(9, [[0.2, -0.02], [10, -0.02]], [0, 1])
    return graph


WEST, EAST = frozenset({0, 1, 2, 3, 8, 9}), frozenset({0, 4, 5, 6, 9})


def detector_with(clusterer: str | None) -> Detector:
    return Detector(scorer="baseline", clusterers={"room": clusterer} if clusterer else {})


# -- what a person expects -------------------------------------------------------------------------


def test_without_pins_the_map_has_two_rooms(baseline: Detector) -> None:
    assert members(baseline.infer(two_rooms_with_a_common_wall()), "room") == {WEST, EAST}


@pytest.mark.parametrize("clusterer", CLUSTERERS)
@pytest.mark.parametrize(
    ("same", "apart"),
    [
        pytest.param([(2, 5)], [], id="surfaces of two rooms"),
        pytest.param([(2, 7)], [], id="a surface that belongs to no room"),
        pytest.param([(2, 7), (7, 5)], [], id="pins over a third surface"),
        pytest.param([], [(2, 3)], id="surfaces of one room"),
        pytest.param([], [(0, 2)], id="a split surface and a surface of one of its rooms"),
        pytest.param([(0, 7)], [(0, 2), (7, 5)], id="a split surface that leaves both rooms"),
        pytest.param([(0, 1), (0, 4)], [], id="a split surface and one of each of its rooms"),
        pytest.param([(8, 5)], [], id="a copy"),
        pytest.param([], [(8, 2)], id="a copy apart"),
        pytest.param([], [(1, 8)], id="a copy apart from its original"),
        pytest.param([(8, 5)], [(1, 5)], id="a copy where its original must not be"),
        pytest.param([(9, 4), (0, 2)], [(9, 2)], id="a split copy apart from its original"),
        pytest.param([(1, 8)], [(1, 2), (1, 3), (8, 0)], id="a copy with its original only"),
    ],
)
def test_pins_hold_with_any_clusterer(same: Pairs, apart: Pairs, clusterer: str | None) -> None:
    graph = with_pins(two_rooms_with_a_common_wall(), tuple(same), tuple(apart))
    assert_pins_hold(detector_with(clusterer).infer(graph))


def test_clusterers_see_the_pins_as_the_surest_of_all_scores() -> None:
    surest = detector_with("zone:surest_pair")
    assert members(surest.infer(with_pins(block(0.15), same=((0, 12),))), "room") == {
        frozenset({0, 12})
    }


def test_neighbours_follow_where_little_holds_two_rooms_apart() -> None:
    graph = with_pins(block(0.15), same=((0, 12), (1, 13)))
    found = members(Detector(scorer="baseline").infer(graph), "room")
    assert frozenset({0, 1, 2, 3, 12, 13, 14, 15}) in found


def test_a_wrong_room_is_split_with_its_neighbours() -> None:
    graph = plan(rectangle(0, 0, 5, 4), rectangle(5.2, 0, 5, 4))
    lumped = detector_with("zone:one_node")
    assert len(lumped.infer(graph).concepts["room"]) == 1
    pairs = tuple((k, k + 4) for k in range(4))
    found = members(lumped.infer(with_pins(graph, apart=pairs)), "room")
    assert found == {frozenset({0, 1, 2, 3}), frozenset({4, 5, 6, 7})}


def test_what_a_pin_leaves_of_a_room_is_none_by_itself(detector: Detector) -> None:
    graph = with_pins(plan(rectangle(0, 0, 5, 4)), apart=((0, 2),))
    (room,) = members(detector.infer(graph), "room")
    assert len(room) == 3


def test_two_sides_of_a_corridor_become_a_room_by_a_pin(detector: Detector) -> None:
    graph = SGraph()
    graph.add_wall_surface(4, [[0, 0], [15, 0]], [0, 1])
    graph.add_wall_surface(7, [[15, 2], [0, 2]], [0, -1])
    assert detector.infer(graph).concepts["room"] == []
    (room,) = detector.infer(with_pins(graph, same=((4, 7),))).concepts["room"]
    assert room.members == (4, 7)
    assert room.shape.attributes["area_m2"] == pytest.approx(30)


def test_rooms_that_no_pin_concerns_stay_as_they_are(detector: Detector) -> None:
    before = detector.infer(block(0.15)).concepts["room"]
    after = detector.infer(with_pins(block(0.15), same=((0, 4),), apart=((5, 7),)))
    untouched = [node.members for node in before[2:]]
    assert [node.members for node in after.concepts["room"]][-2:] == untouched


def test_pins_concern_rooms_only(detector: Detector) -> None:
    graph = with_pins(block(0.15), same=((0, 2),), apart=((1, 7),))
    assert members(detector.infer(graph), "wall") == members(detector.infer(block(0.15)), "wall")


def test_pins_do_not_depend_on_the_order_of_surfaces(baseline: Detector) -> None:
    graph = with_pins(two_rooms_with_a_common_wall(), ((0, 7), (2, 5)), ((5, 6), (1, 8)))
    expected = rooms(baseline.infer(graph))
    table, order = graph.wall_surfaces, list(range(len(graph.wall_surfaces.ids)))
    for seed in range(5):
        random.Random(seed).shuffle(order)
        shuffled = SGraph()
        for row in order:
            shuffled.add_wall_surface(int(table.ids[row]), table.segments[row], table.normals[row])
        shuffled.pins = graph.pins
        assert rooms(baseline.infer(shuffled)) == expected


# -- re-inference ----------------------------------------------------------------------------------


def named(graph: SGraph, names: dict[int, str]) -> SGraph:
    """Return an inferred map whose rooms a person has named."""
    pins = graph.pins or Pins()
    graph.pins = Pins(pins.same_room, pins.not_same_room, names)
    return graph


def test_pins_survive_inference_and_writing(detector: Detector) -> None:
    graph = named(with_pins(block(0.15), ((0, 4),), ((0, 2),)), {0: "kitchen"})
    again = map_file.parse(map_file.dump(detector.infer(graph)).encode())
    assert again.pins == graph.pins


def test_a_room_merged_by_pins_takes_the_lower_id_of_equals(detector: Detector) -> None:
    graph = detector.infer(block(0.15))
    merged = detector.infer(with_pins(graph, same=((0, 12), (2, 14))))
    assert rooms(merged) == [
        (0, None, (0, 1, 2, 3, 12, 13, 14, 15)),
        (1, None, (4, 5, 6, 7)),
        (2, None, (8, 9, 10, 11)),
    ]


@pytest.mark.parametrize("pinned_name", [True, False])
def test_a_room_merged_by_pins_keeps_id_and_name_of_the_named_one(
    pinned_name: bool, detector: Detector
) -> None:
    graph = detector.infer(named(detector.infer(block(0.15)), {3: "kitchen"}))
    names = {3: "kitchen"} if pinned_name else {}
    merged = detector.infer(named(with_pins(graph, same=((0, 12), (2, 14))), names))
    assert rooms(merged) == [
        (1, None, (4, 5, 6, 7)),
        (2, None, (8, 9, 10, 11)),
        (3, "kitchen", (0, 1, 2, 3, 12, 13, 14, 15)),
    ]


def test_a_room_split_by_a_pin_keeps_id_and_name_in_one_part() -> None:
    lumped = detector_with("zone:one_node")
    once = lumped.infer(named(plan(rectangle(0, 0, 5, 4), rectangle(5.2, 0, 5, 4)), {0: "lab"}))
    once.pins = Pins((), tuple((k, k + 4) for k in range(4)), {0: "lab"})
    assert rooms(lumped.infer(once)) == [(0, "lab", (0, 1, 2, 3)), (1, None, (4, 5, 6, 7))]


def test_the_id_of_a_pinned_name_is_not_given_to_another_room(detector: Detector) -> None:
    small = detector.infer(plan(rectangle(0, 0, 5, 4)))
    assert [node.id for node in small.concepts["room"]] == [0]
    grown = named(plan(rectangle(0, 0, 5, 4), rectangle(5.2, 0, 5, 4)), {1: "room that is gone"})
    grown.concepts = small.concepts
    assert rooms(detector.infer(grown)) == [(0, None, (0, 1, 2, 3)), (2, None, (4, 5, 6, 7))]


# -- errors ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("pins", "message"),
    [
        (Pins(((0, 99),)), "pins.same_room[0][1] = 99: must be the id of a wall_surface"),
        (Pins((), ((0, 1), (2, 2))), "pins.not_same_room[1] = [2, 2]: must be two surfaces"),
        (
            Pins(((0, 1),), ((1, 0),)),
            "pins.not_same_room[0] = [1, 0]: contradicts same_room [1, 0]",
        ),
        (
            Pins(((0, 1), (3, 2), (1, 2)), ((4, 5), (0, 3))),
            "pins.not_same_room[1] = [0, 3]: contradicts same_room [0, 1], [1, 2], [2, 3]",
        ),
    ],
)
def test_pins_that_break_a_rule_are_named_before_inference(
    pins: Pins, message: str, baseline: Detector
) -> None:
    graph = block(0.15)
    graph.pins = pins
    with pytest.raises(InputError) as caught:
        baseline.infer(graph, ["wall"])
    assert str(caught.value) == message


# -- properties ------------------------------------------------------------------------------------


@st.composite
def consistent_pins(draw: st.DrawFn, surfaces: int) -> tuple[Pairs, Pairs]:
    """Return pins that some partition of the surfaces keeps to."""
    owner = draw(st.lists(st.integers(0, 3), min_size=surfaces, max_size=surfaces))
    pairs = draw(st.lists(st.sampled_from(list(combinations(range(surfaces), 2))), max_size=12))
    same = tuple((a, b) for a, b in pairs if owner[a] == owner[b])
    return same, tuple((a, b) for a, b in pairs if owner[a] != owner[b])


@given(consistent_pins(10), st.sampled_from(CLUSTERERS))
@settings(max_examples=150, deadline=None)
def test_any_consistent_pins_hold_and_a_second_inference_changes_nothing(
    pins: tuple[Pairs, Pairs], clusterer: str | None
) -> None:
    detector = detector_with(clusterer)
    once = detector.infer(with_pins(two_rooms_with_a_common_wall(), *pins))
    assert_pins_hold(once)
    assert once.pins == Pins(*pins)
    assert rooms(detector.infer(once)) == rooms(once)


def linked(pairs: Pairs) -> list[frozenset[int]]:
    """Return what pairs link, the slow way."""
    groups = {frozenset(pair) for pair in pairs}
    while True:
        touching = [(a, b) for a, b in combinations(groups, 2) if a & b]
        if not touching:
            return sorted(groups, key=min)
        one, two = touching[0]
        groups = groups - {one, two} | {one | two}


def scene_of(ids: list[int], segments: np.ndarray, pairs: np.ndarray) -> Scene:
    """Return a scene with all that pins need of one."""
    nothing = np.empty(0)
    surfaces = SurfaceArrays(np.array(ids), segments, nothing)
    return Scene(surfaces, np.zeros(2), pairs, nothing, nothing)


SURFACES = 9


def random_relation(seed: int, pins: tuple[Pairs, Pairs]) -> tuple[ScoredEdges, PinnedRelation]:
    """Return a random relation of fragments, some not scored at all, without and with pins."""
    rng = np.random.default_rng(seed)
    ids = np.sort(np.concatenate([np.arange(SURFACES), rng.integers(0, SURFACES, 5)]))
    pairs = np.array(list(combinations(range(len(ids)), 2)))[rng.random(91) < rng.random()]
    edges = ScoredEdges(pairs, rng.normal(0, rng.choice([0.1, 3, 1000]), len(pairs)))
    scene = scene_of(ids.tolist(), rng.uniform(0, 9, (len(ids), 2, 2)), pairs)
    return edges, pin(edges, scene, linked(pins[0]), pins[1])


@given(st.integers(0, 100_000), consistent_pins(SURFACES))
@settings(max_examples=200, deadline=None)
def test_greedy_contraction_keeps_to_pins_by_itself(seed: int, pins: tuple[Pairs, Pairs]) -> None:
    edges, pinned = random_relation(seed, pins)
    ids = pinned.ids
    sets = multicut(len(ids), pinned.edges.pairs, pinned.edges.logits)
    surfaces = [frozenset(ids[group].tolist()) for group in sets]
    for group in linked(pins[0]):
        assert any(group <= found for found in surfaces)
    for pair in pins[1]:
        assert not any(found.issuperset(pair) for found in surfaces)
    if not pins[0] and not pins[1]:
        assert sets == multicut(len(ids), edges.pairs, edges.logits)


@given(st.integers(0, 100_000), consistent_pins(SURFACES))
@settings(max_examples=200, deadline=None)
def test_any_clusters_are_put_right(seed: int, pins: tuple[Pairs, Pairs]) -> None:
    _, pinned = random_relation(seed, pins)
    rng = np.random.default_rng(seed)
    owner = rng.integers(-1, 4, len(pinned.ids))
    given = [
        Cluster(tuple(np.flatnonzero(owner == k).tolist()), 0.25) for k in range(4) if k in owner
    ]
    found = pinned.enforce(given)
    rows = [row for cluster in found for row in cluster.members]
    assert len(rows) == len(set(rows))
    surfaces = [frozenset(pinned.ids[list(cluster.members)].tolist()) for cluster in found]
    assert all(any(group <= room for room in surfaces) for group in linked(pins[0]))
    assert not any(room.issuperset(pair) for room in surfaces for pair in pins[1])
    assert all(0 <= cluster.confidence <= 1 for cluster in found)
    assert pinned.enforce(found) == found
    pinned_ids = {surface for pair in (*pins[0], *pins[1]) for surface in pair}
    for cluster in given:
        if pinned_ids.isdisjoint(pinned.ids[list(cluster.members)].tolist()):
            assert cluster in found


def test_a_group_takes_the_fragment_it_is_related_to_or_else_the_closest() -> None:
    segments = np.array([[[0.0, 0], [4, 0]], [[4, 0], [8, 0]], [[1, 3], [3, 3]]])
    for logits, expected in (([-1.0, 2.0], {1, 2}), ([-1.0], {0, 2}), ([], {0, 2})):
        pairs = np.array([[0, 2], [1, 2]][: len(logits)], np.int64).reshape(-1, 2)
        scene = scene_of([0, 0, 1], segments, pairs)
        pinned = pin(ScoredEdges(pairs, np.array(logits)), scene, [frozenset({0, 1})], [])
        assert pinned.together == [expected]


def put_right(
    logits: dict[tuple[int, int], float],
    given: list[tuple[int, ...]],
    same: Pairs = (),
    apart: Pairs = (),
) -> list[tuple[int, ...]]:
    """Return what pins make of given clusters of seven surfaces."""
    pairs = np.array(list(logits))
    scene = scene_of(list(range(7)), np.zeros((7, 2, 2)), pairs)
    pinned = pin(ScoredEdges(pairs, np.array(list(logits.values()))), scene, linked(same), apart)
    return [cluster.members for cluster in pinned.enforce([Cluster(rows, 0.5) for rows in given])]


def within(rows: tuple[int, ...], logit: float) -> dict[tuple[int, int], float]:
    return dict.fromkeys(combinations(rows, 2), logit)


def test_a_divided_group_draws_its_neighbours_with_it_as_far_as_scores_and_pins_let_it() -> None:
    given = [(0, 1, 2), (3, 4, 5)]
    logits = within(given[0], 2.0) | within(given[1], 1.0)
    same = ((0, 3),)
    assert put_right(logits, given, same) == [(0, 1, 2, 3, 4, 5)]
    against = logits | {(a, b): -5.0 for a in (1, 2) for b in (4, 5)}
    assert put_right(against, given, same) == [(0, 1, 2, 3)]  # 4 and 5 enclose nothing
    assert put_right(against, given, same, ((1, 3),)) == [(0, 3, 4, 5)]  # nor do 1 and 2
    assert put_right(logits, given, same, ((0, 1), (0, 2), (0, 4))) == [(0, 3, 5)]
    assert put_right(logits, given, same, ((0, 1), (0, 2), (0, 4), (0, 5))) == [(0, 3)]


def test_a_row_of_no_cluster_comes_to_the_one_it_is_pinned_to() -> None:
    logits = within((0, 1, 2), 1.0) | {(1, 3): -9.0, (2, 3): -9.0}
    assert put_right(logits, [(0, 1, 2)], ((0, 3),)) == [(0, 1, 2, 3)]


def test_rows_that_were_not_scored_stay_in_a_cluster_that_is_cut() -> None:
    assert put_right(within((0, 1, 2), 1.0), [(0, 1, 2, 3, 4)], (), ((0, 4),)) == [(0, 1, 2, 3)]
