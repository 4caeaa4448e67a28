import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from sgraph_concepts.types import OccupancyGrid

FREE = np.zeros((2, 3), np.uint8)


def test_a_point_of_a_turned_grid_stands_where_its_axes_say():
    grid = OccupancyGrid(FREE, 0.5, np.array([10.0, 20.0, np.pi / 2]))
    # 2 columns along the grid's x axis (the world's y), 1 row along its y axis (the world's -x)
    np.testing.assert_allclose(grid.to_world(np.array([2.0, 1.0])), [9.5, 21.0])


@given(
    st.floats(0.01, 1.0),
    st.tuples(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.floats(-4, 4)),
    st.tuples(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3)),
)
def test_to_cells_is_the_inverse_of_to_world(resolution, origin, point):
    grid = OccupancyGrid(FREE, resolution, np.array(origin))
    np.testing.assert_allclose(grid.to_cells(grid.to_world(np.array([point]))), [point], atol=1e-6)


def test_a_shifted_grid_moves_with_its_points():
    grid = OccupancyGrid(FREE, 0.5, np.array([10.0, 20.0, 0.3]))
    by = np.array([-3.0, 7.0])
    point = np.array([1.0, 1.0])
    np.testing.assert_allclose(grid.shifted(by).to_world(point), grid.to_world(point) + by)
