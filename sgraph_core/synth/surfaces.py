"""From a plan to its wall surfaces: doors, facades, and the clutter that is mapped with them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from numpy.random import Generator
from numpy.typing import NDArray
from shapely import Polygon

from sgraph_concepts.types import FloatArray, IntArray
from sgraph_core.synth.config import FittingConfig
from sgraph_core.synth.plan import all_edges
from sgraph_core.synth.polygons import edges, grow, polygons_in, rectangle, turn_left
from sgraph_core.synth.walls import THICKEST_M, WallGaps, wall_gaps

__all__ = ["NO_ROOM", "Pieces", "draw_surfaces"]

NO_ROOM = -1
DOOR_FRAME_M = 0.05
"""Doors stay this far from the ends of a wall."""
SHORTEST_PIECE_M = 0.05


@dataclass(frozen=True, eq=False)
class Pieces:
    """P pieces of surfaces with what is true of them.

    Attributes:
        segments: [P, 2, 2].
        normals: [P, 2].
        rooms: index of the room each belongs to, NO_ROOM for none, [P].
        structural: whether a piece is a side of a wall, as opposed to clutter, [P].
    """

    segments: FloatArray
    normals: FloatArray
    rooms: IntArray
    structural: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.rooms)

    def take(self, rows: IntArray | NDArray[np.bool_]) -> Pieces:
        """Return the given rows, by index or mask."""
        return Pieces(
            self.segments[rows], self.normals[rows], self.rooms[rows], self.structural[rows]
        )

    def moved(self, segments: FloatArray) -> Pieces:
        """Return the pieces with other endpoints; normals stay."""
        return Pieces(segments, self.normals, self.rooms, self.structural)

    @staticmethod
    def joined(*parts: Pieces) -> Pieces:
        """Return the rows of all parts."""
        return Pieces(
            np.concatenate([part.segments for part in parts]),
            np.concatenate([part.normals for part in parts]),
            np.concatenate([part.rooms for part in parts]),
            np.concatenate([part.structural for part in parts]),
        )


def draw_surfaces(rooms: list[Polygon], rng: Generator, config: FittingConfig) -> Pieces:
    """Return the surfaces of a plan: the rooms' sides with doors cut out, facades, clutter."""
    segments, normals, owners = all_edges(rooms)
    walls = Pieces(segments, normals, owners.astype(np.int64), np.ones(len(owners), bool))
    if rng.random() < config.facade_share:
        walls = Pieces.joined(walls, _facades(rooms, rng.uniform(*config.facade_thickness_m)))
    gaps = wall_gaps(walls.segments, walls.normals)
    doors = _draw_doors(gaps, walls, rng, config)
    cuts = _door_cuts(walls, gaps, doors)
    broken = rng.choice(config.broken_behind_share)
    for row, cut in _junctions_behind(gaps, len(walls), rng, broken):
        cuts[row].append(cut)
    return Pieces.joined(
        _cut(walls, cuts),
        _door_leaves(doors, gaps, rng, rng.choice(config.door_leaf_share)),
        _furniture(rooms, rng, rng.choice(config.furnished_share), config),
    )


def _facades(rooms: list[Polygon], thickness_m: float) -> Pieces:
    """Return the outer faces of the building: its rooms grown by the outer walls."""
    grown = shapely.union_all([grow(room, thickness_m) for room in rooms])
    closed = grow(grow(grown, 0.2), -0.2)
    faces = [edges(_simple(body)) for body in polygons_in(closed)]
    segments = np.concatenate([segments for segments, _ in faces])
    normals = np.concatenate([normals for _, normals in faces])
    count = len(segments)
    return Pieces(segments, -normals, np.full(count, NO_ROOM), np.ones(count, bool))


def _simple(body: Polygon) -> Polygon:
    """Return the outer outline of a body without its smallest bends."""
    outline = body.exterior.simplify(0.02)
    return Polygon(outline.coords)


@dataclass(frozen=True, eq=False)
class _Door:
    gap: int
    start: FloatArray
    end: FloatArray


def _draw_doors(
    gaps: WallGaps, walls: Pieces, rng: Generator, config: FittingConfig
) -> list[_Door]:
    between: dict[tuple[int, int], list[int]] = defaultdict(list)
    for k, (one, two) in enumerate(zip(gaps.one, gaps.two, strict=True)):
        rooms = sorted((int(walls.rooms[one]), int(walls.rooms[two])))
        if rooms[0] != rooms[1]:
            between[rooms[0], rooms[1]].append(k)
    share = rng.choice(config.door_share)
    doors = []
    for candidates in between.values():
        if rng.random() >= share:
            continue
        for _ in range(2 if rng.random() < config.second_door_share else 1):
            wide = rng.random() < config.opening_share
            width = rng.uniform(*(config.opening_width_m if wide else config.door_width_m))
            gap = int(rng.choice(candidates))
            start, along = gaps.starts[gap], gaps.ends[gap] - gaps.starts[gap]
            length = float(np.linalg.norm(along))
            if length > width + 2 * DOOR_FRAME_M:
                along /= length
                where = rng.uniform(DOOR_FRAME_M, length - width - DOOR_FRAME_M)
                doors.append(_Door(gap, start + where * along, start + (where + width) * along))
    return doors


Cuts = dict[int, list[tuple[FloatArray, FloatArray]]]
"""By row of a surface, the stretches to be cut out of it, from point to point."""


def _door_cuts(walls: Pieces, gaps: WallGaps, doors: list[_Door]) -> Cuts:
    """Return what doors cut out: every one is cut out of both sides of its wall."""
    cuts: Cuts = {row: [] for row in range(len(walls))}
    for door in doors:
        for row in (int(gaps.one[door.gap]), int(gaps.two[door.gap])):
            cuts[row].append((door.start, door.end))
    return cuts


def _junctions_behind(
    gaps: WallGaps, count: int, rng: Generator, share: float
) -> Iterator[tuple[int, tuple[FloatArray, FloatArray]]]:
    """Yield where walls meet surfaces from behind: between the rooms that lie behind them."""
    behind: dict[int, list[tuple[FloatArray, FloatArray]]] = defaultdict(list)
    for one, two, start, end in zip(gaps.one, gaps.two, gaps.starts, gaps.ends, strict=True):
        behind[int(one)].append((start, end))
        behind[int(two)].append((end, start))  # opposed surfaces run in opposite directions
    for row in range(count):
        if len(behind[row]) < 2 or rng.random() >= share:
            continue
        along = behind[row][0][1] - behind[row][0][0]
        for (_, end), (start, _) in pairwise(sorted(behind[row], key=lambda s: s[0] @ along)):
            if (start - end) @ along >= 0 and np.linalg.norm(start - end) <= THICKEST_M:
                yield row, (end, start)


def _cut(walls: Pieces, cuts: Cuts) -> Pieces:
    rows, segments = [], []
    for row, segment in enumerate(walls.segments):
        length = float(np.linalg.norm(segment[1] - segment[0]))
        along = (segment[1] - segment[0]) / length
        spans = [(0.0, length)]
        for start, end in cuts[row]:
            ends = sorted(((start - segment[0]) @ along, (end - segment[0]) @ along))
            spans = [
                span
                for low, high in spans
                for span in ((low, min(high, ends[0])), (max(low, ends[1]), high))
                if span[1] - span[0] > SHORTEST_PIECE_M
            ]
        for low, high in spans:
            rows.append(row)
            segments.append([segment[0] + low * along, segment[0] + high * along])
    return walls.take(np.array(rows)).moved(np.array(segments))


def _door_leaves(doors: list[_Door], gaps: WallGaps, rng: Generator, share: float) -> Pieces:
    """Return both faces of the leaves of some doors, swung open."""
    segments, normals = [], []
    for door in doors:
        opening = door.end - door.start
        if rng.random() >= share or np.linalg.norm(opening) > 1.2:
            continue
        hinge = door.start if rng.random() < 0.5 else door.end
        angle = rng.uniform(0.2, 1.6) * rng.choice([-1, 1])
        leaf = np.cos(angle) * opening + np.sin(angle) * turn_left(opening)
        normal = turn_left(leaf / np.linalg.norm(leaf))
        for side in (1.0, -1.0):
            if rng.random() < 0.7:
                face = hinge + 0.02 * side * normal
                segments.append([face, face + leaf])
                normals.append(side * normal)
    return _clutter(segments, normals)


def _furniture(rooms: list[Polygon], rng: Generator, share: float, config: FittingConfig) -> Pieces:
    """Return the mapped faces of boxes that stand about in some rooms."""
    segments: list[FloatArray] = []
    normals: list[FloatArray] = []
    for room in rooms:
        if rng.random() >= share or room.area < 6:
            continue
        west, south, east, north = room.bounds
        for _ in range(rng.integers(1, 4)):
            length, width = rng.uniform(*config.furniture_size_m, size=2)
            angle = rng.choice([0.0, rng.uniform(0, np.pi / 2)])
            middle = rng.uniform([west, south], [east, north])
            body = rectangle(middle, np.array([np.cos(angle), np.sin(angle)]), length, width)
            if grow(room, -0.15).contains(body):
                faces, inwards = edges(body)
                seen = rng.random(len(faces)) < 0.8
                segments += list(faces[seen])
                normals += list(-inwards[seen])
    return _clutter(segments, normals)


def _clutter(segments: list, normals: list) -> Pieces:  # type: ignore[type-arg]
    count = len(segments)
    return Pieces(
        np.array(segments, np.float64).reshape(count, 2, 2),
        np.array(normals, np.float64).reshape(count, 2),
        np.full(count, NO_ROOM),
        np.zeros(count, bool),
    )
