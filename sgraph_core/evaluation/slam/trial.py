"""One drive, as every method gets it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from sgraph_concepts.types import FloatArray, IntArray, SurfaceArrays
from sgraph_core.backend import optimize
from sgraph_core.evaluation.slam.free_space import free_outlines
from sgraph_core.evaluation.slam.oracle import oracle_map
from sgraph_core.frontend.association import GATE, Lines, seen_from_pose
from sgraph_core.frontend.mapper import Mapper
from sgraph_core.frontend.mapping import MappedDrive, build_map, seen_again
from sgraph_core.frontend.planar import as_rows, from_rows
from sgraph_core.frontend.recording import Recording
from sgraph_core.frontend.truth import mapped_along_reference, observed_sources
from sgraph_core.graph import SGraph, Truth

__all__ = ["Trial", "Update"]

FIRST_UPDATES, REGULAR_UPDATES = 20, 20


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
        segments = np.concatenate([lines.segments for lines in seen])
        normals = np.concatenate([lines.normals for lines in seen])
        _add_lines(graph, np.arange(len(segments)), Lines(segments, normals))
        return graph

    @cached_property
    def true_surfaces(self) -> SurfaceArrays:
        """The building's surfaces; of a log, those that the front end maps along the reference."""
        true, sources = self._truth
        if self.recording.building is not None:
            return true
        return true.take(seen_again(sources, len(true)))

    @cached_property
    def oracle(self) -> SGraph:
        """The map with true association; see :func:`oracle_map`."""
        return oracle_map(self.recording, *self._truth)

    @cached_property
    def _truth(self) -> tuple[SurfaceArrays, list[IntArray]]:
        """The true surfaces, and per keyframe the one that each observed one is of."""
        recording = self.recording
        if recording.building is not None:
            return recording.building.surfaces, observed_sources(recording, GATE)
        mapper = mapped_along_reference(recording, GATE)
        lines, graph = mapper.surfaces(), SGraph()
        _add_lines(graph, np.arange(len(lines)), lines)
        return graph.wall_surfaces.ordered(), mapper.associations

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
        mapper = Mapper(from_rows(recording.reference[:1])[0], GATE)
        stages = []
        for number, observed in enumerate(recording.observations):
            if number == 0:
                mapper.add(observed)
            else:
                motion = recording.odometry[number - 1], recording.odometry_sigmas[number - 1]
                mapper.add(observed, *motion)
            if number < FIRST_UPDATES or number in regular:
                lines = mapper.surfaces()
                stages.append((mapper.poses, lines, seen_again(mapper.associations, len(lines))))
        ids = np.cumsum(seen_again(mapper.associations, len(mapper.surfaces()))) - 1
        return [
            Update(
                float(recording.stamps[len(poses) - 1] - recording.stamps[0]),
                len(poses) - 1 in regular,
                self._so_far(poses, ids[: len(lines)][kept], lines.take(kept)),
            )
            for poses, lines, kept in stages
        ]

    def _so_far(self, poses: FloatArray, ids: IntArray, lines: Lines) -> SGraph:
        graph = SGraph(self.recording.name)
        graph.extend_keyframes(
            np.arange(len(poses)), as_rows(poses), self.recording.stamps[: len(poses)]
        )
        _add_lines(graph, ids, lines)
        graph.truth = _known(self.mapped.graph.truth, set(ids.tolist()))
        return graph


def _add_lines(graph: SGraph, ids: IntArray, lines: Lines) -> None:
    unknown = np.full((len(lines), 2), np.nan)
    graph.extend_wall_surfaces(ids, lines.segments, lines.normals, unknown)


def _known(truth: Truth | None, ids: set[int]) -> Truth | None:
    """Return the truth about surfaces of the given ids."""
    if truth is None:
        return None
    rooms = (replace(room, members=tuple(ids & set(room.members))) for room in truth.rooms)
    return Truth(
        tuple(room for room in rooms if room.members),
        tuple(wall for wall in truth.walls if set(wall) <= ids),
    )
