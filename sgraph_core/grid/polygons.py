"""The outlines of labelled cells, as polygons that do not overlap."""

from __future__ import annotations

import numpy as np
import shapely

from sgraph_concepts.types import OccupancyGrid
from sgraph_core.grid.outlines import enclosed_area, outlines
from sgraph_core.grid.regions import Labels, Mask, windows

__all__ = ["polygons"]

STRAIGHT_CELLS = 1.5
"""Corners are dropped whose triangle with their neighbours is smaller than this side squared."""


def polygons(labels: Labels, count: int, grid: OccupancyGrid) -> list[shapely.Polygon | None]:
    """Return the outline of each label's cells, holes included.

    A border that two labels share is the same line for both, also after it is simplified.

    Args:
        labels: 1 to ``count``, or ``NOBODY``, [H, W]; the cells of each connected by their sides.
        count: how many labels there are.
        grid: where the cells lie.

    Returns:
        A valid polygon in the grid's world for each label, None where it has no cells.
    """
    found: dict[int, shapely.Polygon] = {}
    for label, window in windows(labels, count):
        corner = (window[1].start, window[0].start)
        found[label] = _outline(labels[window] == label, corner)
    if not found:
        return [None] * count
    simple = shapely.coverage_simplify(np.array(list(found.values())), STRAIGHT_CELLS)
    placed = shapely.transform(simple, grid.to_world)
    by_label = dict(zip(found, placed, strict=True))
    return [by_label.get(label) for label in range(1, count + 1)]


def _outline(cells: Mask, corner: tuple[int, int]) -> shapely.Polygon:
    """Return the outline of connected cells, in cells, its corners cut by half a cell."""
    rings = [ring - 1 + corner for ring in outlines(np.pad(cells, 1))]
    outer = min(range(len(rings)), key=lambda ring: enclosed_area(rings[ring]))
    return shapely.Polygon(rings[outer], rings[:outer] + rings[outer + 1 :])
