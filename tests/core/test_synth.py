"""Synthetic buildings: reproducible, varied, and true to their own geometry."""

from __future__ import annotations

import json

import numpy as np
import pytest
import shapely
from pydantic import ValidationError

from sgraph_core import map_file
from sgraph_core.evaluation.scores import score_floor
from sgraph_core.preprocess import preprocess
from sgraph_core.synth.building import Building, draw_building
from sgraph_core.synth.config import BuildingConfig, FittingConfig, PlanConfig, ViewConfig
from sgraph_core.synth.plan import draw_plan

CLEAN = BuildingConfig(
    plan=PlanConfig(crooked_m=(0.0,)),
    fittings=FittingConfig(door_share=(0.0,), door_leaf_share=(0.0,), furnished_share=(0.0,)),
    view=ViewConfig(
        occluded_share=0.0,
        drifted_share=0.0,
        through_share=(0.0,),
        fragmented_share=0.0,
        missing_share=(0.0,),
        cropped_share=(0.0,),
        duplicate_share=(0.0,),
        noise_m=(0.0,),
    ),
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
            own = set(drawn.pieces.rooms[drawn.owners == parent].tolist())
            assert rooms <= own
            split += len(rooms) > 1
    assert split > 20


def test_labels_never_depend_on_where_the_building_lies() -> None:
    for seed in range(5):
        drawn = building(seed)
        normals = drawn.segments[:, 1] - drawn.segments[:, 0]
        assert np.abs((normals * drawn.normals).sum(axis=1)).max() < 1e-9


def test_ingredients_are_checked() -> None:
    with pytest.raises(ValidationError, match="lower bound must not exceed"):
        PlanConfig(aspect=(3.0, 1.0))
    with pytest.raises(ValidationError, match="less than or equal to 1"):
        FittingConfig(facade_share=2)
    with pytest.raises(ValidationError, match="greater than 0"):
        ViewConfig(pose_spacing_m=(0.0, 1.0))
    with pytest.raises(ValidationError, match="Extra inputs"):
        BuildingConfig.model_validate_json(json.dumps({"roof": 1}))


def test_every_ingredient_is_described() -> None:
    for model in (PlanConfig, FittingConfig, ViewConfig):
        assert [n for n, f in model.model_fields.items() if not f.description] == []
