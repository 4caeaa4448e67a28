"""What is mapped of a building without being part of it: door leaves and furniture."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from shapely import Polygon

from sgraph_concepts.types import FloatArray
from sgraph_core.geometry import turn_left
from sgraph_core.synth.config import FittingConfig
from sgraph_core.synth.cutouts import Cutout
from sgraph_core.synth.pieces import NO_ROOM, Pieces
from sgraph_core.synth.polygons import edges, grow, rectangle

__all__ = ["door_leaves", "furniture"]

WIDEST_LEAF_M = 1.2


def door_leaves(doors: list[Cutout], rng: Generator, share: float) -> Pieces:
    """Return both faces of the leaves of some doors, swung open."""
    segments, normals = [], []
    for door in doors:
        opening = door.end - door.start
        if rng.random() >= share or np.linalg.norm(opening) > WIDEST_LEAF_M:
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


def furniture(
    rooms: list[Polygon], rng: Generator, share: float, config: FittingConfig
) -> tuple[Pieces, list[Polygon]]:
    """Return the mapped faces of boxes that stand about in some rooms, and the boxes."""
    segments: list[FloatArray] = []
    normals: list[FloatArray] = []
    bodies: list[Polygon] = []
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
                bodies.append(body)
    return _clutter(segments, normals), bodies


def _clutter(segments: list, normals: list) -> Pieces:  # type: ignore[type-arg]
    count = len(segments)
    return Pieces(
        np.array(segments, np.float64).reshape(count, 2, 2),
        np.array(normals, np.float64).reshape(count, 2),
        np.full(count, NO_ROOM),
        np.zeros(count, bool),
    )
