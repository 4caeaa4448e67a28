"""Double walls: where they stand, what is mapped of them, and what is true of that."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
import shapely
from shapely import LineString, Polygon, box
from views import EXACT_VIEW

from sgraph_concepts.types import FloatArray
from sgraph_core.preprocess import preprocess
from sgraph_core.synth.building import Building, draw_building
from sgraph_core.synth.config import BuildingConfig, FittingConfig, PlanConfig, ViewConfig
from sgraph_core.synth.double_walls import draw_double_walls
from sgraph_core.synth.pieces import IN_CAVITY
from sgraph_core.synth.plan import Plan, draw_plan
from sgraph_core.synth.robot_grid import render
from sgraph_core.synth.surfaces import Floor, draw_surfaces
from sgraph_core.synth.view import draw_view

TWO_ROOMS = [box(0, 0, 5, 4), box(5.2, 0, 9, 6)]
DOUBLE = PlanConfig(double_wall_share=(1.0,), leaf_m=(0.1, 0.1), cavity_m=(0.2, 0.2))


def floors(count: int, **fittings: object) -> Iterator[Floor]:
    for seed in range(count):
        rng = np.random.default_rng(seed)
        plan = draw_plan(rng, DOUBLE)
        assert plan is not None
        if plan.double_walls:
            yield draw_surfaces(plan, rng, FittingConfig().model_copy(update=fittings))


def buildings(count: int, cavity_share: float, cavity_m: float) -> Iterator[Building]:
    config = BuildingConfig(
        plan=DOUBLE.model_copy(update={"cavity_m": (cavity_m, cavity_m), "crooked_m": (0.0,)}),
        fittings=FittingConfig(cavity_share=cavity_share),
        view=EXACT_VIEW,
    )
    for seed in range(count):
        yield draw_building(np.random.default_rng(seed), config)


def lines(segments: FloatArray) -> list[LineString]:
    return [LineString(segment) for segment in segments]


def test_a_double_wall_takes_what_it_needs_from_both_rooms() -> None:
    rooms, walls = draw_double_walls(TWO_ROOMS, np.random.default_rng(0), DOUBLE)
    assert len(walls) == 1
    assert walls[0].body.equals(box(4.9, 0, 5.3, 4))
    assert walls[0].cavity.symmetric_difference(box(5.0, 0.1, 5.2, 3.9)).area < 1e-9
    assert rooms[0].equals(box(0, 0, 4.9, 4))
    assert rooms[1].equals(TWO_ROOMS[1].difference(walls[0].body))


def test_a_wall_that_is_thick_enough_keeps_its_thickness() -> None:
    thin = DOUBLE.model_copy(update={"leaf_m": (0.05, 0.05), "cavity_m": (0.04, 0.04)})
    rooms, walls = draw_double_walls(TWO_ROOMS, np.random.default_rng(0), thin)
    assert all(room.equals(before) for room, before in zip(rooms, TWO_ROOMS, strict=True))
    assert walls[0].cavity.symmetric_difference(box(5.08, 0.05, 5.12, 3.95)).area < 1e-9


def test_a_wall_whose_room_would_have_no_valid_outline_stays_as_it_is() -> None:
    """Now and then taking a body out of a room leaves a hole outside of it: 284 is such a plan."""
    plan = draw_plan(np.random.default_rng(284), PlanConfig(double_wall_share=(1.0,)))
    assert plan is not None
    assert plan.double_walls
    assert shapely.is_valid(plan.rooms).all()


def test_a_corridor_is_not_made_narrow() -> None:
    corridor = [box(0, 0, 5, 0.75), box(0, 0.95, 5, 5)]
    rooms, walls = draw_double_walls(corridor, np.random.default_rng(0), DOUBLE)
    assert (rooms, walls) == (corridor, [])


def test_without_double_walls_all_else_is_drawn_as_if_there_were_no_such_thing() -> None:
    none, some = PlanConfig(double_wall_share=(0.0,)), PlanConfig(double_wall_share=(0.0, 0.3))
    alike = 0
    for seed in range(12):
        one, two = np.random.default_rng(seed), np.random.default_rng(seed)
        plan, other = draw_plan(one, none), draw_plan(two, some)
        assert plan is not None
        assert other is not None
        assert not plan.double_walls
        if not other.double_walls:
            alike += 1
            assert plan.rooms == other.rooms
            assert one.random() == two.random()
    assert 0 < alike < 12


def test_the_faces_of_a_cavity_face_into_it_and_belong_to_no_room() -> None:
    rooms, walls = draw_double_walls(TWO_ROOMS, np.random.default_rng(0), DOUBLE)
    fittings = FittingConfig(door_share=(0.0,), facade_share=0.0, cavity_share=1.0)
    plan = Plan(rooms, np.empty((0, 2, 2)), walls)
    pieces = draw_surfaces(plan, np.random.default_rng(0), fittings).pieces
    inner = pieces.take(pieces.rooms == IN_CAVITY)
    assert inner.structural.all()
    assert not pieces.facades.any()
    lengths = np.linalg.norm(inner.segments[:, 1] - inner.segments[:, 0], axis=1)
    assert np.sort(lengths) == pytest.approx([0.2, 0.2, 3.8, 3.8])
    in_front = inner.segments.mean(axis=1) + 0.01 * inner.normals
    assert shapely.contains_xy(walls[0].cavity, in_front).all()


def test_cavities_are_closed_at_doors_and_clear_of_rooms() -> None:
    doors = 0
    for floor in floors(8, cavity_share=1.0, door_share=(1.0,)):
        inner = lines(floor.pieces.segments[floor.pieces.rooms == IN_CAVITY])
        openings = [Polygon(corners) for corners in floor.doors]
        doors += len(openings)
        for others in (openings, floor.rooms):
            tree = shapely.STRtree(others)
            _, distances = tree.query_nearest(inner, return_distance=True)
            assert distances.min() > 0.04
    assert doors > 50


def test_a_robot_sees_into_no_cavity() -> None:
    view = ViewConfig(occluded_share=1.0, visited_share=(1.0, 1.0))
    for floor in floors(5, cavity_share=1.0, door_share=(0.9,)):
        assert (floor.pieces.rooms == IN_CAVITY).any()
        assert not (draw_view(floor, np.random.default_rng(0), view).rooms == IN_CAVITY).any()


def test_where_a_cavity_is_mapped_each_leaf_is_a_wall() -> None:
    leaves = 0
    for drawn in buildings(5, cavity_share=1.0, cavity_m=0.2):
        graph = drawn.graph("x")
        rooms = np.full(len(drawn.segments), IN_CAVITY)
        rooms[drawn.owners] = drawn.pieces.rooms
        inner = rooms == IN_CAVITY
        tree = shapely.STRtree(lines(drawn.segments[inner]))
        for one, two in drawn.walls:
            between = LineString(drawn.segments[[one, two]].mean(axis=1))
            if inner[[one, two]].any():
                leaves += 1
            elif between.length < 0.5:  # opposite each other
                assert len(tree.query(between, predicate="crosses")) == 0
        assert graph.truth is not None
        in_rooms = {member for room in graph.truth.rooms for member in room.members}
        assert in_rooms.isdisjoint(np.flatnonzero(inner).tolist())
        fragments = preprocess(graph.wall_surfaces.ordered()).surfaces
        labelled = drawn.truth(fragments).rooms
        assert (labelled[inner[fragments.ids]] == -1).all()
    assert leaves > 100


def test_no_face_of_a_cavity_is_mapped_as_one_with_another_surface() -> None:
    config = BuildingConfig(
        plan=DOUBLE,
        fittings=FittingConfig(cavity_share=1.0),
        view=EXACT_VIEW.model_copy(update={"through_share": (1.0,)}),
    )
    joined = 0
    for seed in range(5):
        drawn = draw_building(np.random.default_rng(seed), config)
        pieces = np.bincount(drawn.owners)
        inner = drawn.owners[drawn.pieces.rooms == IN_CAVITY]
        joined += (pieces > 1).sum()
        assert (pieces[inner] == 1).all()
    assert joined > 10


@pytest.mark.parametrize(("cavity_m", "are_walls"), [(0.2, True), (0.4, False)])
def test_where_no_cavity_is_mapped_the_outer_faces_are_a_wall_unless_too_thick(
    cavity_m: float, are_walls: bool
) -> None:
    for drawn in buildings(3, cavity_share=0.0, cavity_m=cavity_m):
        sides = drawn.segments[drawn.walls]
        normals = drawn.normals[drawn.walls[:, 0]]
        thickness = -((sides[:, 1, 0] - sides[:, 0].mean(axis=1)) * normals).sum(axis=1)
        double = np.isclose(thickness, 0.2 + cavity_m, atol=1e-6)
        assert double.any() == are_walls


def test_a_grid_knows_double_walls_as_solid_ones() -> None:
    for floor in floors(3, cavity_share=1.0):
        grid = render(floor, np.random.default_rng(0), BuildingConfig())
        assert grid.labels.any()
        assert not (grid.pieces.rooms == IN_CAVITY).any()
