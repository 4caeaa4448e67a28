"""The rules that nodes keep; ids and names over re-inference."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import gtsam
import numpy as np
import pytest
from drive import drive
from hypothesis import given, settings
from hypothesis import strategies as st
from plans import block

from sgraph_concepts.errors import InputError, MapFileError
from sgraph_concepts.types import ConceptNode, NodeShape
from sgraph_core import map_file
from sgraph_core.backend import concept_factors, optimize
from sgraph_core.detector import Detector
from sgraph_core.graph import SGraph
from sgraph_core.nodes import keep_identity, node_record
from sgraph_core.slam import ConceptTracker
from sgraph_core.slam.nodes import LiveNodes, NodeChanges


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

NAN, INF = float("nan"), float("inf")
RING = ((0, 0), (1, 1), (0, 1))
ENDLESS: dict[str, Any] = {}
ENDLESS["itself"] = ENDLESS


def wrong(**fields: Any) -> ConceptNode:
    return replace(ConceptNode(0, (1, 7)), **fields)


def shaped(*fields: Any, **others: Any) -> ConceptNode:
    return wrong(shape=NodeShape(*fields, **others))


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
    r"\[0\].members\[1\] = '7': must be a valid integer": [wrong(members=(1, "7"))],
    r"\[0\].members\[1\] = 7.0: must be a valid integer": [wrong(members=(1, 7.0))],
    r"\[0\].members\[0\] = True: must be a valid integer": [wrong(members=(True, 7))],
    r"\[0\].members\[0\] = -1: must be greater than or equal to 0": [wrong(members=(-1, 7))],
    r"\[0\].members = 7: must be a valid list": [wrong(members=7)],
    r"\[0\].members = None: must be a valid list": [wrong(members=None)],
    r"\[0\].id = None: must be an integer from 0 to": [wrong(id=None)],
    r"\[0\].name = 5: must be a valid string": [wrong(name=5)],
    r"\[0\].name = '\\ud800': must hold no lone surrogate": [wrong(name="\ud800")],
    r"\[0\].confidence = sure: must be from 0 to 1": [wrong(confidence="sure")],
    r"\[0\].shape = None: must be a NodeShape": [wrong(shape=None)],
    r"\[0\].centre = \[1e\+300, 0.0\]: must be finite, x and y within 1e8": [shaped((1e300, 0.0))],
    r"\[0\].centre = \[1.0\]: must be finite, x and y": [shaped((1.0,))],
    r"\[0\].thickness = nan: must be finite and not negative": [shaped(thickness=NAN)],
    r"\[0\].polygon = \[\[0, 0\], \[1, 1\]\]: must have at least 3": [shaped(None, RING[:2])],
    r"\[0\].polygon\[3\]\[0\] = nan: must be a finite number": [shaped(None, (*RING, (NAN, 0)))],
    r"\[0\].polygon\[3\]\[1\] = 1e\+300: must be less than or": [shaped(None, (*RING, (0, 1e300)))],
    r"\[0\].holes\[1\] = \[\[0, 0\], \[1, 1\]\]: must have": [shaped(holes=(RING, RING[:2]))],
    r"\[0\].attributes.a = {'b': \[0, inf\]}: must be a finite": [
        shaped(attributes={"a": {"b": (0, INF)}})
    ],
    r"\[0\].attributes.a = <.*>: .* a valid JSON value": [shaped(attributes={"a": SGraph()})],
    r"\[0\].attributes.a = R: \[ 1, 0, 0; .* \] t: 0 0 0: .* JSON value": [
        shaped(attributes={"a": gtsam.Pose3()})
    ],
    r"\[0\].attributes.a b = nan: must be a finite": [shaped(attributes={"a\nb": NAN})],
    r"\[0\].attributes.a = 10{76}\.\.\.: must be a finite": [shaped(attributes={"a": 10**400})],
    r"\[0\].attributes.a = \.\.\.: must be a finite": [shaped(attributes={"a": 10**5000})],
    r"\[0\].attributes.a = {'b': \[inf, 0, (0, )+0,\.\.\.: must be a finite": [
        shaped(attributes={"a": {"b": (INF, *[0] * 1000)}})
    ],
    r"\[0\].confidence = a b: must be from 0": [wrong(confidence="a\nb")],
    r"\[0\].id = \.\.\.: must be an integer": [wrong(id=10**5000)],
    r"\[0\].centre = \[10{75}\.\.\.: must be finite": [shaped((10**400, 0.0))],
    r"\[0\].members\[1\] = 10{76}\.\.\.: must be": [wrong(members=(1, 10**400))],
    r"\[0\] = \.\.\.: must be a ConceptNode": [10**5000],  # type: ignore[list-item]
    r"\[0\].attributes\[1\] = 1: must be a valid string": [shaped(attributes={1: 2})],
    r"\[0\].attributes = 7: must be a valid dictionary": [shaped(attributes=7)],
    r"\[0\].attributes = ...: is nested too deeply": [shaped(attributes=ENDLESS)],
}
CALLS: list[Callable[[SGraph, Detector], object]] = [
    lambda graph, detector: detector.infer(graph),
    ConceptTracker,
    lambda graph, _: concept_factors(graph),
    lambda graph, _: optimize(graph),
    lambda graph, _: map_file.dump(graph),
]


@pytest.mark.parametrize("call", CALLS)
@pytest.mark.parametrize("message", BAD)
def test_nodes_that_break_a_rule_are_named(
    message: str, call: Callable[[SGraph, Detector], object], detector: Detector
) -> None:
    graph = block(0.15)
    graph.concepts["wall"] = BAD[message]
    with pytest.raises(InputError, match=r"^concepts\.wall" + message) as caught:
        call(graph, detector)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 200
    assert graph.concepts["wall"] is BAD[message]


def test_the_name_of_a_concept_is_text() -> None:
    graph = block(0.15)
    for name, message in ((" ", None), ("", "at least 1 character"), (1, "must be a valid string")):
        graph.concepts = {name: [ConceptNode(0, (1, 7))]}  # type: ignore[dict-item]
        if message is None:
            assert map_file.parse(map_file.dump(graph).encode()).concepts == graph.concepts
        else:
            with pytest.raises(InputError, match=rf"^concepts.* = .*{message}"):
                map_file.dump(graph)


def test_numbers_and_arrays_of_numpy_are_saved_as_numbers() -> None:
    graph = block(0.15)
    ring = np.array(RING, np.float32)
    numpy = wrong(
        id=np.int64(3),
        members=(np.int64(1), np.int64(7)),
        shape=NodeShape(
            ring[0], ring, np.array([ring]), np.float32(0.5), {"area_m2": np.arange(2)}
        ),
    )
    plain = ConceptNode(
        3, (1, 7), None, NodeShape(RING[0], RING, (RING,), 0.5, {"area_m2": [0, 1]})
    )
    graph.concepts["wall"] = [numpy]
    assert map_file.parse(map_file.dump(graph).encode()).concepts["wall"] == [plain]


def in_numpy(node: ConceptNode) -> ConceptNode:
    """Return a node with its numbers as numpy's, and its tuples of them as arrays."""
    shape = node.shape
    return ConceptNode(
        np.int64(node.id),  # type: ignore[arg-type]
        np.array(node.members),  # type: ignore[arg-type]
        node.name,
        NodeShape(
            None if shape.centre is None else np.array(shape.centre),
            None if shape.polygon is None else np.array(shape.polygon),
            [np.array(hole) for hole in shape.holes],  # type: ignore[arg-type]
            None if shape.thickness is None else np.float64(shape.thickness),
            {name: np.array(value) for name, value in shape.attributes.items()},
        ),
        None if node.confidence is None else np.float64(node.confidence),
    )


def _tracked(graph: SGraph, detector: Detector) -> str:
    tracker = ConceptTracker(graph, detector)
    tracker.update()
    return map_file.dump(tracker.snapshot())


@pytest.mark.parametrize(
    "use",
    [
        lambda graph, detector: map_file.dump(detector.infer(graph)),
        _tracked,
        lambda graph, _: concept_factors(graph).graph.size(),
        lambda graph, _: map_file.dump(optimize(graph).graph),
        lambda graph, _: map_file.dump(graph),
    ],
    ids=["infer", "track", "factors", "optimize", "save"],
)
def test_numbers_and_arrays_of_numpy_are_as_good_as_plain_ones(
    use: Callable[[SGraph, Detector], object], detector: Detector
) -> None:
    plain = detector.infer(drive(0).graph)
    numpy = plain.copy()
    numpy.concepts = {c: [*map(in_numpy, nodes)] for c, nodes in plain.concepts.items()}
    assert use(numpy, detector) == use(plain, detector)


def test_arrays_in_a_node_become_tuples_of_plain_numbers() -> None:
    corners = tuple(map(np.array, RING))
    for polygon in (np.array(RING), corners, list(corners)):
        assert NodeShape(None, polygon).polygon == RING
        assert NodeShape(holes=(polygon,)).holes == (RING,)
    assert ConceptNode(0, np.arange(2)).members == (0, 1)  # type: ignore[arg-type]


def test_while_a_map_grows_arrays_in_attributes_are_compared_by_their_numbers() -> None:
    live = LiveNodes("zone", [shaped(attributes={"at": np.arange(2)})])
    same, other = shaped(attributes={"at": [0, 1]}), shaped(attributes={"at": np.array([0, 2])})
    for changes in (live.shaped(NodeChanges(), {0: same.shape}), live.replaced_by([same])):
        assert not changes
    for changes in (live.shaped(NodeChanges(), {0: other.shape}), live.replaced_by([other])):
        assert changes.changed == [other]


junk = st.sampled_from([NAN, INF, -1, 1e300, "1", True, (), (1.0,), RING, 2**53, 1.5, "\ud800", {}])
number = st.floats(0, 1) | st.integers(0, 10**6)
point = st.tuples(number, number)
ring = st.lists(point | st.just((1.0, 2.0)), min_size=3, max_size=5).map(tuple)
json_values = st.recursive(
    st.none() | st.booleans() | number | st.text(max_size=2) | junk,
    lambda parts: (
        st.lists(parts, max_size=2) | st.dictionaries(st.text(max_size=2), parts, max_size=2)
    ),
    max_leaves=4,
)


def nearly(good: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    """Draw what is good, nothing, and now and then what is not."""
    return st.sampled_from(range(12)).flatmap(lambda k: {0: junk, 1: st.none()}.get(k, good))


shapes = st.builds(
    NodeShape,
    nearly(point),
    nearly(st.lists(nearly(point), min_size=3, max_size=5).map(tuple) | ring),
    nearly(st.lists(nearly(ring), max_size=2).map(tuple)),
    nearly(number),
    nearly(st.dictionaries(st.text(max_size=2), json_values, max_size=2)),
)
members = st.lists(nearly(st.sampled_from([1, 7, 9])), min_size=1, max_size=3).map(tuple)


@given(
    st.builds(
        ConceptNode,
        nearly(st.integers(0, 2**53 - 1)),
        nearly(members),
        nearly(st.text()),
        shapes,
        nearly(st.floats(0, 1)),
    )
)
@settings(deadline=None, max_examples=500)
def test_what_is_saved_can_be_read_and_what_is_refused_could_not(node: ConceptNode) -> None:
    graph = block(0.15)
    document = json.loads(map_file.dump(graph))
    graph.concepts["zone"] = [node]
    written = json.dumps(document | {"concepts": {"zone": [node_record(node)]}}).encode()
    refused, text = "", ""
    try:
        text = map_file.dump(graph)
    except InputError as error:
        refused = str(error)
    if not refused:
        map_file.parse(text.encode())
        map_file.parse(written)
        return
    assert re.fullmatch(r"concepts\.zone\[0\]\.\w+.* = .+: .+", refused)
    with pytest.raises(MapFileError):
        map_file.parse(written)


def test_nodes_of_other_concepts_may_group_nodes() -> None:
    graph = block(0.15)
    graph.concepts["floor"] = [ConceptNode(40, (41,))]
    graph.concepts["zone"] = [ConceptNode(41, (40, 3))]
    assert concept_factors(graph).graph.size() == 0
    graph.concepts["zone"] = [ConceptNode(41, (40, 42))]
    with pytest.raises(InputError, match=r"concepts\.zone\[0\]\.members\[1\] = 42: must be the id"):
        concept_factors(graph)
