"""Which surfaces that concepts take for one surface mapped twice are tied.

A concept proposes pairs of surfaces. Alone a pair proves little: walls of a building repeat, and
what the map believes of its own accuracy is wrong where the front end matched a wrong wall. So
pairs vote. All that a short stretch of the drive saw must move onto the older map by one rigid
correction that the drift between may explain. Two pairs that are not parallel fix a correction;
every pair that it explains supports it, and so does every surface that the front end recognised
itself and that the correction leaves in place. A correction that puts walls where keyframes looked
through is wrong, whatever supports it. One that does not is accepted when enough walls support it,
and when neither another one nor what it would tear apart has nearly as much support: of equal doors
in a row each explains what is seen, and none is taken. Nor is a long one where a much shorter one
leaves what was seen in view: the place may be new.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from sgraph_concepts.errors import ConceptError
from sgraph_concepts.types import FloatArray, IntArray, SurfaceArrays
from sgraph_core.backend.coincidence import coincidence
from sgraph_core.backend.corrections import (
    REJECTION,
    Corrections,
    composed,
    corrections_of,
    possible,
)
from sgraph_core.backend.drift import Drift
from sgraph_core.backend.sight_lines import SightLines
from sgraph_core.backend.visits import Visits
from sgraph_core.backend.votes import MOST_SUPPORT_M, Votes, votes_of_pairs, votes_of_rows
from sgraph_core.geometry import meeting_box
from sgraph_core.graph import SGraph

__all__ = ["Association", "Proposal", "Same", "associate"]

TIE_SIGMAS = (0.02, 0.03)
"""How two mapped pieces of one wall differ from one plane: angle in rad, offset in m."""
MORE_DRIFT = 1.5
"""Drift by more than its own noise: loops stay open where noise was large."""
DRIFT_SHARE, DRIFT_RAD_PER_M = 0.01, np.radians(0.02)
"""Drift that is not noise, such as of a wall taken for another, per metre of the way."""
LEAST_DRIFT_M, LEAST_DRIFT_RAD = 0.1, np.radians(1.0)
WINDOW = 20
"""Keyframes that see the older map again together: short enough to be rigid."""
DOUBT = 30
"""Keyframes around a correction within which the front end's own recognitions are doubted."""
FEWEST_NEW = 2
"""Surfaces mapped anew that must support a correction that moves them far."""
LEAST_SUPPORT_M = 5.0
EXPLAINED = 0.4
"""Share of what a window saw, and what might be known, that its correction must explain."""
BLOCKED = 0.03
"""Share of the lines of sight that a right correction may block."""
LONG_M = 1.5
"""A correction this long may be to the next room, if a much shorter one contradicts nothing."""
SHORTER = 0.5
"""How much shorter that is."""
RIVAL = 0.7
"""A rival with this share of the best one's support makes both ambiguous."""
OTHER_M, OTHER_RAD = 0.3, np.radians(8.0)
"""Corrections that differ by more are not the same."""
ELSEWHERE_M = 0.6
"""Corrections that differ by more are of another place; of others, what all support holds."""
ALIKE = 0.9
"""Share of what was recognised that another place must have, to look like it."""
SURE = 1 / 3
"""Share of the shift to a place that looks alike: a shorter correction is surely no such shift."""
REPEAT_M = 8.0
"""How far away another place may look like the one that was recognised."""


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
        pair: ids of the older and the newer surface.
    """

    concept: str
    node: int
    pair: tuple[int, int]


@dataclass(frozen=True)
class Association:
    """What votes decided.

    Attributes:
        same: pairs of surfaces that are one.
        doubted: surfaces that the front end recognised at a later visit near which it was wrong
            about others: id and row of the keyframe that begins the visit.
    """

    same: Sequence[Same] = ()
    doubted: Sequence[tuple[int, int]] = ()

    def with_(self, other: Association) -> Association:
        """Return both together; what comes first keeps its place."""
        return Association(
            list(dict.fromkeys([*self.same, *other.same])),
            list(dict.fromkeys([*self.doubted, *other.doubted])),
        )


def associate(
    graph: SGraph, proposals: Sequence[Proposal], known: Association = Association()
) -> Association:
    """Return which of the proposed pairs are one surface.

    Args:
        graph: an S-Graph whose low layers are solved.
        proposals: pairs of observed surfaces.
        known: what was decided before.

    Raises:
        ConceptError: a pair names something else.
        OptimizationError: sigmas differ by too much to tell how far the drive has drifted.
    """
    visits = Visits(graph)
    who = _candidates(proposals, visits, {frozenset(same.pair) for same in known.same})
    if not who:
        return Association()
    votes = votes_of_pairs(graph, list(who), visits, set(known.doubted))
    drive = _Drive(graph, visits, Drift(graph), SightLines(graph))
    elections = [
        election
        for first in range(0, len(graph.keyframes.ids), WINDOW // 2)
        if (election := _elect(votes.within(first, first + WINDOW), first, drive)) is not None
    ]
    found = Association()
    for election in _surest(elections):
        window = election.window
        if election.moves and not _distinct(election, drive):
            continue
        pairs = window.pairs[election.chosen & ~window.held].tolist()
        same = [Same(who[a, b].concept, who[a, b].node, (a, b)) for a, b in pairs]
        doubted = _doubted(votes, election.first) if election.moves else []
        found = found.with_(Association(same, doubted))
    return found


def _surest(elections: Sequence[_Election]) -> list[_Election]:
    """Return the best supported elections of their surroundings: the next round sees the others."""
    taken: list[_Election] = []
    for election in sorted(elections, key=lambda e: -e.weight):
        if all(abs(election.first - other.first) > DOUBT for other in taken):
            taken.append(election)
    return taken


def _doubted(votes: Votes, first: int) -> list[tuple[int, int]]:
    """Return what the front end recognised around a window: surfaces and beginnings of visits."""
    near = votes.within(first - DOUBT, first + WINDOW + DOUBT)
    near = near.take(near.held)
    return list(zip(near.pairs[:, 0].tolist(), near.visits[:, 0].tolist(), strict=True))


def _candidates(
    proposals: Sequence[Proposal], visits: Visits, done: set[frozenset[int]]
) -> dict[tuple[int, int], Proposal]:
    """Return who proposes which pair, older surface first; not those that were seen together."""
    who: dict[tuple[int, int], Proposal] = {}
    for proposal in proposals:
        for one, two in proposal.pairs:
            if one not in visits or two not in visits:
                what = f"factor of {proposal.concept} {proposal.node}"
                raise ConceptError(f"{what}: {one} and {two} must be ids of observed surfaces")
            pair = (one, two) if visits.first(one) <= visits.first(two) else (two, one)
            if frozenset(pair) not in done and not visits.together(one, two):
                who.setdefault(pair, proposal)
    return who


@dataclass(frozen=True, eq=False)
class _Drive:
    """What is known of a drive, whatever is proposed."""

    graph: SGraph
    visits: Visits
    drift: Drift
    sights: SightLines

    def spread(self, between: Sequence[tuple[int, int]], centre: FloatArray) -> FloatArray:
        """Return the covariance of a correction about a point: angle, x and y, [3, 3].

        Args:
            between: rows of the two keyframes that what is corrected lies between, for each pair.
            centre: the point.
        """
        typical = sorted(between, key=lambda rows: self.visits.way(*rows))[len(between) // 2]
        way = self.visits.way(*typical)
        shift = LEAST_DRIFT_M + DRIFT_SHARE * way
        other = np.array([LEAST_DRIFT_RAD + DRIFT_RAD_PER_M * way, shift, shift])
        drifted = self.drift.between(*typical, centre)
        return np.asarray(np.diag(other**2) + MORE_DRIFT**2 * drifted)

    def is_free(self, first: int, move: FloatArray, centre: FloatArray) -> bool:
        """Return whether keyframes look through no wall once a window is moved about its centre."""
        return self.sights.blocked(first, first + WINDOW, move, centre) <= BLOCKED

    def is_free_within(
        self, first: int, shift_m: float, turn_rad: float, centre: FloatArray
    ) -> bool:
        """Return whether a correction of a window with so small a shift and angle is free."""
        ways, turns = np.linspace(-1, 1, 7) * shift_m, np.linspace(-1, 1, 5) * turn_rad
        moves = np.stack(np.meshgrid(turns, ways, ways), axis=-1).reshape(-1, 3)
        shifts = np.linalg.norm(moves[:, 1:], axis=1)
        order = np.lexsort((np.abs(moves[:, 0]), shifts))  # to stay is what most often is free
        near = order[shifts[order] <= shift_m]
        return any(self.is_free(first, move, centre) for move in moves[near])


@dataclass(frozen=True, eq=False)
class _Election:
    """A correction of a window that was accepted.

    Attributes:
        first: the row of a keyframe where the window begins.
        window: all its pairs.
        chosen: which of them hold, [P].
        centre: about which the correction turns, [2].
        move: the correction: angle, x and y, [3].
        weight: metres of wall in support.
    """

    first: int
    window: Votes
    chosen: NDArray[np.bool_]
    centre: FloatArray
    move: FloatArray
    weight: float

    @property
    def moves(self) -> bool:
        """Whether the window moves by more than a front end's gate may have missed."""
        return bool(_differ(self.move))


def _differ(moves: FloatArray, shift_m: float = OTHER_M) -> NDArray[np.bool_]:
    """Return which differences of corrections, [..., 3], are such that these are not the same."""
    return np.asarray((np.abs(moves) > [OTHER_RAD, shift_m, shift_m]).any(axis=-1))


def _elect(window: Votes, first: int, drive: _Drive) -> _Election | None:
    """Return the best supported correction of a window; None where none is beyond doubt."""
    if window.held.all():
        return None
    centre = window.points.mean(axis=0)
    times = zip(window.pairs[:, 0].tolist(), window.visits[:, 0].tolist(), strict=True)
    spread = drive.spread(
        [(drive.visits.last_before(older, time), time) for older, time in times], centre
    )
    everything = window.weights(np.ones((1, len(window.pairs)), bool))[0]
    window = window.take(window.held | possible(window, spread, centre))
    if window.held.all():
        return None
    # the stretch that moves begins where the first of all this was seen
    first = max(first, int(window.visits[:, 0].min()))
    corrections = corrections_of(window, spread, centre)
    # a window that moves takes with it what it saw for the first time
    idle = _differ(corrections.moves)[:, None] & (window.since >= first)
    corrections = Corrections(corrections.moves, corrections.support & ~idle).fixed_by(window)
    moves, support = corrections.moves, corrections.support
    weights, shifts = window.weights(support), np.linalg.norm(moves[:, 1:], axis=1)

    @cache
    def is_free(k: int) -> bool:  # to stay needs no leave
        return not _differ(moves[k]) or drive.is_free(first, moves[k], centre)

    enough = weights >= max(LEAST_SUPPORT_M, EXPLAINED * everything)
    order = np.lexsort((shifts, -weights.round(6)))
    best = next((k for k in order[enough[order]].tolist() if is_free(k)), None)
    if best is None:
        return None
    torn = window.held & ~support[best]
    needless = shifts[best] > LONG_M and drive.is_free_within(
        first, SHORTER * shifts[best], np.sqrt(spread[0, 0]), centre
    )
    if needless or window.weights(torn[None])[0] >= RIVAL * weights[best]:
        return None
    rivals = _differ(moves - moves[best]) & (weights >= RIVAL * weights[best])
    elsewhere = _differ(moves - moves[best], ELSEWHERE_M)
    as_likely = rivals & elsewhere & (SURE * shifts <= shifts[best])
    if any(is_free(k) for k in np.flatnonzero(as_likely).tolist()):
        return None
    beside = [k for k in np.flatnonzero(rivals & ~elsewhere).tolist() if is_free(k)]
    chosen = support[best] & support[beside].all(axis=0)
    election = _Election(first, window, chosen, centre, moves[best], float(weights[best]))
    anew = np.unique(window.pairs[chosen & ~window.held, 1])
    return None if len(anew) < (FEWEST_NEW if election.moves else 1) else election


def _distinct(election: _Election, drive: _Drive) -> bool:
    """Return whether no other place near by looks like the one that was recognised.

    The surfaces that were recognised are matched with the rest of the older map, like a visit that
    has drifted far. Where a shift explains them as well, the window would block no lines of sight
    there either, and drift does not explain the shift, the map repeats, as rooms in a row do, and
    only a correction that is clearly shorter than that shift tells a copy from the next room.
    """
    known = np.unique(election.window.pairs[election.chosen, 0])
    graph, visits = drive.graph, drive.visits
    surfaces = graph.wall_surfaces.ordered()
    mine = np.array([graph.surface_row(i) for i in known.tolist()], np.int64)
    segments = surfaces.segments
    rows = np.flatnonzero(meeting_box(segments, segments[mine], np.sqrt(2) * REPEAT_M))
    ids = surfaces.ids[rows].tolist()
    older = [i in visits and visits.first(i) < election.first for i in ids]
    one, two = (side.ravel() for side in np.meshgrid(rows[older], mine, indexing="ij"))
    lie = coincidence(surfaces, one, two)
    like = (one != two) & (np.abs(lie.gaps) <= REPEAT_M) & (np.abs(lie.angles) <= OTHER_RAD)
    like &= lie.overlaps >= -REPEAT_M
    if not like.any():
        return True
    place = votes_of_rows(surfaces, one[like], two[like])
    around = np.diag(np.array([OTHER_RAD, REPEAT_M, REPEAT_M]) / 3) ** 2
    centre = place.points.mean(axis=0)
    repeats = corrections_of(place, around, centre)
    lengths = np.linalg.norm(repeats.moves[:, 1:], axis=1)
    alike = place.weights(repeats.support) >= ALIKE * _own(surfaces, mine)
    nearest = float(np.linalg.norm(election.move[1:])) / SURE
    return not any(
        drive.is_free(
            election.first,
            composed(election.move, election.centre, repeats.moves[k], centre),
            election.centre,
        )
        and not _may_be_drift(place, repeats, k, drive)
        for k in np.flatnonzero(alike & (lengths > OTHER_M) & (lengths <= nearest)).tolist()
    )


def _may_be_drift(place: Votes, repeats: Corrections, k: int, drive: _Drive) -> bool:
    """Return whether a place may repeat because it was mapped twice, with drift between."""
    visits = drive.visits
    between = [
        (min(visits.first(one), visits.first(two)), max(visits.first(one), visits.first(two)))
        for one, two in place.pairs[repeats.support[k]].tolist()
    ]
    spread = drive.spread(between, place.points.mean(axis=0))
    move = repeats.moves[k]
    return bool(move @ np.linalg.inv(spread) @ move <= chdtri(3, REJECTION))


def _own(surfaces: SurfaceArrays, rows: IntArray) -> float:
    return float(np.minimum(surfaces.lengths[rows], MOST_SUPPORT_M).sum())
