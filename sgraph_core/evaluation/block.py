"""How long it takes to solve a large map, with the concepts' factors and without."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from sgraph_concepts.types import ConceptNode, FloatArray, NodeShape
from sgraph_core.backend import optimize
from sgraph_core.graph import SGraph

__all__ = ["SolveTimes", "block_of_rooms", "time_optimization"]

ROOM_M = (5.0, 4.0)
WALL_M = 0.15
ODOMETRY_SIGMAS = np.array([1e-3, 1e-3, 2e-4, 1e-3, 1e-3, 1e-3])
PLANE_SIGMAS = np.array([2e-3, 0.02])
STOPS = ((-1.0, 0.0), (1.0, 0.0))
"""Where a room's keyframes are, from its middle."""


@dataclass(frozen=True)
class SolveTimes:
    """Seconds and iterations of Levenberg-Marquardt to solve a block of rooms.

    Attributes:
        rooms: of the block.
        planes: seconds with the low layers only.
        concepts: seconds with the factors of all rooms and walls.
        plane_iterations, concept_iterations: of both.
    """

    rooms: int
    planes: float
    concepts: float
    plane_iterations: int
    concept_iterations: int


def time_optimization(sizes: Sequence[int], repeats: int, seed: int) -> Iterator[SolveTimes]:
    """Time batch optimisation of blocks of rooms; the least of repeated runs counts."""
    for rooms in sizes:
        graph = block_of_rooms(rooms, np.random.default_rng(seed))
        plain = dict.fromkeys(graph.concepts, "none")
        runs = [(_timed(graph, plain), _timed(graph, None)) for _ in range(repeats)]
        planes, concepts = (min(each) for each in zip(*runs, strict=True))
        yield SolveTimes(rooms, planes[0], concepts[0], planes[1], concepts[1])


def _timed(graph: SGraph, factor_types: Mapping[str, str] | None) -> tuple[float, int]:
    """Return seconds and iterations of one optimisation."""
    start = time.perf_counter()
    solved = optimize(graph, factor_types)
    return time.perf_counter() - start, solved.iterations


def block_of_rooms(count: int, rng: Generator) -> SGraph:
    """Return the map of a drive through a block of rooms, row by row.

    Every room has two keyframes and four surfaces; rooms and walls are the true ones.
    """
    columns = math.ceil(math.sqrt(count))
    cells = [
        (row, column if row % 2 == 0 else columns - 1 - column)
        for row in range(math.ceil(count / columns))
        for column in range(columns)
    ][:count]
    graph = SGraph(f"{count} rooms")
    drive = _Drive(graph, rng)
    pitch = np.array(ROOM_M) + WALL_M
    for number, (row, column) in enumerate(cells):
        drive.visit(number, pitch * (column, row))
    _add_nodes(graph, cells)
    return graph


class _Drive:
    """A robot that drifts, and maps the room it is in."""

    def __init__(self, graph: SGraph, rng: Generator) -> None:
        self._graph, self._rng = graph, rng
        self._true = self._believed = np.zeros(3)

    def visit(self, room: int, corner: FloatArray) -> None:
        for stop in STOPS:
            true = np.array([*(corner + np.array(ROOM_M) / 2 + stop), 0.0])
            self._move(true)
            self._observe(room, corner)

    def _move(self, true: FloatArray) -> None:
        number = len(self._graph.keyframes.ids)
        motion = true - self._true
        if number:
            motion = motion + self._rng.normal(0, ODOMETRY_SIGMAS[[3, 4, 2]])
            self._believed = _composed(self._believed, motion)
        else:
            self._believed = true
        self._true = true
        self._graph.add_keyframe(number, _row(self._believed), float(number))
        if number:
            self._graph.add_odometry(number - 1, number, _row(motion), ODOMETRY_SIGMAS)

    def _observe(self, room: int, corner: FloatArray) -> None:
        keyframe, table = len(self._graph.keyframes.ids) - 1, self._graph.wall_surfaces
        width, depth = ROOM_M
        corners = corner + np.array([(0, 0), (width, 0), (width, depth), (0, depth)])
        for side, (start, end) in enumerate(zip(corners, np.roll(corners, -1, 0), strict=True)):
            along = (end - start) / np.linalg.norm(end - start)
            normal = np.array([-along[1], along[0]])
            angle, offset = self._rng.normal(0, PLANE_SIGMAS)
            heading = float(np.arctan2(normal[1], normal[0])) + angle
            distance = float(normal @ (self._true[:2] - start)) + offset
            surface = 4 * room + side
            if surface not in table.ids:
                ends = [
                    _composed(self._believed, [*(p - self._true[:2]), 0])[:2] for p in (start, end)
                ]
                turn = self._believed[2]
                seen = (
                    np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ normal
                )
                self._graph.add_wall_surface(surface, ends, seen)
            self._graph.observe(
                surface, keyframe, [np.cos(heading), np.sin(heading), 0, distance], PLANE_SIGMAS
            )


def _composed(pose: FloatArray, motion: FloatArray | Sequence[float]) -> FloatArray:
    cosine, sine = np.cos(pose[2]), np.sin(pose[2])
    x, y, turn = motion
    return np.asarray(pose + np.array([cosine * x - sine * y, sine * x + cosine * y, turn]))


def _row(pose: FloatArray) -> list[float]:
    x, y, yaw = pose.tolist()
    return [x, y, 0, 0, 0, math.sin(yaw / 2), math.cos(yaw / 2)]


def _add_nodes(graph: SGraph, cells: Sequence[tuple[int, int]]) -> None:
    number = {cell: room for room, cell in enumerate(cells)}
    segments = graph.wall_surfaces.segments
    rooms: list[ConceptNode] = []
    walls: list[ConceptNode] = []
    for (row, column), room in number.items():
        members = tuple(range(4 * room, 4 * room + 4))
        corners = segments[list(members), 0]
        rooms.append(
            ConceptNode(
                room,
                members,
                shape=NodeShape(tuple(corners.mean(axis=0)), tuple(map(tuple, corners.tolist()))),
                confidence=1.0,
            )
        )
        for other, side, facing in ((row, column + 1), 1, 3), ((row + 1, column), 2, 0):
            if other in number:
                pair = (4 * room + side, 4 * number[other] + facing)
                middle = segments[list(pair)].mean(axis=(0, 1))
                walls.append(
                    ConceptNode(
                        len(walls),
                        pair,
                        shape=NodeShape(tuple(middle), thickness=WALL_M),
                        confidence=1.0,
                    )
                )
    graph.concepts = {"room": rooms, "wall": walls}
