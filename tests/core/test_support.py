"""What a building has in common with a surface."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plans import block, plan, rectangle

from sgraph_concepts.types import SurfaceArrays
from sgraph_core.graph import SGraph
from sgraph_core.support import alignment, collinear, collinear_lengths, lines_near


def surfaces(*rows: tuple[list[list[float]], list[float]]) -> SurfaceArrays:
    graph = SGraph()
    for number, (segment, normal) in enumerate(rows):
        graph.add_wall_surface(number, segment, normal)
    return graph.wall_surfaces.ordered()


def test_surfaces_in_line_count_by_their_length_their_distance_and_their_side() -> None:
    line = surfaces(
        ([[0, 0], [2, 0]], [0, 1]),
        ([[6, 0], [9, 0]], [0, 1]),  # its end lies 5 m from the first surface's middle
        ([[-8, 0.05], [-4, 0.05]], [0, -1]),  # a third of the 10 cm and 5 m / 100 aside that count
        ([[30, 0], [34, 0]], [0, 1]),
        ([[0, 3], [2, 3]], [0, -1]),
        ([[1, 1], [1, 2]], [1, 0]),
    )
    same, other = collinear_lengths(line)[0]
    assert same == pytest.approx(3 * (1 - 5 / 20))  # from the second's end to the first's middle
    assert other == pytest.approx(4 * (1 - 5 / 20) * (1 - 0.05 / 0.15))
    assert collinear_lengths(line)[[4, 5]] == pytest.approx(np.zeros((2, 2)))


def test_of_a_long_and_a_short_surface_the_long_ones_line_counts() -> None:
    pair = surfaces(([[0, 0], [6, 0]], [0, 1]), ([[10, 0], [10.4, 0.04]], [-0.0995, 0.995]))
    lengths = collinear_lengths(pair)[:, 0]
    weight = (1 - 4.2 / 20) * (1 - 0.04 / 0.142)
    assert lengths == pytest.approx([weight * pair.lengths[1], weight * 6])


@given(st.integers(0, 10_000))
@settings(max_examples=30, deadline=None)
def test_no_surface_in_line_is_overlooked(seed: int) -> None:
    rng = np.random.default_rng(seed)
    count, angle = 40, rng.uniform(0, np.pi)
    along, across = rng.uniform(0, 60, count), rng.integers(0, 3, count) + rng.normal(0, 0.1, count)
    lengths, turns = rng.uniform(0.1, 8, count), angle + rng.normal(0, 0.02, count)
    middles = along[:, None] * [np.cos(angle), np.sin(angle)]
    middles += across[:, None] * [-np.sin(angle), np.cos(angle)]
    tangents = np.stack([np.cos(turns), np.sin(turns)], axis=1) * rng.choice([-1, 1], (count, 1))
    half = lengths[:, None] / 2 * tangents
    normals = np.stack([tangents[:, 1], -tangents[:, 0]], axis=1)
    drawn = SurfaceArrays(
        np.arange(count), np.stack([middles - half, middles + half], axis=1), normals
    )
    one, two = np.nonzero(~np.eye(count, dtype=bool))
    shares = collinear(drawn, one, two)
    expected = np.zeros((count, 2))
    np.add.at(expected, one, shares * lengths[two, None])
    assert collinear_lengths(drawn) == pytest.approx(expected)
    assert expected.any()
    asking = np.flatnonzero(rng.random(count) < 0.3)
    found = set(zip(*(rows.tolist() for rows in lines_near(drawn, asking)), strict=True))
    counts = shares.any(axis=1) & np.isin(one, asking)
    assert set(zip(one[counts].tolist(), two[counts].tolist(), strict=True)) <= found


def test_the_walls_of_a_block_support_one_another_and_what_stands_askew_has_no_support() -> None:
    graph = block(0.1)
    count = 16
    graph.add_wall_surface(count, [[1.3, 1.1], [1.9, 1.5]], [0.4 / 0.52**0.5, -0.6 / 0.52**0.5])
    support = collinear_lengths(graph.wall_surfaces.ordered())
    assert (support[:count].sum(axis=1) > 1).all()
    assert support[count] == pytest.approx([0, 0])


@pytest.mark.parametrize("angle", [0.0, 0.4])
def test_a_surface_runs_along_or_across_a_building_or_at_45_degrees(angle: float) -> None:
    graph = plan(rectangle(0, 0, 40, 30), angle_rad=angle)
    direction = np.array([np.cos(angle + np.pi / 4), np.sin(angle + np.pi / 4)])
    middle = graph.wall_surfaces.segments.reshape(-1, 2).mean(axis=0)
    askew = [middle, middle + 0.1 * direction]
    graph.add_wall_surface(4, askew, [-direction[1], direction[0]])
    aligned = alignment(graph.wall_surfaces.ordered())
    assert aligned[:4] == pytest.approx(np.full(4, 139.9 / 140.1), abs=1e-6)
    assert aligned[4] == pytest.approx(-139.9 / 140.1, abs=1e-6)


def test_no_surfaces_have_no_support() -> None:
    none = surfaces()
    assert collinear_lengths(none).shape == (0, 2)
    assert alignment(none).shape == (0,)
