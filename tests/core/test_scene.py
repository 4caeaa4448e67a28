"""Visibility, neighbours and features: facts of geometry, and what must not change them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plans import L_SHAPE, block, plan, rectangle

from sgraph_concepts.types import IntArray, Scene, SurfaceArrays
from sgraph_core.closures import Closures
from sgraph_core.features import (
    EDGE_FEATURES,
    NODE_FEATURES,
    FeatureSet,
    edge_features,
    edge_index,
    node_features,
)
from sgraph_core.geometry import nearest, unique_pairs
from sgraph_core.graph import SGraph
from sgraph_core.proximity import build_scene
from sgraph_core.rays import Obstacles, Rays, blocked_by_one
from sgraph_core.visibility import VISIBILITIES, facing_pairs, visibility


def seen(graph: SGraph, one: int, two: int) -> list[float]:
    return visibility(graph.wall_surfaces.ordered(), np.array([[one, two]]))[0].tolist()


def test_opposite_sides_of_a_room_see_all_of_each_other() -> None:
    assert seen(plan(rectangle(0, 0, 5, 4)), 0, 2) == [1] * len(VISIBILITIES)


def test_surfaces_back_to_back_see_nothing_of_each_other() -> None:
    graph = plan(rectangle(0, 0, 5, 4), rectangle(5.1, 0, 5, 4))
    assert seen(graph, 1, 7)[0] == 0
    assert seen(graph, 3, 5)[0] == 0  # two walls stand between these


def test_a_doorway_lets_some_lines_of_sight_through_until_it_is_closed() -> None:
    graph = SGraph()
    graph.add_wall_surface(0, [[0, 0], [0, 4]], [1, 0])  # far side of the west room
    graph.add_wall_surface(1, [[10, 0], [10, 4]], [-1, 0])  # far side of the east room
    for number, (x, side) in enumerate(((5.0, -1), (5.1, 1))):  # the wall, with a 1 m door
        graph.add_wall_surface(2 + 2 * number, [[x, 0], [x, 1.5]], [side, 0])
        graph.add_wall_surface(3 + 2 * number, [[x, 2.5], [x, 4]], [side, 0])
    free, door_closed, wide_closed, all_closed, *_ = seen(graph, 0, 1)
    assert 0 < free < 0.6
    assert (door_closed, wide_closed, all_closed) == (0, 0, 0)


def test_a_wide_opening_is_closed_only_by_the_wider_gaps() -> None:
    graph = SGraph()
    graph.add_wall_surface(0, [[0, 0], [0, 6]], [1, 0])
    graph.add_wall_surface(1, [[8, 0], [8, 6]], [-1, 0])
    graph.add_wall_surface(2, [[4, 0], [4, 2]], [-1, 0])
    graph.add_wall_surface(3, [[4, 4.5], [4, 6]], [-1, 0])
    free, door_closed, wide_closed, all_closed, *_ = seen(graph, 0, 1)
    assert free == door_closed > 0
    assert (wide_closed, all_closed) == (0, 0)


def test_a_wall_that_ends_in_the_open_is_continued_as_far_as_the_column_says() -> None:
    graph = SGraph()
    graph.add_wall_surface(0, [[0, 0], [0, 6]], [1, 0])
    graph.add_wall_surface(1, [[8, 0], [8, 6]], [-1, 0])
    graph.add_wall_surface(2, [[0, 6], [8, 6]], [0, -1])
    graph.add_wall_surface(3, [[4, 0], [4, 3]], [-1, 0])  # 3 m short of the wall that it meets
    free, door, wide, all_gaps, short, longer, longest = seen(graph, 0, 1)
    assert free == door == wide == all_gaps == short > 0
    assert (longer, longest) == (0, 0)


def brute_force_visibility(surfaces: SurfaceArrays, pairs: IntArray) -> np.ndarray:
    """The definition, ray by ray."""
    import shapely

    from sgraph_core.rays import CLEARANCE_M, FRACTIONS

    shares = []
    for one, two in pairs:
        count = 0
        for a in FRACTIONS:
            for b in FRACTIONS:
                start = (1 - a) * surfaces.segments[one, 0] + a * surfaces.segments[one, 1]
                end = (1 - b) * surfaces.segments[two, 0] + b * surfaces.segments[two, 1]
                start = start + CLEARANCE_M * surfaces.normals[one]
                end = end + CLEARANCE_M * surfaces.normals[two]
                ray = shapely.LineString([start, end])
                faces = (end - start) @ surfaces.normals[one] > 0
                faces = faces and (end - start) @ surfaces.normals[two] < 0
                others = [k for k in range(len(surfaces)) if k not in (one, two)]
                blocked = any(
                    ray.intersects(shapely.LineString(surfaces.segments[k])) for k in others
                )
                count += faces and not blocked
        shares.append(count / len(FRACTIONS) ** 2)
    return np.array(shares)


@given(st.integers(0, 10_000))
@settings(max_examples=15, deadline=None)
def test_visibility_equals_its_definition(seed: int) -> None:
    rng = np.random.default_rng(seed)
    graph = SGraph()
    for number in range(14):
        start, angle = rng.uniform(0, 8, 2), rng.uniform(0, 2 * np.pi)
        along = np.array([np.cos(angle), np.sin(angle)])
        normal = [-along[1], along[0]]
        graph.add_wall_surface(number, [start, start + rng.uniform(0.5, 4) * along], normal)
    surfaces = graph.wall_surfaces.ordered()
    pairs = np.stack(np.triu_indices(14, k=1), axis=1)
    assert visibility(surfaces, pairs)[:, 0] == pytest.approx(
        brute_force_visibility(surfaces, pairs)
    )


@given(st.integers(0, 10_000))
@settings(max_examples=100, deadline=None)
def test_one_obstacle_blocks_a_pair_when_all_rays_cross_it(seed: int) -> None:
    import shapely

    rng = np.random.default_rng(seed)
    segments = np.array([[[-1, -2], [1, -2]], [[1, 2], [-1, 2]], rng.uniform(-4, 4, (2, 2))])
    segments[:2] += rng.uniform(-0.5, 0.5, (2, 2, 2))
    along = segments[:, 1] - segments[:, 0]
    along /= np.linalg.norm(along, axis=1)[:, None]
    normals = np.stack([-along[:, 1], along[:, 0]], axis=1)
    pair = np.array([[0, 1]])
    surfaces = SurfaceArrays(np.arange(3), segments, normals)
    walls = Obstacles.of(Closures(segments, np.zeros(3)))
    lines = shapely.linestrings(Rays.between(surfaces, pair).lines[:, 0])
    blocked = shapely.intersects(lines, shapely.LineString(segments[2])).all()
    assert blocked_by_one(surfaces, pair, walls).tolist() == [blocked]


def test_facing_pairs_are_those_in_front_of_each_other() -> None:
    graph = plan(rectangle(0, 0, 5, 4), rectangle(5.1, 0, 5, 4))
    pairs = {tuple(pair) for pair in facing_pairs(graph.wall_surfaces.ordered(), 30).tolist()}
    assert {(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)} <= pairs
    assert (1, 7) not in pairs  # back to back
    assert (3, 5) in pairs  # facing, although walls stand between


def test_facing_pairs_keep_the_nearest_only() -> None:
    rows = [rectangle(6.0 * k, 0, 5, 4) for k in range(12)]
    surfaces = plan(*rows).wall_surfaces.ordered()
    few, many = facing_pairs(surfaces, 4), facing_pairs(surfaces, 40)
    assert len(few) < len(many)
    assert {tuple(p) for p in few.tolist()} <= {tuple(p) for p in many.tolist()}


def test_nearest_keeps_ties() -> None:
    groups = np.array([0, 0, 0, 0, 1])
    distances = np.array([2.0, 1.0, 1.0, 3.0, 9.0])
    assert nearest(groups, distances, 1).tolist() == [False, True, True, False, True]


@given(st.integers(0, 10_000), st.sampled_from([3, 300, 70_000]))
@settings(max_examples=50, deadline=None)
def test_nearest_equals_its_definition(seed: int, largest: int) -> None:
    rng = np.random.default_rng(seed)
    groups = rng.integers(0, largest, 40) // 2 * 2  # odd ones are empty
    distances = rng.integers(0, 6, 40) / 4
    expected = []
    for group, distance in zip(groups, distances, strict=True):
        in_group = np.sort(distances[groups == group])
        expected.append(distance <= in_group[:3][-1])
    assert nearest(groups, distances, 3).tolist() == expected


def test_pairs_are_unordered_and_come_once_and_in_order() -> None:
    one, two = np.array([[5, 2], [0, 3], [2, 5], [0, 1], [3, 0]]).T
    assert unique_pairs(one, two).tolist() == [[0, 1], [0, 3], [2, 5]]


def test_the_two_sides_of_a_wall_are_linked_although_blind() -> None:
    graph = block(0.3)
    scene = build_scene(graph.wall_surfaces.ordered())
    pairs = {tuple(p) for p in scene.pairs.tolist()}
    assert {(1, 7), (9, 15), (2, 8), (6, 12)} <= pairs


def test_an_empty_map_and_a_lone_surface_have_no_pairs() -> None:
    assert len(build_scene(SGraph().wall_surfaces.ordered()).pairs) == 0
    graph = SGraph()
    graph.add_wall_surface(5, [[0, 0], [1, 0]], [0, 1])
    assert len(build_scene(graph.wall_surfaces.ordered()).pairs) == 0


def features(
    graph: SGraph, kind: FeatureSet
) -> tuple[dict[int, np.ndarray], dict[tuple[int, int], np.ndarray]]:
    """Return node features by id, edge features by ids (j, i)."""
    scene = build_scene(graph.wall_surfaces.ordered())
    ids = scene.surfaces.ids
    nodes = dict(zip(ids.tolist(), node_features(scene, kind), strict=True))
    ends = [tuple(pair) for pair in ids[edge_index(scene)].T.tolist()]
    return nodes, dict(zip(ends, edge_features(scene, kind), strict=True))


def assert_same_features(one: SGraph, two: SGraph, kind: FeatureSet = "support") -> None:
    (nodes, edges), (other_nodes, other_edges) = features(one, kind), features(two, kind)
    assert set(edges) == set(other_edges)
    for key, value in nodes.items():
        assert other_nodes[key] == pytest.approx(value, abs=1e-5)
    for pair, value in edges.items():
        assert other_edges[pair] == pytest.approx(value, abs=1e-5)


@pytest.mark.parametrize("kind", ["support", "visibility", "frame"])
@pytest.mark.parametrize("offset", [(0.0, 0.0), (3.7, -12.1), (500_000.0, 5_400_000.0)])
@pytest.mark.parametrize("angle", [0.0, 0.3, np.pi / 4, np.pi / 2, 3.0])
def test_features_do_not_change_when_the_map_is_moved_or_turned(
    angle: float, offset: tuple[float, float], kind: FeatureSet
) -> None:
    rooms = (L_SHAPE, rectangle(8.15, 0, 5, 4), rectangle(0, 7.2, 6, 5))
    assert_same_features(plan(*rooms), plan(*rooms, angle_rad=angle, offset=offset), kind)


def test_the_papers_features_turn_with_the_map_but_do_not_move_with_it() -> None:
    straight, moved = plan(L_SHAPE), plan(L_SHAPE, offset=(3.0, -700.0))
    assert_same_features(straight, moved, "paper")
    (nodes, edges), (turned_nodes, turned_edges) = (
        features(graph, "paper") for graph in (straight, plan(L_SHAPE, angle_rad=np.pi / 2))
    )
    for number, (length, x, y) in nodes.items():
        assert turned_nodes[number] == pytest.approx([length, -y, x], abs=1e-5)
    for pair, (x, y, distance) in edges.items():
        assert turned_edges[pair] == pytest.approx([-y, x, distance], abs=1e-5)


def test_the_papers_neighbours_are_the_15_nearest_midpoints() -> None:
    surfaces = plan(*[rectangle(6.0 * k, 0, 5, 4) for k in range(8)]).wall_surfaces.ordered()
    scene = build_scene(surfaces, "nearest")
    apart = np.linalg.norm(surfaces.midpoints[:, None] - surfaces.midpoints[None], axis=2)
    linked = np.zeros(apart.shape, bool)
    linked[tuple(scene.pairs.T)] = linked[tuple(scene.pairs.T[::-1])] = True
    assert (linked.sum(axis=1) >= 15).all()
    reach = np.sort(apart, axis=1)[:, 15]
    either_asks = np.maximum.outer(reach, reach)
    others = ~np.eye(len(apart), dtype=bool)
    assert (apart <= either_asks + 1e-9)[linked].all()
    assert (apart >= either_asks - 1e-9)[~linked & others].all()


def test_a_lone_surface_has_no_nearest_neighbours() -> None:
    graph = SGraph()
    graph.add_wall_surface(5, [[0, 0], [1, 0]], [0, 1])
    assert len(build_scene(graph.wall_surfaces.ordered(), "nearest").pairs) == 0


@given(st.randoms(use_true_random=False))
@settings(max_examples=20, deadline=None)
def test_features_do_not_depend_on_the_order_of_surfaces_and_endpoints(random: object) -> None:
    graph = block(0.15)
    table = graph.wall_surfaces
    order = list(range(len(table.ids)))
    random.shuffle(order)  # type: ignore[attr-defined]
    shuffled = SGraph()
    for row in order:
        segment = table.segments[row]
        if random.random() < 0.5:  # type: ignore[attr-defined]
            segment = segment[::-1]
        shuffled.add_wall_surface(int(table.ids[row]), segment, table.normals[row])
    assert_same_features(graph, shuffled)


@pytest.mark.parametrize("kind", list(NODE_FEATURES))
def test_every_feature_is_named_and_finite(kind: FeatureSet) -> None:
    scene: Scene = build_scene(block(0.06, 0.7).wall_surfaces.ordered())
    nodes, edges = node_features(scene, kind), edge_features(scene, kind)
    assert nodes.shape == (16, len(NODE_FEATURES[kind]))
    assert edges.shape == (2 * len(scene.pairs), len(EDGE_FEATURES[kind]))
    assert np.isfinite(nodes).all()
    assert np.isfinite(edges).all()


def test_edges_come_in_both_directions() -> None:
    scene = build_scene(block(0.1).wall_surfaces.ordered())
    forward, backward = np.split(edge_index(scene), 2, axis=1)
    assert (forward[::-1] == backward).all()
