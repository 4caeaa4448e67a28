"""The paper's scenes, floors as data, and the ways through them."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
import shapely

from sgraph_concepts.errors import InputError
from sgraph_core.frontend.building import Door, Floor, Furniture
from sgraph_core.frontend.route import CLEARANCE_M, drive_along, route
from sgraph_core.frontend.scenes import SCENES, scene

TABLE_I = {
    "C1F1s": {"L": 1, "square": 1, "corridor": 2},
    "C1F2s": {"square": 5, "elongated": 2, "corridor": 1},
    "SE1s": {"square": 6, "corridor": 3},
    "SE2s": {"square": 5, "elongated": 2},
    "SE3s": {"square": 22, "corridor": 4},
    "C1F1r": {"L": 1, "square": 1, "corridor": 2},
    "C1F2r": {"square": 5, "elongated": 2, "corridor": 1},
    "C2F2r": {"square": 7, "L": 2, "elongated": 3},
    "C3F2r": {"square": 9, "L": 3, "corridor": 2},
}


def shape(polygon: shapely.Polygon) -> str:
    """Return what a room's outline is, whatever its name says."""
    if len(polygon.exterior.coords) == 7:
        return "L"
    west, south, east, north = polygon.bounds
    short, long = sorted((east - west, north - south))
    if long < 1.5 * short:
        return "square"
    return "corridor" if short < 2.5 else "elongated"


@pytest.mark.parametrize("name", SCENES)
def test_scenes_have_the_rooms_of_table_i(name: str) -> None:
    floor = scene(name)
    assert Counter(name.split()[0] for name in floor.rooms) == TABLE_I[name]
    assert Counter(map(shape, floor.polygons.values())) == TABLE_I[name]


@pytest.mark.parametrize("name", SCENES)
def test_rooms_are_apart_by_walls_of_differing_thickness(name: str) -> None:
    polygons = list(scene(name).polygons.values())
    gaps = [a.distance(b) for k, a in enumerate(polygons) for b in polygons[:k]]
    walls = {round(gap, 3) for gap in gaps if gap < 0.5}
    assert min(walls) > 0.05
    assert len(walls) >= 2


@pytest.mark.parametrize("name", SCENES)
def test_tours_visit_every_room_and_come_back_by_doors(name: str) -> None:
    floor = scene(name)
    assert set(floor.tour) == set(floor.rooms)
    assert floor.tour[0] == floor.tour[-1]
    poses = drive_along(route(floor.free, floor.stops()), 0.25)
    shell = floor.free.boundary
    assert shapely.distance(shapely.points(poses[:, :2]), shell).min() > CLEARANCE_M - 0.01
    steps = np.linalg.norm(np.diff(poses[:, :2], axis=0), axis=1)
    assert steps.max() < 0.26


def test_truth_names_the_two_sides_of_walls() -> None:
    truth = scene("SE2s").truth()
    segments, normals = truth.surfaces.segments, truth.surfaces.normals
    for one, two in truth.walls:
        assert normals[one] @ normals[two] == pytest.approx(-1)
        thickness = (segments[two].mean(axis=0) - segments[one].mean(axis=0)) @ -normals[one]
        assert 0.05 < thickness < 0.5
        assert truth.rooms[one] != truth.rooms[two]


def test_surfaces_of_the_truth_have_the_room_in_front_of_them() -> None:
    floor = scene("C1F1r")
    truth = floor.truth()
    in_front = shapely.points(truth.surfaces.midpoints + 0.01 * truth.surfaces.normals)
    rooms = list(floor.polygons.values())
    for point, room in zip(in_front, truth.rooms, strict=True):
        assert room == -1 or rooms[room].contains(point)
        assert floor.free.contains(point)
    assert (truth.rooms == -1).sum() == 4 * len(floor.furniture)
    turned = truth.surfaces.tangents
    along = truth.surfaces.segments[:, 1] - truth.surfaces.segments[:, 0]
    assert (along * turned).sum(axis=1) == pytest.approx(truth.surfaces.lengths)


ROOMS = {"a": ((0, 0), (4, 0), (4, 4), (0, 4)), "b": ((4.2, 0), (8, 0), (8, 4), (4.2, 4))}


def test_a_door_must_be_in_a_wall() -> None:
    rooms = {**ROOMS, "b": ((6, 0), (8, 0), (8, 4), (6, 4))}
    floor = Floor("far", rooms, (Door("a", "b", (5, 2)),), ("a", "b"))
    with pytest.raises(InputError, match=r"far: a door from a to b at \(5, 2\)"):
        floor.panels()


def test_a_tour_needs_doors() -> None:
    floor = Floor("closed", ROOMS, (), ("a", "b"))
    with pytest.raises(InputError, match="there is no way"):
        route(floor.free, floor.stops())


def test_the_way_leads_around_furniture() -> None:
    desk = Furniture((1.5, 1.0), (2.5, 4.0), 0.8)
    floor = Floor("desk", ROOMS, (Door("a", "b", (4.1, 3)),), ("a",), (desk,))
    corners = route(floor.free, [(0.7, 3.3), (3.3, 3.3)])
    assert len(corners) == 4
    assert corners[1:3, 1] == pytest.approx(1.0 - CLEARANCE_M)


def test_unknown_scenes_are_named() -> None:
    with pytest.raises(InputError, match=r"no scene .C9.: .*SE3s"):
        scene("C9")
