"""Polygons and segments as cells of a grid. Coordinates are (column, row), in cells."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from sgraph_concepts.types import FloatArray, IntArray

__all__ = ["cells_along", "covered", "filled", "flat_cells", "spread"]

STEP = 0.3
"""Of the points that stand for a segment, in cells."""


def filled(
    polygons: Sequence[BaseGeometry], values: IntArray, shape: tuple[int, int]
) -> NDArray[np.int32]:
    """Return for each cell the value of the polygon that its centre lies in, 0 for none, [H, W].

    Along each row, a polygon's value is added where its outline enters and taken away where it
    leaves. Polygons may have holes and must not overlap.
    """
    height, width = shape
    rings, polygon = shapely.get_rings(shapely.orient_polygons(polygons), return_index=True)
    corners, ring = shapely.get_coordinates(rings, return_index=True)
    same = ring[:-1] == ring[1:]
    start, end = corners[:-1][same], corners[1:][same]
    weight = np.asarray(values, np.int32)[polygon[ring[:-1][same]]]
    # the rows whose centres lie between the ends of an edge: low <= row + 0.5 < high
    low, high = np.minimum(start[:, 1], end[:, 1]), np.maximum(start[:, 1], end[:, 1])
    first = np.clip(np.ceil(low - 0.5), 0, height).astype(np.int64)
    last = np.clip(np.ceil(high - 0.5), 0, height).astype(np.int64)
    edge, row = spread(first, last - first)
    share = (row + 0.5 - start[edge, 1]) / (end[edge, 1] - start[edge, 1])
    x = start[edge, 0] + share * (end[edge, 0] - start[edge, 0])
    column = np.clip(np.ceil(x - 0.5), 0, width).astype(np.int64)
    downwards = np.sign(start[edge, 1] - end[edge, 1]).astype(np.int32)
    changes = np.zeros((height, width + 1), np.int32)
    np.add.at(changes, (row, column), downwards * weight[edge])
    return np.asarray(np.cumsum(changes, axis=1, dtype=np.int32)[:, :-1])


def covered(polygons: Sequence[BaseGeometry], shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Return which cells' centres lie in any of some polygons, which may overlap, [H, W]."""
    union = [p for p in shapely.get_parts(shapely.union_all(polygons)) if p.geom_type == "Polygon"]
    if not union:
        return np.zeros(shape, bool)
    return filled(union, np.ones(len(union), np.int64), shape) > 0


def cells_along(segments: FloatArray, shape: tuple[int, int]) -> IntArray:
    """Return the flat indices of the cells that segments [S, 2, 2] run through; repeated."""
    along = segments[:, 1] - segments[:, 0]
    counts = np.ceil(np.linalg.norm(along, axis=1) / STEP).astype(np.int64) + 1
    segment, step = spread(np.zeros(len(segments), np.int64), counts)
    shares = step / np.maximum(counts - 1, 1)[segment]
    points = segments[segment, 0] + shares[:, None] * along[segment]
    return flat_cells(points, shape)[1]


def spread(starts: IntArray, counts: IntArray) -> tuple[IntArray, IntArray]:
    """Return for each of several runs of numbers, start to start + count, its index and them."""
    run = np.repeat(np.arange(len(counts)), counts)
    number = np.arange(len(run)) - np.repeat(np.cumsum(counts) - counts, counts)
    return run, starts[run] + number


def flat_cells(points: FloatArray, shape: tuple[int, int]) -> tuple[NDArray[np.bool_], IntArray]:
    """Return which points [P, 2] lie on the grid, and the flat indices of those points' cells."""
    height, width = shape
    column, row = np.floor(points).astype(np.int64).T
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    return inside, row[inside] * width + column[inside]
