"""Scores against hand-counted examples, and the trajectory error against evo."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from evo.core import metrics, trajectory
from hypothesis import given, settings
from hypothesis import strategies as st

from sgraph_concepts.errors import InputError
from sgraph_concepts.types import ConceptNode
from sgraph_core.evaluation.scores import Counts, score_floor
from sgraph_core.evaluation.trajectory import ate_rmse, read_tum, trajectory_error
from sgraph_core.graph import SGraph, TrueRoom, Truth


def graph(rooms: list[set[int]], walls: list[tuple[int, int]] = []) -> SGraph:  # noqa: B006
    result = SGraph()
    result.concepts["room"] = [ConceptNode(k, tuple(r)) for k, r in enumerate(rooms)]
    result.concepts["wall"] = [ConceptNode(k, w) for k, w in enumerate(walls)]
    return result


def truth(rooms: list[set[int]], walls: list[tuple[int, int]] = []) -> Truth:  # noqa: B006
    return Truth(
        tuple(TrueRoom(k, None, tuple(r), None) for k, r in enumerate(rooms)), tuple(walls)
    )


ROOM_A, ROOM_B, SMALL = {1, 2, 3, 4}, {5, 6, 7, 8}, {9, 10}


def test_perfect_rooms_score_one() -> None:
    score = score_floor(graph([ROOM_A, ROOM_B]), truth([ROOM_A, ROOM_B]))
    assert score.rooms == score.exact_rooms == Counts(2, 2, 2, 0)
    assert (score.rooms.precision, score.rooms.recall, score.rooms.f1) == (1, 1, 1)


def test_half_a_room_matches_but_not_exactly() -> None:
    score = score_floor(graph([{1, 2}, ROOM_B]), truth([ROOM_A, ROOM_B]))
    assert (score.rooms.matched, score.exact_rooms.matched) == (2, 1)


def test_less_than_half_does_not_match() -> None:
    score = score_floor(graph([{1}, ROOM_A | ROOM_B | {20}]), truth([ROOM_A, ROOM_B]))
    assert score.rooms.matched == 0


def test_one_prediction_matches_one_room_only() -> None:
    merged = score_floor(graph([ROOM_A | ROOM_B]), truth([ROOM_A, ROOM_B]))
    assert merged.rooms == Counts(1, 1, 2, 0)


def test_the_assignment_makes_the_most_matches() -> None:
    # the first prediction could match either room, the second only A
    score = score_floor(graph([{1, 2, 5, 6}, {1, 2, 3}]), truth([ROOM_A, {2, 5, 6}]))
    assert score.rooms.matched == 2


def test_small_rooms_and_predictions_on_them_or_on_nothing_are_left_out() -> None:
    found = graph([ROOM_A, SMALL, {20, 21, 22}, {9, 10, 1, 2}])
    score = score_floor(found, truth([ROOM_A, SMALL]))
    # of {9, 10, 1, 2} exactly half lies in a scored room: it counts, as a miss
    assert score.rooms == Counts(1, 2, 1, 2)


def test_walls_are_pairs_in_any_order() -> None:
    score = score_floor(graph([], [(1, 5), (2, 6)]), truth([ROOM_A, ROOM_B], [(5, 1), (3, 7)]))
    assert score.walls == Counts(1, 2, 2, 0)
    assert score.walls.f1 == 0.5


def test_walls_on_unlabelled_surfaces_are_left_out() -> None:
    score = score_floor(graph([], [(1, 5), (30, 31)]), truth([ROOM_A, ROOM_B], [(1, 5)]))
    assert score.walls == Counts(1, 1, 1, 1)


def test_nothing_predicted_scores_zero() -> None:
    score = score_floor(graph([]), truth([ROOM_A], [(1, 2)]))
    assert (score.rooms.precision, score.rooms.f1, score.walls.f1) == (0, 0, 0)
    assert score_floor(graph([]), truth([])).rooms == Counts()


def test_counts_add_up() -> None:
    assert Counts(1, 2, 3, 4) + Counts(10, 20, 30, 40) == Counts(11, 22, 33, 44)


@given(st.integers(0, 1000), st.integers(3, 40))
@settings(max_examples=20, deadline=None)
def test_the_trajectory_error_is_evos(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    reference = np.cumsum(rng.normal(0, 1, (count, 3)) * [1, 1, 0.1], axis=0)
    angle = rng.uniform(0, 6)
    turn = np.array(
        [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    )
    positions = (reference + rng.normal(0, 0.2, (count, 3))) @ turn.T + [3, -2, 1]
    level = np.tile([1.0, 0, 0, 0], (count, 1))
    estimate = trajectory.PosePath3D(positions, level)
    wanted = trajectory.PosePath3D(reference, level)
    estimate.align(wanted)
    ape = metrics.APE(metrics.PoseRelation.translation_part)
    ape.process_data((wanted, estimate))
    rmse = ape.get_statistic(metrics.StatisticsType.rmse)
    assert ate_rmse(positions, reference) == pytest.approx(rmse, abs=1e-6)


def test_keyframes_are_matched_by_their_stamps(tmp_path: Path) -> None:
    result = SGraph()
    for number, (x, y) in enumerate([(0, 0), (1, 0), (1, 1), (9, 9)]):
        stamp = None if number == 3 else 10.0 + number
        result.add_keyframe(number, [x, y, 0, 0, 0, 0, 1], stamp)
    file = tmp_path / "true.tum"
    file.write_text("# comment\n10 5 5 0 0 0 0 1\n11 6 5 0 0 0 0 1\n12 6 6 0 0 0 0 1\n")
    assert trajectory_error(result, *read_tum(file)) == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("text", ["", "1 2 3\n", "a b c d e f g h\n", "1 nan 0 0 0 0 0 1\n"])
def test_what_is_no_trajectory_is_named(tmp_path: Path, text: str) -> None:
    file = tmp_path / "true.tum"
    file.write_text(text)
    with pytest.raises(InputError, match=r"true\.tum"):
        read_tum(file)


def test_too_few_common_poses_are_an_error() -> None:
    result = SGraph()
    result.add_keyframe(0, [0, 0, 0, 0, 0, 0, 1], 1.0)
    with pytest.raises(InputError, match="3 or more"):
        trajectory_error(result, np.array([1.0, 2.0]), np.zeros((2, 3)))
