"""Which of the factors in somebody's graph contradict its solution.

A group of factors, a node's own or a tie, is tested when it is new and when a plane that it refers
to has moved since it was tested: how well it fits depends on nothing else, for its own variables
follow the planes. ISAM2's estimate is a solution only once it has linearised anew what has moved;
before that the group's own variables are not where they fit best, and the group waits, though not
for ever.

Of the misfits that were seen in one stretch of the drive only the worst are refused, since they may
be what bends the others; these are tested again in the next solution.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import gtsam
import numpy as np

from sgraph_concepts.errors import ConceptError, one_line
from sgraph_concepts.types import FactorResult, FloatArray, IntArray
from sgraph_core.backend.association import Same
from sgraph_core.backend.keys import Keys
from sgraph_core.backend.robust import STRETCH, Refusal, keys_of, misfit, worst_of
from sgraph_core.graph import SGraph
from sgraph_core.slam.estimate import observations_of
from sgraph_core.slam.handout import Handout, Owner

__all__ = ["Misfits", "Verdict"]

MOVED = 2e-3
"""A plane has moved when a component of its normal, or its offset in m, differs by more."""
PATIENCE = 10
"""A group that is not settled in so many solutions in a row is judged as it is."""
SETTLED = 1.0
"""A group is settled when its own variables can lower its squared error by no more than this."""


@dataclass(frozen=True, eq=False)
class _Group:
    """Factors that stand or fall together; ``own`` holds the dimensions of their own variables."""

    concept: str
    node: int
    surfaces: tuple[int, ...]
    factors: Sequence[gtsam.NonlinearFactor]
    own: Mapping[int, int]
    keys: frozenset[int]

    def refusal(self, values: gtsam.Values) -> Refusal | None:
        return misfit(self.concept, self.node, self.surfaces, self.factors, self.own, values)

    def settled(self, values: gtsam.Values) -> bool:
        try:
            return self._excess(values) <= SETTLED
        except Exception as error:  # a third party's factors may raise anything
            what = f"factor of {self.concept} {self.node}"
            raise ConceptError(f"{what} cannot be linearised: {one_line(error)}") from error

    def _excess(self, values: gtsam.Values) -> float:
        """Return by how much a step of the own variables would lower the squared error."""
        if not self.own:
            return 0.0
        point = values.extract(sorted(self.keys))
        dims, residuals, slopes = point.dims(), [], []
        for factor in self.factors:
            linear = factor.linearize(point)
            jacobian, residual = linear.jacobian()
            keys = linear.keys()
            starts = np.cumsum([0, *(dims[key] for key in keys)])
            slope = {key: np.zeros((len(residual), size)) for key, size in self.own.items()}
            for key, start in zip(keys, starts, strict=False):
                if key in slope:
                    slope[key] = jacobian[:, start : start + dims[key]]
            slopes.append(np.hstack([slope[key] for key in self.own]))
            residuals.append(residual)
        whole, toward = np.concatenate(residuals), np.concatenate(slopes)
        if not np.isfinite(whole).all():
            return np.inf
        step = np.linalg.lstsq(toward, whole, rcond=None)[0]
        return float(whole @ whole - np.sum((whole - toward @ step) ** 2))


@dataclass(frozen=True, eq=False)
class Verdict:
    """What a solution shows.

    Attributes:
        found: why factors are to be switched off, by owner.
        waiting: whose factors are to be tested in the next solution in any case, and in how many
            solutions in a row they have been misfits.
        surfaces: ids of the surfaces whose planes were looked at, ascending, [N].
        planes: where each was when what concerns it was tested, [N, 4].
    """

    found: Mapping[Owner, Refusal] = field(default_factory=dict)
    waiting: Mapping[Owner, int] = field(default_factory=dict)
    surfaces: IntArray = field(default_factory=lambda: np.empty(0, np.int64))
    planes: FloatArray = field(default_factory=lambda: np.empty((0, 4)))


class Misfits:
    """Tests the factors that a ledger holds.

    Attributes:
        verdict: on the last solution.

    Args:
        keys: of the surfaces.
    """

    def __init__(self, keys: Keys) -> None:
        self._keys = keys
        self._groups: dict[Owner, _Group] = {}
        self._at: dict[int, set[Owner]] = {}
        self.verdict = Verdict()

    def take(self, handout: Handout, ties: Mapping[Owner, Same]) -> None:
        """Take in what a handout replaces; what is new is to be tested."""
        replaced = {*handout.gone, *(owner for owner, _ in handout.made)}
        for owner in replaced & self._groups.keys():
            for key in self._groups.pop(owner).keys:
                self._at[key].discard(owner)
        new = {owner: _group(owner, made, ties) for owner, made in handout.made if made.factors}
        for owner, group in new.items():
            for key in group.keys:
                self._at.setdefault(key, set()).add(owner)
        self._groups |= new
        found, waiting = dict(self.verdict.found), dict(self.verdict.waiting)
        for owner in replaced:
            found.pop(owner, None)
            waiting.pop(owner, None)
        waiting |= dict.fromkeys(new, 0)
        self.verdict = replace(self.verdict, found=found, waiting=waiting)

    def judge(
        self, graph: SGraph, values: gtsam.Values, surfaces: IntArray, planes: FloatArray
    ) -> Verdict:
        """Test what is new and what planes that have moved concern; nothing is remembered.

        Args:
            graph: who observed what.
            values: a solution of the graph that holds the factors; those of which it lacks a
                variable wait.
            surfaces: ids of the surfaces that it holds, ascending.
            planes: theirs, [N, 4].

        Raises:
            ConceptError: a factor fails.
        """
        moved, known, stored = self._moved(surfaces, planes)
        concerned = (self._at.get(self._keys.surface(i), ()) for i in moved)
        before = self.verdict.waiting
        waiting = set(before).union(*concerned)
        tested = [owner for owner in waiting if self._is_held(owner, values)]
        found = {o: r for o in tested if (r := self._groups[o].refusal(values)) is not None}
        times = {o: before.get(o, 0) + 1 for o in found}
        ripe = {o for o in found if times[o] >= PATIENCE or self._groups[o].settled(values)}
        worst = {id(r) for r in worst_of(self._with_stretches(found, graph, surfaces))}
        return Verdict(
            {owner: r for owner, r in found.items() if owner in ripe and id(r) in worst},
            dict.fromkeys(waiting.difference(tested), 0) | times,
            known,
            stored,
        )

    def _is_held(self, owner: Owner, values: gtsam.Values) -> bool:
        return all(values.exists(key) for key in self._groups[owner].keys)

    def _moved(
        self, surfaces: IntArray, planes: FloatArray
    ) -> tuple[list[int], IntArray, FloatArray]:
        """Return what has moved or was not known before, and where everything is looked at now."""
        before = self.verdict
        known = np.union1d(before.surfaces, surfaces)
        stored = np.full((len(known), 4), np.nan)
        stored[np.searchsorted(known, before.surfaces)] = before.planes
        rows = np.searchsorted(known, surfaces)
        moved = ~(np.abs(stored[rows] - planes) <= MOVED).all(axis=1)
        stored[rows[moved]] = planes[moved]
        return surfaces[moved].tolist(), known, stored

    def _with_stretches(
        self, found: Mapping[Owner, Refusal], graph: SGraph, surfaces: IntArray
    ) -> list[tuple[Refusal, set[int]]]:
        """Return misfits with the stretches of the drive that saw their surfaces."""
        if len(found) < 2:
            return [(refusal, set()) for refusal in found.values()]
        ids = {self._keys.surface(i): i for i in surfaces.tolist()}
        of = {
            owner: [ids[key] for key in self._groups[owner].keys if key in ids] for owner in found
        }
        concerned = np.unique(np.concatenate(list(of.values())))
        seen, by = observations_of(graph, concerned)
        return [
            (refusal, set((by[np.isin(concerned[seen], of[owner])] // STRETCH).tolist()))
            for owner, refusal in found.items()
        ]


def _group(owner: Owner, result: FactorResult, ties: Mapping[Owner, Same]) -> _Group:
    own = gtsam.Values()
    for key, value in result.values:
        own.insert(key, value)
    of = ties.get(owner)
    concept, node, surfaces = (of.concept, of.node, of.pair) if of else (*owner[:2], ())
    keys = frozenset(keys_of(result.factors))
    return _Group(concept, node, surfaces, result.factors, own.dims(), keys)
