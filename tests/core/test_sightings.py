"""Observed planes as factors: what errs independently, and an optimum solved by hand."""

from __future__ import annotations

from collections.abc import Callable

import gtsam
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from plans import rectangle
from tracked import keyframes_of
from visits import visit_rooms

from sgraph_concepts.types import FloatArray
from sgraph_core.backend import optimize
from sgraph_core.backend.sightings import CLEAR, plane_noise
from sgraph_core.graph import SGraph
from sgraph_core.slam import ConceptTracker

SIGMAS = np.array([0.01, 0.02])
ANGLES = st.floats(-np.pi, np.pi)
METRES = st.floats(-10, 10)
AXES = [0.0, np.pi / 2, np.pi, -np.pi / 2]


def squared_error(
    body: gtsam.Rot3, normal: FloatArray, at: FloatArray, error: tuple[float, float], planar: bool
) -> float:
    """Return the squared whitened error of a plane that was seen turned and shifted about a point.

    Args:
        body: world_R_body.
        normal: of the true plane in the world; it passes the point.
        at: the point, in the body frame.
        error: angle by which the plane is seen turned about the vertical, and distance.
        planar: as for :func:`plane_noise`.
    """
    pose = gtsam.Pose3(body, np.array([3.0, -2.0, 0.5]))
    point, (angle, shift) = pose.transformFrom(at), error
    seen = body.unrotate(gtsam.Rot3.Rz(angle).rotate(normal))
    measured = np.array([*seen, shift - seen @ at])
    values = gtsam.Values()
    values.insert(0, pose)
    values.insert(1, gtsam.OrientedPlane3(*normal, -normal @ point))
    noise = plane_noise(measured, SIGMAS, at, planar)
    return 2 * gtsam.OrientedPlane3Factor(measured, noise, 0, 1).error(values)


@given(ANGLES, st.one_of(ANGLES, st.sampled_from(AXES)), METRES, METRES, METRES)
def test_angle_and_distance_from_the_point_err_independently(
    yaw: float, heading: float, x: float, y: float, z: float
) -> None:
    normal, at = np.array([np.cos(heading), np.sin(heading), 0.0]), np.array([x, y, z])
    body, (angle, shift) = gtsam.Rot3.Yaw(yaw), (1e-4, 3e-4)
    assume((np.abs(body.unrotate(normal)[:2]) > 1e-9).all())  # what is predicted is on no jump
    error = squared_error(body, normal, at, (angle, shift), True)
    assert error == pytest.approx((angle / 0.01) ** 2 + (shift / 0.02) ** 2, rel=0.02)


@given(ANGLES, st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), METRES, METRES, METRES)
def test_the_body_may_be_tilted(
    yaw: float, pitch: float, roll: float, x: float, y: float, z: float
) -> None:
    body, normal = gtsam.Rot3.Ypr(yaw, pitch, roll), np.array([0.6, -0.8, 0.0])
    least, next_to, _ = np.sort(np.abs(body.unrotate(normal)))
    assume(next_to - least > CLEAR + 1e-3)
    error = squared_error(body, normal, np.array([x, y, z]), (1e-4, 3e-4), False)
    assert error == pytest.approx(1e-4 + 2.25e-4, rel=0.02)


@pytest.mark.parametrize("axis", AXES)
def test_a_level_body_that_looks_along_an_axis_is_no_special_case(axis: float) -> None:
    """gtsam's basis jumps there; what was measured is exactly on it, what is predicted is not."""
    normal, at = np.array([np.cos(axis), np.sin(axis), 0.0]), np.array([4.0, 7.0, 0.0])
    for turned in (1e-4, -1e-4):
        error = squared_error(gtsam.Rot3.Yaw(turned), normal, at, (turned, 0.0), True)
        assert error == pytest.approx((1e-4 / 0.01) ** 2, rel=0.02)


def test_near_a_jump_a_tilted_body_loses_the_correlation_only() -> None:
    """Its d errs as before by 2 cm and, 5 m away along the plane, by 5 m times the angle."""
    noise = plane_noise(np.array([1.0, 0.0, 0.0, 2.0]), SIGMAS, np.array([-2.0, 3.0, 4.0]), False)
    assert noise.sigmas() == pytest.approx([0.01, 0.01, np.hypot(0.02, 5 * 0.01)])
    whitened = gtsam.noiseModel.Gaussian.R(noise)
    assert whitened == pytest.approx(np.diag(np.diag(whitened)))


def test_at_the_origin_the_distance_is_d() -> None:
    noise = plane_noise(np.array([0.6, 0.8, 0.0, 2.0]), SIGMAS, np.zeros(3), True)
    assert noise.sigmas() == pytest.approx([0.01, 0.01, 0.02])


def test_the_noise_is_exact_where_an_angle_is_unknown() -> None:
    """One standard deviation of each component is a squared error of 3, however far the point."""
    sigmas, at = np.array([1e5, 0.01]), np.array([60.0, 80.0, 0.0])
    noise = plane_noise(np.array([0.6, -0.8, 0.0, 2.0]), sigmas, at, True)
    along = at @ [-0.8, -0.6, 0.0]
    assert noise.squaredMahalanobisDistance(
        np.array([1e5, 1e5, 0.01 + 1e5 * along])
    ) == pytest.approx(3)


def corridor(tilt: float) -> SGraph:
    """A drive between two walls along x, seen 10 m ahead: poses, angles and tilts err."""
    rng, graph = np.random.default_rng(3), SGraph("corridor")
    for number in range(6):
        graph.add_keyframe(number, [number + rng.normal(0, 0.1), 0, 0, 0, 0, 0, 1])
        if number:
            graph.add_odometry(number - 1, number, [1, 0, 0, 0, 0, 0, 1], [0.05] * 6)
    for side in (-1.0, 1.0):
        graph.add_wall_surface(len(graph.wall_surfaces.ids), [[0, side], [20, side]], [0, -side])
    for number in range(6):
        for surface, side in enumerate((-1.0, 1.0)):
            normal = np.array([rng.normal(0, 0.01), -side, rng.normal(0, tilt) if tilt else 0.0])
            normal /= np.linalg.norm(normal)
            at = np.array([10.0, side + rng.normal(0, 0.01), 0.0])
            graph.observe(surface, number, [*normal, -normal @ at], [0.01, 0.01], at)
    return graph


@pytest.mark.parametrize("tilt", [0.0, 1e-4, 3e-3, 2e-2])
def test_walls_along_the_axes_are_solved_tilted_or_not(tilt: float) -> None:
    result = optimize(corridor(tilt))
    assert result.final_error < 0.9 * result.initial_error
    (one, two) = (result.graph.wall_surface(i) for i in (0, 1))
    assert [one.normal[0], two.normal[0]] == pytest.approx([0, 0], abs=0.04 if tilt else 0.01)


def test_a_consistent_map_takes_no_iterations_for_nothing() -> None:
    """First guesses are turned off the axes, an error that no iteration need remove."""
    graph = visit_rooms([(rectangle(0, 0, 5, 4), (0, 0, 0))] * 4, at_aside=True)
    assert optimize(graph).iterations <= 10


def in_batch(graph: SGraph) -> SGraph:
    return optimize(graph).graph


def keyframe_by_keyframe(graph: SGraph) -> SGraph:
    tracker = ConceptTracker()
    for enter in keyframes_of(graph):
        enter(tracker)
        tracker.optimize()
    return tracker.snapshot()


@pytest.mark.parametrize("solve", [in_batch, keyframe_by_keyframe])
def test_a_wall_seen_from_afar_turns_about_where_it_was_seen(
    solve: Callable[[SGraph], SGraph],
) -> None:
    """Solved by hand.

    One keyframe saw a wall along y = 3 in two places: at x = 10 turned by 0.002 rad about the point
    (10, 3), and at x = 0 exactly. Angle t and height h of the wall at x = 10 minimise

        (t - 0.002)^2 / 0.01^2 + t^2 / 0.01^2 + (h / 0.01)^2 + ((h - 10 t) / 0.01)^2,

    with the gradients 2 t - 0.002 - 10 (h - 10 t) = 0 and h + (h - 10 t) = 0: h = 5 t and
    t = 0.002 / 52.
    """
    graph = SGraph()
    graph.add_keyframe(0, [0, 0, 0, 0, 0, 0, 1])
    graph.add_wall_surface(0, [[-1, 3], [11, 3]], [0, -1])
    seen = np.array([np.sin(0.002), -np.cos(0.002), 0.0])
    graph.observe(0, 0, [*seen, -seen @ [10, 3, 0]], [0.01, 0.01], [10, 3, 0])
    graph.observe(0, 0, [0, -1, 0, 3], [0.01, 0.01], [0, 3, 0])
    (_, left), (_, right) = solve(graph).wall_surface(0).segment
    turn = 0.002 / 52
    assert [left - 3, right - 3] == pytest.approx([-6 * turn, 6 * turn], rel=0.05)
