"""How far a drive may have drifted: hand-solved cases, and what gtsam says of the same chain."""

from __future__ import annotations

import gtsam
import numpy as np
import pytest
import visits
from drive import row
from plans import rectangle
from visits import visit_rooms

from sgraph_concepts.errors import OptimizationError
from sgraph_core.backend import optimize
from sgraph_core.backend.drift import Drift
from sgraph_core.backend.keys import Keys
from sgraph_core.backend.low_layers import low_layers, pose3
from sgraph_core.graph import SGraph

SIGMAS = [1.0, 1.0, 0.01, 0.03, 0.05, 1.0]


def straight(steps: int) -> SGraph:
    """Return a drive without walls along x, a metre per step, far from the origin of the world."""
    graph = SGraph("straight")
    for number in range(steps + 1):
        graph.add_keyframe(number, row(np.array([1e5 + number, -2e5, 0.0])))
    for number in range(steps):
        graph.add_odometry(number, number + 1, row(np.array([1.0, 0.0, 0.0])), SIGMAS)
    return graph


@pytest.mark.parametrize("steps", [6, 2000])
def test_odometry_alone_adds_up(steps: int) -> None:
    """Angles walk at random; they shift the end sideways by their arms, which sum to squares."""
    end = np.array([1e5 + steps, -2e5])
    angle, along, across = np.sqrt(np.diag(Drift(straight(steps)).between(0, steps, end)))
    assert angle == pytest.approx(0.01 * np.sqrt(steps), rel=1e-3)
    assert along == pytest.approx(0.03 * np.sqrt(steps), rel=1e-3)
    arms = np.arange(steps)
    assert across == pytest.approx(np.sqrt(0.05**2 * steps + 0.01**2 * (arms @ arms)), rel=1e-3)


def test_both_directions_are_alike() -> None:
    drift, point = Drift(straight(5)), np.array([1e5, -2e5 + 3.0])
    assert np.allclose(drift.between(1, 4, point), drift.between(4, 1, point))


@pytest.mark.parametrize("at_aside", [False, True])
def test_the_chain_is_that_of_gtsam(at_aside: bool) -> None:
    """The covariance is that of the pose of one keyframe as seen from the other, about it."""
    room, (one, two) = (rectangle(0, 0, 5, 4), (0, 0, 0.4)), (0, 23)
    graph = visit_rooms([room] * 2, at_aside)
    keys = Keys()
    low = low_layers(graph, keys)
    marginals = gtsam.Marginals(low.graph, low.values)
    key, other = keys.keyframe(one), keys.keyframe(two)
    joint = marginals.jointMarginalCovariance([key, other])
    both = np.block([[joint.at(a, b) for b in (key, other)] for a in (key, other)])
    motion = pose3(graph.keyframe(one).pose).between(pose3(graph.keyframe(two).pose))
    change = np.hstack([-motion.inverse().AdjointMap(), np.eye(6)])
    seen = (change @ both @ change.T)[2:5, 2:5]
    turn = np.eye(3)
    turn[1:, 1:] = pose3(graph.keyframe(two).pose).rotation().matrix()[:2, :2]
    assert Drift(graph).between(one, two, graph.keyframe(two).pose[:2]) == pytest.approx(
        turn @ seen @ turn.T, rel=1e-3, abs=1e-9
    )


def test_what_the_front_end_recognised_is_not_believed() -> None:
    graph = visit_rooms([(rectangle(0, 0, 5, 4), (0, 0, 0))] * 2)
    point = graph.keyframe(21).pose[:2]
    before = Drift(graph).between(0, 21, point)
    for surface in range(4):
        plane = graph.observations.planes[graph.observations.surface_ids == surface][0]
        graph.observe(surface, 21, plane, [0.01, 0.02])
    assert Drift(graph).between(0, 21, point) == pytest.approx(before, rel=1e-6, abs=1e-9)


def test_sigmas_that_drown_one_another_are_an_error_of_optimisation(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Heading and x are unknown, y is exact: float64 does not hold the sums of information."""
    monkeypatch.setattr(visits, "SIGMAS", [1e-3, 1e-3, 1e6, 1e6, 1e-6, 1e-3])
    graph = visit_rooms([(rectangle(0, 0, 5, 4), (0, 0, 0.4))] * 2)
    with pytest.raises(OptimizationError, match="how far the drive has drifted cannot be told: "):
        optimize(graph)
