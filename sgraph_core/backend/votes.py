"""Pairs of surfaces that may be one, as votes on how a stretch of the drive must be moved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sgraph_concepts.types import FloatArray, IntArray, SurfaceArrays
from sgraph_core.backend.coincidence import coincidence
from sgraph_core.backend.visits import Visits
from sgraph_core.graph import SGraph

__all__ = ["MOST_SUPPORT_M", "Votes", "votes_of_pairs", "votes_of_rows"]

NOISE_RAD, NOISE_M = 0.03, 0.06
"""How well a correction must explain a pair, as standard deviations."""
END_M = 0.03
"""Error of a surface's ends across it: the direction of short surfaces is uncertain."""
MOST_SUPPORT_M = 2.0
"""What one surface adds to a correction's support: its length, up to this."""


@dataclass(frozen=True, eq=False)
class Votes:
    """P pairs of surfaces that may be one.

    Attributes:
        pairs: ids of the older and the newer surface, [P, 2].
        since: row of the first keyframe that saw the older one, [P].
        visits: rows of the first and the last keyframe of the visit to the newer one, [P, 2].
        held: whether the front end itself recognised the surface: both are the same, [P].
        points: where the surfaces lie side by side, [P, 2].
        normals: of the older surface, [P, 2].
        innovations: heading and offset of the older surface less those of the newer one, [P, 2].
        sigmas: how well a correction must explain them, [P, 2].
        segments: of both surfaces, [P, 2, 2, 2].
    """

    pairs: IntArray
    since: IntArray
    visits: IntArray
    held: NDArray[np.bool_]
    points: FloatArray
    normals: FloatArray
    innovations: FloatArray
    sigmas: FloatArray
    segments: FloatArray

    def within(self, first: int, last: int) -> Votes:
        """Return what the keyframes from one to before another saw."""
        return self.take((self.visits[:, 1] >= first) & (self.visits[:, 0] < last))

    def take(self, rows: NDArray[np.bool_]) -> Votes:
        """Return the rows of a mask."""
        return Votes(
            self.pairs[rows],
            self.since[rows],
            self.visits[rows],
            self.held[rows],
            self.points[rows],
            self.normals[rows],
            self.innovations[rows],
            self.sigmas[rows],
            self.segments[rows],
        )

    def weights(self, support: NDArray[np.bool_]) -> FloatArray:
        """Return the metres of wall in sets of pairs, each newer surface counted once, [C].

        Args:
            support: which pairs are in each set, [C, P].
        """
        ends = self.segments[:, 1]
        lengths = np.minimum(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1), MOST_SUPPORT_M)
        first, _ = self._newer
        return np.asarray(self.newer_in(support) @ lengths[first])

    def newer_in(self, support: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return which of the newer surfaces are in sets of pairs [C, P], [C, surfaces]."""
        _, member = self._newer
        return np.asarray(support.astype(np.float64) @ member > 0)

    @cached_property
    def _newer(self) -> tuple[IntArray, NDArray[np.bool_]]:
        """A pair of each newer surface, and which pairs are of which, [P, surfaces]."""
        _, first, group = np.unique(self.pairs[:, 1], return_index=True, return_inverse=True)
        return first, group[:, None] == np.arange(len(first))


def votes_of_pairs(
    graph: SGraph,
    pairs: Sequence[tuple[int, int]],
    visits: Visits,
    apart: set[tuple[int, int]],
) -> Votes:
    """Return the votes of proposed pairs, and of all that the front end recognised.

    Args:
        graph: an S-Graph.
        pairs: ids of the older and the newer surface.
        visits: of its keyframes to its surfaces.
        apart: later visits that are left out: id of the surface and row of their first keyframe.
    """
    held = [(i, visit) for i, visit in visits.returns() if (i, visit[0]) not in apart]
    ids = np.array([*pairs, *((i, i) for i, _ in held)], np.int64).reshape(-1, 2)
    spans = [visits.first_visit(newer) for _, newer in pairs] + [visit for _, visit in held]
    surfaces = graph.wall_surfaces.ordered()
    one, two = (np.array([graph.surface_row(i) for i in side], np.int64) for side in ids.T.tolist())
    return replace(
        votes_of_rows(surfaces, one, two),
        since=np.array([visits.first(i) for i in ids[:, 0].tolist()], np.int64),
        visits=np.array(spans, np.int64),
        held=one == two,
    )


def votes_of_rows(surfaces: SurfaceArrays, one: IntArray, two: IntArray) -> Votes:
    """Return pairs of surfaces, by rows, as votes of no time."""
    lie = coincidence(surfaces, one, two)
    angle = np.hypot(NOISE_RAD, END_M / np.minimum(surfaces.lengths[one], surfaces.lengths[two]))
    return Votes(
        surfaces.ids[np.stack([one, two], axis=1)],
        np.zeros(len(one), np.int64),
        np.zeros((len(one), 2), np.int64),
        np.zeros(len(one), bool),
        lie.points,
        surfaces.normals[one],
        np.stack([lie.angles, lie.gaps], axis=1),
        np.stack([angle, np.full(len(one), NOISE_M)], axis=1),
        surfaces.segments[np.stack([one, two], axis=1)],
    )
