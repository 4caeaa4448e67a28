"""The outlines of labelled cells, as polygons that do not overlap."""

from __future__ import annotations

from typing import cast

import numpy as np
import shapely
from contourpy import FillType, contour_generator

from sgraph_concepts.types import FloatArray, IntArray, OccupancyGrid
from sgraph_core.grid.regions import Labels, Mask, windows

__all__ = ["polygons"]

STRAIGHT_CELLS = 1.5
"""Corners are dropped whose triangle with their neighbours is smaller than this side squared."""

_Filled = tuple[list[FloatArray], list[IntArray]]
"""Of FillType.OuterOffset: points of each polygon, and where in them its rings begin."""


def polygons(labels: Labels, count: int, grid: OccupancyGrid) -> list[shapely.Polygon | None]:
    """Return the outline of each label's cells, holes included.

    A border that two labels share is the same line for both, also after it is simplified.

    Args:
        labels: 0 to count - 1, or ``NOBODY``, [H, W]; the cells of each connected by their sides.
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
    return [by_label.get(label) for label in range(count)]


def _outline(cells: Mask, corner: tuple[int, int]) -> shapely.Polygon:
    """Return the outline of connected cells, in cells, its corners cut by half a cell."""
    generator = contour_generator(z=np.pad(cells, 1).astype(float), fill_type=FillType.OuterOffset)
    points, offsets = cast(_Filled, generator.filled(0.5, np.inf))
    parts = [
        shapely.Polygon(rings[0], rings[1:])
        for xy, starts in zip(points, offsets, strict=True)
        for rings in [np.split(xy - 0.5 + corner, starts[1:-1])]
    ]
    return max(parts, key=lambda part: part.area)
