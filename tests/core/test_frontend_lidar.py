"""The simulated lidar against closed forms, and the surfaces that are extracted from it."""

from __future__ import annotations

import numpy as np
import pytest

from sgraph_core.frontend.building import Door, Floor
from sgraph_core.frontend.lidar import VLP16, Cloud, cast
from sgraph_core.frontend.surfaces import (
    Extraction,
    Scan,
    extract_surfaces,
    horizontal_scan,
    uneven,
    upright_scan,
)

SQUARE = Floor("square", {"room": ((-4, -3), (4, -3), (4, 3), (-4, 3))}, (), ("room",))
TWO = Floor(
    "two",
    {"west": ((0, 0), (12, 0), (12, 4), (0, 4)), "east": ((12.2, 0), (20, 0), (20, 4), (12.2, 4))},
    (Door("west", "east", (12.1, 2)),),
    ("west", "east"),
)


def to_box(x: float, y: float, angles: np.ndarray) -> np.ndarray:
    """Return the distances from (x, y) to the walls of the square room."""
    cosine, sine = np.cos(angles), np.sin(angles)
    with np.errstate(divide="ignore"):
        across = np.where(cosine > 0, 4 - x, -4 - x) / cosine
        along = np.where(sine > 0, 3 - y, -3 - y) / sine
    return np.minimum(np.abs(across), np.abs(along))


def test_rays_end_where_walls_floor_and_ceiling_are() -> None:
    x, y, yaw = 1.3, -0.4, 0.7
    cloud = cast(VLP16, SQUARE.panels(), np.array([x, y, yaw]))
    walls = to_box(x, y, cloud.azimuths + yaw)
    for ring, elevation in enumerate(cloud.elevations):
        level = 2.6 - 0.6 if elevation > 0 else -0.6
        expected = np.minimum(walls, level / np.tan(elevation))
        assert cloud.horizontal()[:, ring] == pytest.approx(expected, abs=1e-9)


def test_what_is_out_of_range_gives_no_return() -> None:
    lidar = type(VLP16)(range_m=3.5)
    cloud = cast(lidar, SQUARE.panels(), np.zeros(3))
    far = to_box(0, 0, cloud.azimuths) / np.cos(cloud.elevations[8]) > 3.5
    assert (np.isnan(cloud.ranges[:, 8]) == far).all()
    assert far.any()
    assert not far.all()


def test_a_door_lets_rays_through_below_its_lintel_only() -> None:
    cloud = cast(VLP16, TWO.panels(), np.array([2.0, 2.0, 0.0]))
    ahead = np.argmin(np.abs(cloud.azimuths))
    assert cloud.horizontal()[ahead, 8] == pytest.approx(18.0)  # one degree up: the far wall
    assert cloud.horizontal()[ahead, 12] == pytest.approx(10.0)  # nine degrees up: the lintel


def test_horizontal_scans_see_walls_only() -> None:
    points = horizontal_scan(cast(VLP16, SQUARE.panels(), np.zeros(3)))
    assert np.max(np.abs(points) / [4, 3], axis=1) == pytest.approx(1.0)


def test_a_room_shows_its_four_walls() -> None:
    pose = np.array([1.0, 0.5, 0.0])
    cloud = cast(VLP16, SQUARE.panels(), pose)
    found = extract_surfaces(upright_scan(cloud, Extraction()), Extraction())
    order = np.lexsort((found.planes[:, 1].round(6), found.planes[:, 0].round(6)))
    expected = [[-1, 0, 0, 3], [0, -1, 0, 2.5], [0, 1, 0, 3.5], [1, 0, 0, 5]]
    # rings that meet the floor just before a wall are averaged with it
    assert found.planes[order] == pytest.approx(np.array(expected, float), abs=5e-3)
    assert np.linalg.norm(np.diff(found.segments, axis=1), axis=2)[order].ravel() == pytest.approx(
        [6, 8, 8, 6], abs=0.1
    )
    assert (found.heights[:, 0] < 0.2).all()
    assert (found.heights[:, 1] > 1.0).all()


def test_noise_of_ranges_stays_within_the_sigmas_of_the_fit() -> None:
    """Without allowance for uneven walls, errors over sigmas have a variance of about 1."""
    config = Extraction(uneven_m=0.0, least_angle=0.0, noise_m=1e-4)
    errors = []
    for seed in range(40):
        points = np.column_stack([np.linspace(-2, 2.5, 200), np.full(200, 3.0)])
        points[:, 1] += np.random.default_rng(seed).normal(0, 0.02, 200)
        found = extract_surfaces(Scan.flat(points), config)
        (plane,), (sigmas,), (at,) = found.planes, found.sigmas, found.at
        errors.append([np.arctan2(plane[0], -plane[1]), at[1] - 3.0] / sigmas)
    assert np.var(errors, axis=0) == pytest.approx([1.0, 1.0], abs=0.6)


def test_uneven_walls_err_as_their_sigmas_say() -> None:
    config = Extraction()
    cloud = cast(VLP16, SQUARE.panels(), np.array([1.0, 0.5, 0.3]))
    exact = extract_surfaces(upright_scan(cloud, config), config)
    rng = np.random.default_rng(0)
    errors = []
    for _ in range(400):
        drawn = uneven(exact, config, rng)
        cross = exact.planes[:, 0] * drawn.planes[:, 1] - exact.planes[:, 1] * drawn.planes[:, 0]
        distances = (exact.at * drawn.planes[:, :2]).sum(axis=1) + drawn.planes[:, 3]
        errors.append(np.column_stack([cross, distances]) / exact.sigmas)
        normals, offsets = drawn.planes[:, None, :2], drawn.planes[:, 3:]
        points = np.concatenate([drawn.segments, drawn.at[:, None]], axis=1)
        on_plane = (points * normals).sum(axis=2) + offsets
        assert on_plane == pytest.approx(0, abs=1e-9)
    angles, distances = np.array(errors).reshape(-1, 2).T
    assert [np.var(angles), np.var(distances)] == pytest.approx([1.0, 1.0], abs=0.1)
    assert np.corrcoef(angles, distances)[0, 1] == pytest.approx(0.0, abs=0.05)


def test_where_distance_and_angle_err_apart_when_points_are_denser_on_one_side() -> None:
    config, errors = Extraction(), []
    rng = np.random.default_rng(0)
    reach = np.concatenate([np.linspace(-2, 0, 400), np.linspace(0.1, 4, 40)])
    for _ in range(400):
        points = np.column_stack([reach, 3.0 + rng.normal(0, 0.02, len(reach))])
        found = uneven(extract_surfaces(Scan.flat(points), config), config, rng)
        (plane,), (sigmas,), (at,) = found.planes, found.sigmas, found.at
        assert plane[:2] @ at + plane[3] == pytest.approx(0, abs=1e-9)
        errors.append([np.arctan2(plane[0], -plane[1]), at[1] - 3.0] / sigmas)
    angles, distances = np.array(errors).T
    assert [np.var(angles), np.var(distances)] == pytest.approx([1.0, 1.0], abs=0.2)
    assert np.corrcoef(angles, distances)[0, 1] == pytest.approx(0.0, abs=0.12)


def test_a_scan_without_walls_shows_no_surfaces() -> None:
    nothing = Cloud(np.linspace(-np.pi, np.pi, 8), np.array([0.0]), np.full((8, 1), np.nan), 0.6)
    assert len(extract_surfaces(upright_scan(nothing, Extraction()), Extraction())) == 0
    assert horizontal_scan(Cloud(nothing.azimuths, np.array([0.1]), nothing.ranges, 0.6)).size == 0


def test_corners_split_and_gaps_separate_surfaces() -> None:
    """An L of two walls, one of which has an opening."""
    first = np.column_stack([np.linspace(4, 2.05, 60), np.full(60, 2.0)])
    second = np.column_stack([np.full(120, 2.0), np.linspace(2.0, -4.0, 120)])
    second = second[(second[:, 1] > -0.5) | (second[:, 1] < -1.5)]
    found = extract_surfaces(Scan.flat(np.concatenate([first, second])), Extraction())
    lengths = np.linalg.norm(found.segments[:, 1] - found.segments[:, 0], axis=1)
    assert sorted(lengths) == pytest.approx([1.95, 2.5, 2.5], abs=0.1)
    assert np.isnan(found.heights).all()
