import numpy as np
import pytest

from sgraph_concepts.types import SurfaceArrays
from sgraph_core.grid.support import collinear_support


def surfaces(*rows: tuple[float, float, float, float]) -> SurfaceArrays:
    """Surfaces from x0, y0 to x1, y1, which face to the right of that way."""
    segments = np.array(rows).reshape(-1, 2, 2)
    along = segments[:, 1] - segments[:, 0]
    along /= np.linalg.norm(along, axis=1)[:, None]
    normals = np.stack([along[:, 1], -along[:, 0]], axis=1)
    return SurfaceArrays(np.arange(len(rows)), segments, normals)


WALL = (0.0, 0.0, 4.0, 0.0)


def test_walls_in_line_support_one_another_and_themselves():
    np.testing.assert_allclose(collinear_support(surfaces(WALL, (6, 0, 9, 0))), [7, 7])


@pytest.mark.parametrize(
    "other",
    [
        pytest.param((9, 0, 6, 0), id="it faces the other way"),
        pytest.param((6, 0.3, 9, 0.3), id="it stands in front"),
        pytest.param((6, 0, 6, 3), id="it runs across"),
        pytest.param((40, 0, 43, 0), id="it is far off"),
    ],
)
def test_other_surfaces_do_not_support(other):
    np.testing.assert_allclose(collinear_support(surfaces(WALL, other)), [4, 3])


def test_the_longer_surface_says_where_the_line_runs():
    # the short one's own line passes the wall's midpoint a metre off
    np.testing.assert_allclose(
        collinear_support(surfaces(WALL, (8, 0, 8.2, 0.03)))[0], 4.2, atol=0.01
    )


def test_support_moves_with_the_map():
    rng = np.random.default_rng(3)
    starts = rng.integers(0, 12, (60, 2)).astype(float)
    some = surfaces(*np.hstack([starts, starts + np.array([2, 0])]).tolist())
    assert collinear_support(some).max() > 4
    turn = np.array([[0.8, 0.6], [-0.6, 0.8]])
    moved = SurfaceArrays(some.ids, some.segments @ turn + [1e3, -50], some.normals @ turn)
    np.testing.assert_allclose(collinear_support(moved), collinear_support(some))


def test_no_surfaces_have_no_support():
    assert len(collinear_support(surfaces())) == 0
