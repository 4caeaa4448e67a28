"""Synthetic buildings: reproducible, varied, and true to their own geometry."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapely
from views import EXACT_VIEW

from sgraph_concepts.errors import InputError
from sgraph_core import map_file
from sgraph_core.evaluation.scores import score_floor
from sgraph_core.preprocess import preprocess
from sgraph_core.settings import read_settings
from sgraph_core.synth.building import Building, draw_building
from sgraph_core.synth.config import (
    BuildingConfig,
    FittingConfig,
    GridConfig,
    PlanConfig,
    ViewConfig,
)
from sgraph_core.synth.pieces import NO_ROOM
from sgraph_core.synth.plan import draw_plan

CLEAN = BuildingConfig(
    plan=PlanConfig(crooked_m=(0.0,)),
    fittings=FittingConfig(door_share=(0.0,), door_leaf_share=(0.0,), furnished_share=(0.0,)),
    view=EXACT_VIEW,
)


def building(seed: int, config: BuildingConfig = BuildingConfig()) -> Building:  # noqa: B008
    return draw_building(np.random.default_rng(seed), config)


def test_equal_seeds_give_equal_maps_and_others_do_not() -> None:
    one, two = (map_file.dump(building(3).graph("x")) for _ in range(2))
    assert one == two
    assert map_file.dump(building(4).graph("x")) != one


@pytest.mark.parametrize("seed", range(8))
def test_maps_with_their_truth_survive_the_file_format(seed: int) -> None:
    graph = building(seed).graph("floor")
    again = map_file.parse(map_file.dump(graph).encode())
    assert again.truth == graph.truth
    score = score_floor(again, again.truth)  # type: ignore[arg-type]
    assert score.walls.true == len(graph.truth.walls)  # type: ignore[union-attr]


@pytest.mark.parametrize("seed", range(8))
def test_without_noise_surfaces_are_the_outlines_of_their_rooms(seed: int) -> None:
    drawn = building(seed, CLEAN)
    truth = drawn.truth(drawn.graph("x").wall_surfaces.ordered())
    for room, polygon in enumerate(truth.polygons):
        outline = shapely.Polygon(polygon)
        rows = np.flatnonzero(truth.rooms == room)
        for row in rows:
            segment = shapely.LineString(truth.surfaces.segments[row])
            in_front = truth.surfaces.midpoints[row] + 0.01 * truth.surfaces.normals[row]
            on_outline = segment.hausdorff_distance(
                segment.intersection(outline.exterior.buffer(1e-3))
            )
            on_hole = outline.contains(segment)  # holes of a room are not drawn
            assert on_outline < 1e-2 or on_hole
            assert outline.contains(shapely.Point(in_front))


@pytest.mark.parametrize("seed", range(8))
def test_true_walls_are_back_to_back_within_the_thickest_wall(seed: int) -> None:
    drawn = building(seed, CLEAN)
    for one, two in drawn.walls:
        assert drawn.normals[one] @ drawn.normals[two] < -0.95
        gap = shapely.distance(*shapely.linestrings(drawn.segments[[one, two]]))
        assert 0 < gap <= 0.61


def test_buildings_vary_in_the_documented_ways() -> None:
    drawn = [building(seed) for seed in range(60)]
    rooms = [len(b.polygons) for b in drawn]
    surfaces = [len(b.segments) for b in drawn]
    corners = {len(p) for b in drawn for p in b.polygons}
    assert min(rooms) <= 3
    assert max(rooms) >= 30
    assert max(surfaces) > 10 * min(surfaces)
    assert {4, 6, 8} <= corners
    assert any(len(np.unique(b.owners)) < len(b.owners) for b in drawn), "no surface through rooms"
    assert any((b.pieces.rooms < 0).any() for b in drawn), "no facade and no clutter"
    assert not all((b.pieces.rooms < 0).any() for b in drawn), "always a facade or clutter"


def test_one_floor_may_have_rooms_from_toilets_to_halls() -> None:
    areas = []
    for seed in range(60):
        plan = draw_plan(np.random.default_rng(seed), PlanConfig())
        areas.append([room.area for room in plan.rooms] if plan else [])
    assert any(area < 1.5 for floor in areas for area in floor)
    assert any(area > 200 for floor in areas for area in floor)
    assert any(min(floor) < 3 and max(floor) > 100 for floor in areas if floor)


def test_fragments_of_a_surface_through_rooms_know_their_own_room() -> None:
    config = CLEAN.model_copy(
        update={"view": CLEAN.view.model_copy(update={"through_share": (1.0,)})}
    )
    split = 0
    for seed in range(12):
        drawn = building(seed, config)
        fragments = preprocess(drawn.graph("x").wall_surfaces.ordered()).surfaces
        truth = drawn.truth(fragments)
        for parent in np.unique(fragments.ids):
            rooms = set(truth.rooms[fragments.ids == parent].tolist())
            own = set(np.maximum(drawn.pieces.rooms[drawn.owners == parent], NO_ROOM).tolist())
            assert rooms <= own
            split += len(rooms) > 1
    assert split > 20


def test_labels_never_depend_on_where_the_building_lies() -> None:
    for seed in range(5):
        drawn = building(seed)
        normals = drawn.segments[:, 1] - drawn.segments[:, 0]
        assert np.abs((normals * drawn.normals).sum(axis=1)).max() < 1e-9


@pytest.mark.parametrize(
    ("ingredients", "message"),
    [
        ('{"plan": {"aspect": [3, 1]}}', "plan.aspect: .*lower bound must not exceed"),
        ('{"plan": {"floor_area_m2": [60, 1e999]}}', "plan.floor_area_m2.1: .*finite"),
        ('{"plan": {"room_area_m2": [NaN, 9]}}', "plan.room_area_m2.0: .*finite"),
        ('{"plan": {"room_area_spread": 1000}}', "plan.room_area_spread: .*or equal to 3$"),
        ('{"plan": {"open_part": [0.5, 1.5]}}', "plan.open_part.1: .*or equal to 1$"),
        ('{"plan": {"merged_share": []}}', "plan.merged_share: .*at least 1 item"),
        ('{"plan": {"corridor_share": 1}}', "plan: .*corridor_share 1 and .* more than 1$"),
        ('{"fittings": {"facade_share": 2}}', "fittings.facade_share: .*or equal to 1$"),
        ('{"fittings": {"door_share": [0, 30]}}', "fittings.door_share.1: .*or equal to 1$"),
        ('{"view": {"missing_share": [30]}}', "view.missing_share.0: .*or equal to 1$"),
        ('{"view": {"longest_piece_m": [1e-6, 1]}}', "view.longest_piece_m.0: .*to 0.5$"),
        ('{"view": {"pose_spacing_m": [0, 1]}}', "view.pose_spacing_m.0: .*to 0.5$"),
        ('{"view": {"visit_rooms": [1e23, 1e23]}}', "view.visit_rooms.0: .*"),
        ('{"view": {"noise_m": [1e300]}}', "view.noise_m.0: .*or equal to 5$"),
        ('{"roof": 1}', "roof: Extra inputs"),
        ("{", "Invalid JSON"),
    ],
)
def test_ingredients_out_of_bounds_are_named(
    tmp_path: Path, ingredients: str, message: str
) -> None:
    file = tmp_path / "config.json"
    file.write_text(ingredients)
    with pytest.raises(InputError, match=rf"config\.json: {message}"):
        read_settings(file, BuildingConfig)


EXTREMES: dict[str, dict[str, object]] = {
    "small": {"plan": {"floor_area_m2": (1, 10), "room_area_m2": (1, 1)}},
    "long": {"plan": {"floor_area_m2": (2000, 2000), "aspect": (20, 20)}},
    "uneven": {"plan": {"floor_area_m2": (500, 500), "room_area_spread": 3}},
    "thick walls": {"plan": {"wall_thickness_m": (200, 200)}},
    "thick facades": {"fittings": {"facade_thickness_m": (200, 200), "facade_share": 1}},
    "tiny furniture": {"fittings": {"furniture_size_m": (0.01, 0.01), "furnished_share": (1,)}},
    "small pieces": {"view": {"longest_piece_m": (0.5, 0.5), "fragmented_share": 1}},
    "far off": {"view": {"noise_m": (5,), "drift_m": (5, 5), "drifted_share": 1}},
    "one visit": {"view": {"visit_rooms": (1000, 1000), "drifted_share": 1}},
}


@pytest.mark.parametrize("name", EXTREMES)
@pytest.mark.filterwarnings("error")
def test_the_bounds_of_ingredients_give_buildings(name: str) -> None:
    config = BuildingConfig.model_validate(EXTREMES[name])
    for seed in range(3):
        assert np.isfinite(building(seed, config).segments).all()


def test_offices_have_straight_corridors_or_a_ring_around_a_core() -> None:
    offices = Path(__file__).parents[2] / "docs" / "layouts" / "offices.json"
    config = read_settings(offices, BuildingConfig).plan
    rings = 0
    for seed in range(20):
        plan = draw_plan(np.random.default_rng(seed), config)
        assert plan is not None
        holes = [shapely.Polygon(hole) for room in plan.rooms for hole in room.interiors]
        rings += any(hole.area > 50 for hole in holes)
    assert 3 <= rings <= 10


def test_every_ingredient_is_described() -> None:
    for model in (PlanConfig, FittingConfig, ViewConfig, GridConfig):
        assert [n for n, f in model.model_fields.items() if not f.description] == []
