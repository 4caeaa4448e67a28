"""Large grids are worked on in strips, which leave no trace and bound the memory."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable

import numpy as np
import pytest
from floors import closed, grid_of, occupy, surfaces_of

from sgraph_concepts.types import OccupancyGrid, SurfaceArrays
from sgraph_core.grid.passages import separated
from sgraph_core.grid.polygons import polygons
from sgraph_core.grid.regions import label_cells
from sgraph_core.grid.strips import count_labels, has_label, strips


def ring(side: int) -> tuple[OccupancyGrid, list[SurfaceArrays]]:
    """Return a ring corridor around a room, with niches and a door that nobody's surfaces cover."""
    low, high = side // 4, side - side // 4
    grid = grid_of(side, side, (5, side - 5, 5, side - 5), (side - 5, side - 2, 20, 40))
    occupy(grid, (low, high, low, high))
    grid.cells[low + 5 : high - 5, low + 5 : high - 5] = OccupancyGrid.FREE
    grid.cells[low + 20 : low + 38, low : low + 5] = OccupancyGrid.FREE
    core = list(reversed(closed(low, high, low, high)))
    return grid, [
        surfaces_of(grid, closed(5, side - 5, 5, side - 5), core),
        surfaces_of(grid, closed(low + 5, high - 5, low + 5, high - 5)),
    ]


def test_rooms_found_in_strips_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    grid, rooms = ring(200)
    pairs = np.array([[0, 1], [0, 4], [4, 7]])

    def found() -> tuple[object, ...]:
        labels = label_cells(rooms, grid)
        return labels.tolist(), separated(rooms[0], pairs, grid, 1.5).tolist()

    whole = found()
    monkeypatch.setattr("sgraph_core.grid.strips.STRIP_CELLS", 1)
    assert len(list(strips(grid.cells.shape))) > 10
    assert found() == whole


def test_outlines_of_rooms_found_in_strips_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    grid, rooms = ring(200)
    labels = label_cells(rooms, grid)
    whole = polygons(labels, 2, grid)
    monkeypatch.setattr("sgraph_core.grid.strips.STRIP_CELLS", 1)
    for one, other in zip(whole, polygons(labels, 2, grid), strict=True):
        assert one is not None
        assert other is not None
        assert one.symmetric_difference(other).area < 1e-9
    assert whole[0] is not None
    assert len(whole[0].interiors) == 1


def test_margins_are_cut_off_at_the_border(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sgraph_core.grid.strips.STRIP_CELLS", 1)
    assert list(strips((40, 9), 3)) == [
        (slice(0, 24), slice(0, 27)),
        (slice(24, 40), slice(21, 40)),
    ]
    assert list(strips((5, 0))) == []


def test_labels_are_counted_and_chosen_in_strips(monkeypatch: pytest.MonkeyPatch) -> None:
    labels = np.random.default_rng(0).integers(0, 5, (100, 7)).astype(np.uint8)
    monkeypatch.setattr("sgraph_core.grid.strips.STRIP_CELLS", 1)
    assert count_labels(labels, 6).tolist() == [*np.bincount(labels.ravel()).tolist(), 0, 0]
    wanted = np.array([False, True, False, True, False])
    np.testing.assert_array_equal(has_label(labels, wanted), np.isin(labels, [1, 3]))


@pytest.mark.parametrize(("step", "most_bytes"), [("rooms", 8), ("passages", 6)])
def test_memory_beside_the_grid_is_bounded_by_its_cells(step: str, most_bytes: int) -> None:
    grid, rooms = ring(3000)
    pairs = np.array([[0, 4]])
    steps: dict[str, Callable[[], object]] = {
        "rooms": lambda: polygons(label_cells(rooms, grid), 2, grid),
        "passages": lambda: separated(rooms[0], pairs, grid, 1.5),
    }
    tracemalloc.start()
    try:
        steps[step]()
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < most_bytes * grid.cells.size + 40e6
