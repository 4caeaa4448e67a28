"""The score of a grid's surfaces, on cases that can be worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from sgraph_concepts.errors import InputError
from sgraph_concepts.types import OccupancyGrid, SurfaceArrays
from sgraph_core.evaluation.grid_surfaces import score_surfaces, true_surfaces

FREE, UNKNOWN = OccupancyGrid.FREE, OccupancyGrid.UNKNOWN


def facing_up(*spans: tuple[float, float, float]) -> SurfaceArrays:
    """Surfaces along x from x0 to x1 at y."""
    segments = np.array([[[x1, y], [x0, y]] for x0, x1, y in spans]).reshape(-1, 2, 2)
    return SurfaceArrays(np.arange(len(spans)), segments, np.tile([0.0, 1.0], (len(spans), 1)))


def grid_of(labels: np.ndarray) -> OccupancyGrid:
    cells = np.where(labels > 0, FREE, UNKNOWN).astype(np.uint8)
    return OccupancyGrid(cells, 0.1, np.array([10.0, 20.0, 0.0]))


def two_rooms() -> np.ndarray:
    """Two rooms of 2 x 3 m and 3 x 3 m that touch in a doorway of 1 m through a wall of 0.2 m."""
    labels = np.zeros((50, 80), np.uint16)
    labels[10:40, 10:30] = 1
    labels[10:40, 32:62] = 2
    labels[20:30, 30:32] = 2
    return labels


def test_lengths_are_matched_within_10_cm_and_as_far_as_they_overlap():
    score = score_surfaces(
        facing_up((0, 4, 0.08), (6, 7, 0.0)), facing_up((0, 2, 0), (4, 6.5, 0.2))
    )
    assert score.found == 5
    assert score.true == 4.5
    assert score.found_matched == pytest.approx(2, abs=0.1)
    assert score.true_matched == pytest.approx(2, abs=0.1)
    assert score.precision == pytest.approx(0.4, abs=0.02)
    assert score.recall == pytest.approx(2 / 4.5, abs=0.02)


@pytest.mark.parametrize(("degrees", "recall"), [(29, 1), (31, 0), (180, 0)])
def test_normals_may_differ_by_30_degrees(degrees, recall):
    true = facing_up((0, 0.05, 0))
    angle = np.radians(degrees)
    normal = np.array([[-np.sin(angle), np.cos(angle)]])
    along = np.array([normal[0, 1], -normal[0, 0]])
    middle = true.midpoints[0]
    segment = np.stack([middle + 0.025 * along, middle - 0.025 * along])[None]
    assert score_surfaces(SurfaceArrays(true.ids, segment, normal), true).recall == recall


def test_scores_of_nothing_are_zero():
    nothing, something = facing_up(), facing_up((0, 1, 0))
    assert score_surfaces(nothing, something).precision == 0
    assert score_surfaces(nothing, something).recall == 0
    assert score_surfaces(something, nothing).precision == 0
    assert score_surfaces(nothing, nothing).recall == 0


def test_rooms_that_touch_have_no_surface_between_them():
    labels = two_rooms()
    true = true_surfaces(grid_of(labels), labels)
    # both rooms' sides, less the doorway on both sides, plus its two jambs
    assert true.lengths.sum() == pytest.approx(10 + 12 - 2 + 0.4, abs=0.6)
    np.testing.assert_allclose(true.segments.min(axis=(0, 1)), [11, 21], atol=0.06)
    np.testing.assert_allclose(true.segments.max(axis=(0, 1)), [16.2, 24], atol=0.06)


def test_there_is_no_surface_where_free_space_goes_on_without_label():
    labels = two_rooms()
    grid = grid_of(labels)
    true = true_surfaces(grid, np.where(labels == 2, 0, labels))
    doorway = (true.normals[:, 0] < -0.9) & (np.abs(true.midpoints[:, 1] - 22.5) < 0.4)
    assert not doorway.any()
    assert true.lengths.sum() == pytest.approx(10 - 1, abs=0.5)


def test_small_spots_without_label_and_small_labels_have_none():
    labels = two_rooms()
    whole = true_surfaces(grid_of(labels), labels).lengths.sum()
    spotted = labels.copy()
    spotted[15:19, 15:19] = 0  # 0.16 m2
    spotted[45:48, 70:79] = 3  # 0.27 m2
    grid = grid_of(spotted)
    assert true_surfaces(grid, spotted).lengths.sum() == pytest.approx(whole)
    spotted[12:18, 12:18] = 0  # a column
    assert true_surfaces(grid_of(spotted), spotted).lengths.sum() > whole + 2


def test_normals_point_into_the_room_and_steps_of_a_slant_are_straightened():
    row, column = np.mgrid[:80, :80]
    labels = ((column > 5) & (row > 5) & (3 * row + 4 * column < 300)).astype(np.uint16)
    true = true_surfaces(grid_of(labels), labels)
    slant = true.lengths.argmax()
    np.testing.assert_allclose(true.normals[slant], [-0.8, -0.6], atol=0.03)


def test_labels_must_have_the_shape_of_the_grid():
    labels = two_rooms()
    with pytest.raises(InputError, match=r"labels have shape \[50, 79\]: must be the grid's"):
        true_surfaces(grid_of(labels), labels[:, 1:])


def test_no_labels_have_no_surfaces():
    labels = two_rooms()
    assert len(true_surfaces(grid_of(labels), np.zeros_like(labels))) == 0
