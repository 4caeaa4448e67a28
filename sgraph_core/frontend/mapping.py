"""The planes-only front end: from a recording to an S-Graph, keyframe by keyframe.

Every observed surface is taken for the nearest mapped one within a gate, else it becomes a new one.
ISAM2 corrects poses and planes at every keyframe, so the gate meets the current estimate. Loops are
not closed beyond what the gate does: after a long way a wall often becomes a second surface.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sgraph_concepts.types import FloatArray, IntArray
from sgraph_core.frontend.association import GATE, NONE, Gate, Lines
from sgraph_core.frontend.mapper import Mapper
from sgraph_core.frontend.planar import as_rows, in_space
from sgraph_core.frontend.recording import Recording
from sgraph_core.frontend.truth import observed_sources, surface_sources, truth_of_map
from sgraph_core.graph import SGraph

__all__ = ["MappedDrive", "add_keyframes", "add_observed", "build_map", "seen_again"]

FEWEST_KEYFRAMES = 2
"""That saw a surface of the map."""


@dataclass(frozen=True, eq=False)
class MappedDrive:
    """What the front end makes of a recording.

    Attributes:
        graph: keyframes (ids count from 0 in the recording's order), odometry, wall surfaces (ids
            count from 0) and observations, with the truth of a simulated drive.
        sources: of each wall surface the true surface that it was mapped of, -1 where there is
            none, [N]. In a simulated drive these are rows of the building's surfaces; in a log
            they number the surfaces that the reference poses would have mapped. Surfaces with the
            same source are one surface, mapped several times.
    """

    graph: SGraph
    sources: IntArray


def build_map(recording: Recording, gate: Gate = GATE) -> MappedDrive:
    """Map a recording; the same recording gives the same map.

    Surfaces that a single keyframe saw are left out: they tell nothing of the trajectory, and most
    are clutter.

    Raises:
        InputError: the recording holds numbers that break an S-Graph's rules.
        OptimizationError: the estimate is under-determined.
    """
    mapper = Mapper.run(recording, gate)
    surfaces, associations = _kept(mapper)
    graph = _graph(recording, mapper.poses, surfaces, associations)
    sources = observed_sources(recording, gate)
    true = surface_sources(associations, sources, len(surfaces))
    graph.truth = truth_of_map(recording, associations, sources, true)
    return MappedDrive(graph, true)


def seen_again(associations: Sequence[IntArray], count: int) -> NDArray[np.bool_]:
    """Return which of N surfaces two keyframes or more saw, [N].

    Args:
        associations: per keyframe, the surface of each observed one; NONE where there is none.
        count: N.
    """
    keyframes = np.zeros(count, np.int64)
    for seen in associations:
        keyframes[np.unique(seen[seen != NONE])] += 1
    return keyframes >= FEWEST_KEYFRAMES


def _kept(mapper: Mapper) -> tuple[Lines, list[IntArray]]:
    """Return the surfaces that were seen again, and the associations with these."""
    surfaces = mapper.surfaces()
    kept = seen_again(mapper.associations, len(surfaces))
    numbers = np.where(kept, np.cumsum(kept) - 1, NONE)
    return surfaces.take(kept), [numbers[seen] for seen in mapper.associations]


def _graph(
    recording: Recording, poses: FloatArray, surfaces: Lines, associations: list[IntArray]
) -> SGraph:
    graph = SGraph(recording.name)
    add_keyframes(graph, recording, as_rows(poses))
    mapped = np.concatenate(associations)
    kept = mapped != NONE
    heights = np.concatenate([o.heights for o in recording.observations])[kept]
    graph.extend_wall_surfaces(
        np.arange(len(surfaces)),
        surfaces.segments,
        surfaces.normals,
        _heights(heights, mapped[kept], len(surfaces)),
    )
    add_observed(graph, recording, mapped)
    return graph


def add_keyframes(graph: SGraph, recording: Recording, poses: FloatArray) -> None:
    """Add a recording's keyframes, with ids from 0, at given poses [K, 7], and its odometry."""
    keyframes = np.arange(len(recording))
    graph.extend_keyframes(keyframes, poses, recording.stamps)
    graph.extend_odometry(
        keyframes[:-1], keyframes[1:], recording.odometry, recording.odometry_sigmas
    )


def add_observed(graph: SGraph, recording: Recording, of: IntArray) -> None:
    """Add what a recording's keyframes observed.

    Args:
        graph: has the keyframes and the surfaces.
        recording: the drive.
        of: id of the surface that each observed one is of, in the drive's order; NONE leaves it
            out.
    """
    kept, observed = of != NONE, recording.observations
    graph.extend_observations(
        of[kept],
        np.repeat(np.arange(len(recording)), [len(o) for o in observed])[kept],
        np.concatenate([o.planes for o in observed])[kept],
        np.concatenate([o.sigmas for o in observed])[kept],
        in_space(np.concatenate([o.at for o in observed])[kept]),
    )


def _heights(seen: FloatArray, mapped: IntArray, count: int) -> FloatArray:
    """Return the lowest and highest z at which each surface was seen, NaN where unknown, [N, 2]."""
    heights = np.tile([np.inf, -np.inf], (count, 1))
    np.fmin.at(heights[:, 0], mapped, seen[:, 0])
    np.fmax.at(heights[:, 1], mapped, seen[:, 1])
    return np.where(np.isfinite(heights), heights, np.nan)
