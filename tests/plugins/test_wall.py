"""Walls: thickness at the wall's own place, physical gates, factors."""

from __future__ import annotations

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plans import plan, rectangle, turned

from sgraph_concepts.types import ConceptNode, NodeShape, Scene, ScoredEdges
from sgraph_core.graph import SGraph
from sgraph_core.proximity import build_scene
from sgraph_plugins.wall import WALL
from sgraph_plugins.wall.baseline import score
from sgraph_plugins.wall.cluster import cluster
from sgraph_plugins.wall.factor import (
    FREE_SIGMA_M,
    OWN_SIGMA_M,
    known_thicknesses,
    typical_thickness,
)
from sgraph_plugins.wall.geometry import back_to_back
from sgraph_plugins.wall.shape import shape


def pair(*segments: list[list[float]], angle: float = 0.0) -> SGraph:
    """Return surfaces whose normals lie to the left of first-to-second endpoint."""
    graph = SGraph()
    for number, segment in enumerate(segments):
        start, end = np.array(turned([tuple(p) for p in segment], angle))  # type: ignore[misc]
        along = (end - start) / np.linalg.norm(end - start)
        graph.add_wall_surface(number, [start, end], [-along[1], along[0]])
    return graph


@given(st.floats(0, 2 * np.pi), st.floats(0.04, 0.5), st.floats(-3, 3), st.floats(-0.03, 0.03))
@settings(deadline=None)
def test_thickness_is_that_in_the_middle_of_the_overlap(
    angle: float, thickness: float, shift: float, slope: float
) -> None:
    """Two sides, the second shifted along and slightly oblique; far ends do not matter."""
    upper = [[-5.0, 0.0], [5.0, 0.0]]
    middle = ((-5 + max(0, shift)) + (5 + min(0, shift))) / 2
    lower = [[x + shift, -thickness + slope * (x + shift - middle)] for x in (5.0, -5.0)]
    arrays = pair(upper, lower, angle=angle).wall_surfaces.ordered()
    lie = back_to_back(arrays, np.array([0]), np.array([1]))
    assert lie.thickness[0] == pytest.approx(thickness, abs=2e-3)
    x, y = turned([tuple(lie.centres[0])], -angle)[0]  # type: ignore[list-item]
    assert (x, y) == pytest.approx((middle, -thickness / 2), abs=2e-2)
    assert lie.end_thicknesses[0].mean() == pytest.approx(lie.thickness[0], abs=1e-9)
    swapped = back_to_back(arrays, np.array([1]), np.array([0]))
    assert swapped.thickness[0] == pytest.approx(lie.thickness[0], abs=1e-9)


def test_surfaces_that_face_each_other_have_negative_thickness() -> None:
    graph = plan(rectangle(0, 0, 5, 4))
    lie = back_to_back(graph.wall_surfaces.ordered(), np.array([0]), np.array([2]))
    assert lie.thickness[0] == pytest.approx(-4)
    assert not lie.physical(0.6, 0.3)[0]


def baseline_walls(graph: SGraph) -> set[tuple[int, int]]:
    scene = build_scene(graph.wall_surfaces.ordered())
    rows = scene.pairs[score(scene) > 0]
    return {tuple(sorted(ids)) for ids in scene.surfaces.ids[rows].tolist()}


def test_the_rule_accepts_a_wall_and_refuses_what_is_none() -> None:
    west, east = rectangle(0, 0, 5, 4), rectangle(5.2, 0, 5, 4)
    assert baseline_walls(plan(west, east)) == {(1, 7)}
    assert baseline_walls(plan(west, rectangle(5.65, 0, 5, 4))) == set()  # too thick
    assert baseline_walls(plan(west, rectangle(5.2, 3.8, 5, 4))) == set()  # too little overlap


def test_the_rule_refuses_a_wall_with_another_surface_inside() -> None:
    graph = plan(rectangle(0, 0, 5, 4), rectangle(5.5, 0, 5, 4))
    assert baseline_walls(graph) == {(1, 7)}
    graph.add_wall_surface(50, [[5.2, 0], [5.2, 4]], [1, 0])
    assert (1, 7) not in baseline_walls(graph)


def test_unphysical_pairs_are_no_walls_however_likely() -> None:
    graph = plan(rectangle(0, 0, 5, 4), rectangle(5.2, 0, 5, 4))
    scene = build_scene(graph.wall_surfaces.ordered())
    every_pair = ScoredEdges(scene.pairs, np.full(len(scene.pairs), 9.0))
    assert [c.members for c in cluster(every_pair, scene)] == [(1, 7)]


@pytest.mark.parametrize(
    ("lower", "walls"),
    [
        ([[4.0, -0.3], [0.0, -0.1]], 1),  # 10 cm thick at one end, 30 cm at the other
        ([[4.0, -0.3], [0.0, 0.02]], 1),  # noise lets the sides cross a little
        ([[4.0, -0.3], [0.0, 0.1]], 0),  # the sides cross
        ([[4.0, -0.6], [0.0, -0.1]], 0),  # too thick at one end
    ],
)
def test_a_wall_has_a_body_along_all_of_its_sides(lower: list[list[float]], walls: int) -> None:
    scene = build_scene(pair([[0.0, 0.0], [4.0, 0.0]], lower).wall_surfaces.ordered())
    assert len(cluster(ScoredEdges(scene.pairs, np.ones(len(scene.pairs))), scene)) == walls


@given(st.integers(0, 1000))
@settings(deadline=None, max_examples=50)
def test_walls_are_local_as_they_are_declared(seed: int) -> None:
    """Sides in one corridor of half a metre; what likely pairs link is clustered by itself."""
    rng = np.random.default_rng(seed)
    graph = SGraph()
    for k in range(12):
        y, x, up = rng.uniform(0, 0.5), rng.uniform(0, 3), rng.choice([-1, 1])
        graph.add_wall_surface(k, [[x, y], [x + 3, y]], [0, up])
    surfaces = graph.wall_surfaces.ordered()
    pairs = np.stack(np.triu_indices(12, 1), axis=1)
    logits = rng.normal(-0.5, 1, len(pairs))

    def walls(rows: np.ndarray) -> set[tuple[tuple[int, ...], float]]:
        inside = np.isin(pairs, rows).all(axis=1)
        scene = Scene(
            surfaces.take(rows),
            np.zeros(2),
            np.searchsorted(rows, pairs[inside]),
            np.zeros(inside.sum()),
            np.zeros((inside.sum(), 4)),
        )
        found = cluster(ScoredEdges(scene.pairs, logits[inside]), scene)
        return {(tuple(rows[list(c.members)].tolist()), c.confidence) for c in found}

    links = nx.Graph(pairs[logits > 0].tolist())
    links.add_nodes_from(range(12))
    parts = [walls(np.array(sorted(part))) for part in nx.connected_components(links)]
    assert WALL.local
    assert walls(np.arange(12)) == set().union(*parts)


def walls_across(*inner: tuple[float, int]) -> list[tuple[int, ...]]:
    """Return the walls of surfaces at y = 0 and 0.4 and others between, if all are likely."""
    graph = SGraph()
    for k, (y, up) in enumerate([(0.0, -1), (0.4, 1), *inner]):
        graph.add_wall_surface(k, [[0, y], [4, y]], [0, up])
    scene = build_scene(graph.wall_surfaces.ordered())
    return [c.members for c in cluster(ScoredEdges(scene.pairs, np.ones(len(scene.pairs))), scene)]


def test_each_leaf_of_a_double_wall_is_a_wall_and_both_together_are_none() -> None:
    assert walls_across() == [(0, 1)]
    assert walls_across((0.15, 1), (0.25, -1)) == [(0, 2), (1, 3)]


def test_a_copy_that_has_drifted_into_a_wall_leaves_it_a_wall() -> None:
    assert walls_across((0.15, 1)) == [(0, 1), (0, 2)]
    assert walls_across((0.25, 1), (-0.15, -1)) == [(0, 1), (0, 2), (1, 3), (2, 3)]
    assert walls_across((0.25, 1), (0.15, -1)) == [(0, 1), (0, 2), (1, 3), (2, 3)]


def test_one_surface_may_belong_to_several_walls() -> None:
    graph = plan(rectangle(0, 0, 10, 4), rectangle(0, 4.1, 4.9, 3), rectangle(5.1, 4.1, 4.9, 3))
    assert baseline_walls(graph) == {(2, 4), (2, 8), (5, 11)}


def test_a_wall_knows_its_centre_and_thickness() -> None:
    graph = plan(rectangle(0, 0, 5, 4), rectangle(5.2, 1, 5, 4))
    scene = build_scene(graph.wall_surfaces.ordered())
    found = shape({5: np.array([1, 7])}, scene)[5]
    assert found.thickness == pytest.approx(0.2)
    assert found.centre is not None
    assert np.array(found.centre) + scene.origin == pytest.approx([5.1, 2.5])


# -- factors ---------------------------------------------------------------------------------------


def walls(*thicknesses: float) -> list[ConceptNode]:
    return [
        ConceptNode(k, (2 * k, 2 * k + 1), shape=NodeShape((0, 0), thickness=t))
        for k, t in enumerate(thicknesses)
    ]


def test_walls_built_alike_share_their_thickness() -> None:
    known = known_thicknesses(walls(0.16, 0.15, 0.4, 0.15, 0.14))
    thickness, sigma = typical_thickness(0.14, known, OWN_SIGMA_M)
    assert thickness == pytest.approx(0.15)
    assert sigma == pytest.approx(0.015)


def test_a_wall_like_no_other_is_left_its_thickness() -> None:
    known = known_thicknesses(walls(0.14, 0.15, 0.16, 0.15, 0.4))
    assert typical_thickness(0.4, known, OWN_SIGMA_M) == (0.4, OWN_SIGMA_M)
    assert typical_thickness(0.4, known, FREE_SIGMA_M) == (0.4, FREE_SIGMA_M)


def test_sides_that_drift_pushed_together_are_held_parallel_only() -> None:
    known = known_thicknesses(walls(0.0, 0.0, 0.0))
    assert typical_thickness(0.0, known, OWN_SIGMA_M) == (0.0, FREE_SIGMA_M)
