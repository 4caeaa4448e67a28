"""A floor as data, and what follows from it: free space, panels to cast rays at, truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from sgraph_concepts.errors import InputError
from sgraph_concepts.types import BuildingTruth, FloatArray, SurfaceArrays
from sgraph_core.frontend.lidar import Panels
from sgraph_core.geometry import turn_left
from sgraph_core.synth.pieces import NO_ROOM
from sgraph_core.synth.polygons import all_edges, polygons_in
from sgraph_core.synth.walls import wall_gaps

__all__ = ["Door", "Floor", "Furniture", "Point"]

Point = tuple[float, float]

THICKEST_WALL_M = 0.6
INTO_ROOM_M = 0.02
"""A doorway reaches this far into both rooms, so that they join."""


@dataclass(frozen=True)
class Door:
    """An open door between two rooms, in the wall at a point."""

    one: str
    two: str
    at: Point
    width_m: float = 0.9


@dataclass(frozen=True)
class Furniture:
    """A box that stands on the floor: two opposite corners and a height."""

    west_south: Point
    east_north: Point
    height_m: float


@dataclass(frozen=True)
class Floor:
    """A floor plan as data.

    Attributes:
        name: of the scene.
        rooms: corners of each room's free space by the room's name. The walls are what lies
            between rooms, so their thickness is the distance of the rooms.
        doors: they stand open.
        tour: the rooms that a robot visits one after another.
        furniture: hides what is behind it as high as it is.
        ceiling_m, door_height_m: above the floor.
    """

    name: str
    rooms: Mapping[str, tuple[Point, ...]]
    doors: tuple[Door, ...]
    tour: tuple[str, ...]
    furniture: tuple[Furniture, ...] = ()
    ceiling_m: float = 2.6
    door_height_m: float = 2.1

    @cached_property
    def polygons(self) -> dict[str, Polygon]:
        """The rooms' free space, corners counter-clockwise."""
        return {name: shapely.orient_polygons(Polygon(ring)) for name, ring in self.rooms.items()}

    @cached_property
    def free(self) -> BaseGeometry:
        """Where a robot may be: rooms and doorways without furniture."""
        boxes = [shapely.box(*f.west_south, *f.east_north) for f in self.furniture]
        return self._open.difference(shapely.union_all(boxes))

    @cached_property
    def _open(self) -> BaseGeometry:
        doorways = [self._doorway(door, INTO_ROOM_M) for door in self.doors]
        return shapely.union_all([*self.polygons.values(), *map(Polygon, doorways)])

    def _doorway(self, door: Door, margin_m: float) -> FloatArray:
        """Return the corners of a doorway: both on the first room's side, then both on the other's.

        Raises:
            InputError: there is no wall between the two rooms at the door.
        """
        at = shapely.Point(door.at)
        faces = [
            shapely.get_coordinates(shapely.shortest_line(self.polygons[room].exterior, at))[0]
            for room in (door.one, door.two)
        ]
        through = faces[1] - faces[0]
        thickness = float(np.linalg.norm(through))
        if not 0 < thickness <= THICKEST_WALL_M:
            raise InputError(
                f"{self.name}: a door from {door.one} to {door.two} at {door.at}: "
                f"must be in a wall of at most {THICKEST_WALL_M:g} m between them"
            )
        through /= thickness
        half = turn_left(through) * door.width_m / 2
        one, two = faces[0] - margin_m * through, faces[1] + margin_m * through
        return np.array([one + half, one - half, two - half, two + half])

    def panels(self) -> Panels:
        """Return all that a lidar can hit: walls, lintels over doors, furniture."""
        walls, _, _ = all_edges(polygons_in(self._open))
        lintels = [
            ends
            for door in self.doors
            for corners in [self._doorway(door, 0.0)]
            for ends in (corners[1::-1], corners[:1:-1])
        ]
        sides = [_sides(furniture) for furniture in self.furniture]
        heights = [
            *([(0.0, self.ceiling_m)] * len(walls)),
            *([(self.door_height_m, self.ceiling_m)] * len(lintels)),
            *((0.0, f.height_m) for f in self.furniture for _ in range(4)),
        ]
        segments = [walls, np.array(lintels).reshape(-1, 2, 2), *sides]
        return Panels(np.concatenate(segments), np.array(heights), self.ceiling_m)

    def truth(self) -> BuildingTruth:
        """Return the rooms' sides, as if doors were closed, and those of furniture (in no room)."""
        rooms = list(self.polygons.values())
        segments, normals, owners = all_edges(rooms)
        gaps = wall_gaps(segments, normals)
        clutter = np.concatenate([np.empty((0, 2, 2)), *map(_sides, self.furniture)])
        along = clutter[:, 1] - clutter[:, 0]
        outwards = turn_left(along / np.linalg.norm(along, axis=1)[:, None])
        segments = np.concatenate([segments, clutter])
        surfaces = SurfaceArrays(
            np.arange(len(segments)), segments[:, ::-1], np.concatenate([normals, outwards])
        )
        owners = np.append(owners, np.full(len(clutter), NO_ROOM))
        outlines = [shapely.get_coordinates(room.exterior)[:-1] for room in rooms]
        walls = np.unique(np.stack([gaps.one, gaps.two], axis=1), axis=0)
        return BuildingTruth(surfaces, owners, outlines, walls)

    def stops(self) -> list[Point]:
        """Return the points of the tour: of each room the one that is farthest from all walls."""
        places = {}
        for name, polygon in self.polygons.items():
            parts = polygons_in(polygon.intersection(self.free))
            largest = max(parts, key=lambda part: part.area)
            circle = shapely.maximum_inscribed_circle(largest, 0.05)
            places[name] = shapely.get_coordinates(circle)[0]
        return [(float(places[room][0]), float(places[room][1])) for room in self.tour]


def _sides(furniture: Furniture) -> FloatArray:
    """Return the sides of furniture, the space around it to their left, [4, 2, 2]."""
    (west, south), (east, north) = furniture.west_south, furniture.east_north
    corners = np.array([(west, south), (west, north), (east, north), (east, south)])
    return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
