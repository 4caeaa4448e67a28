"""What contradicts the map is switched off, the worst first, until all that remains fits."""

from __future__ import annotations

from collections.abc import Sequence

import gtsam
import numpy as np
import pytest

from sgraph_concepts.types import ConceptNode, NodeShape
from sgraph_core.backend import optimize
from sgraph_core.backend.robust import Refusal, misfit, worst_of
from sgraph_core.graph import SGraph

LEVEL = [0, 0, 0, 0, 0, 0, 1]


def walls_seen_exactly(gaps: Sequence[float]) -> SGraph:
    """Return walls of these thicknesses, a side of each seen by either of two keyframes."""
    graph = SGraph()
    graph.add_keyframe(0, LEVEL)
    graph.add_keyframe(1, [5, 0, 0, 0, 0, 0, 1])
    graph.add_odometry(0, 1, [5, 0, 0, 0, 0, 0, 1], [1e-4] * 6)
    walls = []
    for number, gap in enumerate(gaps):
        near, far, y = 2 * number, 2 * number + 1, 0.1 * number
        graph.add_wall_surface(near, [[2, y - 0.4], [2, y + 0.4]], [-1, 0])
        graph.add_wall_surface(far, [[2 + gap, y - 0.4], [2 + gap, y + 0.4]], [1, 0])
        graph.observe(near, 0, [-1, 0, 0, 2.0], [0.01, 0.005])
        graph.observe(far, 1, [1, 0, 0, 3.0 - gap], [0.01, 0.005])
        shape = NodeShape(centre=(2 + gap / 2, y), thickness=gap)
        walls.append(ConceptNode(number, (near, far), shape=shape))
    graph.concepts["wall"] = walls
    return graph


def test_a_wall_that_contradicts_the_map_is_switched_off_and_the_report_says_why() -> None:
    """Three walls of 0.2 m; the sides of a fourth were seen 0.5 m apart, exactly."""
    graph = walls_seen_exactly([0.2, 0.2, 0.2, 0.5])
    result = optimize(graph, {"wall": "zone:tie_at_a_fifth"})
    assert result.switched_off == [("wall", 3)]
    (refusal,) = result.refusals
    assert refusal.squares > refusal.threshold > 0
    assert str(refusal).startswith(f"wall 3: squared error {refusal.squares:.3g} exceeds")
    assert result.graph.wall_surface(7).segment[:, 0] == pytest.approx([2.5, 2.5], abs=1e-3)


def test_all_that_contradicts_the_map_is_switched_off_however_much_it_is() -> None:
    """What is switched off first is the worst by far; forty walls are wrong by ever less."""
    wrong = [0.36 + 0.02 * number for number in range(40)]
    result = optimize(walls_seen_exactly([0.2, 0.2, 0.2, *wrong]), {"wall": "zone:tie_at_a_fifth"})
    assert result.switched_off == [("wall", number) for number in range(3, 43)]


def test_an_error_that_is_no_number_is_a_misfit_whatever_its_freedom() -> None:
    unit = gtsam.noiseModel.Unit.Create(2)
    nothing = gtsam.CustomFactor(unit, [5], lambda *_: np.full(2, np.nan))
    values = gtsam.Values()
    values.insert(5, gtsam.Point2(0, 0))
    refusal = misfit("zone", 0, (), [nothing], {5: 2}, values)
    assert refusal is not None
    assert worst_of([(refusal, {0})]) == [refusal]


def test_what_is_switched_off_is_the_worst_near_and_what_is_nearly_as_bad() -> None:
    def of(node: int, excess: float) -> Refusal:
        return Refusal("wall", node, (), excess, 1.0, 3)

    worst, beside, nearly, elsewhere = of(0, 100.0), of(1, 10.0), of(2, 60.0), of(3, 2.0)
    bystander = of(4, 6.0)  # bent by the one beside the worst, which stays for now
    misfits = [(beside, {0, 1}), (worst, {1}), (bystander, {0}), (nearly, {1, 2}), (elsewhere, {7})]
    assert worst_of(misfits) == [worst, nearly, elsewhere]
