"""Gaps between collinear surfaces, and surfaces continued to the next one."""

from __future__ import annotations

import numpy as np
import pytest
from plans import L_SHAPE, plan, rectangle

from sgraph_concepts.types import FloatArray, SurfaceArrays
from sgraph_core.closures import Closures, continuations, gaps
from sgraph_core.graph import SGraph


def surfaces(*segments: list[list[float]]) -> SurfaceArrays:
    """Return surfaces that face to the left of their direction."""
    graph = SGraph()
    for number, (start, end) in enumerate(segments):
        along = np.subtract(end, start)
        graph.add_wall_surface(number, [start, end], [-along[1], along[0]] / np.linalg.norm(along))
    return graph.wall_surfaces.ordered()


def drawn(closures: Closures) -> list[tuple[tuple[float, ...], tuple[float, ...]]]:
    return sorted(
        tuple(sorted(tuple(end) for end in segment))
        for segment in (closures.segments.round(6) + 0.0).tolist()
    )


def test_a_doorway_is_a_gap_of_its_width() -> None:
    door = gaps(surfaces([[0, 0], [2, 0]], [[2.9, 0], [5, 0]]), 6.0)
    assert drawn(door) == [((2, 0), (2.9, 0))]
    assert door.widths == pytest.approx([0.9])


def test_a_gap_reaches_to_the_next_collinear_surface_only() -> None:
    row = surfaces([[0, 0], [1, 0]], [[2, 0], [3, 0]], [[4, 0], [5, 0]])
    assert drawn(gaps(row, 6.0)) == [((1, 0), (2, 0)), ((3, 0), (4, 0))]


@pytest.mark.parametrize(
    "second",
    [
        [[8.1, 0], [9, 0]],  # too far
        [[3, 0.5], [5, 0.5]],  # beside the line
        [[3, 0], [4, 1]],  # turned
        [[5, 0], [3, 0]],  # faces the other way
    ],
)
def test_there_is_no_gap_to(second: list[list[float]]) -> None:
    assert drawn(gaps(surfaces([[0, 0], [2, 0]], second), 6.0)) == []


@pytest.mark.parametrize("angle", np.radians([0, 20, 45, 90, 130, 180, 200, 290]))
@pytest.mark.parametrize("turned", np.radians([-14.9, 0, 14.9]))
@pytest.mark.parametrize("aside", [-0.4, 0.0, 0.4])
def test_a_gap_may_be_as_skew_and_offset_as_the_rule_says(
    angle: float, turned: float, aside: float
) -> None:
    def turn(by: float) -> FloatArray:
        return np.array([[np.cos(by), np.sin(by)], [-np.sin(by), np.cos(by)]])

    start = [5.9, aside] @ turn(turned / 2)  # 5.9 m along the mean direction
    second = np.array([start, start + [1, 0] @ turn(turned)])
    closures = gaps(surfaces([[-2, 0] @ turn(angle), [0, 0]], (second @ turn(angle)).tolist()), 6.0)
    assert closures.widths == pytest.approx([5.9])


def test_a_closed_room_has_nothing_to_continue() -> None:
    graph = plan(L_SHAPE, rectangle(12, 0, 5, 4), angle_rad=0.4)
    assert drawn(continuations(graph.wall_surfaces.ordered(), 8.0)) == []


def test_a_wall_that_ends_in_the_open_is_continued_to_the_first_surface_in_its_way() -> None:
    far, near = [[6, 3], [6, -3]], [[4, 3], [4, -3]]
    closures = continuations(surfaces([[0, 0], [2, 0]], far, near), 3.5)
    assert drawn(closures) == [((2, 0), (4, 0))]
    assert closures.widths == pytest.approx([2.0])


def test_continuations_have_a_longest_length() -> None:
    assert drawn(continuations(surfaces([[0, 0], [2, 0]], [[4, 3], [4, -3]]), 1.9)) == []


def test_a_wall_is_not_continued_to_one_that_runs_along_it() -> None:
    almost_parallel = [[5, 0.2], [3, -0.1]]
    assert drawn(continuations(surfaces([[0, 0], [2, 0]], almost_parallel), 8.0)) == []


def test_both_sides_of_a_wall_are_continued() -> None:
    wall = surfaces([[0, 0.1], [2, 0.1]], [[2, 0], [0, 0]], [[5, -2], [5, 2]])
    assert drawn(continuations(wall, 8.0)) == [((2, 0), (5, 0)), ((2, 0.1), (5, 0.1))]
