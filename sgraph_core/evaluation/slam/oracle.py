"""The map of an oracle, who knows which true surface every observed one is of."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sgraph_concepts.types import BuildingTruth, FloatArray, IntArray, SurfaceArrays
from sgraph_core.frontend.association import NONE, seen_from_pose
from sgraph_core.frontend.mapping import add_keyframes, add_observed, seen_again
from sgraph_core.frontend.planar import from_rows
from sgraph_core.frontend.recording import Recording
from sgraph_core.graph import SGraph, TrueRoom, Truth

__all__ = ["oracle_map"]


def oracle_map(recording: Recording, true: SurfaceArrays, sources: Sequence[IntArray]) -> SGraph:
    """Return a recording's map with true association, keyframes and surfaces where they truly are.

    A surface reaches as far as it was seen; what fewer than two keyframes saw is left out, as the
    front end does.

    Args:
        recording: the drive.
        true: the true surfaces.
        sources: per keyframe the row in ``true`` of each observed surface; NONE if there is none.
    """
    graph = SGraph(recording.name)
    add_keyframes(graph, recording, recording.reference)
    of = np.concatenate(sources)
    kept = (of != NONE) & seen_again(sources, len(true))[of]
    seen = [
        seen_from_pose(surfaces, pose).segments
        for surfaces, pose in zip(
            recording.observations, from_rows(recording.reference), strict=True
        )
    ]
    ids = np.unique(of[kept])
    segments = _seen_stretches(true, ids, np.concatenate(seen)[kept], of[kept])
    graph.extend_wall_surfaces(ids, segments, true.normals[ids], np.full((len(ids), 2), np.nan))
    add_observed(graph, recording, np.where(kept, of, NONE))
    if recording.building is not None:
        graph.truth = _truth(recording.building, set(ids.tolist()))
    return graph


def _seen_stretches(
    true: SurfaceArrays, ids: IntArray, seen: FloatArray, of: IntArray
) -> FloatArray:
    """Return the stretch of each surface that what was seen of it covers, [N, 2, 2]."""
    stretches = []
    for surface in ids.tolist():
        start, tangent = true.segments[surface, 0], true.tangents[surface]
        reach = (seen[of == surface].reshape(-1, 2) - start) @ tangent
        stretches.append(start + np.outer([reach.min(), reach.max()], tangent))
    return np.array(stretches).reshape(-1, 2, 2)


def _truth(building: BuildingTruth, ids: set[int]) -> Truth:
    """Return the rooms and walls of the surfaces of the given ids."""
    rooms = []
    for number in range(len(building.polygons)):
        members = [i for i in np.flatnonzero(building.rooms == number).tolist() if i in ids]
        if members:
            rooms.append(TrueRoom(number, None, tuple(members), None))
    walls = ((one, two) for one, two in building.walls.tolist() if {one, two} <= ids)
    return Truth(tuple(rooms), tuple(walls))
