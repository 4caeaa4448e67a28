"""Which true surface every observed and mapped surface is of."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sgraph_concepts.types import FloatArray, IntArray, SurfaceArrays
from sgraph_core.frontend.association import NONE, Gate, Lines, matches, seen_from_pose
from sgraph_core.frontend.mapper import Mapper
from sgraph_core.frontend.planar import as_rows, between, from_rows
from sgraph_core.frontend.recording import Recording
from sgraph_core.geometry import dot, turn_left
from sgraph_core.graph import TrueRoom, Truth
from sgraph_core.synth.walls import wall_gaps

__all__ = ["mapped_along_reference", "observed_sources", "surface_sources", "truth_of_map"]

TRUE_GATE = Gate(angle_deg=15.0, offset_m=0.2, gap_m=0.0)
"""Between an observed surface placed by the reference pose and the true one."""
REFERENCE_SIGMA = 1e-5
"""Of each motion between reference poses, rad and m: they are certain."""
SHARE_OF_ROOM = 0.25
"""Of a surface's observations, to make it a member of a room."""


def observed_sources(recording: Recording, gate: Gate) -> list[IntArray]:
    """Return per keyframe the true surface of each observed one, NONE where there is none.

    In a simulated drive these are the building's surfaces. A log has no building: there the
    surfaces that the same front end maps with the reference poses stand for the true ones.
    """
    if recording.building is None:
        return mapped_along_reference(recording, gate).associations
    built, poses = recording.building.surfaces, from_rows(recording.reference)
    true = Lines(built.segments, built.normals)
    return [
        matches(seen_from_pose(observed, pose), true, TRUE_GATE)
        for pose, observed in zip(poses, recording.observations, strict=True)
    ]


def mapped_along_reference(recording: Recording, gate: Gate) -> Mapper:
    """Map a recording with its reference poses for odometry."""
    poses = from_rows(recording.reference)
    motions = between(poses[:-1], poses[1:])
    sigmas = np.full((len(motions), 6), REFERENCE_SIGMA)
    exact = replace(recording, odometry=as_rows(motions), odometry_sigmas=sigmas)
    return Mapper.run(exact, gate)


def surface_sources(associations: list[IntArray], sources: list[IntArray], count: int) -> IntArray:
    """Return of each of N mapped surfaces the true one of most of its observations, [N]."""
    mapped, true = np.concatenate(associations), np.concatenate(sources)
    votes = _votes(mapped, true, count)
    return np.where(votes.any(axis=1), votes.argmax(axis=1), NONE)


def _votes(mapped: IntArray, true: IntArray, count: int) -> IntArray:
    """Return how many observations of each mapped surface are of each true one, [N, T]."""
    known = (mapped != NONE) & (true != NONE)
    votes = np.zeros((count, int(true.max(initial=-1)) + 2), np.int64)
    np.add.at(votes, (mapped[known], true[known]), 1)
    return votes


def truth_of_map(
    recording: Recording,
    associations: list[IntArray],
    observed: list[IntArray],
    sources: IntArray,
) -> Truth | None:
    """Return the rooms and walls of a map of a simulated building, None for a log.

    A room's members are the mapped surfaces of which a quarter or more of the observations are of
    the room's sides: one surface may run through several rooms. Two mapped surfaces are the sides
    of a wall when what they were mapped of is, where they were seen: walls may be mapped in pieces.

    Args:
        recording: the drive.
        associations: per keyframe the mapped surface of each observed one, NONE for none.
        observed: per keyframe the true surface of each observed one.
        sources: the true surface of each mapped one, [N].
    """
    building = recording.building
    if building is None:
        return None
    true = np.concatenate(observed)
    room_of = np.where(true == NONE, NONE, building.rooms[true])
    votes = _votes(np.concatenate(associations), room_of, len(sources))
    member = votes > SHARE_OF_ROOM * np.maximum(votes.sum(axis=1, keepdims=True), 1)
    rooms = tuple(
        TrueRoom(
            number,
            None,
            tuple(np.flatnonzero(member[:, number]).tolist()),
            tuple((float(x), float(y)) for x, y in outline),
        )
        for number, outline in enumerate(building.polygons)
        if number < member.shape[1] and member[:, number].any()
    )
    known = np.flatnonzero(sources != NONE)
    stretches = _seen_stretches(recording, associations, sources, building.surfaces)[known]
    gaps = wall_gaps(stretches, building.surfaces.normals[sources[known]])
    built = {frozenset(pair) for pair in building.walls.tolist()}
    walls = tuple(
        (one, two)
        for one, two in zip(known[gaps.one].tolist(), known[gaps.two].tolist(), strict=True)
        if frozenset((int(sources[one]), int(sources[two]))) in built
    )
    return Truth(rooms, walls)


def _seen_stretches(
    recording: Recording, associations: list[IntArray], sources: IntArray, true: SurfaceArrays
) -> FloatArray:
    """Return the stretch of its true surface that each mapped surface covers, [N, 2, 2]."""
    reach = np.tile([np.inf, -np.inf], (len(sources), 1))
    middles, tangents = true.midpoints[sources], turn_left(true.normals)[sources]
    for pose, observed, surfaces in zip(
        from_rows(recording.reference), recording.observations, associations, strict=True
    ):
        seen, mapped = seen_from_pose(observed, pose).segments, surfaces[surfaces != NONE]
        ends = seen[surfaces != NONE] - middles[mapped][:, None]
        along = dot(ends, tangents[mapped][:, None])
        np.minimum.at(reach[:, 0], mapped, along.min(axis=1))
        np.maximum.at(reach[:, 1], mapped, along.max(axis=1))
    return middles[:, None] + reach[..., None] * tangents[:, None]
