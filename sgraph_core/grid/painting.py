"""Polygons painted on the cells of a grid."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sgraph_concepts.types import ConceptNode, FloatArray, OccupancyGrid

__all__ = ["paint"]

Cells = NDArray[np.integer[Any]]


def paint(
    nodes: Sequence[ConceptNode], grid: OccupancyGrid, values: Sequence[int], cells: Cells
) -> None:
    """Set the cells whose middles lie in the polygon of a node to the node's value.

    Where polygons overlap, the smaller one wins. Nodes without a polygon are left out.

    Args:
        nodes: nodes with different ids.
        grid: where the cells lie.
        values: one for each node.
        cells: what is painted on, [H, W].
    """
    rings = {
        node.id: [grid.to_cells(np.array(ring)) for ring in (node.shape.polygon, *node.shape.holes)]
        for node in nodes
        if node.shape.polygon is not None
    }
    value = {node.id: value for node, value in zip(nodes, values, strict=True)}
    area = {node: sum(_area(ring) for ring in found) for node, found in rings.items()}
    for node in sorted(rings, key=lambda node: (-abs(area[node]), node)):
        _paint(cells, rings[node], value[node])


def _area(ring: FloatArray) -> float:
    x, y = (ring - ring[0]).T
    return float(np.abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2)


def _paint(painted: Cells, rings: Sequence[FloatArray], value: int) -> None:
    """Paint what rings enclose, by the even-odd rule: what lies in a hole is not painted."""
    height, width = painted.shape
    points = np.concatenate(rings)
    low = np.clip(np.floor(points.min(axis=0)), 0, (width, height)).astype(np.int64)
    high = np.clip(np.ceil(points.max(axis=0)), 0, (width, height)).astype(np.int64)
    columns, rows = high - low
    if columns == 0 or rows == 0:
        return
    inside = np.zeros((rows, columns + 1), bool)
    for ring in rings:
        for first, second in zip(
            ring - low - 0.5, np.roll(ring, -1, axis=0) - low - 0.5, strict=True
        ):
            bottom, top = sorted((first[1], second[1]))
            row = np.arange(max(np.ceil(bottom), 0), min(np.ceil(top), rows)).astype(np.int64)
            x = first[0] + (row - first[1]) / (second[1] - first[1]) * (second[0] - first[0])
            # an edge crosses a row once, so no cell occurs twice
            inside[row, np.clip(np.ceil(x), 0, columns).astype(np.int64)] ^= True
    np.logical_xor.accumulate(inside, axis=1, out=inside)
    painted[low[1] : high[1], low[0] : high[0]][inside[:, :-1]] = value
