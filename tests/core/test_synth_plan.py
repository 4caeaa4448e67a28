"""What stands in the rooms of synthetic buildings, and where their walls are interrupted."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
import shapely
from shapely import LineString, Point, Polygon

from sgraph_core.synth.building import draw_building
from sgraph_core.synth.config import BuildingConfig, FittingConfig, PlanConfig, ViewConfig
from sgraph_core.synth.interior import AISLE_M, LARGE_ROOM_M2
from sgraph_core.synth.pieces import Pieces
from sgraph_core.synth.plan import Plan, draw_plan
from sgraph_core.synth.surfaces import draw_surfaces
from sgraph_core.synth.walls import wall_gaps

BARE = PlanConfig(
    crooked_m=(0.0,),
    ring_corridor_share=0.0,
    column_share=(0.0,),
    partition_share=(0.0,),
    double_wall_share=(0.0,),
    cubicle_share=(0.0,),
    open_plan_share=(0.0,),
)
"""Rooms without holes that do not meet."""
CLOSED = FittingConfig(
    door_share=(0.0,),
    broken_behind_share=(0.0,),
    facade_share=0.0,
    furnished_share=(0.0,),
    window_share=(0.0,),
    curtain_share=(0.0,),
)


def plans(count: int, **changes: object) -> Iterator[tuple[Plan, Pieces]]:
    config = BARE.model_copy(update=changes)
    for seed in range(count):
        rng = np.random.default_rng(seed)
        plan = draw_plan(rng, config)
        assert plan is not None
        yield plan, draw_surfaces(plan, rng, CLOSED).pieces


def test_bare_rooms_have_no_holes_and_keep_apart() -> None:
    for plan, pieces in plans(10):
        assert all(not room.interiors for room in plan.rooms)
        assert len(plan.open_borders) == 0
        assert pieces.structural.all()
        assert (pieces.rooms >= 0).all()


@pytest.mark.parametrize("share", ["column_share", "partition_share"])
def test_what_stands_in_a_room_belongs_to_it_and_faces_it(share: str) -> None:
    bodies = 0
    for plan, pieces in plans(12, **{share: (1.0,)}):
        ends = shapely.points(pieces.segments)
        for number, room in enumerate(plan.rooms):
            for hole in room.interiors:
                bodies += 1
                own = (shapely.distance(hole, ends) < 1e-9).all(axis=1)
                assert own.sum() == 4
                assert (pieces.rooms[own] == number).all()
                in_front = pieces.segments[own].mean(axis=1) + 0.01 * pieces.normals[own]
                assert not shapely.contains_xy(Polygon(hole), in_front).any()
                assert Polygon(room.exterior).area >= LARGE_ROOM_M2
                assert hole.distance(room.exterior) >= AISLE_M - 1e-6
    assert bodies > 30


def test_both_faces_of_a_partition_are_a_wall_in_one_room() -> None:
    for plan, pieces in plans(12, partition_share=(1.0,)):
        gaps = wall_gaps(pieces.segments, pieces.normals)
        inside = pieces.rooms[gaps.one] == pieces.rooms[gaps.two]
        middles = (gaps.starts + gaps.ends) / 2 + (gaps.thicknesses / 2)[:, None] * gaps.inwards
        for hole in (Polygon(hole) for room in plan.rooms for hole in room.interiors):
            assert shapely.contains_xy(hole, middles[inside]).sum() == 1


def test_open_plan_neighbours_meet_without_a_wall_and_stay_different_rooms() -> None:
    borders = 0
    for plan, pieces in plans(12, open_plan_share=(0.5,)):
        shell = shapely.union_all(shapely.linestrings(pieces.segments))
        for border in plan.open_borders:
            borders += 1
            middle = Point(border.mean(axis=0))
            meeting = np.flatnonzero(shapely.distance(middle, plan.rooms) < 2e-4)
            assert len(meeting) == 2
            assert np.isin(meeting, pieces.rooms).all()
            ends = border[0] + np.array([[0.02], [0.98]]) * (border[1] - border[0])
            assert LineString(ends).distance(shell) > 1e-3
    assert borders > 30


def test_rooms_never_overlap() -> None:
    for plan, _ in plans(20, chamfered_share=(0.5,), open_plan_share=(0.5,)):
        for one, two in zip(*shapely.STRtree(plan.rooms).query(plan.rooms), strict=True):
            assert one == two or plan.rooms[one].intersection(plan.rooms[two]).area < 1e-6


def test_an_open_plan_floor_is_as_well_labelled_as_any() -> None:
    config = BuildingConfig(
        plan=PlanConfig(open_plan_share=(1.0,), column_share=(1.0,), partition_share=(1.0,)),
        view=ViewConfig(missing_share=(0.0,), occluded_share=0.0),
    )
    for seed in range(8):
        drawn = draw_building(np.random.default_rng(seed), config)
        assert set(range(len(drawn.polygons))) == set(drawn.pieces.rooms.tolist()) - {-1}


@pytest.mark.parametrize("facade_share", [0.0, 1.0])
def test_windows_interrupt_only_walls_with_the_outside_behind_them(facade_share: float) -> None:
    fittings = CLOSED.model_copy(update={"window_share": (1.0,), "facade_share": facade_share})
    windows = 0
    for seed in range(12):
        rng = np.random.default_rng(seed)
        plan = draw_plan(rng, BARE)
        assert plan is not None
        pieces = draw_surfaces(plan, rng, fittings).pieces
        building = shapely.union_all(shapely.buffer(plan.rooms, 0.21, join_style="mitre"))
        shapely.prepare(building)
        for number, room in enumerate(plan.rooms):
            sides = shapely.multilinestrings(list(pieces.segments[pieces.rooms == number]))
            for gap in shapely.get_parts(room.exterior.difference(sides.buffer(1e-4))):
                if gap.length < 0.1:  # an edge too short to be mapped
                    continue
                windows += 1
                assert gap.length >= 0.59
                behind = gap.interpolate(0.5, normalized=True).buffer(0.5)
                assert not building.contains(behind)
        assert pieces.facades.any() == (facade_share == 1.0)
    assert windows > 100


def test_a_curtain_wall_is_mullions_from_end_to_end() -> None:
    fittings = CLOSED.model_copy(
        update={"curtain_share": (1.0,), "mullion_m": (0.12, 0.12), "pane_m": (1.0, 1.0)}
    )
    room = Polygon([(0, 0), (6, 0), (6, 4.5), (0, 4.5)])
    floor = draw_surfaces(Plan([room], np.empty((0, 2, 2))), np.random.default_rng(0), fittings)
    lengths = np.linalg.norm(floor.pieces.segments[:, 1] - floor.pieces.segments[:, 0], axis=1)
    mullions = 2 * (5 + 4)  # between 6 panes and between 5; the halves at the corners
    halves = 8
    assert np.sort(lengths) == pytest.approx([0.06] * halves + [0.12] * mullions)
    assert len(floor.panes) == len(floor.windows) == 2 * (6 + 5)
    assert (floor.panes.rooms == 0).all()
