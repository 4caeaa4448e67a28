"""Small floor plans, drawn as the rooms' outlines, and the S-Graphs they give."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sgraph_core.graph import SGraph, TrueRoom, Truth

Point = tuple[float, float]


def rectangle(x: float, y: float, width: float, height: float) -> list[Point]:
    return [(x, y), (x + width, y), (x + width, y + height), (x, y + height)]


def regular(sides: int, radius: float) -> list[Point]:
    angles = 2 * np.pi * (np.arange(sides) + 0.5) / sides
    return [(radius * float(np.cos(a)), radius * float(np.sin(a))) for a in angles]


L_SHAPE: list[Point] = [(0, 0), (8, 0), (8, 3), (4, 3), (4, 7), (0, 7)]


def turned(points: Sequence[Point], angle_rad: float) -> list[Point]:
    cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
    return [(float(cosine * x - sine * y), float(sine * x + cosine * y)) for x, y in points]


def plan(
    *rooms: Sequence[Point],
    walls: Sequence[tuple[int, int]] = (),
    angle_rad: float = 0.0,
    offset: Point = (0.0, 0.0),
    first_id: int = 0,
) -> SGraph:
    """Return the S-Graph of rooms given by outlines (counter-clockwise), with its truth.

    Surfaces are numbered room by room, edge by edge; ``walls`` counts them from 0.
    """
    graph = SGraph("plan")
    true_rooms = []
    surface = first_id
    for number, outline in enumerate(rooms):
        corners = np.array(turned(outline, angle_rad)) + offset
        members = []
        for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            along = (end - start) / np.linalg.norm(end - start)
            graph.add_wall_surface(surface, [start, end], [-along[1], along[0]])
            members.append(surface)
            surface += 1
        polygon = tuple((float(x), float(y)) for x, y in corners)
        true_rooms.append(TrueRoom(number, None, tuple(members), polygon))
    true_walls = tuple((one + first_id, two + first_id) for one, two in walls)
    graph.truth = Truth(tuple(true_rooms), true_walls)
    return graph


def add_outline(graph: SGraph, outline: Sequence[Point], first_id: int) -> None:
    """Add the edges of an outline to a graph, normals to the left: clockwise for a facade."""
    for number, (start, end) in enumerate(zip(outline, [*outline[1:], outline[0]], strict=True)):
        along = np.subtract(end, start) / np.linalg.norm(np.subtract(end, start))
        graph.add_wall_surface(first_id + number, [start, end], [-along[1], along[0]])


def block(wall_m: float, angle_rad: float = 0.0, offset: Point = (0.0, 0.0)) -> SGraph:
    """Return a 2 x 2 block of 5 x 4 m rooms. Edges of a room: south, east, north, west."""
    width, height = 5.0, 4.0
    rooms = [
        rectangle(i * (width + wall_m), j * (height + wall_m), width, height)
        for j in (0, 1)
        for i in (0, 1)
    ]
    walls = [(1, 7), (9, 15), (2, 8), (6, 12)]
    return plan(*rooms, walls=walls, angle_rad=angle_rad, offset=offset)


def members(graph: SGraph, concept: str) -> set[frozenset[int]]:
    """Return the nodes of a concept as sets of members."""
    return {frozenset(node.members) for node in graph.concepts[concept]}


def true_rooms(graph: SGraph) -> set[frozenset[int]]:
    assert graph.truth is not None
    return {frozenset(room.members) for room in graph.truth.rooms}


def true_walls(graph: SGraph) -> set[frozenset[int]]:
    assert graph.truth is not None
    return {frozenset(wall) for wall in graph.truth.walls}


def two_rooms_on_one_surface() -> SGraph:
    """Return rooms {0, 1, 2, 3} and {0, 4, 5, 6}: surface 0 runs along the south of both."""
    graph = SGraph("two rooms")
    rows = [
        ([[0, 0], [10.1, 0]], [0, 1]),
        ([[5, 0], [5, 4]], [-1, 0]),
        ([[5, 4], [0, 4]], [0, -1]),
        ([[0, 4], [0, 0]], [1, 0]),
        ([[10.1, 0], [10.1, 4]], [-1, 0]),
        ([[10.1, 4], [5.1, 4]], [0, -1]),
        ([[5.1, 4], [5.1, 0]], [1, 0]),
    ]
    for number, (segment, normal) in enumerate(rows):
        graph.add_wall_surface(number, segment, normal)
    return graph
