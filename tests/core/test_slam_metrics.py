"""Errors of trajectories and maps, and paired statistics, against cases worked out by hand."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plans import block, plan, rectangle

from sgraph_concepts.errors import InputError, MissingExtraError
from sgraph_concepts.types import FloatArray
from sgraph_core.evaluation.slam.metrics import Alignment, align, map_rmse
from sgraph_core.evaluation.slam.statistics import Paired, compare, spread
from sgraph_core.evaluation.trajectory import ate_rmse
from sgraph_core.frontend.planar import as_rows, composed
from sgraph_core.graph import SGraph

IN_PLACE = Alignment(np.eye(3), np.zeros(3), 0.0)
POSES = np.array([[0, 0, 0], [2, 0, 0.3], [4, 1, 0.5], [5, 3, 1.5], [4, 5, 2.5]], np.float64)


def path(poses: FloatArray) -> SGraph:
    graph = SGraph("path")
    graph.extend_keyframes(np.arange(len(poses)), as_rows(poses), np.arange(len(poses)) * 1.0)
    return graph


def shifted(graph: SGraph, by: tuple[float, float]) -> SGraph:
    table = graph.wall_surfaces
    return graph.moved(graph.keyframes.poses, table.segments + by, table.normals)


@settings(deadline=None)  # evo takes its time to import
@given(st.floats(-50, 50), st.floats(-50, 50), st.floats(-3, 3))
def test_a_trajectory_moved_rigidly_has_no_error(x: float, y: float, yaw: float) -> None:
    moved = composed(np.array([x, y, yaw]), POSES)
    assert align(path(moved), as_rows(POSES)).ate_rmse_m == pytest.approx(0, abs=1e-9)


def test_the_error_of_a_trajectory_is_that_of_the_core() -> None:
    noisy = POSES + np.random.default_rng(0).normal(0, 0.1, POSES.shape)
    own = ate_rmse(as_rows(noisy)[:, :3], as_rows(POSES)[:, :3])
    assert align(path(noisy), as_rows(POSES)).ate_rmse_m == pytest.approx(own, rel=1e-9)


def test_two_poses_or_a_reference_of_another_length_are_refused() -> None:
    for poses, reference in ((POSES[:2], POSES[:2]), (POSES, POSES[:4])):
        with pytest.raises(InputError, match="need as many of both, and 3 or more"):
            align(path(poses), as_rows(reference))


def test_a_straight_path_is_refused() -> None:
    straight = np.column_stack([np.arange(5.0), np.zeros((5, 2))])
    with pytest.raises(InputError, match="cannot be aligned"):
        align(path(straight), as_rows(straight))


def test_without_evo_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "evo", None)
    with pytest.raises(MissingExtraError, match=r"sgraph-concepts\[bench\]"):
        align(path(POSES), as_rows(POSES))


def test_a_map_shifted_by_10_cm_is_10_cm_off_where_it_moved_across() -> None:
    graph = plan(rectangle(0, 0, 5, 5))
    true = graph.wall_surfaces.ordered()
    assert map_rmse(graph, true, IN_PLACE) == pytest.approx(0, abs=1e-9)
    # north and south are 10 cm off; east and west stay in line but for the last points
    moved = map_rmse(shifted(graph, (0, 0.1)), true, IN_PLACE)
    squares = [0.1**2] * 51 * 2 + [0.1**2] * 2 + [0.0] * 50 * 2
    assert moved == pytest.approx(np.sqrt(np.mean(squares)))
    one = SGraph("south")
    one.add_wall_surface(0, [[1, 0.1], [4, 0.1]], [0, 1])
    assert map_rmse(one, true, IN_PLACE) == pytest.approx(0.1)


def test_the_map_is_moved_by_the_trajectorys_alignment() -> None:
    graph = block(0.15)
    true = graph.wall_surfaces.ordered()
    moved = block(0.15, angle_rad=0.7, offset=(20.0, -3.0))
    pose = np.array([20.0, -3.0, 0.7])
    moved.extend_keyframes(np.arange(5), as_rows(composed(pose, POSES)), np.arange(5.0))
    assert map_rmse(moved, true, align(moved, as_rows(POSES))) == pytest.approx(0, abs=1e-9)


def test_the_other_side_of_a_wall_is_no_match() -> None:
    wall = SGraph("wall")
    wall.add_wall_surface(0, [[0, 0], [5, 0]], [0, -1])
    wall.add_wall_surface(1, [[0, 0.12], [5, 0.12]], [0, 1])
    wrong = SGraph("wrong side")
    wrong.add_wall_surface(0, [[1, 0.12], [4, 0.12]], [0, -1])
    assert map_rmse(wrong, wall.wall_surfaces.ordered(), IN_PLACE) == pytest.approx(0.12)


def test_an_empty_map_is_refused() -> None:
    with pytest.raises(InputError, match="both need some"):
        map_rmse(SGraph(), block(0.15).wall_surfaces.ordered(), IN_PLACE)


def test_ratios_are_paired_and_2_percent_is_a_draw() -> None:
    found = compare([0.5, 0.99, 1.01, 1.5, 0.9], [1.0, 1.0, 1.0, 1.0, 0.3])
    assert found == Paired(pairs=5, median_ratio=1.01, wins=1, losses=2)
    assert np.isnan(compare([], []).median_ratio)


def test_mean_and_sample_deviation() -> None:
    assert spread([1.0, 2.0, 3.0]).mean == 2.0
    assert spread([1.0, 2.0, 3.0]).deviation == 1.0
    assert np.isnan(spread([1.0]).deviation)
