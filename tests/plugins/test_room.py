"""Rooms: outlines, stray surfaces, facades."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from plans import (
    L_SHAPE,
    Point,
    add_outline,
    block,
    members,
    plan,
    rectangle,
    regular,
    true_rooms,
    turned,
)

from sgraph_concepts.types import Memory, Scene, ScoredEdges, SurfaceArrays
from sgraph_core.detector import Detector, Scorer
from sgraph_core.graph import SGraph
from sgraph_core.proximity import build_scene
from sgraph_plugins.room.cluster import cluster
from sgraph_plugins.room.outline import outline, outlines
from sgraph_plugins.room.shape import shape


def outline_of(graph: SGraph, *missing: int) -> shapely.Polygon:
    arrays = graph.wall_surfaces.ordered()
    keep = ~np.isin(arrays.ids, missing)
    polygon = outline(arrays.take(keep))
    assert polygon is not None
    return polygon


def agreement(polygon: shapely.Polygon, corners: list[Point]) -> float:
    """Return the intersection over union."""
    true = shapely.Polygon(corners)
    return float(polygon.intersection(true).area / polygon.union(true).area)


SHAPES = {
    "rectangle": rectangle(0, 0, 6, 4),
    "L": L_SHAPE,
    "triangle": [(0, 0), (6, 0), (2, 5)],
    "octagon": regular(8, 4),
    "U": [(0, 0), (9, 0), (9, 6), (6, 6), (6, 2), (3, 2), (3, 6), (0, 6)],
}


@given(st.sampled_from(sorted(SHAPES)), st.floats(0, 2 * np.pi))
@settings(deadline=None, max_examples=40)
def test_a_closed_room_gets_its_outline_back_at_any_angle(name: str, angle: float) -> None:
    polygon = outline_of(plan(SHAPES[name], angle_rad=angle))
    assert agreement(polygon, turned(SHAPES[name], angle)) > 0.9999
    assert len(polygon.exterior.coords) - 1 == len(SHAPES[name])


def test_a_doorway_is_closed_by_a_straight_line() -> None:
    graph = SGraph()
    for number, (segment, normal) in enumerate(
        [
            ([[0, 0], [2, 0]], [0, 1]),
            ([[3, 0], [6, 0]], [0, 1]),
            ([[6, 0], [6, 4]], [-1, 0]),
            ([[6, 4], [0, 4]], [0, -1]),
            ([[0, 4], [0, 0]], [1, 0]),
        ]
    ):
        graph.add_wall_surface(number, segment, normal)
    polygon = outline_of(graph)
    assert agreement(polygon, rectangle(0, 0, 6, 4)) > 0.9999
    assert len(polygon.exterior.coords) - 1 == 4


def test_a_missing_side_is_closed_between_its_neighbours() -> None:
    assert agreement(outline_of(plan(SHAPES["rectangle"]), 2), SHAPES["rectangle"]) > 0.9999
    assert agreement(outline_of(plan(L_SHAPE), 0), L_SHAPE) > 0.9999


def test_two_long_sides_of_a_corridor_are_enough() -> None:
    corridor = rectangle(0, 0, 15, 2)
    assert agreement(outline_of(plan(corridor), 1, 3), corridor) > 0.9999


def test_a_ring_corridor_has_a_hole(detector: Detector) -> None:
    graph = plan(rectangle(0, 0, 20, 14))
    core = [(2, 2), (2, 12), (18, 12), (18, 2)]  # clockwise: the normals point outwards
    for number, (start, end) in enumerate(zip(core, core[1:] + core[:1], strict=True)):
        along = np.subtract(end, start) / np.linalg.norm(np.subtract(end, start))
        graph.add_wall_surface(10 + number, [start, end], [-along[1], along[0]])
    (room,) = detector.infer(graph).concepts["room"]
    assert room.members == (0, 1, 2, 3, 10, 11, 12, 13)
    assert len(room.shape.holes) == 1
    assert room.shape.attributes["area_m2"] == pytest.approx(20 * 14 - 16 * 10)
    assert room.shape.centre is not None
    x, y = room.shape.centre
    assert not (2 < x < 18 and 2 < y < 12)  # the centre lies in the corridor, not in the core


@given(st.integers(0, 1000))
@settings(deadline=None, max_examples=25)
def test_noise_changes_an_outline_little(seed: int) -> None:
    rng = np.random.default_rng(seed)
    arrays = plan(L_SHAPE).wall_surfaces.ordered()
    noisy = SGraph()
    for k, segment in enumerate(arrays.segments):
        ends = segment + rng.normal(0, 0.02, (2, 2))
        along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
        noisy.add_wall_surface(k, ends, [along[1], -along[0]])
    assert agreement(outline_of(noisy), L_SHAPE) > 0.97


def test_surfaces_that_enclose_nothing_have_no_outline() -> None:
    graph = SGraph()
    graph.add_wall_surface(0, [[0, 0], [4, 0]], [0, 1])
    graph.add_wall_surface(1, [[5, 0], [9, 0]], [0, 1])
    assert outline(graph.wall_surfaces.ordered()) is None


def test_many_lines_keep_the_outline_affordable() -> None:
    saw = [(float(x), 0.0 if x % 2 else 0.4) for x in range(120)]
    corners = [*saw, (119.0, 10.0), (0.0, 10.0)]
    polygon = outline_of(plan(corners))
    assert agreement(polygon, corners) > 0.98


# -- clustering ------------------------------------------------------------------------------------


def scored(
    graph: SGraph, related: set[frozenset[int]], against: float = -3.0
) -> tuple[ScoredEdges, Scene]:
    scene = build_scene(graph.wall_surfaces.ordered())
    ids = scene.surfaces.ids
    logits = [
        3.0 if any({int(ids[a]), int(ids[b])} <= r for r in related) else against
        for a, b in scene.pairs
    ]
    return ScoredEdges(scene.pairs, np.array(logits)), scene


def test_a_stray_surface_joins_its_most_likely_room() -> None:
    graph = plan(rectangle(0, 0, 5, 4))
    for against, expected in ((-1.0, (0, 1, 2, 3)), (-3.0, (0, 1, 2))):
        edges, scene = scored(graph, {frozenset({0, 1, 2})}, against)
        (room,) = cluster(edges, scene)
        assert room.members == expected


def test_the_short_end_of_a_wall_joins_no_rooms_together() -> None:
    graph = plan(rectangle(0, 0, 5, 4), rectangle(5.2, 0, 5, 4))
    graph.add_wall_surface(20, [[5, 2], [5.2, 2]], [0, 1])
    rooms = {frozenset({0, 1, 2, 3}), frozenset({4, 5, 6, 7})}
    edges, scene = scored(graph, {frozenset({*room, 20}) for room in rooms}, against=-1.0)
    of_jamb = (scene.surfaces.ids[scene.pairs] == 20).any(axis=1)
    edges = ScoredEdges(edges.pairs, np.where(of_jamb, 9.0, edges.logits))
    found = {
        frozenset(scene.surfaces.ids[list(c.members)].tolist()) - {20}
        for c in cluster(edges, scene)
    }
    assert found == rooms


def test_a_facade_is_no_room() -> None:
    graph = plan(list(reversed(rectangle(0, 0, 8, 6))))  # clockwise: the normals point outwards
    pairs = np.array([[0, 1], [1, 2], [2, 3], [0, 3]])
    scene = build_scene(graph.wall_surfaces.ordered())
    assert cluster(ScoredEdges(pairs, np.full(4, 5.0)), scene) == []


@pytest.mark.parametrize("scorer", ["network", "baseline"])
@pytest.mark.parametrize("clusterers", [{}, {"room": "cycles"}], ids=["multicut", "cycles"])
@pytest.mark.parametrize("pieces", [1, 3])
def test_a_facade_around_rooms_stays_out_of_them(
    scorer: Scorer, clusterers: dict[str, str], pieces: int
) -> None:
    graph = block(0.15)
    low, east, north = -0.3, 10.45, 8.45
    corners = [(low, low), (low, north), (east, north), (east, low)]  # clockwise
    outline = [
        (float(x), float(y))
        for start, end in zip(corners, corners[1:] + corners[:1], strict=True)
        for x, y in np.linspace(start, end, pieces, endpoint=False)
    ]
    add_outline(graph, outline, first_id=100)
    result = Detector(scorer=scorer, clusterers=clusterers).infer(graph)
    assert members(result, "room") == true_rooms(graph)


def test_a_stray_surface_joins_no_room_behind_it() -> None:
    graph = plan(rectangle(0, 0, 5, 4))
    graph.add_wall_surface(9, [[0, -0.2], [5, -0.2]], [0, -1])
    edges, scene = scored(graph, {frozenset({0, 1, 2, 3})}, against=-1.0)
    (room,) = cluster(edges, scene)
    assert room.members == (0, 1, 2, 3)


@given(st.floats(0.05, 0.49) | st.floats(0.51, 0.95), st.floats(0, 2 * np.pi))
@settings(deadline=None, max_examples=30)
def test_what_nobody_fits_into_is_no_room(width: float, angle: float) -> None:
    graph = plan(rectangle(0, 0, 5, width), angle_rad=angle)
    scene = build_scene(graph.wall_surfaces.ordered())
    found = cluster(ScoredEdges(scene.pairs, np.ones(len(scene.pairs))), scene)
    assert len(found) == (width > 0.5)


def test_two_surfaces_are_no_room() -> None:
    edges, scene = scored(plan(rectangle(0, 0, 5, 4)), {frozenset({0, 1})})
    assert cluster(edges, scene) == []


@given(st.integers(0, 100_000))
@settings(deadline=None, max_examples=150)
def test_any_surfaces_have_a_proper_outline_or_none(seed: int) -> None:
    rng = np.random.default_rng(seed)
    graph = SGraph()
    for number in range(rng.integers(3, 9)):
        start, angle = rng.uniform(0, 3, 2), rng.choice([0, np.pi / 2, rng.uniform(0, 6)])
        along = np.array([np.cos(angle), np.sin(angle)])
        end = start + rng.choice([0.01, 0.3, 3.0]) * along
        graph.add_wall_surface(number, [start, end], [-along[1], along[0]])
    polygon = outline(graph.wall_surfaces.ordered())
    assert polygon is None or (polygon.is_valid and polygon.area > 0)


@given(st.integers(0, 10_000), st.floats(-3, 3))
@settings(max_examples=30, deadline=None)
def test_an_outline_moves_and_turns_with_its_surfaces(seed: int, angle: float) -> None:
    """Also where surfaces leave much open: then a face's winding number varies within it."""
    rng = np.random.default_rng(seed)
    graph = SGraph()
    for number, direction in enumerate(np.sort(rng.uniform(0, 2 * np.pi, 6))):
        towards = np.array([np.cos(direction), np.sin(direction)])
        across = np.array([-towards[1], towards[0]])
        middle = rng.uniform(1, 4) * towards
        half = rng.uniform(0.3, 2) * across
        graph.add_wall_surface(number, [middle - half, middle + half], -towards)
    surfaces = graph.wall_surfaces.ordered()
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    moved = SurfaceArrays(
        surfaces.ids, surfaces.segments @ turn.T + [60.0, -40.0], surfaces.normals @ turn.T
    )
    one, two = outline(surfaces), outline(moved)
    assert (one is None) == (two is None)
    if one is not None and two is not None:
        assert two.area == pytest.approx(one.area, abs=1e-2)


def test_of_rooms_within_one_another_that_are_equal_but_for_rounding_one_stays() -> None:
    for inset in (0.0, 1e-5):
        inner = rectangle(inset, inset, 5 - 2 * inset, 4 - 2 * inset)
        rooms = [
            plan(corners).wall_surfaces.ordered() for corners in (rectangle(0, 0, 5, 4), inner)
        ]
        for order in ((0, 1), (1, 0)):
            found = outlines({room: rooms[k] for room, k in enumerate(order)}, Memory())
            assert found[0].area == pytest.approx(20, abs=1e-3)
            assert 1 not in found or found[1].area < 1e-3


def with_a_gap(corners: list[Point], side: int, start: float, end: float) -> list[list[Point]]:
    """Return the sides of a room; one that runs along y is open from one y to another."""
    sides = [[corners[k], corners[(k + 1) % 4]] for k in range(4)]
    first, last = sides.pop(side)
    return [*sides, [first, (first[0], start)], [(last[0], end), last]]


@pytest.mark.parametrize(
    ("width", "height", "beside"),
    [
        (5, 4, rectangle(5, 1, 2, 2)),
        (5, 4, rectangle(4.9, 0, 5, 4)),
        (4.95, 3.95, rectangle(4.85, 0, 4.95, 3.95)),
        (3.45, 4.15, rectangle(3.35, 0, 3.45, 4.15)),
    ],
    ids=["touching", "equal", "equal-19.5525", "equal-14.3175"],
)
def test_rounding_does_not_decide_where_a_doorway_is(
    width: float, height: float, beside: list[Point]
) -> None:
    """Whether rooms overlap that touch, and which of two equal ones that overlap stays whole."""
    west = with_a_gap(rectangle(0, 0, width, height), 1, 0.8, 2.1)
    far = [(31.7, 13.3), (35.1, 13.3)]  # else the rooms lie evenly around the scene's origin
    east = with_a_gap(beside, 3, 2.7, 1.3)
    rows = {0: np.arange(5), 1: np.arange(5, 10)}
    for angle in np.linspace(-3, 3, 40):
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        graph = SGraph()
        for number, (start, end) in enumerate(np.array([*west, *east, far]) @ turn.T + 7 * angle):
            along = (end - start) / np.linalg.norm(end - start)
            graph.add_wall_surface(number, [start, end], [-along[1], along[0]])
        found = shape(rows, build_scene(graph.wall_surfaces.ordered()))[0].attributes
        assert found["area_m2"] == pytest.approx(width * height, abs=2e-3)
        (door,) = found["doorways"]
        assert door["position"] == pytest.approx(turn @ [width, 1.7] + 7 * angle, abs=2e-3)
        assert door["width_m"] == pytest.approx(0.8, abs=2e-3)
