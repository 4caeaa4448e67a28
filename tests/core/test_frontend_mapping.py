"""The planes-only front end: maps of simulated drives and of real logs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

from sgraph_concepts.errors import InputError
from sgraph_core.backend import optimize
from sgraph_core.evaluation.trajectory import ate_rmse
from sgraph_core.frontend.association import NONE, Gate, Lines, aligned, matches
from sgraph_core.frontend.carmen import read_carmen, record
from sgraph_core.frontend.lidar import Lidar
from sgraph_core.frontend.mapping import MappedDrive, build_map
from sgraph_core.frontend.odometry import DRIFT, Drift, drifting_odometry
from sgraph_core.frontend.planar import as_rows, between, chained, composed, from_rows
from sgraph_core.frontend.recording import ObservedSurfaces, Recording
from sgraph_core.frontend.scenes import scene
from sgraph_core.frontend.simulation import simulate
from sgraph_core.frontend.surfaces import Extraction


@pytest.fixture(scope="module")
def recording() -> Recording:
    return simulate(scene("C1F1s"), 0)


@pytest.fixture(scope="module")
def mapped(recording: Recording) -> MappedDrive:
    return build_map(recording)


def test_a_seed_gives_one_recording_and_one_map(recording: Recording, mapped: MappedDrive) -> None:
    again = simulate(scene("C1F1s"), 0)
    assert np.array_equal(again.odometry, recording.odometry)
    for first, second in zip(again.observations, recording.observations, strict=True):
        assert np.array_equal(first.planes, second.planes)
    segments = build_map(again).graph.wall_surfaces.segments
    assert np.array_equal(segments, mapped.graph.wall_surfaces.segments)
    assert not np.array_equal(simulate(scene("C1F1s"), 1).odometry, recording.odometry)


def test_the_map_corrects_drift(recording: Recording, mapped: MappedDrive) -> None:
    drifted = ate_rmse(recording.dead_reckoned()[:, :3], recording.positions())
    corrected = ate_rmse(mapped.graph.keyframes.poses[:, :3], recording.positions())
    assert corrected < 0.2 * drifted


BESIDE_A_WIDE_DOOR = 4
"""The south side of corridor 2, of which its door leaves 0.3 m on the left and right."""


def test_an_exact_drive_maps_the_true_surfaces() -> None:
    exact = simulate(
        scene("C1F1s"),
        0,
        lidar=Lidar(sigma_m=0.0),
        drift=Drift(0.0, 0.0, 1e-5, 1e-4),
        extraction=Extraction(uneven_m=1e-4, least_angle=1e-4),
    )
    drive = build_map(exact)
    assert exact.building is not None
    true, found = exact.building.surfaces, drive.graph.wall_surfaces
    assert (drive.sources != NONE).all()
    assert set(drive.sources) == set(range(len(true))) - {BESIDE_A_WIDE_DOOR}
    normals = true.normals[drive.sources]
    assert (found.normals * normals).sum(axis=1) == pytest.approx(1.0, abs=1e-3)
    away = (found.segments - true.midpoints[drive.sources][:, None]) * normals[:, None]
    assert np.abs(away.sum(axis=2)).max() < 0.03
    assert np.median(np.abs(away.sum(axis=2))) < 0.003
    for row in set(drive.sources):
        ends = found.segments[drive.sources == row] @ true.tangents[row]
        true_ends = true.segments[row] @ true.tangents[row]
        assert ends.min() > true_ends.min() - 0.1
        assert ends.max() < true_ends.max() + 0.1
        assert np.ptp(ends) > true.lengths[row] - 1.85  # a wide door and what is left beside it


def test_the_truth_of_a_map_names_rooms_and_walls(
    recording: Recording, mapped: MappedDrive
) -> None:
    truth, building = mapped.graph.truth, recording.building
    assert truth is not None
    assert building is not None
    assert len(truth.rooms) == 4
    for room in truth.rooms:
        own = np.flatnonzero(building.rooms[mapped.sources] == room.id)
        assert set(own) <= set(room.members)
        sides = np.flatnonzero(building.rooms == room.id)
        normals, middles = building.surfaces.normals[sides], building.surfaces.midpoints[sides]
        for member in room.members:  # of which some may run on into the next room
            surface = mapped.graph.wall_surface(member)
            away = ((surface.segment.mean(axis=0) - middles) * normals).sum(axis=1)
            along = (surface.normal * normals).sum(axis=1)
            assert ((np.abs(away) < 0.1) & (along > 0.99)).any()
    walls = building.walls.tolist()
    true = {frozenset(pair) for pair in walls if BESIDE_A_WIDE_DOOR not in pair}
    assert {frozenset(mapped.sources[list(pair)].tolist()) for pair in truth.walls} == true


def test_surfaces_that_one_keyframe_saw_are_left_out(mapped: MappedDrive) -> None:
    seen = mapped.graph.observations
    for surface in mapped.graph.wall_surfaces.ids:
        assert len(set(seen.keyframe_ids[seen.surface_ids == surface])) >= 2


def test_drift_is_what_its_sigmas_say() -> None:
    poses = np.column_stack([np.arange(2000.0), np.zeros(2000), np.zeros(2000)])
    odometry, sigmas = drifting_odometry(poses, DRIFT, np.random.default_rng(0))
    errors = between(between(poses[:-1], poses[1:]), from_rows(odometry))
    squares = ((errors / sigmas[:, [3, 4, 2]]) ** 2).sum()
    assert chi2(errors.size).cdf(squares) == pytest.approx(0.5, abs=0.49)
    assert sigmas[0] == pytest.approx([1e-3, 1e-3, np.radians(1.0), 0.02, 0.02, 1e-3])


def test_motions_lead_from_pose_to_pose() -> None:
    rng = np.random.default_rng(1)
    poses = rng.uniform(-3, 3, (20, 3))
    motions = between(poses[:-1], poses[1:])
    assert composed(poses[:-1], motions) == pytest.approx(poses[1:])
    assert chained(poses[0], motions) == pytest.approx(poses)
    assert from_rows(as_rows(poses)) == pytest.approx(poses)


LOOSE = Gate(angle_deg=10.0, offset_m=0.15, gap_m=0.1)
WALLS = Lines(
    np.array([[[0, 0], [4, 0]], [[0, 0.12], [4, 0.12]], [[4.4, 0], [8, 0]]], float),
    np.array([[0, -1], [0, 1], [0, -1]], float),
)


@pytest.mark.parametrize(
    ("segment", "normal", "match"),
    [
        ([[1, 0.1], [2, 0.1]], [0, -1], 0),  # nearer to the other side, but it faces away
        ([[1, 0.1], [2, 0.1]], [0, 1], 1),
        ([[1, 0.3], [2, 0.3]], [0, -1], NONE),  # too far
        ([[4.05, 0], [4.2, 0]], [0, -1], 0),  # a gap of 5 cm
        ([[4.15, 0], [4.25, 0]], [0, -1], NONE),  # gaps of 15 cm on both sides
        ([[3, 0], [4, 0.25]], [0.2425, -0.9701], NONE),  # turned by 14 degrees
    ],
)
def test_the_gate_tells_surfaces_apart(
    segment: list[list[float]], normal: list[float], match: int
) -> None:
    seen = Lines(np.array([segment], float), np.array([normal], float))
    assert matches(seen, WALLS, LOOSE).tolist() == [match]
    backwards = Lines(seen.segments[:, ::-1], seen.normals)
    assert matches(backwards, WALLS, LOOSE).tolist() == [match]


def test_of_two_within_the_gate_the_nearest_is_taken() -> None:
    known = Lines(WALLS.segments[[0, 0]] + [[[0, 0]], [[0, 0.1]]], WALLS.normals[[0, 0]])
    seen = Lines(np.array([[[1, 0.08], [2, 0.08]]]), np.array([[0.0, -1.0]]))
    assert matches(seen, known, LOOSE).tolist() == [1]


@pytest.mark.parametrize(("aside", "tolerance"), [(0.0, 1e-6), (1.0, 1e-5)])
def test_alignment_finds_the_pose_that_surfaces_show(aside: float, tolerance: float) -> None:
    """Two steps go almost all the way, where distances are known metres aside of the robot."""
    true = np.array([1.0, -2.0, 0.1])
    known = Lines(
        np.array([[[0, 0], [4, 0]], [[4, 0], [4, -4]]], float), np.array([[0, -1], [-1, 0]], float)
    )
    normals = known.normals @ np.array([[np.cos(0.1), -np.sin(0.1)], [np.sin(0.1), np.cos(0.1)]])
    planes = np.column_stack([normals, np.zeros(2), [2.0, 3.0]])
    along = np.column_stack([-normals[:, 1], normals[:, 0]])
    at = -normals * planes[:, 3:] + aside * along * [[-4.0], [2.5]]
    observed = ObservedSurfaces(
        np.zeros((2, 2, 2)), planes, np.full((2, 2), 1e-4), at, np.full((2, 2), np.nan)
    )
    predicted = true + np.array([0.1, -0.05, 0.02])
    found = aligned(predicted, np.ones(3), observed, known, np.array([0, 1]))
    assert found == pytest.approx(true, abs=tolerance)
    unmatched = aligned(predicted, np.ones(3), observed, known, np.array([NONE, NONE]))
    assert unmatched == pytest.approx(predicted)


def test_alignment_weighs_the_prediction_and_what_is_seen() -> None:
    """A wall that is as uncertain as the prediction moves the pose half of the way to it."""
    known = Lines(np.array([[[4, -1], [4, 1]]], float), np.array([[-1, 0]], float))
    observed = ObservedSurfaces(
        np.zeros((1, 2, 2)),
        np.array([[-1.0, 0.0, 0.0, 3.9]]),
        np.array([[0.1, 0.05]]),
        np.array([[3.9, 2.0]]),
        np.full((1, 2), np.nan),
    )
    found = aligned(np.zeros(3), np.array([0.05, 0.05, 1e-6]), observed, known, np.array([0]))
    assert found == pytest.approx([0.05, 0, 0], abs=1e-6)


def test_observations_hold_at_points_of_their_planes(recording: Recording) -> None:
    seen = build_map(recording).graph.observations
    assert (seen.at * seen.planes[:, :3]).sum(axis=1) + seen.planes[:, 3] == pytest.approx(0)
    assert len(seen.at) == len(seen.planes) > 100


def test_a_drive_that_saw_nothing_gives_a_map_without_surfaces(recording: Recording) -> None:
    nothing = ObservedSurfaces(
        *(np.empty((0, *shape)) for shape in ((2, 2), (4,), (2,), (2,), (2,)))
    )
    drive = build_map(replace(recording, observations=(nothing,) * len(recording)))
    assert len(drive.sources) == len(drive.graph.wall_surfaces.ids) == 0
    reckoned = recording.dead_reckoned()
    assert drive.graph.keyframes.poses[:, :3] == pytest.approx(reckoned[:, :3], abs=1e-6)


def test_recordings_are_of_one_length(recording: Recording) -> None:
    with pytest.raises(InputError, match="C1F1s: scans is for 90 keyframes, stamps for 91"):
        replace(recording, scans=recording.scans[:-1])


@pytest.mark.parametrize("name", ["belgioioso", "acapulco"])
def test_maps_of_real_logs_beat_their_odometry(name: str, real_buildings: Path) -> None:
    path = real_buildings / "lidar" / f"{name}.log.gz"
    if not path.exists():
        pytest.skip("SGRAPH_DATA holds no logs")
    recording = record(read_carmen(path), 0)
    drive = build_map(recording)
    solved = optimize(drive.graph, {}).graph.keyframes.poses[:, :3]
    drifted = ate_rmse(recording.dead_reckoned()[:, :3], recording.positions())
    assert ate_rmse(solved, recording.positions()) < 0.7 * drifted
    assert len(drive.sources) == len(drive.graph.wall_surfaces.ids)
    assert drive.graph.truth is None
