"""Sweeps change what they name and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from sgraph_core.detector import Detector
from sgraph_core.evaluation.sweeps import PLAIN, SWEEPS, Sweep, building_config, run_sweep
from sgraph_core.synth.building import Building, draw_building
from sgraph_core.synth.walls import wall_gaps

BY_NAME = {sweep.name: sweep for sweep in SWEEPS}


def drawn(name: str, value: float) -> Building:
    config = building_config(BY_NAME[name], value)
    return draw_building(np.random.default_rng([5, 0]), config)


def test_turning_the_map_changes_no_score(detector: Detector) -> None:
    points = list(run_sweep(BY_NAME["yaw"], 3, 5, detector))
    assert [point.value for point in points] == list(BY_NAME["yaw"].values)
    assert len({(p.room_f1, p.room_exact_f1, p.wall_f1) for p in points}) == 1
    assert points[0].room_f1 > 0.5


@pytest.mark.parametrize("sweep", [s for s in SWEEPS if not s.turns], ids=lambda s: s.name)
def test_a_sweep_changes_one_part_of_the_plain_configuration(sweep: Sweep) -> None:
    configs = [building_config(sweep, value) for value in sweep.values]
    assert len(set(map(repr, configs))) == len(configs)
    for config in configs:
        changed = [part for part, value in config if value != getattr(PLAIN, part)]
        assert len(changed) <= 1


def test_a_building_stays_the_same_while_its_noise_grows() -> None:
    clean, noisy = drawn("noise", 0.0), drawn("noise", 0.1)
    assert [p.tolist() for p in clean.polygons] == [p.tolist() for p in noisy.polygons]
    assert not np.isin(noisy.segments, clean.segments).any()


def test_more_and_more_is_missing() -> None:
    counts = [len(drawn("missing", value).segments) for value in BY_NAME["missing"].values]
    assert counts == sorted(counts, reverse=True)
    assert counts[-1] < 0.7 * counts[0]


def test_shorter_pieces_are_more_pieces() -> None:
    counts = [len(drawn("fragments", value).segments) for value in BY_NAME["fragments"].values]
    assert counts == sorted(counts, reverse=True)
    assert counts[0] > 2 * counts[-1]


def test_walls_are_as_thick_as_asked_for() -> None:
    for value in BY_NAME["thickness"].values:
        building = drawn("thickness", value)
        gaps = wall_gaps(building.segments, building.normals)
        assert np.median(gaps.thicknesses) == pytest.approx(value, abs=0.02)
