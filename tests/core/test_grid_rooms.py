"""Rooms of occupancy grids: whose the free cells are, outlines, doorways, labelled images."""

from __future__ import annotations

import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import shapely
import yaml
from floors import CELL_M, closed, grid_of, occupy, surfaces_of
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import Image

from sgraph_concepts.errors import InputError, MapWarning, MissingExtraError
from sgraph_concepts.types import (
    ConceptNode,
    NodeShape,
    OccupancyGrid,
    Scene,
    ScoredEdges,
    SurfaceArrays,
)
from sgraph_core.evaluation.watershed import watershed_rooms
from sgraph_core.graph import SGraph
from sgraph_core.grid.label_image import save_label_image
from sgraph_core.grid.painting import paint
from sgraph_core.grid.passages import separated
from sgraph_core.grid.polygons import polygons
from sgraph_core.grid.reader import read_grid
from sgraph_core.grid.regions import NOBODY, label_cells
from sgraph_core.rooms import adjacency
from sgraph_plugins.room.cluster import cluster
from sgraph_plugins.room.shape import shape

# two rooms of 80 x 80 and 90 x 80 cells, a wall of 10 cells between them, a doorway of 18 cells
WEST, EAST, DOOR = (10, 90, 10, 90), (100, 190, 10, 90), (90, 100, 40, 58)
WEST_LINES = [[(90, 58), (90, 90), (10, 90), (10, 10), (90, 10), (90, 40)]]
EAST_LINES = [[(100, 40), (100, 10), (190, 10), (190, 90), (100, 90), (100, 58)]]


def two_rooms(
    origin: tuple[float, float, float] = (0, 0, 0),
) -> tuple[OccupancyGrid, list[SurfaceArrays]]:
    grid = grid_of(200, 100, WEST, EAST, DOOR, origin=origin)
    return grid, [surfaces_of(grid, *WEST_LINES), surfaces_of(grid, *EAST_LINES, first_id=10)]


def together(*rooms: SurfaceArrays) -> SurfaceArrays:
    segments = np.concatenate([room.segments for room in rooms])
    normals = np.concatenate([room.normals for room in rooms])
    return SurfaceArrays(np.arange(len(segments)), segments, normals)


def shapes_of(grid: OccupancyGrid | None, rooms: list[SurfaceArrays]) -> list[NodeShape]:
    """Return the shapes of rooms as the detector asks for them; ids are places in the list."""
    surfaces = together(*rooms)
    ends = np.cumsum([len(room) for room in rooms])
    members = dict(enumerate(np.split(np.arange(ends[-1]), ends[:-1])))
    none = np.empty((0, 2), np.int64)
    scene = Scene(surfaces, np.zeros(2), none, np.empty(0), np.empty((0, 7)), grid=grid)
    found = shape(members, scene)
    return [found[room] for room in members]


def polygon_of(room: NodeShape) -> shapely.Polygon:
    assert room.polygon is not None
    return shapely.Polygon(room.polygon, room.holes)


def box(grid: OccupancyGrid, *corners: tuple[float, float]) -> shapely.Polygon:
    return shapely.Polygon(grid.to_world(np.array(corners, float)))


@given(st.tuples(st.floats(-50, 50), st.floats(-50, 50), st.floats(-3.2, 3.2)))
@settings(deadline=None, max_examples=20)
def test_two_rooms_meet_in_the_middle_of_their_doorway(origin: tuple[float, float, float]) -> None:
    grid, rooms = two_rooms(origin)
    west, east = shapes_of(grid, rooms)
    true = box(grid, (10, 10), (90, 10), (90, 40), (95, 40), (95, 58), (90, 58), (90, 90), (10, 90))
    assert polygon_of(west).symmetric_difference(true).area < true.length * CELL_M / 10
    assert west.attributes["area_m2"] == pytest.approx((80 * 80 + 5 * 18) * CELL_M**2, abs=0.01)
    assert east.attributes["area_m2"] == pytest.approx((90 * 80 + 5 * 18) * CELL_M**2, abs=0.01)
    assert west.holes == east.holes == ()
    (door,) = west.attributes["doorways"]
    assert east.attributes["doorways"] == [door]
    assert door["rooms"] == [0, 1]
    assert door["position"] == pytest.approx(grid.to_world(np.array([95, 49.0])), abs=0.002)
    assert door["width_m"] == pytest.approx(18 * CELL_M, abs=0.002)
    assert west.attributes["open_sides"] == east.attributes["open_sides"] == []


def test_without_a_grid_the_doorway_is_the_gap_between_collinear_surfaces() -> None:
    _, rooms = two_rooms()
    west, east = shapes_of(None, rooms)
    assert west.attributes["area_m2"] == pytest.approx(16)
    (door,) = west.attributes["doorways"]
    assert east.attributes["doorways"] == [door]
    assert door == {"rooms": [0, 1], "position": [4.75, 2.45], "width_m": 0.9}


def test_a_gap_that_leads_to_a_wall_is_no_doorway() -> None:
    grid, (west, _) = two_rooms()
    blind = surfaces_of(grid, closed(100, 190, 10, 90))
    assert [room.attributes["doorways"] for room in shapes_of(None, [west, blind])] == [[], []]
    for cells in (OccupancyGrid.UNKNOWN, OccupancyGrid.OCCUPIED):
        grid.cells[:, 94:96] = cells
        assert [room.attributes["doorways"] for room in shapes_of(grid, [west, blind])] == [[], []]


def test_a_ring_corridor_has_a_hole_and_the_room_inside_is_its_own() -> None:
    grid = grid_of(200, 160, (10, 190, 10, 150))
    occupy(grid, (50, 150, 50, 110))
    grid.cells[60:100, 60:140] = OccupancyGrid.FREE
    outer = closed(10, 190, 10, 150)
    core = list(reversed(closed(50, 150, 50, 110)))
    ring, inner = shapes_of(
        grid, [surfaces_of(grid, outer, core), surfaces_of(grid, closed(60, 140, 60, 100))]
    )
    assert len(ring.holes) == 1
    assert ring.attributes["area_m2"] == pytest.approx((180 * 140 - 100 * 60) * CELL_M**2, abs=0.01)
    assert inner.attributes["area_m2"] == pytest.approx(80 * 40 * CELL_M**2, abs=0.01)
    assert ring.centre is not None
    assert polygon_of(ring).contains(shapely.Point(ring.centre))


@pytest.mark.parametrize(("side", "holes"), [(48, 0), (50, 1)])
def test_furniture_is_filled_and_what_is_larger_is_a_hole(side: int, holes: int) -> None:
    grid = grid_of(140, 140, (10, 130, 10, 130))
    occupy(grid, (40, 40 + side, 40, 40 + side))  # 5.76 and 6.25 m2
    (room,) = shapes_of(grid, [surfaces_of(grid, closed(10, 130, 10, 130))])
    assert len(room.holes) == holes


def test_an_open_side_is_closed_between_its_ends() -> None:
    grid = grid_of(200, 100, (10, 190, 10, 90))
    alcove = surfaces_of(grid, [(90, 90), (10, 90), (10, 10), (90, 10)])
    (room,) = shapes_of(grid, [alcove])
    assert room.attributes["area_m2"] == pytest.approx(80 * 80 * CELL_M**2, rel=0.02)
    assert room.attributes["open_m"] == pytest.approx(80 * CELL_M, rel=0.05)
    assert room.attributes["doorways"] == []


def test_a_niche_belongs_to_its_room_and_a_hall_without_surfaces_to_nobody() -> None:
    niche, hall = (40, 60, 90, 98), (90, 190, 10, 90)
    grid = grid_of(200, 100, (10, 90, 10, 90), niche, hall)
    room = surfaces_of(grid, [(90, 90), (10, 90), (10, 10), (90, 10)])
    labels = label_cells([room], grid)
    assert (labels[90:98, 40:60] == 1).all()
    assert (labels[10:90, 110:190] == NOBODY).all()


def test_surfaces_that_face_no_free_cell_have_no_polygon() -> None:
    grid = grid_of(200, 100, (10, 90, 10, 90))
    (room,) = shapes_of(grid, [surfaces_of(grid, closed(120, 180, 10, 90))])
    assert room.polygon is None
    assert room.attributes == {}
    assert room.centre is not None


def ids_painted(nodes: list[ConceptNode], grid: OccupancyGrid) -> NDArray[np.int64]:
    """Return the id of the node painted on each cell, -1 for none."""
    cells = np.full(grid.cells.shape, -1, np.int64)
    paint(nodes, grid, [node.id for node in nodes], cells)
    return cells


# -- properties ------------------------------------------------------------------------------------


@st.composite
def floors(draw: st.DrawFn) -> tuple[OccupancyGrid, list[SurfaceArrays]]:
    """Return a row of rooms, some of whose surfaces are missing, moved or of a neighbour."""
    rng = np.random.default_rng(draw(st.integers(0, 10**6)))
    widths, wall = rng.integers(25, 70, rng.integers(2, 5)), int(rng.integers(1, 6))
    boxes, lines, left = [], [], 5
    for width in widths.tolist():
        top = int(rng.integers(40, 90))
        boxes.append((left, left + width, 5, top))
        lines.append(closed(left, left + width, 5, top))
        left += width + wall
    yaw = float(rng.uniform(-3, 3))
    grid = grid_of(left + 5, 100, *boxes, origin=(3.0, -2.0, yaw))
    for box_, next_box in pairwise(boxes):
        start = int(rng.integers(6, 30))
        grid.cells[start : start + 18, box_[1] : next_box[0]] = OccupancyGrid.FREE
    clutter = rng.random(grid.cells.shape) < rng.choice([0, 0.01])
    grid.cells[clutter] = OccupancyGrid.OCCUPIED
    rooms = []
    for line in lines:
        sides = [(np.array(s) + rng.normal(0, 1, (2, 2))).tolist() for s in pairwise(line)]
        stray = [[lines[0][0], lines[0][1]]] if rng.random() < 0.3 else []
        rooms.append(surfaces_of(grid, *sides[: rng.integers(2, 5)], *stray))
    return grid, rooms


@given(floors(), st.booleans())
@settings(deadline=None, max_examples=80)
def test_rooms_are_valid_and_do_not_overlap(
    floor: tuple[OccupancyGrid, list[SurfaceArrays]], known: bool
) -> None:
    grid, rooms = floor
    found = [polygon_of(room) for room in shapes_of(grid if known else None, rooms) if room.polygon]
    assert all(polygon.is_valid for polygon in found)
    for k, one in enumerate(found):
        for two in found[:k]:
            assert one.intersection(two).area < 1e-9


@given(floors())
@settings(deadline=None, max_examples=40)
def test_polygons_follow_the_cells_that_they_are_made_of(
    floor: tuple[OccupancyGrid, list[SurfaceArrays]],
) -> None:
    grid, rooms = floor
    labels = label_cells(rooms, grid)
    found = polygons(labels, len(rooms), grid)
    for label, polygon in enumerate(found, 1):
        cells = (labels == label).sum()
        assert (polygon is None) == (cells == 0)
        if polygon is not None:
            slack = polygon.length / CELL_M  # less than a cell all around
            assert abs(polygon.area / CELL_M**2 - cells) <= slack
    nodes = [
        ConceptNode(k, (), shape=NodeShape(polygon=tuple(p.exterior.coords)[:-1]))
        for k, p in enumerate(found)
        if p is not None and not p.interiors
    ]
    painted = ids_painted(nodes, grid)
    for node in nodes:
        differs = (painted == node.id) != (labels == node.id + 1)
        assert differs.sum() <= found[node.id].length / CELL_M


@given(st.integers(0, 10**6))
@settings(deadline=None, max_examples=40)
def test_painting_is_telling_for_each_cell_whether_its_middle_lies_inside(seed: int) -> None:
    rng = np.random.default_rng(seed)
    grid = grid_of(30, 20, origin=tuple(rng.uniform(-3, 3, 3)))
    corners = np.sort(rng.uniform(0, 2 * np.pi, 7))
    ring = np.stack([np.cos(corners), np.sin(corners)], axis=1) * rng.uniform(3, 14, (7, 1))
    middle = np.array([15, 10])
    polygon = shapely.Polygon(grid.to_world(middle + ring), [grid.to_world(middle + ring / 2)])
    assume(polygon.is_valid)  # else the hole reaches out of it
    rings = [tuple(ring.coords)[:-1] for ring in (polygon.exterior, *polygon.interiors)]
    node = ConceptNode(4, (), shape=NodeShape(polygon=rings[0], holes=tuple(rings[1:])))
    column, row = np.meshgrid(np.arange(30) + 0.5, np.arange(20) + 0.5)
    middles = grid.to_world(np.stack([column, row], axis=2).reshape(-1, 2))
    inside = shapely.contains_xy(polygon, *middles.T).reshape(20, 30)
    np.testing.assert_array_equal(ids_painted([node], grid), np.where(inside, 4, -1))


def test_of_overlapping_polygons_the_smaller_is_painted() -> None:
    grid = grid_of(20, 20)
    nodes = [
        ConceptNode(k, (), shape=NodeShape(polygon=((0, 0), (side, 0), (side, side), (0, side))))
        for k, side in enumerate((0.5, 1.0))
    ]
    assert np.unique(ids_painted(nodes, grid)[:10, :10]).tolist() == [0]
    np.testing.assert_array_equal(ids_painted(nodes, grid), ids_painted(nodes[::-1], grid))


# -- passages --------------------------------------------------------------------------------------


@pytest.mark.parametrize(("width_m", "apart"), [(1.5, 1.0), (0.5, 0.0)])
def test_a_doorway_separates_what_surfaces_face_if_it_is_narrow(
    width_m: float, apart: float
) -> None:
    grid, (west, east) = two_rooms()
    both = together(west, east)
    pairs = np.array([[1, 2], [1, 7], [6, 7]])
    occupy(grid, (50, 53, 50, 53))  # a table leg, which narrows nothing
    assert separated(both, pairs, grid, width_m).tolist() == [0.0, apart, 0.0]


def test_where_no_space_is_wide_nothing_is_known() -> None:
    grid = grid_of(200, 100, (10, 90, 10, 20), (100, 190, 10, 20))
    rooms = surfaces_of(grid, [(10, 10), (90, 10)], [(100, 10), (190, 10)])
    assert separated(rooms, np.array([[0, 1]]), grid, 1.5).tolist() == [0.0]


# -- what is handed on -----------------------------------------------------------------------------


def inferred(origin: tuple[float, float, float] = (0, 0, 0)) -> SGraph:
    grid, rooms = two_rooms(origin)
    graph = SGraph("floor")
    graph.grid = grid
    graph.concepts["room"] = [
        ConceptNode(3 + 4 * k, (1, 2, 3), name, shape=found)
        for k, (name, found) in enumerate(
            zip(("kitchen: 'big'", None), shapes_of(grid, rooms), strict=True)
        )
    ]
    return graph


def test_a_labelled_image_gives_the_rooms_back(tmp_path: Path) -> None:
    graph = inferred((5.0, -7.25, 0.3))
    save_label_image(graph, tmp_path / "rooms.png")
    with Image.open(tmp_path / "rooms.png") as image:
        assert image.mode == "I;16"
        labels = np.asarray(image)[::-1].astype(np.int64)
    assert graph.grid is not None
    np.testing.assert_array_equal(labels, ids_painted(graph.concepts["room"], graph.grid) + 1)
    assert np.unique(labels).tolist() == [0, 4, 8]
    description = yaml.safe_load((tmp_path / "rooms.yaml").read_text())
    rooms = description.pop("rooms")
    assert [(room["label"], room["id"], room["name"]) for room in rooms] == [
        (4, 3, "kitchen: 'big'"),
        (8, 7, None),
    ]
    for room in rooms:
        counted = (labels == room["label"]).sum() * CELL_M**2
        assert room["area_m2"] == pytest.approx(counted, rel=0.01)
    with pytest.warns(MapWarning):  # it is no map of what is free
        placed = read_grid(tmp_path / "rooms.yaml")
    assert placed.resolution == graph.grid.resolution
    assert placed.origin.tolist() == graph.grid.origin.tolist()


def test_a_labelled_image_needs_a_grid_rooms_and_small_ids(tmp_path: Path) -> None:
    for change, message in (
        ({"grid": None}, "this map has none"),
        ({"concepts": {}}, "there are no rooms to paint"),
        ({"concepts": {"room": [ConceptNode(65535, (1, 2, 3))]}}, "room 65535 does not fit"),
    ):
        graph = inferred()
        for name, value in change.items():
            setattr(graph, name, value)
        with pytest.raises(InputError, match=message):
            save_label_image(graph, tmp_path / "rooms.png")
        assert list(tmp_path.iterdir()) == []


def test_the_adjacency_joins_rooms_by_their_doorways() -> None:
    graph = inferred()
    doors = [{"rooms": [3, 7], "position": [4.75, 2.45], "width_m": 0.9}]
    for room in graph.concepts["room"]:
        room.shape.attributes["doorways"][:] = doors
    result = adjacency(graph)
    assert sorted(result.nodes) == [3, 7]
    assert result.nodes[3]["name"] == "kitchen: 'big'"
    assert result.nodes[3]["area_m2"] == pytest.approx(16.2, abs=0.1)
    assert list(result.edges(data="doorways")) == [
        (3, 7, [{"position": (4.75, 2.45), "width_m": 0.9}])
    ]
    graph.concepts["room"] = graph.concepts["room"][:1]
    with pytest.raises(InputError, match="room 3 has a doorway to 7, which is not there"):
        adjacency(graph)
    with pytest.raises(InputError, match="holds no rooms"):
        adjacency(SGraph())


# -- the classic -----------------------------------------------------------------------------------


def test_the_watershed_parts_rooms_at_their_doorway_and_fills_furniture() -> None:
    pytest.importorskip("skimage")
    grid, _ = two_rooms()
    occupy(grid, (40, 50, 40, 50))  # 0.25 m2
    labels = watershed_rooms(grid)
    assert sorted(np.unique(labels)) == [-1, 0, 1]
    for room in (WEST, EAST):
        left, right, bottom, top = room
        assert len(np.unique(labels[bottom:top, left:right])) == 1
    assert labels[50, 20] != labels[50, 120]
    assert (labels[:10] == -1).all()


def test_without_scikit_image_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "skimage.morphology", None)
    with pytest.raises(MissingExtraError, match=r"sgraph-concepts\[classic\]"):
        watershed_rooms(two_rooms()[0])


# -- clusters --------------------------------------------------------------------------------------


@pytest.mark.parametrize(("known", "count"), [(False, 1), (True, 2)])
def test_a_narrow_passage_is_evidence_against_one_room(known: bool, count: int) -> None:
    grid, (west, east) = two_rooms()
    total = len(west) + len(east)
    surfaces = together(west, east)
    pairs = np.stack(np.triu_indices(total, k=1), axis=1)
    within = (pairs < len(west)).sum(axis=1) != 1
    edges = ScoredEdges(pairs, np.where(within, 2.0, 1.0))
    nothing = np.zeros(len(pairs))
    scene = Scene(
        surfaces, np.zeros(2), pairs, nothing, nothing[:, None], grid=grid if known else None
    )
    assert len(cluster(edges, scene)) == count


@pytest.mark.parametrize(
    ("side", "against", "count"),
    [(20, -1.0, 1), (20, -3.0, 2), (10, -3.0, 1), (40, -1.0, 2)],
    ids=["a thing in the room", "a closet", "nothing", "a room"],
)
def test_what_covers_little_space_joins_the_room_it_likely_belongs_to(
    side: int, against: float, count: int
) -> None:
    grid = grid_of(140, 140, (10, 130, 10, 130))
    walls = surfaces_of(grid, closed(10, 130, 10, 130))
    surfaces = together(walls, surfaces_of(grid, closed(60, 60 + side, 60, 60 + side)))
    pairs = np.stack(np.triu_indices(8, k=1), axis=1)
    within = (pairs < len(walls)).sum(axis=1) != 1
    scene = Scene(surfaces, np.zeros(2), pairs, np.zeros(28), np.zeros((28, 1)), grid=grid)
    edges = ScoredEdges(pairs, np.where(within, 2.0, against))
    assert len(cluster(edges, scene)) == count
