"""Maps of rooms that are visited one after the other, each visit drifted as a whole."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from drive import Array, compose, invert, row
from shapely import Polygon

from sgraph_concepts.types import ConceptNode, NodeShape
from sgraph_core.graph import SGraph

AWAY = 18
"""Keyframes between two visits, a metre apart: out of the building and back."""
SEEING = 3
"""Keyframes of a visit that see the room."""
KEYFRAMES = SEEING + AWAY
"""Of each visit."""
SIGMAS = [1e-3, 1e-3, 0.01, 0.05, 0.05, 1e-3]


def visit_rooms(
    visits: Sequence[tuple[Sequence[Sequence[float]], Sequence[float]]], at_aside: bool = False
) -> SGraph:
    """Return the map of visits, each an outline (counter-clockwise) and its drift x, y, yaw.

    Each visit has keyframes that see all sides, and is a room of its own. Surfaces are
    numbered visit by visit, side by side. Odometry agrees with the drift, so the map is solved.
    Distances err in the keyframes, or aside, some metres along the surfaces.
    """
    graph, rooms = SGraph("visits"), []
    for outline, drift in visits:
        corners, poses = np.array(outline, float), []
        centre = np.array(Polygon(corners).representative_point().coords[0]) - [0.3, 0.0]
        for step in range(SEEING):
            poses.append(
                _keyframe(graph, np.array([centre[0] + 0.3 * step, centre[1], 0.0]), drift)
            )
        members = [
            _see(graph, corners[side], corners[(side + 1) % len(corners)], poses, drift, at_aside)
            for side in range(len(corners))
        ]
        shape = NodeShape(tuple(centre), tuple(map(tuple, corners.tolist())))
        rooms.append(ConceptNode(len(rooms), tuple(members), shape=shape, confidence=1.0))
        for step in range(AWAY):
            out = min(step, AWAY - 1 - step)
            _keyframe(graph, np.array([centre[0], centre[1] - 20.0 - out, 0.0]), drift)
    graph.concepts["room"] = rooms
    return graph


def _keyframe(graph: SGraph, true: Array, drift: Sequence[float]) -> tuple[int, Array]:
    pose, number = compose(np.array(drift, float), true), len(graph.keyframes.ids)
    graph.add_keyframe(number, row(pose))
    if number:
        x, y, _, _, _, z, w = graph.keyframe(number - 1).pose.tolist()
        before = np.array([x, y, 2 * np.arctan2(z, w)])
        graph.add_odometry(number - 1, number, row(compose(invert(before), pose)), SIGMAS)
    return number, true


def _see(
    graph: SGraph,
    start: Array,
    end: Array,
    poses: Sequence[tuple[int, Array]],
    drift: Sequence[float],
    at_aside: bool,
) -> int:
    surface, moved = len(graph.wall_surfaces.ids), np.array(drift, float)
    along = (end - start) / np.linalg.norm(end - start)
    normal = np.array([-along[1], along[0]])
    ends = [compose(moved, np.append(point, 0.0))[:2] for point in (start, end)]
    turned = compose(np.array([0, 0, moved[2]]), np.append(normal, 0.0))[:2]
    graph.add_wall_surface(surface, ends, turned)
    for keyframe, true in poses:
        plane = [*normal, 0, float(normal @ (true[:2] - start))]
        seen = start + (1.0 + surface + keyframe % 3) * along - true[:2]
        at = np.append(seen, 0.0) if at_aside else np.zeros(3)
        graph.observe(surface, keyframe, plane, [0.01, 0.02], at)
    return surface
