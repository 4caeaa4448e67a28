"""Every method on one small simulated drive, and the parts that methods are made of."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plans import block

from sgraph_concepts.errors import WeightsError
from sgraph_concepts.types import ConceptNode
from sgraph_core.detector import Detector
from sgraph_core.evaluation.slam.metrics import align
from sgraph_core.evaluation.slam.nodes import corrupted, described
from sgraph_core.evaluation.slam.study import measure
from sgraph_core.evaluation.slam.trial import Trial
from sgraph_core.evaluation.slam.variants import BASELINE, VARIANTS, Detectors
from sgraph_core.frontend.building import Door, Floor
from sgraph_core.frontend.lidar import Lidar
from sgraph_core.frontend.simulation import simulate
from sgraph_core.graph import SGraph

FLOOR = Floor(
    name="two rooms",
    rooms={
        "west": ((0, 0), (5, 0), (5, 4), (0, 4)),
        "east": ((5.2, 0), (10, 0), (10, 4), (5.2, 4)),
    },
    doors=(Door("west", "east", (5.1, 1)),),
    tour=("west", "east", "west"),
)


@pytest.fixture(scope="module")
def trial() -> Trial:
    return Trial(simulate(FLOOR, 0, lidar=Lidar(azimuths=600)), 0)


@pytest.fixture(scope="module")
def detectors(detector: Detector) -> Detectors:
    return Detectors(detector, detector)


@pytest.mark.parametrize("name", VARIANTS)
def test_a_method_solves_all_keyframes_and_is_measured(
    name: str, trial: Trial, detectors: Detectors
) -> None:
    variant = VARIANTS[name]
    solved = variant.solve(trial, detectors)
    assert np.array_equal(solved.keyframes.ids, np.arange(len(trial.recording)))
    result = measure(trial, variant, detectors)
    assert (result.drive, result.seed, result.variant) == ("two rooms", 0, name)
    assert 0 < result.ate_m < 1
    assert 0 < result.map_m < 1
    assert (result.rooms is not None) == ("room" in variant.concepts)
    assert (result.walls is not None) == ("wall" in variant.concepts)
    if result.rooms is not None:
        assert result.rooms.matched == result.rooms.true == 2
    if variant.detect is not None and not variant.papers:
        assert result.first_room_s is not None
        assert 0 <= result.first_room_s <= trial.recording.stamps[-1]
        assert result.update_ms is not None


def test_planes_correct_odometry_and_published_factors_correct_nothing(
    trial: Trial, detectors: Detectors
) -> None:
    def error(name: str) -> float:
        solved = VARIANTS[name].solve(trial, detectors)
        return align(solved, trial.recording.reference).ate_rmse_m

    assert error(BASELINE) < error("odometry")
    for name in ("free space", "paper, rooms", "paper, rooms + walls"):
        assert error(name) == pytest.approx(error(BASELINE), rel=1e-4)


def test_the_oracle_knows_every_surface(trial: Trial) -> None:
    graph, building = trial.oracle, trial.recording.building
    assert building is not None
    assert graph.truth is not None
    assert set(graph.wall_surfaces.ids.tolist()) <= set(building.surfaces.ids.tolist())
    assert len(graph.truth.rooms) == 2
    assert set(map(tuple, building.walls.tolist())) >= set(graph.truth.walls)
    true = building.surfaces.take(graph.wall_surfaces.ids)
    off = ((graph.wall_surfaces.segments - true.midpoints[:, None]) * true.normals[:, None]).sum(2)
    np.testing.assert_allclose(off, 0, atol=1e-9)
    np.testing.assert_array_equal(graph.keyframes.poses, trial.recording.reference)


def test_true_association_ties_the_true_walls(trial: Trial, detectors: Detectors) -> None:
    solved = VARIANTS["true association"].solve(trial, detectors)
    assert solved.truth is not None
    assert {node.members for node in solved.concepts["wall"]} == set(solved.truth.walls)
    log = Trial(replace(trial.recording, building=None), 0)
    solved = VARIANTS["true association"].solve(log, detectors)
    assert solved.truth is None
    assert solved.concepts["wall"]


def test_a_log_has_the_map_along_its_reference_for_truth(trial: Trial) -> None:
    log = Trial(replace(trial.recording, building=None), 0)
    assert log.mapped.graph.truth is None
    true, known = trial.true_surfaces, log.true_surfaces
    offsets = np.abs(((known.midpoints[:, None] - true.midpoints) * true.normals).sum(axis=2))
    facing = known.normals @ true.normals.T > 0.99
    assert np.where(facing, offsets, np.inf).min(axis=1).max() < 0.1


def test_updates_are_the_map_as_it_grows(trial: Trial) -> None:
    updates = trial.updates
    last = trial.recording.stamps[-1] - trial.recording.stamps[0]
    assert updates[0].seconds == 0
    assert updates[-1].seconds == last
    counts = [len(update.graph.wall_surfaces.ids) for update in updates]
    assert counts == sorted(counts)
    final = trial.mapped.graph
    assert np.array_equal(updates[-1].graph.wall_surfaces.ids, final.wall_surfaces.ids)
    np.testing.assert_allclose(
        updates[-1].graph.wall_surfaces.segments, final.wall_surfaces.segments
    )
    for update in updates:
        so_far = update.graph
        assert so_far.truth is not None
        ids = set(so_far.wall_surfaces.ids.tolist())
        assert all(set(room.members) <= ids for room in so_far.truth.rooms)
        for surface in ids:  # ids are those of the map in the end
            facing = so_far.wall_surface(surface).normal @ final.wall_surface(surface).normal
            assert facing > 0.9


def with_nodes(detector: Detector) -> SGraph:
    graph = block(0.15)
    assert graph.truth is not None
    rooms = [room.members for room in graph.truth.rooms]
    graph.concepts = {
        "room": described(graph, "room", rooms, detector.registry),
        "wall": described(graph, "wall", graph.truth.walls, detector.registry),
    }
    return graph


def test_nodes_are_described_by_the_map(detector: Detector) -> None:
    graph = with_nodes(detector)
    assert [wall.shape.thickness for wall in graph.concepts["wall"]] == pytest.approx([0.15] * 4)
    centre = graph.concepts["room"][0].shape.centre
    assert centre == pytest.approx((2.5, 2.0))


def test_corruption_spoils_every_fifth_room_and_wall(detector: Detector) -> None:
    graph = with_nodes(detector)
    before = graph.copy()
    spoilt = corrupted(graph, detector.registry, np.random.default_rng(0))
    assert graph.concepts == before.concepts
    assert graph.truth is not None

    def changed(concept: str) -> list[tuple[ConceptNode, ConceptNode]]:
        nodes = zip(graph.concepts[concept], spoilt.concepts[concept], strict=True)
        return [(one, two) for one, two in nodes if one.members != two.members]

    ((room, with_neighbour),) = changed("room")
    assert set(room.members) < set(with_neighbour.members)
    others = [node for node in graph.concepts["room"] if node.id != room.id]
    added = set(with_neighbour.members) - set(room.members)
    assert added in [set(node.members) for node in others]
    ((wall, wrong),) = changed("wall")
    assert wrong.members[0] == wall.members[0]
    assert wrong.confidence == wall.confidence
    assert tuple(sorted(wrong.members)) not in {tuple(sorted(w)) for w in graph.truth.walls}
    again = corrupted(graph, detector.registry, np.random.default_rng(0))
    assert again.concepts == spoilt.concepts


def test_weights_that_are_not_the_papers_are_named(detector: Detector) -> None:
    with pytest.raises(WeightsError, match=r"^ours: is no training of the paper's network"):
        Detectors(detector, detector).require_papers(Path("ours"))
