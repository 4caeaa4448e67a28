"""The rigid corrections that pairs of surfaces vote for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from sgraph_concepts.types import FloatArray, IntArray
from sgraph_core.backend.votes import Votes
from sgraph_core.geometry import cross, dot, turn_left

__all__ = ["REJECTION", "Corrections", "composed", "corrections_of", "possible"]

REJECTION = 1e-2
"""Probability with which a pair is refused though the right correction explains it."""
LEAST_OVERLAP_M = 0.3
PARALLEL = np.sin(np.radians(30.0))
FEWEST = 3
"""Surfaces that must support a correction."""
MOST_SEEDS = 40


@dataclass(frozen=True, eq=False)
class Corrections:
    """C rigid corrections of what votes: angle a, shift s about its centre c.

    A point p goes to p + s + a J (p - c), with J the quarter turn.

    Attributes:
        moves: angle, x and y of each, [C, 3].
        support: which pairs each explains, [C, P].
    """

    moves: FloatArray
    support: NDArray[np.bool_]

    def fixed_by(self, votes: Votes) -> Corrections:
        """Return those that enough surfaces support, not all parallel, one of them proposed."""
        across = self.support.astype(np.float64) @ _crossing(votes) > 0
        fixed = (across & self.support).any(axis=1)
        fixed &= votes.newer_in(self.support).sum(axis=1) >= FEWEST
        fixed &= (self.support & ~votes.held).any(axis=1)
        return Corrections(self.moves[fixed], self.support[fixed])


def corrections_of(votes: Votes, spread: FloatArray, centre: FloatArray) -> Corrections:
    """Return the corrections about a centre that two pairs fix and several surfaces support.

    Args:
        votes: the pairs.
        spread: covariance of the correction that drift may ask for, [3, 3].
        centre: the centre, [2].
    """
    design = _design(votes, centre) / votes.sigmas[:, :, None]
    target = votes.innovations / votes.sigmas
    some = _some(votes)
    one, two = (some[side] for side in np.triu_indices(len(some), k=1))
    seeds = _crossing(votes)[one, two]
    support = np.zeros((int(seeds.sum()), len(votes.pairs)), bool)
    rows, expected = np.arange(len(support)), np.asarray(np.linalg.inv(spread), np.float64)
    support[rows, one[seeds]] = support[rows, two[seeds]] = True

    def explained(support: NDArray[np.bool_]) -> tuple[FloatArray, NDArray[np.bool_]]:
        moves = _fit(design, target, support, expected)
        likely = np.einsum("ci,ij,cj->c", moves, expected, moves) <= chdtri(3, REJECTION)
        moves = moves[likely]
        left = (target.ravel() - moves @ design.reshape(-1, 3).T) ** 2
        close = left[:, ::2] + left[:, 1::2] <= chdtri(2, REJECTION)
        return moves, close & _side_by_side(votes, moves, centre)

    moves, support = explained(_each_once(explained(support)[1]))
    return Corrections(moves, support).fixed_by(votes)


def composed(
    move: FloatArray, centre: FloatArray, then: FloatArray, about: FloatArray
) -> FloatArray:
    """Return a correction about its centre that is followed by another one about another, [3].

    Angles are small: their product is left out.
    """
    arm = centre + move[1:] - about
    return np.asarray(move + then + then[0] * np.append(0.0, turn_left(arm)))


def possible(votes: Votes, spread: FloatArray, centre: FloatArray) -> NDArray[np.bool_]:
    """Return which pairs the drift explains, each for itself, [P]; see :func:`corrections_of`."""
    design = _design(votes, centre)
    variance = np.einsum("pij,jk,pik->pi", design, spread, design) + votes.sigmas**2
    likely = votes.innovations**2 / variance
    return np.asarray((likely <= chdtri(1, REJECTION / 10)).all(axis=1))


def _crossing(votes: Votes) -> NDArray[np.bool_]:
    """Return which pairs are not parallel to which, [P, P]."""
    return np.asarray(np.abs(cross(votes.normals[:, None], votes.normals[None])) > PARALLEL)


def _some(votes: Votes) -> IntArray:
    """Return at most MOST_SEEDS of the pairs, drawn evenly from the proposed ones first."""
    proposed = np.flatnonzero(~votes.held)
    drawn = np.random.default_rng(0).permutation(proposed)[:MOST_SEEDS]
    return np.append(np.sort(drawn), np.flatnonzero(votes.held)[: MOST_SEEDS - len(drawn)])


def _each_once(support: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the different ones of corrections' supports, in their order, [C, P]."""
    _, first = np.unique(np.packbits(support, axis=1), axis=0, return_index=True)
    return support[np.sort(first)]


def _design(votes: Votes, centre: FloatArray) -> FloatArray:
    """Return how innovations follow from a correction of the newer side, [P, 2, 3]."""
    normals, arms = votes.normals, votes.points - centre
    design = np.zeros((len(normals), 2, 3))
    design[:, 0, 0] = 1.0
    design[:, 1, 0] = -cross(arms, normals)
    design[:, 1, 1:] = -normals
    return design


def _fit(
    design: FloatArray, target: FloatArray, support: NDArray[np.bool_], expected: FloatArray
) -> FloatArray:
    """Return the least-squares corrections of supporting pairs and of the drift model, [C, 3]."""
    weights = support.astype(np.float64)
    squares = np.einsum("pij,pik->pjk", design, design).reshape(-1, 9)
    normal = (weights @ squares).reshape(-1, 3, 3) + expected
    right = weights @ np.einsum("pij,pi->pj", design, target)
    return np.asarray(np.linalg.solve(normal, right[:, :, None])[:, :, 0])


def _side_by_side(votes: Votes, moves: FloatArray, centre: FloatArray) -> NDArray[np.bool_]:
    """Return which pairs overlap once the newer surface is moved, [C, P]."""
    tangents = turn_left(votes.normals)
    ends = np.sort(dot(votes.segments, tangents[:, None, None]), axis=2)
    (old_low, old_high), (new_low, new_high) = ends.transpose(1, 2, 0)
    arms = votes.segments[:, 1].mean(axis=1) - centre
    shifts = moves @ np.column_stack([dot(turn_left(arms), tangents), tangents]).T
    long = np.minimum(old_high - old_low, new_high - new_low) >= LEAST_OVERLAP_M
    reaches = shifts >= old_low + LEAST_OVERLAP_M - new_high
    return np.asarray(long & reaches & (shifts <= old_high - LEAST_OVERLAP_M - new_low))
