"""Explanations of small plans, whose answers are known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from plans import block, plan, rectangle, two_rooms_on_one_surface

from sgraph_concepts.errors import ConceptError, InputError
from sgraph_concepts.spec import ConceptSpec, HeadSpec
from sgraph_concepts.types import ConceptNode
from sgraph_core import map_file
from sgraph_core.concepts import installed, new_registry
from sgraph_core.detector import Detector
from sgraph_core.explain import Link, Member, PairExplanation, Relation, explain_node, explain_pair
from sgraph_core.graph import Pins, SGraph
from sgraph_core.preprocess import preprocess
from sgraph_core.proximity import build_scene
from sgraph_core.sight import Sight, sight
from sgraph_core.visibility import visibility

TWO_ROOMS = (rectangle(0, 0, 5, 4), rectangle(5.15, 0, 5, 4))
"""Surface 1 is the east side of the first room, 7 the west side of the second."""


def explained_pair(graph: SGraph, detector: Detector, one: int, two: int) -> PairExplanation:
    return explain_pair(detector.infer(graph), detector, one, two)


def relation(explained: PairExplanation, concept: str) -> Relation:
    (found,) = [r for r in explained.relations if r.concept == concept]
    return found


def detector_of_two_zones(**parts: str) -> Detector:
    """Return a detector of zones: surfaces with ids below 4, and the others; all pairs score +1."""
    registry = new_registry()
    declared = {"baseline": "zone:everything", "clusterer": "zone:two_nodes", **parts}
    registry.add(ConceptSpec(name="zone", relation="same_zone", **declared))
    return Detector(registry)


# -- lines of sight --------------------------------------------------------------------------------


def test_free_lines_of_sight_are_those_of_the_visibility(demo_map: Path) -> None:
    scene = build_scene(preprocess(map_file.load(demo_map).wall_surfaces.ordered()).surfaces)
    seen = visibility(scene.surfaces, scene.pairs)[:, 0]
    for pair, share in zip(scene.pairs.tolist(), seen.tolist(), strict=True):
        found = sight(scene.surfaces, *pair)
        assert found.free / found.lines == share
        blocked = found.lines - found.free - found.behind
        assert bool(blocked) == bool(found.blockers)
        assert all(0 < count <= blocked for _, count in found.blockers)


def test_a_wall_between_two_rooms_is_named_as_what_blocks_the_view(detector: Detector) -> None:
    west_to_east = explained_pair(plan(*TWO_ROOMS), detector, 3, 5)
    assert west_to_east.sight == Sight(16, 0, 0, ((1, 16), (7, 16)))
    assert west_to_east.distance_m == pytest.approx(10.15)
    assert relation(west_to_east, "room") == Relation("room", "same_room", None, ((0,), (1,)))


def test_back_to_back_surfaces_are_a_wall_and_see_nothing(detector: Detector) -> None:
    explained = explained_pair(plan(*TWO_ROOMS), detector, 1, 7)
    assert explained.sight == Sight(16, 0, 16, ())
    assert relation(explained, "wall").shared == (0,)
    assert relation(explained, "room").shared == ()


# -- pairs -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("one", "two"), [(3, 5), (5, 3), (0, 2), (1, 7), (12, 1)])
def test_a_pair_is_explained_alike_in_both_orders(one: int, two: int, detector: Detector) -> None:
    graph = detector.infer(block(0.15))
    there, back = explain_pair(graph, detector, one, two), explain_pair(graph, detector, two, one)
    assert there.sight == back.sight
    for ahead, behind in zip(there.relations, back.relations, strict=True):
        assert ahead.nodes == behind.nodes[::-1]
        assert ahead.shared == behind.shared
        assert (ahead.link is None) == (behind.link is None)


def test_the_probability_is_the_scored_one(detector: Detector) -> None:
    graph = detector.infer(plan(*TWO_ROOMS))
    scene = build_scene(graph.wall_surfaces.ordered())
    edges = detector.score(detector.registry["room"], scene)
    for (one, two), logit, probability in zip(
        scene.pairs.tolist(), edges.logits.tolist(), edges.probabilities.tolist(), strict=True
    ):
        link = relation(explain_pair(graph, detector, one, two), "room").link
        assert link is not None
        assert link.logit == pytest.approx(logit)
        assert link.probability == pytest.approx(probability)


def test_scored_for_but_apart_the_links_between_both_nodes_are_added_up() -> None:
    graph = plan(*TWO_ROOMS)
    zones = detector_of_two_zones()
    found = relation(explained_pair(graph, zones, 1, 7), "zone")
    assert found.nodes == ((0,), (1,))
    assert found.balance is not None
    pairs = build_scene(graph.wall_surfaces.ordered()).pairs
    crossing = [(one, two) for one, two in pairs.tolist() if one < 4 <= two]
    assert sorted((link.one, link.two) for link in found.balance.links) == crossing
    assert found.balance.total == len(crossing)  # every pair is scored +1
    assert found.balance.mean_probability == pytest.approx(1 / (1 + np.exp(-1)))


def test_scored_for_but_apart_a_surface_in_no_node_is_named_with_its_links() -> None:
    graph = plan(*TWO_ROOMS)
    zones = detector_of_two_zones(clusterer="zone:first_node")
    found = relation(explained_pair(graph, zones, 1, 7), "zone")
    assert (found.nodes, found.balance) == (((0,), ()), None)
    ((stray, support),) = found.strays
    assert stray == 7
    pairs = build_scene(graph.wall_surfaces.ordered()).pairs
    assert sorted(link.two for link in support.links) == sorted(
        sum(pair) - 7 for pair in pairs.tolist() if 7 in pair
    )


def test_scored_against_but_together_the_links_to_the_rest_of_the_node_are_added_up() -> None:
    zones = detector_of_two_zones(baseline="zone:nothing")
    found = relation(explained_pair(plan(*TWO_ROOMS), zones, 0, 2), "zone")
    assert found.shared == (0,)
    assert found.balance is not None
    assert found.balance.links == tuple(
        Link(0, other, -1.0, pytest.approx(0.269, abs=1e-3)) for other in (1, 2, 3)
    )
    assert found.balance.total == -3.0


def test_what_counts_is_the_score_and_not_the_calibrated_probability() -> None:
    registry, installed_room = new_registry(), installed()["room"]
    head = HeadSpec(weights="room.onnx", encoder="1", intercept=-20.0, slope=1.0)
    spec = installed_room.spec.model_copy(update={"head": head})
    registry.add(spec, package=installed_room.package)
    found = relation(explained_pair(plan(rectangle(0, 0, 5, 4)), Detector(registry), 0, 2), "room")
    assert found.link is not None
    assert found.link.probability < 0.5
    assert found.link.scored_for
    assert (found.shared, found.balance) == ((0,), None)


def test_what_the_clusterer_agrees_with_is_not_balanced() -> None:
    zones = detector_of_two_zones()
    assert relation(explained_pair(plan(*TWO_ROOMS), zones, 0, 2), "zone").balance is None


def test_a_surface_mapped_twice_is_explained_as_such(detector: Detector) -> None:
    graph = plan(*TWO_ROOMS)
    graph.add_wall_surface(50, [[5.02, 0.1], [5.02, 4]], [-1, 0])
    graph = detector.infer(graph)
    assert explain_pair(graph, detector, 50, 1) == PairExplanation(50, 1, {50: 1}, 0.0, None, ())
    wall = relation(explain_pair(graph, detector, 50, 7), "wall")
    assert wall.shared == (1,)
    room = explain_node(graph, detector, "room", 0)
    kept, copy = room.members[1], room.members[4]
    assert copy == Member(50, 1, kept.support)
    copied_wall = explain_node(graph, detector, "wall", 1)
    assert [member.id for member in copied_wall.members] == [7, 50]
    assert all(len(member.support.links) == 1 for member in copied_wall.members)


# -- pins ------------------------------------------------------------------------------------------


def pinned_block() -> SGraph:
    """Return the block, 0 and 12 of its first and last room pinned together, 0 and 1 apart."""
    graph = block(0.15)
    graph.pins = Pins(((0, 12),), ((0, 1),))
    return graph


@pytest.mark.parametrize(
    ("one", "two", "pinned"),
    [(0, 1, "apart"), (12, 1, "apart"), (0, 12, "together"), (2, 3, None), (1, 14, None)],
)
def test_a_pin_explains_a_pair_directly_or_over_others(
    one: int, two: int, pinned: str | None, detector: Detector
) -> None:
    graph = detector.infer(pinned_block())
    for pair in ((one, two), (two, one)):
        explained = explain_pair(graph, detector, *pair)
        room = relation(explained, "room")
        assert room.pinned == pinned
        assert bool(room.shared) == (pinned == "together" or pair in ((2, 3), (3, 2)))
        assert relation(explained, "wall").pinned is None
        assert pinned is None or (room.balance, room.strays) == (None, ())


def test_what_is_pinned_in_is_not_the_weakest(detector: Detector) -> None:
    graph = detector.infer(pinned_block())
    explained = explain_node(graph, detector, "room", 0)
    pinned = {member.id: member.pinned for member in explained.members}
    assert pinned == {0: (12,), 12: (0,), 13: (), 14: (), 15: ()}
    totals = {member.id: member.support.total for member in explained.members}
    assert min(totals, key=lambda member: totals[member]) == 0
    assert explained.weakest in (13, 14, 15)


def test_a_surface_outside_that_is_pinned_apart_is_marked(detector: Detector) -> None:
    graph = detector.infer(pinned_block())
    outsider = explain_node(graph, detector, "room", 1).outsider
    assert outsider is not None
    assert (outsider.id, outsider.pinned) == (0, (1,))
    assert outsider.support.total > 0


def test_a_copys_pins_explain_its_original(detector: Detector) -> None:
    graph = block(0.15)
    graph.add_wall_surface(50, [[5.02, 0.1], [5.02, 4]], [-1, 0])  # repeats 1
    graph.pins = Pins((), ((50, 2),))
    graph = detector.infer(graph)
    for surface in (1, 50):
        assert relation(explain_pair(graph, detector, surface, 2), "room").pinned == "apart"
        assert relation(explain_pair(graph, detector, surface, 3), "room").pinned is None


def test_a_split_surface_that_shares_a_room_all_the_same_is_not_called_pinned_apart(
    detector: Detector,
) -> None:
    graph = two_rooms_on_one_surface()
    graph.pins = Pins(((0, 1),), ((1, 4),))
    graph = detector.infer(graph)
    room = relation(explain_pair(graph, detector, 0, 4), "room")
    assert len(room.shared) == 1
    assert room.pinned is None


# -- nodes -----------------------------------------------------------------------------------------


def hidden_east_side() -> SGraph:
    """Return a room of 6 x 4 m with a panel in front of the middle of its east side, surface 1."""
    graph = plan(rectangle(0, 0, 6, 4))
    graph.add_wall_surface(10, [[5.4, 1], [5.4, 3]], [-1, 0])
    return graph


def test_the_member_that_is_hidden_most_is_the_weakest(baseline: Detector) -> None:
    explained = explain_node(baseline.infer(hidden_east_side()), baseline, "room", 0)
    assert [member.id for member in explained.members] == [0, 1, 2, 3, 10]
    assert explained.weakest == 1


def test_support_is_the_sum_of_the_links_to_the_other_members(baseline: Detector) -> None:
    graph = baseline.infer(hidden_east_side())
    scene = build_scene(graph.wall_surfaces.ordered())
    edges = baseline.score(baseline.registry["room"], scene)
    for row, member in enumerate(explain_node(graph, baseline, "room", 0).members):
        own = (scene.pairs == row).any(axis=1)
        assert member.support.total == pytest.approx(edges.logits[own].sum())
        assert member.support.mean_probability == pytest.approx(edges.probabilities[own].mean())
        assert member.support.links[0].logit == edges.logits[own].max()


def test_a_wall_has_no_weakest_side(detector: Detector) -> None:
    explained = explain_node(detector.infer(plan(*TWO_ROOMS)), detector, "wall", 0)
    assert explained.weakest is None
    assert explained.border == ()


def test_the_strongest_outsider_belongs_more_to_its_own_room(detector: Detector) -> None:
    whole = plan(*TWO_ROOMS).wall_surfaces
    graph = SGraph()
    for row in (0, 2, 3, 4, 5, 6):
        graph.add_wall_surface(row, whole.segments[row], whole.normals[row])
    for number, (x, normal) in enumerate([(5, -1), (5.15, 1)]):  # a door of 0.9 m
        graph.add_wall_surface(10 + number, [[x, 0], [x, 1.5]], [normal, 0])
        graph.add_wall_surface(12 + number, [[x, 2.4], [x, 4]], [normal, 0])
    explained = explain_node(detector.infer(graph), detector, "room", 0)
    assert [member.id for member in explained.members] == [0, 2, 3, 10, 12]
    outsider = explained.outsider
    assert outsider is not None
    assert outsider.own is not None
    assert outsider.id in (4, 5, 6, 11, 13)
    assert outsider.support.total < 0 < outsider.own.total
    (door,) = explained.border
    assert door.opening.kind == "door"
    assert door.opening.lengths_m == pytest.approx([0.9])
    assert (door.facing, door.behind) == ((), ())


def test_pieces_of_a_surface_count_only_for_the_room_that_they_are_in(detector: Detector) -> None:
    graph = detector.infer(two_rooms_on_one_surface())
    for node_id, others in ((0, {1, 2, 3}), (1, {4, 5, 6})):
        explained = explain_node(graph, detector, "room", node_id)
        assert {link.two for link in explained.members[0].support.links} == others
        assert explained.border == ()
    east = explain_pair(graph, detector, 0, 4)
    assert east.sight is not None
    assert east.sight.free == east.sight.lines
    assert relation(east, "room").nodes == ((0, 1), (1,))


@pytest.mark.parametrize("offset", [(0.0, 0.0), (5e5, 5.4e6)])
def test_an_open_side_names_what_else_lies_along_it(
    offset: tuple[float, float], baseline: Detector
) -> None:
    whole = plan(*TWO_ROOMS, offset=offset).wall_surfaces
    graph = SGraph()
    for row in (0, 2, 3, 4, 5, 6, 7):  # the first room's east side is missing
        graph.add_wall_surface(row, whole.segments[row], whole.normals[row])
    explained = explain_node(baseline.infer(graph), baseline, "room", 0)
    assert [member.id for member in explained.members] == [0, 2, 3]
    (side,) = explained.border
    assert side.opening.kind == "open side"
    expected = np.array([[5, 4], [5, 0]]) + offset
    assert side.opening.segments[0] == pytest.approx(expected, abs=1e-5)
    assert (side.facing, side.behind) == ((), (7,))


# -- what cannot be explained ----------------------------------------------------------------------


def test_unknown_and_equal_surfaces_are_named(detector: Detector) -> None:
    graph = detector.infer(plan(*TWO_ROOMS))
    with pytest.raises(InputError, match="there is no wall surface 99"):
        explain_pair(graph, detector, 99, 1)
    with pytest.raises(InputError, match="wall surface 1 is compared with itself"):
        explain_pair(graph, detector, 1, 1)


def test_unknown_nodes_and_concepts_are_named(detector: Detector) -> None:
    graph = detector.infer(plan(*TWO_ROOMS))
    with pytest.raises(InputError, match="there is no room 9"):
        explain_node(graph, detector, "room", 9)
    with pytest.raises(ConceptError, match="there is no concept 'roof'"):
        explain_node(graph, detector, "roof", 0)


def test_a_node_that_inference_does_not_find_is_refused(detector: Detector) -> None:
    graph = plan(*TWO_ROOMS)
    graph.concepts = {"room": [ConceptNode(4, (0, 1, 7))]}
    with pytest.raises(InputError, match="room 4 is not what inference finds in this map"):
        explain_node(graph, detector, "room", 4)


def test_a_concept_that_groups_nodes_is_refused() -> None:
    zones = detector_of_two_zones()
    zones.registry.add(
        ConceptSpec(
            name="floor",
            groups="zone",
            relation="same_floor",
            baseline="zone:everything",
            clusterer="zone:one_node",
        )
    )
    graph = zones.infer(plan(*TWO_ROOMS))
    with pytest.raises(ConceptError, match="'floor' groups zones, not wall surfaces"):
        explain_node(graph, zones, "floor", 0)
    assert [r.concept for r in explain_pair(graph, zones, 0, 1).relations] == ["zone"]
