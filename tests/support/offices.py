"""A robot drives along a corridor with a row of identical offices, enters some, and comes back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from drive import PLANE_SIGMAS, Array, compose, invert, place, row

from sgraph_core.graph import SGraph

OFFICE_M = (4.0, 5.0)
WALL_M = 0.15
CORRIDOR_M = 2.0
DOOR_M = 1.0
SEEN_M = 6.0
STEP_M = 1.0
TURN_SIGMA = np.radians(1.0)
"""Drift of the heading per root metre."""
MOVE_SIGMA = 0.02
KNOWN_OFFSET_M = 0.2
KNOWN_ANGLE_RAD = np.radians(8.0)


@dataclass(frozen=True, eq=False)
class OfficeDrive:
    """The drifted map, true keyframe positions [K, 3], and which built surface each one maps."""

    graph: SGraph
    positions: Array
    built: list[int]
    segments: Array
    normals: Array
    room_of: list[int]


def offices(count: int) -> tuple[Array, Array, list[int]]:
    """Return segments, normals and rooms (-1: the corridor) of offices north of a corridor."""
    width, depth = OFFICE_M
    segments, normals, rooms = [], [], []

    def add(room: int, start: Sequence[float], end: Sequence[float]) -> None:
        along = np.subtract(end, start) / np.linalg.norm(np.subtract(end, start))
        segments.append([start, end])
        normals.append([-along[1], along[0]])
        rooms.append(room)

    length = count * (width + WALL_M) - WALL_M
    add(-1, [0, 0], [length, 0])
    add(-1, [length, 0], [length, CORRIDOR_M])
    add(-1, [0, CORRIDOR_M], [0, 0])
    south = CORRIDOR_M + WALL_M
    for office in range(count):
        west = office * (width + WALL_M)
        east, north = west + width, south + depth
        door = (west + width / 2 - DOOR_M / 2, west + width / 2 + DOOR_M / 2)
        add(-1, [door[0], CORRIDOR_M], [west, CORRIDOR_M])
        add(-1, [east, CORRIDOR_M], [door[1], CORRIDOR_M])
        add(office, [west, south], [door[0], south])
        add(office, [door[1], south], [east, south])
        add(office, [east, south], [east, north])
        add(office, [east, north], [west, north])
        add(office, [west, north], [west, south])
    return np.array(segments, float), np.array(normals), rooms


def route(visits: Sequence[int]) -> tuple[Array, list[int]]:
    """Return true poses [K, 3] a metre apart and their rooms, through the corridor and offices."""
    stops = [(np.array([1.0, 1.0]), -1)]
    for office in visits:
        x = office * (OFFICE_M[0] + WALL_M) + OFFICE_M[0] / 2
        south = CORRIDOR_M + WALL_M
        stops += [
            (np.array([x, 1.0]), -1),
            (np.array([x, south + 1.5]), office),
            (np.array([x + 0.8, south + 3.5]), office),
            (np.array([x - 0.8, south + 3.5]), office),
            (np.array([x, south + 1.5]), office),
            (np.array([x, 1.0]), -1),
        ]
    points, rooms = [stops[0][0]], [-1]
    for (start, _), (end, room) in zip(stops, stops[1:], strict=False):
        steps = max(int(np.ceil(np.linalg.norm(end - start) / STEP_M)), 1)
        for step in range(1, steps + 1):
            points.append(start + (end - start) * step / steps)
            inside = points[-1][1] > CORRIDOR_M + WALL_M / 2
            rooms.append(max(room, stops[0][1]) if inside else -1)
    office_now = -1
    for k, point in enumerate(points):
        if point[1] > CORRIDOR_M + WALL_M / 2:
            office_now = int(point[0] // (OFFICE_M[0] + WALL_M))
            rooms[k] = office_now
    heading = np.unwrap(
        [np.arctan2(*(b - a)[::-1]) for a, b in zip(points, points[1:], strict=False)] + [0.0]
    )
    return np.column_stack([points, heading]), rooms


def office_drive(
    seed: int, count: int = 5, visits: Sequence[int] | None = None, drift: float = 1.0
) -> OfficeDrive:
    """Drive along the corridor and back; surfaces that have drifted too far are mapped anew."""
    rng = np.random.default_rng(seed)
    segments, normals, owners = offices(count)
    there = list(range(count))
    true, rooms = route(visits if visits is not None else [*there, *there[::-1]])
    graph, pose, built = SGraph("offices"), true[0], list[int]()
    for keyframe, (real, room) in enumerate(zip(true, rooms, strict=True)):
        if keyframe:
            motion = compose(invert(true[keyframe - 1]), real)
            motion[2] = (motion[2] + np.pi) % (2 * np.pi) - np.pi
            far = float(np.hypot(*motion[:2]))
            sigmas = drift * np.array(
                [MOVE_SIGMA * far + 1e-3] * 2 + [TURN_SIGMA * np.sqrt(far) + 1e-3]
            )
            motion = motion + rng.normal(0, 1, 3) * sigmas
            pose = compose(pose, motion)
        graph.add_keyframe(keyframe, row(pose), float(keyframe))
        if keyframe:
            noise = [1e-3, 1e-3, sigmas[2], sigmas[0], sigmas[1], 1e-3]
            graph.add_odometry(keyframe - 1, keyframe, row(motion), noise)
        for side in range(len(segments)):
            away = np.abs(segments[side].mean(axis=0) - real[:2])
            faces = normals[side] @ (real[:2] - segments[side][0]) > 0.1
            near = owners[side] >= 0 or side < 3 or away[0] < SEEN_M
            if owners[side] == room and near and faces:
                _see(graph, keyframe, side, built, segments[side], normals[side], real, pose, rng)
    positions = np.column_stack([true[:, :2], np.zeros(len(true))])
    return OfficeDrive(graph, positions, built, segments, normals, owners)


def _see(graph, keyframe, side, built, segment, normal, real, pose, rng) -> None:  # type: ignore[no-untyped-def]
    heading = np.arctan2(normal[1], normal[0]) - real[2] + rng.normal(0, PLANE_SIGMAS[0])
    distance = max(normal @ (real[:2] - segment[0]) + rng.normal(0, PLANE_SIGMAS[1]), 0.01)
    plane = np.array([np.cos(heading), np.sin(heading), 0, distance])
    ends, outward = place(segment, plane, real, pose)
    known = [k for k, original in enumerate(built) if original == side]
    best, gap = -1, KNOWN_OFFSET_M
    for surface in known:
        mapped = graph.wall_surface(surface)
        if mapped.normal @ outward < np.cos(KNOWN_ANGLE_RAD):
            continue
        away = np.abs((ends.mean(axis=0) - mapped.segment[0]) @ mapped.normal)
        seen_now = graph.observations.keyframe_ids[graph.observations.surface_ids == surface]
        if seen_now.max() >= keyframe - 1:
            away = 0.0  # tracked from the keyframe before
        if away < gap:
            best, gap = surface, away
    if best < 0:
        best = len(built)
        built.append(side)
        graph.add_wall_surface(best, ends, outward)
    graph.observe(best, keyframe, plane, PLANE_SIGMAS)
