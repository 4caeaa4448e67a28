"""The factor graph: optima solved by hand, what informs and what does not."""

from __future__ import annotations

import gtsam
import numpy as np
import pytest
import zone
from drive import WALL_M, Drive, drive, with_walls

from sgraph_concepts.errors import InputError
from sgraph_concepts.types import ConceptNode, FactorContext, FloatArray, NodeShape
from sgraph_core import infer
from sgraph_core.backend import Keys, concept_factors, low_layers, optimize, robust
from sgraph_core.backend.back_projection import shifted
from sgraph_core.backend.observed import observed_in
from sgraph_core.backend.published import centre_of
from sgraph_core.backend.published import factors as published
from sgraph_core.backend.ties import TieNoise, tie_planes
from sgraph_core.evaluation.trajectory import ate_rmse
from sgraph_core.graph import SGraph

LEVEL = [0, 0, 0, 0, 0, 0, 1]
KEYS = Keys()


def line_of_two() -> SGraph:
    """Two keyframes on the x axis that see one wall ahead of them."""
    graph = SGraph()
    graph.add_keyframe(0, LEVEL)
    graph.add_keyframe(1, [1, 0, 0, 0, 0, 0, 1])
    graph.add_odometry(0, 1, [1, 0, 0, 0, 0, 0, 1], [0.1] * 6)
    graph.add_wall_surface(0, [[5, -1], [5, 1]], [-1, 0])
    graph.observe(0, 0, [-1, 0, 0, 5.0], [0.1, 0.1])
    graph.observe(0, 1, [-1, 0, 0, 3.9], [0.1, 0.1])
    return graph


def test_the_low_layers_reach_the_optimum_solved_by_hand() -> None:
    """Minimise (x - 1)^2 + (p - 5)^2 + (p - x - 3.9)^2: x = 31/30, p = 149/30."""
    result = optimize(line_of_two()).graph
    assert result.keyframe(1).pose[:3] == pytest.approx([31 / 30, 0, 0], abs=1e-4)
    assert result.wall_surface(0).segment[:, 0] == pytest.approx([149 / 30] * 2, abs=1e-4)


def test_a_consistent_graph_has_no_error() -> None:
    graph = line_of_two()
    consistent = SGraph()
    consistent.add_keyframe(0, LEVEL)
    consistent.add_keyframe(1, [1, 0, 0, 0, 0, 0, 1])
    consistent.add_odometry(0, 1, [1, 0, 0, 0, 0, 0, 1], [0.1] * 6)
    consistent.add_wall_surface(0, [[5, -1], [5, 1]], [-1, 0])
    consistent.observe(0, 1, [-1, 0, 0, 4.0], [0.1, 0.1])
    low = low_layers(consistent)
    assert low.graph.error(low.values) == pytest.approx(0, abs=1e-12)
    assert low_layers(graph).graph.error(low_layers(graph).values) > 0.1


def test_the_order_of_keyframes_in_the_map_is_that_of_the_drive() -> None:
    """Neither ids nor stamps say so: keyframe 9 came before keyframe 4, and is held in place."""
    graph = SGraph()
    graph.add_keyframe(9, LEVEL, stamp=8.0)
    graph.add_keyframe(4, [1, 0, 0, 0, 0, 0, 1], stamp=2.0)
    graph.add_odometry(4, 9, [-1, 0, 0, 0, 0, 0, 1], [0.1] * 6)
    for surface, keyframes in ((0, [4, 9]), (1, [4])):
        graph.add_wall_surface(surface, [[5, -1], [5, 1]], [-1, 0])
        for keyframe in keyframes:
            graph.observe(surface, keyframe, [-1, 0, 0, 4.0], [0.1, 0.1])
    assert observed_in(graph).first_seen.tolist() == [0, 1]
    assert optimize(graph).graph.keyframe(9).pose == pytest.approx(LEVEL, abs=1e-6)


def test_default_keys_differ_as_far_as_ids_go() -> None:
    last = 2**53 - 1
    keys = [KEYS.keyframe(last), KEYS.surface(last)]
    keys += [KEYS.node("room", 2**32 - 1, 255), KEYS.node("wall", 2**32 - 1, 255)]
    keys += [KEYS.tie(0, 2**28 - 1), KEYS.tie(2**28 - 2, 2**28 - 1)]
    assert len(set(keys)) == 6
    with pytest.raises(InputError, match=r"wall surface 268435456: .* ids below 2\^28"):
        KEYS.tie(2**28, 0)
    with pytest.raises(InputError, match=r"room 4294967296: .* ids below 2\^32"):
        KEYS.node("room", 2**32, 0)


def facing_wall(gap_seen: float) -> SGraph:
    """Two keyframes on either side of a wall, each sees its own side."""
    graph = SGraph()
    graph.add_keyframe(0, LEVEL)
    graph.add_keyframe(1, [5, 0, 0, 0, 0, 0, 1])
    graph.add_odometry(0, 1, [5, 0, 0, 0, 0, 0, 1], [1e-4] * 6)
    graph.add_wall_surface(10, [[2, -1], [2, 1]], [-1, 0])
    graph.add_wall_surface(11, [[2 + gap_seen, -1], [2 + gap_seen, 1]], [1, 0])
    graph.observe(10, 0, [-1, 0, 0, 2.0], [0.1, 0.1])
    graph.observe(11, 1, [1, 0, 0, 3.0 - gap_seen], [0.1, 0.1])
    return graph


def test_a_tie_reaches_the_optimum_solved_by_hand() -> None:
    """Sides seen at 2.0 and 2.3, tied at 0.2 with variance s^2, seen with variance q^2.

    The excess of 0.1 is shared: each side moves by 0.1 q^2 / (2 q^2 + s^2).
    """
    graph, s, q = facing_wall(0.3), 0.05, 0.1
    low = low_layers(graph)
    tie = tie_planes(
        (KEYS.surface(10), KEYS.surface(11)),
        KEYS.node("wall", 0, 0),
        np.array([2.15, 0.0]),
        np.array([-1.0, 0.0]),
        0.2,
        TieNoise(0.01, s),
    )
    factors, values = gtsam.NonlinearFactorGraph(low.graph), gtsam.Values(low.values)
    for factor in tie.factors:
        factors.add(factor)
    for key, value in tie.values:
        values.insert(key, value)
    solved = gtsam.LevenbergMarquardtOptimizer(factors, values).optimize()
    moved = 0.1 * q**2 / (2 * q**2 + s**2)
    near = solved.atOrientedPlane3(KEYS.surface(10)).planeCoefficients()
    far = solved.atOrientedPlane3(KEYS.surface(11)).planeCoefficients()
    assert near == pytest.approx([-1, 0, 0, 2 + moved], abs=1e-4)
    assert far == pytest.approx([1, 0, 0, -(2.3 - moved)], abs=1e-4)


def test_a_tie_of_coinciding_planes_brings_them_together() -> None:
    low = low_layers(line_of_two())
    values, factors = gtsam.Values(low.values), gtsam.NonlinearFactorGraph(low.graph)
    other = KEYS.surface(1)
    values.insert(other, gtsam.OrientedPlane3(-1, 0, 0, 5.4))
    tie = tie_planes(
        (KEYS.surface(0), other),
        KEYS.node("room", 0, 0),
        np.array([5.2, 0.0]),
        np.array([-1.0, 0.0]),
        None,
        TieNoise(0.01, 0.01),
    )
    for factor in tie.factors:
        factors.add(factor)
    for key, value in tie.values:
        values.insert(key, value)
    solved = gtsam.LevenbergMarquardtOptimizer(factors, values).optimize()
    planes = [solved.atOrientedPlane3(key).planeCoefficients() for key in (KEYS.surface(0), other)]
    assert planes[0] == pytest.approx(planes[1], abs=1e-5)


# -- the published factor ----------------------------------------------------------------------


def test_the_published_centre_is_midway_between_opposed_planes() -> None:
    room = np.array([[1, 0, 0, 0], [-1, 0, 0, 6], [0, 1, 0, -1], [0, -1, 0, 5]], float)
    assert centre_of(np.array([1.0, 4.0]), room) == pytest.approx([3, 3])
    corridor = room[:2]
    assert centre_of(np.array([1.0, 4.0]), corridor) == pytest.approx([3, 4])
    wall = np.array([[-1, 0, 0, 2], [1, 0, 0, -2.2]], float)
    assert centre_of(np.array([0.0, 7.0]), wall) == pytest.approx([2.1, 7])


def check_jacobian(factor: gtsam.NoiseModelFactor, values: gtsam.Values) -> FloatArray:
    """Compare a factor's Jacobian with central differences; return minus its whitened error."""
    linear = factor.linearize(values)
    jacobian, rhs = linear.jacobian()
    step = 1e-5
    for column in range(jacobian.shape[1]):
        moved = []
        for sign in (1, -1):
            delta, start = gtsam.VectorValues(), 0
            for key in linear.keys():  # noqa: SIM118
                width = values.zeroVectors().at(key).size
                part = np.zeros(width)
                if start <= column < start + width:
                    part[column - start] = sign * step
                delta.insert(key, part)
                start += width
            moved.append(-factor.linearize(values.retract(delta)).jacobian()[1])
        numeric = (moved[0] - moved[1]) / (2 * step)
        assert jacobian[:, column] == pytest.approx(numeric, rel=1e-4, abs=1e-4)
    return np.asarray(rhs)


@pytest.mark.parametrize("thickness", [0.2, None])
def test_the_jacobians_of_a_tie_are_the_derivatives_of_its_errors(thickness: float | None) -> None:
    planes = (gtsam.OrientedPlane3(-1, 0.02, 0, 2.1), gtsam.OrientedPlane3(1, 0.01, 0, -2.3))
    keys = (KEYS.surface(0), KEYS.surface(1))
    tie = tie_planes(
        keys,
        KEYS.tie(0, 1),
        np.array([2.1, 0.4]),
        np.array([-1.0, 0.0]),
        thickness,
        TieNoise(0.01, 0.02),
    )
    values = gtsam.Values()
    for key, value in (*zip(keys, planes, strict=True), *tie.values):
        values.insert(key, value)
    for factor in tie.factors:
        check_jacobian(factor, values)


def test_the_published_factors_jacobian_is_the_derivative_of_its_error() -> None:
    planes = {
        0: np.array([0.8, 0.6, 0, 1.0]),
        1: np.array([-1.0, 0, 0, 4]),
        2: np.array([0, 1.0, 0, 2]),
    }
    node = ConceptNode(0, (0, 1, 2), shape=NodeShape(centre=(1.0, 0.5)))
    keys = {member: KEYS.surface(member) for member in planes}
    context = FactorContext(keys, planes, {}, [node], lambda n: KEYS.node("room", 0, n))
    result = published(node, context)
    values = gtsam.Values()
    for member, plane in planes.items():
        values.insert(keys[member], gtsam.OrientedPlane3(*plane))
    values.insert(result.values[0][0], gtsam.Point2(0.3, -0.2))
    rhs = check_jacobian(result.factors[0], values)
    assert -rhs == pytest.approx(
        (np.array([0.3, -0.2]) - centre_of(np.array([1.0, 0.5]), np.array(list(planes.values()))))
        / 0.1,
        abs=1e-6,
    )


# -- what informs ------------------------------------------------------------------------------


def covariances(graph: SGraph, factor: str) -> tuple[FloatArray, FloatArray]:
    """Return the covariance traces of all poses and of all planes, at the map as it is."""
    low = low_layers(graph)
    extra = concept_factors(graph, factor_types={"wall": factor})
    factors, values = gtsam.NonlinearFactorGraph(low.graph), gtsam.Values(low.values)
    factors.push_back(extra.graph)
    values.insert(extra.values)
    values = gtsam.LevenbergMarquardtOptimizer(factors, values).optimize()
    marginals = gtsam.Marginals(factors, values)
    poses = [KEYS.keyframe(i) for i in graph.keyframes.ids.tolist()]
    planes = [KEYS.surface(i) for i in low.surfaces]
    return tuple(  # type: ignore[return-value]
        np.array([np.trace(marginals.marginalCovariance(key)) for key in keys])
        for keys in (poses, planes)
    )


def test_wall_ties_inform_about_planes_and_the_published_factor_does_not() -> None:
    graph = with_walls(drive(0))
    poses, planes = covariances(graph, "none")
    published_poses, published_planes = covariances(graph, "published")
    tied_poses, tied_planes = covariances(graph, "sgraph_plugins.wall.factor:factors")
    assert published_poses == pytest.approx(poses, rel=1e-4)
    assert published_planes == pytest.approx(planes, rel=1e-4)
    of_walls = sorted({member for wall in graph.concepts["wall"] for member in wall.members})
    rows = np.searchsorted(np.unique(graph.observations.surface_ids), of_walls)
    assert (tied_planes[rows] < 0.999 * planes[rows]).all()
    assert tied_planes[rows].mean() < 0.7 * planes[rows].mean()
    assert tied_poses[-1] < 0.8 * poses[-1]


def error_of(simulated: Drive, factor: str) -> float:
    solved = optimize(with_walls(simulated), {"wall": factor}).graph
    return ate_rmse(solved.keyframes.poses[:, :3], simulated.positions)


def test_wall_ties_straighten_a_drifted_trajectory_and_the_published_factor_does_not() -> None:
    seeds = [drive(seed) for seed in range(12)]
    plain = np.array([error_of(s, "none") for s in seeds])
    as_published = np.array([error_of(s, "published") for s in seeds])
    tied = np.array([error_of(s, "sgraph_plugins.wall.factor:factors") for s in seeds])
    assert as_published == pytest.approx(plain, rel=1e-3)
    assert np.median(tied / plain) < 0.8
    assert (tied < plain).sum() >= 10


def test_what_was_inferred_from_the_demonstration_map_improves_it(demo_map: object) -> None:
    from pathlib import Path

    from sgraph_core import load
    from sgraph_core.evaluation.trajectory import read_tum, trajectory_error

    graph = load(str(demo_map))
    reference = read_tum(Path(str(demo_map)).with_suffix(".tum"))
    planes_only = optimize(graph).graph
    improved = infer(graph, optimize=True)
    before = trajectory_error(graph, *reference)
    assert trajectory_error(planes_only, *reference) < 0.1 * before
    assert trajectory_error(improved, *reference) < 0.95 * trajectory_error(planes_only, *reference)


# -- the S-Graph afterwards ----------------------------------------------------------------------


def test_surfaces_lie_on_their_planes_and_unobserved_ones_stay() -> None:
    graph = with_walls(drive(3))
    unseen = len(graph.wall_surfaces.ids)
    graph.add_wall_surface(unseen, [[20, 0], [24, 0]], [0, 1])
    solved = optimize(graph)
    result = solved.graph
    for surface in np.unique(graph.observations.surface_ids).tolist():
        plane = solved.values.atOrientedPlane3(KEYS.surface(surface)).planeCoefficients()
        ends = np.column_stack([result.wall_surface(surface).segment, np.zeros(2)])
        assert ends @ plane[:3] + plane[3] == pytest.approx([0, 0], abs=1e-3)
        before = graph.wall_surface(surface)
        assert before.normal @ result.wall_surface(surface).normal > 0.5
    assert (result.wall_surface(unseen).segment == graph.wall_surface(unseen).segment).all()


@pytest.mark.parametrize("by", [(300.0, -270.0, 0.0), (5e5, 5e6, 800.0)], ids=["a way", "UTM"])
def test_where_the_origin_lies_does_not_matter(by: tuple[float, float, float]) -> None:
    graph = with_walls(drive(3))
    here, there = optimize(graph), optimize(shifted(graph, np.array(by)))
    assert there.final_error == pytest.approx(here.final_error, rel=1e-6)
    back = shifted(there.graph, -np.array(by))
    assert back.keyframes.poses == pytest.approx(here.graph.keyframes.poses, abs=1e-5)
    assert back.wall_surfaces.segments == pytest.approx(here.graph.wall_surfaces.segments, abs=1e-5)
    for one, two in zip(back.concepts["wall"], here.graph.concepts["wall"], strict=True):
        assert one.shape.centre == pytest.approx(two.shape.centre, abs=1e-3)
    assert np.abs(there.graph.keyframes.poses[:, :3].mean(axis=0) - there.origin).max() < 100


def test_factors_may_refer_to_the_world_wherever_the_graph_is_solved(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A plugin that holds surfaces where the world's map has them finds them there."""
    by = np.array([5e5, 5e6, 0.0])
    graph = shifted(with_walls(drive(3)), by)
    seen: list[FloatArray] = []

    def told(context: FactorContext) -> None:
        seen.extend(segment + context.origin for segment in context.segments.values())

    monkeypatch.setattr(zone, "told", told)
    optimize(graph, {"wall": "zone:telling_factor"})
    assert seen
    assert np.abs(np.array(seen) - by[:2]).max() < 100


def test_a_map_whose_concepts_add_nothing_is_solved_once() -> None:
    graph = with_walls(drive(0))
    low = low_layers(graph)
    optimizer = gtsam.LevenbergMarquardtOptimizer(low.graph, low.values)
    values, plain = optimizer.optimize(), optimize(graph, {"room": "none", "wall": "none"})
    assert plain.values.equals(values, 1e-12)
    assert plain.iterations == optimizer.iterations()
    assert plain.factors == low.graph.size()
    assert plain.graph.concepts["wall"] != graph.concepts["wall"]  # their shapes are moved


def test_sides_that_are_no_wall_get_no_factors_and_do_not_bend_the_map() -> None:
    simulated = drive(1)
    graph = with_walls(simulated)
    right = optimize(graph)
    assert right.switched_off == []
    wrong = ConceptNode(
        99, (0, 2), shape=NodeShape(centre=(2.5, 2.0), thickness=WALL_M), confidence=0.9
    )  # the south and the north side of one room: 4 m apart, and facing each other
    graph.concepts["wall"] = [*simulated.walls, wrong]
    result = optimize(graph)
    assert ("wall", 99) not in concept_factors(right.graph, factor_types={"room": "none"}).of_node
    bent = np.abs(result.graph.keyframes.poses - right.graph.keyframes.poses).max()
    assert bent < 0.01


def test_a_side_seen_from_afar_stays_at_the_other_one_when_it_is_turned_parallel() -> None:
    """10 m away along the wall the direction was 3 degrees off; where it was seen it is right."""
    graph, tilt = SGraph(), np.radians(3.0)
    normal = np.array([np.sin(tilt), np.cos(tilt)])
    seen = np.array([10.0, 1.15])
    along = np.array([normal[1], -normal[0]])
    graph.add_keyframe(0, [10, 0, 0, 0, 0, 0, 1])
    graph.add_keyframe(1, [0, 3, 0, 0, 0, 0, 1])
    graph.add_odometry(0, 1, [-10, 3, 0, 0, 0, 0, 1], [1e-4] * 6)
    graph.add_wall_surface(0, [[11, 1], [9, 1]], [0, -1])
    graph.add_wall_surface(1, [seen - along, seen + along], normal)
    graph.observe(0, 0, [0, -1, 0, 1], [0.005, 0.01])
    graph.observe(1, 1, [*normal, 0, normal @ ([0, 3] - seen)], [0.06, 0.3])
    shape = NodeShape(centre=(10, 1.075), thickness=0.15)
    graph.concepts["wall"] = [ConceptNode(0, (0, 1), shape=shape)]
    side = optimize(graph).graph.wall_surface(1)
    assert side.normal == pytest.approx([0, 1], abs=0.02)
    assert side.segment[:, 1] == pytest.approx([1.15, 1.15], abs=0.1)


def test_the_shapes_of_nodes_follow_their_members() -> None:
    """The east wall of a room moves out by 0.4 m: so do its corners; its centre by half of it."""
    graph = SGraph()
    corners = [(0.0, 0.0), (4.0, 0.0), (4.0, 3.0), (0.0, 3.0)]
    ends = zip(corners, [*corners[1:], corners[0]], strict=True)
    for side, (normal, segment) in enumerate(
        zip([(0, 1), (-1, 0), (0, -1), (1, 0)], ends, strict=True)
    ):
        graph.add_wall_surface(side, segment, normal)
    graph.add_wall_surface(4, [[4.2, 0], [4.2, 3]], [1, 0])
    graph.add_keyframe(0, [2, 1.5, 0, 0, 0, 0, 1])
    graph.add_keyframe(1, [6, 1.5, 0, 0, 0, 0, 1])
    graph.add_odometry(0, 1, [4, 0, 0, 0, 0, 0, 1], [1e-3] * 6)
    for side, (normal, seen) in enumerate(
        zip([(0, 1), (-1, 0), (0, -1), (1, 0)], [1.5, 2.4, 1.5, 2.0], strict=True)
    ):
        graph.observe(side, 0, [*normal, 0, seen], [0.01, 0.01])
    graph.observe(4, 1, [1, 0, 0, 1.3], [0.01, 0.01])  # its back, at x = 4.7
    room = NodeShape(centre=(2.0, 1.5), polygon=tuple(corners))
    graph.concepts["room"] = [ConceptNode(0, (0, 1, 2, 3), shape=room)]
    wall = NodeShape(centre=(4.1, 1.5), thickness=0.2)
    graph.concepts["wall"] = [ConceptNode(0, (1, 4), shape=wall)]
    before = graph.concepts["room"][0].shape
    solved = optimize(graph, {"wall": "none", "room": "none"}).graph
    shape = solved.node("room", 0).shape
    assert shape.polygon is not None
    wanted = [(0, 0), (4.4, 0), (4.4, 3), (0, 3)]
    assert np.array(shape.polygon) == pytest.approx(np.array(wanted), abs=0.01)
    assert shape.centre == pytest.approx((2.2, 1.5), abs=0.01)
    assert solved.node("wall", 0).shape.thickness == pytest.approx(0.3, abs=0.01)
    assert solved.node("wall", 0).shape.centre == pytest.approx((4.55, 1.5), abs=0.01)
    assert graph.concepts["room"][0].shape == before


def test_factors_go_into_a_graph_of_ones_own() -> None:
    """One's own keys, ISAM2, and gtsam objects that outlive the call."""
    graph = with_walls(drive(2))
    own = Keys(
        keyframe=lambda i: 1000 + i,
        surface=lambda i: 5000 + i,
        node=lambda _c, i, v: 9000 + 10 * i + v,
    )
    low, concepts = low_layers(graph, own), concept_factors(graph, own)
    isam = gtsam.ISAM2()
    isam.update(low.graph, low.values)
    before = isam.calculateEstimate().atPose3(1005)
    isam.update(concepts.graph, concepts.values)
    isam.update()
    after = isam.calculateEstimate().atPose3(1005)
    assert 0 < before.range(after) < 1.0
    assert {key for key in concepts.values.keys() if key < 9000} == set()  # noqa: SIM118
    assert sum(map(len, concepts.of_node.values())) == concepts.graph.size()


def test_an_unobserved_side_leaves_its_wall_out() -> None:
    graph = facing_wall(0.2)
    graph.add_wall_surface(12, [[8, -1], [8, 1]], [-1, 0])
    graph.concepts["wall"] = [
        ConceptNode(0, (10, 11), shape=NodeShape(centre=(2.1, 0), thickness=0.2)),
        ConceptNode(1, (11, 12), shape=NodeShape(centre=(5, 0), thickness=0.2)),
    ]
    assert list(concept_factors(graph).of_node) == [("wall", 0)]


# -- gross outliers --------------------------------------------------------------------------------


def test_a_start_far_from_the_solution_is_left() -> None:
    """Motions that are believed to 1e-7 say that the second half of the drive is 100 m away."""
    drifted = drive(0).graph
    graph, table = SGraph("far"), drifted.odometry
    motions = table.poses.copy()
    motions[5, :2] = 100, 0
    graph.extend_keyframes(drifted.keyframes.ids, drifted.keyframes.poses, drifted.keyframes.stamps)
    graph.extend_odometry(table.from_ids, table.to_ids, motions, np.full_like(table.sigmas, 1e-7))
    surface = drifted.wall_surface(0)
    graph.add_wall_surface(0, surface.segment, surface.normal)
    first = drifted.observations.surface_ids.tolist().index(0)
    seen = drifted.observations
    graph.observe(0, int(seen.keyframe_ids[first]), seen.planes[first], seen.sigmas[first])
    solved = optimize(graph)
    assert solved.converged
    assert solved.final_error < 1e-3
    one, two = solved.graph.keyframes.poses[5:7, :2]
    assert np.linalg.norm(two - one) == pytest.approx(100, abs=1e-3)


def test_a_solution_that_does_not_converge_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    graph = with_walls(drive(0))
    assert optimize(graph).converged
    monkeypatch.setattr(robust, "MOST_ITERATIONS", 1)
    assert not optimize(graph).converged
