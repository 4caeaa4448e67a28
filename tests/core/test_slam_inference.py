"""What a ConceptTracker infers while the map changes is what inference on the whole map finds."""

from __future__ import annotations

from dataclasses import astuple, replace
from pathlib import Path

import numpy as np
import pytest
from floors import grid_of
from plans import add_outline, block, plan, rectangle, true_rooms, true_walls
from tracked import add, assert_as_inferred_at_once, building, eastwards

import sgraph_plugins.room.outline
from sgraph_concepts.errors import InputError
from sgraph_concepts.registry import RegisteredConcept
from sgraph_concepts.spec import ConceptSpec
from sgraph_concepts.types import (
    Cluster,
    ConceptNode,
    FloatArray,
    Scene,
    ScoredEdges,
    SurfaceArrays,
)
from sgraph_core import load
from sgraph_core.concepts import installed, new_registry
from sgraph_core.detector import Detector, Inference
from sgraph_core.evaluation.incremental import drive_through
from sgraph_core.graph import Pins
from sgraph_core.slam import ConceptTracker, Work
from sgraph_plugins.room.outline import outline

# -- equality with whole inference ---------------------------------------------------------------


def test_a_drive_through_a_block_of_rooms_ends_as_inferred_at_once(detector: Detector) -> None:
    tracker, before = ConceptTracker(detector=detector), None
    for visit in drive_through(24, seed=3):
        visit.enter(tracker, before)
        update = tracker.update()
        tracker.placed(range(update.factors.size()))
        before = visit
    assert len(tracker.nodes("room")) == 24
    assert_as_inferred_at_once(tracker, detector)


@pytest.mark.parametrize("seed", range(4))
def test_every_step_of_a_drive_through_a_synthetic_building_is_as_inferred_at_once(
    seed: int, detector: Detector
) -> None:
    graph, tracker = building(seed), ConceptTracker(detector=detector)
    order = eastwards(graph, np.random.default_rng(seed))
    for start in range(0, len(order), 10):
        add(tracker, graph, order[start : start + 10])
        assert_as_inferred_at_once(tracker, detector)


def test_surfaces_that_grow_and_move_are_inferred_as_they_are(detector: Detector) -> None:
    """Each surface is mapped half, grows to its length, and is moved by a correction of the map."""
    graph, rng = building(7), np.random.default_rng(7)
    tracker = ConceptTracker(detector=detector, tolerance_m=0.0)
    order = eastwards(graph, rng)
    for start in range(0, len(order), 12):
        some = order[start : start + 12]
        for surface in some:
            view = graph.wall_surface(surface)
            half = np.array([view.segment[0], view.segment.mean(axis=0)])
            tracker.add_wall_surface(surface, half, view.normal)
        tracker.update()
        tracker.move(
            surfaces={
                surface: (graph.wall_surface(surface).segment, graph.wall_surface(surface).normal)
                for surface in some
            }
        )
        tracker.update()
    assert_as_inferred_at_once(tracker, detector)
    table = graph.wall_surfaces
    west = table.segments[:, :, 0].mean(axis=1) < np.median(table.segments[:, :, 0])
    tracker.move(surfaces=turned_about(table.segments, table.normals, np.flatnonzero(west), 0.02))
    tracker.update()
    assert_as_inferred_at_once(tracker, detector)


def turned_about(
    segments: FloatArray, normals: FloatArray, rows: FloatArray, angle: float
) -> dict[int, tuple[FloatArray, FloatArray]]:
    cosine, sine = np.cos(angle), np.sin(angle)
    turn = np.array([[cosine, sine], [-sine, cosine]])
    return {int(row): (segments[row] @ turn, normals[row] @ turn) for row in rows}


def test_surfaces_mapped_twice_come_and_go(detector: Detector) -> None:
    graph = block(0.15)
    tracker = ConceptTracker(detector=detector)
    add(tracker, graph, range(16))
    copy = graph.wall_surface(1)
    tracker.add_wall_surface(50, copy.segment * (1, 0.9) + np.array([0.01, 0.1]), copy.normal)
    tracker.update()
    rooms = {frozenset(node.members) for node in tracker.nodes("room")}
    assert frozenset({0, 1, 2, 3, 50}) in rooms
    assert_as_inferred_at_once(tracker, detector)
    tracker.move(surfaces={50: (copy.segment + np.array([0.3, 0]), copy.normal)})
    tracker.update()
    assert_as_inferred_at_once(tracker, detector)


def test_a_building_far_from_the_origin_is_inferred_alike(detector: Detector) -> None:
    graph = block(0.1, 0.4, (500_000.0, 5_400_000.0))
    tracker = ConceptTracker(detector=detector)
    for room in range(4):
        add(tracker, graph, range(4 * room, 4 * room + 4))
    assert {frozenset(node.members) for node in tracker.nodes("room")} == true_rooms(graph)
    assert {frozenset(node.members) for node in tracker.nodes("wall")} == true_walls(graph)


def test_the_baselines_are_tracked_too(baseline: Detector) -> None:
    graph = block(0.15)
    tracker = ConceptTracker(detector=baseline)
    for room in range(4):
        add(tracker, graph, range(4 * room, 4 * room + 4))
    assert {frozenset(node.members) for node in tracker.nodes("room")} == true_rooms(graph)
    assert_as_inferred_at_once(tracker, baseline)


def test_real_floors_end_as_inferred_at_once(real_buildings: Path, detector: Detector) -> None:
    files = sorted((real_buildings / "surfaces-open").glob("*.json"))[::12]
    assert files
    for file in files:
        graph, tracker = load(str(file)), ConceptTracker(detector=detector)
        order = eastwards(graph, np.random.default_rng(0))
        for start in range(0, len(order), 40):
            add(tracker, graph, order[start : start + 40])
        assert_as_inferred_at_once(tracker, detector)


# -- ids and names -------------------------------------------------------------------------------


def test_ids_stay_while_the_map_grows_and_are_not_used_again(detector: Detector) -> None:
    graph = plan(*(rectangle(5.15 * k, 0, 5, 4) for k in range(6)))
    tracker = ConceptTracker(detector=detector)
    ids: dict[frozenset[int], int] = {}
    for start in range(0, 24, 2):
        changes = add(tracker, graph, [start, start + 1]).nodes["room"]
        assert not {node.id for node in changes.added} & set(ids.values())
        for room in tracker.nodes("room"):
            older = [i for members, i in ids.items() if members <= frozenset(room.members)]
            assert room.id in older or not older
            ids[frozenset(room.members)] = room.id
    assert {frozenset(node.members) for node in tracker.nodes("room")} == true_rooms(graph)


def test_what_changed_is_told_once(detector: Detector) -> None:
    graph = block(0.15)
    tracker = ConceptTracker(detector=detector)
    first = add(tracker, graph, range(4)).nodes["room"]
    assert [node.members for node in first.added] == [(0, 1, 2, 3)]
    nothing = tracker.update()
    assert not any(nothing.nodes.values())
    assert nothing.work == Work()
    second = add(tracker, graph, range(4, 8)).nodes
    assert [node.members for node in second["room"].added] == [(4, 5, 6, 7)]
    assert not second["room"].removed
    assert [node.members for node in second["wall"].added] == [(1, 7)]


def test_of_rooms_with_the_same_members_one_counts(detector: Detector) -> None:
    graph = block(0.15)
    members = (0, 1, 2, 3)
    graph.concepts["room"] = [ConceptNode(4, members), ConceptNode(9, members, name="office")]
    tracker = ConceptTracker(graph, detector)
    tracker.update()
    (room,) = (node for node in tracker.nodes("room") if node.members == members)
    assert (room.id, room.name) == (9, "office")
    assert_as_inferred_at_once(tracker, detector)
    assert len(tracker.nodes("room")) == 4
    assert min(node.id for node in tracker.nodes("room")) == 9, "an id is not used again"


def test_a_map_to_begin_with_gives_its_ids_and_names_on(detector: Detector) -> None:
    known = detector.infer(block(0.15))
    known.concepts["room"] = [
        replace(node, id=node.id + 20, name=f"office {node.id}") for node in known.concepts["room"]
    ]
    tracker = ConceptTracker(known, detector)
    assert not tracker.update().nodes["room"].added
    assert [node.name for node in tracker.nodes("room")] == [f"office {k}" for k in range(4)]
    add_outline(known, rectangle(-5.15, 0, 5, 4), first_id=16)
    assert add(tracker, known, range(16, 20)).nodes["room"].added[0].id == 24


def with_floors(clusterer: str) -> Detector:
    """Return a detector with a concept that groups rooms."""
    registry = new_registry()
    for concept in installed():
        registry.add(concept.spec, package=concept.package)
    floor = ConceptSpec(
        name="floor",
        groups="room",
        relation="same_floor",
        baseline="zone:everything",
        clusterer=clusterer,
    )
    registry.add(floor)
    return Detector(registry)


def test_a_concept_of_rooms_follows_the_rooms() -> None:
    graph, tracker = block(0.15), ConceptTracker(detector=with_floors("zone:one_node"))
    for room in range(4):
        add(tracker, graph, range(4 * room, 4 * room + 4))
        (floor_now,) = tracker.nodes("floor")
        assert floor_now.id == 0
        assert floor_now.members == tuple(node.id for node in tracker.nodes("room"))
    assert tracker.snapshot().groups == {"floor": "room"}


def test_ids_of_what_groups_rooms_are_not_used_again() -> None:
    graph, tracker = block(0.15), ConceptTracker(detector=with_floors("zone:one_each"))
    add(tracker, graph, range(8))
    assert [node.id for node in tracker.nodes("floor")] == [0, 1]
    tracker.pin(Pins(not_same_room=((4, 5), (6, 7))))  # leaves two surfaces of a side: no room
    assert [node.id for node in tracker.update().nodes["floor"].removed] == [1]
    assert [node.id for node in add(tracker, graph, range(8, 12)).nodes["floor"].added] == [2]


def test_the_grid_of_a_map_to_begin_with_is_not_used(detector: Detector) -> None:
    graph = block(0.15)
    graph.grid = grid_of(200, 200)  # nothing is free: by it there is no room
    assert not detector.infer(graph).concepts["room"]
    tracker = ConceptTracker(graph, detector)
    tracker.update()
    assert len(tracker.nodes("room")) == 4
    assert tracker.snapshot().grid is not None


def test_of_clusters_with_the_same_members_the_surest_counts() -> None:
    registry = new_registry()
    registry.add(
        ConceptSpec(
            name="pairing",
            relation="same_pairing",
            baseline="zone:everything",
            clusterer="zone:said_twice",
            exclusive=False,
        )
    )
    detector, graph = Detector(registry), block(0.15)
    tracker = ConceptTracker(graph, detector)
    tracker.update()
    nodes = tracker.nodes("pairing")
    at_once = detector.infer(graph).concepts["pairing"]
    assert {(n.members, n.confidence) for n in nodes} == {
        (n.members, n.confidence) for n in at_once
    }
    assert {node.confidence for node in nodes} == {0.9}


# -- how much is computed ------------------------------------------------------------------------


def work_at_the_end(rooms: int, columns: int, detector: Detector) -> Work:
    """Return what the updates in the last eight rooms of a drive compute together."""
    visits = drive_through(rooms, columns)
    tracker, total = ConceptTracker(detector=detector), np.zeros(4, int)
    for k, visit in enumerate(visits):
        visit.enter(tracker, visits[k - 1] if k else None)
        if k >= len(visits) - 17:
            update = tracker.update()
            tracker.placed(range(update.factors.size()))
            if k > len(visits) - 17:  # the first one takes in the whole map
                total += astuple(update.work)
    return Work(*total.tolist())


def test_an_update_computes_as_much_in_220_rooms_as_in_20(detector: Detector) -> None:
    few, many = (work_at_the_end(rooms, rooms, detector) for rooms in (20, 220))
    assert many.surfaces == few.surfaces
    assert many.pairs == few.pairs
    assert many.rows <= 1.15 * few.rows  # the far end of 20 rooms is in reach at first
    assert many.clustered <= 1.15 * few.clustered


def test_an_update_among_169_rooms_looks_at_a_neighbourhood(detector: Detector) -> None:
    """In a block, neighbours lie on three sides: it takes more rooms until a map holds them all."""
    some, many = (work_at_the_end(rooms, int(rooms**0.5), detector) for rooms in (81, 169))
    assert many.surfaces <= 1.1 * some.surfaces
    assert many.pairs <= 1.1 * some.pairs
    assert many.rows <= 1.3 * some.rows
    assert many.clustered <= 1.3 * some.clustered


def test_outlines_of_rooms_that_stay_as_they_are_are_remembered(
    detector: Detector, monkeypatch: pytest.MonkeyPatch
) -> None:
    visits, outlined = drive_through(30), []
    tracker = ConceptTracker(detector=detector)

    def counted(surfaces: SurfaceArrays) -> object:
        outlined.append(surfaces)
        return outline(surfaces)

    for k, visit in enumerate(visits):
        visit.enter(tracker, visits[k - 1] if k else None)
        if k == len(visits) - 1:
            monkeypatch.setattr(sgraph_plugins.room.outline, "outline", counted)
        if k >= len(visits) - 2:
            tracker.placed(range(tracker.update().factors.size()))
    assert 1 <= len(outlined) <= 3


def clustered_at_the_end(
    detector: Detector, concept: str, monkeypatch: pytest.MonkeyPatch
) -> tuple[int, ConceptTracker]:
    """Return how many fragments of a concept the last update of a drive clusters."""
    visits, sizes = drive_through(40, 40), []
    tracker, cluster = ConceptTracker(detector=detector), Inference.cluster

    def counted(
        run: Inference, one: RegisteredConcept, edges: ScoredEdges, scene: Scene
    ) -> list[Cluster]:
        if one.spec.name == concept:
            sizes.append(len(scene.surfaces))
        return cluster(run, one, edges, scene)

    with monkeypatch.context() as patch:
        patch.setattr(Inference, "cluster", counted)
        for k, visit in enumerate(visits):
            visit.enter(tracker, visits[k - 1] if k else None)
            if k >= len(visits) - 2:
                tracker.placed(range(tracker.update().factors.size()))
    return sizes[-1], tracker


def test_what_is_next_to_a_change_is_not_clustered_for_a_local_concept(
    detector: Detector, monkeypatch: pytest.MonkeyPatch
) -> None:
    walls, tracker = clustered_at_the_end(detector, "wall", monkeypatch)
    chosen = Detector(clusterers={"wall": "sgraph_plugins.wall.cluster:cluster"})
    with_next, _ = clustered_at_the_end(chosen, "wall", monkeypatch)
    assert walls < 0.8 * with_next, "what holds of the declared clusterer need not of others"
    assert_as_inferred_at_once(tracker, detector)


# -- what is refused -----------------------------------------------------------------------------


def test_an_impossible_tolerance_is_refused(detector: Detector) -> None:
    with pytest.raises(InputError, match=r"tolerance_m = -0\.1: must not be negative"):
        ConceptTracker(detector=detector, tolerance_m=-0.1)
    with pytest.raises(InputError, match="tolerance_m = nan"):
        ConceptTracker(detector=detector, tolerance_m=float("nan"))
