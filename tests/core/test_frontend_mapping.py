"""The planes-only front end on simulated drives."""

from __future__ import annotations

import numpy as np

from sgraph_core.evaluation.trajectory import ate_rmse
from sgraph_core.frontend.mapping import build_map
from sgraph_core.frontend.scenes import scene
from sgraph_core.frontend.simulation import simulate


def test_a_seed_gives_one_recording_and_one_map() -> None:
    one, two = (simulate(scene("C1F1s"), 3) for _ in range(2))
    assert np.array_equal(one.odometry, two.odometry)
    for first, second in zip(one.observations, two.observations, strict=True):
        assert np.array_equal(first.planes, second.planes)
    maps = [build_map(recording).graph.wall_surfaces.segments for recording in (one, two)]
    assert np.array_equal(*maps)
    assert not np.array_equal(one.odometry, simulate(scene("C1F1s"), 4).odometry)


def test_the_map_corrects_drift() -> None:
    recording = simulate(scene("C1F1s"), 0)
    graph = build_map(recording).graph
    drifted = ate_rmse(recording.dead_reckoned()[:, :3], recording.positions())
    corrected = ate_rmse(graph.keyframes.poses[:, :3], recording.positions())
    assert corrected < 0.2 * drifted
