"""One drive, as every method gets it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from sgraph_concepts.types import FloatArray, SurfaceArrays
from sgraph_core.backend import optimize
from sgraph_core.evaluation.slam.free_space import free_outlines
from sgraph_core.frontend.association import NONE, Gate, seen_from_pose
from sgraph_core.frontend.mapper import Mapper
from sgraph_core.frontend.mapping import MappedDrive, build_map
from sgraph_core.frontend.planar import as_rows, between, from_rows
from sgraph_core.frontend.recording import Recording
from sgraph_core.graph import SGraph, Truth

__all__ = ["Trial", "Update"]

FIRST_UPDATES, REGULAR_UPDATES = 20, 20
REFERENCE_SIGMA = 1e-3
"""Of motions between reference poses, rad and m."""


@dataclass(frozen=True, eq=False)
class Update:
    """The map as far as the drive has come.

    Attributes:
        seconds: since the start of the drive.
        regular: whether it is one of those that are spread evenly over the drive.
        graph: the keyframes and the surfaces mapped so far, with the truth of all.
    """

    seconds: float
    regular: bool
    graph: SGraph


class Trial:
    """One drive, as every method gets it.

    Args:
        recording: the drive.
        seed: that it was recorded with.
    """

    def __init__(self, recording: Recording, seed: int) -> None:
        self.recording = recording
        self.seed = seed

    @cached_property
    def mapped(self) -> MappedDrive:
        """What the front end makes of the drive; its truth is only for scores."""
        return build_map(self.recording)

    @cached_property
    def straightened(self) -> SGraph:
        """The map, solved for odometry and planes."""
        return optimize(self.mapped.graph).graph

    @cached_property
    def dead_reckoned(self) -> SGraph:
        """Keyframes where odometry alone puts them, and observed surfaces as seen from there."""
        rows = self.recording.dead_reckoned()
        graph = SGraph(self.recording.name)
        graph.extend_keyframes(np.arange(len(rows)), rows, self.recording.stamps)
        seen = [
            seen_from_pose(observed, pose)
            for observed, pose in zip(self.recording.observations, from_rows(rows), strict=True)
        ]
        _add_lines(
            graph,
            np.concatenate([lines.segments for lines in seen]),
            np.concatenate([lines.normals for lines in seen]),
        )
        return graph

    @cached_property
    def same_surfaces(self) -> list[list[int]]:
        """Ids of the mapped surfaces that are one surface in truth, group by group."""
        groups: dict[int, list[int]] = {}
        for surface, source in enumerate(self.mapped.sources.tolist()):
            if source != NONE:
                groups.setdefault(source, []).append(surface)
        return list(groups.values())

    @cached_property
    def true_surfaces(self) -> SurfaceArrays:
        """The building's surfaces; of a log, those that the front end maps along the reference."""
        if self.recording.building is not None:
            return self.recording.building.surfaces
        poses = from_rows(self.recording.reference)
        motions = between(poses[:-1], poses[1:])
        sigmas = np.full((len(motions), 6), REFERENCE_SIGMA)
        exact = replace(self.recording, odometry=as_rows(motions), odometry_sigmas=sigmas)
        graph = SGraph()
        lines = Mapper.run(exact, Gate()).surfaces()
        _add_lines(graph, lines.segments, lines.normals)
        return graph.wall_surfaces.ordered()

    @cached_property
    def free_outlines(self) -> list[list[FloatArray]]:
        """What each keyframe shows to be free, for :func:`free_space_rooms`."""
        return free_outlines(self.recording.scans)

    @cached_property
    def updates(self) -> list[Update]:
        """The map as the front end had it at some keyframes.

        These are the first 20, when a first room may be found, and 20 that are spread evenly.
        """
        recording = self.recording
        regular = set(np.linspace(0, len(recording) - 1, REGULAR_UPDATES).round().tolist())
        mapper = Mapper(from_rows(recording.reference[:1])[0], Gate())
        updates = []
        for number, observed in enumerate(recording.observations):
            if number == 0:
                mapper.add(observed)
            else:
                motion = recording.odometry[number - 1], recording.odometry_sigmas[number - 1]
                mapper.add(observed, *motion)
            if number < FIRST_UPDATES or number in regular:
                seconds = float(recording.stamps[number] - recording.stamps[0])
                updates.append(Update(seconds, number in regular, self._so_far(mapper)))
        return updates

    def _so_far(self, mapper: Mapper) -> SGraph:
        graph = SGraph(self.recording.name)
        count = len(mapper.poses)
        stamps = self.recording.stamps[:count]
        graph.extend_keyframes(np.arange(count), as_rows(mapper.poses), stamps)
        lines = mapper.surfaces()
        _add_lines(graph, lines.segments, lines.normals)
        graph.truth = _known(self.mapped.graph.truth, len(lines))
        return graph


def _add_lines(graph: SGraph, segments: FloatArray, normals: FloatArray) -> None:
    unknown = np.full((len(segments), 2), np.nan)
    graph.extend_wall_surfaces(np.arange(len(segments)), segments, normals, unknown)


def _known(truth: Truth | None, count: int) -> Truth | None:
    """Return the truth about surfaces of ids below a count."""
    if truth is None:
        return None
    rooms = (
        replace(room, members=tuple(i for i in room.members if i < count)) for room in truth.rooms
    )
    return Truth(
        tuple(room for room in rooms if room.members),
        tuple(wall for wall in truth.walls if max(wall) < count),
    )
