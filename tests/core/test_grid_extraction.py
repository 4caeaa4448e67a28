"""Wall surfaces from occupancy grids: hand-made grids with exact truth, and invariances."""

from __future__ import annotations

import numpy as np
import pytest

from sgraph_concepts.types import OccupancyGrid, SurfaceArrays
from sgraph_core.grid.extraction import extract, extract_surfaces

FREE, OCCUPIED, UNKNOWN = OccupancyGrid.FREE, OccupancyGrid.OCCUPIED, OccupancyGrid.UNKNOWN


def painted(resolution: float, size_m: tuple[float, float], *boxes: tuple[float, ...]):
    """Unknown cells, and boxes x0, y0, x1, y1 (metres), value painted on them in turn."""
    width, height = (round(side / resolution) for side in size_m)
    cells = np.full((height, width), UNKNOWN, np.uint8)
    for *box, value in boxes:
        x0, y0, x1, y1 = (round(side / resolution) for side in box)
        cells[y0:y1, x0:x1] = value
    return OccupancyGrid(cells, resolution, np.zeros(3))


def facing(surfaces: SurfaceArrays, x: float, y: float) -> np.ndarray:
    """The segments whose normal is (x, y), within a degree."""
    return surfaces.segments[surfaces.normals @ [x, y] > np.cos(np.radians(1))]


@pytest.mark.parametrize("resolution", [0.02, 0.05, 0.1])
def test_a_room_has_a_surface_on_each_side_that_faces_it(resolution):
    grid = painted(resolution, (6, 5), (0.9, 0.9, 5.1, 4.1, OCCUPIED), (1, 1, 5, 4, FREE))
    surfaces = extract_surfaces(grid)
    assert len(surfaces) == 4
    for normal, ends in {
        (0, 1): [[5, 1], [1, 1]],
        (0, -1): [[1, 4], [5, 4]],
        (1, 0): [[1, 1], [1, 4]],
        (-1, 0): [[5, 4], [5, 1]],
    }.items():
        (segment,) = facing(surfaces, *normal)
        np.testing.assert_allclose(segment, ends, atol=1e-6)


@pytest.mark.parametrize("value", [FREE, OCCUPIED, UNKNOWN])
@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (40, 1), (50, 60)])
@pytest.mark.filterwarnings("error")
def test_a_grid_of_one_kind_of_cells_has_no_surfaces(value, shape):
    grid = OccupancyGrid(np.full(shape, value, np.uint8), 0.05, np.zeros(3))
    graph = extract(grid, "empty")
    assert len(graph.wall_surfaces.ids) == 0
    assert graph.grid is grid
