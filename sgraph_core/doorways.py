"""Openings between two rooms."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

from sgraph_concepts.types import FloatArray
from sgraph_core.geometry import cross, dot, lines_of
from sgraph_core.openings import SHORTEST_M, THICKEST_WALL_M, Opening

__all__ = ["Doorway", "doorways_between", "doorways_on_shared_borders"]

OPPOSITE_RAD = np.radians(20.0)
"""Two openings are the two sides of a doorway if they face one another within this angle."""
OVERLAP_M = 0.05
"""The openings of a doorway may overlap by this much, as rooms that share a border do."""


@dataclass(frozen=True)
class Doorway:
    """An opening between two rooms.

    Attributes:
        rooms: what the two are called, the lower first.
        position: the middle of the gap, x and y.
        width_m: width of the gap.
    """

    rooms: tuple[int, int]
    position: tuple[float, float]
    width_m: float

    def attributes(self, origin: FloatArray) -> dict[str, Any]:
        """Return the doorway as JSON values, moved by an origin, to the millimetre."""
        x, y = (round(float(value), 3) for value in np.add(self.position, origin))
        return {
            "rooms": list(self.rooms),
            "position": [x, y],
            "width_m": round(self.width_m, 3),
        }


def doorways_between(rooms: Mapping[int, Sequence[Opening]]) -> list[Doorway]:
    """Return where openings of two rooms lie opposite one another, a wall's thickness apart.

    Unseen corners are no doorways: nothing says that they are open.

    Args:
        rooms: openings in the borders of rooms that do not overlap.
    """
    pieces = [
        (room, piece)
        for room, found in rooms.items()
        for opening in found
        if opening.kind != "corner"
        for piece in opening.segments
    ]
    if not pieces:
        return []
    lines = lines_of(np.stack([piece for _, piece in pieces]))
    one, two = shapely.STRtree(lines).query(lines, predicate="dwithin", distance=THICKEST_WALL_M)
    found = []
    for k, m in zip(one.tolist(), two.tolist(), strict=True):
        (room, piece), (other, opposite) = pieces[k], pieces[m]
        if room < other:
            middle, width = _passage(piece, opposite)
            if width >= SHORTEST_M:
                found.append(Doorway((room, other), middle, width))
    return _ordered(found)


def _passage(piece: FloatArray, opposite: FloatArray) -> tuple[tuple[float, float], float]:
    """Return the middle and the width of what two sides of a doorway leave open; 0 if nothing."""
    along = (piece[1] - piece[0]) / np.linalg.norm(piece[1] - piece[0])
    other = (opposite[1] - opposite[0]) / np.linalg.norm(opposite[1] - opposite[0])
    reach = dot(opposite - piece[0], along)
    start, end = max(0.0, reach.min()), min(dot(piece[1] - piece[0], along), reach.max())
    away = cross(along, opposite.mean(axis=0) - piece[0])  # the inside is on the right
    x, y = piece[0] + (start + end) / 2 * along + away / 2 * np.array([-along[1], along[0]])
    faces = dot(along, other) < -np.cos(OPPOSITE_RAD) and away > -OVERLAP_M
    return (float(x), float(y)), float(end - start) if faces else 0.0


def doorways_on_shared_borders(
    rooms: Mapping[int, shapely.Polygon], cell_m: float
) -> list[Doorway]:
    """Return the doorways of rooms that follow free cells: where two share a border.

    Args:
        rooms: polygons with equal vertices on shared borders.
        cell_m: side of a cell. Outlines cut the corners of cells: a shared border ends half a
            cell before each wall.
    """
    names = list(rooms)
    borders = np.array([polygon.boundary for polygon in rooms.values()], object)
    one, two = shapely.STRtree(borders).query(borders, predicate="intersects")
    found = []
    for k, m in zip(one.tolist(), two.tolist(), strict=True):
        if names[k] < names[m]:
            shared = shapely.line_merge(shapely.intersection(borders[k], borders[m]))
            for part in shapely.get_parts(shared):
                first, last = shapely.get_coordinates(part)[[0, -1]]
                width = float(np.linalg.norm(last - first)) + cell_m
                if width >= SHORTEST_M:
                    x, y = ((first + last) / 2).tolist()
                    found.append(Doorway((names[k], names[m]), (x, y), width))
    return _ordered(found)


def _ordered(found: Iterable[Doorway]) -> list[Doorway]:
    return sorted(found, key=lambda door: (door.rooms, door.position))
