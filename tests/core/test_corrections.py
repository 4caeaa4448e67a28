"""Rigid corrections that pairs of surfaces vote for, against moves that are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plans import plan, rectangle

from sgraph_concepts.types import FloatArray
from sgraph_core.backend.corrections import Corrections, composed, corrections_of, possible
from sgraph_core.backend.votes import Votes, votes_of_rows
from sgraph_core.geometry import turn_left

SPREAD = np.diag([0.1, 1.0, 1.0]) ** 2
CENTRE = np.array([3.0, 1.0])


def moved(points: FloatArray, move: FloatArray, centre: FloatArray) -> FloatArray:
    return np.asarray(points + move[1:] + move[0] * turn_left(points - centre))


def votes(shift: tuple[float, float], sides: list[int]) -> Votes:
    """Return votes of some sides of a room and of its copy."""
    surfaces = plan(rectangle(0, 0, 5, 4), rectangle(*shift, 5, 4)).wall_surfaces.ordered()
    rows = np.array(sides)
    return votes_of_rows(surfaces, rows, 4 + rows)


def test_a_copy_votes_for_the_move_that_undoes_its_drift() -> None:
    found = corrections_of(votes((0.6, -0.4), [0, 1, 2, 3]), SPREAD, CENTRE)
    best = found.moves[found.support.sum(axis=1).argmax()]
    assert found.support.all(axis=1).any()
    assert best == pytest.approx([0, -0.6, 0.4], abs=0.01)


@pytest.mark.parametrize("sides", [[0, 2], [0, 1], [1, 3]])
def test_fewer_than_three_sides_fix_no_correction(sides: list[int]) -> None:
    assert not len(corrections_of(votes((0.6, -0.4), sides), SPREAD, CENTRE).moves)


def test_what_the_front_end_recognised_proposes_no_correction_alone() -> None:
    room = votes((0.6, -0.4), [0, 1, 2, 3])
    for held, any_is_found in ((4, False), (3, True)):
        some = replace(room, held=np.arange(4) < held)
        assert bool(len(corrections_of(some, SPREAD, CENTRE).moves)) is any_is_found


def test_support_that_is_left_must_fix_a_correction_still() -> None:
    """Of a room and the next one in its row: without a side across, what is left is parallel."""
    rooms = [rectangle(x, y, 5, 4) for x, y in ((0, 0), (5.2, 0), (0.6, -0.4), (5.8, -0.4))]
    surfaces = plan(*rooms).wall_surfaces.ordered()
    rows = np.arange(8)
    two = votes_of_rows(surfaces, rows, 8 + rows)
    found = corrections_of(two, SPREAD, CENTRE)
    across = np.array([1, 3, 5, 7])
    for left_out, remain in ((across[:3], True), (across, False)):
        support = found.support.copy()
        support[:, left_out] = False
        assert bool(len(Corrections(found.moves, support).fixed_by(two).moves)) is remain


def test_what_drift_does_not_explain_is_not_possible() -> None:
    near, far = (possible(votes((x, 0.0), [0, 1, 2, 3]), SPREAD, CENTRE) for x in (1.0, 5.0))
    assert near.all()
    assert far.tolist() == [True, False, True, False]  # the sides along the way fit anywhere


def test_a_correction_that_another_one_follows() -> None:
    first, then = np.array([1e-4, 2.0, -1.0]), np.array([0.3, 0.5, 4.0])
    about, points = np.array([-7.0, 2.0]), np.array([[0.0, 0.0], [10.0, -3.0]])
    both = composed(first, CENTRE, then, about)
    assert moved(points, both, CENTRE) == pytest.approx(
        moved(moved(points, first, CENTRE), then, about), abs=1e-3
    )
    assert both[0] == pytest.approx(0.3001)
