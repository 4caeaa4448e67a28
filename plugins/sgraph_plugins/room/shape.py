"""Centres, outlines and doorways of rooms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import shapely

from sgraph_concepts.types import (
    FloatArray,
    IntArray,
    NodeShape,
    OccupancyGrid,
    Scene,
    SurfaceArrays,
)
from sgraph_core.doorways import doorways_between, doorways_on_shared_borders
from sgraph_core.grid.polygons import polygons
from sgraph_core.grid.regions import label_cells
from sgraph_core.openings import Opening, openings
from sgraph_plugins.room.outline import outlines

__all__ = ["shape"]

CELLS_BEYOND = 1.5
"""How far beyond a border cells are looked at: past those that it passes through."""


def shape(members: Mapping[int, IntArray], scene: Scene) -> dict[int, NodeShape]:
    """Return centre, polygon, holes and doorways of the rooms that members enclose.

    No two polygons overlap. With a grid, a room's polygon follows its free cells; without one it
    follows the members and is straight over what is open between them, such as doors. It is absent
    when the members enclose nothing.

    Attributes: ``area_m2``; ``doorways``, the openings to other rooms, each with both ``rooms``,
    its ``position`` and its ``width_m``; ``open_sides``, the parts of the border that no member
    covers and that are wider than a door, in the world; ``open_m``, their length.
    """
    rooms = {room: scene.surfaces.take(rows) for room, rows in members.items()}
    if scene.grid is None:
        found = outlines(rooms, scene.memory)
        open_ = {
            room: scene.memory.recall(
                ("openings", polygon, rooms[room].content), partial(openings, polygon, rooms[room])
            )
            for room, polygon in found.items()
        }
        doorways = doorways_between(open_)
    else:
        found = _of_free_cells(rooms, scene.grid)
        open_ = {
            room: _into_free_cells(openings(polygon, rooms[room]), scene.grid)
            for room, polygon in found.items()
        }
        doorways = doorways_on_shared_borders(found, scene.grid.resolution)
    return {
        room: NodeShape(centre=_point(surfaces.midpoints.mean(axis=0)))
        if room not in found
        else NodeShape(
            centre=_centre(found[room]),
            polygon=_ring(found[room].exterior),
            holes=tuple(_ring(hole) for hole in found[room].interiors),
            attributes={
                "area_m2": round(found[room].area, 3),
                "doorways": [
                    door.attributes(scene.origin) for door in doorways if room in door.rooms
                ],
                **_open_sides(open_[room], scene.origin),
            },
        )
        for room, surfaces in rooms.items()
    }


def _of_free_cells(
    rooms: Mapping[int, SurfaceArrays], grid: OccupancyGrid
) -> dict[int, shapely.Polygon]:
    labels = label_cells(list(rooms.values()), grid)
    found = zip(rooms, polygons(labels, len(rooms), grid), strict=True)
    return {room: polygon for room, polygon in found if polygon is not None}


def _into_free_cells(found: Sequence[Opening], grid: OccupancyGrid) -> list[Opening]:
    """Return the openings, or what is left of them, beyond which half of the cells are free."""
    left = [
        Opening(
            opening.kind, opening.segments[[_is_free_beyond(s, grid) for s in opening.segments]]
        )
        for opening in found
    ]
    return [opening for opening in left if len(opening.segments)]


def _is_free_beyond(segment: FloatArray, grid: OccupancyGrid) -> bool:
    first, second = grid.to_cells(segment)
    along = (second - first) / np.linalg.norm(second - first)
    steps = np.linspace(0, 1, 20)[:, None] * (second - first)
    points = np.floor(first + steps + CELLS_BEYOND * np.array([-along[1], along[0]])).astype(int)
    column, row = points[((points >= 0) & (points < grid.cells.shape[::-1])).all(axis=1)].T
    return bool((grid.cells[row, column] == OccupancyGrid.FREE).sum() > len(steps) / 2)


def _open_sides(found: Sequence[Opening], origin: FloatArray) -> dict[str, Any]:
    sides = [opening for opening in found if opening.kind == "open side"]
    return {
        "open_sides": [piece.tolist() for side in sides for piece in side.segments + origin],
        "open_m": round(sum((float(side.lengths_m.sum()) for side in sides), 0.0), 3),
    }


def _centre(polygon: shapely.Polygon) -> tuple[float, float]:
    centre = polygon.centroid
    if not polygon.contains(centre):
        centre = polygon.representative_point()
    return centre.x, centre.y


def _ring(ring: shapely.LinearRing) -> tuple[tuple[float, float], ...]:
    points = shapely.get_coordinates(ring)[:-1]
    if not ring.is_ccw:
        points = points[::-1]
    return tuple(_point(point) for point in points)


def _point(xy: FloatArray) -> tuple[float, float]:
    return float(xy[0]), float(xy[1])
