"""A robot drives through the 2 x 2 block: drifting odometry, planes of the room it is in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from plans import block

from sgraph_concepts.types import ConceptNode, NodeShape
from sgraph_core.graph import SGraph

Array = NDArray[np.float64]

WALL_M = 0.15
ROUNDS = 2
ROOM_ORDER = (0, 1, 3, 2)
PLANE_SIGMAS = (0.01, 0.02)
ODOMETRY_SIGMAS = np.array([1e-3, 1e-3, 0.03, 0.05, 0.05, 1e-3])


@dataclass(frozen=True, eq=False)
class Drive:
    """The drifted map, its true keyframe positions [K, 3] and true wall nodes."""

    graph: SGraph
    positions: Array
    walls: list[ConceptNode]


def compose(pose: Array, motion: Array) -> Array:
    cosine, sine = np.cos(pose[2]), np.sin(pose[2])
    turn = np.array([[cosine, -sine], [sine, cosine]])
    return np.append(pose[:2] + turn @ motion[:2], pose[2] + motion[2])


def invert(pose: Array) -> Array:
    cosine, sine = np.cos(pose[2]), np.sin(pose[2])
    turn = np.array([[cosine, sine], [-sine, cosine]])
    return np.append(-turn @ pose[:2], -pose[2])


def row(pose: Array) -> list[float]:
    return [pose[0], pose[1], 0, 0, 0, float(np.sin(pose[2] / 2)), float(np.cos(pose[2] / 2))]


def with_walls(simulated: Drive) -> SGraph:
    """Return the map of a drive with its true walls."""
    graph = simulated.graph.copy()
    graph.concepts["wall"] = simulated.walls
    return graph


def drive(seed: int) -> Drive:
    """Drive around the block twice; every visit of a room maps its surfaces anew."""
    rng = np.random.default_rng(seed)
    built = block(WALL_M).wall_surfaces
    true, rooms = _route(built.segments)
    graph, pose = SGraph("drive"), true[0]
    mapped: dict[tuple[int, int], int] = {}
    copies: dict[int, list[int]] = {}
    for keyframe, (real, room) in enumerate(zip(true, rooms, strict=True)):
        if keyframe:
            motion = compose(invert(true[keyframe - 1]), real)
            motion = motion + rng.normal(0, 1, 3) * ODOMETRY_SIGMAS[[3, 4, 2]]
            pose = compose(pose, motion)
        graph.add_keyframe(keyframe, row(pose), float(keyframe))
        if keyframe:
            graph.add_odometry(keyframe - 1, keyframe, row(motion), ODOMETRY_SIGMAS)
        visit = keyframe // 3
        for side in range(4 * room, 4 * room + 4):
            plane = _observe(built.segments[side], built.normals[side], real, rng)
            if (visit, side) not in mapped:
                mapped[visit, side] = len(graph.wall_surfaces.ids)
                copies.setdefault(side, []).append(mapped[visit, side])
                ends, normal = place(built.segments[side], plane, real, pose)
                graph.add_wall_surface(mapped[visit, side], ends, normal)
            graph.observe(mapped[visit, side], keyframe, plane, PLANE_SIGMAS)
    positions = np.column_stack([true[:, :2], np.zeros(len(true))])
    return Drive(graph, positions, _walls(graph, copies))


def _route(segments: Array) -> tuple[Array, list[int]]:
    """Return true poses [K, 3] and their rooms: three poses in each room, around and around."""
    poses, rooms = [], []
    for room in ROOM_ORDER * ROUNDS:
        centre = segments[4 * room : 4 * room + 4].mean(axis=(0, 1))
        for offset in ((-1.0, -0.5, 0.0), (0.0, 0.5, 0.8), (1.0, 0.0, 1.6)):
            poses.append([*(centre + offset[:2]), offset[2] + 1.5 * len(rooms)])
            rooms.append(room)
    return np.array(poses), rooms


def _observe(segment: Array, normal: Array, pose: Array, rng: np.random.Generator) -> Array:
    heading = np.arctan2(normal[1], normal[0]) - pose[2] + rng.normal(0, PLANE_SIGMAS[0])
    distance = normal @ (pose[:2] - segment[0]) + rng.normal(0, PLANE_SIGMAS[1])
    return np.array([np.cos(heading), np.sin(heading), 0, distance])


def place(segment: Array, plane: Array, real: Array, pose: Array) -> tuple[Array, Array]:
    """Return where a surface seems to be: its ends [2, 2] on the observed plane, and its normal."""
    heading = np.arctan2(plane[1], plane[0]) + pose[2]
    normal = np.array([np.cos(heading), np.sin(heading)])
    ends = [compose(pose, compose(invert(real), np.append(end, 0.0)))[:2] for end in segment]
    offset = plane[3] - normal @ pose[:2]
    return np.array([end - (normal @ end + offset) * normal for end in ends]), normal


def _walls(graph: SGraph, copies: dict[int, list[int]]) -> list[ConceptNode]:
    truth = block(WALL_M).truth
    assert truth is not None
    segments = graph.wall_surfaces.segments
    pairs = [
        (one, two)
        for side, other in truth.walls
        for one, two in zip(copies[side], copies[other], strict=True)
    ]
    return [
        ConceptNode(
            number,
            pair,
            shape=NodeShape(
                centre=tuple(segments[list(pair)].mean(axis=(0, 1)).tolist()), thickness=WALL_M
            ),
            confidence=1.0,
        )
        for number, pair in enumerate(pairs)
    ]
