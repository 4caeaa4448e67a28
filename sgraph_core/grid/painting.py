"""Polygons painted on the cells of a grid."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sgraph_concepts.types import ConceptNode, FloatArray, OccupancyGrid

__all__ = ["paint"]


def paint(nodes: Sequence[ConceptNode], grid: OccupancyGrid) -> NDArray[np.int64]:
    """Return the id of the node in whose polygon the middle of each cell lies, -1 for none, [H, W].

    Where polygons overlap, the smaller one wins. Nodes without a polygon are left out.
    """
    painted = np.full(grid.cells.shape, -1, np.int64)
    rings = {
        node.id: [grid.to_cells(np.array(ring)) for ring in (node.shape.polygon, *node.shape.holes)]
        for node in nodes
        if node.shape.polygon is not None
    }
    area = {node: sum(_area(ring) for ring in found) for node, found in rings.items()}
    for node in sorted(rings, key=lambda node: (-abs(area[node]), node)):
        _paint(painted, rings[node], node)
    return painted


def _area(ring: FloatArray) -> float:
    x, y = (ring - ring[0]).T
    return float(np.abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2)


def _paint(painted: NDArray[np.int64], rings: Sequence[FloatArray], value: int) -> None:
    """Paint what rings enclose, by the even-odd rule: what lies in a hole is not painted."""
    height, width = painted.shape
    points = np.concatenate(rings)
    low = np.clip(np.floor(points.min(axis=0)), 0, (width, height)).astype(np.int64)
    high = np.clip(np.ceil(points.max(axis=0)), 0, (width, height)).astype(np.int64)
    columns, rows = high - low
    if columns == 0 or rows == 0:
        return
    crossed = np.zeros((rows, columns + 1), np.int64)
    for ring in rings:
        for first, second in zip(
            ring - low - 0.5, np.roll(ring, -1, axis=0) - low - 0.5, strict=True
        ):
            bottom, top = sorted((first[1], second[1]))
            row = np.arange(max(np.ceil(bottom), 0), min(np.ceil(top), rows)).astype(np.int64)
            x = first[0] + (row - first[1]) / (second[1] - first[1]) * (second[0] - first[0])
            np.add.at(crossed, (row, np.clip(np.ceil(x), 0, columns).astype(np.int64)), 1)
    inside = np.cumsum(crossed, axis=1)[:, :-1] % 2 == 1
    painted[low[1] : high[1], low[0] : high[0]][inside] = value
