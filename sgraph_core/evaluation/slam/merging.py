"""Surfaces that are one surface, made one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from sgraph_concepts.types import FloatArray
from sgraph_core.graph import SGraph, TrueRoom, Truth

__all__ = ["merged"]


def merged(graph: SGraph, same: Sequence[Sequence[int]]) -> SGraph:
    """Return an S-Graph in which groups of wall surfaces are one surface each.

    The first of a group gives its id and its line; the others lengthen it to where they reach along
    that line, and their observations become its own. Concepts are left out.

    Args:
        graph: the S-Graph.
        same: ids of the wall surfaces of each group; surfaces in no group stay as they are.
    """
    kept = {other: group[0] for group in same for other in group}
    result = SGraph(graph.name)
    poses, odometry, seen = graph.keyframes, graph.odometry, graph.observations
    result.extend_keyframes(poses.ids, poses.poses, poses.stamps)
    result.extend_odometry(odometry.from_ids, odometry.to_ids, odometry.poses, odometry.sigmas)
    _add_surfaces(result, graph, kept)
    own = np.array([kept.get(i, i) for i in seen.surface_ids.tolist()], np.int64)
    result.extend_observations(own, seen.keyframe_ids, seen.planes, seen.sigmas)
    if graph.truth is not None:
        result.truth = _renamed(graph.truth, kept)
    return result


def _add_surfaces(result: SGraph, graph: SGraph, kept: Mapping[int, int]) -> None:
    table = graph.wall_surfaces
    groups: dict[int, list[int]] = {}
    for row, surface in enumerate(table.ids.tolist()):
        groups.setdefault(kept.get(surface, surface), []).append(row)
    rows = [graph.surface_row(surface) for surface in groups]
    segments = [
        _lengthened(table.segments[graph.surface_row(surface)], table.segments[others])
        for surface, others in groups.items()
    ]
    result.extend_wall_surfaces(
        table.ids[rows], np.array(segments), table.normals[rows], table.heights[rows]
    )


def _lengthened(segment: FloatArray, others: FloatArray) -> FloatArray:
    """Return a segment lengthened along its line to where other segments [S, 2, 2] reach."""
    start = segment[0]
    tangent = (segment[1] - start) / np.linalg.norm(segment[1] - start)
    reach = (others.reshape(-1, 2) - start) @ tangent
    return np.asarray(start + np.outer([reach.min(), reach.max()], tangent))


def _renamed(truth: Truth, kept: Mapping[int, int]) -> Truth:
    rooms = (
        TrueRoom(
            room.id,
            room.name,
            tuple(dict.fromkeys(kept.get(i, i) for i in room.members)),
            room.polygon,
        )
        for room in truth.rooms
    )
    walls = {tuple(sorted(kept.get(i, i) for i in wall)) for wall in truth.walls}
    return Truth(tuple(rooms), tuple(sorted((one, two) for one, two in walls)))
