"""Pins in a ConceptTracker: what a person corrects while the map is built."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plans import add_outline, block, rectangle, true_rooms, two_rooms_on_one_surface
from tracked import add, assert_as_inferred_at_once, building, eastwards

from sgraph_concepts.errors import ConceptError, InputError
from sgraph_core.detector import Detector
from sgraph_core.evaluation.incremental import drive_through
from sgraph_core.graph import Pins, SGraph
from sgraph_core.slam import ConceptTracker, Work

Pairs = tuple[tuple[int, int], ...]


def rooms(tracker: ConceptTracker) -> set[frozenset[int]]:
    return {frozenset(node.members) for node in tracker.nodes("room")}


def drawn_pins(graph: SGraph, rng: np.random.Generator, count: int) -> Pins:
    """Return pairs of surfaces near each other, as far as they do not contradict one another."""
    ids, middles = graph.wall_surfaces.ids, graph.wall_surfaces.segments.mean(axis=1)
    pins = Pins()
    while len(pins.same_room) + len(pins.not_same_room) < count:
        one = int(rng.integers(len(ids)))
        near = np.argsort(np.linalg.norm(middles - middles[one], axis=1))[1:15]
        pair = (int(ids[one]), int(ids[rng.choice(near)]))
        kind = str(rng.choice(["same_room", "not_same_room"]))
        more = replace(pins, **{kind: (*getattr(pins, kind), pair)})
        try:
            ConceptTracker().pin(more)
        except InputError:
            continue
        pins = more
    return pins


# -- equality with whole inference ---------------------------------------------------------------


@pytest.mark.parametrize("seed", range(4))
def test_every_step_of_a_pinned_map_is_as_inferred_at_once(seed: int, detector: Detector) -> None:
    """The pins are there from the beginning and wait for their surfaces."""
    graph, rng = building(seed), np.random.default_rng(seed)
    tracker = ConceptTracker(detector=detector)
    tracker.pin(drawn_pins(graph, rng, 12))
    order = eastwards(graph, rng)
    for start in range(0, len(order), 15):
        add(tracker, graph, order[start : start + 15])
        assert_as_inferred_at_once(tracker, detector)
    assert tracker.snapshot().pins == tracker.pins


@pytest.mark.parametrize("seed", range(4))
def test_pins_that_come_and_go_are_as_inferred_at_once(seed: int, detector: Detector) -> None:
    graph, rng = building(seed), np.random.default_rng(seed)
    tracker = ConceptTracker(detector=detector)
    add(tracker, graph, graph.wall_surfaces.ids.tolist())
    unpinned = rooms(tracker)
    for _ in range(6):
        tracker.pin(drawn_pins(graph, rng, int(rng.integers(1, 12))))
        tracker.update()
        assert_as_inferred_at_once(tracker, detector)
    tracker.pin(Pins())
    tracker.update()
    assert rooms(tracker) == unpinned


def test_a_tracker_of_a_pinned_map_finds_what_inference_finds(detector: Detector) -> None:
    graph = block(0.15)
    graph.pins = Pins(same_room=((0, 12),), not_same_room=((4, 6),), room_names={1: "kitchen"})
    tracker = ConceptTracker(graph, detector)
    tracker.update()
    whole = detector.infer(graph)
    assert [(n.id, n.name, n.members) for n in tracker.nodes("room")] == [
        (n.id, n.name, n.members) for n in whole.concepts["room"]
    ]
    assert tracker.snapshot().pins == graph.pins


def with_copies() -> SGraph:
    """Two rooms on surface 0; 8 repeats 1, 9 repeats 0."""
    graph = two_rooms_on_one_surface()
    graph.add_wall_surface(8, [[5.02, 0.1], [5.02, 4]], [-1, 0])
    graph.add_wall_surface(9, [[0.2, -0.02], [10, -0.02]], [0, 1])
    return graph


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    ("same", "apart"),
    [
        pytest.param([(8, 5)], [], id="a copy"),
        pytest.param([], [(1, 8)], id="a copy apart from its original"),
        pytest.param([(8, 5)], [(1, 5)], id="a copy where its original must not be"),
        pytest.param([(9, 4), (0, 2)], [(9, 2)], id="a split copy apart from its original"),
        pytest.param([(1, 8)], [(1, 2), (1, 3), (8, 0)], id="a copy with its original only"),
        pytest.param([(8, 9)], [(0, 1)], id="copies together whose originals are apart"),
    ],
)
def test_surfaces_mapped_twice_share_their_pins(
    same: Pairs, apart: Pairs, seed: int, baseline: Detector
) -> None:
    graph = with_copies()
    tracker = ConceptTracker(detector=baseline)
    tracker.pin(Pins(tuple(same), tuple(apart)))
    for surface in np.random.default_rng(seed).permutation(graph.wall_surfaces.ids).tolist():
        add(tracker, graph, [surface])
        assert_as_inferred_at_once(tracker, baseline)
    tracker.pin(Pins())
    tracker.update()
    assert_as_inferred_at_once(tracker, baseline)


# -- while the map is built ------------------------------------------------------------------------


def test_a_pair_waits_for_its_surfaces(detector: Detector) -> None:
    graph, tracker = block(0.15), ConceptTracker(detector=detector)
    pins = Pins(same_room=((0, 12),))
    tracker.pin(pins)
    add(tracker, graph, range(12))
    assert frozenset(range(4)) in rooms(tracker)
    assert tracker.pins == pins
    assert tracker.snapshot().pins == Pins()
    add(tracker, graph, range(12, 16))
    assert any(room >= {0, 12} for room in rooms(tracker))
    assert tracker.snapshot().pins == pins


def test_a_merged_room_keeps_its_name_and_its_parts_get_other_ids(detector: Detector) -> None:
    graph, tracker = block(0.15), ConceptTracker(detector=detector)
    add(tracker, graph, range(16))
    named = next(node for node in tracker.nodes("room") if 12 in node.members)
    tracker.pin(Pins(room_names={named.id: "office"}))
    assert [n.name for n in tracker.update().nodes["room"].changed] == ["office"]
    four = tuple((k, k + 12) for k in range(4))
    tracker.pin(replace(tracker.pins, same_room=four))
    changes = tracker.update().nodes["room"]
    (merged,) = changes.changed
    assert (merged.id, merged.name, merged.members) == (
        named.id,
        "office",
        (0, 1, 2, 3, 12, 13, 14, 15),
    )
    assert len(changes.removed) == 1
    tracker.pin(replace(tracker.pins, same_room=()))
    tracker.update()
    assert rooms(tracker) == true_rooms(graph)
    assert named.id in {node.id for node in tracker.nodes("room")}
    assert changes.removed[0].id not in {node.id for node in tracker.nodes("room")}


def test_a_name_is_for_the_room_of_that_id_and_stays_when_it_is_no_longer_pinned(
    detector: Detector,
) -> None:
    graph, tracker = block(0.15), ConceptTracker(detector=detector)
    tracker.pin(Pins(room_names={0: "hall", 2: "never"}))
    add(tracker, graph, range(4))
    add(tracker, graph, range(4, 16))
    names = {node.id: node.name for node in tracker.nodes("room")}
    assert names == {0: "hall", 1: None, 3: None, 4: None}, "a named id is no new room's"
    tracker.pin(Pins())
    assert not tracker.update().nodes["room"]
    assert tracker.nodes("room")[0].name == "hall"


def test_pins_that_change_compute_their_neighbourhood_again(detector: Detector) -> None:
    work = []
    for rooms_in_a_row in (20, 120):
        tracker, before = ConceptTracker(detector=detector), None
        for visit in drive_through(rooms_in_a_row, rooms_in_a_row):
            visit.enter(tracker, before)
            before = visit
        tracker.placed(range(tracker.update().factors.size()))
        one, two = (node.members for node in tracker.nodes("room")[:2])
        tracker.pin(Pins(same_room=((one[0], two[0]),)))
        update = tracker.update()
        assert update.nodes["room"]
        work.append(update.work)
        tracker.placed(range(update.factors.size()))
        tracker.pin(tracker.pins)
        assert tracker.update().work == Work()
    assert work[1].surfaces <= work[0].surfaces < 40
    assert work[1].rows == work[1].pairs == 0, "nothing is scored again"
    assert work[1].clustered <= work[0].clustered < 80


def test_an_update_that_fails_makes_up_for_the_pins(
    detector: Detector, monkeypatch: pytest.MonkeyPatch
) -> None:
    graph, tracker = block(0.15), ConceptTracker(detector=detector)
    add(tracker, graph, range(16))
    pins = Pins(same_room=((0, 12),))
    tracker.pin(pins)
    with monkeypatch.context() as patch:
        patch.setattr("sgraph_core.detector.pin", broken)
        with pytest.raises(ConceptError, match="not today"):
            tracker.update()
    assert rooms(tracker) == true_rooms(graph)
    tracker.update()
    assert_as_inferred_at_once(tracker, detector)
    assert any(room >= {0, 12} for room in rooms(tracker))


def broken(*_: object) -> object:
    raise ConceptError("not today")


# -- what is refused -----------------------------------------------------------------------------

BAD = {
    r"pins.not_same_room\[0\] = \[1, 3\]: contradicts same_room \[1, 2\], \[2, 3\]": Pins(
        ((1, 2), (2, 3)), ((1, 3),)
    ),
    r"pins.not_same_room\[0\] = \[90, 92\]: contradicts same_room": Pins(
        ((90, 91), (91, 92)), ((90, 92),)
    ),
    r"pins.same_room\[0\] = \[4, 4\]: must be two surfaces": Pins(((4, 4),)),
    r"pins.same_room\[0\]\[1\] = -1: must be an integer from 0": Pins(((4, -1),)),
    r"pins.same_room\[0\]\[0\] = 1.5: must be an integer": Pins(((1.5, 2),)),  # type: ignore[arg-type]
    r"pins.not_same_room\[0\]\[1\] = True: must be an integer": Pins((), ((1, True),)),
    r"pins.same_room\[0\] = \(1, 2, 3\): must be a tuple of two": Pins(((1, 2, 3),)),  # type: ignore[arg-type]
    r"pins.same_room\[0\] = 7: must be a tuple of two": Pins((7,)),  # type: ignore[arg-type]
    r"pins.room_names = a: key must be an integer": Pins(room_names={"a": "x"}),  # type: ignore[dict-item]
    r"pins.room_names\[0\] = 5: must be text": Pins(room_names={0: 5}),  # type: ignore[dict-item]
}


@pytest.mark.parametrize("message", BAD)
def test_pins_that_break_a_rule_change_nothing(message: str, detector: Detector) -> None:
    graph, tracker = block(0.15), ConceptTracker(detector=detector)
    good = Pins(same_room=((0, 12),))
    tracker.pin(good)
    add(tracker, graph, range(16))
    before = tracker.snapshot().concepts
    with pytest.raises(InputError, match=message):
        tracker.pin(BAD[message])
    assert tracker.pins == good
    assert not any(tracker.update().nodes.values())
    assert tracker.snapshot().concepts == before
    graph.pins = BAD[message]
    with pytest.raises(InputError, match=message):
        ConceptTracker(graph, detector)


def test_pins_do_not_change_with_what_they_were_made_of(detector: Detector) -> None:
    names = {0: "hall"}
    tracker = ConceptTracker(detector=detector)
    tracker.pin(Pins(room_names=names))
    names[0] = "cellar"
    tracker.pins.room_names[0] = "attic"  # type: ignore[index]
    graph = block(0.15)
    add_outline(graph, rectangle(20, 0, 5, 4), first_id=16)
    add(tracker, graph, range(16, 20))
    assert [node.name for node in tracker.nodes("room")] == ["hall"]
