"""Real floors, where SGRAPH_DATA names a folder of them: the network against the rules."""

from __future__ import annotations

from pathlib import Path

import pytest

from sgraph_core.detector import Detector
from sgraph_core.evaluation.report import evaluate


@pytest.mark.parametrize("folder", ["surfaces", "surfaces-open", "surfaces-sparse"])
def test_the_network_finds_rooms_wherever_the_baseline_does(
    folder: str, real_buildings: Path, detector: Detector, baseline: Detector
) -> None:
    (learned,) = evaluate([real_buildings / folder], detector)
    (rules,) = evaluate([real_buildings / folder], baseline)
    for ours, theirs in zip(learned.floors, rules.floors, strict=True):
        if theirs.score.rooms.matched:
            assert ours.score.rooms.matched, ours.name
    assert learned.rooms.f1 > 0.8
    assert learned.walls.f1 > 0.9
    for concept in ("room", "wall"):
        assert learned.calibration.nodes[concept].error <= 0.05
