"""The rules that nodes keep; ids and names over re-inference."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from plans import block

from sgraph_concepts.errors import InputError
from sgraph_concepts.types import ConceptNode, NodeShape
from sgraph_core.backend import concept_factors, optimize
from sgraph_core.detector import Detector
from sgraph_core.graph import SGraph
from sgraph_core.nodes import keep_identity
from sgraph_core.slam import ConceptTracker


def nodes(*members: tuple[int, ...]) -> list[ConceptNode]:
    return [ConceptNode(0, m) for m in members]


def ids(found: list[ConceptNode]) -> dict[tuple[int, ...], int]:
    return {node.members: node.id for node in found}


def test_new_nodes_are_numbered_in_the_order_of_their_members() -> None:
    assert ids(keep_identity(nodes((5, 6), (1, 9)), [], {})) == {(1, 9): 0, (5, 6): 1}


def test_a_node_persists_in_the_one_that_shares_most_of_it() -> None:
    old = [ConceptNode(4, (1, 2, 3), "a"), ConceptNode(7, (10, 11, 12), "b")]
    found = keep_identity(nodes((10, 11, 12, 13, 14, 15), (1, 2)), old, {})
    assert ids(found) == {(1, 2): 4, (10, 11, 12, 13, 14, 15): 7}
    assert [node.name for node in found] == ["a", "b"]


def test_a_split_node_keeps_its_id_in_the_larger_part() -> None:
    old = [ConceptNode(3, (1, 2, 3, 4, 5), "hall")]
    found = keep_identity(nodes((1, 2), (3, 4, 5)), old, {})
    assert ids(found) == {(3, 4, 5): 3, (1, 2): 4}


def test_a_node_that_shares_too_little_is_new_and_old_ids_are_not_used_again() -> None:
    old = [ConceptNode(8, (1, 2, 3, 4))]
    assert ids(keep_identity(nodes((4, 5, 6)), old, {})) == {(4, 5, 6): 9}


def test_beyond_the_largest_id_the_lowest_free_ones_are_used() -> None:
    old = [ConceptNode(2**53 - 2, (1, 2, 3)), ConceptNode(1, (4, 5, 6))]
    found = keep_identity(nodes((1, 2, 3), (4, 5, 6), (7, 8), (9, 10), (11, 12)), old, {0: "a"})
    assert ids(found) == {
        (1, 2, 3): 2**53 - 2,
        (4, 5, 6): 1,
        (7, 8): 2**53 - 1,
        (9, 10): 2,
        (11, 12): 3,
    }


def test_a_node_with_a_name_persists_before_one_without() -> None:
    old = [ConceptNode(0, (1, 2, 3, 4)), ConceptNode(1, (5, 6, 7), "kitchen")]
    merged = keep_identity(nodes((1, 2, 3, 4, 5, 6, 7)), old, {})
    assert [(node.id, node.name) for node in merged] == [(1, "kitchen")]
    pinned = keep_identity(nodes((1, 2, 3, 4, 5, 6, 7)), [old[0], ConceptNode(1, (5, 6))], {1: "a"})
    assert [(node.id, node.name) for node in pinned] == [(1, "a")]


def test_a_name_does_not_go_where_its_node_does_not_persist() -> None:
    old = [ConceptNode(0, (1, 2, 3, 4), "hall")]
    assert keep_identity(nodes((4, 5, 6)), old, {})[0].name is None


def test_pinned_names_win_over_old_ones() -> None:
    old = [ConceptNode(1, (1, 2, 3), "old")]
    assert keep_identity(nodes((1, 2, 3)), old, {1: "new"})[0].name == "new"


# -- what is refused -----------------------------------------------------------------------------

NAN = float("nan")
BAD: dict[str, list[ConceptNode]] = {
    r"\[0\] = 'wall': must be a ConceptNode": ["wall"],  # type: ignore[list-item]
    r"\[0\].id = -1: must be an integer from 0 to": [ConceptNode(-1, (1, 7))],
    r"\[0\].id = one: must be an integer": [ConceptNode("one", (1, 7))],  # type: ignore[arg-type]
    r": id = 3: must be unique": [ConceptNode(3, (1, 7)), ConceptNode(3, (9, 15))],
    r"\[1\].members\[1\] = 99: must be the id of a wall_surface": [
        ConceptNode(0, (1, 7)),
        ConceptNode(1, (9, 99)),
    ],
    r"\[0\].members = \[7, 7\]: must be unique": [ConceptNode(0, (7, 7))],
    r"\[0\].members = \[\]: must have at least 1": [ConceptNode(0, ())],
    r"\[0\].members = \[1, 2, 7\]: a wall has exactly two": [ConceptNode(0, (1, 2, 7))],
    r"\[0\].confidence = nan: must be from 0 to 1": [ConceptNode(0, (1, 7), confidence=NAN)],
    r"\[0\].confidence = 1.5: must be from 0 to 1": [ConceptNode(0, (1, 7), confidence=1.5)],
    r"\[0\].centre = \[nan, 2.0\]: must be finite": [
        ConceptNode(0, (1, 7), shape=NodeShape((NAN, 2.0)))
    ],
    r"\[0\].thickness = -0.1: must be finite and not": [
        ConceptNode(0, (1, 7), shape=NodeShape((1.0, 2.0), thickness=-0.1))
    ],
}
CALLS: list[Callable[[SGraph, Detector], object]] = [
    lambda graph, detector: detector.infer(graph),
    ConceptTracker,
    lambda graph, _: concept_factors(graph),
    lambda graph, _: optimize(graph),
]


@pytest.mark.parametrize("call", CALLS)
@pytest.mark.parametrize("message", BAD)
def test_nodes_that_break_a_rule_are_named(
    message: str, call: Callable[[SGraph, Detector], object], detector: Detector
) -> None:
    graph = block(0.15)
    graph.concepts["wall"] = BAD[message]
    with pytest.raises(InputError, match=r"^concepts\.wall" + message):
        call(graph, detector)
    assert graph.concepts["wall"] is BAD[message]


def test_nodes_of_other_concepts_may_group_nodes() -> None:
    graph = block(0.15)
    graph.concepts["floor"] = [ConceptNode(40, (41,))]
    graph.concepts["zone"] = [ConceptNode(41, (40, 3))]
    assert concept_factors(graph).graph.size() == 0
    graph.concepts["zone"] = [ConceptNode(41, (40, 42))]
    with pytest.raises(InputError, match=r"concepts\.zone\[0\]\.members\[1\] = 42: must be the id"):
        concept_factors(graph)
