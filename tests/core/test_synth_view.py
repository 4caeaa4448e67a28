"""What a robot maps of synthetic buildings: occlusion from a trajectory, drift between visits."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from shapely import LineString, Polygon, box

from sgraph_concepts.types import FloatArray
from sgraph_core.synth import occlusion
from sgraph_core.synth.building import draw_building
from sgraph_core.synth.config import BuildingConfig, FittingConfig, PlanConfig, ViewConfig
from sgraph_core.synth.drift import Drift
from sgraph_core.synth.occlusion import seen_from
from sgraph_core.synth.pieces import Pieces
from sgraph_core.synth.plan import draw_plan
from sgraph_core.synth.polygons import all_edges
from sgraph_core.synth.surfaces import Floor, draw_surfaces
from sgraph_core.synth.trajectory import draw_poses

SMALL = PlanConfig(floor_area_m2=(150.0, 400.0))
ROUND = ViewConfig(visited_share=(0.3, 0.6))
"""A robot that enters about half of the rooms."""


def floor(seed: int, fittings: FittingConfig = FittingConfig()) -> Floor:  # noqa: B008
    rng = np.random.default_rng(seed)
    plan = draw_plan(rng, SMALL)
    assert plan is not None
    return draw_surfaces(plan, rng, fittings)


def sides(*rooms: Polygon) -> Pieces:
    segments, normals, owners = all_edges(list(rooms))
    return Pieces(segments, normals, owners, np.ones(len(owners), bool))


def is_seen(
    points: FloatArray, rows: NDArray[np.int64], pieces: Pieces, poses: FloatArray, range_m: float
) -> NDArray[np.bool_]:
    """Cast a ray from every pose in front of each point, which lies on a piece, to the point."""
    tree = shapely.STRtree(shapely.linestrings(pieces.segments))

    def sees(pose: FloatArray, point: FloatArray, row: int) -> bool:
        ray = LineString([pose, point + 1e-6 * (pose - point)])
        return set(tree.query(ray, predicate="intersects").tolist()) <= {row}

    seen = []
    for point, row in zip(points, rows.tolist(), strict=True):
        rays = poses - point
        fit = (rays @ pieces.normals[row] > 0.01) & (np.linalg.norm(rays, axis=1) <= range_m)
        seen.append(any(sees(pose, point, row) for pose in poses[fit]))
    return np.array(seen)


def points_on(pieces: Pieces, rows: NDArray[np.int64], rng: np.random.Generator) -> FloatArray:
    start, end = pieces.segments[rows, 0], pieces.segments[rows, 1]
    return np.asarray(start + rng.uniform(0.01, 0.99, (len(rows), 1)) * (end - start))


@pytest.mark.parametrize("seed", range(6))
def test_exactly_what_some_pose_sees_is_mapped(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(occlusion, "SHORTEST_PIECE_M", 0.0)
    built, rng = floor(seed), np.random.default_rng(seed)
    poses, pieces, range_m = draw_poses(built, rng, ROUND), built.pieces, 4.0 + seed
    mapped = seen_from(poses, pieces, range_m)
    rows = rng.integers(len(pieces), size=150)
    points = points_on(pieces, rows, rng)
    seen = is_seen(points, rows, pieces, poses, range_m)
    lines = shapely.linestrings(mapped.segments)
    for point, row, visible in zip(points, rows, seen, strict=True):
        same_way = mapped.normals @ pieces.normals[row] > 1 - 1e-9
        near = shapely.distance(lines[same_way], shapely.Point(point)) < 1e-7
        assert near.any() == visible
    assert 0 < seen.sum() < len(seen)


def test_from_the_middle_of_a_closed_room_its_sides_are_seen_and_no_more() -> None:
    pieces = sides(box(0, 0, 4, 3), box(4.2, 0, 8, 3))
    seen = seen_from(np.array([[1.0, 2.0]]), pieces, 20.0)
    assert seen.rooms.tolist() == [0, 0, 0, 0]
    assert np.linalg.norm(seen.segments[:, 1] - seen.segments[:, 0], axis=1).sum() == pytest.approx(
        14.0
    )


def test_a_sensor_sees_as_far_as_its_range() -> None:
    seen = seen_from(np.array([[5.0, 3.0]]), sides(box(0, 0, 10, 10)), 5.0)
    assert np.linalg.norm(seen.segments[:, 1] - seen.segments[:, 0], axis=1) == pytest.approx([8.0])
    assert len(seen_from(np.array([[5.0, 5.0]]), sides(box(0, 0, 10, 10)), 4.0)) == 0


def test_a_column_hides_what_is_behind_it() -> None:
    hall = box(0, 0, 10, 10).difference(box(4, 4, 6, 6))
    seen = seen_from(np.array([[5.0, 2.0]]), sides(hall), 20.0)
    far = np.sort(seen.segments[(seen.segments[..., 1] == 10).all(axis=1), :, 0], axis=None)
    assert far == pytest.approx([0.0, 1.0, 9.0, 10.0])
    assert len(seen) == 6  # the far side in two parts, three others, the column's near face


def test_behind_closed_doors_a_robot_maps_the_rooms_that_it_enters() -> None:
    closed = FittingConfig(
        door_share=(0.0,),
        window_share=(0.0,),
        curtain_share=(0.0,),
        facade_share=0.0,
        furnished_share=(0.0,),
    )
    plan = SMALL.model_copy(update={"open_plan_share": (0.0,)})
    for seed in range(8):
        rng = np.random.default_rng(seed)
        drawn = draw_plan(rng, plan)
        assert drawn is not None
        built = draw_surfaces(drawn, rng, closed)
        share = rng.uniform(0.2, 0.9)
        poses = draw_poses(built, rng, ViewConfig(visited_share=(share, share)))
        mapped = seen_from(poses, built.pieces, 50.0)
        entered = int(np.ceil(share * len(built.rooms)))
        assert len(set(mapped.rooms.tolist()) - {-1}) == entered


def test_poses_keep_their_distance_inside_and_around_the_building() -> None:
    for seed in range(8):
        built = floor(seed, FittingConfig(facade_share=1.0, furnished_share=(0.0,)))
        poses = draw_poses(built, np.random.default_rng(seed), ViewConfig())
        free = shapely.union_all(built.rooms)
        outside = ~shapely.contains_xy(free.buffer(0.5), poses)
        assert outside.any()
        away = shapely.distance(free, shapely.points(poses[outside]))
        assert away == pytest.approx(np.full(len(away), 3.0), abs=0.05)


def test_drift_moves_what_is_mapped_in_one_visit_as_a_whole() -> None:
    config = ViewConfig(drift_m=(0.05, 0.05), drift_deg=(0.5, 0.5), visit_rooms=(2, 4))
    for seed in range(6):
        built = floor(seed)
        drift = Drift.draw(built.rooms, np.random.default_rng(seed), config)
        before, after = built.pieces, drift.drifted(built.pieces, built.rooms)
        along = after.segments[:, 1] - after.segments[:, 0]
        assert (along * after.normals).sum(axis=1) == pytest.approx(np.zeros(len(after)), abs=1e-9)
        visit = np.where(before.rooms >= 0, drift.room_visits[before.rooms], -1)
        for one in np.unique(visit[visit >= 0]):
            points = [p.segments[visit == one].reshape(-1, 2) for p in (before, after)]
            spans = [np.linalg.norm(p[:, None] - p[None], axis=2) for p in points]
            assert spans[1] == pytest.approx(spans[0], abs=1e-9)
        first = np.isin(visit, [0])
        assert after.segments[first] == pytest.approx(before.segments[first])
        assert np.abs(after.segments - before.segments).max() < 1.5


def test_outlines_drift_with_their_rooms() -> None:
    config = ViewConfig(drift_m=(0.5, 0.5), drift_deg=(1.0, 1.0), visit_rooms=(1, 1))
    rooms = [box(0, 0, 4, 3), box(4.2, 0, 8, 3), box(8.2, 0, 12, 3)]
    drift = Drift.draw(rooms, np.random.default_rng(0), config)
    drifted = drift.drifted(sides(*rooms), rooms)
    moved = 0
    for number, room in enumerate(rooms):
        corners = shapely.get_coordinates(room.exterior)[:-1]
        outline = Polygon(drift.drifted_outline(corners, number))
        own = shapely.linestrings(drifted.segments[drifted.rooms == number])
        assert shapely.union_all(own).hausdorff_distance(outline.exterior) < 1e-9
        moved += not outline.equals_exact(room, 0.01)
    assert moved == 2


def test_walls_are_true_however_far_their_sides_have_drifted() -> None:
    view = ViewConfig(
        occluded_share=0.0,
        drifted_share=1.0,
        drift_m=(2.0, 2.0),
        visit_rooms=(1, 1),
        through_share=(0.0,),
        missing_share=(0.0,),
        noise_m=(0.0,),
    )
    far_apart = 0
    for seed in range(6):
        drawn = draw_building(np.random.default_rng(seed), BuildingConfig(plan=SMALL, view=view))
        one, two = (shapely.linestrings(drawn.segments[rows]) for rows in drawn.walls.T)
        far_apart += int((shapely.distance(one, two) > 0.7).sum())
        assert set(drawn.pieces.rooms.tolist()) <= set(range(-1, len(drawn.polygons)))
    assert far_apart > 0


def test_no_pose_lies_in_furniture() -> None:
    crowded = FittingConfig(furnished_share=(1.0,), furniture_size_m=(0.8, 1.2))
    standing = 0
    for seed in range(8):
        built = floor(seed, crowded)
        poses = draw_poses(built, np.random.default_rng(seed), ViewConfig(pose_spacing_m=(0.5, 1)))
        standing += len(built.furniture)
        assert not shapely.contains_xy(shapely.union_all(built.furniture), poses).any()
    assert standing > 30
