"""Cubicles: where they stand, and that each is a room which is open towards the one around it."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
import shapely.affinity
from shapely import Polygon, box

from sgraph_core.synth.building import draw_building
from sgraph_core.synth.config import BuildingConfig, FittingConfig, PlanConfig, ViewConfig
from sgraph_core.synth.cubicles import stand_cubicles
from sgraph_core.synth.plan import Plan
from sgraph_core.synth.surfaces import draw_surfaces

CUBICLES = PlanConfig(
    cubicle_share=(1.0,),
    cubicle_m=(2.5, 2.5),
    cubicle_partition_m=(0.1, 0.1),
    aisle_m=(1.5, 1.5),
)
HALL = box(0, 0, 24, 15)


def halls(count: int, hall: Polygon = HALL) -> list[Plan]:
    plans = []
    for seed in range(count):
        rooms, cubicles = stand_cubicles([hall], np.random.default_rng(seed), CUBICLES)
        assert list(cubicles) == list(range(1, len(rooms)))
        assert set(cubicles.values()) == {0}
        plans.append(Plan(rooms, np.empty((0, 2, 2)), [], cubicles))
    return plans


@pytest.mark.parametrize("angle", [0.0, 30.0])
def test_cubicles_keep_apart_by_a_partition_and_leave_aisles(angle: float) -> None:
    for plan in halls(6, shapely.affinity.rotate(HALL, angle, origin=(0, 0))):
        hall, *cells = plan.rooms
        assert len(cells) >= 4
        for number, cell in enumerate(cells):
            assert cell.area == pytest.approx(2.5**2)
            others = [hall, *cells[:number], *cells[number + 1 :]]
            assert shapely.distance(cell, others).min() == pytest.approx(0.1, abs=2e-4)
            assert cell.within(shapely.affinity.rotate(HALL, angle, origin=(0, 0)).buffer(1e-6))
        assert hall.buffer(-0.74).geom_type == "Polygon"  # aisles of 1.5 m reach everywhere


def test_small_rooms_have_none() -> None:
    rooms, cubicles = stand_cubicles([box(0, 0, 6, 6)], np.random.default_rng(0), CUBICLES)
    assert (rooms, cubicles) == ([box(0, 0, 6, 6)], {})


def test_each_cubicle_is_open_towards_the_room_around_it_and_nowhere_else() -> None:
    """However many doors there are between rooms."""
    fittings = FittingConfig(
        door_share=(1.0,),
        second_door_share=1.0,
        cubicle_opening=(0.6, 0.6),
        broken_behind_share=(0.0,),
        window_share=(0.0,),
        curtain_share=(0.0,),
    )
    for seed, plan in enumerate(halls(6)):
        floor = draw_surfaces(plan, np.random.default_rng(seed), fittings)
        passages = sorted(sorted(pair) for pair in floor.passages.tolist())
        assert passages == [[0, cell] for cell in plan.cubicles]
        for cell in plan.cubicles:
            mapped = floor.pieces.segments[(floor.pieces.rooms == cell) & floor.pieces.structural]
            length = np.linalg.norm(mapped[:, 1] - mapped[:, 0], axis=1).sum()
            assert 10 - 0.6 * 2.5 - 0.3 <= length <= 10 - 0.6 * 0.3


def test_floors_with_cubicles_are_as_well_labelled_as_any() -> None:
    config = BuildingConfig(
        plan=CUBICLES.model_copy(update={"room_area_m2": (60.0, 90.0)}),
        view=ViewConfig(missing_share=(0.0,), occluded_share=0.0),
    )
    cubicles = 0
    for seed in range(4):
        drawn = draw_building(np.random.default_rng(seed), config)
        cubicles += np.isclose([Polygon(ring).area for ring in drawn.polygons], 2.5**2).sum()
        assert set(range(len(drawn.polygons))) == set(drawn.pieces.rooms.tolist()) - {-1, -2}
    assert cubicles > 20
