"""Flatten, drop duplicates, split: and what must survive it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plans import L_SHAPE, block, plan, rectangle, regular

from sgraph_concepts.errors import InputError
from sgraph_core.graph import SGraph
from sgraph_core.preprocess import flatten, preprocess


def surfaces(*rows: tuple[list[list[float]], list[float]]) -> SGraph:
    graph = SGraph()
    for number, (segment, normal) in enumerate(rows):
        graph.add_wall_surface(number, segment, normal)
    return graph


@given(st.floats(0, 2 * np.pi), st.floats(-100, 100), st.floats(0.5, 20))
def test_points_of_a_line_flatten_to_that_line(angle: float, x: float, length: float) -> None:
    along, across = (
        np.array([np.cos(angle), np.sin(angle)]),
        np.array([-np.sin(angle), np.cos(angle)]),
    )
    start = np.array([x, 1.0])
    points = start + np.linspace(0, length, 30)[:, None] * along
    with_height = np.column_stack([points, np.linspace(0, 2.5, 30)])
    segment, normal = flatten(with_height, start + 2 * across)
    found = segment if np.linalg.norm(segment[0] - start) < length / 2 else segment[::-1]
    assert found == pytest.approx(np.array([start, start + length * along]), abs=1e-6)
    assert normal == pytest.approx(across, abs=1e-6)


def test_noise_on_both_sides_cancels_in_the_fit() -> None:
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(0, 10, 4000), rng.normal(0, 0.02, 4000)])
    segment, normal = flatten(points, [5, 1])
    assert np.abs(segment[:, 1]).max() < 0.01
    assert normal[1] > 0.9999


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ([[0, 0]], "must be"),
        ([[0, 0, 0, 0], [1, 1, 1, 1]], "must be"),
        ([[0, 0], [np.nan, 1]], "must be finite"),
        ([[1, 1, 0], [1, 1, 2]], "one vertical line"),
    ],
)
def test_points_without_a_line_are_refused(points: list[list[float]], message: str) -> None:
    with pytest.raises(InputError, match=message):
        flatten(points, [0, 0])


def test_a_surface_mapped_twice_is_dropped_and_remembered() -> None:
    graph = surfaces(
        ([[0, 0], [4, 0]], [0, 1]),
        ([[1, 0.03], [3, 0.02]], [0, 1]),
        ([[0, 0.02], [4, 0.02]], [0, 1]),
    )
    fragments = preprocess(graph.wall_surfaces.ordered())
    assert fragments.surfaces.ids.tolist() == [0]
    assert fragments.duplicates == {1: 0, 2: 0}
    assert fragments.with_duplicates(frozenset({0})) == {0, 1, 2}


def test_a_copy_that_may_not_be_dropped_is_a_surface_of_its_own() -> None:
    graph = surfaces(
        ([[0, 0], [4, 0]], [0, 1]),
        ([[1, 0.03], [3, 0.02]], [0, 1]),
        ([[0, 0.02], [4, 0.02]], [0, 1]),
    )
    fragments = preprocess(graph.wall_surfaces.ordered(), lambda _original, copy: copy != 1)
    assert fragments.surfaces.ids.tolist() == [0, 1]
    assert fragments.duplicates == {2: 0}


def test_neighbours_in_one_line_are_no_duplicates() -> None:
    graph = surfaces(([[0, 0], [4, 0]], [0, 1]), ([[3.5, 0.02], [8, 0.02]], [0, 1]))
    assert preprocess(graph.wall_surfaces.ordered()).duplicates == {}


@pytest.mark.parametrize("thickness", [0.06, 0.04])
def test_the_sides_of_a_thin_wall_survive(thickness: float) -> None:
    graph = plan(rectangle(0, 0, 5, 4), rectangle(5 + thickness, 0, 5, 4))
    fragments = preprocess(graph.wall_surfaces.ordered())
    assert sorted(fragments.surfaces.ids.tolist()) == list(range(8))
    assert fragments.duplicates == {}


@pytest.mark.parametrize("graph", [block(0.06, np.pi / 4), plan(regular(8, 4)), plan(L_SHAPE)])
def test_closed_rooms_at_exact_angles_are_left_alone(graph: SGraph) -> None:
    before = graph.wall_surfaces.ordered()
    after = preprocess(before).surfaces
    assert (after.ids == before.ids).all()
    assert (after.segments == before.segments).all()


@given(st.floats(0, 2 * np.pi))
def test_a_surface_that_runs_through_two_rooms_is_split_where_their_wall_meets_it(
    angle: float,
) -> None:
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    rows = [
        ([[0, 0], [10, 0]], [0, 1]),  # along both rooms
        ([[4.9, 0.05], [4.9, 4]], [-1, 0]),  # west side of the wall between them
        ([[5.1, 0.05], [5.1, 4]], [1, 0]),  # east side
    ]
    graph = surfaces(
        *(((np.array(s) @ turn.T).tolist(), (turn @ np.array(n)).tolist()) for s, n in rows)
    )
    fragments = preprocess(graph.wall_surfaces.ordered()).surfaces
    ends = (fragments.segments[fragments.ids == 0] @ turn)[:, :, 0]
    assert sorted(np.sort(ends, axis=1).tolist()) == [
        pytest.approx([0, 4.9], abs=1e-6),
        pytest.approx([5.1, 10], abs=1e-6),
    ]


@pytest.mark.parametrize(
    "other",
    [
        ([[0.3, 0], [0.3, 3]], [1, 0]),  # near an end: a corner
        ([[5, 0], [5, 0.2]], [1, 0]),  # a pilaster: does not divide the room
        ([[5, 0], [5, -3]], [1, 0]),  # behind it
        ([[0, 0.05], [10, 0.09]], [0, -1]),  # alongside it
        ([[5, 1], [5, 3]], [1, 0]),  # does not reach it
    ],
)
def test_what_does_not_divide_the_space_in_front_does_not_split(
    other: tuple[list[list[float]], list[float]],
) -> None:
    graph = surfaces(([[0, 0], [10, 0]], [0, 1]))
    normal = np.array(other[0][1], float) - other[0][0]
    normal = np.array([-normal[1], normal[0]]) / np.linalg.norm(normal)
    graph.add_wall_surface(1, other[0], normal if normal @ other[1] > 0 else -normal)
    assert sorted(preprocess(graph.wall_surfaces.ordered()).surfaces.ids.tolist()) == [0, 1]


def test_nothing_is_lost_of_an_empty_map_and_of_one_surface() -> None:
    assert len(preprocess(SGraph().wall_surfaces.ordered()).surfaces) == 0
    assert (
        len(preprocess(surfaces(([[0, 0], [1, 0]], [0, 1])).wall_surfaces.ordered()).surfaces) == 1
    )
