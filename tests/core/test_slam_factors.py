"""A ConceptTracker's factors in ISAM2 and in batch graphs, on the caller's keys and on ours."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import gtsam
import numpy as np
import pytest
from callers import OWN, Caller, factors_by_keys
from drive import drive
from plans import block, plan, rectangle, true_rooms
from tracked import keyframes_of

import sgraph_core.slam.ties
from sgraph_concepts.errors import InputError, OptimizationError
from sgraph_core.backend import Keys, low_layers, optimize
from sgraph_core.backend.association import Association, Proposal
from sgraph_core.backend.concept_factors import propose
from sgraph_core.detector import Detector
from sgraph_core.evaluation.incremental import drive_through
from sgraph_core.evaluation.trajectory import ate_rmse
from sgraph_core.graph import SGraph
from sgraph_core.slam import ConceptTracker, Update

# -- in the caller's own graph -----------------------------------------------------------------


def test_isam2_ends_where_batch_optimisation_of_the_same_factors_does(detector: Detector) -> None:
    caller = Caller(ConceptTracker(detector=detector, keys=OWN))
    for enter in keyframes_of(drive(0).graph):
        caller.see(enter)
    estimate = caller.settled()
    graph = gtsam.NonlinearFactorGraph()
    graph.push_back(caller.isam.getFactorsUnsafe())
    solved = gtsam.LevenbergMarquardtOptimizer(graph, estimate).optimize()
    assert graph.error(estimate) == pytest.approx(graph.error(solved), rel=1e-3)
    for keyframe in caller.graph.keyframes.ids.tolist():
        ours = estimate.atPose3(OWN.keyframe(keyframe))
        assert ours.range(solved.atPose3(OWN.keyframe(keyframe)).translation()) < 2e-3


def test_the_graph_holds_the_factors_of_the_nodes_as_they_are(detector: Detector) -> None:
    """A tracker that was told everything at once hands out what the other's graph has come to."""
    rooms = {"room": "published", "wall": "none"}
    caller = Caller(ConceptTracker(detector=detector, keys=OWN, factor_types=rooms))
    for enter in keyframes_of(drive(3).graph):
        caller.see(enter)
    at_once = ConceptTracker(caller.tracker.snapshot(), detector, OWN, rooms).update()
    estimate = caller.isam.calculateEstimate()
    low = low_layers(caller.graph, OWN)
    both = gtsam.NonlinearFactorGraph(low.graph)
    both.push_back(at_once.factors)
    kept = [entry[:2] for entry in factors_by_keys(caller.isam.getFactorsUnsafe(), estimate)]
    assert kept == [entry[:2] for entry in factors_by_keys(both, estimate)]
    expected = set(low.values.keys()) | set(at_once.values.keys())
    assert set(estimate.keys()) == expected


def test_a_tracker_begun_with_an_inferred_map_hands_out_its_factors(detector: Detector) -> None:
    first = ConceptTracker(drive(3).graph, detector)
    before = first.update()
    second = ConceptTracker(first.snapshot(), detector)
    after = second.update()
    assert not any(change.added or change.changed for change in after.nodes.values())
    assert after.factors.size() > 0
    assert after.factors.equals(before.factors, 1e-9)
    assert after.values.equals(before.values, 1e-9)


def two_rooms_seen_from_both() -> SGraph:
    """Return two rooms, a keyframe in each; the wall between them is 1 and 7."""
    graph = plan(rectangle(0, 0, 5, 4), rectangle(5.15, 0, 5, 4), walls=[(1, 7)])
    for keyframe, x in enumerate((2.0, 7.0)):
        graph.add_keyframe(keyframe, [x, 2, 0, 0, 0, 0, 1])
    graph.add_odometry(0, 1, [5, 0, 0, 0, 0, 0, 1], [1e-3] * 6)
    for surface in graph.wall_surfaces.ids.tolist():
        view = graph.wall_surface(surface)
        distance = float(view.normal @ ([2.0 if surface < 4 else 7.0, 2.0] - view.segment[0]))
        graph.observe(surface, int(surface >= 4), [*view.normal, 0, distance], [0.01, 0.02])
    return graph


def begun_with(surfaces: list[list[int]], detector: Detector) -> tuple[Caller, list[Update]]:
    """Let a caller map surfaces of the two rooms in steps."""
    graph = two_rooms_seen_from_both()
    factor_types = {"room": "published"}
    caller = Caller(ConceptTracker(detector=detector, keys=OWN, factor_types=factor_types))
    seen, updates = graph.observations, []
    for target in (caller.graph, caller.tracker):
        for keyframe in (0, 1):
            target.add_keyframe(keyframe, graph.keyframes.poses[keyframe])
        target.add_odometry(0, 1, graph.odometry.poses[0], graph.odometry.sigmas[0])
    for step in surfaces:
        for surface in step:
            view = graph.wall_surface(surface)
            for target in (caller.graph, caller.tracker):
                target.add_wall_surface(surface, view.segment, view.normal)
                target.observe(surface, int(surface >= 4), seen.planes[surface], [0.01, 0.02])
        updates.append(caller.step())
    return caller, updates


def test_a_wrong_room_that_is_split_later_leaves_no_trace(detector: Detector) -> None:
    outer, between = [0, 2, 3, 4, 5, 6], [1, 7]
    mistaken, (first, second) = begun_with([outer, between], detector)
    (wrong,) = first.nodes["room"].added
    assert set(wrong.members) > {3, 5}, "the wall between is not mapped yet: one room"
    assert first.factors.size() == len(second.remove) == 1
    right, _ = begun_with([sorted(outer + between)], detector)
    rooms = {frozenset(node.members) for node in mistaken.tracker.nodes("room")}
    assert rooms == {frozenset(range(4)), frozenset(range(4, 8))}

    def renamed(caller: Caller) -> dict[int, int]:
        """Number the rooms' variables by the rooms' members, for ids differ."""
        nodes = sorted(caller.tracker.nodes("room"), key=lambda node: node.members)
        return {OWN.node("room", node.id, 0): k for k, node in enumerate(nodes)}

    estimates = [caller.settled() for caller in (mistaken, right)]
    graphs, variables = [], []
    for caller, estimate in zip((mistaken, right), estimates, strict=True):
        number = renamed(caller)
        graphs.append(
            sorted(
                (name, tuple(number.get(key, key) for key in keys), round(error, 6))
                for name, keys, error in factors_by_keys(caller.isam.getFactorsUnsafe(), estimate)
            )
        )
        variables.append(sorted(number.get(key, key) for key in estimate.keys()))  # noqa: SIM118
    assert graphs[0] == graphs[1]
    assert variables[0] == variables[1]


def test_isam2_drops_the_variables_of_nodes_that_are_gone(detector: Detector) -> None:
    caller, _ = begun_with([[0, 2, 3, 4, 5, 6]], detector)
    (wrong,) = caller.tracker.nodes("room")
    key = OWN.node("room", wrong.id, 0)
    assert caller.isam.calculateEstimate().exists(key)
    apart = {
        surface: (segment + np.array([0.0, 60.0 * surface]), normal)
        for surface, segment, normal in zip(
            caller.graph.wall_surfaces.ids.tolist(),
            caller.graph.wall_surfaces.segments,
            caller.graph.wall_surfaces.normals,
            strict=True,
        )
    }
    caller.tracker.move(surfaces=apart)
    update = caller.step()
    assert update.unused == [key]
    assert [node.id for node in update.nodes["room"].removed] == [wrong.id]
    assert not caller.isam.calculateEstimate().exists(key)
    held = caller.isam.getFactorsUnsafe()
    assert key not in held.keyVector()


def test_a_batch_graph_is_kept_up_to_date_by_the_same_updates(detector: Detector) -> None:
    """Factors are removed by index, which leaves holes that gtsam's batch optimisers skip."""
    simulated = drive(0)
    tracker, graph = ConceptTracker(detector=detector), SGraph()
    concepts, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for enter in keyframes_of(simulated.graph):
        enter(graph)
        enter(tracker)
        update = tracker.update()
        for index in update.remove:
            concepts.remove(index)
        first = concepts.size()
        concepts.push_back(update.factors)
        tracker.placed(range(first, concepts.size()))
        for key in update.unused:
            values.erase(key)
        values.insert(update.values)
    low = low_layers(graph)
    whole = gtsam.NonlinearFactorGraph(low.graph)
    whole.push_back(concepts)
    start = gtsam.Values(low.values)
    start.insert(values)
    solved = gtsam.LevenbergMarquardtOptimizer(whole, start).optimize()
    assert set(solved.keys()) == set(whole.keyVector())
    positions = np.array([solved.atPose3(Keys().keyframe(i)).translation() for i in range(24)])
    alone = ate_rmse(
        optimize(graph, {"wall": "none", "room": "none"}).graph.keyframes.poses[:, :3],
        simulated.positions,
    )
    assert ate_rmse(positions, simulated.positions) < 0.9 * alone


def test_a_surface_observed_late_joins_the_factors_then(detector: Detector) -> None:
    graph = block(0.15)
    tracker = ConceptTracker(detector=detector)
    tracker.add_keyframe(0, [2, 2, 0, 0, 0, 0, 1])
    for surface in graph.wall_surfaces.ids.tolist():
        view = graph.wall_surface(surface)
        tracker.add_wall_surface(surface, view.segment, view.normal)
    assert tracker.update().factors.size() == 0, "no plane variable, no factor"
    tracker.observe(1, 0, [-1, 0, 0, 3], [0.01, 0.02])
    tracker.observe(7, 0, [1, 0, 0, 3], [0.01, 0.02])
    update = tracker.update()
    assert set(update.factors.keyVector()) >= {Keys().surface(1), Keys().surface(7)}
    assert not any(update.nodes.values())


def enter_wall(tracker: ConceptTracker, keyframes: int) -> None:
    """Enter two rooms and keyframes in turn in both; the first and the last see a side each."""
    graph = two_rooms_seen_from_both()
    for keyframe in range(keyframes):
        tracker.add_keyframe(keyframe, [7 if keyframe % 2 else 2, 2, 0, 0, 0, 0, 1])
    for surface in graph.wall_surfaces.ids.tolist():
        view = graph.wall_surface(surface)
        tracker.add_wall_surface(surface, view.segment, view.normal)
    tracker.observe(1, 0, [-1, 0, 0, 3], [0.01, 0.02])
    tracker.observe(7, keyframes - 1, [1, 0, 0, 1.85], [0.01, 0.02])


def test_a_sight_told_late_counts_from_its_keyframe(detector: Detector) -> None:
    """Whether a wall's sides were mapped in one go is known once all sights are told."""
    tracker = ConceptTracker(detector=detector)
    enter_wall(tracker, keyframes=30)
    apart = tracker.update()
    tracker.placed(range(apart.factors.size()))
    tracker.observe(7, 3, [1, 0, 0, 1.85], [0.01, 0.02])
    in_one_go = tracker.update()
    assert in_one_go.remove
    assert thickness_sigma(apart) > 10 * thickness_sigma(in_one_go)
    at_once = ConceptTracker(tracker.snapshot(), detector).update()
    assert thickness_sigma(in_one_go) == thickness_sigma(at_once)


def thickness_sigma(update: Update) -> float:
    """Return the largest sigma of the factors of the wall between 1 and 7."""
    keys = {Keys().surface(1), Keys().surface(7)}
    factors = [update.factors.at(k) for k in range(update.factors.size())]
    return max(f.noiseModel().sigmas().max() for f in factors if keys & set(f.keys()))


def test_a_wall_that_turns_about_gets_a_new_anchor(detector: Detector) -> None:
    """ISAM2 keeps the value of a variable that stays; one turned by 180 degrees would be no use."""
    tracker = ConceptTracker(detector=detector, keys=OWN)
    enter_wall(tracker, keyframes=2)
    before = tracker.update()
    tracker.placed(range(before.factors.size()))
    side = tracker.snapshot().wall_surface(1)
    tracker.move(surfaces={1: ([[3.0, 1.0], [3.0, 1.4]], [-1, 0])})
    tracker.add_wall_surface(8, side.segment, side.normal)
    tracker.observe(8, 0, [-1, 0, 0, 3], [0.01, 0.02])
    after = tracker.update()
    assert [node.members for node in before.nodes["wall"].added] == [(1, 7)]
    assert [node.members for node in after.nodes["wall"].changed] == [(7, 8)]
    (one,), (two,) = before.values.keys(), after.values.keys()
    assert one != two
    assert before.values.atPose3(one).rotation().matrix()[:, 0] == pytest.approx(
        [-1, 0, 0], abs=0.02
    )
    assert after.values.atPose3(two).rotation().matrix()[:, 0] == pytest.approx([1, 0, 0], abs=0.02)


# -- optimised by the tracker itself ---------------------------------------------------------------


def test_the_trackers_own_optimisation_straightens_a_drive(detector: Detector) -> None:
    errors = []
    for seed in (0, 1, 2):
        simulated = drive(seed)
        tracker = ConceptTracker(detector=detector)
        for enter in keyframes_of(simulated.graph):
            enter(tracker)
            tracker.optimize()
        result = tracker.snapshot()
        alone = optimize(simulated.graph, {"wall": "none", "room": "none"}).graph
        errors.append(
            [
                ate_rmse(graph.keyframes.poses[:, :3], simulated.positions)
                for graph in (result, alone, simulated.graph)
            ]
        )
        assert errors[-1][0] < 1.02 * errors[-1][1]
        for surface in np.unique(result.observations.surface_ids).tolist():
            before = simulated.graph.wall_surface(surface)
            assert before.normal @ result.wall_surface(surface).normal > 0.5
    ours, _, driven = np.mean(errors, axis=0)
    assert ours < 0.5 * driven


def test_surfaces_mapped_twice_are_tied_on_request(detector: Detector) -> None:
    for seed in (0, 3, 5):
        simulated, tracker = drive(seed), ConceptTracker(detector=detector)
        for enter in keyframes_of(simulated.graph):
            enter(tracker)
            tracker.optimize()
        before = tracker.snapshot().keyframes.poses
        assert tracker.associate().factors.size()
        tracker.optimize()
        after = tracker.snapshot().keyframes.poses
        errors = [ate_rmse(poses[:, :3], simulated.positions) for poses in (before, after)]
        assert errors[1] < errors[0]
        again = tracker.associate()
        assert (again.factors.size(), again.remove) == (0, []), "all is tied"


@pytest.mark.parametrize("seed", [0, 2])
def test_pairs_are_proposed_on_the_map_as_it_is(
    detector: Detector, monkeypatch: pytest.MonkeyPatch, seed: int
) -> None:
    """A room's factor looks at all surfaces around, which come and move without the room."""
    pairs: list[set[tuple[int, int]]] = []

    def listening(_graph: SGraph, proposals: list[Proposal], _known: Association) -> Association:
        pairs.append({pair for proposal in proposals for pair in proposal.pairs})
        return Association()

    monkeypatch.setattr(sgraph_core.slam.ties, "associate", listening)
    tracker = ConceptTracker(detector=detector)
    for enter in keyframes_of(drive(seed).graph):
        enter(tracker)
        tracker.placed(range(tracker.update().factors.size()))
    tracker.associate()
    ConceptTracker(tracker.snapshot(), detector).associate()
    proposals = propose(tracker.snapshot(), None, None)
    expected = {pair for proposal in proposals for pair in proposal.pairs}
    assert pairs == [expected, expected]


def test_ties_go_with_the_nodes_that_proposed_them(detector: Detector) -> None:
    caller = Caller(ConceptTracker(detector=detector, keys=OWN))
    for enter in keyframes_of(drive(0).graph):
        caller.see(enter)
    caller.tracker.follow(caller.settled())
    caller.step()
    update = caller.tracker.associate()
    tied = set(update.values.keys())
    assert tied
    caller.take(update)
    assert tied <= set(caller.isam.calculateEstimate().keys())
    table = caller.graph.wall_surfaces
    scattered = {
        i: (segment + np.array([0.0, 60.0 * i]), normal)
        for i, segment, normal in zip(
            table.ids.tolist(), table.segments, table.normals, strict=True
        )
    }
    caller.tracker.move(surfaces=scattered)
    caller.step()
    assert not caller.tracker.nodes("room")
    gone = caller.tracker.associate()
    assert set(gone.unused) == tied
    caller.take(gone)
    assert not tied & set(caller.isam.calculateEstimate().keys())


def test_keyframes_that_odometry_does_not_connect_are_named(detector: Detector) -> None:
    tracker = ConceptTracker(detector=detector)
    with pytest.raises(OptimizationError, match="the map has no keyframes"):
        tracker.optimize()
    tracker.add_keyframe(0, [0, 0, 0, 0, 0, 0, 1])
    tracker.add_keyframe(7, [1, 0, 0, 0, 0, 0, 1])
    with pytest.raises(OptimizationError, match="does not connect keyframe 7"):
        tracker.optimize()
    tracker.add_odometry(0, 7, [1, 0, 0, 0, 0, 0, 1], [0.1] * 6)
    tracker.optimize()


def test_a_graph_is_the_callers_or_the_trackers(detector: Detector) -> None:
    caller = Caller(ConceptTracker(detector=detector, keys=OWN))
    tracker = ConceptTracker(detector=detector)
    for enter in keyframes_of(drive(0).graph)[:5]:
        enter(tracker)
        tracker.optimize()
        caller.see(enter)
    with pytest.raises(InputError, match="a graph of its own"):
        tracker.update()
    with pytest.raises(InputError, match="a graph of the caller's"):
        caller.tracker.optimize()


# -- threads -----------------------------------------------------------------------------------


def test_threads_may_add_while_another_updates(detector: Detector) -> None:
    graph = plan(*(rectangle(5.15 * k, 0, 5, 4) for k in range(12)))
    tracker = ConceptTracker(detector=detector)

    def add(start: int) -> None:
        for surface in range(start, 48, 3):
            view = graph.wall_surface(surface)
            tracker.add_wall_surface(surface, view.segment, view.normal)

    with ThreadPoolExecutor() as pool:
        adding = [pool.submit(add, start) for start in range(3)]
        while not all(part.done() for part in adding):
            tracker.update()
        for part in adding:
            part.result()
    tracker.update()
    assert {frozenset(node.members) for node in tracker.nodes("room")} == true_rooms(graph)


def test_a_drive_is_consistent_with_itself() -> None:
    """Each plane is where its keyframe is and its surface lies."""
    graph, before = SGraph(), None
    for visit in drive_through(9):
        visit.enter(graph, before)
        before = visit
    low = low_layers(graph)
    assert low.graph.error(low.values) == pytest.approx(0, abs=1e-9)
