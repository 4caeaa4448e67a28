"""Ids and names over re-inference."""

from __future__ import annotations

from sgraph_concepts.types import ConceptNode
from sgraph_core.nodes import keep_identity


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
