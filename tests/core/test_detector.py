"""What `infer` finds: right rooms and right walls, wherever the map lies."""

from __future__ import annotations

import random

import numpy as np
import pytest
from plans import (
    L_SHAPE,
    block,
    members,
    plan,
    rectangle,
    regular,
    true_rooms,
    true_walls,
    two_rooms_on_one_surface,
)

from sgraph_concepts.errors import ConceptError
from sgraph_concepts.spec import ConceptSpec
from sgraph_concepts.types import ConceptNode, NodeShape
from sgraph_core import map_file
from sgraph_core.concepts import new_registry
from sgraph_core.detector import Detector
from sgraph_core.graph import Pins, SGraph

TWO_ROOMS = (rectangle(0, 0, 10, 8), rectangle(10.15, 0, 10, 8))

PLANS: dict[str, SGraph] = {
    "one rectangle": plan(rectangle(0, 0, 5, 4)),
    "a corridor of 15 x 2 m": plan(rectangle(0, 0, 15, 2)),
    "two adjacent rooms of 10 x 8 m": plan(*TWO_ROOMS, walls=[(1, 7)]),
    "a 6 cm wall": plan(rectangle(0, 0, 5, 4), rectangle(5.06, 0, 5, 4), walls=[(1, 7)]),
    "a block at exactly 45 degrees": block(0.15, np.pi / 4),
    "a triangle": plan([(0, 0), (6, 0), (2, 5)]),
    "an octagon": plan(regular(8, 4)),
    "ids from 100": plan(*TWO_ROOMS, walls=[(1, 7)], first_id=100),
    "a block in UTM coordinates": block(0.1, 0.4, (500_000.0, 5_400_000.0)),
    "a toilet": plan(rectangle(0, 0, 1.2, 0.9)),
    "a hall": plan(rectangle(0, 0, 40, 25)),
    **{
        f"an L at {degrees} degrees": plan(L_SHAPE, angle_rad=np.radians(degrees))
        for degrees in range(0, 360, 15)
    },
}


@pytest.mark.parametrize("name", PLANS)
def test_rooms_and_walls_of_simple_plans_are_exact(name: str, detector: Detector) -> None:
    result = detector.infer(PLANS[name])
    assert members(result, "room") == true_rooms(PLANS[name])
    assert members(result, "wall") == true_walls(PLANS[name])


@pytest.mark.parametrize("name", [n for n in PLANS if not n.startswith("an L")])
def test_the_baseline_finds_convex_rooms_and_walls(name: str, baseline: Detector) -> None:
    result = baseline.infer(PLANS[name])
    assert members(result, "room") == true_rooms(PLANS[name])
    assert members(result, "wall") == true_walls(PLANS[name])


def test_algorithm_1_may_be_chosen(detector: Detector) -> None:
    cycles = Detector(clusterers={"room": "cycles"})
    graph = PLANS["two adjacent rooms of 10 x 8 m"]
    assert members(cycles.infer(graph), "room") == true_rooms(graph)


def test_empty_maps_and_lone_surfaces_have_no_concepts(detector: Detector) -> None:
    assert detector.infer(SGraph()).concepts == {"room": [], "wall": []}
    lone = SGraph()
    lone.add_wall_surface(3, [[0, 0], [4, 0]], [0, 1])
    assert detector.infer(lone).concepts == {"room": [], "wall": []}


def test_the_given_graph_is_not_changed_and_its_truth_not_read(detector: Detector) -> None:
    graph = block(0.15)
    graph.truth = None
    assert members(detector.infer(graph), "room") == true_rooms(block(0.15))
    assert graph.concepts == {}


def test_the_order_of_surfaces_does_not_matter(detector: Detector) -> None:
    graph = block(0.15)
    expected = detector.infer(graph)
    table = graph.wall_surfaces
    rows = list(range(len(table.ids)))
    shuffler = random.Random(0)
    for _ in range(5):
        shuffler.shuffle(rows)
        shuffled = SGraph()
        for row in rows:
            segment = table.segments[row][:: shuffler.choice([1, -1])]
            shuffled.add_wall_surface(int(table.ids[row]), segment, table.normals[row])
        result = detector.infer(shuffled)
        for concept in ("room", "wall"):
            pairs = zip(result.concepts[concept], expected.concepts[concept], strict=True)
            for found, wanted in pairs:
                assert (found.id, found.members) == (wanted.id, wanted.members)
                assert found.confidence == pytest.approx(wanted.confidence, abs=1e-5)
                assert found.shape.centre == pytest.approx(wanted.shape.centre, abs=1e-9)


@pytest.mark.parametrize("angle", [0.0, 0.5, 2.0])
@pytest.mark.parametrize("offset", [(0.0, 0.0), (5e5, 5.4e6)])
def test_shapes_move_and_turn_with_the_map(
    angle: float, offset: tuple[float, float], detector: Detector
) -> None:
    graph = plan(L_SHAPE, angle_rad=angle, offset=offset)
    (room,) = detector.infer(graph).concepts["room"]
    assert graph.truth is not None
    assert room.shape.polygon is not None
    found = sorted(room.shape.polygon)
    assert found == [pytest.approx(p, abs=1e-5) for p in sorted(graph.truth.rooms[0].polygon or ())]
    assert room.shape.attributes["area_m2"] == pytest.approx(8 * 3 + 4 * 4, abs=1e-3)


def test_a_surface_through_two_rooms_belongs_to_both(detector: Detector) -> None:
    result = detector.infer(two_rooms_on_one_surface())
    assert members(result, "room") == {frozenset({0, 1, 2, 3}), frozenset({0, 4, 5, 6})}
    assert members(result, "wall") == {frozenset({1, 6})}


def test_a_surface_mapped_twice_is_a_member_twice(detector: Detector) -> None:
    graph = plan(rectangle(0, 0, 5, 4), rectangle(5.2, 0, 5, 4), walls=[(1, 7)])
    graph.add_wall_surface(50, [[5.02, 0.1], [5.02, 4]], [-1, 0])
    result = detector.infer(graph)
    assert members(result, "room") == {frozenset({0, 1, 2, 3, 50}), frozenset({4, 5, 6, 7})}
    assert members(result, "wall") == {frozenset({1, 7}), frozenset({50, 7})}


def test_ids_and_names_persist_when_the_map_grows(detector: Detector) -> None:
    first = detector.infer(plan(rectangle(0, 0, 5, 4), first_id=4))
    (room,) = first.concepts["room"]
    grown = plan(rectangle(-5.1, 0, 5, 4), rectangle(0, 0, 5, 4))
    grown.concepts = {"room": [ConceptNode(17, room.members, "kitchen")]}
    found = {node.id: node for node in detector.infer(grown).concepts["room"]}
    assert found[17].members == room.members
    assert found[17].name == "kitchen"
    assert sorted(found) == [17, 18]


def test_a_map_with_the_largest_id_is_written_readable(detector: Detector) -> None:
    graph = block(0.15)
    graph.concepts = {"room": [ConceptNode(2**53 - 1, (0, 1, 2, 3))]}
    written = map_file.parse(map_file.dump(detector.infer(graph)).encode())
    assert {node.id for node in written.concepts["room"]} == {0, 1, 2, 2**53 - 1}


def test_names_that_a_person_pinned_win(detector: Detector) -> None:
    graph = plan(rectangle(0, 0, 5, 4))
    graph.pins = Pins(room_names={0: "lab"})
    assert detector.infer(graph).concepts["room"][0].name == "lab"


def test_only_the_wanted_concepts_are_inferred(detector: Detector) -> None:
    graph = block(0.15)
    stored = [ConceptNode(3, (1, 7), shape=NodeShape(thickness=9.0))]
    graph.concepts = {"wall": stored, "lift": [ConceptNode(0, (1, 2))]}
    result = detector.infer(graph, ["room"])
    assert len(result.concepts["room"]) == 4
    assert result.concepts["wall"] == stored
    assert result.concepts["lift"] == [ConceptNode(0, (1, 2))]


# -- concepts of one's own: the parts are in tests/support/zone.py -----------------------------


def detector_with(**parts: str) -> Detector:
    registry = new_registry()
    declared = {
        "relation": "same_zone",
        "baseline": "zone:everything",
        "clusterer": "zone:one_node",
    }
    registry.add(ConceptSpec(name="zone", **{**declared, **parts}))
    declared["relation"] = "same_floor"
    registry.add(ConceptSpec(name="floor", groups="zone", **declared))
    return Detector(registry)


def test_a_concept_may_group_another_ones_nodes() -> None:
    result = detector_with().infer(block(0.1))
    (zone,), (floor,) = result.concepts["zone"], result.concepts["floor"]
    assert zone.members == tuple(range(16))
    assert floor.members == (zone.id,)
    assert floor.shape.centre == pytest.approx(zone.shape.centre)
    assert result.networkx()[("floor", 0)][("zone", 0)]["link"] == "member"


def test_shapes_are_made_together_and_know_the_ids() -> None:
    graph = block(0.1)
    graph.concepts = {"zone": [ConceptNode(7, (0, 1, 2, 3))]}
    zones = detector_with(clusterer="zone:two_nodes", shape="zone:boxed").infer(graph)
    shapes = {node.id: node.shape for node in zones.concepts["zone"]}
    origin = graph.wall_surfaces.segments.reshape(-1, 2)
    middle = (origin.min(axis=0) + origin.max(axis=0)) / 2
    assert shapes[7].attributes == {"others": [8]}
    assert shapes[8].attributes == {"others": [7]}
    assert shapes[7].centre == pytest.approx((middle[0], middle[1] + 4))
    assert shapes[8].centre == pytest.approx((middle[0], middle[1] + 12))


def test_where_there_are_no_nodes_to_group_there_is_none() -> None:
    result = detector_with(clusterer="zone:no_nodes").infer(block(0.1))
    assert result.concepts == {"zone": [], "floor": []}


@pytest.mark.parametrize(
    ("part", "message"),
    [
        ({"baseline": "zone:too_few"}, r"baseline of concept 'zone' must return \d+ finite"),
        ({"clusterer": "zone:nowhere"}, "clusterer of concept 'zone' returned a row that does not"),
        ({"clusterer": "zone:overlapping"}, "put a row into two clusters"),
        ({"clusterer": "zone:nobody"}, "returned a cluster without members"),
        ({"clusterer": "zone:too_sure"}, "returned a confidence that is not from 0 to 1"),
        ({"clusterer": "zone:bare_rows"}, "must return a list of Cluster"),
        ({"clusterer": "os:getcwd"}, r"clusterer of concept 'zone' fails: .*arguments"),
        ({"clusterer": "os:name"}, "clusterer of concept 'zone' fails: 'str' object is not"),
        ({"clusterer": "published"}, r"nor a built-in \(known: cycles\)"),
        ({"baseline": "os:getcwd"}, "baseline of concept 'zone' fails"),
        ({"shape": "os:getcwd"}, "shape of concept 'zone' fails"),
        ({"shape": "zone:no_shape"}, "shape of concept 'zone' must return a mapping"),
        ({"shape": "zone:shapeless"}, "must return a NodeShape for every node, but .* none for 0"),
        ({"shape": "zone:missing"}, "has no attribute 'missing'"),
    ],
)
def test_nonsense_from_a_plugin_is_named(part: dict[str, str], message: str) -> None:
    with pytest.raises(ConceptError, match=message):
        detector_with(**part).infer(block(0.1))


def test_unknown_concepts_are_named(detector: Detector) -> None:
    with pytest.raises(ConceptError, match="there is no concept 'roof'"):
        detector.infer(SGraph(), ["roof"])
    with pytest.raises(ConceptError, match="there is no concept 'roof'"):
        Detector(clusterers={"roof": "cycles"})
