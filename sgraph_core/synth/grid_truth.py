"""What is true of surfaces that were extracted from a synthetic building's grid."""

from __future__ import annotations

import numpy as np
import shapely

from sgraph_concepts.types import BuildingTruth, FloatArray, IntArray, SurfaceArrays
from sgraph_core.geometry import dot, lines_of, points_of
from sgraph_core.synth.pieces import NO_ROOM, Pieces
from sgraph_core.synth.walls import wall_gaps

__all__ = ["pieces_of", "surface_truth"]

SAME_WAY = np.cos(np.radians(30.0))
NEAR_M = 0.15
"""A surface lies on a true piece when it is no farther from it."""
POINTS = (np.arange(9) + 0.5) / 9
"""Where along a surface it is asked what it lies on, as shares of its length."""
IN_FRONT_M = 0.1
"""What lies on no wall belongs to the room that its middle has so far in front."""
NOTHING = -1


def surface_truth(
    surfaces: SurfaceArrays, pieces: Pieces, polygons: list[FloatArray]
) -> BuildingTruth:
    """Return the rooms of surfaces and which of them are the sides of a wall.

    Surfaces belong to the room of the wall that they lie on. Others, such as furniture and the
    borders of what is known, belong to the room that they face: whoever draws a room into a robot's
    grid draws it around them. Outside of rooms, and in doorways, surfaces belong to none. Two are a
    wall where they lie back to back as the true sides of walls do and both lie on walls.

    Args:
        surfaces: N surfaces.
        pieces: what they may lie on.
        polygons: outlines of the rooms.
    """
    own = pieces_of(surfaces, pieces)
    structural = (own != NOTHING) & pieces.structural[own]
    rooms = np.where(structural, pieces.rooms[own], _faced(surfaces, polygons))
    gaps = wall_gaps(surfaces.segments, surfaces.normals)
    sides = np.stack([gaps.one, gaps.two], axis=1)
    return BuildingTruth(surfaces, rooms, polygons, sides[structural[sides].all(axis=1)])


def _faced(surfaces: SurfaceArrays, polygons: list[FloatArray]) -> IntArray:
    """Return the room that lies in front of each surface's middle, -1 for none, [N].

    The outline of a corridor that runs around rooms encloses theirs, so the smallest counts.
    """
    in_front = points_of(surfaces.midpoints + IN_FRONT_M * surfaces.normals)
    rooms = np.full(len(surfaces), NO_ROOM)
    outlines = [shapely.Polygon(corners) for corners in polygons]
    row, room = shapely.STRtree(outlines).query(in_front, predicate="within")
    shrinking = np.argsort(-shapely.area(outlines)[room], kind="stable")
    rooms[row[shrinking]] = room[shrinking]  # of several values for a row, the last one stays
    return rooms


def pieces_of(surfaces: SurfaceArrays, pieces: Pieces) -> IntArray:
    """Return the piece that each surface lies on, -1 for none, [N].

    Nine points of a surface each lie on the nearest piece that faces the same way, within 30
    degrees and 15 cm. The surface lies on a piece of the room (or of no room) of most of its
    points, if those are more than half: on the one with the most of them.
    """
    start, along = surfaces.segments[:, 0], surfaces.segments[:, 1] - surfaces.segments[:, 0]
    points = points_of((start[:, None] + POINTS[:, None] * along[:, None]).reshape(-1, 2))
    lines = lines_of(pieces.segments)
    point, piece = shapely.STRtree(lines).query(points, predicate="dwithin", distance=NEAR_M)
    same_way = dot(surfaces.normals[point // len(POINTS)], pieces.normals[piece]) > SAME_WAY
    point, piece = point[same_way], piece[same_way]
    order = np.lexsort((piece, shapely.distance(points[point], lines[piece]), point))
    point, nearest = np.unique(point[order], return_index=True)
    lies_on = np.full((len(surfaces), len(POINTS)), NOTHING)
    lies_on.flat[point] = piece[order][nearest]
    return np.array([_most(row, pieces) for row in lies_on], np.int64)


def _most(lies_on: IntArray, pieces: Pieces) -> int:
    """Return the piece that stands for what most of a surface's points lie on."""
    known = lies_on[lies_on != NOTHING]
    rooms, counts = np.unique(pieces.rooms[known], return_counts=True)
    if not len(rooms) or 2 * counts.max() <= len(lies_on):
        return NOTHING
    own, counts = np.unique(
        known[pieces.rooms[known] == rooms[np.argmax(counts)]], return_counts=True
    )
    return int(own[np.argmax(counts)])
