"""Synthetic buildings as occupancy grids: exact cells, exact labels, exact truth of surfaces."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapely
from PIL import Image
from shapely import box

from sgraph_concepts.types import FloatArray, OccupancyGrid, SurfaceArrays
from sgraph_core.grid.extraction import extract
from sgraph_core.preprocess import preprocess
from sgraph_core.synth.building import draw_building
from sgraph_core.synth.config import BuildingConfig, FittingConfig, GridConfig, PlanConfig
from sgraph_core.synth.grid_clutter import stand_cupboards, stand_tables
from sgraph_core.synth.grid_files import write_grid
from sgraph_core.synth.grid_truth import surface_truth
from sgraph_core.synth.pieces import Pieces
from sgraph_core.synth.plan import Plan
from sgraph_core.synth.polygons import all_edges
from sgraph_core.synth.raster import cells_along, covered, filled
from sgraph_core.synth.robot_grid import GridBuilding, draw_grid_building, render
from sgraph_core.synth.scans import Obstacles, Scanner, scan
from sgraph_core.synth.surfaces import Floor, draw_surfaces

FREE, OCCUPIED, UNKNOWN = OccupancyGrid.FREE, OccupancyGrid.OCCUPIED, OccupancyGrid.UNKNOWN
CLOSED = FittingConfig(
    door_share=(0.0,),
    facade_share=0.0,
    furnished_share=(0.0,),
    window_share=(0.0,),
    curtain_share=(0.0,),
)
EMPTY = GridConfig(
    resolution_m=(0.05,),
    aligned_share=1.0,
    cupboard_share=(0.0,),
    table_share=(0.0,),
    speckles_per_m2=(0.0,),
    drawn_share=1.0,
    drawn_walls=("faces",),
)
EXACT = {
    "range_noise_m": (0.0,),
    "pose_noise_m": (0.0,),
    "pose_noise_deg": (0.0,),
    "dark_share": (0.0,),
    "drawn_share": 0.0,
}
"""A robot that measures without error."""
DRAWERS = (draw_building, draw_grid_building)
SMALL = PlanConfig(floor_area_m2=(100.0, 250.0))


def floor(*rooms: shapely.Polygon, fittings: FittingConfig = CLOSED, seed: int = 0) -> Floor:
    plan = Plan(list(rooms), np.empty((0, 2, 2)))
    return draw_surfaces(plan, np.random.default_rng(seed), fittings)


def drawn(built: Floor, grid: GridConfig, seed: int = 0) -> GridBuilding:
    return render(built, np.random.default_rng(seed), BuildingConfig(grid=grid))


TWO_ROOMS = (box(0, 0, 5, 4), box(5.2, 0, 9, 4))
OUTLINES = [shapely.get_coordinates(room.exterior)[:-1] for room in TWO_ROOMS]


def test_polygons_with_holes_fill_the_cells_whose_centres_they_hold() -> None:
    rng = np.random.default_rng(0)
    ring = shapely.Point(15.3, 12.1).buffer(9.7, quad_segs=5)
    hollow = ring.difference(shapely.affinity.rotate(box(12, 9, 19, 14), 30))
    other = shapely.Polygon(rng.uniform(26, 38, (3, 2)))
    found = filled([hollow, other], np.array([3, 7]), (30, 40))
    column, row = np.meshgrid(np.arange(40) + 0.5, np.arange(30) + 0.5)
    expected = 3 * shapely.contains_xy(hollow, column, row)
    expected += 7 * shapely.contains_xy(other, column, row)
    assert (found == expected).all()
    assert (covered([ring, hollow], (30, 40)) == shapely.contains_xy(ring, column, row)).all()
    assert not covered([], (30, 40)).any()


def test_polygons_and_segments_that_reach_beyond_the_grid_are_cut() -> None:
    assert (filled([box(-5, -5, 50, 2)], np.array([1]), (4, 6))[:2] == 1).all()
    cells = cells_along(np.array([[[-3.0, 1.5], [9.0, 1.5]]]), (4, 6))
    assert set(cells.tolist()) == set(range(6, 12))


def scanner(**changes: object) -> Scanner:
    settings = {
        "beams": 720,
        "reach": 50.0,
        "range_noise": 0.0,
        "pose_noise": 0.0,
        "angle_noise": 0.0,
        "clearing": False,
        "occupied_from": 0.25,
    }
    return Scanner(**{**settings, **changes})  # type: ignore[arg-type]


def outline(*polygons: shapely.Polygon) -> FloatArray:
    return all_edges(list(polygons))[0]


def obstacles(segments: FloatArray, stopping: float = 1.0, dark: bool = False) -> Obstacles:
    count = len(segments)
    return Obstacles(segments, np.full(count, stopping), np.full(count, dark))


def scanned(things: Obstacles, *poses: tuple[float, float], **changes: object) -> np.ndarray:
    rng = np.random.default_rng(0)
    return scan(np.array(poses), things, scanner(**changes), (40, 40), rng)


def test_a_scan_frees_what_it_sees_and_marks_where_it_ends() -> None:
    room, column = box(5.5, 5.5, 30.5, 25.5), box(17.5, 12.5, 20.5, 15.5)
    cells = scanned(obstacles(outline(room, column)), (10.0, 14.0))
    inside = np.zeros((40, 40), bool)
    inside[6:25, 6:30] = True
    assert (cells[8, 8:28] == FREE).all()
    assert (cells[12:15, 17] == OCCUPIED).all()  # the column's near face
    assert (cells[13:15, 22:29] == UNKNOWN).all()  # its shadow
    assert (cells[7:24, 5] == OCCUPIED).all()
    assert set(cells[~inside & (cells != OCCUPIED)].tolist()) == {UNKNOWN}


def test_rays_pass_windows_and_free_wedges_only_where_they_meet_something() -> None:
    room = outline(box(5.5, 5.5, 20.5, 20.5))
    window = np.array([[[20.5, 15.5], [20.5, 11.5]]])
    east = (room == 20.5)[..., 0].all(axis=1)
    sides = np.array([[[20.5, 5.5], [20.5, 11.5]], [[20.5, 15.5], [20.5, 20.5]]])
    walls = np.concatenate([room[~east], sides])
    fence = np.array([[[35.5, 0.0], [35.5, 40.0]]])
    assert (scanned(obstacles(walls), (13.0, 13.0))[13, 22:] == UNKNOWN).all()
    assert (scanned(obstacles(walls), (13.0, 13.0), clearing=True)[13, 22:] == FREE).all()
    fenced = scanned(obstacles(np.concatenate([walls, fence])), (13.0, 13.0))
    assert (fenced[13, 22:35] == FREE).all()
    assert fenced[13, 35] == OCCUPIED
    assert fenced[3, 25] == UNKNOWN
    glass = Obstacles(
        np.concatenate([walls, window]), np.append(np.ones(len(walls)), 1.0), np.zeros(6, bool)
    )
    assert (scanned(glass, (13.0, 13.0), clearing=True)[13, 22:] == UNKNOWN).all()


def test_dark_surfaces_return_nothing_and_far_ones_are_not_seen() -> None:
    room = outline(box(5.5, 5.5, 30.5, 25.5))
    assert (scanned(obstacles(room, dark=True), (10.0, 14.0), clearing=True) == UNKNOWN).all()
    near = scanned(obstacles(room), (10.0, 14.0), reach=10.0)
    assert (near[:, 20:] == UNKNOWN).all()
    assert OCCUPIED in near[:, 5]


def test_a_drawn_grid_knows_all_of_every_room() -> None:
    building = drawn(floor(*TWO_ROOMS), EMPTY)
    cells, labels = building.grid.cells, building.labels
    for number, room in enumerate(TWO_ROOMS, 1):
        assert (labels == number).sum() * 0.05**2 == pytest.approx(room.area, rel=0.03)
    assert ((cells == FREE) == (labels > 0)).all()
    occupied = (cells == OCCUPIED).sum() * 0.05
    outlines = sum(piece.length for piece in (*TWO_ROOMS, box(-0.3, -0.3, 9.3, 4.3)))
    assert occupied == pytest.approx(outlines, rel=0.12)  # walls are one cell thin


@pytest.mark.parametrize("walls", ["solid", "unknown"])
def test_walls_are_drawn_solid_or_not_at_all(walls: str) -> None:
    fittings = CLOSED.model_copy(update={"facade_thickness_m": (0.2, 0.2)})
    grid = EMPTY.model_copy(update={"drawn_walls": (walls,)})
    building = drawn(floor(*TWO_ROOMS, fittings=fittings), grid)
    occupied = (building.grid.cells == OCCUPIED).sum() * 0.05**2
    body = box(-0.2, -0.2, 9.2, 4.2).area - sum(room.area for room in TWO_ROOMS)
    assert occupied == pytest.approx(body if walls == "solid" else 0.0, rel=0.05)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("aligned", [0.0, 1.0])
def test_labels_say_which_room_each_free_cell_lies_in(seed: int, aligned: float) -> None:
    grid = GridConfig(resolution_m=(0.1,), aligned_share=aligned)
    building = draw_grid_building(
        np.random.default_rng(seed), BuildingConfig(plan=SMALL, grid=grid)
    )
    height, width = building.labels.shape
    column, row = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    centres = building.grid.to_world(np.stack([column, row], axis=-1).reshape(-1, 2))
    within = np.zeros(height * width, bool)
    for number, corners in enumerate(building.polygons, 1):
        own = building.labels.ravel() == number
        room = shapely.Polygon(corners)
        within |= shapely.contains_xy(room, centres)
        assert shapely.dwithin(shapely.points(centres[own]), room, 1e-6).all()
    assert (building.labels.ravel()[~within] == 0).all()
    assert building.labels.any()


@pytest.mark.parametrize("seed", range(6))
def test_every_surface_of_a_clean_plan_gets_its_room(seed: int) -> None:
    config = BuildingConfig(plan=SMALL, fittings=CLOSED, grid=EMPTY)
    building = draw_grid_building(np.random.default_rng(seed), config)
    surfaces = preprocess(extract(building.grid).wall_surfaces.ordered()).surfaces
    truth = building.truth(surfaces)
    rooms = [shapely.Polygon(corners) for corners in building.polygons]
    in_front = shapely.points(surfaces.midpoints + 0.1 * surfaces.normals)
    long = surfaces.lengths > 0.3  # the shortest lie across the corners of columns and niches
    for room, point in zip(truth.rooms[long].tolist(), in_front[long], strict=True):
        assert room >= 0
        assert rooms[room].contains(point)
    assert set(truth.rooms.tolist()) >= set(range(len(rooms)))


def test_the_truth_of_surfaces_made_by_hand() -> None:
    segments, normals, rooms = all_edges(list(TWO_ROOMS))
    pieces = Pieces(segments, normals, rooms, np.ones(len(rooms), bool))
    box_faces, inwards, _ = all_edges([box(1, 1, 2, 2)])
    clutter = Pieces(box_faces, -inwards, np.full(4, -1), np.zeros(4, bool))
    rows = [
        ([[4.95, 0.2], [5.05, 3.8]], [-1, 0], 0),  # the wall between the rooms, a little oblique
        ([[5.2, 3.0], [5.2, 0.5]], [1, 0], 1),
        ([[0.5, -0.1], [3.0, -0.1]], [0, 1], 0),  # 10 cm off
        ([[0.5, -0.2], [3.0, -0.2]], [0, 1], -1),  # 20 cm off
        ([[0.5, 0.0], [3.0, 0.0]], [0, -1], -1),  # faces the other way
        ([[1.0, 1.0], [1.0, 2.0]], [-1, 0], 0),  # a box in the room
        ([[5.1, 1.5], [5.15, 1.6]], [0, 1], -1),  # in the wall
        ([[3.0, 4.0], [7.8, 4.0]], [0, -1], 1),  # through both rooms, more in the second
    ]
    ends = np.array([segment for segment, _, _ in rows], np.float64)
    across = np.array([normal for _, normal, _ in rows], np.float64)
    surfaces = SurfaceArrays(np.arange(len(rows)), ends, across)
    truth = surface_truth(surfaces, Pieces.joined(pieces, clutter), OUTLINES)
    assert truth.rooms.tolist() == [room for _, _, room in rows]
    assert truth.walls.tolist() == [[0, 1]]


def test_in_a_core_surfaces_belong_to_its_rooms_and_not_to_the_corridor_around_it() -> None:
    ring = np.array([[0, 0], [9, 0], [9, 9], [0, 9]], np.float64)
    core = np.array([[3, 3], [6, 3], [6, 6], [3, 6]], np.float64)
    far_off = Pieces(*all_edges([box(50, 50, 51, 51)])[:2], np.zeros(4, int), np.ones(4, bool))
    ends = np.array([[[4.0, 4.0], [5.0, 4.0]], [[1.0, 1.0], [2.0, 1.0]]])
    surfaces = SurfaceArrays(np.arange(2), ends, np.array([[0.0, 1.0], [0.0, 1.0]]))
    for polygons, expected in (([ring, core], [1, 0]), ([core, ring], [0, 1])):
        assert surface_truth(surfaces, far_off, polygons).rooms.tolist() == expected


def test_a_scanned_grid_knows_no_more_than_the_robot_sees() -> None:
    robot = EMPTY.model_copy(update=EXACT)
    doors = CLOSED.model_copy(
        update={"door_share": (1.0,), "second_door_share": 0.0, "opening_share": (0.0,)}
    )
    for seed in range(3):
        building = drawn(floor(*TWO_ROOMS, fittings=doors, seed=seed), robot, seed)
        free = building.grid.cells == FREE
        outside = free & (building.labels == 0)
        assert (building.labels[~free] == 0).all()
        assert free.sum() * 0.05**2 == pytest.approx(sum(r.area for r in TWO_ROOMS), rel=0.05)
        assert outside.sum() * 0.05**2 < 0.3  # the doorway


def test_furniture_stands_in_rooms_clear_of_doors_and_of_other_furniture() -> None:
    doors = CLOSED.model_copy(update={"door_share": (1.0,), "furnished_share": (1.0,)})
    crowded = GridConfig(cupboard_share=(1.0,), table_share=(1.0,))
    standing_by_walls = 0
    for seed in range(6):
        rng = np.random.default_rng(seed)
        built = floor(*TWO_ROOMS, fittings=doors, seed=seed)
        cupboards = stand_cupboards(built, rng, crowded)
        standing = [*built.furniture, *cupboards]
        legs = stand_tables(built.rooms, standing, rng, crowded)
        standing_by_walls += len(cupboards)
        assert len(legs) % 4 == 0
        free = shapely.union_all([room.buffer(0.02) for room in built.rooms])
        assert all(free.contains(body) for body in [*standing, *legs])
        ways = shapely.polygons(built.doors)
        assert all(shapely.distance(ways, body).min() > 0.5 for body in cupboards)
        for number, body in enumerate(cupboards, len(built.furniture)):
            shared = shapely.area(shapely.intersection(body, standing[:number]))
            assert shared.max(initial=0) < 0.05
        against = [shapely.distance(room.exterior, b) for room in built.rooms for b in cupboards]
        assert sum(distance < 1e-6 for distance in against) == len(cupboards)
    assert standing_by_walls > 10


def test_a_drawn_grid_is_labelled_under_its_furniture() -> None:
    crowded = EMPTY.model_copy(update={"cupboard_share": (1.0,), "table_share": (1.0,)})
    bare, furnished = (drawn(floor(*TWO_ROOMS), grid) for grid in (EMPTY, crowded))
    covered_cells = (furnished.labels > 0) & (furnished.grid.cells != FREE)
    assert covered_cells.sum() * 0.05**2 > 0.3
    assert (furnished.labels > 0).sum() == pytest.approx((bare.labels > 0).sum(), rel=0.02)


def test_speckles_turn_known_cells_into_something_else() -> None:
    grid = EMPTY.model_copy(update={"speckles_per_m2": (2.0,)})
    clean, speckled = drawn(floor(*TWO_ROOMS), EMPTY), drawn(floor(*TWO_ROOMS), grid)
    known = clean.grid.cells != UNKNOWN
    changed = clean.grid.cells != speckled.grid.cells
    assert changed.sum() == int(2.0 * 0.05**2 * known.sum())
    assert not changed[~known].any()
    assert (clean.labels == speckled.labels).all()


def test_equal_seeds_give_equal_grids_and_others_do_not() -> None:
    config = BuildingConfig(plan=SMALL)
    one, two, other = (
        draw_grid_building(np.random.default_rng(seed), config) for seed in (1, 1, 2)
    )
    assert (one.grid.cells == two.grid.cells).all()
    assert (one.labels == two.labels).all()
    assert (one.pieces.segments == two.pieces.segments).all()
    assert one.grid.cells.shape != other.grid.cells.shape


def test_one_seed_gives_one_building_as_surfaces_and_as_a_grid() -> None:
    config = BuildingConfig(plan=SMALL)
    for seed in range(3):
        buildings = [draw(np.random.default_rng(seed), config) for draw in DRAWERS]
        one, two = (
            [shapely.Polygon(corners).area for corners in building.polygons]
            for building in buildings
        )
        assert one == pytest.approx(two)


def test_what_is_written_is_what_was_drawn(tmp_path: Path) -> None:
    building = draw_grid_building(np.random.default_rng(3), BuildingConfig(plan=SMALL))
    write_grid(building, tmp_path / "floor")
    folder, grid = tmp_path / "floor", building.grid
    assert sorted(file.name for file in folder.iterdir()) == ["map.png", "map.yaml", "rooms.png"]
    with Image.open(folder / "map.png") as image:
        values = np.array(image)[::-1]
    assert (np.array([254, 0, 205])[grid.cells] == values).all()
    with Image.open(folder / "rooms.png") as image:
        assert image.mode == "I;16"
        assert (np.array(image)[::-1] == building.labels).all()
    description = (folder / "map.yaml").read_text()
    assert f"origin: {grid.origin.tolist()}" in description
    assert f"resolution: {grid.resolution}" in description
