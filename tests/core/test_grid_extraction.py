"""Wall surfaces from occupancy grids: hand-made grids with exact truth, and invariances."""

from __future__ import annotations

import json
import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from PIL import Image

from sgraph_concepts.types import OccupancyGrid, SurfaceArrays
from sgraph_core.evaluation.grid_surfaces import score_surfaces, true_surfaces
from sgraph_core.grid.extraction import extract, extract_surfaces
from sgraph_core.grid.reader import read_grid
from sgraph_core.grid.settings import SurfaceSettings

FREE, OCCUPIED, UNKNOWN = OccupancyGrid.FREE, OccupancyGrid.OCCUPIED, OccupancyGrid.UNKNOWN
DOCS = Path(__file__).parent.parent.parent / "docs"
RESOLUTIONS = [0.02, 0.05, 0.1]


def painted(resolution: float, size_m: tuple[float, float], *shapes) -> OccupancyGrid:
    """Unknown cells, and pairs of a shapely geometry or a box and a value painted on them in turn.

    A cell is painted if its centre lies inside.
    """
    width, height = (round(side / resolution) for side in size_m)
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    cells = np.full((height, width), UNKNOWN, np.uint8)
    for shape, value in shapes:
        area = shapely.box(*shape) if isinstance(shape, tuple) else shape
        cells[shapely.contains_xy(area, x * resolution, y * resolution)] = value
    return OccupancyGrid(cells, resolution, np.zeros(3))


def sides(area: shapely.Polygon) -> SurfaceArrays:
    """The true surfaces of a free polygon: its sides, normals inwards."""
    ring = shapely.get_coordinates(shapely.orient_polygons(area, exterior_cw=True).exterior)
    segments = np.stack([ring[:-1], ring[1:]], axis=1)
    along = segments[:, 1] - segments[:, 0]
    along /= np.linalg.norm(along, axis=1)[:, None]
    normals = np.stack([along[:, 1], -along[:, 0]], axis=1)
    return SurfaceArrays(np.arange(len(segments)), segments, normals)


def around(obstacle: shapely.Polygon) -> SurfaceArrays:
    """The true surfaces of something that stands in free space."""
    inwards = sides(obstacle)
    return SurfaceArrays(inwards.ids, inwards.segments[:, ::-1], -inwards.normals)


def together(*several: SurfaceArrays) -> SurfaceArrays:
    segments = np.concatenate([surfaces.segments for surfaces in several])
    normals = np.concatenate([surfaces.normals for surfaces in several])
    return SurfaceArrays(np.arange(len(segments)), segments, normals)


def assert_same(
    found: SurfaceArrays, true: SurfaceArrays, within_m: float, degrees: float = 2.5
) -> None:
    """As many surfaces, each with its ends and normal."""
    assert len(found) == len(true)
    for segment, normal in zip(true.segments, true.normals, strict=True):
        apart = np.abs(found.segments - segment).max(axis=(1, 2))
        best = int(np.argmin(apart))
        assert apart[best] <= within_m, (segment, found.segments[best])
        assert found.normals[best] @ normal > np.cos(np.radians(degrees))


@pytest.mark.parametrize("resolution", RESOLUTIONS)
def test_a_room_has_a_surface_on_each_side_that_faces_it(resolution):
    room = shapely.box(1, 1, 5, 4)
    grid = painted(resolution, (6, 5), ((0.9, 0.9, 5.1, 4.1), OCCUPIED), (room, FREE))
    assert_same(extract_surfaces(grid), sides(room), 1e-6)


@pytest.mark.parametrize("resolution", RESOLUTIONS)
@pytest.mark.parametrize("degrees", [0, 3, 10, 27, 45, 60, 88])
def test_a_turned_room_is_found_within_a_fraction_of_a_cell(resolution, degrees):
    room = shapely.affinity.rotate(shapely.box(2, 2, 6, 5), degrees)
    grid = painted(resolution, (8, 7), (room.buffer(0.15), OCCUPIED), (room, FREE))
    found = extract_surfaces(grid)
    assert_same(found, sides(room), resolution)
    for segment, normal in zip(sides(room).segments, sides(room).normals, strict=True):
        same = found.segments[found.normals @ normal > 0.9]
        offsets = (same.mean(axis=1) - segment[0]) @ normal
        assert np.abs(offsets).max() < 0.35 * resolution


def test_a_corner_may_be_re_entrant():
    room = shapely.Polygon([(1, 1), (6, 1), (6, 3), (3, 3), (3, 5), (1, 5)])
    grid = painted(0.05, (7, 6), (room.buffer(0.1), OCCUPIED), (room, FREE))
    assert_same(extract_surfaces(grid), sides(room), 1e-6)


@pytest.mark.parametrize("degrees", [0, 20, 45, 70])
def test_a_wall_of_one_cell_has_two_sides(degrees):
    wall = shapely.affinity.rotate(shapely.box(2, 3, 6, 3.05), degrees, origin=(4, 3))
    room = shapely.box(0.5, 0.5, 7.5, 6)
    # every cell that the wall touches: on a slant these hang together by their corners
    grid = painted(0.05, (8, 6.5), (room, FREE), (wall.buffer(0.012), OCCUPIED))
    inner = extract_surfaces(grid)
    along = sides(room)
    of_wall = inner.take(np.abs(inner.segments - [4, 3.025]).max(axis=(1, 2)) < 2.2)
    score = score_surfaces(of_wall, around(wall))
    assert len(inner) == len(along) + 2
    assert score.recall > 0.97
    assert score.precision == pytest.approx(1)


@pytest.mark.parametrize("resolution", RESOLUTIONS)
def test_walls_of_neighbouring_rooms_do_not_fuse(resolution):
    one, two = shapely.box(1, 1, 4, 4), shapely.box(4.1, 1, 8, 4)
    both = one | two
    grid = painted(resolution, (9, 5), (both.envelope.buffer(0.1), OCCUPIED), (both, FREE))
    assert_same(extract_surfaces(grid), together(sides(one), sides(two)), 1e-6)


@pytest.mark.parametrize("resolution", RESOLUTIONS)
def test_there_is_no_surface_across_a_doorway(resolution):
    one, two = shapely.box(1, 1, 4, 4), shapely.box(4.2, 1, 8, 4)
    door = shapely.box(3.9, 2, 4.3, 2.9)
    free = shapely.union_all([one, two, door])
    grid = painted(resolution, (9, 5), (free.envelope.buffer(0.2), OCCUPIED), (free, FREE))
    # the jambs are two cells wide at the coarsest resolution: not enough for a direction
    assert_same(extract_surfaces(grid), sides(free), 0.5 * resolution, degrees=20)


@pytest.mark.parametrize("resolution", RESOLUTIONS)
@pytest.mark.parametrize("length", [0.4, 0.3])
def test_a_wall_broken_into_short_pieces_is_one_surface_on_each_side(length, resolution):
    room = shapely.box(0.5, 0.5, 7.5, 5.5)
    pieces = [(x, 3, x + length, 3.1) for x in np.arange(1, 6.5, 0.5)]
    grid = painted(resolution, (8, 6), (room, FREE), *((piece, OCCUPIED) for piece in pieces))
    wall = shapely.box(1, 3, 6 + length, 3.1)
    found = extract_surfaces(grid)
    long = found.take(found.lengths > 1)
    true = together(sides(room), around(wall))
    assert_same(long, true.take(true.lengths > 1), 0.1)


@pytest.mark.parametrize("resolution", RESOLUTIONS)
def test_a_column_has_four_surfaces_and_legs_of_a_chair_none(resolution):
    room, column = shapely.box(0.5, 0.5, 7.5, 5.5), shapely.box(3, 3, 3.8, 3.8)
    legs = [(x, y, x + 0.1, y + 0.1) for x in (5.1, 5.5) for y in (2.1, 2.5)]
    grid = painted(
        resolution, (8, 6), (room, FREE), (column, OCCUPIED), *((leg, OCCUPIED) for leg in legs)
    )
    assert_same(extract_surfaces(grid), together(sides(room), around(column)), 1e-6)


def test_a_wall_needs_no_occupied_cells():
    room = shapely.box(1, 1, 5, 4)
    assert_same(extract_surfaces(painted(0.05, (6, 5), (room, FREE))), sides(room), 1e-6)


@pytest.mark.parametrize("thickness", [0.05, 0.1, 0.3])
def test_the_sides_of_a_wall_are_as_far_apart_as_it_is_thick(thickness):
    rooms = [shapely.box(1, 1, 4, 4), shapely.box(4 + thickness, 1, 8, 4)]
    found = extract_surfaces(painted(0.05, (9, 5), *((room, FREE) for room in rooms)))
    left = found.take((found.normals[:, 0] < -0.99) & (found.midpoints[:, 0] < 6))
    right = found.take((found.normals[:, 0] > 0.99) & (found.midpoints[:, 0] > 3))
    assert right.midpoints[0, 0] - left.midpoints[0, 0] == pytest.approx(thickness)


@pytest.mark.parametrize("resolution", RESOLUTIONS)
def test_rays_through_a_window_leave_the_wall_whole(resolution):
    room = shapely.box(1, 1, 5, 4)
    origin, ends = (3, 2.5), [(9, y) for y in (0.5, 1.5, 3.5, 4.5)]
    rays = [(shapely.LineString([origin, end]).buffer(0.5 * resolution), FREE) for end in ends]
    walls = (room.buffer(0.1, join_style="mitre"), OCCUPIED)
    found = extract_surfaces(painted(resolution, (10, 5), walls, *rays, (room, FREE)))
    assert_same(found, sides(room), resolution)


@pytest.mark.parametrize("value", [FREE, OCCUPIED, UNKNOWN])
@pytest.mark.parametrize("shape", [(0, 0), (0, 5), (5, 0), (1, 1), (1, 40), (40, 1), (50, 60)])
@pytest.mark.filterwarnings("error")
def test_a_grid_of_one_kind_of_cells_has_no_surfaces(value, shape):
    grid = OccupancyGrid(np.full(shape, value, np.uint8), 0.05, np.zeros(3))
    graph = extract(grid, "empty")
    assert len(graph.wall_surfaces.ids) == 0
    assert graph.grid is grid
    assert graph.name == "empty"


@given(
    arrays(np.uint8, st.tuples(st.integers(1, 40), st.integers(1, 40)), elements=st.integers(0, 2)),
    st.sampled_from([0.02, 0.1, 0.5, 3.0]),
)
@pytest.mark.filterwarnings("error")
def test_any_grid_gives_surfaces_that_an_s_graph_accepts(cells, resolution):
    grid = OccupancyGrid(cells, resolution, np.array([3e6, -2e6, 1.0]))
    table = extract(grid).wall_surfaces
    inside = grid.to_cells(table.segments)
    assert (inside > -5).all()
    assert (inside < np.array(cells.shape)[::-1] + 5).all()


def clutter(seed: int, resolution: float = 0.05) -> OccupancyGrid:
    """Rooms on a slant, with doors, things in them and noise: nothing is symmetric."""
    rng = np.random.default_rng(seed)
    rooms = [shapely.box(1, 1, 5, 4), shapely.box(5.2, 1, 9, 6), shapely.box(1, 4.1, 5, 7)]
    rooms += [shapely.box(4, 2, 6, 3.1), shapely.box(2.2, 3, 3.3, 5)]
    free = shapely.affinity.rotate(shapely.union_all(rooms), 7.0, origin=(5, 4))
    things = [shapely.Point(rng.uniform(1, 8, 2)).buffer(r) for r in rng.uniform(0.05, 0.6, 12)]
    grid = painted(resolution, (11, 9), (free, FREE), *((thing, UNKNOWN) for thing in things))
    noise = rng.random(grid.cells.shape) < 0.005
    return replace(grid, cells=np.where(noise, OCCUPIED, grid.cells).astype(np.uint8))


def in_order(segments: np.ndarray) -> np.ndarray:
    return segments[np.lexsort(np.round(segments.reshape(len(segments), 4), 6).T)]


@pytest.mark.parametrize("seed", range(4))
def test_surfaces_move_and_turn_with_the_origin(seed):
    grid = clutter(seed)
    still = extract_surfaces(grid)
    assert still.ids.tolist() == list(range(len(still)))
    moved = extract_surfaces(replace(grid, origin=np.array([100.0, -20.0, 0.7])))
    turn = np.array([[np.cos(0.7), np.sin(0.7)], [-np.sin(0.7), np.cos(0.7)]])
    np.testing.assert_allclose(moved.segments, still.segments @ turn + [100, -20], atol=1e-9)
    np.testing.assert_allclose(moved.normals, still.normals @ turn, atol=1e-9)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("mirror", ["left-right", "up-down", "transposed"])
def test_a_mirrored_grid_has_the_mirrored_surfaces(seed, mirror):
    grid = clutter(seed)
    height, width = np.array(grid.cells.shape) * grid.resolution
    cells, back = {
        "left-right": (grid.cells[:, ::-1], lambda points: points * [-1, 1] + [width, 0]),
        "up-down": (grid.cells[::-1], lambda points: points * [1, -1] + [0, height]),
        "transposed": (grid.cells.T, lambda points: points[..., ::-1]),
    }[mirror]
    mirrored = extract_surfaces(replace(grid, cells=cells))
    origin = back(np.zeros(2))
    # a mirror turns left into right, and so the first endpoint into the second
    seen_back = SurfaceArrays(
        mirrored.ids, back(mirrored.segments)[:, ::-1], back(mirrored.normals) - origin
    )
    expected = extract_surfaces(grid)
    score = score_surfaces(seen_back, expected)
    # of two corners of cells that are equally far from a chord, the first one cuts an outline
    assert score.recall > 0.98
    assert score.precision > 0.98
    long_back, long = (s.segments[s.lengths > 1] for s in (seen_back, expected))
    np.testing.assert_allclose(in_order(long_back), in_order(long), atol=0.1)


def test_the_resolution_does_not_matter():
    one, *others = [extract_surfaces(clutter(1, resolution)) for resolution in RESOLUTIONS]
    for other in others:
        score = score_surfaces(other, one)
        assert score.recall > 0.85
        assert score.precision > 0.9


def test_strips_leave_no_trace(monkeypatch):
    grid = clutter(2)
    whole = extract_surfaces(grid)
    monkeypatch.setattr("sgraph_core.grid.strips.STRIP_CELLS", 1)
    told = []
    parts = extract_surfaces(grid, progress=lambda *progress: told.append(progress))
    np.testing.assert_allclose(in_order(parts.segments), in_order(whole.segments), atol=1e-6)
    assert [done for _, done, _ in told] == sorted(done for _, done, _ in told)
    assert told[-1][1:] == (360, 360)
    assert len(told) > 20


def test_memory_beside_the_grid_is_bounded_by_its_cells():
    """One byte for each cell, what a strip needs, and little for the outlines."""
    rooms = [shapely.box(x, y, x + 9, y + 9) for x in range(1, 139, 10) for y in range(1, 139, 10)]
    cells = painted(0.5, (150, 150), (shapely.union_all(rooms), FREE)).cells
    grid = OccupancyGrid(np.kron(cells, np.ones((10, 10), np.uint8)), 0.05, np.zeros(3))
    assert grid.cells.shape == (3000, 3000)
    extract_surfaces(grid)  # imports and caches do not count
    tracemalloc.start()
    try:
        surfaces = extract_surfaces(grid)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert len(surfaces) == 4 * len(rooms)
    assert peak < grid.cells.size + 30e6


def listed(name: str) -> list[str]:
    lines = (DOCS / "splits" / f"{name}.txt").read_text(encoding="utf-8").splitlines()
    return [line for line in lines if line and not line.startswith("#")]


def kind_of(name: str) -> str:
    if name.startswith("robot-"):
        return "robot"
    return "furnished" if name.endswith("-furnished") else "plain"


@pytest.mark.parametrize(
    ("split", "kind", "recall", "precision"),
    [
        ("grids-selection", "plain", 0.98, 0.99),
        ("grids-selection", "furnished", 0.92, 0.88),
        ("grids-selection", "robot", 0.78, 0.8),
        ("grids-report", "plain", 0.96, 0.97),
        ("grids-report", "furnished", 0.85, 0.8),
    ],
)
def test_surfaces_of_labelled_grids(real_buildings, split, kind, recall, precision):
    scores = []
    for name in (name for name in listed(split) if kind_of(name) == kind):
        folder = real_buildings / "grids" / name
        grid = read_grid(folder / "map.yaml")
        labels = np.array(Image.open(folder / "rooms.png"))[::-1]
        scores.append(score_surfaces(extract_surfaces(grid), true_surfaces(grid, labels)))
    assert np.mean([score.recall for score in scores]) > recall
    assert np.mean([score.precision for score in scores]) > precision


def test_every_setting_is_documented_with_its_default():
    text = (DOCS / "grids.md").read_text(encoding="utf-8")
    for name, field in SurfaceSettings.model_fields.items():
        assert f"| `{name}` | {json.dumps(field.default)} | {field.description} |" in text
