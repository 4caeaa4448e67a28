"""Which surfaces that concepts take for one surface mapped twice may be tied.

A concept proposes pairs of surfaces. A pair is possible where the map's own uncertainty explains
its gap (chi-squared of the innovation, after the individual compatibility of Neira and Tardos,
"Data Association in Stochastic Mapping Using the Joint Compatibility Test", 2001). Alone it proves
little: walls of a building repeat. So the pairs that one node proposes vote. Two pairs that are not
parallel fix how one visit must move onto the other; the covariance between all pairs then predicts
every other gap, and pairs that agree support the correction. It is accepted when its support is
jointly compatible, and when no other correction has nearly as much: of equal doors in a row, each
explains the observation, and none is taken.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from sgraph_concepts.types import FloatArray, IntArray
from sgraph_core.backend.coincidence import coincidence
from sgraph_core.backend.uncertainty import Uncertainty
from sgraph_core.graph import SGraph

__all__ = ["Proposal", "Same", "associate"]

TIE_SIGMAS = (0.02, 0.03)
"""How two mapped pieces of one wall differ from one plane: angle in rad, offset in m."""
REJECTION = 1e-2
PREDICTED_M = 0.1
"""A pair supports a correction only where the correction predicts its gap this well, or better."""
PARALLEL = np.sin(np.radians(30.0))
FEWEST = 3
RIVAL = 0.7
"""A rival correction with this share of the best one's support makes both ambiguous."""
APART_M = 0.25
MOST_SEEDS = 24


@dataclass(frozen=True)
class Proposal:
    """Pairs of surfaces, by id, that a node takes for one surface mapped twice."""

    concept: str
    node: int
    pairs: Sequence[tuple[int, int]]


@dataclass(frozen=True)
class Same:
    """Two surfaces that are one, shown by a node.

    Attributes:
        concept, node: who says so.
        pair: ids of the surfaces.
        point: where they lie side by side, halfway between them.
        sigmas: how exactly they are one plane: angle in rad, offset in m.
    """

    concept: str
    node: int
    pair: tuple[int, int]
    point: tuple[float, float]
    sigmas: tuple[float, float] = TIE_SIGMAS


def associate(
    graph: SGraph,
    proposals: Sequence[Proposal],
    known: Sequence[Same] = (),
) -> list[Same]:
    """Return the proposed pairs that are one surface.

    Args:
        graph: an S-Graph whose low layers are solved.
        proposals: pairs of observed surfaces.
        known: pairs that the map has been solved with.
    """
    together = _seen_together(graph)
    done = {frozenset(same.pair) for same in known}
    refused = done | together
    open_ = [
        (proposal, np.array(pairs))
        for proposal in proposals
        if (pairs := [pair for pair in proposal.pairs if frozenset(pair) not in refused])
    ]
    if not open_:
        return []
    uncertainty = Uncertainty(graph, known)
    found = []
    for proposal, pairs in open_:
        found += _vote(graph, uncertainty, proposal, pairs)
    unique = {frozenset(same.pair): same for same in found}
    return list(unique.values())


def _seen_together(graph: SGraph) -> set[frozenset[int]]:
    seen: dict[int, list[int]] = {}
    table = graph.observations
    for surface, keyframe in zip(
        table.surface_ids.tolist(), table.keyframe_ids.tolist(), strict=True
    ):
        seen.setdefault(keyframe, []).append(surface)
    return {
        frozenset((one, two)) for surfaces in seen.values() for one in surfaces for two in surfaces
    }


@dataclass(frozen=True, eq=False)
class _Ballot:
    """The possible pairs of one node, P of them.

    Attributes:
        pairs: ids, [P, 2].
        points: where they lie side by side, [P, 2].
        normals: of the first surface, [P, 2].
        innovations: angle and gap of each pair, [P, 2].
        covariance: of all innovations, [2P, 2P].
    """

    pairs: IntArray
    points: FloatArray
    normals: FloatArray
    innovations: FloatArray
    covariance: FloatArray


def _vote(
    graph: SGraph, uncertainty: Uncertainty, proposal: Proposal, pairs: IntArray
) -> list[Same]:
    ballot = _possible(graph, uncertainty, pairs)
    chosen = _elect(ballot)
    return [
        Same(proposal.concept, proposal.node, (int(a), int(b)), (float(x), float(y)))
        for (a, b), (x, y) in zip(ballot.pairs[chosen], ballot.points[chosen], strict=True)
    ]


def _possible(graph: SGraph, uncertainty: Uncertainty, pairs: IntArray) -> _Ballot:
    surfaces = graph.wall_surfaces.ordered()
    one, two = (np.array([graph.surface_row(i) for i in ids]) for ids in pairs.T.tolist())
    lie = coincidence(surfaces, one, two)
    jacobian = uncertainty.differences(pairs, lie.points)
    covariance = uncertainty.covariance(jacobian) + np.diag(np.tile(np.square(TIE_SIGMAS), len(pairs)))
    innovations = np.stack([lie.angles, lie.gaps], axis=1)
    single = np.array(
        [
            z @ np.linalg.solve(covariance[2 * k : 2 * k + 2, 2 * k : 2 * k + 2], z)
            for k, z in enumerate(innovations)
        ]
    )
    fit = np.flatnonzero(single <= chdtri(2, REJECTION))
    both = _both(fit)
    return _Ballot(
        pairs[fit],
        (lie.points + lie.gaps[:, None] / 2 * surfaces.normals[one])[fit],
        surfaces.normals[one[fit]],
        innovations[fit],
        covariance[np.ix_(both, both)],
    )


def _both(pairs: IntArray) -> IntArray:
    """Return the rows of the innovations of pairs."""
    return np.asarray((2 * pairs[:, None] + np.arange(2)).ravel())


@dataclass(frozen=True, eq=False)
class _Correction:
    support: IntArray
    squares: float


def _elect(ballot: _Ballot) -> IntArray:
    """Return the pairs of the best-supported correction; none where another rivals it."""
    corrections = [c for c in _corrections(ballot) if len(c.support) >= FEWEST]
    if not corrections:
        return np.empty(0, np.int64)
    best = max(corrections, key=lambda c: (len(c.support), -c.squares))
    rivals = [
        c
        for c in corrections
        if len(c.support) >= RIVAL * len(best.support) and _contradict(ballot, best, c)
    ]
    return np.empty(0, np.int64) if rivals else best.support


def _corrections(ballot: _Ballot) -> list[_Correction]:
    found = []
    seeds = range(min(len(ballot.pairs), MOST_SEEDS))
    for one in seeds:
        for two in range(one):
            normals = ballot.normals[[one, two]]
            if abs(normals[0, 0] * normals[1, 1] - normals[0, 1] * normals[1, 0]) < PARALLEL:
                continue
            correction = _correction(ballot, np.array([one, two]))
            if correction is not None:
                found.append(correction)
    return found


def _correction(ballot: _Ballot, seed: IntArray) -> _Correction | None:
    """Return what supports the correction that two pairs fix; None if they contradict the map."""
    rows, z, covariance = _both(seed), ballot.innovations.ravel(), ballot.covariance
    gain = np.linalg.solve(covariance[np.ix_(rows, rows)], covariance[rows]).T
    squares = float(z[rows] @ np.linalg.solve(covariance[np.ix_(rows, rows)], z[rows]))
    if squares > chdtri(len(rows), REJECTION):
        return None
    left = z - gain @ z[rows]
    remaining = covariance - gain @ covariance[rows]
    support = list(seed)
    for pair in range(len(ballot.pairs)):
        if pair in seed:
            continue
        block = slice(2 * pair, 2 * pair + 2)
        own = remaining[block, block]
        if own[1, 1] > PREDICTED_M**2:
            continue
        misfit = float(left[block] @ np.linalg.solve(own, left[block]))
        if misfit <= chdtri(2, REJECTION):
            support.append(pair)
            squares += misfit
    return _Correction(np.array(sorted(support)), squares)


def _contradict(ballot: _Ballot, one: _Correction, two: _Correction) -> bool:
    """Return whether two corrections move some surface to different places."""
    gaps: dict[int, list[float]] = {}
    for pair in one.support.tolist():
        for surface in ballot.pairs[pair].tolist():
            gaps.setdefault(surface, []).append(ballot.innovations[pair, 1])
    return any(
        abs(gap - ballot.innovations[pair, 1]) > APART_M
        for pair in two.support.tolist()
        for surface in ballot.pairs[pair].tolist()
        for gap in gaps.get(surface, [])
    )
